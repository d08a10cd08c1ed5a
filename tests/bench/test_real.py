"""Conversion of the real recordings and prediction from named effects."""

import numpy as np
import pandas as pd
import pytest

from bench.concealed.answer import Answer, Named
from bench.real import balldrop, juggling_mocap, rocket_coast, rod_pendulum
from bench.real.falling import Fall, fall_of, predict
from bench.real.named import outcome
from measuring.setup.file import load_setup
from tests.shared_data import shared_folder


@pytest.mark.parametrize(
    ("named", "groups", "truth", "said"),
    [
        ({"drag": 0.9}, [], ("drag",), "right"),
        ({"wind": 0.9}, [{"wind", "drag"}], ("drag",), "right"),
        ({"wind": 0.9}, [], ("drag",), "wrong"),
        ({"drag": 0.9, "wind": 0.6}, [], ("drag",), "wrong"),
        ({"drag": 0.9, "wind": 0.4}, [], ("drag",), "right"),
        ({"drag": 0.9}, [], ("drag", "magnus"), "in part"),
        ({"drag": 0.4}, [], ("drag",), "silent"),
        ({}, [], (), "right"),
    ],
)
def test_an_answer_to_a_recording_is_right_in_part_silent_or_wrong(named, groups, truth, said):
    names = tuple(Named(one, chance, {}) for one, chance in named.items())
    answer = Answer("ambiguous", names, tuple(frozenset(one) for one in groups))
    assert outcome(answer, truth) == said


def test_only_the_free_swing_of_the_rod_is_converted(tmp_path):
    rod_pendulum.convert(shared_folder("realdata") / "rod_pendulum", tmp_path)
    table = pd.read_csv(tmp_path / "pendulum.csv")
    first = table.groupby("trial").first()
    # Second turning points, read off a plot: 98, 126 and 58 degrees.
    assert np.degrees(first["phi_rad"]).to_numpy() == pytest.approx([98.5, 125.8, 58.3], abs=1)
    assert load_setup(tmp_path / "setup.toml").pendulum is not None


def test_the_right_torques_predict_a_held_out_release():
    source = shared_folder("realdata") / "rod_pendulum"
    inertia = rod_pendulum.ROD_MASS * rod_pendulum.ROD_LENGTH**2 / 3
    both = Answer(
        "explained",
        (
            Named("viscous_damping", 1.0, {"viscous_coefficient": (0.215 * inertia, None)}),
            Named("bearing_friction", 1.0, {"dry_torque": (2.06 * inertia, None)}),
        ),
    )
    assert rod_pendulum.held_out_rmse(source, both, (2, 3), 1) < 1.5
    assert rod_pendulum.held_out_rmse(source, Answer("no_mismatch"), (2, 3), 1) > 10


def test_a_fall_is_predicted_from_its_first_half():
    time = np.linspace(0, 3, 60)
    drag = Answer("explained", (Named("drag", 1.0, {"drag_coefficient": (0.5, 0.1)}),))
    fall = fall_of(drag, mass=0.05, diameter=0.07, density=1.2)
    k = 0.25 * 1.2 * np.pi / 4 * 0.07**2 / 0.05
    assert fall == Fall(drag_per_mass=pytest.approx(k))
    # From rest, y = h - ln cosh(t sqrt(g k)) / k.
    height = 40 - np.log(np.cosh(time * np.sqrt(9.80665 * k))) / k
    known = time < 1.5
    assert predict(fall, time, height, known)[-1] == pytest.approx(height[-1], abs=0.01)
    vacuum = predict(Fall(), time, height, known)
    assert abs(vacuum[-1] - height[-1]) > 1


def test_the_other_sets_are_converted(tmp_path):
    shared = shared_folder("realdata")
    rocket_coast.convert(shared / "rocket_coast", tmp_path / "r", "juno3", 0.5)
    balldrop.convert(shared / "balldrop", tmp_path / "b", ("volleyball", "golf_ball"), (1,))
    juggling_mocap.convert(shared / "juggling_mocap", tmp_path / "j", "6_throws")
    assert set(pd.read_csv(tmp_path / "b" / "ball.csv")["ball"]) == {"volleyball", "golf_ball"}
    for name in "rbj":
        load_setup(tmp_path / name / "setup.toml")
    juggling = pd.read_csv(tmp_path / "j" / "ball.csv")
    # Flights accelerate downwards along y, which points up.
    one = juggling[juggling["trial"] == juggling["trial"].iloc[0]]
    assert np.polyfit(one["t_s"], one["y_m"], 2)[0] == pytest.approx(-4.9, abs=0.3)
