"""Campaigns of the independent simulator: setup file, tables and key."""

import json
import tomllib

import pandas as pd
import pytest

from bench.concealed.foreign import convert, foreign_key
from bench.concealed.setup_toml import BallFacts, LabFacts, Outcome, setup_text
from tests.shared_data import shared_folder

OUTCOME = Outcome(1.1, 0.75, 0.0165, 0.95, 0.1787, 0.0169, 0.4146, 1.79, 0.155)
FACTS = LabFacts(
    balls={"jokku": BallFacts(0.353, 0.20175, 8.5, "0.1*exp(-0.2*v) + 0.67", (OUTCOME,))},
    pendulum_length=0.5541,
    pendulum_inertia=1.579,
    pendulum_mass=6.0,
    pendulum_com=0.4553,
    support_height=0.312,
    air_density=1.18,
    air_viscosity=1.852e-5,
    position_noise=0.0017,
    angle_noise=0.0011,
    drag_coefficient=0.45,
)


def test_the_setup_file_has_the_keys_of_the_schema():
    setup = tomllib.loads(setup_text(FACTS))
    assert setup["camera"] == {"capture_fps": 600}
    assert setup["balls"]["jokku"]["contact_outcome"] == [
        {
            "impact_speed": 1.1,
            "cor": 0.75,
            "contact_time": 0.0165,
            "pendulum_speed_after": 0.95,
            "pendulum_angle": 0.1787,
            "ball_x": 0.0169,
            "ball_y": 0.4146,
            "ball_vx": 1.79,
            "ball_vy": 0.155,
        }
    ]
    assert setup["model"] == {"effects": ["gravity", "drag"], "drag": {"drag_coefficient": 0.45}}
    assert setup["noise"]["position"] == "1.7 mm"


def test_a_baseline_without_air_has_only_gravity():
    without = tomllib.loads(setup_text(LabFacts(**{**vars(FACTS), "drag_coefficient": None})))
    assert without["model"] == {"effects": ["gravity"]}


def test_a_converted_campaign_contains_the_public_facts(tmp_path):
    source = shared_folder("concealed_dev") / "01"
    convert(source, tmp_path / "01")
    public = json.loads((source / "public.json").read_text())
    setup = tomllib.loads((tmp_path / "01" / "setup.toml").read_text())
    theirs = public["balls"]["basketball"]["baseline_contact"][2]
    ours = setup["balls"]["basketball"]["contact_outcome"][2]
    assert ours["ball_vy"] == pytest.approx(theirs["vy"], rel=1e-9)
    assert ours["pendulum_angle"] == pytest.approx(theirs["phi_release"], rel=1e-9)
    assert setup["scatter"]["launch_angle_law"] == "0.3 deg"
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "01" / "ball.csv"), pd.read_csv(source / "ball.csv")
    )
    assert not (tmp_path / "01" / "answer.json").exists()


@pytest.mark.parametrize(
    ("name", "acts_in", "phase"),
    [
        ("aging", "contact", "across_trials"),
        ("cor_velocity", "contact", "contact"),
        ("frame_rate", "camera", "measurement"),
    ],
)
def test_a_key_has_the_phases_of_the_answers(tmp_path, name, acts_in, phase):
    effect = {"name": name, "acts_in": acts_in, "strength_parameter": "a", "parameters": {"a": 0.1}}
    key = {
        "case": 1, "kind": "single", "level": "strong", "delta_chi2": 200.0, "trials": [],
        "delta_chi2_of_each_effect_alone": {}, "indistinguishable_single_effects_expected": [],
        "effects": [effect],
    }  # fmt: skip
    (tmp_path / "answer.json").write_text(json.dumps(key))
    assert foreign_key(tmp_path / "answer.json").effects[0].phase == phase
