import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from metrology import DomainError, UsageError
from physics.bodies import BASKETBALL, JOKKU
from physics.forward import Experiment, impulsive_launch, numerical_landing
from physics.restitution import ConstantCor
from physics.swing import frictionless_speed
from pipelines.model import parse_effect, simulate, simulate_command

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(simulate_command)
runner = CliRunner()


def _values(*arguments: str) -> dict[str, dict[str, float]]:
    result = runner.invoke(app, [*arguments, "--json", "-"], catch_exceptions=False)
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert set(document) == {"quantities", "warnings"}
    quantities: dict[str, dict[str, float]] = document["quantities"]
    return quantities


def test_json_on_stdout_has_every_number_with_its_std() -> None:
    values = _values("--backswing", "90deg", "--ball", "jokku")
    for name in (
        "backswing_angle",
        "impact_speed",
        "pendulum_speed_after",
        "ball_speed",
        "launch_angle",
        "flight_time",
        "landing_distance",
        "external_impulse",
        "energy_loss",
        "contact_time",
    ):
        assert math.isfinite(values[name]["value"])
        assert values[name]["std"] >= 0.0
    assert values["landing_distance"]["std"] > 0.005
    assert values["backswing_angle"]["value"] == pytest.approx(90.0)


def test_the_papers_numbers_come_out() -> None:
    values = _values("--impact-speed", "3.2144", "--ball", "jokku")
    assert values["external_impulse"]["value"] == pytest.approx(1.8267, abs=3e-4)
    values = _values("--impact-speed", "3.2144 m/s", "--ball", "jokku", "--cor", "constant")
    assert values["external_impulse"]["value"] == pytest.approx(1.8926, abs=3e-4)
    values = _values("--impact-speed", "3", "--cor", "0.5")
    assert values["cor_speeds"]["value"] == 0.5


def test_stds_are_the_scatter_of_many_strikes() -> None:
    """Linear propagation against Monte Carlo over the same inputs."""
    experiment = Experiment(BASKETBALL)
    run = {q.name: q for q in simulate(experiment, backswing=1.2).quantities}
    generator = np.random.default_rng(8)
    distances = []
    for _ in range(150):
        ball = replace(
            BASKETBALL,
            launch_angle=BASKETBALL.launch_angle
            + generator.normal(0.0, math.radians(math.hypot(0.2, 0.3))),
            contact_time=replace(
                BASKETBALL.contact_time,
                reference_time=BASKETBALL.contact_time.reference_time + generator.normal(0.0, 1e-3),
            ),
        )
        swing = 1.2 + generator.normal(0.0, math.radians(0.2))
        moved = replace(experiment, ball=ball)
        speed = frictionless_speed(moved.pendulum, swing, ball.launch_angle)
        e = ball.cor(speed) + generator.normal(0.0, math.hypot(0.005, 0.01))
        landing = numerical_landing(moved, impulsive_launch(moved, speed, float(e)))
        distances.append(float(np.ravel(landing.distance)[0]))
    std = run["landing_distance"].std
    assert std is not None
    assert float(np.std(distances)) == pytest.approx(std, rel=0.15)


def test_closed_form_and_numerical_path_are_both_given() -> None:
    values = _values("--backswing", "120 deg")
    difference = values["closed_form_difference"]["value"]
    gap = values["landing_distance_closed_form"]["value"] - values["landing_distance"]["value"]
    assert difference == pytest.approx(gap)
    assert 1e-4 < abs(difference) < 0.02


def test_effects_of_the_catalogue_act() -> None:
    plain = _values("--backswing", "90 deg")
    spun = _values("--backswing", "90 deg", "--effect", "magnus:spin=20")
    rubbed = _values("--backswing", "90 deg", "--effect", "bearing_friction:dry_torque=0.3")
    assert spun["landing_distance"]["value"] > plain["landing_distance"]["value"] + 0.01
    assert rubbed["impact_speed"]["value"] < plain["impact_speed"]["value"] - 0.01
    tilted = simulate(
        Experiment(JOKKU),
        backswing=1.5,
        effects=(parse_effect("velocity_dependent_cor:slope=0.05"),),
    )
    straight = simulate(Experiment(JOKKU), backswing=1.5)
    speed = {q.name: q.value for q in straight.quantities}["impact_speed"]
    assert speed is not None
    gained = {q.name: q.value for q in tilted.quantities}["ball_speed"]
    before = {q.name: q.value for q in straight.quantities}["ball_speed"]
    assert gained is not None
    assert before is not None
    assert (gained - before) * (speed - 2.5) > 0.0


def test_a_drag_curve_is_followed_along_the_flight() -> None:
    free = _values("--backswing", "120 deg", "--drag", "0")
    curve = _values("--backswing", "120 deg", "--drag", "soccer")
    level = _values("--backswing", "120 deg", "--drag", "0.5")
    assert free["landing_distance"]["value"] > curve["landing_distance"]["value"] + 0.05
    assert curve["landing_distance"]["value"] == pytest.approx(
        level["landing_distance"]["value"], abs=2e-3
    )
    assert free["closed_form_difference"]["value"] == pytest.approx(0.0, abs=1e-9)


def test_a_setup_file_sets_ball_air_scatter_and_model(tmp_path: Path) -> None:
    setup = tmp_path / "lab.toml"
    setup.write_text(
        '[balls.heavy]\nmass = "0.6 kg"\ndiameter = "0.22 m"\nlaunch_angle = "10 deg"\n'
        'cor = "0.8 - 0.01*v"\n[scatter]\nbackswing = "1 deg"\n'
        '[model]\neffects = ["gravity", "magnus"]\n[model.magnus]\nspin = 10\n'
    )
    values = _values("--backswing", "60 deg", "--setup", str(setup))
    speed = values["impact_speed"]["value"]
    assert values["cor_speeds"]["value"] == pytest.approx(0.8 - 0.01 * speed)
    assert values["backswing_angle"]["std"] == pytest.approx(1.0)


def test_files_are_written_where_asked(tmp_path: Path) -> None:
    table, picture = tmp_path / "out.csv", tmp_path / "path.png"
    result = runner.invoke(
        app, ["--backswing", "90 deg", "--csv", str(table), "--plot", str(picture), "--quiet"]
    )
    assert result.exit_code == 0
    assert result.output == ""
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len(rows) == 1
    assert {
        "impact_speed_m_s",
        "impact_speed_m_s_std",
        "cor_speeds",
        "external_impulse_N_s",
    } <= set(rows[0])
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_beyond_the_fitted_speeds_it_warns() -> None:
    assert not simulate(Experiment(JOKKU), impact_speed=2.0).warnings
    assert "extrapolated" in simulate(Experiment(JOKKU), impact_speed=5.5).warnings[0]
    known = simulate(Experiment(JOKKU), impact_speed=5.5, cor=ConstantCor(0.7)).warnings
    assert not any("extrapolated" in warning for warning in known)


def test_a_contact_that_cannot_be_followed_leaves_a_reason(tmp_path: Path) -> None:
    picture = tmp_path / "slow.png"
    values = _values("--impact-speed", "0.02", "--plot", str(picture))
    assert values["landing_distance"]["value"] > 0.0
    missing: dict[str, object] = dict(values["landing_distance_contact_model"])
    assert missing["value"] is None
    assert "contact law" in str(missing["reason"])
    assert picture.exists()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--backswing", "90 deg", "--impact-speed", "3"],
        ["--backswing", "200deg"],
        ["--backswing", "3 kg"],
        ["--impact-speed", "-3"],
        ["--impact-speed", "3", "--cor", "1.4"],
        ["--impact-speed", "3", "--cor", "os.system('true')"],
        ["--impact-speed", "3", "--ball", "football field"],
        ["--impact-speed", "3", "--effect", "magnus"],
        ["--impact-speed", "3", "--effect", "magnus:spin=fast"],
        ["--impact-speed", "3", "--effect", "magnus:speed=3"],
        ["--impact-speed", "3", "--effect", "telekinesis"],
        ["--impact-speed", "3", "--effect", "camera_roll:roll=1"],
        ["--impact-speed", "3", "--plot", "x.pdf"],
        ["--impact-speed", "3", "--drag", "velvet"],
        ["--impact-speed", "3", "--drag", "-1"],
    ],
)
def test_bad_usage_is_refused_with_a_reason(arguments: list[str]) -> None:
    result = runner.invoke(app, arguments)
    assert isinstance(result.exception, UsageError)
    assert result.exception.exit_code == 2


def test_a_swing_that_cannot_reach_the_ball() -> None:
    with pytest.raises(DomainError):
        simulate(Experiment(JOKKU), backswing=math.radians(5.0))
