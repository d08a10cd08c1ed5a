"""Ray-traced clips measured again as another camera might have filmed them, against the same truth.

Run: python -m bench.altered RENDERED_FOLDER

Each clip is mirrored, cut short, made smaller, noisy with flickering light, dark, taken at half the
rate, or squeezed through a strong compression; nothing is tuned to any of it, and distances are
taped as in bench.measure.
"""

import argparse
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from bench.measure import (
    Outcome,
    frames_error,
    held,
    measured,
    percent_held,
    rms_error,
    shortfalls,
    with_value,
)
from bench.measure_truth import Case, ray_traced
from metrology import ImpactVisionError

Pictures = list[NDArray[np.uint8]]
CUT_FRAMES = 30
CLOCK = ("contact_start", "contact_end", "landing_time")


@dataclass(frozen=True)
class Alteration:
    """A way in which a clip may differ.

    Attributes
    ----------
    name : str
    change : callable
        From the pictures to altered ones.
    cut, every : int
        Frames left out at the start, and of how many one is kept.
    crf : int
        Strength of the compression (H.264's constant rate factor).
    """

    name: str
    change: Callable[[Pictures], Pictures]
    cut: int = 0
    every: int = 1
    crf: int = 16


def noisy(pictures: Pictures) -> Pictures:
    """Noise of 6 gray levels, and light that flickers by 8 %."""
    rng = np.random.default_rng(1)
    return [
        np.clip(
            one * (1 + 0.08 * np.sin(1.05 * index)) + rng.normal(0, 6, one.shape), 0, 255
        ).astype(np.uint8)
        for index, one in enumerate(pictures)
    ]


def smaller(pictures: Pictures) -> Pictures:
    """Six tenths of the size."""
    return [
        np.asarray(
            cv2.resize(one, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
        for one in pictures
    ]


ALTERATIONS = (
    Alteration("as it is", lambda all_: all_),
    Alteration("mirrored", lambda all_: [one[:, ::-1] for one in all_]),
    Alteration(f"without its first {CUT_FRAMES} frames", lambda all_: all_, cut=CUT_FRAMES),
    Alteration("0.6 of its size", smaller),
    Alteration("noise of 6 levels, flicker of 8 %", noisy),
    Alteration(
        "dark, another transfer curve",
        lambda all_: [(153 * (one / 255.0) ** 1.6).astype(np.uint8) for one in all_],
    ),
    Alteration("half the frame rate", lambda all_: all_, every=2),
    Alteration("compressed to a fiftieth", lambda all_: all_, crf=36),
)


def written(pictures: Pictures, path: Path, crf: int) -> None:
    """Write pictures as a grey H.264 clip of 30 frames per second."""
    height, width = (length - length % 2 for length in pictures[0].shape)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": str(crf), "preset": "fast"}
        for picture in pictures:
            whole = np.ascontiguousarray(picture[:height, :width])
            frame = av.VideoFrame.from_ndarray(whole, format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def altered(case: Case, way: Alteration, folder: Path) -> Case:
    """The same case with another clip."""
    with av.open(str(case.path)) as container:
        pictures = [
            np.asarray(frame.to_ndarray(format="gray"), dtype=np.uint8)
            for frame in container.decode(video=0)
        ]
    path = folder / f"{case.name}-{ALTERATIONS.index(way)}.mp4"
    written(way.change(pictures[way.cut :: way.every]), path, way.crf)
    fps = case.fps / way.every
    setup = case.options.setup
    options = replace(
        case.options, setup=replace(setup, camera=replace(setup.camera, capture_fps=fps))
    )
    truth = {
        name: value - way.cut / case.fps if name in CLOCK else value
        for name, value in case.truth.items()
        if not (name == "contact_frames" and way.every > 1)
    }
    centre = np.full((len(pictures), 2), math.nan)
    return replace(
        case,
        name=f"{case.name} ({way.name})",
        path=path,
        options=options,
        fps=fps,
        truth=truth,
        centre_px=centre,
    )


def row(way: Alteration, outcomes: list[Outcome], failed: int) -> str:
    inside, count = held(outcomes)
    cells = (
        way.name,
        with_value(outcomes, "contact_time"),
        f"{frames_error(outcomes):.2f}",
        f"{rms_error(outcomes, 'ball_speed', True):.2f} %",
        f"{rms_error(outcomes, 'launch_angle'):.2f}°",
        f"{rms_error(outcomes, 'landing_distance', True):.2f} %",
        f"{rms_error(outcomes, 'cor'):.3f}",
        f"{inside} of {count}",
        str(failed or "–"),
    )
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print a row for each alteration."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rendered", type=Path)
    folder = parser.parse_args().rendered
    originals = [ray_traced(path.parent) for path in sorted(folder.glob("*/truth.json"))]
    print(
        "| clip | contact measured | contact time, frames | ball speed | launch angle | landing "
        "| COR | 95 % intervals hold | failed |\n|---|---|---|---|---|---|---|---|---|"
    )
    every: list[Outcome] = []
    for way in ALTERATIONS:
        outcomes, failed = [], 0
        with tempfile.TemporaryDirectory() as scratch:
            for case in originals:
                try:
                    outcomes.append(measured(altered(case, way, Path(scratch))))
                except ImpactVisionError:
                    failed += 1
        every += outcomes
        print(row(way, outcomes, failed))
    print(f"\nErrors are RMS. All: {percent_held(every):.1f} % of {held(every)[1]} intervals hold.")
    print(f"\n{shortfalls(every)}")


if __name__ == "__main__":
    main()
