"""Motion inconsistent with free bodies or noise gets no name."""

import numpy as np
import pandas as pd
import pytest

from bench.real.made import write_rolling
from mismatch.verdict import DOUBTED, Doubt, HeldOut
from pipelines.explain.command import explain_files
from pipelines.explain.report import explain_report_html


@pytest.fixture(scope="module")
def rolling(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rolling")
    write_rolling(folder)
    table = pd.read_csv(folder / "ball.csv")
    table[table["trial"] <= 2].to_csv(folder / "ball.csv", index=False)
    return folder, explain_files(folder / "ball.csv", None, folder / "setup.toml")


def test_a_rolling_ball_is_neither_a_flight_nor_a_lens_error(rolling):
    verdict = rolling[1].verdict
    assert verdict.verdict == "unexplained"
    assert verdict.effects == ()
    assert Doubt.CARRIED.value in verdict.remainder.statement
    assert verdict.location is not None
    assert verdict.location.channel == "vertical"


def test_the_report_lists_its_inputs_and_shows_the_trajectories_first(rolling):
    folder, explained = rolling
    page = explain_report_html(explained, [folder / "ball.csv"])
    assert page.index("recorded paths") < page.index("What remains")
    assert "Nothing is named" in page
    assert "ball.csv, SHA-256" in page
    assert "http" not in page.replace("http://www.w3.org", "")
    assert "simulated with the missing effect" not in page


def test_throws_read_off_a_grid_by_hand_get_no_confident_name(tmp_path):
    rng = np.random.default_rng(3)
    rows = []
    for trial in range(6):
        time = 0.03 * np.arange(13)
        # Each throw has its own error, far above the reading's resolution of 1 mm.
        bend = rng.normal(0.0, 2.0, 2)
        for t in time:
            wrong = bend * np.sin(9.0 * t + trial) * 0.01
            x, y = (2.0 * t + wrong[0], 1.0 + 2.0 * t - 4.903 * t**2 + wrong[1])
            rows.append((trial, round(t, 4), round(x, 3), round(y, 3)))
    table = pd.DataFrame(rows, columns=["trial", "t_s", "x_m", "y_m"])
    table.to_csv(tmp_path / "ball.csv", index=False)
    (tmp_path / "setup.toml").write_text(
        '[ball]\nmass = "2.7 g"\ndiameter = "40 mm"\n[model]\neffects = ["gravity"]\n'
    )
    verdict = explain_files(tmp_path / "ball.csv", None, tmp_path / "setup.toml").verdict
    assert verdict.verdict in ("unexplained", "ambiguous", "no_mismatch")
    assert all(effect.probability <= max(DOUBTED, 0.5) for effect in verdict.effects)


@pytest.mark.parametrize(
    ("ratio", "gain", "worse"),
    [
        ((0.9989, 0.9999), 4.4, False),
        ((0.9989, 0.9999), 0.2, True),
        ((0.9989, 0.9999), None, True),
        ((0.9989, 1.0003), -3.0, False),
    ],
)
def test_better_launches_outweigh_a_thousandth_of_trajectory_error(ratio, gain, worse):
    """A difference of 0.06 % of the trajectory error is no evidence against an answer."""
    assert HeldOut(("1",), 0.0019412, 0.0019422, ratio, gain=gain).worse is worse


@pytest.mark.parametrize(
    ("ratio", "claimed", "gain", "proved"),
    [
        ((1.001, 1.005), 0.6, None, False),
        ((1.001, 1.005), 0.6, 0.2, False),
        ((1.001, 1.005), 0.6, 12.0, True),
        ((1.001, 1.005), 0.003, None, True),
        ((1.3, 2.4), 0.6, None, True),
        ((0.9, 2.4), 0.0, None, False),
    ],
)
def test_a_thousandth_is_no_proof_of_half_of_the_fitted_error(ratio, claimed, gain, proved):
    kept = HeldOut(("1",), 0.03311, 0.03302, ratio, gain=gain, claimed=claimed)
    assert kept.proves is proved
    assert ("no proof" in kept.in_words) is not proved


@pytest.mark.parametrize(("gain", "proved"), [(12.7, True), (2.0, False), (None, False)])
def test_the_statement_agrees_with_the_proof(gain, proved):
    kept = HeldOut(("1",), 0.00091281, 0.00091302, (0.9995, 0.99999), gain=gain)
    assert kept.proves is proved
    assert ("no proof" in kept.in_words) is not proved
    assert ("chi-square falls by 12.7" in kept.in_words) is proved
