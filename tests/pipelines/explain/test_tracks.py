"""The free motion cut out of a whole track: rest, push, flight and bounce known exactly."""

import numpy as np
import pandas as pd
import pytest

from measuring.setup.file import read_setup
from metrology import UsageError
from mismatch.verdict import DOUBTED, Doubt
from pipelines.explain.campaign import explain_files
from pipelines.explain.clips import flight_rows, is_track_table, swing_rows

TOUCH, RELEASE, PUSHED, LANDS = 0.1, 0.115, 0.04, 0.5
PX_PER_M = 200.0


def track(direction: float = 1.0, noise: float = 3e-4) -> pd.DataFrame:
    """A ball at rest until TOUCH, pushed by PUSHED to RELEASE, in flight to LANDS, then it bounces;
    a pendulum that slows down where they meet."""
    time = np.arange(0.0, 0.65, 1 / 600)
    since = np.clip(time - TOUCH, 0.0, RELEASE - TOUCH) / (RELEASE - TOUCH)
    flown = np.clip(time - RELEASE, 0.0, LANDS - RELEASE)
    after = np.clip(time - LANDS, 0.0, None)
    x = PUSHED * since**2 + 5.0 * flown + 4.0 * after
    y = 0.41 + 1.0 * flown - 4.9 * flown**2 + 2.0 * after
    rng = np.random.default_rng(4)
    x, y = (row + noise * rng.standard_normal(len(time)) for row in (x, y))
    ball = pd.DataFrame(
        {
            "frame": np.arange(len(time)), "t_s": time, "object": "ball",
            "x_px": 300 + direction * x * PX_PER_M, "y_px": 200 - y * PX_PER_M,
            "x_m": 1.3 + direction * x, "y_m": y + 0.2, "radius_px": 0.1 * PX_PER_M,
        }
    )  # fmt: skip
    swung = time[time < 0.3]
    phi = np.where(swung < TOUCH, 6.0 * (swung - TOUCH), 5.0 * (swung - TOUCH))
    bob = pd.DataFrame({"t_s": swung, "object": "pendulum", "phi_rad": phi, "x_px": 0, "y_px": 0})
    return pd.concat([ball, bob], ignore_index=True)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_flight_is_cut_out_forward_from_rest(direction: float) -> None:
    flight = flight_rows(track(direction), "a", rest_height=0.41)
    assert set(flight["trial"]) == {"a"}
    assert RELEASE <= flight["t_s"].min() < RELEASE + 0.03
    assert LANDS - 0.03 < flight["t_s"].max() <= LANDS + 0.004
    flown = flight["t_s"] - RELEASE
    assert np.abs(flight["x_m"] - (PUSHED + 5.0 * flown)).max() < 2e-3
    assert np.abs(flight["y_m"] - (0.41 + flown - 4.9 * flown**2)).max() < 2e-3


def test_the_swing_ends_before_the_ball_is_met() -> None:
    swing = swing_rows(track(), "a")
    assert 0.05 < swing["t_s"].max() < TOUCH


def test_a_swing_alone_is_kept_whole() -> None:
    whole = track()
    alone = whole[whole["object"] == "pendulum"]
    assert len(swing_rows(alone, "a")) == len(alone)


def test_trials_by_name_are_cut_each_by_itself() -> None:
    both = pd.concat([track().assign(trial="a"), track(-1.0).assign(trial="b")])
    flights = flight_rows(both, "-")
    assert [*flights["trial"].unique()] == ["a", "b"]
    assert (flights["x_m"] > 0.0).all()


def test_a_table_without_metres_says_what_would_help() -> None:
    table = track().assign(x_m=np.nan, y_m=np.nan)
    assert is_track_table(table)
    with pytest.raises(UsageError, match="metres") as told:
        flight_rows(table, "a")
    assert "--wall-grid" in str(told.value)


SETUP = read_setup('[ball]\nmass = "5 kg"\ndiameter = "200 mm"\n[model]\neffects = ["gravity"]\n')


def rolled(angle: float) -> pd.DataFrame:
    """The flight of a heavy ball as a camera shows it that is rolled by `angle`, rad."""
    time = np.arange(0.0, 0.5, 1 / 600)
    x, y = 5.0 * time, 1.0 * time - 0.5 * 9.806 * time**2
    rng = np.random.default_rng(5)
    seen = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, y = seen @ np.stack([x, y]) + 1e-4 * rng.standard_normal((2, time.size))
    return pd.DataFrame(
        {
            "t_s": time, "object": "ball", "x_px": 300 + x * PX_PER_M, "y_px": 200 - y * PX_PER_M,
            "x_m": x, "y_m": y, "x_m_std": 1e-4, "y_m_std": 1e-4,
        }
    )  # fmt: skip


def test_an_error_that_any_unknown_calibration_may_have_is_not_surely_named() -> None:
    verdict = explain_files(rolled(np.radians(0.6)), None, SETUP).verdict
    assert verdict.verdict == "ambiguous"
    assert [effect.probability <= DOUBTED for effect in verdict.effects] == [True]
    assert any(Doubt.UNKNOWN_CALIBRATION.value in note for note in verdict.notes)
    assert "vision explain CLIP" in str(verdict.next_measurement)


def test_an_error_beyond_any_usual_calibration_is_named_but_one_trial_proves_no_name() -> None:
    verdict = explain_files(rolled(np.radians(8.0)), None, SETUP).verdict
    assert verdict.effects
    assert all(effect.probability <= DOUBTED for effect in verdict.effects)
    assert not any(Doubt.UNKNOWN_CALIBRATION.value in note for note in verdict.notes)
    assert Doubt.UNPROVED.value in verdict.remainder.statement
    assert Doubt.ONE_RECORD.value in verdict.remainder.statement
