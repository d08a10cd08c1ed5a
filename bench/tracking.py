"""How finely ball and pendulum are followed: errors against truth, printed as markdown tables.

Run: python -m bench.tracking [--rendered FOLDER…] [--clips FOLDER]

Rendered folders hold clip.mp4, setup.json and truth.json; the truth is the sphere's outline
through the
true camera. `clips` is a folder of real recordings with truth/NAME.csv beside them. χ is the root
mean
square of error over claimed standard uncertainty; its scatter part leaves out what a smooth curve
takes.
"""

import argparse
import csv
import json
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.trackers_side_by_side import true_flight
from vision.clip.clip import ClipReader
from vision.following import follow
from vision.tracks import PendulumTrack, Track

FloatArray = NDArray[np.float64]
CAPTURE_FPS = {"balltoss": 29.97, "diabolo": 240.0, "pendulum": 29.92, "toss": 29.83}
CANON_FPS = 240.0
SMOOTH_DEGREE = 6


def root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rendered_row(folder: Path) -> str:
    """Errors on one rendered clip, as a line of the table."""
    truth = json.loads((folder / "truth.json").read_text())
    clip = ClipReader.open(folder / "clip.mp4")
    start = time.perf_counter()
    tracks = follow(clip, truth["fps_nominal"])
    elapsed = time.perf_counter() - start
    flight = true_flight(folder)
    ball = tracks.ball
    _, own, theirs = np.intersect1d(ball.frame, flight.frames, return_indices=True)
    error = ball.centre_px[own] - flight.centre[theirs]
    std = np.sqrt(np.diagonal(ball.covariance_px2[own], axis1=1, axis2=2))
    bound = np.sqrt(np.diagonal(ball.bound_px2[own], axis1=1, axis2=2))
    place = np.linspace(-1, 1, len(own))
    scatter = error - np.column_stack(
        [np.polyval(np.polyfit(place, column, SMOOTH_DEGREE), place) for column in error.T]
    )
    return (
        f"| {folder.name} | {len(own)}/{len(flight.frames)} | {root_mean_square(error):.3f} | "
        f"{error[:, 0].mean():+.3f}, {error[:, 1].mean():+.3f} | {root_mean_square(scatter):.3f} | "
        f"{np.median(bound):.3f} | {root_mean_square(error / std):.1f} | "
        f"{root_mean_square(scatter / std):.1f} | {pendulum_error(tracks.pendulum, truth)} | "
        f"{len(truth['frames']['x_m']) / elapsed:.0f} |"
    )


def pendulum_error(pendulum: PendulumTrack | None, truth: dict[str, dict[str, list[float]]]) -> str:
    """Scatter of the mass along its arc within 25 frames of contact, px."""
    if pendulum is None:
        return "not found"
    frame = pendulum.track.frame
    near = np.abs(frame - truth["contact"]["first"]) < 25
    rows = {
        name: np.array(truth["frames"][name])[frame] for name in ("mass_u", "mass_v", "phi_rad")
    }
    gap = pendulum.track.centre_px - np.column_stack([rows["mass_u"], rows["mass_v"]])
    along = np.cos(rows["phi_rad"]) * gap[:, 0] - np.sin(rows["phi_rad"]) * gap[:, 1]
    return f"{np.std(along[near]):.3f}"


def real_rows(folder: Path) -> list[str]:
    """Errors on the real clips for which somebody marked the truth."""
    lines = []
    for marked in sorted((folder / "truth").glob("*.csv")):
        path = next(folder.glob(f"{marked.stem}.m*"))
        tracks = follow(
            ClipReader.open(path), CAPTURE_FPS.get(marked.stem.split("_")[0], CANON_FPS)
        )
        with marked.open() as file:
            rows = list(csv.DictReader(file))
        for name in sorted({row.get("object", "ball") for row in rows}):
            truth = np.array(
                [
                    [float(row[key]) for key in ("frame", "x_px", "y_px")]
                    for row in rows
                    if row.get("object", "ball") == name
                ]
            )
            track = tracks.others[0].track if name == "striker" and tracks.others else tracks.ball
            found, rms = against(track, truth, tracks.shift_px)
            lines.append(f"| {marked.stem} | {name} | {found}/{len(truth)} | {rms:.2f} |")
    return lines


def against(track: Track, truth: FloatArray, shift: FloatArray | None) -> tuple[int, float]:
    """How many marked frames were found, and the root mean square distance there, px."""
    frame = truth[:, 0].astype(np.int64)
    _, own, theirs = np.intersect1d(track.frame, frame, return_indices=True)
    seen = track.centre_px[own] + (0.0 if shift is None else shift[track.frame[own]])
    gap = np.hypot(*(seen - truth[theirs, 1:]).T)
    return len(own), root_mean_square(gap) if len(own) else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rendered", type=Path, nargs="*", default=[])
    parser.add_argument("--clips", type=Path)
    chosen = parser.parse_args()
    if chosen.rendered:
        print(
            "| clip | frames | ball rms px | mean x, y px | scatter px | bound px | χ "
            "| χ of scatter "
            "| mass scatter px | frames/s |\n|---|---|---|---|---|---|---|---|---|---|"
        )
        for folder in chosen.rendered:
            print(rendered_row(folder), flush=True)
    if chosen.clips is not None:
        print("\n| clip | object | found | rms px |\n|---|---|---|---|")
        for line in real_rows(chosen.clips):
            print(line, flush=True)


if __name__ == "__main__":
    main()
