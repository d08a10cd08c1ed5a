"""One hostile input: the command, its files, and what came of it in a process of its own."""

import base64
import hashlib
import json
import os
import re
import signal
import sys
import time
import traceback
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

__all__ = ["Case", "Fault", "Kind", "Ran", "faults_of", "kept", "read_case", "run_case"]

LONGEST_S = 30.0
"""Of processor time: what a busy machine adds is no fault of the command."""
_PATIENCE_S = 120.0
"""Of any time."""
LARGEST_BYTES = 2 << 30
CODES = (0, 2, 3, 4)
"""Exit codes of the contract without 1, which is a bug."""


class Kind(StrEnum):
    """Which door a case knocks at."""

    SETUP = "setup files"
    ARGUMENTS = "arguments"
    TABLE = "tables"
    TRACKS = "tracks of other programs"
    LAWS = "laws of restitution"
    LAB_BOOK = "lab books"
    CLIP = "clips"
    EFFECTS = "users' effects"


class Fault(StrEnum):
    """What must not come of a case."""

    TRACEBACK = "traceback"
    HANG = "hang over 30 s of work"
    MEMORY = "memory over 2 GB"
    CODE = "exit code outside the contract"
    SPEECHLESS = "refused without a word"
    INPUT = "input damaged"
    LEFTOVER = "file left behind"
    HALF = "output that is not whole"
    SILENT = "verdict changed in silence"
    NOISE = "warnings of libraries"


@dataclass(frozen=True)
class Case:
    """A command in a folder that holds `files`, and nothing else.

    Attributes
    ----------
    kind : Kind
    arguments : tuple of str
    files : mapping of str to bytes
    outputs : tuple of str
        Files that the command was asked to write.
    sound : tuple of str
        Effects that the undamaged table shows: where they change, something must be said.
    """

    kind: Kind
    arguments: tuple[str, ...]
    files: Mapping[str, bytes]
    outputs: tuple[str, ...] = ()
    sound: tuple[str, ...] | None = None

    @property
    def name(self) -> str:
        """A digest of the case, its file's name."""
        return hashlib.sha256(self.text().encode()).hexdigest()[:12]

    def text(self) -> str:
        """The case as JSON."""
        files = {
            name: base64.b64encode(zlib.compress(data, 9)).decode()
            for name, data in self.files.items()
        }
        return json.dumps(
            {
                "kind": self.kind.value,
                "arguments": self.arguments,
                "files": files,
                "outputs": self.outputs,
                "sound": self.sound,
            },
            indent=1,
        )


def read_case(path: Path) -> Case:
    """A case that was kept."""
    held = json.loads(path.read_text(encoding="utf-8"))
    return Case(
        Kind(held["kind"]),
        tuple(held["arguments"]),
        {name: zlib.decompress(base64.b64decode(data)) for name, data in held["files"].items()},
        tuple(held["outputs"]),
        None if held["sound"] is None else tuple(held["sound"]),
    )


def kept() -> list[Path]:
    """Cases that failed once, and must not again."""
    return sorted((Path(__file__).parent / "kept").glob("*.json"))


@dataclass(frozen=True)
class Ran:
    """What came of a case.

    Attributes
    ----------
    code : int
        Exit code; negative: the signal that ended it.
    said, results : str
        On stderr and stdout.
    seconds, worked : float
        In all, and of processor time.
    memory : int
        Most bytes held.
    left : mapping of str to bytes
        Files in the folder afterwards.
    """

    code: int
    said: str
    results: str
    seconds: float
    worked: float
    memory: int
    left: Mapping[str, bytes]


def run_case(case: Case, folder: Path) -> Ran:
    """Run a case in a fork of this process, which has the commands loaded; not from threads."""
    for name, data in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    said, results = folder.with_suffix(".said"), folder.with_suffix(".results")
    sys.stdout.flush()
    sys.stderr.flush()
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _become(case, folder, said, results)
    status, worked, memory = _waited(child, began + _PATIENCE_S)
    seconds = time.monotonic() - began
    code = os.waitstatus_to_exitcode(status)
    left = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    return Ran(code, _text(said), _text(results), seconds, worked, memory, left)


def _become(case: Case, folder: Path, said: Path, results: Path) -> None:
    """Be the command, and end with it."""
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        for number, path in ((1, results), (2, said)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        from pipelines.cli import app

        app(list(case.arguments))
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


def _waited(child: int, until: float) -> tuple[int, float, int]:
    """Status, processor time and largest memory; ended where it takes too long or too much."""
    peak = 0
    while True:
        found, status, usage = os.wait4(child, os.WNOHANG)
        if found:
            return status, usage.ru_utime + usage.ru_stime, max(peak, usage.ru_maxrss * 1024)
        peak = max(peak, _held(child))
        if time.monotonic() > until or peak > 2 * LARGEST_BYTES:
            os.kill(child, signal.SIGKILL)
            until = float("inf")
        time.sleep(0.01)


def _held(child: int) -> int:
    try:
        pages = int(Path(f"/proc/{child}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8", errors="replace")
    finally:
        path.unlink(missing_ok=True)


_WARNING = re.compile(r"^\S+:\d+: \w*Warning:", re.MULTILINE)


def faults_of(case: Case, ran: Ran) -> tuple[Fault, ...]:
    """What is wrong with what came of a case; empty where all is well."""
    found = []
    if ran.worked > LONGEST_S or ran.seconds > _PATIENCE_S:
        found.append(Fault.HANG)
    if ran.memory > LARGEST_BYTES:
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
    written = [ran.left[name] for name in case.outputs if name in ran.left]
    if any(not _whole(name, ran.left[name]) for name in case.outputs if name in ran.left):
        found.append(Fault.HALF)
    if case.sound is not None and written and ran.code == 0 and not found:
        found += [Fault.SILENT] * _changed_in_silence(case.sound, written[0], ran.said)
    return tuple(found)


def _allowed(case: Case, ran: Ran) -> list[str]:
    """Outputs asked for; what is in those that are folders."""
    if {"", "."} & set(case.arguments):
        return list(ran.left)
    return [
        name
        for name in ran.left
        if any(name == out or name.startswith(f"{out}/") for out in case.outputs)
    ]


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"{text} is no JSON")


def _whole(name: str, data: bytes) -> bool:
    """Whether a JSON file can be read by anybody: whole, and no number that JSON does not have."""
    if not name.endswith(".json"):
        return len(data) > 0
    try:
        json.loads(data, parse_constant=_refuse_constant)
    except ValueError:
        return False
    return True


SURE = 0.5
"""Probability from which a name counts as a verdict."""


def named(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Effects that a verdict names, sorted."""
    return tuple(sorted(e["id"] for e in document.get("effects", ()) if e["probability"] > SURE))


def _changed_in_silence(sound: tuple[str, ...], data: bytes, said: str) -> bool:
    document = json.loads(data)
    told = bool(document.get("notes")) or bool(document.get("warnings")) or bool(said.strip())
    return not told and named(document) != sound
