"""The improved model is a setup file like any other: simulate, plan and measure take it."""

import json

import pytest
from typer.testing import CliRunner

from measuring.setup.file import load_setup
from mismatch.forward import ForwardModel
from mismatch.trial_table import explain_table
from physics.effects import CATALOGUE
from pipelines.cli import app
from pipelines.explain.command import improved_setup
from tests.mismatch.table.trial_tables import SETUP, lab, simulated_table


@pytest.fixture(scope="module")
def explained():
    return explain_table(simulated_table(4, "velocity_dependent_cor"), lab())


def improved(tmp_path, explained, *more):
    setup = tmp_path / "setup.toml"
    setup.write_text(SETUP)
    entries = explained.best.model.entries + tuple(more)
    object.__setattr__(explained.best, "model", ForwardModel(entries))
    path = tmp_path / "model.toml"
    path.write_text(improved_setup(setup, explained))
    return path


def numbers(*arguments):
    result = CliRunner().invoke(app, [*arguments, "--json", "-"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)["quantities"]


def test_simulate_plan_and_measure_take_the_improved_model(tmp_path, explained):
    model = improved(tmp_path, explained)
    known = load_setup(model)
    assert known.model.effects == ("gravity", "drag", "velocity_dependent_cor")
    slope = known.model.parameters["velocity_dependent_cor"]["slope"]
    assert slope == pytest.approx(-0.02, abs=0.01)
    strike = ("simulate", "--ball", "jokku", "--impact-speed", "3.9")
    before = numbers(*strike, "--setup", str(tmp_path / "setup.toml"))
    after = numbers(*strike, "--setup", str(model))
    # Less restitution at high speed: the improved model throws less far from the same contact.
    key = next(name for name in after if name.startswith("landing_distance_contact"))
    assert after[key]["value"] < before[key]["value"]
    plan = ("plan", "--distance", "1.8m", "--ball", "jokku", "--setup", str(model))
    assert numbers(*plan)["backswing_angle"]["value"] > 0.0
    clip = tmp_path / "none.mp4"
    clip.write_bytes(b"no film")
    told = CliRunner().invoke(app, ["measure", str(clip), "--setup", str(model)])
    # The setup is read before the clip, which is what fails here.
    assert "none.mp4" in str(told.exception) + told.output
    assert "setup" not in str(told.exception).lower()


def test_what_a_setup_cannot_hold_stands_in_a_comment(tmp_path, explained):
    roll = CATALOGUE["camera_roll"][0]
    mass = CATALOGUE["effective_mass"][1]
    model = improved(tmp_path, explained, (roll, {"roll": 0.01}), (mass, {"relative_error": 0.02}))
    text = model.read_text()
    assert "# camera_roll" in text
    assert "# effective_mass (mass)" in text
    assert set(load_setup(model).model.effects) == {"gravity", "drag", "velocity_dependent_cor"}
