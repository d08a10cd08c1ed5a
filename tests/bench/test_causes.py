"""What brought the first build down holds now, and the judge of it sees what went wrong there."""

import subprocess
import tarfile
from io import BytesIO
from pathlib import Path

import pytest

from bench.hostile.causes import ROOT, Encounter, Ending, encountered, encounters

FIRST_BUILD = "a1dcaa4"
ALL = encounters()
QUICK = {"an output that is an input", "a pipe as setup", "12 damaged clips, read five times"}
"""Tests beside the doors hold the rest in the default run; ``python -m bench.hostile.causes``
tries them all."""


@pytest.mark.parametrize(
    "encounter",
    [
        pytest.param(one, id=one.name, marks=() if one.name in QUICK else pytest.mark.slow)
        for one in ALL
    ],
)
def test_what_brought_the_first_build_down_holds(encounter: Encounter, tmp_path: Path) -> None:
    assert encountered(encounter, ROOT, tmp_path) == ""


def test_each_cause_is_met_and_names_are_their_own() -> None:
    assert {one.cause for one in ALL} == set(range(1, 10))
    assert len({one.name for one in ALL}) == len(ALL)
    assert {one.name for one in ALL} >= QUICK


def test_the_judge_tells_hangs_tracebacks_deaths_and_wrong_codes(tmp_path: Path) -> None:
    traceback = "Traceback (most recent call last):\n  …\nValueError: no\n"
    assert Ending(None, "", "", tmp_path, 1.0).refused(2) == "hangs"
    assert Ending(2, "", "", tmp_path, 31.0).refused(2) == "hangs"
    assert Ending(1, traceback, "", tmp_path, 1.0).refused(2) == "traceback: ValueError"
    assert Ending(-9, "", "", tmp_path, 1.0).refused(2) == "dies of signal 9"
    assert Ending(0, "", "", tmp_path, 1.0).refused(2) == "ends with 0"
    assert Ending(2, "no", "", tmp_path, 1.0).refused(2) == ""


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_each_cause_fails_on_the_first_build(tmp_path: Path) -> None:
    packed = subprocess.run(
        ["git", "archive", FIRST_BUILD], cwd=ROOT, capture_output=True, check=False
    )
    if packed.returncode != 0:
        pytest.skip(f"the history here does not reach back to {FIRST_BUILD}")
    with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
        archive.extractall(tmp_path / "first", filter="data")
    fails = set()
    for number, one in enumerate(ALL):
        folder = tmp_path / f"{number}"
        folder.mkdir()
        if one.cause not in fails and encountered(one, tmp_path / "first", folder):
            fails.add(one.cause)
    assert fails == set(range(1, 10))
