"""Page Why: the engine's answer for one clip, in a sentence with its picture."""

import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from metrology import SetupError
from pipelines.app.corrections import ClipInputs, Corrections
from pipelines.app.pages.why import command_of, explained
from tests.pipelines.app.small import CLIP, strike


def _clip(path: Path, **inputs: str) -> Any:
    """What the page needs of an open clip."""
    corrections = Corrections(ClipInputs(**inputs))
    return SimpleNamespace(path=path, measured=strike(), corrections=corrections)


def test_the_answer_is_that_of_explain(tmp_path: Path) -> None:
    found = explained(_clip(CLIP, setup="jokku_90_small.toml"))
    assert found.sentence.endswith(".")
    assert found.sentence in found.html
    assert found.picture.startswith(b"\x89PNG")
    # a ball that was typed counts as well as one of the set-up file
    text = CLIP.with_suffix(".toml").read_text().partition("[ball]")[0]
    (tmp_path / "lab.toml").write_text(text)
    setup = str(tmp_path / "lab.toml")
    assert explained(_clip(CLIP, setup=setup, ball="jokku")).html == found.html
    with pytest.raises(SetupError, match="no ball"):
        explained(_clip(CLIP, setup=setup))


def test_the_command_is_given_only_where_it_does_the_same() -> None:
    clip = _clip(Path("/lab of/a b.mp4"), setup="lab.toml")
    words = shlex.split(command_of(clip))
    assert words == ["vision", "explain", "/lab of/a b.mp4", "--setup", "/lab of/lab.toml"]
    assert command_of(_clip(CLIP, setup="lab.toml", ball="jokku")) == ""
    assert command_of(_clip(CLIP)) == ""
