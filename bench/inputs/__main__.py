"""Measure inputs as people hand them in, and print what comes out of each.

``python -m bench.inputs [NAME…] [--json FILE]`` runs ``../shared/inputs`` and clips made from its
strike. With --json the outcomes are stored, for the docs; inputs that are not run keep theirs. An
outcome is *right* if every compared quantity is within three standard uncertainties of the truth,
*explained* if the refusal or a warning names the cure, *wrong*, *misdiagnosed*, or a *crash*.
"""

import argparse
import json
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from bench.inputs.written import REFUSED_TABLES, TABLES, Strike, strike_text
from measuring.chain import measure_clip
from measuring.measurement import ClipMeasurement
from metrology import ImpactVisionError, write_text_whole
from pipelines.api.quantities import measure_options
from pipelines.explain.tabular import read_sheet
from pipelines.interop.measured import measure_from_tracks
from pipelines.interop.tables import parse_columns
from vision.clip.clip import ClipReader

__all__ = ["CASES", "Case", "verdict_of", "written"]

Gray = NDArray[np.uint8]

SHARED = Path(os.environ.get("IMPACT_VISION_SHARED", "../shared"))
"""Folder of recordings."""

INPUT_QUANTITIES = (
    "ball_speed",
    "launch_angle",
    "contact_time",
    "pendulum_speed_before",
    "cor_speeds",
    "landing_distance",
)
"""Quantities compared with the truth."""

MAX_SIGMAS = 3.0
"""Deviation from the truth that counts as right, standard uncertainties (convention)."""


@dataclass(frozen=True)
class Case:
    """One input.

    Attributes
    ----------
    run : callable
        Takes a folder for files that are made; returns a measurement, or raises.
    cure : str
        Words of the message that states the cure, where the input can't come out right.
    """

    name: str
    run: Callable[[Path], ClipMeasurement | None]
    cure: str = ""


def verdict_of(case: Case, folder: Path, truth: dict[str, dict[str, float]]) -> tuple[str, str]:
    """Verdict and its details."""
    try:
        found = case.run(folder)
    except ImpactVisionError as problem:
        text = " ".join(str(problem).split())
        return ("explained" if case.cure and case.cure in text else "misdiagnosed"), text[:160]
    except Exception as problem:  # a crash is one of the verdicts
        return "crash", f"{type(problem).__name__}: {problem}"[:160]
    if found is None:
        return "wrong", "read without a word"
    known = [found.quantity(name) for name in INPUT_QUANTITIES if found.quantity(name).known]
    if not known:
        reasons = dict.fromkeys(one.reason or "" for one in found.quantities)
        text = " ".join([*found.warnings, *reasons])
        return ("explained" if case.cure and case.cure in text else "misdiagnosed"), text[:160]
    sigmas = {
        one.name: ((one.value or 0.0) - truth[one.name]["value"]) / (one.std or 1.0)
        for one in known
    }
    off = {name: z for name, z in sigmas.items() if abs(z) > MAX_SIGMAS}
    stated = case.cure and case.cure in " ".join(found.warnings)
    details = ", ".join(f"{name} {z:+.1f}" for name, z in (off or sigmas).items())
    if off:
        return ("explained" if stated else "wrong"), details
    return "right", f"{len(known)} quantities, largest |z| {max(map(abs, sigmas.values())):.1f}"


def _inputs() -> Path:
    return SHARED / "inputs"


def _table(name: str, columns: str = "", **options: str) -> Callable[[Path], ClipMeasurement]:
    def run(_: Path) -> ClipMeasurement:
        stated = measure_options(ball="jokku", **options)  # type: ignore[arg-type]
        return measure_from_tracks(_inputs() / name, stated, columns=parse_columns(columns))

    return run


def _clip(
    make: Callable[[list[Gray], Path], Path], **options: str
) -> Callable[[Path], ClipMeasurement]:
    def run(folder: Path) -> ClipMeasurement:
        pictures = [
            np.asarray(frame.gray, np.uint8)
            for frame in ClipReader.open(_inputs() / "base_strike.mkv").frames()
        ]
        stated = measure_options(_inputs() / "lab.toml", **options)  # type: ignore[arg-type]
        return measure_clip(make(pictures, folder), replace(stated, cache=False))

    return run


def written(
    pictures: Sequence[Gray], path: Path, stamps: Sequence[int] | None = None, rate: int = 30
) -> Path:
    """A clip of gray pictures."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": "12"})
        stream.height, stream.width = pictures[0].shape
        stream.pix_fmt = "yuv420p"
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="gray")
            frame.pts = number if stamps is None else stamps[number]
            frame.time_base = Fraction(1, rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _images(pictures: Sequence[Gray], folder: Path, numbers: Sequence[int]) -> Path:
    place = folder / "images"
    place.mkdir()
    for number in numbers:
        cv2.imwrite(str(place / f"img{number:05d}.png"), pictures[number])
    return place


def _without(pictures: Sequence[Gray], holes: Sequence[tuple[int, int]]) -> list[int]:
    return [
        number
        for number in range(len(pictures))
        if not any(first <= number <= last for first, last in holes)
    ]


def _lost(count: int) -> Callable[[list[Gray], Path], Path]:
    """A clip without `count` pictures in flight, and without a trace in its stamps."""

    def make(pictures: list[Gray], folder: Path) -> Path:
        kept = _without(pictures, [(150, 149 + count)])
        return written([pictures[number] for number in kept], folder / "lost.mkv")

    return make


def _webp(pictures: list[Gray], folder: Path) -> Path:
    from PIL import Image

    frames = [Image.fromarray(picture) for picture in pictures]
    path = folder / "animated.webp"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=33, quality=90)
    return path


def _raw(pictures: list[Gray], folder: Path) -> Path:
    """Pictures behind a mosaic of filters of different transmission."""
    gains = np.ones((*pictures[0].shape,))
    gains[0::2, 0::2], gains[1::2, 1::2] = 0.75, 0.6
    place = folder / "raw"
    place.mkdir()
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(place / f"{number:05d}.tif"), (16 * gains * picture).astype(np.uint16))
    return place


def _ramp(factor: int) -> Callable[[list[Gray], Path], Path]:
    """A clip whose middle is slower than its ends by a factor, as telephones export it."""

    def make(pictures: list[Gray], folder: Path) -> Path:
        first, last = len(pictures) // 5, 3 * len(pictures) // 5
        normal = range(0, len(pictures), factor)
        kept = sorted({*range(first, last), *(k for k in normal if not first <= k < last)})
        return written([pictures[number] for number in kept], folder / "ramp.mkv")

    return make


def _framed(pictures: list[Gray], folder: Path) -> Path:
    """A clip between black bars on all sides, which cover more than half of it."""
    return written([np.pad(one, ((30, 30), (40, 40))) for one in pictures], folder / "bars.mp4")


def _enlarged(factor: int, kind: int) -> Callable[[list[Gray], Path], Path]:
    def make(pictures: list[Gray], folder: Path) -> Path:
        larger = [
            cv2.resize(one, None, fx=factor, fy=factor, interpolation=kind) for one in pictures
        ]
        return written(larger, folder / "larger.mp4")

    return make


def _two_quotes(_: Path) -> None:
    read_sheet(_inputs() / "explain_trials_two_quotes.csv", {})


def _as_written(write: Callable[[Strike], str]) -> Callable[[Path], ClipMeasurement]:
    def run(folder: Path) -> ClipMeasurement:
        path = folder / "strike.txt"
        path.write_text(strike_text(write), encoding="utf-8")
        return measure_from_tracks(path, measure_options(ball="jokku"))

    return run


_RENAMED = "ball=mass B, pendulum=mass A"

CASES = (
    Case("base strike", _clip(lambda p, d: _inputs() / "base_strike.mkv", fps="600")),
    Case("r06 plain t,x,y", _table("r06_plain_txy_metres.csv")),
    Case("r07 Tracker, uneven", _table("r07_tracker_two_masses_uneven_columns.txt", _RENAMED)),
    Case("r08 Tracker, cm", _table("r08_tracker_centimetres.txt")),
    Case("r09 Excel dates", _table("r09_excel_dates.xlsx")),
    Case("r10 Excel days", _table("r10_excel_serial_days.xlsx")),
    Case("r11 Vernier", _table("r11_vernier.csv")),
    Case("r12 PASCO", _table("r12_pasco_two_head_lines.csv")),
    Case("r13 DeepLabCut", _table("r13_dlc.h5", fps="600", scale="73.4 px/m")),
    Case("r14 Kinovea", _table("r14_kinovea_timeseries.csv")),
    Case("r15 Tracker", _table("r15_tracker_second_mass_has_more_columns.txt", _RENAMED)),
    Case("r16 wide table", _table("r16_wide_two_objects.csv")),
    Case(
        "r17 Phantom, 7 pictures",
        lambda _: measure_clip(_inputs() / "r17_phantom_7_frames.cine", measure_options(fps="600")),
        "pictures, and 10 are needed",
    ),
    Case("explain, two quotes", _two_quotes, "line 5"),
    Case("--fps 300", _clip(lambda p, d: _inputs() / "base_strike.mkv", fps="300"), "--fps 600"),
    Case(
        "--wall-grid 40mm",
        _clip(lambda p, d: _inputs() / "base_strike.mkv", fps="600", wall_grid="40mm"),
        "--wall-grid 50mm",
    ),
    Case(
        "--ball 246mm",
        _clip(lambda p, d: _inputs() / "base_strike.mkv", fps="600", ball="246mm"),
        "instead of 246 mm",
    ),
    Case(
        "images with holes",
        _clip(lambda p, d: _images(p, d, _without(p, [(150, 161), (20, 23), (52, 54)])), fps="600"),
    ),
    Case(
        "images in steps of two", _clip(lambda p, d: _images(p, d, range(0, len(p), 2)), fps="600")
    ),
    Case(
        "every picture twice",
        _clip(lambda p, d: written([q for q in p for _ in range(2)], d / "twice.mkv"), fps="600"),
    ),
    *(
        Case(f"{count} pictures lost", _clip(_lost(count), fps="600"), "frames are missing")
        for count in (3, 6, 10)
    ),
    *(
        Case(f"middle slower {factor} times", _clip(_ramp(factor), fps="600"), "in slow motion")
        for factor in (4, 8)
    ),
    Case("black bars around", _clip(_framed, fps="600")),
    Case("enlarged 3 times", _clip(_enlarged(3, cv2.INTER_CUBIC), fps="600")),
    Case("each pixel doubled", _clip(_enlarged(2, cv2.INTER_NEAREST), fps="600")),
    Case("doubled in size", _clip(_enlarged(2, cv2.INTER_LINEAR), fps="600")),
    Case("animated WebP", _clip(_webp, fps="600")),
    Case("raw Bayer TIFF", _clip(_raw, fps="600")),
    *(Case(name, _as_written(write)) for name, write in TABLES.items()),
    *(Case(name, _as_written(write), cure) for name, (write, cure) in REFUSED_TABLES.items()),
)
"""Inputs of the table in the folder's README, clips made from its strike, and exports of it."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m bench.inputs")
    parser.add_argument("names", nargs="*", metavar="NAME", help="part of an input's name")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    truth = json.loads((_inputs() / "truth.json").read_text())
    outcomes: dict[str, str] = {}
    print("| input | outcome | details |\n|---|---|---|")
    for case in CASES:
        if asked.names and not any(word in case.name for word in asked.names):
            continue
        with tempfile.TemporaryDirectory() as folder:
            outcomes[case.name], details = verdict_of(case, Path(folder), truth)
        print(f"| {case.name} | {outcomes[case.name]} | {details} |", flush=True)
    counts = Counter(outcomes.values())
    print("\n" + ", ".join(f"{count} {verdict}" for verdict, count in counts.items()))
    if asked.json is not None:
        kept = json.loads(asked.json.read_text()) if asked.json.exists() else {}
        outcomes = {one.name: {**kept, **outcomes}[one.name] for one in CASES
                    if one.name in {**kept, **outcomes}}  # fmt: skip
        write_text_whole(asked.json, json.dumps(outcomes, indent=1) + "\n")


if __name__ == "__main__":
    main()
