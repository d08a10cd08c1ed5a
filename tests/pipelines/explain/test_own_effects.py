"""User-defined effects: loops, exits and invalid values are reported."""

import json
import sys
import time

import pytest
from typer.testing import CliRunner

from metrology import UsageError
from physics.effects import CATALOGUE
from pipelines.cli import app
from pipelines.explain import own_effects
from pipelines.explain.own_effects import check_effect, effect_limits, load_effects

PULL = """
import sys, time
import numpy as np
from physics.effects import Effect, Parameter
class Pull(Effect):
    def force(self, values, flight):
        nothing = np.zeros_like(np.asarray(flight.vx))
        {body}
EFFECTS = [Pull("pull", "A pull.", "F = k", "this lab", {phase!r},
                ({parameters}))]
"""
STRENGTH = "Parameter('k', 'N', 0.1, -9.0, 9.0),"
SOUND = "return values['k'] + nothing, nothing, nothing"


def pull(body=SOUND, phase="flight", parameters=STRENGTH):
    return PULL.format(body=body, phase=phase, parameters=parameters)


def told(tmp_path, text):
    """What the process apart would write down, without the process."""
    file, answer = tmp_path / "own.py", tmp_path / "answer.json"
    file.write_text(text + "\n")
    own_effects._answer(file, answer)
    return json.loads(answer.read_text()).get("message", "")


WRONG = {
    "raise RuntimeError('no')": "RuntimeError: no",
    "import sys; sys.exit(0)": "stops with SystemExit",
    "x = 1": "contains no effect",
    "def f(:": "SyntaxError",
    "EFFECTS = 3": "is not a list",
    "EFFECTS = [3]": "is not an effect",
    "EFFECTS = []": "contains no effect",
    "from physics.effects import Effect\nEFFECTS = [Effect]": "contains the class Effect",
    pull("raise ZeroDivisionError('no wind tunnel')"): "no wind tunnel",
    pull("sys.exit(0)"): "ends the program",
    pull("return nothing, nothing"): "does not return three components",
    pull("return None"): "does not return three components",
    pull("return np.nan * values['k'] + nothing, nothing, nothing"): "not finite numbers",
    pull("return 1.0 + nothing, nothing, nothing"): "acts at its neutral values",
    pull(phase="night"): "unknown phase 'night'",
    pull(parameters=""): "nothing to fit",
    pull().replace('"pull", "A', '"magnus", "A'): "an id that the catalogue has",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_with_a_file_of_effects_is_told(tmp_path, text):
    assert WRONG[text] in told(tmp_path, text)


def test_beside_a_file_of_effects_nothing_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    file = tmp_path / "own.py"
    file.write_text(pull())
    assert load_effects(file)
    assert list(tmp_path.iterdir()) == [file]


def test_a_sound_file_is_taken_and_what_it_prints_stays_out_of_results(tmp_path, capsys):
    file = tmp_path / "own.py"
    file.write_text("print('hello')\n" + pull())
    (effect,) = load_effects(file)
    assert effect.id == "pull"
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("while True: pass", "did not return within"),
        ("import os; os._exit(0)", "exit code 0"),
        ("x = bytearray(1 << 31)", "MemoryError"),
        ("import threading as t; t.Thread(target=t.Event().wait).start()", "starts threads"),
    ],
)
def test_a_file_that_never_ends_or_ends_everything_is_told(tmp_path, text, said):
    file = tmp_path / "own.py"
    file.write_text(text + "\n" + pull())
    with pytest.raises(UsageError, match=said):
        load_effects(file, seconds=2.0 if "while" in text else 30.0)


def test_the_catalogue_keeps_what_users_must():
    for forms in CATALOGUE.values():
        for effect in forms:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(own_effects, "refuse_unusable", lambda effect: None)
                check_effect(effect)


def test_a_hook_that_ends_the_program_later_on_is_told():
    effect = CATALOGUE["drag"][0]
    with pytest.raises(UsageError, match="drag ends the program"), effect_limits([effect]):
        raise SystemExit(0)


def test_a_hook_that_never_ends_later_on_is_told(monkeypatch):
    monkeypatch.setattr(own_effects, "RUN_TIMEOUT_S", 1)
    with (
        pytest.raises(UsageError, match="no result after 1 s"),
        effect_limits([CATALOGUE["drag"][0]]),
    ):
        time.sleep(5.0)


def test_the_command_says_what_an_effect_does_and_what_is_open(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(pull())
    result = CliRunner().invoke(app, ["effects", "check", str(file)])
    assert result.exit_code == 0
    assert "pull: acts through force; to be fitted: k (N)" in result.output
