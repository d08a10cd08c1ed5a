import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from metrology import DomainError, UsageError
from physics.bodies import BASKETBALL, JOKKU
from physics.forward import Experiment
from physics.restitution import parse_cor_law
from pipelines.model import plan, plan_command, simulate

app = typer.Typer(pretty_exceptions_enable=False)
app.command()(plan_command)
runner = CliRunner()


@pytest.mark.parametrize(
    ("ball", "distance"), [(JOKKU, 1.8), pytest.param(BASKETBALL, 2.2, marks=pytest.mark.slow)]
)
def test_simulating_the_plan_lands_where_it_was_wanted(ball: type(JOKKU), distance: float) -> None:
    experiment = Experiment(ball)
    planned = plan(experiment, distance)
    run = simulate(experiment, backswing=planned.plan.backswing)
    landed = {q.name: q for q in run.quantities}["landing_distance"]
    assert landed.value == pytest.approx(distance, abs=1e-5)
    # both ways to the scatter of the distance, up to the contact time's share
    assert landed.std == pytest.approx(planned.plan.distance_std, rel=0.1)


def test_the_contact_model_plan_lands_there_too() -> None:
    experiment = Experiment(JOKKU)
    values = {q.name: q.value for q in plan(experiment, 2.0).quantities}
    speed = values["impact_speed_contact_model"]
    assert speed is not None
    run = {q.name: q.value for q in simulate(experiment, impact_speed=speed).quantities}
    assert run["landing_distance_contact_model"] == pytest.approx(2.0, abs=1e-4)


def test_json_and_extrapolation_warning() -> None:
    result = runner.invoke(app, ["--distance", "2.5m", "--ball", "jokku", "--json", "-"])
    document = json.loads(result.stdout)
    angle = document["quantities"]["backswing_angle"]
    assert angle["unit"] == "deg"
    assert angle["std"] > 0.1
    constant = document["quantities"]["backswing_angle_constant_cor"]["value"]
    assert constant < angle["value"]
    assert "extrapolation" in document["warnings"][0]
    near = json.loads(runner.invoke(app, ["--distance", "1.5 m", "--json", "-"]).stdout)
    assert near["warnings"] == []


def test_a_given_number_for_the_cor_is_used() -> None:
    low, high = (
        json.loads(runner.invoke(app, ["--distance", "1.5", "--cor", e, "--json", "-"]).stdout)
        for e in ("0.6", "0.9")
    )
    name = "impact_speed"
    assert low["quantities"][name]["value"] > high["quantities"][name]["value"]


def test_a_law_that_ends_somewhere_is_planned_with_as_far_as_it_goes() -> None:
    result = runner.invoke(app, ["--distance", "0.8", "--cor", "1 - 0.3*v", "--json", "-"])
    speed = json.loads(result.stdout)["quantities"]["impact_speed"]["value"]
    assert 1.0 < speed < 3.3


def test_a_power_of_the_speed_is_planned_with_though_it_has_no_value_at_rest(
    tmp_path: Path,
) -> None:
    picture = tmp_path / "plan.svg"
    given = ["--distance", "1.5", "--cor", "0.6767*v**-0.104", "--json", "-"]
    result = runner.invoke(app, [*given, "--plot", str(picture)])
    assert result.exit_code == 0, result.output
    quantities = json.loads(result.stdout)["quantities"]
    assert "backswing_angle_constant_cor" not in quantities
    speed = quantities["impact_speed"]["value"]
    cor = f"{0.6767 * speed**-0.104}"
    number = runner.invoke(app, ["--distance", "1.5", "--cor", cor, "--json", "-"])
    same = json.loads(number.stdout)["quantities"]["impact_speed"]["value"]
    assert same == pytest.approx(speed, rel=1e-4)
    assert "constant COR" not in picture.read_text()


def test_a_law_that_is_no_law_for_gentle_strikes_is_planned_with_where_it_holds() -> None:
    # above 1 below 0.1 m/s
    given = ["--distance", "1.5", "--cor", "0.7862*v**-0.104", "--json", "-"]
    result = runner.invoke(app, given)
    assert result.exit_code == 0, result.output
    speed = json.loads(result.stdout)["quantities"]["impact_speed"]["value"]
    assert 2.0 < speed < 3.5
    with pytest.raises(DomainError, match=r"not -0\.5 at an impact speed of"):
        plan(Experiment(JOKKU), 1.5, cor=parse_cor_law("0*v - 0.5"))


def test_a_contact_that_cannot_be_followed_leaves_a_reason() -> None:
    result = runner.invoke(app, ["--distance", "1m", "--cor", "0.02", "--json", "-"])
    quantities = json.loads(result.stdout)["quantities"]
    assert quantities["impact_speed"]["value"] > 1.0
    assert quantities["backswing_angle_contact_model"]["value"] is None
    assert quantities["backswing_angle_contact_model"]["reason"]


def test_a_picture_of_the_plan(tmp_path: Path) -> None:
    picture = tmp_path / "plan.svg"
    result = runner.invoke(app, ["--distance", "2", "--plot", str(picture), "--quiet"])
    assert result.exit_code == 0
    assert "<svg" in picture.read_text()


@pytest.mark.parametrize("distance", ["50 m", "-1", "0", "2 kg"])
def test_what_cannot_be_planned_is_refused(distance: str) -> None:
    result = runner.invoke(app, [f"--distance={distance}"])
    assert isinstance(result.exception, UsageError)


def test_an_unreachable_distance_says_what_can_be_reached() -> None:
    with pytest.raises(DomainError, match="reaches"):
        plan(Experiment(JOKKU), 8.0)
