"""``python -m bench.hostile.causes [--tree FOLDER]``: what happened to the first build, once more.

Nine causes brought the first build (a1dcaa4) down, or let something change in silence. Of each
there are a few inputs here, run as a user runs them, against this tree or that of another commit::

    git worktree add --detach ../first-build a1dcaa4
    python -m bench.hostile.causes --tree ../first-build

With both, the table says what each makes of them. Nothing here writes to a device: old builds
replaced devices by files.
"""

import argparse
import io
import json
import os
import resource
import signal
import stat
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.hostile.case import LARGEST_BYTES, LONGEST_S
from bench.hostile.draw import SETUP, _sound_clips, table_text
from bench.hostile.nulls import null_case
from bench.hostile.reads import damaged

__all__ = ["Encounter", "Ending", "encountered", "encounters"]

ROOT = Path(__file__).parents[2]
_PATIENCE_S = 90.0
"""Of any time: a busy machine is slower than one with nothing else to do."""
RUN = "from pipelines.cli import app; app()"


@dataclass(frozen=True)
class Ending:
    """How a command ended.

    Attributes
    ----------
    code : int or None
        Exit code; None: it did not end and was killed.
    said, results : str
        On stderr and stdout.
    folder : Path
        Where it ran.
    worked_s : float
        Processor time, s.
    """

    code: int | None
    said: str
    results: str
    folder: Path
    worked_s: float

    def refused(self, *codes: int) -> str:
        """What is wrong, unless it was refused in words with one of the codes; empty if nothing."""
        fault = self.fault()
        if fault or self.code in codes:
            return fault
        return f"ends with {self.code}"

    def fault(self) -> str:
        """A traceback, a hang, a death; empty if none."""
        if self.code is None or self.worked_s > LONGEST_S:
            return "hangs"
        if "Traceback (most recent call last)" in self.said:
            last = self.said.strip().splitlines()[-1]
            return f"traceback: {last.split(':')[0][:40]}"
        return f"dies of signal {-self.code}" if self.code < 0 else ""


Judge = Callable[[Ending], str]
Bytes = bytes | Callable[[], bytes]
"""Of a file, or what makes them when they are wanted: simulated tables take a second."""


@dataclass(frozen=True)
class Encounter:
    """One input of a cause.

    Attributes
    ----------
    cause : int
        1 to 9.
    name : str
        What is handed in.
    arguments : tuple of str
        Of the command; of a program where `script` is given.
    judge : callable
        What is wrong with how it ended, in a few words; empty where all is well.
    files : mapping of str to bytes, or to what gives them
    prepare : callable
        Further things in the folder.
    largest_file : int or None
        Bytes after which the disk is full.
    memory : int
        Bytes that may be held.
    environment : mapping of str to str
    disturb : callable
        Called with the process while it works.
    script : str
        Python, in place of the command.
    """

    cause: int
    name: str
    arguments: tuple[str, ...]
    judge: Judge
    files: dict[str, Bytes] = field(default_factory=dict)
    prepare: Callable[[Path], None] = lambda folder: None
    largest_file: int | None = None
    memory: int = 2 * LARGEST_BYTES
    environment: dict[str, str] = field(default_factory=dict)
    disturb: Callable[["subprocess.Popen[bytes]", Path], None] = lambda process, folder: None
    script: str = RUN


def encountered(encounter: Encounter, tree: Path, folder: Path) -> str:
    """Run one against a tree; what is wrong with how it ended, or nothing."""
    for name, data in encounter.files.items():
        (folder / name).write_bytes(data() if callable(data) else data)
    encounter.prepare(folder)

    def limits() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (encounter.memory, encounter.memory))
        if encounter.largest_file is not None:
            most = encounter.largest_file
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        [sys.executable, "-B", "-c", encounter.script, *encounter.arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(tree), "COLUMNS": "100", "NO_COLOR": "1",
             "IMPACT_VISION_CACHE": "off", **encounter.environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=limits,
    )  # fmt: skip
    encounter.disturb(process, folder)
    try:
        results, said = process.communicate(timeout=_PATIENCE_S)
        code: int | None = process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        results, said = process.communicate()
        code = None
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    worked = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    words = [part.decode("utf-8", errors="replace") for part in (said, results)]
    return encounter.judge(Ending(code, words[0], words[1], folder, worked))


SIMULATE = ("simulate", "--backswing", "60deg", "--ball", "jokku")
SPEED = ("simulate", "--impact-speed", "2.5")


def _is_json(path: Path) -> bool:
    try:
        json.loads(path.read_bytes())
    except (OSError, ValueError):
        return False
    return True


def _two(code: Ending) -> str:
    return code.refused(2)


def _four(ending: Ending) -> str:
    """Refused, or measured with what it could: no traceback, nothing without end."""
    return ending.refused(0, 2, 4)


def _unreadable(ending: Ending) -> str:
    return ending.refused(2, 3)


# --- 1. outputs


def _link(folder: Path) -> None:
    (folder / "there").mkdir()
    (folder / "there" / "o.json").write_text("old")
    (folder / "o.json").symlink_to(folder / "there" / "o.json")


def _link_stays(ending: Ending) -> str:
    if not (ending.folder / "o.json").is_symlink():
        return "the link is replaced by a file"
    return "" if _is_json(ending.folder / "there" / "o.json") else "nothing is written"


def _open_mode(folder: Path) -> None:
    (folder / "o.json").write_text("old")
    (folder / "o.json").chmod(0o664)


def _mode_stays(ending: Ending) -> str:
    mode = stat.S_IMODE((ending.folder / "o.json").stat().st_mode)
    return "" if mode == 0o664 else f"its mode becomes {mode:o}"


def _pipe(folder: Path) -> None:
    os.mkfifo(folder / "o.json")
    # held open, so that a writer finds a reader
    os.open(folder / "o.json", os.O_RDWR | os.O_NONBLOCK)


def _pipe_stays(ending: Ending) -> str:
    mode = (ending.folder / "o.json").lstat().st_mode
    return ending.fault() or ("" if stat.S_ISFIFO(mode) else "the pipe is replaced by a file")


def _input_stays(ending: Ending) -> str:
    if (ending.folder / "lab.toml").read_bytes() != SETUP.encode():
        return "the input is destroyed"
    return ending.refused(2)


def _terminated(process: "subprocess.Popen[bytes]", folder: Path) -> None:
    until = time.monotonic() + _PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        if any(path.name.startswith(".") for path in folder.iterdir()):
            process.terminate()
            return
        time.sleep(0.01)


def _nothing_left(ending: Ending) -> str:
    left = [path.name for path in ending.folder.iterdir()]
    return f"{left[0][:3]}… is left behind" if left else ""


# --- 4. tables


def _table(change: Callable[[list[list[str]]], None], mark: str = ",") -> Callable[[], bytes]:
    def changed() -> bytes:
        rows = [line.split(",") for line in table_text().splitlines()]
        change(rows)
        return ("\n".join(mark.join(row) for row in rows) + "\n").encode()

    return changed


def _flights(marks: str = ",", point: str = ".", x: str | None = None) -> bytes:
    """Four throws with spin, as another program may have written them."""
    lines = [marks.join(("trial", "t_s", "x_m", "y_m"))]
    for trial in range(4):
        for k in range(30):
            t = 0.01 * k
            cells = (f"{t:.3f}", x or f"{(2.0 + 0.3 * trial) * t - 0.4 * t**2:.5f}",
                     f"{1.0 + 2.0 * t - 4.0 * t**2:.5f}")  # fmt: skip
            lines.append(marks.join((f"t{trial}", *(c.replace(".", point) for c in cells))))
    return ("\n".join(lines) + "\n").encode()


def _commas() -> bytes:
    """Decimal commas in one column alone, quoted, as a spreadsheet writes them."""
    head, *rows = _flights().decode().splitlines()
    cells = [row.split(",") for row in rows]
    shown = [f'{trial},{t},"{x.replace(".", ",")}",{y}' for trial, t, x, y in cells]
    return ("\n".join([head, *shown]) + "\n").encode()


def _times(factor: float) -> bytes:
    """Instants in another unit, or in none."""
    head, *rows = _flights().decode().splitlines()
    cells = [row.split(",") for row in rows]
    shown = [f"{trial},{factor * float(t):g},{x},{y}" for trial, t, x, y in cells]
    return ("\n".join([head, *shown]) + "\n").encode()


def _all_cells(column: int, value: str) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        for row in rows[1:]:
            row[column] = value

    return change


def _one_cell(row: int, column: int, value: str) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        rows[row][column] = value

    return change


def _twice(rows: list[list[str]]) -> None:
    rows[0][3] = rows[0][1]


EXPLAIN = ("explain", "b.csv", "--setup", "lab.toml", "--json", "o.json")


def _told(ending: Ending) -> str:
    """Refused, or taken with a word about it."""
    fault = ending.refused(0, 2, 4)
    if fault or ending.code != 0:
        return fault
    held = json.loads((ending.folder / "o.json").read_text())
    told = held.get("notes") or held.get("warnings") or held.get("summary", {}).get("notes")
    return "" if told else "taken without a word"


# --- 5. numerics


def _noise_table(way: str, of: int) -> dict[str, bytes]:
    return dict(null_case(way, of).files)


def _swings() -> bytes:
    """Back-swings that belong to other trials."""
    rng = np.random.default_rng(4)
    lines = ["trial,backswing_deg,ball,t_s,x_m,y_m"]
    swings = rng.permutation([30, 45, 60, 75, 90, 105])
    for trial, swing in enumerate(swings):
        speed = 2.0 + 0.3 * trial
        for k in range(40):
            t = 0.01 * k
            x, y = speed * t, 0.31 + 0.3 * t - 4.9 * t * t
            x, y = x + rng.normal(0, 0.001), y + rng.normal(0, 0.001)
            lines.append(f"t{trial},{swing},jokku,{t:.3f},{x:.4f},{y:.4f}")
    return ("\n".join(lines) + "\n").encode()


# --- 6. pictures


def _giant_png() -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        check = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)

    head = struct.pack(">IIBBBBB", 60_000, 60_000, 1, 0, 0, 0, 0)
    body = zlib.compress(bytes(60_000 // 8 * 64))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def _giants(folder: Path) -> None:
    (folder / "stack").mkdir()
    for number in range(3):
        (folder / "stack" / f"{number}.png").write_bytes(_giant_png())


def _strike(size: tuple[int, int], frames: int = 40) -> bytes:
    """A clip of so many pixels in which a mass strikes a ball."""
    import av

    width, height = size
    held = io.BytesIO()
    rng = np.random.default_rng(1)
    with av.open(held, "w", format="avi") as container:
        stream = container.add_stream("ffv1", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        y, x = np.mgrid[:height, :width]
        for number in range(frames):
            picture = rng.normal(110, 3, (height, width, 3))
            for middle, level in (
                (0.45 + max(0, number - frames // 2) * 0.02, 220),
                (min(0.3, 0.05 + 0.3 * number / frames), 20),
            ):
                picture[np.hypot(x - width * middle, y - height * 0.6) < height * 0.12] = level
            shown = np.clip(picture, 0, 255).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, "rgb24")))
        container.mux(stream.encode(None))
    return held.getvalue()


MEASURE = ("measure", "--fps", "600", "--json", "o.json")

# --- 7. decoding

_READ = """
import hashlib, sys
from pathlib import Path
try:
    from vision.clip.clip import ClipReader
except ImportError:
    from vision.clip import Clip as ClipReader
found = set()
for path in sys.argv[1:]:
    seen = set()
    for _ in range(5):
        digest = hashlib.sha256()
        try:
            for frame in ClipReader.open(Path(path)).frames():
                digest.update(repr((frame.index, frame.time_s)).encode())
                digest.update(frame.gray.tobytes())
        except Exception as problem:
            digest.update(repr(problem).encode())
        seen.add(digest.hexdigest())
    found.add((path, len(seen)))
print(sum(number > 1 for _, number in found))
"""


def _one_reading(ending: Ending) -> str:
    fault = ending.fault()
    differ = int(ending.results.split()[-1]) if not fault else 0
    return fault or (f"{differ} of 12 clips differ from reading to reading" if differ else "")


def _damaged_clips() -> dict[str, bytes]:
    sound = _sound_clips()["long.mp4"]
    return {f"{k}.mp4": damaged(sound, 100 + k) for k in range(12)}


# --- 8. users' effects


def _own(text: str) -> dict[str, Bytes]:
    return {
        "b.csv": lambda: table_text().encode(),
        "lab.toml": SETUP.encode(),
        "own.py": text.encode(),
        "f.csv": _flights(),
    }


OWN = ("explain", "f.csv", "--setup", "lab.toml", "--effects", "own.py", "--json", "o.json")
_PULL = """
import numpy as np
from physics.effects import Effect, Parameter
class Pull(Effect):
    def force(self, values, flight):
        nothing = np.zeros_like(np.asarray(flight.vx))
        return {returned}
EFFECTS = [Pull("{id}", "A pull.", "F = k", "this lab", "{phase}",
                (Parameter("k", "N", 0.1, -9.0, 9.0),))]
"""


def _pull(
    returned: str = "nothing, nothing, nothing", id: str = "pull", phase: str = "flight"
) -> str:
    return _PULL.format(returned=returned, id=id, phase=phase)


# --- 9. small things


def _no_escape(ending: Ending) -> str:
    return ending.fault() or ("commands reach the terminal" if "\x1b" in ending.said else "")


def _shown(ending: Ending) -> str:
    return ending.fault() or ("" if "60.00" in ending.results else "an empty table")


def _quiet(ending: Ending) -> str:
    return ending.refused(2) or (
        "a library's warning before it" if "Warning" in ending.said else ""
    )


def _no_formula(ending: Ending) -> str:
    if not (ending.folder / "o.csv").exists():
        return ending.fault() or f"ends with {ending.code}"
    cells = (ending.folder / "o.csv").read_text().replace('"', "").split(",")
    return "a cell is a formula" if any(c.strip().startswith("=") for c in cells) else ""


def _setup_with(text: str) -> dict[str, bytes]:
    return {"lab.toml": (SETUP + text).encode()}


def _setup_changed(line: str, by: str) -> dict[str, bytes]:
    return {"lab.toml": SETUP.replace(line, by).encode()}


LAB = (*SPEED, "--setup", "lab.toml")
SOUND = {"lab.toml": SETUP.encode()}


def _with_table(data: Bytes) -> dict[str, Bytes]:
    return {"b.csv": data, "lab.toml": SETUP.encode()}


def _of_outputs() -> tuple[Encounter, ...]:
    """Outputs that are links, pipes, inputs, too large; a death while writing."""
    return (
        Encounter(
            1,
            "an output that is a link",
            (*SIMULATE, "--json", "o.json"),
            _link_stays,
            prepare=_link,
        ),
        Encounter(
            1, "an output's mode", (*SIMULATE, "--json", "o.json"), _mode_stays, prepare=_open_mode
        ),
        Encounter(
            1,
            "an output that is a pipe",
            (*SIMULATE, "--json", "o.json"),
            _pipe_stays,
            prepare=_pipe,
        ),
        Encounter(
            1, "an output that is an input", (*LAB, "--json", "lab.toml"), _input_stays, SOUND
        ),
        Encounter(
            1, "two outputs with one path", (*SIMULATE, "--json", "o.json", "--csv", "o.json"), _two
        ),
        Encounter(1, "a full disk", (*SIMULATE, "--json", "o.json"), _two, largest_file=64),
        Encounter(
            1,
            "SIGTERM while writing",
            ("render", "-o", "a.mp4"),
            _nothing_left,
            disturb=_terminated,
        ),
    )


def _of_setups() -> tuple[Encounter, ...]:
    """Setups and names that are no text, too long, too deep."""
    return (
        Encounter(
            2, "a pipe as setup", LAB, _two, prepare=lambda folder: os.mkfifo(folder / "lab.toml")
        ),
        Encounter(2, "/dev/zero as setup", (*SPEED, "--setup", "/dev/zero"), _two),
        Encounter(2, "a name of 5,000 characters", ("measure", "x" * 5000), _unreadable),
        Encounter(
            2,
            "a number of 5,000 digits",
            LAB,
            _two,
            _setup_changed("capture_fps = 600", "capture_fps = " + "9" * 5000),
        ),
        Encounter(
            2,
            "lists in lists, 2,000 deep",
            LAB,
            _two,
            _setup_with("[x]\na = " + "[" * 2000 + "]" * 2000),
        ),
        Encounter(
            2,
            "a setup in UTF-16",
            LAB,
            lambda e: e.refused(0),
            {"lab.toml": SETUP.encode("utf-16")},
        ),
        Encounter(
            2,
            "a setup with a byte-order mark",
            LAB,
            lambda e: e.refused(0),
            {"lab.toml": SETUP.encode("utf-8-sig")},
        ),
    )


def _of_numbers() -> tuple[Encounter, ...]:
    """Numbers that no rig has."""
    return (
        Encounter(
            3,
            "a drag coefficient of nan",
            LAB,
            _two,
            _setup_changed("drag_coefficient = 0.47", "drag_coefficient = nan"),
        ),
        Encounter(
            3,
            "--effect magnus:spin=nan",
            (*SPEED, "--ball", "jokku", "--effect", "magnus:spin=nan"),
            _two,
        ),
        Encounter(
            3,
            "--impact-speed 1e300",
            ("simulate", "--impact-speed", "1e300", "--ball", "jokku"),
            _two,
        ),
        Encounter(3, 'distance_to_wall = "-4 m"', LAB, _two, _setup_changed('"4.00 m"', '"-4 m"')),
        Encounter(
            3, "grid = 50 (metres)", LAB, _two, _setup_changed('\ngrid = "50 mm"', "\ngrid = 50")
        ),
        Encounter(3, 'cor = "(-1)**0.5"', (*SPEED, "--ball", "jokku", "--cor", "(-1)**0.5"), _two),
        Encounter(3, "[model.drag] foo = 1", LAB, _two, _setup_with("foo = 1\n")),
        Encounter(
            3,
            "a length of 1e200 m",
            LAB,
            _two,
            _setup_changed('length = "0.5541 m"', 'length = "1e200 m"'),
        ),
    )


def _of_tables() -> tuple[Encounter, ...]:
    """Tables with words, commas, infinities."""
    return (
        Encounter(4, "a column of words", EXPLAIN, _two, _with_table(_flights(x="abc"))),
        Encounter(4, "decimal commas", EXPLAIN, _told, _with_table(_commas())),
        Encounter(4, "one cell inf", EXPLAIN, _told, _with_table(_table(_one_cell(3, 5, "inf")))),
        Encounter(4, "uncertainties of 0", EXPLAIN, _told, _with_table(_table(_all_cells(6, "0")))),
        Encounter(4, "two columns of one name", EXPLAIN, _two, _with_table(_table(_twice))),
        Encounter(
            4,
            "a table in UTF-16",
            EXPLAIN,
            _told,
            _with_table(_flights().decode().encode("utf-16")),
        ),
    )


def _of_noise() -> tuple[Encounter, ...]:
    """Tables without physics in them."""
    return (
        Encounter(5, "back-swings of other trials", EXPLAIN, _four, _with_table(_swings())),
        Encounter(5, "noise in place of samples", EXPLAIN, _four, _noise_table("noise samples", 3)),
        Encounter(5, "samples shuffled", EXPLAIN, _four, _noise_table("shuffled", 4)),
        Encounter(5, "times of 1e12 s", EXPLAIN, _four, _with_table(_times(1e14))),
        Encounter(
            5,
            "uncertainties of 1e-300",
            EXPLAIN,
            _four,
            _with_table(_table(_all_cells(6, "1e-300"))),
        ),
        Encounter(
            5,
            "ball speeds of other trials",
            EXPLAIN,
            _four,
            _noise_table("ball speeds permuted", 1001),
        ),
    )


def _of_sizes() -> tuple[Encounter, ...]:
    """Pictures too small or too large."""
    return (
        Encounter(
            6,
            "a clip of 48 × 32 px",
            (*MEASURE, "a.avi"),
            lambda e: e.refused(0, 3, 4),
            {"a.avi": _strike((48, 32))},
        ),
        Encounter(
            6,
            "a clip of 8 × 8 px",
            (*MEASURE, "a.avi"),
            lambda e: e.refused(3, 4),
            {"a.avi": _strike((8, 8))},
        ),
        Encounter(
            6,
            "pictures of 60,000 × 60,000 px",
            (*MEASURE, "stack"),
            lambda e: e.refused(3),
            prepare=_giants,
        ),
    )


def _of_damage() -> tuple[Encounter, ...]:
    """Damaged clips."""
    return (
        Encounter(
            7,
            "12 damaged clips, read five times",
            tuple(_damaged_clips()),
            _one_reading,
            _damaged_clips(),
            script=_READ,
        ),
    )


def _of_effects() -> tuple[Encounter, ...]:
    """Users' effects that are none."""
    return (
        Encounter(8, "EFFECTS = 3", OWN, _two, _own("EFFECTS = 3")),
        Encounter(8, "sys.exit(0)", OWN, _two, _own("import sys; sys.exit(0)")),
        Encounter(8, "two components", OWN, _two, _own(_pull("nothing, nothing"))),
        Encounter(8, "a taken id", OWN, _two, _own(_pull(id="magnus"))),
        Encounter(8, "an unknown phase", OWN, _two, _own(_pull(phase="night"))),
        Encounter(8, "a loop without end", OWN, _two, _own("while True: pass")),
    )


def _of_terminals() -> tuple[Encounter, ...]:
    """Terminals, environments, warnings."""
    return (
        Encounter(
            9,
            "commands to the terminal in a setup",
            LAB,
            _no_escape,
            _setup_with('"\\u001b[2Jx" = 1\n'),
        ),
        Encounter(
            9, "--hold-out nope", (*EXPLAIN, "--hold-out", "nope"), _two, _with_table(_flights())
        ),
        Encounter(9, "COLUMNS=0", SIMULATE, _shown, environment={"COLUMNS": "0"}),
        Encounter(
            9,
            "a grid pitch without a unit",
            ("landing", "a.avi", "--fps", "600", "--wall-grid", "50"),
            _two,
            {"a.avi": _strike((96, 64))},
        ),
        Encounter(
            9,
            "warnings of libraries",
            ("simulate", "--impact-speed", "2.5", "--ball", "jokku", "--cor", "exp(1000*v)"),
            _quiet,
        ),
        Encounter(
            9,
            "ulimit -v 400 MB",
            ("measure", "a.avi"),
            lambda e: e.refused(2, 3),
            {"a.avi": _strike((96, 64))},
            memory=400 << 20,
        ),
    )


def encounters() -> tuple[Encounter, ...]:
    """All of them, drawn when they are asked for."""
    causes = (
        _of_outputs,
        _of_setups,
        _of_numbers,
        _of_tables,
        _of_noise,
        _of_sizes,
        _of_damage,
        _of_effects,
        _of_terminals,
    )
    return tuple(one for cause in causes for one in cause())


def main() -> None:
    """Run all, print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.causes", description=__doc__)
    parser.add_argument("--tree", type=Path, help="an older tree, beside this one")
    parser.add_argument("--causes", type=int, nargs="+", default=list(range(1, 10)))
    asked = parser.parse_args()
    trees = [*([asked.tree] if asked.tree else []), ROOT]
    print("| cause | input |", " | ".join(["there", "here"][-len(trees) :]), "|")
    print("|---|---|" + "---|" * len(trees))
    wrong = 0
    for one in encounters():
        if one.cause not in asked.causes:
            continue
        found = []
        for tree in trees:
            with tempfile.TemporaryDirectory(prefix="causes-") as folder:
                found.append(encountered(one, tree.resolve(), Path(folder)))
        wrong += bool(found[-1])
        print(
            f"| {one.cause} | {one.name} | {' | '.join(f or 'held' for f in found)} |", flush=True
        )
    sys.exit(min(wrong, 1))


if __name__ == "__main__":
    main()
