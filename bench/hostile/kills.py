"""Every command that writes, ended by signal 9 at random moments: what is left is whole, or absent.

``python -m bench.hostile.kills [--moments 50]``. Inputs must be as before, and every output either
absent, or as it was before, or one that its readers take. A hidden temporary may stay: nobody can
clean up after signal 9, and it has no output's name.
"""

import argparse
import contextlib
import functools
import io
import json
import os
import random
import signal
import sqlite3
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import av
import pandas as pd
from PIL import Image

from bench.hostile.case import Case as CommandCase
from bench.hostile.case import Kind as CaseKind
from bench.hostile.case import _become
from bench.hostile.draw import LAWS, SETUP, _sound_tracks, table_text
from bench.hostile.warm import load_commands

__all__ = ["COMMANDS", "Killed", "Writer", "killed_at_random", "whole"]


def _picture(data: bytes) -> object:
    return Image.open(io.BytesIO(data)).load()


def _clip(data: bytes) -> object:
    with av.open(io.BytesIO(data)) as container:
        return sum(1 for _ in container.decode(video=0))


def _page(data: bytes) -> object:
    if not data.rstrip().endswith(b"</html>"):
        raise ValueError("cut")
    return None


def _pdf(data: bytes) -> object:
    if not data.rstrip().endswith(b"%%EOF"):
        raise ValueError("cut")
    return None


_READERS: dict[str, Callable[[bytes], object]] = {
    ".json": json.loads,
    ".csv": lambda data: pd.read_csv(io.BytesIO(data)),
    ".toml": lambda data: tomllib.loads(data.decode()),
    ".png": _picture,
    ".jpg": _picture,
    ".parquet": lambda data: pd.read_parquet(io.BytesIO(data)),
    ".svg": ElementTree.fromstring,
    ".kva": ElementTree.fromstring,
    ".trk": ElementTree.fromstring,
    ".xlsx": lambda data: zipfile.ZipFile(io.BytesIO(data)).testzip(),
    ".html": _page,
    ".mp4": _clip,
    ".avi": _clip,
    ".pdf": _pdf,
}


def whole(name: str, data: bytes) -> bool:
    """Whether a file's readers take it."""
    try:
        _READERS[Path(name).suffix](data)
    except Exception:
        return False
    return True


_BESIDE_A_LEDGER = ("-wal", "-shm")
"""Ends of the files that SQLite keeps beside a database until it is closed: no outputs."""


def _sound(path: Path, name: str) -> bool:
    """Whether an output stands as its readers want it; a ledger with what SQLite keeps beside."""
    if path.suffix != ".sqlite":
        return whole(name, path.read_bytes())
    with contextlib.closing(sqlite3.connect(path)) as base:
        return bool(base.execute("PRAGMA integrity_check").fetchone() == ("ok",))


@dataclass(frozen=True)
class Writer:
    """A command that writes.

    Attributes
    ----------
    arguments : tuple of str
    inputs : mapping of str to bytes, lazily
    outputs : tuple of str
        Files, or a folder of files.
    """

    arguments: tuple[str, ...]
    inputs: Callable[[], dict[str, bytes]]
    outputs: tuple[str, ...]


def _setup() -> dict[str, bytes]:
    return {"lab.toml": SETUP.encode(), "cor.toml": LAWS.encode()}


def _table() -> dict[str, bytes]:
    return {"b.csv": table_text().encode(), "lab.toml": SETUP.encode()}


@functools.cache
def _sample() -> dict[str, bytes]:
    from importlib.resources import files

    found = next(
        p for p in files("sample_videos").joinpath("clips").iterdir() if p.name.endswith(".mp4")
    )
    return {"a.mp4": found.read_bytes()}


def _campaign() -> dict[str, bytes]:
    book = "clip,ball\na,jokku\nb,jokku\n"
    clips = {f"clips/{name}.mp4": _sample()["a.mp4"] for name in "ab"}
    return {**clips, "trials.csv": book.encode()}


COMMANDS = {
    "simulate": Writer(
        ("simulate", "--impact-speed", "2.5", "--setup", "lab.toml", "--json", "o.json", "--csv",
         "o.csv", "--plot", "o.png"), _setup, ("o.json", "o.csv", "o.png")),
    "plan": Writer(
        ("plan", "--distance", "1.5m", "--ball", "jokku", "--cor-law", "cor.toml", "--json",
         "o.json", "--csv", "o.csv", "--plot", "o.svg"), _setup, ("o.json", "o.csv", "o.svg")),
    "render": Writer(
        ("render", "--setup", "lab.toml", "--size", "96x64", "--frames", "6", "-o", "o.mp4"),
        _setup, ("o.mp4", "o.truth.json")),
    "explain": Writer(
        ("explain", "b.csv", "--setup", "lab.toml", "--json", "o.json", "--report", "o.html",
         "--plot", "o.png", "--model", "o.toml"), _table, ("o.json", "o.html", "o.png", "o.toml")),
    "convert": Writer(("convert", "a.trk", "o.kva"), _sound_tracks, ("o.kva",)),
    "convert to a table": Writer(("convert", "a.kva", "o.xlsx"), _sound_tracks, ("o.xlsx",)),
    "measure from tracks": Writer(
        ("measure", "--from-tracks", "a.trk", "--fps", "240", "--json", "o.json", "--csv", "o.csv",
         "--tracks", "t.csv"), _sound_tracks, ("o.json", "o.csv", "t.csv")),
    "measure": Writer(
        ("measure", "a.mp4", "--fps", "600", "--ball", "jokku", "--json", "o.json", "--csv",
         "o.csv", "--tracks", "t.csv", "--overlay", "v.mp4", "--plot", "o.png", "--report",
         "o.html"), _sample, ("o.json", "o.csv", "t.csv", "v.mp4", "o.png", "o.html")),
    "measure many": Writer(
        ("measure", "a.mp4", "--fps", "600", "--ball", "jokku", "--out", "many", "-j", "1",
         "--json", "o.json"), _sample, ("many",)),
    "paper": Writer(
        ("paper", "--quiet", "--json", "o.json", "--csv", "o.csv", "--figures", "figures"),
        dict, ("o.json", "o.csv", "figures")),
    "campaign": Writer(
        ("campaign", "clips", "--trials", "trials.csv", "--fps", "600", "--out", "out", "-j", "1",
         "--quiet"), _campaign, ("out",)),
    # the page's Save ends in the same function
    "calibrate": Writer(
        ("calibrate", "a.mp4", "--yes", "--fps", "600", "--ball", "jokku", "--out", "setup.toml"),
        _sample, ("setup.toml", "lens.toml")),
    "calibrate board": Writer(("calibrate", "board", "--pdf", "o.pdf"), dict, ("o.pdf",)),
    "calibrate plan": Writer(
        ("calibrate", "plan", "--no-changes", "--quiet", "--json", "o.json"), dict, ("o.json",)),
}  # fmt: skip


@dataclass(frozen=True)
class Killed:
    """What was left after a command was killed so often.

    Attributes
    ----------
    moments : int
    written : int
        Outputs found, all moments together.
    broken, damaged : tuple of str
        Outputs that nobody can read; inputs that are no longer as they were.
    """

    moments: int
    written: int
    broken: tuple[str, ...]
    damaged: tuple[str, ...]


def killed_at_random(writer: Writer, moments: int, of: int, folder: Path) -> Killed:
    """Run a command, once to its end, then so often until a random moment before."""
    rng = random.Random(of)
    inputs = writer.inputs()
    _run(writer, inputs, folder / "first", None)
    longest = _run(writer, inputs, folder / "whole", None)
    written, broken, damaged = 0, [], []
    for number in range(moments):
        place = folder / f"{number}"
        # most files are written near the end
        _run(writer, inputs, place, longest * (1.1 - rng.random() ** 2))
        for name, data in inputs.items():
            if (place / name).read_bytes() != data:
                damaged.append(name)
        for path in sorted(place.rglob("*")):
            name = str(path.relative_to(place))
            if not path.is_file() or path.name.startswith(".") or name in inputs:
                continue
            if name.endswith(_BESIDE_A_LEDGER):
                continue
            written += 1
            if not _sound(path, name):
                broken.append(name)
    return Killed(moments, written, tuple(broken), tuple(damaged))


def _run(writer: Writer, inputs: dict[str, bytes], folder: Path, until_s: float | None) -> float:
    """Seconds that a run took, which is ended with signal 9 after so many."""
    folder.mkdir(parents=True)
    for name, data in inputs.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    case = CommandCase(CaseKind.ARGUMENTS, writer.arguments, {})
    said, results = folder.with_suffix(".said"), folder.with_suffix(".results")
    began = time.monotonic()
    child = os.fork()
    if child == 0:
        _become(case, folder, said, results)
    if until_s is not None:
        time.sleep(until_s)
        os.killpg(os.getpgid(child), signal.SIGKILL) if _lives(child) else None
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if until_s is None and status != 0:
        raise RuntimeError(f"{writer.arguments[0]} ends with {status}: {said.read_text()}")
    return time.monotonic() - began


def _lives(child: int) -> bool:
    """Whether the child is at work in a group of its own: before that, the signal would hit us."""
    try:
        return os.getpgid(child) == child
    except ProcessLookupError:
        return False


def main() -> None:
    """Kill, look, print."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.kills", description=__doc__)
    parser.add_argument("--moments", type=int, default=50)
    parser.add_argument("--commands", nargs="+", choices=[*COMMANDS], default=[*COMMANDS])
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    load_commands()
    bad = 0
    print(
        "| command | killed | outputs found | not whole | inputs damaged |\n|---|---|---|---|---|"
    )
    for name in asked.commands:
        with tempfile.TemporaryDirectory(prefix="kills-") as folder:
            os.environ["IMPACT_VISION_CACHE"] = str(Path(folder) / "cache")
            found = killed_at_random(COMMANDS[name], asked.moments, asked.seed, Path(folder) / "at")
        bad += len(found.broken) + len(found.damaged)
        print(
            f"| {name} | {found.moments} | {found.written} | {len(found.broken)}"
            f" {' '.join(sorted(set(found.broken)))} | {len(found.damaged)} |",
            flush=True,
        )
    sys.exit(min(bad, 1))


if __name__ == "__main__":
    main()
