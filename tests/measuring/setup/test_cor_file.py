"""Laws of restitution handed from a campaign to simulate, plan and explain."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from measuring.setup.cor_file import (
    BallLaw,
    FittedLaw,
    law_of_ball,
    read_cor_file,
    with_laws,
    write_cor_file,
)
from measuring.setup.file import read_setup
from metrology import SetupError, UsageError
from physics.cor_fit import LawKind
from pipelines.cli import app

COVARIANCE = np.array([[4e-4, 2e-4, -1e-4], [2e-4, 9e-4, -2e-4], [-1e-4, -2e-4, 1e-4]])
JOKKU = BallLaw(
    "jokku",
    (FittedLaw(LawKind.EXPONENTIAL, {"a": 0.1073, "b": 0.2685, "d": 0.6746}, COVARIANCE),),
    (1.12, 3.92),
    strike_scatter=0.006,
    session_scatter=0.008,
)
FLAT = BallLaw("flat", (FittedLaw(LawKind.CONSTANT, {"d": 0.7}, np.array([[1e-4]])),), (1.0, 4.0))
VISCOUS = BallLaw(
    "viscous", (FittedLaw(LawKind.POWER, {"a": 0.2}, np.array([[1e-6]])),), (1.0, 4.0)
)
DOUBTED = BallLaw(
    "doubted",
    (
        FittedLaw(LawKind.POWER, {"a": 0.2}, np.array([[1e-4]]), 0.7),
        FittedLaw(LawKind.CONSTANT, {"d": 0.7}, np.array([[4e-4]]), 0.3),
    ),
    (1.0, 4.0),
)


def test_laws_written_are_read_again(tmp_path: Path) -> None:
    path = tmp_path / "cor.toml"
    write_cor_file(path, {law.ball: law for law in (JOKKU, FLAT, VISCOUS)})
    laws = read_cor_file(path)
    assert laws["jokku"].laws[0].parameters == JOKKU.laws[0].parameters
    np.testing.assert_array_equal(laws["jokku"].laws[0].covariance, COVARIANCE)
    assert laws["jokku"].speeds == JOKKU.speeds
    assert laws["flat"].law(3.0) == pytest.approx(0.7)
    assert laws["viscous"].law(3.0) == pytest.approx(1.0 - 0.2 * 3.0**0.2)


def test_the_law_is_as_sure_as_draws_of_its_parameters() -> None:
    draws = np.random.default_rng(1).multivariate_normal(
        [0.1073, 0.2685, 0.6746], COVARIANCE, 40000
    )
    for speed in (1.2, 2.5, 3.9):
        values = draws[:, 0] * np.exp(-draws[:, 1] * speed) + draws[:, 2]
        assert JOKKU.std_at(speed) == pytest.approx(float(values.std()), rel=0.03)
        wanted = 0.1073 * math.exp(-0.2685 * speed) + 0.6746
        assert JOKKU.law(speed) == pytest.approx(wanted)


def test_laws_that_compete_give_their_mean_and_the_doubt_between_them(tmp_path: Path) -> None:
    path = tmp_path / "cor.toml"
    write_cor_file(path, {"doubted": DOUBTED, "jokku": JOKKU})
    read = read_cor_file(path)["doubted"]
    rng = np.random.default_rng(4)
    draws = 200_000
    power = 1.0 - rng.normal(0.2, 0.01, draws) * 3.0**0.2
    flat = rng.normal(0.7, 0.02, draws)
    values = np.where(rng.random(draws) < 0.7, power, flat)
    assert read.law(3.0) == pytest.approx(float(values.mean()), abs=3e-4)
    assert read.std_at(3.0) == pytest.approx(float(values.std()), rel=0.01)
    # either law alone is surer than both together
    assert read.std_at(3.0) > max(one.std_at(3.0) for one in read.laws)


@pytest.mark.slow
def test_a_plan_from_a_campaigns_law_is_as_wide_as_the_campaign_says(tmp_path: Path) -> None:
    path = tmp_path / "cor.toml"
    setup = tmp_path / "lab.toml"
    setup.write_text("[scatter]\nbackswing = 0.0\nlaunch_angle = 0.0\nlaunch_angle_law = 0.0\n")
    command = ["plan", "--distance", "1.5m", "--ball", "jokku", "--setup", str(setup)]

    def width(law: BallLaw) -> float:
        write_cor_file(path, {"jokku": law})
        run = CliRunner().invoke(app, [*command, "--cor-law", str(path), "--json", "-"])
        assert run.exit_code == 0, run.output
        values = json.loads(run.stdout)["quantities"]
        assert values["landing_distance"]["value"] == pytest.approx(1.5)
        low, high = (values[f"landing_distance_{e}_95"]["value"] for e in ("low", "high"))
        return float(high - low)

    exact = (replace(JOKKU.laws[0], covariance=0.0 * COVARIANCE),)
    sure = BallLaw("jokku", exact, JOKKU.speeds, 0.01)
    wide = BallLaw("jokku", exact, JOKKU.speeds, 0.02)
    assert width(wide) == pytest.approx(2.0 * width(sure), rel=1e-6)
    std = JOKKU.std_at(2.7)
    assert width(JOKKU) / width(sure) == pytest.approx(math.hypot(std, 0.01) / 0.01, rel=0.1)


def test_simulate_takes_the_law_and_its_uncertainty(tmp_path: Path) -> None:
    path = tmp_path / "cor.toml"
    write_cor_file(path, {"jokku": JOKKU})
    run = CliRunner().invoke(
        app, ["simulate", "--impact-speed", "3.0", "--cor-law", str(path), "--json", "-"]
    )
    assert run.exit_code == 0, run.output
    cor = json.loads(run.stdout)["quantities"]["cor_speeds"]
    assert cor["value"] == pytest.approx(0.1073 * math.exp(-0.2685 * 3.0) + 0.6746)
    assert cor["std"] == pytest.approx(math.hypot(JOKKU.std_at(3.0), 0.01), rel=1e-6)


def test_a_setup_rebounds_by_the_laws() -> None:
    setup = read_setup('[balls.jokku]\nmass = "0.353 kg"\n[ball]\npreset = "basketball"')
    changed = with_laws(setup, {"jokku": JOKKU, "flat": FLAT})
    cor = changed.balls["jokku"].cor
    assert cor is not None
    assert cor(2.0) == pytest.approx(JOKKU.law(2.0))
    assert changed.ball == setup.ball
    assert changed.scatter.cor == pytest.approx(0.01)
    with pytest.raises(UsageError, match="jokku, flat"):
        law_of_ball({"jokku": JOKKU, "flat": FLAT}, "basketball")


GOOD = """
[balls.jokku]
law = "exponential"
parameters = { a = { value = 0.1, std = 0.01 }, b = 0.27, d = 0.67 }
covariance = [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]]
speeds = [1.0, 4.0]
"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("exponential", "linear", "law"),
        ("b = 0.27, ", "", "a, b, d"),
        ("[1e-4, 0.0, 0.0], ", "", "3 by 3"),
        ("[[1e-4, 0.0", "[[-1e-4, 0.0", "not a valid covariance"),
        ("[1e-4, 0.0, 0.0], [0.0", "[1e-4, 0.5, 0.0], [0.0", "not a valid covariance"),
        ("speeds = [1.0, 4.0]", "speeds = [4.0, 1.0]", "not a range"),
        ("speeds = [1.0, 4.0]", "", "speeds"),
        ("b = 0.27", "b = nan", "parameters"),
        ("d = 0.67", "d = 1.67", "at most 1"),
        ("law =", "law", "cor.toml"),
        ("speeds", "probability = 0.6\nspeeds", "sum to 0.6"),
        ("speeds", "probability = -1.0\nspeeds", "probability"),
    ],
)
def test_a_broken_file_says_what_is_wrong(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "cor.toml"
    path.write_text(GOOD)
    assert read_cor_file(path)["jokku"].laws[0].parameters["a"] == 0.1
    assert old in GOOD
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(SetupError, match=said):
        read_cor_file(path)
