"""Conversion of the real recordings."""

import numpy as np
import pandas as pd
import pytest

from bench.real import juggling_mocap, rocket_coast, rod_pendulum
from pipelines.setup.file import load_setup
from tests.shared_data import shared_folder


def test_only_the_free_swing_of_the_rod_is_converted(tmp_path):
    rod_pendulum.convert(shared_folder("realdata") / "rod_pendulum", tmp_path)
    table = pd.read_csv(tmp_path / "pendulum.csv")
    first = table.groupby("trial").first()
    # Second turning points, read off a plot: 98, 126 and 58 degrees.
    assert np.degrees(first["phi_rad"]).to_numpy() == pytest.approx([98.5, 125.8, 58.3], abs=1)
    assert load_setup(tmp_path / "setup.toml").pendulum is not None


def test_the_other_sets_are_converted(tmp_path):
    shared = shared_folder("realdata")
    rocket_coast.convert(shared / "rocket_coast", tmp_path / "r", "juno3", 0.5)
    juggling_mocap.convert(shared / "juggling_mocap", tmp_path / "j", "6_throws")
    for name in "rj":
        load_setup(tmp_path / name / "setup.toml")
    juggling = pd.read_csv(tmp_path / "j" / "ball.csv")
    # Flights accelerate downwards along y, which points up.
    one = juggling[juggling["trial"] == juggling["trial"].iloc[0]]
    assert np.polyfit(one["t_s"], one["y_m"], 2)[0] == pytest.approx(-4.9, abs=0.3)
