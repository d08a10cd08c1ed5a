"""The judge of hostile inputs sees every fault; what failed once does not fail again."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from bench.hostile import __main__ as run
from bench.hostile.case import Case, Fault, Kind, Ran, faults_of, named, read_case
from bench.hostile.draw import STRATEGIES, drawn
from bench.hostile.kills import whole
from bench.hostile.nulls import null_case
from pipelines.api.explained import explain

ROOT = Path(__file__).parents[2]
CASE = Case(
    Kind.TABLE, ("explain", "b.csv", "--json", "o.json"), {"b.csv": b"x"}, ("o.json",), ("drag",)
)
EXPLAINED = json.dumps({"effects": [{"id": "drag", "probability": 0.9}], "notes": []}).encode()
FINE = Ran(0, "", "", 1.0, 1.0, 1 << 20, {"b.csv": b"x", "o.json": EXPLAINED})


def _bench(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bench.hostile", *words],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "IMPACT_VISION_CACHE": "off"},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )


@pytest.mark.parametrize(
    ("ran", "fault"),
    [
        (replace(FINE, code=1, said="Traceback (most recent call last):\n"), Fault.TRACEBACK),
        (replace(FINE, code=-9), Fault.CODE),
        (replace(FINE, worked=31.0), Fault.HANG),
        (replace(FINE, seconds=121.0), Fault.HANG),
        (replace(FINE, memory=3 << 30), Fault.MEMORY),
        (replace(FINE, code=2, left={"b.csv": b"x"}), Fault.SPEECHLESS),
        (replace(FINE, said="a.py:3: RuntimeWarning: overflow\n"), Fault.NOISE),
        (replace(FINE, left={**FINE.left, "b.csv": b"y"}), Fault.INPUT),
        (replace(FINE, left={**FINE.left, ".b-1.json": b""}), Fault.LEFTOVER),
        (replace(FINE, left={**FINE.left, "o.json": b'{"effects": ['}), Fault.HALF),
        (replace(FINE, left={**FINE.left, "o.json": b'{"effects": [], "x": NaN}'}), Fault.HALF),
        (replace(FINE, left={**FINE.left, "o.json": b'{"effects": []}'}), Fault.SILENT),
    ],
)
def test_the_judge_sees_each_fault(ran: Ran, fault: Fault) -> None:
    assert faults_of(CASE, FINE) == ()
    assert faults_of(CASE, ran) == (fault,)


def test_a_run_is_taken_up_where_its_log_ends_and_counts_each_input_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cases = [replace(CASE, arguments=("explain", str(number))) for number in range(8)]
    tries: list[str] = []

    def tried(case: Case) -> tuple[Ran, tuple[Fault, ...]]:
        tries.append(case.name)
        return FINE, (Fault.NOISE,) if case.arguments[1] == "4" else ()

    monkeypatch.setattr(run, "tried", tried)
    monkeypatch.setattr(run, "drawn", lambda kind, number, of: cases[: 3 + of % 1000])
    wish = run.Wish(60.0, 5, (Kind.TABLE,), None, tmp_path / "log")
    assert run.campaign(wish, 1).codes.total() == 5
    assert run.campaign(replace(wish, inputs=7), 1).codes.total() == 2
    assert tries == [case.name for case in cases[:7]]
    found = run.found_in(run.logged(wish.log))
    assert (found.codes, found.faults) == ({(Kind.TABLE, 0): 7}, {Fault.NOISE: 1})


def test_a_verdict_that_changes_with_a_word_is_no_silence() -> None:
    noted = b'{"effects": [], "notes": ["2 cells are left out"]}'
    assert faults_of(CASE, replace(FINE, left={**FINE.left, "o.json": noted})) == ()


def test_a_case_is_kept_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    path.write_text(CASE.text(), encoding="utf-8")
    assert read_case(path) == CASE
    assert read_case(path).name == CASE.name


@pytest.mark.parametrize("kind", [Kind.SETUP, Kind.ARGUMENTS, Kind.LAWS, Kind.LAB_BOOK])
def test_a_seed_draws_the_same_cases(kind: Kind) -> None:
    assert set(STRATEGIES) == set(Kind)
    first = drawn(kind, 5, 7)
    assert first == drawn(kind, 5, 7)
    assert len({case.name for case in first}) > 2


@pytest.mark.parametrize(
    ("name", "sound"),
    [("a.json", b'{"a": 1}'), ("a.html", b"<html></html>"), ("a.toml", b"a = [1]")],
)
def test_what_is_cut_is_not_whole(name: str, sound: bytes) -> None:
    assert whole(name, sound)
    assert not whole(name, sound[:-1])


def test_what_failed_once_does_not_fail_again() -> None:
    ran = _bench("--replay")
    assert ran.returncode == 0, ran.stderr[-3000:]


@pytest.mark.parametrize(("way", "of"), [("ranges permuted", 1000), ("ball speeds permuted", 1001)])
def test_in_a_table_that_is_mixed_up_nothing_is_named(way: str, of: int, tmp_path: Path) -> None:
    case = null_case(way, of)
    for name, data in case.files.items():
        (tmp_path / name).write_bytes(data)
    verdict = explain(trials=tmp_path / "b.csv", setup=tmp_path / "lab.toml").to_dict()
    assert named(verdict) == ()
    assert verdict["verdict"] == "unexplained"


@pytest.mark.slow
def test_a_minute_of_hostile_inputs_brings_nothing_down() -> None:
    ran = _bench("--seconds", "60", "--seed", "60")
    assert ran.returncode == 0, ran.stdout + ran.stderr[-3000:]


@pytest.mark.slow
@pytest.mark.parametrize("command", ["simulate", "render", "explain", "convert", "measure"])
def test_a_killed_command_leaves_whole_files_or_none(command: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "bench.hostile.kills", "--moments", "5", "--commands", command],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr[-2000:]
