"""``python -m bench.hostile.mutate --seconds 300``: bytes changed at random, and read.

A plain mutator below the level of strategies: bits, bytes, words and blocks of sound files are
flipped, cut, doubled, swapped and spliced with those of other files; in archives the members, too,
so that a wrong checksum is not all that readers see. Files go to the readers behind the doors, a
few hundred in each process. A reader may take a file or refuse it by an error of the project;
everything else is a fault, and kept as a case of the command that reads such files.
"""

import argparse
import functools
import io
import json
import os
import random
import resource
import signal
import sys
import tempfile
import time
import zipfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench.hostile.case import LARGEST_BYTES, Case, Kind
from bench.hostile.draw import BOOK, LAWS, SETUP, _sound_clips, _sound_tracks, table_text
from bench.hostile.warm import load_commands
from metrology import ImpactVisionError

__all__ = ["TARGETS", "Target", "mutated", "rounds"]

_BATCH = 100
"""Files in a process: a reader that dies takes no more with it."""
_WORK_S = 20
"""Of processor time for one file."""


@dataclass(frozen=True)
class Target:
    """A reader, and sound files for it.

    Attributes
    ----------
    kind : Kind
    command : tuple of str
        What reads such a file on the command line; ``@`` is the file.
    read : callable
    seeds : callable
        Sound files, name to bytes.
    tokens : tuple of bytes
        Words of the format, put in at random places.
    """

    kind: Kind
    command: tuple[str, ...]
    read: Callable[[Path], object]
    seeds: Callable[[], dict[str, bytes]]
    tokens: tuple[bytes, ...] = ()


def _read_setup(path: Path) -> object:
    from pipelines.setup.file import load_setup

    return load_setup(path)


def _read_laws(path: Path) -> object:
    from pipelines.setup.cor_file import read_cor_file

    return read_cor_file(path)


def _read_lens(path: Path) -> object:
    from calib.lens import read_lens

    return read_lens(path)


def _read_tracks(path: Path) -> object:
    from pipelines.interop.measured import track_table

    return track_table(path, {})


def _read_book(path: Path) -> object:
    from pipelines.campaign.results import read_lab_book

    return read_lab_book(path)


def _read_samples(path: Path) -> object:
    from pipelines.explain.campaign import load_campaign
    from pipelines.setup.file import read_setup

    return load_campaign(path, None, read_setup(SETUP))


def _read_clip(path: Path) -> object:
    from vision.clip.clip import ClipReader

    clip = ClipReader.open(path)
    return sum(1 for _ in clip.frames())


def _read_ledger(path: Path) -> object:
    from pipelines.campaign.ledger import Ledger

    (path.parent / "ledger.sqlite").write_bytes(path.read_bytes())
    with Ledger(path.parent) as ledger:
        return list(ledger.entries()), ledger.counts()


LENS = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 320., 0., 600., 240., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.1, 0.01, 0., 0., 0. ]
"""


def _samples() -> dict[str, bytes]:
    lines = ["trial,backswing_deg,ball,t_s,x_m,y_m"]
    lines += [
        f"t{trial},60,jokku,{0.01 * k:.2f},{0.02 * k:.3f},{0.3 + 0.01 * k - 0.0005 * k * k:.4f}"
        for trial in range(3)
        for k in range(12)
    ]
    return {"a.csv": ("\n".join(lines) + "\n").encode(), "b.csv": table_text().encode()}


@functools.cache
def _ledgers() -> dict[str, bytes]:
    from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder

    with tempfile.TemporaryDirectory() as folder:
        with Ledger(Path(folder)) as ledger:
            names = ["a.mp4", "b.mp4"]
            ledger.plan([WorkOrder(n, n, "0", "0", "1") for n in names], retry_failed=False)
            document = json.dumps({"quantities": {"cor": {"value": 0.7, "std": 0.01, "unit": "1"}}})
            ledger.finish([AttemptOutcome("a.mp4", State.DONE, 1.0, document)])
        return {"ledger.db": (Path(folder) / "ledger.sqlite").read_bytes()}


@functools.cache
def _books() -> dict[str, bytes]:
    import openpyxl

    book = openpyxl.Workbook()
    for line in BOOK.splitlines():
        book.active.append(line.split(","))
    held = io.BytesIO()
    book.save(held)
    return {"a.csv": BOOK.encode(), "b.xlsx": held.getvalue()}


_XML = (b"<", b"</", b"&amp;", b"&#0;", b"<![CDATA[", b"NaN", b"-1", b'""', b"1e309", b"<a>" * 99)
_CELLS = (b",", b";", b"\t", b'"', b"\r", b"\x00", b"nan", b"1e309", b"-", b"=1+1", b"\xff\xfe")
_TOML = (
    b"[",
    b"]",
    b"=",
    b'"""',
    b"[[",
    b"nan",
    b"-inf",
    b"1e309",
    b".",
    b"9" * 40,
    b"\xef\xbb\xbf",
)

TARGETS = {
    "setup": Target(Kind.SETUP, ("simulate", "--impact-speed", "2.5", "--setup", "@"),
                    _read_setup, lambda: {"a.toml": SETUP.encode()}, _TOML),
    "laws": Target(Kind.LAWS, ("simulate", "--impact-speed", "2.5", "--ball", "jokku",
                               "--cor-law", "@"),
                   _read_laws, lambda: {"a.toml": LAWS.encode()}, _TOML),
    "lens": Target(Kind.SETUP, ("calibrate", "wall", "a.avi", "--lens", "@"),
                   _read_lens, lambda: {"a.yaml": LENS.encode()},
                   (b"!!python/object/apply:os.system", b"&a", b"*a", b"[", b": ", b".nan")),
    "tracks": Target(Kind.TRACKS, ("convert", "@", "o.csv"), _read_tracks, _sound_tracks,
                     _XML + _CELLS),
    "lab book": Target(Kind.LAB_BOOK, ("campaign", "none.mp4", "--trials", "@", "--out", "out"),
                       _read_book, _books, _CELLS),
    "samples": Target(Kind.TABLE, ("explain", "@", "--setup", "lab.toml"), _read_samples, _samples,
                      _CELLS),
    "clip": Target(Kind.CLIP, ("measure", "@", "--fps", "600"), _read_clip, _sound_clips,
                   (b"moov", b"mdat", b"\x00\x00\x00\x01", b"RIFF", b"\xff\xff\xff\xff", b"stts")),
    "ledger": Target(Kind.LAB_BOOK, ("campaign", "status", "."), _read_ledger, _ledgers),
}  # fmt: skip

_EDGES = (0, 1, 16, 127, 128, 255, 256, 32_767, 32_768, 65_535, 2**31 - 1, 2**31, 2**32 - 1)


def mutated(
    data: bytes, others: list[bytes], tokens: tuple[bytes, ...], rng: random.Random
) -> bytes:
    """The bytes with one to sixteen changes."""
    if data[:2] == b"PK" and rng.random() < 0.8:
        return _repacked(data, others, tokens, rng)
    raw = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        _change(raw, others, tokens, rng)
    return bytes(raw)


def _change(
    raw: bytearray, others: list[bytes], tokens: tuple[bytes, ...], rng: random.Random
) -> None:
    at = rng.randrange(len(raw) + 1)
    # long blocks are rare in short files: little of them would be left
    long = min(1 << rng.randrange(12), rng.randrange(len(raw) // 8 + 2))
    match rng.randrange(10):
        case 0 if raw:
            raw[at - 1] ^= 1 << rng.randrange(8)
        case 1 if raw:
            raw[at - 1] = rng.choice(_EDGES) & 255
        case 2:
            wide = rng.choice((2, 4, 8))
            number = rng.choice(_EDGES) % (1 << 8 * wide)
            raw[at : at + wide] = number.to_bytes(wide, rng.choice(("little", "big")))
        case 3:
            del raw[at : at + long]
        case 4:
            raw[at:at] = raw[max(0, at - long) : at]
        case 5:
            raw[at:at] = rng.randbytes(rng.randrange(1, 9))
        case 6 if tokens:
            raw[at:at] = rng.choice(tokens)
        case 7:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            raw[at : at + long] = other[start : start + long]
        case 8:
            to = rng.randrange(len(raw) + 1)
            raw[at : at + long], raw[to : to + long] = raw[to : to + long], raw[at : at + long]
        case 9 if rng.random() < 0.1:
            del raw[at:]
        case _:
            raw[at:at] = bytes(raw[at : at + 8]) * rng.choice((2, 50, 2_000))


def _repacked(
    data: bytes, others: list[bytes], tokens: tuple[bytes, ...], rng: random.Random
) -> bytes:
    """An archive with the same members, one of them changed, and sums that are right again."""
    held = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as whole, zipfile.ZipFile(held, "w") as new:
        names = whole.namelist()
        changed = rng.choice(names)
        for name in names:
            inside = bytearray(whole.read(name))
            if name == changed:
                for _ in range(1 << rng.randrange(4)):
                    _change(inside, others, tokens, rng)
            new.writestr(name, bytes(inside))
    return held.getvalue()


def _files(target: Target, of: int, first: int) -> list[tuple[str, bytes]]:
    """A batch: names and bytes; the same numbers give the same ones."""
    seeds = target.seeds()
    names, others = sorted(seeds), list(seeds.values())
    found = []
    for number in range(first, first + _BATCH):
        rng = random.Random(f"{of} {number}")
        name = rng.choice(names)
        found.append((name, mutated(seeds[name], others, target.tokens, rng)))
    return found


def _read_all(target: Target, files: list[tuple[str, bytes]], tell: int) -> None:
    """Read a batch in this process, and write of each how it ended."""
    resource.setrlimit(resource.RLIMIT_AS, (2 * LARGEST_BYTES, 2 * LARGEST_BYTES))

    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        for number, (name, data) in enumerate(files):
            inside = Path(folder) / f"{number}"
            inside.mkdir()
            path = inside / name
            path.write_bytes(data)
            os.write(tell, f"{number} ".encode())
            spent = resource.getrusage(resource.RUSAGE_SELF)
            most = int(spent.ru_utime + spent.ru_stime) + _WORK_S
            resource.setrlimit(resource.RLIMIT_CPU, (most, resource.RLIM_INFINITY))
            os.write(tell, (_ending(target.read, path) + "\n").encode())


def _ending(read: Callable[[Path], object], path: Path) -> str:
    try:
        read(path)
    except ImpactVisionError as problem:
        return "refused" if str(problem) else "refused without a word"
    except BaseException as problem:
        return ascii(f"{type(problem).__name__}: {str(problem)[:120]}")
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return "taken" if held < LARGEST_BYTES else "memory over 2 GB"


def read_batch(target: Target, files: list[tuple[str, bytes]]) -> list[str]:
    """How each file of a batch ended; the rest of a batch whose process dies is read anew."""
    listen, tell = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(listen)
            _read_all(target, files, tell)
        finally:
            os._exit(0)
    os.close(tell)
    with os.fdopen(listen, "rb") as heard:
        lines = heard.read().decode().split("\n")
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    ended = [line.split(" ", 1)[1] for line in lines[:-1]]
    if len(ended) == len(files):
        return ended
    died = "hang" if status in (-signal.SIGXCPU, -signal.SIGKILL) else f"dies of signal {-status}"
    rest = files[len(ended) + 1 :]
    return [*ended, died, *(read_batch(target, rest) if rest else [])]


def rounds(
    seconds: float, of: int, names: list[str], keep: Path | None
) -> Counter[tuple[str, str]]:
    """Batches of all targets in turn until the time is over; endings by target."""
    found: Counter[tuple[str, str]] = Counter()
    until, first = time.monotonic() + seconds, 0
    while time.monotonic() < until:
        for name in names:
            target = TARGETS[name]
            files = _files(target, of, first)
            for (file, data), ending in zip(files, read_batch(target, files), strict=True):
                sound = ending in ("taken", "refused")
                found[name, ending if sound else "fault"] += 1
                if not sound:
                    _keep(target, file, data, ending, keep)
        first += _BATCH
    return found


def _keep(target: Target, file: str, data: bytes, ending: str, keep: Path | None) -> None:
    command = tuple(file if word == "@" else word for word in target.command)
    files = {file: data}
    if "lab.toml" in command:
        files["lab.toml"] = SETUP.encode()
    if command[:2] == ("campaign", "status"):
        files = {"ledger.sqlite": data}
    case = Case(target.kind, command, files, ("o.csv", "out"))
    print(f"{case.name}: {target.kind}: {ending}", file=sys.stderr, flush=True)
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
        (keep / f"{case.name}.json").write_text(case.text() + "\n", encoding="utf-8")


def main() -> None:
    """Change, read, count."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.mutate", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--targets", nargs="+", choices=[*TARGETS], default=[*TARGETS])
    parser.add_argument("--keep", type=Path, default=Path(__file__).with_name("kept"))
    asked = parser.parse_args()
    load_commands()
    found = rounds(asked.seconds, asked.seed, asked.targets, asked.keep)
    faults = sum(number for (_, ending), number in found.items() if ending == "fault")
    print("| bytes changed in | files | taken | refused | faults |\n|---|---|---|---|---|")
    for name in asked.targets:
        row = [found[name, ending] for ending in ("taken", "refused", "fault")]
        print(f"| {name} | {sum(row):,} | {row[0]:,} | {row[1]:,} | {row[2]} |")
    print(f"| all | {found.total():,} | | | {faults} |")
    sys.exit(min(faults, 1))


if __name__ == "__main__":
    main()
