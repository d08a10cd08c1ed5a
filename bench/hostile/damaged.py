"""Hypothesis strategies for damaged inputs of every command."""

import functools
import json
import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from bench.hostile.case import Case, Kind, named
from bench.hostile.places import PLACE_CASES
from bench.hostile.valid import EFFECT, VALID, clip_of, films

__all__ = [
    "LAWS",
    "SETUP",
    "STRATEGIES",
    "bytes_changed",
    "drawn",
    "null_table",
    "sound_tracks",
    "table_text",
]

SETUP = """[camera]
capture_fps = 600
distance_to_wall = "4.00 m"
[wall]
grid = "50 mm"
fine_grid = "10 mm"
ball_plane_offset = "0.45 m"
[ball]
preset = "jokku"
mass = "0.353 kg"
diameter = "201.75 mm"
launch_angle = "8.5 deg"
[pendulum]
length = "0.5541 m"
inertia = "1.579 kg m^2"
mass = "6.0 kg"
com = "0.4553 m"
effective_mass = "5.1667 kg"
[support]
height = "0.3120 m"
[air]
temperature = "26 degC"
pressure = "1013.25 hPa"
humidity = 0.5
[balls.red]
mass = "0.3 kg"
diameter = "0.2 m"
launch_angle = "9 deg"
cor = "0.1305*exp(-0.2685*v - 0.1953) + 0.6746"
[scatter]
backswing = "0.2 deg"
cor = 0.005
[noise]
position = "1.7 mm"
[model]
effects = ["gravity", "drag"]
[model.drag]
drag_coefficient = 0.47
"""

ODD_WORDS = (
    "nan", "inf", "-inf", "-4 m", "1e300", "1e-300", "1e400", "0", "-0", "-1", "50", "abc", "",
    " ", "±", "1 m ± -1 m", "1 m ± nan", "0.5 parsec", "9" * 400, "1/0 s", "(-1)**0.5", "1e5 kg",
    "v", "exp(exp(exp(v)))", "1/(v-2)", "0x10", "1,5", "１２", "\x1b[31m", "=1+1", "../../x",
    "\x00",
    "True", "600 fps ± 600 fps", "5 mm", "90 deg", "a" * 5000, "١٢", "1_000", "--", "None", "{}",
)  # fmt: skip
"""Text in place of a number or a name."""
LITERALS = (
    "nan", "inf", "-inf", "true", "[]", "{}", "[[1, 2], [3]]", "-1", "0", "1e300", "1e-300", "50",
    "9" * 400, "1979-05-27", "''", '["a", 1]', "0.0", "1e999", '"""x\n"""',
)  # fmt: skip

words = st.one_of(st.sampled_from(ODD_WORDS), st.text(max_size=12))


def bytes_changed(data: bytes, draw: st.DrawFn) -> bytes:
    """The bytes with one to four changes."""
    raw = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(raw) - 1)))
        match draw(st.sampled_from(("set", "cut", "insert", "double", "drop"))):
            case "set" if raw:
                raw[at] = draw(st.integers(0, 255))
            case "cut":
                del raw[at:]
            case "insert":
                raw[at:at] = draw(st.binary(max_size=16))
            case "double":
                raw[at:at] = raw[at : at + draw(st.integers(1, 200))]
            case _:
                del raw[at : at + draw(st.integers(1, 50))]
    return bytes(raw)


def _encoded(text: str, draw: st.DrawFn) -> bytes:
    encodings = ("utf-8",) * 5 + ("utf-8-sig", "utf-16", "latin-1", "utf-16-le")
    return text.encode(draw(st.sampled_from(encodings)), errors="replace")


_NUMBER_TEXT = re.compile(r"\d+\.?\d*(?:e-?\d+)?")


def _with_another_number(line: str, draw: st.DrawFn) -> str:
    """The line with its number multiplied, perhaps with another uncertainty."""
    found = _NUMBER_TEXT.search(line)
    if found is None:
        return line
    factor = draw(st.sampled_from((0.0, 1e-6, 1e-3, 0.1, 0.5, 2.0, 10.0, 1e3, 1e6, -1.0)))
    std = draw(st.sampled_from(("", "", " ± 1e-9", " ± 100", " +- 0", " ± 5 %")))
    number = f"{factor * float(found.group()):g}"
    if std and '"' in line:
        return line[: found.start()] + number + line[found.end() :].rstrip('"') + std + '"'
    return line[: found.start()] + number + line[found.end() :]


@st.composite
def setups(draw: st.DrawFn) -> bytes:
    """A setup file with one to three errors, or with changed bytes."""
    if draw(st.integers(0, 4)) == 0:
        return bytes_changed(SETUP.encode(), draw)
    lines = SETUP.splitlines()
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 3)))):
        at = draw(st.integers(0, len(lines) - 1))
        key = lines[at].split("=")[0].strip()
        value = draw(st.sampled_from(LITERALS) | words.map(lambda w: json.dumps(w)))
        kinds = ("value",) * 4 + ("scale",) * 6 + ("key", "drop", "twice", "table", "many")
        match draw(st.sampled_from(kinds)):
            case "scale":
                lines[at] = _with_another_number(lines[at], draw)
            case "value" if "=" in lines[at]:
                lines[at] = f"{key} = {value}"
            case "key":
                lines[at] = f"{draw(st.sampled_from(ODD_WORDS[:12]))} = {value}"
            case "drop":
                lines[at] = ""
            case "twice":
                lines.insert(at, lines[at])
            case "table":
                lines.insert(at, f"[{draw(st.sampled_from(('ball', 'x', 'a.b.c', '[wall]', '')))}]")
            case "many":
                lines += [f"key{i} = {i}" for i in range(draw(st.sampled_from((10, 5000))))]
            case _:
                pass
    return _encoded("\n".join(lines) + "\n", draw)


MODEL = (
    ("simulate", "--impact-speed", "2.5 m/s"),
    ("simulate", "--backswing", "60 deg", "--ball", "red"),
    ("plan", "--distance", "1.5m"),
    ("plan", "--distance", "1.2m", "--ball", "red"),
    ("plan", "campaign", "--target-cor-std", "0.01"),
)
"""Fast commands that read a setup file."""


@st.composite
def setup_cases(draw: st.DrawFn) -> Case:
    command = draw(st.sampled_from(MODEL))
    arguments = (*command, "--setup", "lab.toml", "--json", "o.json")
    return Case(Kind.SETUP, arguments, {"lab.toml": draw(setups())}, ("o.json",))


OPTIONS_OF = {
    "simulate": (
        "--backswing", "--impact-speed", "--cor", "--ball", "--effect", "--drag", "--setup",
        "--cor-law", "--csv", "--plot",
    ),
    "plan": ("--distance", "--cor", "--ball", "--drag", "--setup", "--csv", "--plot"),
    "plan campaign": ("--target-cor-std", "--ball", "--setup", "--pilot"),
    "render": ("--size", "--fps", "--shutter", "--backswing", "--noise", "--codec", "--effect"),
    "measure": ("--fps", "--ball", "--wall-grid", "--ball-at", "--scale", "--setup", "--out"),
    "explain": ("--setup", "--hold-out", "--columns", "--cor-law", "--effects", "--pendulum"),
    "convert": ("--columns",),
    "campaign": ("--out", "--trials", "--setup", "--ball", "--timeout", "--only"),
    "calibrate wall": ("--wall-grid", "--camera-distance", "--lens"),
    "paper": (),
    "campaign status": (),
    "campaign mark": ("--bad",),
    "effects check": (),
    "nothing": (),
}  # fmt: skip
ODD_PATHS = (
    "lab.toml", "b.csv", "nothing.csv", ".", "/dev/null", "/nowhere/x", "x" * 300, "a\nb.csv",
    "-", "jokku", "magnus:spin=nan", "magnus:spin=1e300", "magnus:", ":=", "drag", "smooth",
    "o.json", "lab.toml/x", "1e300 m/s", "nan deg", "300 deg", "0 m", "1e9 m", "3.2", "64x48",
    "99999x99999", "0x0", "-3x5", "10,10", "nan,nan", "1,2,3,4", "b.csv ", "", "é.csv",
)  # fmt: skip


ODD_NUMBERS = (
    "0", "1e-9", "0.001", "0.05", "1", "10", "99", "1000", "1e6", "-1", "2.5 m", "3 km/h", "5 deg",
    "1 rad", "179.9 deg", "180 deg", "1 m/s ± 1 m/s", "0.0001 m/s", "smooth", "variable",
    "0.99 - 0.3*v", "drag:drag_coefficient=1e6", "magnus:spin=-1e6", "magnus:spin=0.001",
    "wind:speed=1000", "viscous_damping:rate=1e9", "tilt:angle=90", "basketball", "1 mm", "30 m",
)  # fmt: skip


@st.composite
def nearly_right_cases(draw: st.DrawFn) -> Case:
    """A valid command with one or two extreme values."""
    command = list(draw(st.sampled_from(MODEL)))
    name = "plan" if command[0] == "plan" else "simulate"
    options = ["--cor", "--drag", "--ball"] + (["--effect"] if name == "simulate" else [])
    if "campaign" in command:
        options = ["--target-cor-std", "--ball"]
    given_values = dict(zip(command[1::2], command[2::2], strict=False))
    if "campaign" in command:
        given_values = {"--target-cor-std": "0.01"}
    for _ in range(draw(st.integers(1, 2))):
        given_values[draw(st.sampled_from([*given_values, *options]))] = draw(
            st.sampled_from(ODD_NUMBERS)
        )
    head = ["plan", "campaign"] if "campaign" in command else [name]
    pairs = [part for pair in given_values.items() for part in pair]
    files = {"lab.toml": SETUP.encode()}
    arguments = (*head, *pairs, "--setup", "lab.toml", "--json", "o.json")
    return Case(Kind.ARGUMENTS, arguments, files, ("o.json",))


@st.composite
def argument_cases(draw: st.DrawFn) -> Case:
    """A command with random options and values, mostly invalid."""
    if draw(st.booleans()):
        return draw(nearly_right_cases())
    command = draw(st.sampled_from([*OPTIONS_OF]))
    values = st.sampled_from(ODD_PATHS) | words.filter(lambda word: "\x00" not in word)
    given_values = [
        part
        for option in draw(st.lists(st.sampled_from(OPTIONS_OF[command] or ("--x",)), max_size=3))
        for part in (option, draw(values))
    ]
    arguments = [*command.split(), *given_values, *draw(st.lists(values, max_size=2))]
    if command == "render":
        arguments += ["--frames", "2", "-o", draw(st.sampled_from(("o.mp4", "o.txt", "/x/o.mp4")))]
    if draw(st.booleans()):
        arguments += ["--json", draw(st.sampled_from(("o.json", "lab.toml", "b.csv", "-")))]
    files = {"lab.toml": SETUP.encode(), "b.csv": table_text().encode()}
    # a random word may name an output; the two input files must not change
    at = arguments.index("--json") + 1 if "--json" in arguments else len(arguments)
    outputs = tuple(part for part in arguments if part not in files and "/" not in part and part)
    outputs += tuple(arguments[at : at + 1])
    return Case(Kind.ARGUMENTS, tuple(arguments), files, (*outputs, "vision-demo", "o.truth.json"))


@functools.cache
def table_text() -> str:
    """A table of trials with ranges 12 % longer than simulated."""
    from pipelines.api.modelled import simulate

    rng = np.random.default_rng(5)
    rows = [
        "trial,impact_speed_m_s,impact_speed_m_s_std,ball_speed_m_s,ball_speed_m_s_std,"
        "range_m,range_m_std"
    ]
    for trial in range(12):
        speed = 1.5 + 0.2 * trial
        found = simulate(impact_speed=speed, ball="jokku").to_dict()["quantities"]
        reach = 1.12 * found["landing_distance"]["value"] + 0.004 * rng.standard_normal()
        after = found["ball_speed"]["value"] + 0.004 * rng.standard_normal()
        rows.append(f"s{trial},{speed:.4f},0.004,{after:.4f},0.004,{reach:.4f},0.004")
    return "\n".join(rows) + "\n"


@functools.cache
def sound_table() -> tuple[str, tuple[str, ...]]:
    """The table of trials and the effects that `explain` names."""
    from pipelines.api.explained import explain

    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "b.csv").write_text(table_text())
        (Path(folder) / "lab.toml").write_text(SETUP)
        verdict = explain(trials=Path(folder) / "b.csv", setup=Path(folder) / "lab.toml")
    return table_text(), named(verdict.to_dict())


CELLS = (
    "", "abc", "nan", "inf", "-inf", "1,5", "1e300", "-1", "0", "1e-300", "12 m", "#DIV/0!", "—",
    "1.2.3", "NULL", "1e400", "'1.5", "１.５", " 1.5 ", "True", "2026-03-01", "=1+1", "\x1b[2J",
)  # fmt: skip


@st.composite
def table_cases(draw: st.DrawFn) -> Case:
    """A table with the damage that spreadsheets and typing errors cause."""
    text, sound = sound_table()
    rows = [line.split(",") for line in text.splitlines()]
    mark, raw, same = ",", None, True
    for _ in range(draw(st.sampled_from((1, 1, 1, 2, 3)))):
        row, column = draw(st.integers(1, len(rows) - 1)), draw(st.integers(0, len(rows[0]) - 1))
        kinds = ("cell",) * 6 + ("column", "head", "drop", "double", "shuffle", "mark", "comma",
                 "scale", "bytes", "ragged", "constant")  # fmt: skip
        kind = draw(st.sampled_from(kinds))
        same = same and kind in ("cell", "shuffle", "mark", "comma")
        match kind:
            case "cell" if column < len(rows[row]):
                rows[row][column] = draw(st.sampled_from(CELLS))
                same = same and not _is_number(rows[row][column])
            case "column":
                cell = draw(st.sampled_from(CELLS))
                rows = [rows[0], *[[*r[:column], cell, *r[column + 1 :]] for r in rows[1:]]]
            case "head":
                rows[0][column % len(rows[0])] = draw(
                    st.sampled_from(("range_mm", "range_m", "x", "", "Range (cm)", "trial"))
                )
            case "drop" if len(rows) > 2:
                del rows[row]
            case "double":
                rows.insert(row, list(rows[row]))
            case "shuffle":
                rows[1:] = draw(st.permutations(rows[1:]))
            case "mark":
                mark = draw(st.sampled_from((";", "\t", "|", " ")))
            case "comma":
                rows = [rows[0], *[[cell.replace(".", ",") for cell in r] for r in rows[1:]]]
            case "scale":
                rows = [rows[0], *[_scaled(r, column, draw(st.sampled_from((1e3, 1e12, -1.0))))
                                   for r in rows[1:]]]  # fmt: skip
            case "ragged":
                rows[row] = rows[row][:column]
            case "constant":
                rows = [rows[0], *[[*r[:column], *rows[1][column : column + 1], *r[column + 1 :]]
                                   for r in rows[1:]]]  # fmt: skip
            case "bytes":
                raw = bytes_changed(text.encode(), draw)
            case _:
                pass
    data = raw or _encoded("\n".join(mark.join(row) for row in rows) + "\n", draw)
    arguments = ("explain", "b.csv", "--setup", "lab.toml", "--json", "o.json")
    files = {"b.csv": data, "lab.toml": SETUP.encode()}
    # other numbers, headers or scales make another recording; ignored cells must be reported
    return Case(Kind.TABLE, arguments, files, ("o.json",), sound if same else None)


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", ".").strip("' "))
    except ValueError:
        return False
    return True


def _scaled(row: list[str], column: int, factor: float) -> list[str]:
    try:
        return [*row[:column], repr(factor * float(row[column])), *row[column + 1 :]]
    except (ValueError, IndexError):
        return row


@functools.cache
def sound_tracks() -> dict[str, bytes]:
    """One track in the format of each program."""
    from pipelines.interop.external import ExternalTrack, ExternalTracks, PlaneOfMotion, Program
    from pipelines.interop.measured import write_tracks

    frame = np.arange(60)
    # 9.81 m/s² at 400 px/m and 240 frames a second
    px = np.column_stack([20.0 + 4.0 * frame, 200.0 - 3.0 * frame + 0.0341 * frame**2])
    plane = PlaneOfMotion(400.0, 0.01, np.array([10.0, 200.0]), 0.0)
    tracks = ExternalTracks(Path("a"), Program.IMPACT_VISION, (ExternalTrack("ball", frame, px),),
                            (320, 240), 240.0, plane, "a.mp4")  # fmt: skip
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".trk", ".kva", ".csv", ".xlsx"):
            path = Path(folder) / f"a{suffix}"
            write_tracks(path, tracks)
            found[path.name] = path.read_bytes()
    text = "#Kinovea Trajectory data export\n#T X Y\n\n# a\n"
    found["k.txt"] = (text + "".join(f"0.{i:03d} {i},50 -{i},25\n" for i in range(20))).encode()
    return found


@st.composite
def track_cases(draw: st.DrawFn) -> Case:
    """A track file with changed bytes or numbers."""
    name = draw(st.sampled_from([*sound_tracks()]))
    data = sound_tracks()[name]
    if draw(st.booleans()) and not name.endswith("xlsx"):
        parts = data.decode().split("0")
        at = draw(st.integers(1, max(1, len(parts) - 1)))
        joined = "0".join(parts[:at]) + draw(st.sampled_from(CELLS)) + "0".join(parts[at:])
        data = joined.encode()
    else:
        data = bytes_changed(data, draw)
    out = draw(st.sampled_from(("o.csv", "o.trk", "o.kva", "o.xlsx", "o.json")))
    return Case(Kind.TRACKS, ("convert", name, out), {name: data}, (out,))


LAWS = """[balls.jokku]
law = "power"
probability = 0.7
parameters = { a = 0.2 }
covariance = [[1e-4]]
speeds = [1.0, 4.0]
strike_scatter = 0.005
[[balls.jokku.other_laws]]
law = "exponential"
probability = 0.3
parameters = { a = 0.1, b = 0.27, d = 0.67 }
covariance = [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]]
"""


@st.composite
def law_cases(draw: st.DrawFn) -> Case:
    """An edited cor.toml, or a law on the command line."""
    if draw(st.integers(0, 2)) == 0:
        parts = (*"v0123456789.+-*/(),", "exp", "log", "**", "sqrt", "min", "e", " ", "1e9")
        law = draw(st.lists(st.sampled_from(parts), max_size=14).map("".join))
        arguments = ("simulate", "--impact-speed", "2.5", "--cor", law, "--json", "o.json")
        return Case(Kind.LAWS, arguments, {}, ("o.json",))
    parts = LAWS.replace("= ", "=|").split("|")
    if draw(st.booleans()):
        at = draw(st.integers(1, len(parts) - 1))
        rest = parts[at].split("\n", 1)[-1]
        parts[at] = draw(st.sampled_from(LITERALS)) + "\n" + rest
        data = " ".join(parts).encode()
    else:
        data = bytes_changed(LAWS.encode(), draw)
    command = draw(
        st.sampled_from((("simulate", "--impact-speed", "2.5"), ("plan", "--distance", "1.5m")))
    )
    arguments = (*command, "--ball", "jokku", "--cor-law", "cor.toml", "--json", "o.json")
    return Case(Kind.LAWS, arguments, {"cor.toml": data}, ("o.json",))


BOOK = "clip,ball,backswing_deg,session,contact_time_fsr_s,landing_tape_m,landing_tape_m_std\n" + (
    "".join(f"c{i},jokku,{30 + 10 * i},a,0.015,{1 + 0.2 * i:.2f},0.01\n" for i in range(4))
)


@st.composite
def lab_book_cases(draw: st.DrawFn) -> Case:
    """A lab book with errors, and empty clips, so that nothing is measured."""
    rows = [line.split(",") for line in BOOK.splitlines()]
    for _ in range(draw(st.integers(1, 3))):
        row, column = draw(st.integers(0, len(rows) - 1)), draw(st.integers(0, 6))
        rows[row][column] = draw(st.sampled_from((*CELLS, "clip", "c1", "c1.mp4", "../c2")))
    mark = draw(st.sampled_from((",", ",", ";", "\t")))
    data = _encoded("\n".join(mark.join(row) for row in rows), draw)
    if draw(st.integers(0, 3)) == 0:
        data = bytes_changed(data, draw)
    # two clips of one name are rejected before any is opened
    files = {"trials.csv": data, "clips/c0.mp4": b"", "clips/c0.mov": b""}
    arguments = ("campaign", "clips", "--trials", "trials.csv", "--out", "out", "--quiet")
    return Case(Kind.LAB_BOOK, arguments, files, ("out",))


MADE_CLIPS = (
    ("a.mp4", (96, 64), 40),
    ("long.mp4", (160, 96), 90),
    ("b.avi", (96, 64), 24),
    ("c.mkv", (64, 48), 16),
    ("one.mp4", (96, 64), 1),
    ("tiny.mkv", (8, 8), 20),
    ("flat.mkv", (2000, 2), 8),
)
"""File name, size in px and number of frames."""


@st.composite
def clip_cases(draw: st.DrawFn) -> Case:
    """A small clip, unchanged, with changed bytes, or with another file name."""
    name, size, frames = draw(st.sampled_from(MADE_CLIPS))
    data = clip_of(Path(name).suffix, size, frames, frames)
    how = draw(st.integers(0, 5))
    if how > 1:
        data = bytes_changed(data, draw)
    if how == 1:
        name = draw(st.sampled_from(("x.mov", "x.gif", "x.png", "x.txt", "x", "=1+1.mp4")))
    command = draw(st.sampled_from(("measure", "measure", "contact-time", "landing", "cor")))
    arguments = [command, name, "--fps", "600", "--json", "o.json", "--csv", "o.csv", "--no-cache"]
    if draw(st.booleans()):
        arguments += ["--ball", "jokku"]
    if command == "landing":
        arguments += ["--wall-grid", "50mm"]
    if draw(st.integers(0, 2)) == 0:
        arguments += ["--ball-at", draw(st.sampled_from(("40,40", "-5,3", "1e9,1e9", "40,40,900")))]
    if command != "measure":
        arguments.remove("--no-cache")
    return Case(Kind.CLIP, tuple(arguments), {name: data}, ("o.json", "o.csv"))


EXAMPLE = {
    "force": 'values["size"] * flight.vx, nothing, nothing',
    "id": "own", "law": "k v", "unit": "kg/s", "prior": "0.1", "low": "0.0", "high": "100.0",
}  # fmt: skip
"""A sound effect, for `EFFECT`."""
SPOILS = (
    "EFFECTS = 3", "EFFECTS = []", "EFFECTS = None", "import sys; sys.exit(0)", "raise SystemExit",
    "while True: pass", "x = bytearray(3 << 30)", "import os; os._exit(0)", "import nothing_such",
    "def (", "EFFECTS = [object()]", "EFFECTS = EFFECTS * 2", "print('a' * 100000)",
    "import os; os.kill(os.getpid(), 9)", "raise KeyboardInterrupt", "def f(): f()\nf()",
    "import time; time.sleep(1000)", "EFFECTS = (x for x in iter(int, 1))", "\x00", "﻿EFFECTS = 1",
    "import threading; threading.Thread(target=lambda: [None for _ in iter(int, 1)]).start()",
    "1/0",
)  # fmt: skip


@st.composite
def effect_cases(draw: st.DrawFn) -> Case:
    """A file of effects with harmful code or changed bytes."""
    text = EFFECT.format(**EXAMPLE)
    if draw(st.booleans()):
        text += "\n" + draw(st.sampled_from(SPOILS)) + "\n"
        data = text.encode()
    else:
        data = bytes_changed(text.encode(), draw)
    return Case(Kind.EFFECTS, ("effects", "check", "mine.py"), {"mine.py": data})


def null_table(column: str, seed: int) -> str:
    """The table of trials with one column permuted among the trials: no effect is present."""
    rows = [line.split(",") for line in table_text().splitlines()]
    at = rows[0].index(column)
    values = np.random.default_rng(seed).permutation([float(row[at]) for row in rows[1:]])
    for row, value in zip(rows[1:], values, strict=True):
        row[at] = f"{value:.4f}"
    return "\n".join(",".join(row) for row in rows) + "\n"


STRATEGIES: dict[Kind, tuple[Callable[[], st.SearchStrategy[Case]], int]] = {
    Kind.SETUP: (setup_cases, 30),
    Kind.ARGUMENTS: (argument_cases, 30),
    Kind.LAWS: (law_cases, 20),
    Kind.LAB_BOOK: (lab_book_cases, 8),
    Kind.TRACKS: (track_cases, 20),
    Kind.TABLE: (table_cases, 8),
    Kind.CLIP: (clip_cases, 8),
    Kind.EFFECTS: (effect_cases, 4),
    **PLACE_CASES,
}
"""Strategy of each kind and number of cases in a round: fast ones more often."""


_PREPARED: dict[Kind, Callable[[], object]] = {
    Kind.TABLE: sound_table,
    Kind.TRACKS: sound_tracks,
    Kind.CLIP: films,
    Kind.LAB_BOOK: films,
    Kind.NAMES: sound_tracks,
    Kind.PLACES: sound_tracks,
}


@st.composite
def _either(draw: st.DrawFn, kind: Kind) -> Case:
    """A damaged or a valid input."""
    valid = kind in VALID and draw(st.booleans())
    return draw(VALID[kind]() if valid else STRATEGIES[kind][0]())


def drawn(kind: Kind, number: int, of: int) -> list[Case]:
    """`number` cases of a kind; a seed always gives the same cases."""
    found: list[Case] = []
    # prepared outside hypothesis, which forbids libraries to use the module `random` inside
    _PREPARED.get(kind, table_text)()

    @seed(of)
    @settings(
        max_examples=number,
        database=None,
        deadline=None,
        phases=(Phase.generate,),
        suppress_health_check=[*HealthCheck],
    )
    @given(_either(kind))
    def collect(case: Case) -> None:
        found.append(case)

    collect()
    return found
