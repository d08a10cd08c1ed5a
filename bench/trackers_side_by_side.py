"""Ball trackers on the same frames in the same run: error in flight and speed.

Run: python bench/trackers_side_by_side.py CLIP_FOLDER…   (clip.mp4, setup.json, truth.json in each)

`vision.following.follow` finds ball and pendulum unaided, in every frame of the clip. The others
are helped: they get the background (the median frame) taken away, the true radius within 15 %, and
of what they find the candidate nearest to the truth, no further away than a radius. They see only
the frames in flight. What all of them see is a sphere's outline, so the truth is that outline
through the true camera, and not the projection of the ball's centre.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trackpy
from numpy.typing import NDArray
from skimage.feature import canny
from skimage.transform import hough_circle, hough_circle_peaks

from vision.clip.clip import ClipReader
from vision.following import follow

FloatArray = NDArray[np.float64]
Image = NDArray[np.uint8]
Tracker = Callable[[Image, float], FloatArray]

RADIUS_LEEWAY = 0.15


@dataclass(frozen=True)
class Flight:
    """Frames in flight: their indices, where the outline's centre truly is, and its radius, px."""

    frames: NDArray[np.int64]
    centre: FloatArray
    radius: FloatArray


@dataclass(frozen=True)
class Score:
    """How one tracker did on one clip."""

    tracker: str
    rms_px: float
    found: float
    per_second: float


def outline(camera: dict[str, Any], ball: FloatArray, radius: float) -> tuple[FloatArray, float]:
    """Centre and mean radius of a sphere's outline in the picture, px."""
    sight = ball - np.array(camera["location"])
    distance = float(np.linalg.norm(sight))
    along = sight / distance
    across = np.cross(along, camera["up"])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)[:, None]
    ring = np.cos(turn) * across + np.sin(turn) * np.cross(along, across)
    sine = radius / distance
    rays = np.sqrt(1 - sine**2) * along + sine * ring
    depth = rays @ camera["forward"]
    x, y = rays @ camera["right"] / depth, -(rays @ camera["up"]) / depth
    square = x**2 + y**2
    bend = 1 + camera["k1"] * square + camera["k2"] * square**2
    points = np.stack(
        [camera["u0"] + camera["F_px"] * x * bend, camera["v0"] + camera["F_px"] * y * bend], axis=1
    )
    # Algebraic circle: |p|² = 2 c·p + const.
    design = np.column_stack([2 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    return solution[:2], float(np.hypot(*(points - solution[:2]).T).mean())


def true_flight(folder: Path) -> Flight:
    """Read where the ball is between release and landing, wholly in view."""
    truth = json.loads((folder / "truth.json").read_text())
    setup = json.loads((folder / "setup.json").read_text())
    ball_radius = 0.5 * setup["ball"]["diameter_m"]
    rows = truth["frames"]
    camera = truth["camera"]
    chosen, centres, radii = [], [], []
    land = truth["flight"].get("frame_land") or np.inf
    for index in range(truth["contact"]["last"] + 2, min(len(rows["x_m"]), int(min(land, 1e9)))):
        ball = np.array([rows["x_m"][index], rows["y_m"][index], truth["ball_plane_z"]])
        centre, radius = outline(camera, ball, ball_radius)
        if np.all(centre > radius + 1) and np.all(
            centre < np.array([camera["W"], camera["H"]]) - radius - 2
        ):
            chosen.append(index)
            centres.append(centre)
            radii.append(radius)
    return Flight(np.array(chosen), np.array(centres), np.array(radii))


def by_trackpy(image: Image, radius: float) -> FloatArray:
    """`trackpy.locate`, a bright blob of the ball's diameter."""
    diameter = 2 * round(radius) + 1
    # Its own band pass blurs over a pixel and takes away what is wider than the ball.
    features = trackpy.locate(image, diameter, topn=5, engine="python", characterize=False)
    return features[["x", "y"]].to_numpy(dtype=np.float64)


def by_opencv(image: Image, radius: float) -> FloatArray:
    """`cv2.HoughCircles` on the slightly blurred difference, as its manual advises."""
    low, high = (1 - RADIUS_LEEWAY) * radius, (1 + RADIUS_LEEWAY) * radius
    circles = cv2.HoughCircles(
        cv2.GaussianBlur(image, (0, 0), 1.0), cv2.HOUGH_GRADIENT, 1.0, radius, param1=60, param2=8,
        minRadius=int(low), maxRadius=int(np.ceil(high)),
    )  # fmt: skip
    if circles is None:
        return np.zeros((0, 2))
    return np.asarray(circles, np.float64).reshape(-1, circles.shape[-1])[:, :2]


def by_skimage(image: Image, radius: float) -> FloatArray:
    """scikit-image's circular Hough transform over Canny edges."""
    edges = canny(image, sigma=1.5)
    low, high = (1 - RADIUS_LEEWAY) * radius, (1 + RADIUS_LEEWAY) * radius
    radii = np.arange(int(low), int(np.ceil(high)) + 1)
    _, x, y, _ = hough_circle_peaks(hough_circle(edges, radii), radii, total_num_peaks=5)
    return np.column_stack([x, y]).astype(np.float64)


HELPED: dict[str, Tracker] = {
    "trackpy.locate": by_trackpy,
    "cv2.HoughCircles": by_opencv,
    "skimage circular Hough": by_skimage,
}


def score_helped(name: str, frames: list[Image], flight: Flight) -> Score:
    """Run one of the libraries' trackers over the frames in flight."""
    background = np.median(np.stack(frames[:: max(1, len(frames) // 48)]), axis=0)
    errors = []
    start = time.perf_counter()
    for index, truth, radius in zip(flight.frames, flight.centre, flight.radius, strict=True):
        moved = np.clip(np.abs(frames[index] - background), 0, 255).astype(np.uint8)
        found = HELPED[name](moved, float(radius))
        distance = np.hypot(*(found - truth).T) if len(found) else np.array([np.inf])
        errors.append(float(distance.min()))
    spent = time.perf_counter() - start
    return summary(name, np.array(errors), flight, len(flight.frames) / spent)


def score_ours(clip: ClipReader, flight: Flight, capture_fps: float) -> Score:
    """Follow ball and pendulum through the whole clip, decoding included."""
    start = time.perf_counter()
    ball = follow(clip, capture_fps).ball
    spent = time.perf_counter() - start
    place = dict(zip(ball.frame.tolist(), ball.centre_px, strict=True))
    errors = [
        float(np.hypot(*(place[index] - truth))) if index in place else np.inf
        for index, truth in zip(flight.frames.tolist(), flight.centre, strict=True)
    ]
    return summary("impact-vision", np.array(errors), flight, clip.info.frames / spent)


def summary(name: str, errors: FloatArray, flight: Flight, per_second: float) -> Score:
    """Root mean square error where the ball was found; further off than a radius is not found."""
    found = errors < flight.radius
    rms = float(np.sqrt(np.mean(errors[found] ** 2))) if found.any() else np.nan
    return Score(name, rms, float(found.mean()), per_second)


def side_by_side(folder: Path) -> tuple[int, list[Score]]:
    """All trackers on one clip."""
    flight = true_flight(folder)
    clip = ClipReader.open(folder / "clip.mp4")
    fps = float(json.loads((folder / "setup.json").read_text())["camera_nominal_fps"])
    frames = [np.asarray(frame.gray, np.uint8) for frame in clip.frames()]
    scores = [score_ours(clip, flight, fps)]
    scores += [score_helped(name, frames, flight) for name in HELPED]
    return len(flight.frames), scores


HEADER = """| clip (frames in flight) | tracker | RMS error / px | found | frames/s |
|---|---|---|---|---|"""


def rows(clip: str, count: int, scores: list[Score]) -> str:
    """One clip's rows of the table."""
    lines = []
    for score in scores:
        rms = "–" if np.isnan(score.rms_px) else f"{score.rms_px:.3f}"
        lines.append(
            f"| {clip} ({count}) | {score.tracker} | {rms} | {100 * score.found:.0f} % "
            f"| {score.per_second:.0f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="+")
    arguments = parser.parse_args()
    trackpy.quiet()
    print(HEADER)
    for folder in arguments.folder:
        print(rows(folder.name, *side_by_side(folder)), flush=True)


if __name__ == "__main__":
    main()
