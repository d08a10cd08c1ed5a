"""Run one hostile input in a child process and judge the outcome."""

import base64
import functools
import hashlib
import json
import os
import re
import signal
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import psutil

__all__ = ["Case", "Fault", "Kind", "Ran", "faults_of", "kept", "load_commands", "named",
           "read_case", "run_case", "start", "tried"]  # fmt: skip

MAX_CPU_S = 120.0
"""Processor time of one command, s; convention, also on a machine with other work."""
MAX_IDLE_S = 60.0
"""Time without any work of a command, s; chosen: on a busy machine a process runs far sooner."""
MAX_BYTES = 2 << 30
"""Memory of one command; convention: half of a small machine's 4 GB."""
CODES = (0, 2, 3, 4)
"""Documented exit codes without 1, which reports a bug."""
SURE = 0.5
"""Probability above which a named effect counts as part of the verdict."""


class Kind(StrEnum):
    """Class of input."""

    SETUP = "setup files"
    ARGUMENTS = "arguments"
    TABLE = "tables"
    TRACKS = "tracks of other programs"
    LAWS = "laws of restitution"
    LAB_BOOK = "lab books"
    CLIP = "clips"
    EFFECTS = "users' effects"
    LEDGERS = "ledgers of campaigns"
    NAMES = "file names"
    PLACES = "what is no file"


class Fault(StrEnum):
    """Outcomes that are errors of the program."""

    TRACEBACK = "traceback"
    HANG = "no end: 120 s of processor time, or 60 s without work"
    MEMORY = "memory over 2 GB"
    CODE = "undocumented exit code"
    SPEECHLESS = "rejected without a message"
    INPUT = "input damaged"
    LEFTOVER = "file left behind"
    HALF = "incomplete output"
    SILENT = "verdict changed without a note"
    NOISE = "library warnings"
    CONTROL = "control characters on the terminal"
    LOSS = "cell of a lab book lost"


@dataclass(frozen=True)
class Case:
    """A command run in a folder that contains only `files`.

    Attributes
    ----------
    outputs : tuple of str
        Files the command is asked to write.
    sound : tuple of str
        Effects named for the undamaged table: a different answer needs a note.
    special : mapping of str to str
        What is no file, by its name: "pipe", "folder", or the target of a link.
    cells : tuple of str
        Texts that a table of results holds, if one is written.
    """

    kind: Kind
    arguments: tuple[str, ...]
    files: Mapping[str, bytes]
    outputs: tuple[str, ...] = ()
    sound: tuple[str, ...] | None = None
    special: Mapping[str, str] = field(default_factory=dict)
    cells: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """File name of the case: a digest of its contents."""
        return hashlib.sha256(self.text().encode()).hexdigest()[:12]

    def text(self) -> str:
        """The case as JSON."""
        files = {
            name: base64.b64encode(zlib.compress(data, 9)).decode()
            for name, data in self.files.items()
        }
        raw = {"kind": self.kind.value, "arguments": self.arguments, "files": files,
               "outputs": self.outputs, "sound": self.sound}  # fmt: skip
        if self.special or self.cells:
            raw |= {"special": dict(self.special), "cells": self.cells}
        return json.dumps(raw, indent=1)


def read_case(path: Path) -> Case:
    """Read a case from its JSON file."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    return Case(
        Kind(raw["kind"]),
        tuple(raw["arguments"]),
        {name: zlib.decompress(base64.b64decode(data)) for name, data in raw["files"].items()},
        tuple(raw["outputs"]),
        None if raw["sound"] is None else tuple(raw["sound"]),
        raw.get("special", {}),
        tuple(raw.get("cells", ())),
    )


def kept() -> list[Path]:
    """Files of cases that once failed and are replayed by the tests."""
    return sorted((Path(__file__).parent / "kept").glob("*.json"))


@dataclass(frozen=True)
class Ran:
    """Outcome of a case.

    Attributes
    ----------
    code : int
        Exit code; negative: the signal that ended the process.
    said : str
        Text on stderr.
    idle, worked : float
        Longest time without work, and processor time, s.
    memory : int
        Peak memory, bytes.
    left : mapping of str to bytes
        Files in the folder afterwards.
    """

    code: int
    said: str
    idle: float
    worked: float
    memory: int
    left: Mapping[str, bytes]


def load_commands() -> None:
    """Import every module a command imports, so that a case costs only a fork."""
    from metrology import parse_quantity
    from pipelines.cli import _COMMANDS

    lazy = ("av", "cv2", "matplotlib.figure", "openpyxl", "scipy.optimize",
            "pipelines.api.explained", "measuring.chain")  # fmt: skip
    for name in (*(command.module for command in _COMMANDS.values()), *lazy):
        import_module(name)
    # building the registry of units takes half a second
    parse_quantity("1 furlong", "m")


def start(
    arguments: tuple[str, ...], folder: Path, said: Path, run: Callable[[], None] | None = None
) -> int:
    """Fork a child that runs a command, or `run`, in `folder` with stderr in `said`; its id."""
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        _run_and_exit(run or functools.partial(_command, arguments), folder, said)
    return child


def _command(arguments: tuple[str, ...]) -> None:
    from pipelines.cli import app

    app(list(arguments))


def _run_and_exit(run: Callable[[], object], folder: Path, said: Path) -> NoReturn:
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        run()
        code = 0
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError:
                code = code or 1
        os._exit(code)


def run_case(case: Case, folder: Path) -> Ran:
    """Run a case in a fork of this process; call `load_commands` before, and not from threads."""
    for name, data in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    for name, what in case.special.items():
        _put(folder / name, what)
    said = folder.with_suffix(".said")
    status, worked, memory, idle = _waited(start(case.arguments, folder, said))
    text = said.read_bytes().decode("utf-8", errors="replace")
    said.unlink()
    left = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    return Ran(os.waitstatus_to_exitcode(status), text, idle, worked, memory, left)


def _put(path: Path, what: str) -> None:
    """Make a pipe, a folder or a link."""
    path.parent.mkdir(parents=True, exist_ok=True)
    match what:
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case target:
            path.symlink_to(target)


def tried(case: Case) -> tuple[Ran, tuple[Fault, ...]]:
    """Run a case in a temporary folder and judge it."""
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        inside = Path(folder) / "case"
        inside.mkdir()
        ran = run_case(case, inside)
    return ran, faults_of(case, ran)


def _waited(child: int) -> tuple[int, float, int, float]:
    """Exit status, processor time, peak memory and idle time; kills the child beyond a limit."""
    peak, worked, idle, since = 0, 0.0, 0.0, time.monotonic()
    while True:
        found, status, usage = os.wait4(child, os.WNOHANG)
        if found:
            used = max(worked, usage.ru_utime + usage.ru_stime)
            return status, used, max(peak, usage.ru_maxrss * 1024), idle
        try:
            pages = int(Path(f"/proc/{child}/statm").read_text().split()[1])
        except (OSError, IndexError):
            pages = 0
        peak = max(peak, pages * os.sysconf("SC_PAGE_SIZE"))
        now = _worked(child)
        if now > worked + _MIN_WORK_S:
            worked, since = now, time.monotonic()
        idle = max(idle, time.monotonic() - since)
        if idle > MAX_IDLE_S or worked > MAX_CPU_S + 1.0 or peak > 2 * MAX_BYTES:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.05)


_MIN_WORK_S = 0.01
"""Smallest change of the processor time, s (derived: a tick of the kernel's clock)."""


def _worked(child: int) -> float:
    """Processor time of a process and of those that it started, s."""
    try:
        one = psutil.Process(child)
        every = [one.cpu_times(), *(other.cpu_times() for other in one.children(recursive=True))]
    except psutil.Error:
        return 0.0
    ended = every[0].children_user + every[0].children_system
    return float(sum(times.user + times.system for times in every) + ended)


_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_WARNING = re.compile(r"^\S+:\d+: \w*Warning:", re.MULTILINE)


def faults_of(case: Case, ran: Ran) -> tuple[Fault, ...]:
    """Faults in the outcome of a case."""
    found = []
    if ran.worked > MAX_CPU_S or ran.idle > MAX_IDLE_S:
        found.append(Fault.HANG)
    if ran.memory > MAX_BYTES:
        found.append(Fault.MEMORY)
    if "Traceback (most recent call last)" in ran.said:
        found.append(Fault.TRACEBACK)
    elif ran.code not in CODES and not found:
        found.append(Fault.CODE)
    if ran.code in (2, 3, 4) and not ran.said.strip():
        found.append(Fault.SPEECHLESS)
    if _WARNING.search(ran.said):
        found.append(Fault.NOISE)
    if any(
        ran.left.get(name) != data and not (name in case.outputs and case.arguments.count(name) < 2)
        for name, data in case.files.items()
    ):
        found.append(Fault.INPUT)
    if set(ran.left) - set(case.files) - set(_allowed(case, ran)):
        found.append(Fault.LEFTOVER)
    if _CONTROL.search(ran.said.replace("\r\n", "\n")):
        found.append(Fault.CONTROL)
    tables = [data.decode() for name, data in ran.left.items() if name.endswith("results.csv")]
    if any(cell not in table for table in tables for cell in case.cells):
        found.append(Fault.LOSS)
    written = {name: ran.left[name] for name in case.outputs if name in ran.left}
    if not all(_complete(name, data) for name, data in written.items()):
        found.append(Fault.HALF)
    if case.sound is not None and written and ran.code == 0 and not found:
        document = json.loads(next(iter(written.values())))
        noted = document.get("notes") or document.get("warnings") or ran.said.strip()
        if not noted and named(document) != case.sound:
            found.append(Fault.SILENT)
    return tuple(found)


def _allowed(case: Case, ran: Ran) -> list[str]:
    """Requested outputs, and files inside requested folders or linked to."""
    if {"", "."} & set(case.arguments):
        return list(ran.left)
    return [
        name
        for name in ran.left
        if any(name == out or name.startswith(f"{out}/") for out in case.outputs)
        or name in case.special.values()
    ]


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"{text} is not JSON")


def _complete(name: str, data: bytes) -> bool:
    """Whether a JSON output is complete and contains no NaN or infinity."""
    if not name.endswith(".json"):
        return len(data) > 0
    try:
        json.loads(data, parse_constant=_refuse_constant)
    except ValueError:
        return False
    return True


def named(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Effects that a verdict names, sorted."""
    return tuple(sorted(e["id"] for e in document.get("effects", ()) if e["probability"] > SURE))
