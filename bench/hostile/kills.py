"""Kill writing commands at random moments: outputs are complete or absent.

Run: python -m bench.hostile.kills [--moments 50] [--commands NAME…]

Inputs must be unchanged, and every output either absent, as before, or readable. A hidden
temporary file may remain after signal 9; it does not carry an output's name.
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

from bench.hostile.case import load_commands, start
from bench.hostile.damaged import LAWS, SETUP, sound_tracks, table_text

__all__ = ["COMMANDS", "Writer", "complete", "killed_at_random"]


def _decoded(data: bytes) -> object:
    with av.open(io.BytesIO(data)) as container:
        return sum(1 for _ in container.decode(video=0))


def _ends_with(mark: bytes) -> Callable[[bytes], object]:
    return lambda data: data.rstrip().rindex(mark, len(data.rstrip()) - len(mark))


_READERS: dict[str, Callable[[bytes], object]] = {
    ".json": json.loads,
    ".csv": lambda data: pd.read_csv(io.BytesIO(data)),
    ".toml": lambda data: tomllib.loads(data.decode()),
    **dict.fromkeys((".png", ".jpg"), lambda data: Image.open(io.BytesIO(data)).load()),
    ".parquet": lambda data: pd.read_parquet(io.BytesIO(data)),
    **dict.fromkeys((".svg", ".kva", ".trk"), ElementTree.fromstring),
    ".xlsx": lambda data: zipfile.ZipFile(io.BytesIO(data)).testzip(),
    ".html": _ends_with(b"</html>"),
    ".pdf": _ends_with(b"%%EOF"),
    ".mp4": _decoded,
}


def complete(name: str, data: bytes) -> bool:
    """Whether a file can be read to its end."""
    try:
        _READERS[Path(name).suffix](data)
    except Exception:
        return False
    return True


def _sound(path: Path) -> bool:
    """Whether an output is complete; a ledger is checked with the files SQLite keeps next to it."""
    if path.suffix != ".sqlite":
        return complete(path.name, path.read_bytes())
    with contextlib.closing(sqlite3.connect(path)) as base:
        return bool(base.execute("PRAGMA integrity_check").fetchone() == ("ok",))


@dataclass(frozen=True)
class Writer:
    """A command line that writes files, and its input files."""

    arguments: str
    inputs: Callable[[], dict[str, bytes]]


def _setup() -> dict[str, bytes]:
    return {"lab.toml": SETUP.encode(), "cor.toml": LAWS.encode()}


def _table() -> dict[str, bytes]:
    return {"b.csv": table_text().encode(), "lab.toml": SETUP.encode()}


@functools.cache
def _sample() -> dict[str, bytes]:
    clips = Path(__file__).parents[2] / "sample_videos" / "clips"
    return {"a.mp4": (clips / "jokku_90_small.mp4").read_bytes()}


def _campaign() -> dict[str, bytes]:
    clips = {f"clips/{name}.mp4": _sample()["a.mp4"] for name in "ab"}
    return {**clips, "trials.csv": b"clip,ball\na,jokku\nb,jokku\n"}


COMMANDS = {
    "simulate": Writer(
        "simulate --impact-speed 2.5 --setup lab.toml --json o.json --csv o.csv --plot o.png",
        _setup,
    ),
    "plan": Writer(
        "plan --distance 1.5m --ball jokku --cor-law cor.toml --json o.json --csv o.csv"
        " --plot o.svg",
        _setup,
    ),
    "render": Writer("render --setup lab.toml --size 96x64 --frames 6 -o o.mp4", _setup),
    "explain": Writer(
        "explain b.csv --setup lab.toml --json o.json --report o.html --plot o.png --model o.toml",
        _table,
    ),
    "convert": Writer("convert a.trk o.csv", sound_tracks),
    "measure from tracks": Writer(
        "measure --from-tracks a.trk --fps 240 --json o.json --csv o.csv --tracks t.csv",
        sound_tracks,
    ),
    "measure": Writer(
        "measure a.mp4 --fps 600 --ball jokku --json o.json --csv o.csv --tracks t.csv"
        " --overlay v.mp4 --plot o.png --report o.html",
        _sample,
    ),
    "measure many": Writer(
        "measure a.mp4 --fps 600 --ball jokku --out many -j 1 --json o.json", _sample
    ),
    "paper": Writer("paper --quiet --json o.json --csv o.csv --figures figures", dict),
    "campaign": Writer(
        "campaign clips --trials trials.csv --fps 600 --out out -j 1 --quiet", _campaign
    ),
    "calibrate": Writer("calibrate a.mp4 --yes --fps 600 --ball jokku --out setup.toml", _sample),
    "calibrate board": Writer("calibrate board --pdf o.pdf", dict),
    "calibrate plan": Writer("calibrate plan --no-changes --quiet --json o.json", dict),
}


def killed_at_random(
    writer: Writer, moments: int, seed: int, folder: Path
) -> tuple[int, list[str], list[str]]:
    """Kill a command `moments` times; outputs found, incomplete outputs, damaged inputs."""
    rng = random.Random(seed)
    inputs = writer.inputs()
    _run(writer, inputs, folder / "first", None)
    longest = _run(writer, inputs, folder / "whole", None)
    written, broken, damaged = 0, list[str](), list[str]()
    for number in range(moments):
        place = folder / f"{number}"
        # most files are written near the end
        _run(writer, inputs, place, longest * (1.1 - rng.random() ** 2))
        damaged += [name for name, data in inputs.items() if (place / name).read_bytes() != data]
        for path in sorted(place.rglob("*")):
            name = str(path.relative_to(place))
            aside = path.name.startswith(".") or name.endswith(("-wal", "-shm"))
            if path.is_file() and not aside and name not in inputs:
                written += 1
                broken += [] if _sound(path) else [name]
    return written, broken, damaged


def _run(writer: Writer, inputs: dict[str, bytes], folder: Path, until_s: float | None) -> float:
    """Duration of a run, s; it is ended by signal 9 after `until_s`."""
    folder.mkdir(parents=True)
    for name, data in inputs.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    said = folder.with_suffix(".said")
    began = time.monotonic()
    child = start(tuple(writer.arguments.split()), folder, said)
    if until_s is not None:
        time.sleep(until_s)
        # before the child has its own process group, the signal would reach this process
        with contextlib.suppress(ProcessLookupError):
            if os.getpgid(child) == child:
                os.killpg(child, signal.SIGKILL)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if until_s is None and status != 0:
        raise RuntimeError(f"{writer.arguments} ends with {status}: {said.read_text()}")
    return time.monotonic() - began


def main() -> None:
    """Kill, check, print."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.kills", description=__doc__)
    parser.add_argument("--moments", type=int, default=50)
    parser.add_argument("--commands", nargs="+", choices=[*COMMANDS], default=[*COMMANDS])
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    load_commands()
    bad = 0
    print("| command | killed | outputs found | incomplete | inputs damaged |")
    print("|---|---|---|---|---|")
    for name in asked.commands:
        with tempfile.TemporaryDirectory(prefix="kills-") as folder:
            os.environ["IMPACT_VISION_CACHE"] = str(Path(folder) / "cache")
            written, broken, damaged = killed_at_random(
                COMMANDS[name], asked.moments, asked.seed, Path(folder) / "at"
            )
        bad += len(broken) + len(damaged)
        incomplete = " ".join([str(len(broken)), *sorted(set(broken))])
        print(f"| {name} | {asked.moments} | {written} | {incomplete} | {len(damaged)} |",
              flush=True)  # fmt: skip
    sys.exit(min(bad, 1))


if __name__ == "__main__":
    main()
