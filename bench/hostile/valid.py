"""Hypothesis strategies for valid but extreme inputs of every command.

Numbers near their limits, tables of few trials or much noise, tracks with gaps, clips with little
light: each must give a number, or a message why there is none.
"""

import functools
import io
import re
from typing import Any

import numpy as np
from hypothesis import strategies as st

from bench.hostile.case import Case, Kind
from physics.effects import CATALOGUE, MEASUREMENT_IDS

__all__ = ["EFFECT", "VALID", "clip_of", "films"]

SETUP = """[camera]
capture_fps = 600
distance_to_wall = "4.00 m ± 0.01 m"
[wall]
grid = "50 mm"
ball_plane_offset = "0.45 m ± 0.01 m"
[ball]
mass = "0.353 kg ± 0.001 kg"
diameter = "201.75 mm ± 0.4 mm"
launch_angle = "8.5 deg ± 0.3 deg"
cor = "0.1305*exp(-0.2685*v - 0.1953) + 0.6746"
[pendulum]
length = "0.5541 m ± 0.001 m"
inertia = "1.579 kg m^2 ± 0.02 kg m^2"
mass = "6.0 kg ± 0.06 kg"
com = "0.4553 m ± 0.005 m"
effective_mass = "5.1667 kg ± 0.05 kg"
[support]
height = "0.3120 m ± 0.001 m"
[air]
temperature = "26 degC ± 1 K"
pressure = "1013.25 hPa ± 10 hPa"
humidity = 0.5
[scatter]
backswing = "0.2 deg"
cor = 0.005
[noise]
position = "1.7 mm"
[model.drag]
drag_coefficient = "0.47 ± 0.1"
"""
_VALUE_TEXT = re.compile(r"(= \"?)(\d+\.?\d*)")
_STD = re.compile(r" ± \d+\.?\d* ?[\w^ ]*")

numbers = st.floats(0.0, 1.0, allow_nan=False)


def _between(draw: st.DrawFn, low: float, high: float) -> float:
    return round(low + (high - low) * draw(numbers), 4)


def _times(factor: float, found: re.Match[str]) -> str:
    return f"{found[1]}{factor * float(found[2]):g}"


@st.composite
def _setups(draw: st.DrawFn) -> bytes:
    """A setup file of another laboratory: other numbers and uncertainties, fewer lines."""
    lines = []
    for line in SETUP.splitlines():
        if "=" in line and "cor =" not in line and draw(st.integers(0, 3)) == 0:
            factor = draw(st.sampled_from((0.3, 0.7, 0.9, 0.99, 1.01, 1.1, 1.5, 3.0)))
            line = _VALUE_TEXT.sub(functools.partial(_times, factor), line, count=1)
        match draw(st.integers(0, 11)):
            case 0 if "=" in line:
                continue
            case 1:
                line = _STD.sub("", line)
            case 2:
                line = _STD.sub(draw(st.sampled_from((" ± 30 %", " ± 0.01 %", " ± 100 %"))), line)
            case _:
                pass
        lines.append(line)
    return ("\n".join(lines) + "\n").encode()


def _speeds(draw: st.DrawFn) -> tuple[str, ...]:
    if draw(st.booleans()):
        return "--impact-speed", f"{_between(draw, 0.05, 8.0)} m/s"
    return "--backswing", f"{_between(draw, 0.5, 179.5)} deg"


@st.composite
def _models(draw: st.DrawFn) -> tuple[str, ...]:
    """A command of the forward model with plausible numbers."""
    ball = draw(st.sampled_from(((), ("--ball", "jokku"), ("--ball", "basketball"))))
    match draw(st.integers(0, 3)):
        case 0:
            return "plan", "--distance", f"{_between(draw, 0.02, 4.0)} m", *ball
        case 1:
            wanted = draw(st.sampled_from(("0.1", "0.02", "0.01", "0.005", "0.003", "0.0005")))
            return "plan", "campaign", "--target-cor-std", wanted, *ball
        case _:
            return "simulate", *_speeds(draw), *ball


@st.composite
def setup_cases(draw: st.DrawFn) -> Case:
    """A forward model with another setup file."""
    arguments = (*draw(_models()), "--setup", "lab.toml", "--json", "o.json")
    return Case(Kind.SETUP, arguments, {"lab.toml": draw(_setups())}, ("o.json",))


_ACTING = sorted(set(CATALOGUE) - MEASUREMENT_IDS)


@st.composite
def _effects(draw: st.DrawFn) -> str:
    """An effect of the catalogue on the motion, with parameters within their bounds."""
    effect = draw(st.sampled_from(CATALOGUE[draw(st.sampled_from(_ACTING))]))
    sizes = []
    for parameter in effect.parameters:
        low = max(parameter.lower, parameter.neutral - 4.0 * parameter.scale)
        high = min(parameter.upper, parameter.neutral + 4.0 * parameter.scale)
        sizes.append(f"{parameter.name}={low + (high - low) * draw(numbers):.6g}")
    return f"{effect.id}:{','.join(sizes)}"


@st.composite
def argument_cases(draw: st.DrawFn) -> Case:
    """A forward model with effects, laws and outputs."""
    arguments = [*draw(_models())]
    outputs = ["o.json"]
    if arguments[0] == "simulate":
        for given in draw(st.lists(_effects(), max_size=2)):
            arguments += ["--effect", given]
        if draw(st.booleans()):
            arguments += ["--drag", draw(st.sampled_from(("smooth", "variable", "0.3", "0.5")))]
    if "campaign" not in arguments:
        if draw(st.booleans()):
            a, b = _between(draw, 0.3, 0.95), _between(draw, 0.0, 0.12)
            arguments += ["--cor", draw(st.sampled_from((f"{a}", f"{a} - {b}*v", f"{a}*v**-{b}")))]
        if draw(st.booleans()):
            arguments += ["--csv", "o.csv"]
            outputs.append("o.csv")
        if draw(st.integers(0, 7)) == 0:
            arguments += ["--plot", "o.svg"]
            outputs.append("o.svg")
    arguments += ["--setup", "lab.toml", "--json", "o.json"]
    return Case(Kind.ARGUMENTS, tuple(arguments), {"lab.toml": SETUP.encode()}, tuple(outputs))


def _noise(draw: st.DrawFn) -> np.random.Generator:
    return np.random.default_rng(draw(st.integers(0, 10_000)))


def _listed(rows: list[dict[str, str]]) -> bytes:
    head = [*dict.fromkeys(key for row in rows for key in row)]
    lines = [",".join(head)] + [",".join(row.get(key, "") for key in head) for row in rows]
    return ("\n".join(lines) + "\n").encode()


@st.composite
def _strikes(draw: st.DrawFn) -> bytes:
    """A table of a few strikes: random columns, uncertainties, gaps and outliers."""
    rng = _noise(draw)
    count = draw(st.sampled_from((1, 2, 3, 4, 6, 9, 15)))
    lowest, highest = draw(st.sampled_from(((1.0, 4.0), (2.0, 2.1), (0.2, 0.6), (3.0, 7.0))))
    noise = draw(st.sampled_from((1e-4, 0.003, 0.02, 0.15)))
    extra = draw(st.sampled_from((1.0, 1.0, 1.1, 0.8, 2.0)))
    stated = draw(st.booleans())
    columns = draw(st.sets(st.sampled_from(("speed", "backswing", "after")), min_size=1))
    rows = []
    for trial, speed in enumerate(np.linspace(lowest, highest, count)):
        after = speed * (1.0 + 0.11 * np.exp(-0.27 * speed) + 0.67) * 5.1667 / 5.5197
        scale = 1.0 + noise * rng.standard_normal(3)
        row = {"trial": f"s{trial}"}
        shown = {
            "impact_speed_m_s": speed * scale[0] if "speed" in columns else None,
            "ball_speed_m_s": after * scale[1] if "after" in columns else None,
            "range_m": extra * after * 0.42 * scale[2],
        }
        for name, value in shown.items():
            if value is None or draw(st.integers(0, 24)) == 0:
                continue
            row[name] = f"{value:.5f}"
            if stated:
                row[f"{name}_std"] = f"{max(noise, 0.002) * value:.5f}"
        if "backswing" in columns:
            angle = 2.0 * np.arcsin(min(0.99, speed / 4.4))
            row["backswing_deg"] = f"{np.rad2deg(angle) + 0.2 * rng.standard_normal():.2f}"
        rows.append(row)
    if draw(st.integers(0, 3)) == 0:
        slip = draw(st.sampled_from(("range_m", "ball_speed_m_s", "impact_speed_m_s")))
        row = rows[draw(st.integers(0, count - 1))]
        if slip in row:
            row[slip] = f"{draw(st.sampled_from((0.5, 1.3, 10.0, 100.0))) * float(row[slip]):.4f}"
    return _listed(rows)


@st.composite
def _throws(draw: st.DrawFn) -> bytes:
    """Samples of thrown balls: few or many, with gaps, noise and too much drag."""
    rng = _noise(draw)
    count, long = draw(st.sampled_from((1, 2, 4, 8))), draw(st.sampled_from((3, 8, 20, 60)))
    noise = draw(st.sampled_from((1e-5, 0.002, 0.03)))
    rate, gravity = (
        draw(st.sampled_from((0.0, 0.05, 0.4))),
        draw(st.sampled_from((9.81, 9.81, 6.0))),
    )
    rows = []
    for trial in range(count):
        time = np.arange(long) * draw(st.sampled_from((1 / 30, 1 / 100, 1 / 600)))
        if draw(st.integers(0, 3)) == 0:
            time = np.delete(time, slice(long // 3, long // 2))
        shown = np.column_stack(
            [(2.0 + 0.2 * trial) * time * np.exp(-rate * time), 1.0 + time - gravity / 2 * time**2]
        )
        shown += noise * rng.standard_normal(shown.shape)
        rows += [
            {"trial": f"t{trial}", "t_s": f"{t:.5f}", "x_m": f"{x:.5f}", "y_m": f"{y:.5f}"}
            for t, (x, y) in zip(time, shown, strict=True)
        ]
    return _listed(rows)


@st.composite
def table_cases(draw: st.DrawFn) -> Case:
    """A table in a readable format with arbitrary contents."""
    data = draw(_throws() if draw(st.integers(0, 4)) == 0 else _strikes())
    arguments = ["explain", "b.csv", "--setup", "lab.toml", "--json", "o.json"]
    files = {"b.csv": data, "lab.toml": SETUP.encode()}
    return Case(Kind.TABLE, tuple(arguments), files, ("o.json",))


@st.composite
def track_cases(draw: st.DrawFn) -> Case:
    """Tracks of a thrown ball: few points, gaps, noise, scale unknown."""
    rng = _noise(draw)
    count = draw(st.sampled_from((2, 4, 8, 30, 120)))
    frame = np.arange(count) + draw(st.integers(0, 900))
    keep = rng.random(count) > draw(st.sampled_from((0.0, 0.0, 0.3, 0.8)))
    time = (frame - frame[0]) / 240.0
    px = np.column_stack([40.0 + 700.0 * time, 400.0 - 500.0 * time + 1962.0 * time**2])
    px += draw(st.sampled_from((0.01, 0.3, 3.0))) * rng.standard_normal(px.shape)
    if draw(st.integers(0, 4)) == 0:
        px[draw(st.integers(0, count - 1))] += 200.0
    name = draw(st.sampled_from(("frame,x_px,y_px", "t_s,x_px,y_px", "t_s,x_m,y_m")))
    first = frame if name.startswith("frame") else time
    shown = px * (0.0025 if name.endswith("m") else 1.0)
    rows = [f"{a:g},{x:.4f},{y:.4f}" for a, (x, y) in zip(first, shown, strict=True)]
    text = "\n".join([name, *[row for row, kept in zip(rows, keep, strict=True) if kept]]) + "\n"
    arguments = ["measure", "--from-tracks", "a.csv", "--json", "o.json", "--csv", "o.csv"]
    if draw(st.integers(0, 3)):
        arguments += ["--fps", "240"]
    if draw(st.integers(0, 3)):
        arguments += ["--scale", draw(st.sampled_from(("400 px/m", "400 px/m ± 4 px/m")))]
    if draw(st.booleans()):
        arguments += ["--ball", "jokku"]
    return Case(Kind.TRACKS, tuple(arguments), {"a.csv": text.encode()}, ("o.json", "o.csv"))


@st.composite
def law_cases(draw: st.DrawFn) -> Case:
    """Laws with valid covariances, some of which leave (0, 1] within their range."""
    root = np.array([[_between(draw, -0.05, 0.05) for _ in range(3)] for _ in range(3)])
    covariance = (root @ root.T + 1e-8 * np.eye(3)).tolist()
    a, b, d = _between(draw, 0.0, 0.5), _between(draw, 0.0, 2.0), _between(draw, 0.2, 0.9)
    chance = _between(draw, 0.05, 1.0)
    text = f"""[balls.jokku]
law = "exponential"
probability = {chance}
parameters = {{ a = {a}, b = {b}, d = {d} }}
covariance = {covariance}
speeds = [1.0, 4.0]
strike_scatter = {_between(draw, 0.0, 0.05)}
"""
    if chance < 1.0 and draw(st.booleans()):
        text += f"""[[balls.jokku.other_laws]]
law = "power"
probability = {round(1.0 - chance, 4)}
parameters = {{ a = {_between(draw, 0.05, 0.5)} }}
covariance = [[{_between(draw, 1e-4, 0.01)}]]
"""
    if draw(st.booleans()):
        command = ["plan", "--distance", f"{_between(draw, 0.3, 2.5)} m"]
    else:
        command = ["simulate", *_speeds(draw)]
    arguments = (*command, "--ball", "jokku", "--cor-law", "cor.toml", "--json", "o.json")
    return Case(Kind.LAWS, arguments, {"cor.toml": text.encode()}, ("o.json",))


_CLIP_FORMATS = {
    ".mp4": ("mp4", "libx264", "yuv420p"),
    ".avi": ("avi", "mjpeg", "yuvj420p"),
    ".mkv": ("matroska", "ffv1", "yuv420p"),
}
"""Container, codec and pixel format by suffix."""


@functools.cache
def clip_of(suffix: str, size: tuple[int, int], frames: int, of: int) -> bytes:
    """A clip of two discs, one of which may strike the other; a seed gives one clip."""
    import av

    rng = np.random.default_rng(of)
    width, height = size
    form, codec, pixels = _CLIP_FORMATS[suffix]
    ball, struck = rng.uniform(0.05, 0.2) * height, rng.integers(1, max(2, frames - 1))
    back, front, dark = rng.uniform(10, 240, 3)
    speed, gravity = rng.uniform(0.0, 0.05) * width, rng.uniform(0.0, 0.002) * height
    y, x = np.mgrid[:height, :width]
    buffer = io.BytesIO()
    with av.open(buffer, "w", format=form) as container:
        stream: Any = container.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        for number in range(frames):
            picture = rng.normal(back, rng.uniform(0, 4), (height, width, 3))
            after = max(0, number - struck)
            at = width * 0.5 + speed * after, height * 0.6 + gravity * after**2
            bob = width * 0.5 - 2 * ball + 0.5 * speed * min(0, number - struck), height * 0.6
            picture[np.hypot(x - at[0], y - at[1]) < ball] = front
            if of % 3:
                picture[np.hypot(x - bob[0], y - bob[1]) < ball] = dark
            frame = av.VideoFrame.from_ndarray(np.clip(picture, 0, 255).astype(np.uint8), "rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return buffer.getvalue()


@functools.cache
def films() -> tuple[bytes, ...]:
    """A few clips, prepared outside hypothesis."""
    sizes = ((64, 48), (96, 64), (160, 96), (240, 136))
    return tuple(
        clip_of(".mp4" if of % 2 else ".avi", sizes[of % 4], (5, 12, 30, 60)[of // 4 % 4], of)
        for of in range(24)
    )


@st.composite
def clip_cases(draw: st.DrawFn) -> Case:
    """A clip that may be partly damaged, with random options."""
    of = draw(st.integers(0, len(films()) - 1))
    data = bytearray(films()[of])
    if draw(st.integers(0, 2)) == 0:
        at = int(_between(draw, 0.3, 0.95) * len(data))
        data[at : at + 8] = draw(st.binary(min_size=8, max_size=8))
    name = f"a.{'mp4' if of % 2 else 'avi'}"
    arguments = ["measure", name, "--json", "o.json", "--csv", "o.csv", "--no-cache"]
    if draw(st.integers(0, 3)):
        arguments += ["--fps", draw(st.sampled_from(("30", "240", "600", "600 ± 1")))]
    if draw(st.booleans()):
        arguments += ["--ball", "jokku"]
    if draw(st.integers(0, 2)) == 0:
        arguments += ["--scale", "300 px/m"]
    if draw(st.integers(0, 3)) == 0:
        arguments += ["--ball-at", f"{draw(st.integers(10, 60))},{draw(st.integers(10, 50))}"]
    return Case(Kind.CLIP, tuple(arguments), {name: bytes(data)}, ("o.json", "o.csv"))


@st.composite
def lab_book_cases(draw: st.DrawFn) -> Case:
    """A valid lab book and clips that may not show a strike."""
    count = draw(st.integers(1, 2))
    rows = [
        {
            "clip": f"c{k}",
            "ball": draw(st.sampled_from(("jokku", "basketball"))),
            "backswing_deg": f"{_between(draw, 5.0, 120.0)}",
            "session": draw(st.sampled_from(("a", "b", "1.0", ""))),
            "landing_tape_m": f"{_between(draw, 0.2, 2.5)}",
            "remark": draw(st.sampled_from(("", "wet", "=1+1", "ü"))),
        }
        for k in range(count)
    ]
    contents = st.sampled_from((b"", b"no clip", *films()[:4]))
    files = {f"clips/c{k}.avi": draw(contents) for k in range(count)}
    arguments = (
        "campaign",
        "clips",
        "--trials",
        "trials.csv",
        "--out",
        "out",
        "--quiet",
        "-j",
        "1",
    )
    return Case(Kind.LAB_BOOK, arguments, {"trials.csv": _listed(rows), **files}, ("out",))


EFFECT = """from physics.effects import Effect, Parameter
import numpy as np


class Own(Effect):
    def force(self, values, flight):
        nothing = np.zeros_like(np.asarray(flight.vx))
        return {force}


EFFECTS = [
    Own(
        id="{id}", statement="An assumed force.", law=r"F = {law}", source="this lab",
        phase="flight",
        parameters=(Parameter("size", "{unit}", {prior}, {low}, {high}),),
    )
]
"""


@st.composite
def effect_cases(draw: st.DrawFn) -> Case:
    """A file with a user's force: any size, one or three components, steep or flat."""
    force = draw(
        st.sampled_from(
            (
                'values["size"] * flight.vx, nothing, nothing',
                '-values["size"] * flight.x, nothing, nothing',
                'nothing, values["size"] * np.abs(flight.vx) ** 3, nothing',
                'values["size"] / flight.x, nothing, nothing',
                'nothing, values["size"] * np.sin(50.0 * flight.y), nothing',
                '-values["size"] * np.sqrt(flight.y), nothing, nothing',
                'values["size"] * np.exp(flight.vx), nothing, nothing',
                'values["size"], 0.0, 0.0',
                'values["sise"] * flight.vx, nothing, nothing',
            )
        )
    )
    text = EFFECT.format(
        force=force,
        id=draw(st.sampled_from(("own", "own_force", "magnus", "Own Force", "x" * 60))),
        law=draw(st.sampled_from(("k v", r"-k x", "", "\\frac{1}{"))),
        unit=draw(st.sampled_from(("N/m", "N", "1", "parsec", "kg/s"))),
        prior=draw(st.sampled_from(("0.1", "1e-6", "1e6", "-1.0", "0.0"))),
        low=draw(st.sampled_from(("0.0", "-10.0", "5.0"))),
        high=draw(st.sampled_from(("100.0", "0.0", "1e300"))),
    )
    return Case(Kind.EFFECTS, ("effects", "check", "mine.py"), {"mine.py": text.encode()})


VALID = {
    Kind.SETUP: setup_cases,
    Kind.ARGUMENTS: argument_cases,
    Kind.LAWS: law_cases,
    Kind.LAB_BOOK: lab_book_cases,
    Kind.TRACKS: track_cases,
    Kind.TABLE: table_cases,
    Kind.CLIP: clip_cases,
    Kind.EFFECTS: effect_cases,
}
"""Strategy of each kind."""
