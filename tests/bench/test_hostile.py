"""The judge of hostile inputs reports every fault; kept cases do not fail again."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from bench.hostile.case import Case, Fault, Kind, Ran, faults_of, named, read_case
from bench.hostile.damaged import SETUP, STRATEGIES, drawn, null_table
from bench.hostile.kills import complete
from pipelines.api.explained import explain

ROOT = Path(__file__).parents[2]
CASE = Case(
    Kind.TABLE, ("explain", "b.csv", "--json", "o.json"), {"b.csv": b"x"}, ("o.json",), ("drag",)
)
EXPLAINED = json.dumps({"effects": [{"id": "drag", "probability": 0.9}], "notes": []}).encode()
FINE = Ran(0, "", 1.0, 1.0, 1 << 20, {"b.csv": b"x", "o.json": EXPLAINED})


def _bench(module: str, *words: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", module, *words],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "IMPACT_VISION_CACHE": "off"},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr[-3000:]


@pytest.mark.parametrize(
    ("ran", "fault"),
    [
        (replace(FINE, code=1, said="Traceback (most recent call last):\n"), Fault.TRACEBACK),
        (replace(FINE, code=-9), Fault.CODE),
        (replace(FINE, worked=121.0), Fault.HANG),
        (replace(FINE, idle=61.0), Fault.HANG),
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
def test_the_judge_reports_each_fault(ran: Ran, fault: Fault) -> None:
    assert faults_of(CASE, FINE) == ()
    assert faults_of(CASE, ran) == (fault,)


def test_a_changed_verdict_with_a_note_is_no_fault() -> None:
    noted = b'{"effects": [], "notes": ["2 cells are left out"]}'
    assert faults_of(CASE, replace(FINE, left={**FINE.left, "o.json": noted})) == ()


def test_a_case_survives_a_round_trip(tmp_path: Path) -> None:
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
def test_a_truncated_file_is_incomplete(name: str, sound: bytes) -> None:
    assert complete(name, sound)
    assert not complete(name, sound[:-1])


def test_no_kept_case_fails_again() -> None:
    _bench("bench.hostile", "--replay")


@pytest.mark.parametrize(("column", "seed"), [("range_m", 1000), ("ball_speed_m_s", 1001)])
def test_nothing_is_named_in_a_permuted_table(column: str, seed: int, tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text(null_table(column, seed), encoding="utf-8")
    (tmp_path / "lab.toml").write_text(SETUP, encoding="utf-8")
    verdict = explain(trials=tmp_path / "b.csv", setup=tmp_path / "lab.toml").to_dict()
    assert named(verdict) == ()
    assert verdict["verdict"] == "unexplained"


@pytest.mark.slow
def test_a_minute_of_hostile_inputs_gives_no_fault() -> None:
    _bench("bench.hostile", "--seconds", "60", "--seed", "60")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["simulate", "render", "explain", "convert", "measure"])
def test_a_killed_command_leaves_complete_files_or_none(command: str) -> None:
    _bench("bench.hostile.kills", "--moments", "5", "--commands", command)
