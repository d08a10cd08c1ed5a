"""Kill writing commands at random moments: outputs are complete or absent.

Run: python -m bench.hostile.kills [--moments 20] [--commands NAME…] [--json FILE]

Inputs must be unchanged, and every output either absent, as before, or readable. A hidden
temporary file may remain after signal 9; it does not carry an output's name. The processes that the
command started end within 5 s. What goes on where it stopped is then run again: it ends well, and
its table has each clip once. With --json the counts are stored by command, for the docs; commands
that are not run keep theirs.
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
from dataclasses import asdict, dataclass
from pathlib import Path
from xml.etree import ElementTree

import av
import pandas as pd
import psutil
from PIL import Image

from bench.hostile.case import load_commands, start
from bench.hostile.damaged import LAWS, SETUP, sound_tracks, table_text

__all__ = ["WRITERS", "Kills", "Writer", "complete", "killed_at_random"]

MAX_ORPHAN_S = 5.0
"""Time within which processes end after the one that started them, s; convention."""


def _decoded(data: bytes) -> object:
    with av.open(io.BytesIO(data)) as container:
        return sum(1 for _ in container.decode(video=0))


def _ends_with(mark: bytes) -> Callable[[bytes], object]:
    return lambda data: data.rstrip().rindex(mark, len(data.rstrip()) - len(mark))


_FILE_READERS: dict[str, Callable[[bytes], object]] = {
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
        _FILE_READERS[Path(name).suffix](data)
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
    """A command line that writes files, its input files, and the table that it goes on with.

    With `run`, that is called in the command's place.
    """

    arguments: str
    inputs: Callable[[], dict[str, bytes]]
    table: str | None = None
    run: Callable[[], None] | None = None


@dataclass
class Kills:
    """Counts of one command: outputs found, and what went wrong."""

    killed: int = 0
    outputs: int = 0
    incomplete: int = 0
    inputs_damaged: int = 0
    orphans: int = 0
    resumed: int = 0
    not_resumed: int = 0

    @property
    def bad(self) -> int:
        """Number of faults."""
        return self.incomplete + self.inputs_damaged + self.orphans + self.not_resumed


def _setup() -> dict[str, bytes]:
    return {"lab.toml": SETUP.encode(), "cor.toml": LAWS.encode()}


def _table() -> dict[str, bytes]:
    return {"b.csv": table_text().encode(), "lab.toml": SETUP.encode()}


@functools.cache
def _sample() -> dict[str, bytes]:
    clips = Path(__file__).parents[2] / "sample_videos" / "clips"
    return {"a.mp4": (clips / "jokku_90_small.mp4").read_bytes()}


def _clips() -> dict[str, bytes]:
    return {f"clips/{name}.mp4": _sample()["a.mp4"] for name in "ab"}


def _campaign() -> dict[str, bytes]:
    return {**_clips(), "trials.csv": b"clip,ball\na,jokku\nb,jokku\n"}


def _campaign_of_the_page() -> None:
    """A campaign as the page begins it."""
    from pipelines.app.campaign import FolderInputs, FolderSession

    session = FolderSession.of(Path("clips"))
    session.begin(FolderInputs(fps="600", ball="jokku"))
    session.finish()
    sys.exit(session.problem or 0)


WRITERS = {
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
        "measure clips/a.mp4 clips/b.mp4 --fps 600 --ball jokku --out many -j 2 --json o.json",
        _clips,
        "many/results.csv",
    ),
    "paper": Writer("paper --quiet --json o.json --csv o.csv --figures figures", dict),
    "campaign": Writer(
        "campaign clips --trials trials.csv --fps 600 --out out -j 2 --quiet",
        _campaign,
        "out/results.csv",
    ),
    "campaign of the page": Writer(
        "app clips", _clips, "clips/results/results.csv", _campaign_of_the_page
    ),
    "calibrate": Writer("calibrate a.mp4 --yes --fps 600 --ball jokku --out setup.toml", _sample),
    "calibrate board": Writer("calibrate board --pdf o.pdf", dict),
    "calibrate plan": Writer("calibrate plan --no-changes --quiet --json o.json", dict),
}


def killed_at_random(writer: Writer, moments: int, seed: int, folder: Path) -> Kills:
    """Kill a command `moments` times and count what is left."""
    rng = random.Random(seed)
    inputs = writer.inputs()
    _run(writer, inputs, folder / "first")
    longest = _run(writer, inputs, folder / "whole")
    found = Kills()
    for number in range(moments):
        place = folder / f"{number}"
        # most files are written near the end
        found.orphans += _killed(writer, inputs, place, longest * (1.1 - rng.random() ** 2))
        found.killed += 1
        found.inputs_damaged += sum(
            (place / name).read_bytes() != data for name, data in inputs.items()
        )
        for path in sorted(place.rglob("*")):
            name = str(path.relative_to(place))
            hidden = any(part.startswith(".") for part in Path(name).parts)
            aside = hidden or name.endswith(("-wal", "-shm"))
            if path.is_file() and not aside and name not in inputs:
                found.outputs += 1
                found.incomplete += not _sound(path)
        if writer.table is not None:
            _run(writer, inputs, place)
            rows = pd.read_csv(place / writer.table)["clip"]
            right = len(rows) == 2 and rows.is_unique
            found.resumed += right
            found.not_resumed += not right
    return found


def _started(writer: Writer, inputs: dict[str, bytes], folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in inputs.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    arguments = tuple(writer.arguments.split())
    return start(arguments, folder, folder.with_suffix(".said"), writer.run)


def _run(writer: Writer, inputs: dict[str, bytes], folder: Path) -> float:
    """Duration of a run to its end, s."""
    began = time.monotonic()
    child = _started(writer, inputs, folder)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status != 0:
        said = folder.with_suffix(".said").read_text()
        raise RuntimeError(f"{writer.arguments} ends with {status}: {said}")
    return time.monotonic() - began


def _killed(writer: Writer, inputs: dict[str, bytes], folder: Path, after_s: float) -> int:
    """Kill the command's own process after a time; processes that it leaves at work."""
    child = _started(writer, inputs, folder)
    time.sleep(after_s)
    with contextlib.suppress(psutil.NoSuchProcess):
        others = psutil.Process(child).children(recursive=True)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        alive = psutil.wait_procs(others, timeout=MAX_ORPHAN_S)[1]
        for one in alive:
            one.kill()
        return len(alive)
    return 0


HEAD = ("command", "killed", "outputs found", "incomplete", "inputs damaged", "orphans", "resumed")


def row(name: str, found: Kills) -> tuple[str, ...]:
    """One line of the table of the docs."""
    asked = found.resumed + found.not_resumed
    resumed = f"{found.resumed} of {asked}" if asked else "–"
    counts = (found.killed, found.outputs, found.incomplete, found.inputs_damaged, found.orphans)
    return (name, *map(str, counts), resumed)


def main() -> None:
    """Kill, check, print."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.kills", description=__doc__)
    parser.add_argument("--moments", type=int, default=20)
    parser.add_argument("--commands", nargs="+", choices=[*WRITERS], default=[*WRITERS])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    load_commands()
    every: dict[str, Kills] = {}
    print("| " + " | ".join(HEAD) + " |")
    print("|---" * len(HEAD) + "|")
    for name in asked.commands:
        with tempfile.TemporaryDirectory(prefix="kills-") as folder:
            os.environ["IMPACT_VISION_CACHE"] = str(Path(folder) / "cache")
            every[name] = killed_at_random(
                WRITERS[name], asked.moments, asked.seed, Path(folder) / "at"
            )
        print("| " + " | ".join(row(name, every[name])) + " |", flush=True)
        if asked.json is not None:
            kept = json.loads(asked.json.read_text("utf-8")) if asked.json.exists() else {}
            counts = kept | {name: asdict(every[name])}
            asked.json.write_text(json.dumps(counts, indent=1) + "\n", encoding="utf-8")
    sys.exit(min(sum(one.bad for one in every.values()), 1))


if __name__ == "__main__":
    main()
