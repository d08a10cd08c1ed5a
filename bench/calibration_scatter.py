"""Compare predicted and actual std of positions over many calibrations.

Run: python -m bench.calibration_scatter [--simulated 200] [--rendered 200]

Each calibration draws every uncertain input from its stated distribution: noise of the grid
crossings, lens, hand-measured distances, diameter and outlines of the ball. The ratio is the root
mean square of the error over the predicted standard deviation, 1 for a correct prediction.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, Evidence
from calib.camera import Camera
from calib.grid import find_wall_grid
from calib.solve import PRINCIPAL_POINT_STD, calibrate
from metrology import CalibrationError
from tests.calib.synthetic import rendered, some_camera
from tests.calib.test_pose import DEPTH, RADIUS, evidence, known_lens, seen_grid, wide_camera

FloatArray = NDArray[np.float64]

PLACES = np.array([[0.4, 0.5], [0.9, 0.35], [1.3, RADIUS]])
CORNER_NOISE_PX = 0.3
RENDERED_SIZE = (432, 240)


@dataclass(frozen=True)
class Drawn:
    """One calibration: errors at `PLACES` in units of the predicted standard deviation, (P, 2)."""

    normalised: FloatArray
    predicted_m: float


def seen_places(camera: Camera) -> FloatArray | None:
    """Image positions of the ball at `PLACES`, px; None unless all of them are in view."""
    centres = np.c_[PLACES, np.full(len(PLACES), DEPTH)]
    px = camera.sphere_outline(centres, RADIUS)[0]
    size = [camera.lens.width, camera.lens.height]
    inside = np.isfinite(px).all() and (px > 0).all() and (px < size).all()
    return np.asarray(px) if inside else None


def judged(scene: Calibration, camera: Camera) -> Drawn | None:
    """Compare positions with the truth; None unless all places are in view."""
    px = seen_places(camera)
    if px is None:
        return None
    error = scene.position(px)[0] - PLACES
    variance = np.einsum("pii->pi", scene.position_covariance(px))
    return Drawn(error / np.sqrt(variance), float(np.sqrt(np.median(variance))))


def board_known(count: int) -> Iterator[Drawn]:
    """One camera with the lens calibrated from a board."""
    camera = wide_camera()
    for seed in range(count):
        rng = np.random.default_rng([seed, 51])
        known = evidence(camera, rng, tape=True, ball=True, fall=False)
        grid = seen_grid(camera, CORNER_NOISE_PX, rng)
        found = judged(calibrate(grid, known, lens=known_lens(camera, rng)), camera)
        if found is not None:
            yield found


def placed_by_eye(rng: np.random.Generator, size: tuple[int, int] = (640, 360)) -> Camera:
    """A random camera whose principal point is displaced as the prior of the fit assumes."""
    camera = some_camera(rng, size)
    lens = camera.lens
    off = rng.normal(0.0, PRINCIPAL_POINT_STD * lens.width, 2)
    return replace(camera, lens=replace(lens, cx=lens.cx + off[0], cy=lens.cy + off[1]))


def grid_alone(count: int) -> Iterator[Drawn]:
    """Random cameras, lens from the grid alone; distances and ball determine the depth."""
    for seed in range(count):
        rng = np.random.default_rng([seed, 52])
        camera = placed_by_eye(rng)
        known = evidence(camera, rng, tape=True, ball=True, fall=False)
        found = judged(calibrate(seen_grid(camera, CORNER_NOISE_PX, rng), known), camera)
        if found is not None:
            yield found


def from_pictures(count: int) -> tuple[list[Drawn], int]:
    """The same with the grid found in rendered images; and the number of rejected images."""
    drawn: list[Drawn] = []
    seed = refused = 0
    while len(drawn) < count:
        seed += 1
        rng = np.random.default_rng([seed, 53])
        camera = placed_by_eye(rng, RENDERED_SIZE)
        if seen_places(camera) is None:
            continue
        known: Evidence = evidence(camera, rng, tape=True, ball=True, fall=False)
        try:
            grid = find_wall_grid(rendered(camera, seed=seed, samples=3))
            found = judged(calibrate(grid, known), camera)
        except CalibrationError:
            refused += 1
            continue
        if found is not None:
            drawn.append(found)
    return drawn, refused


def row(name: str, drawn: list[Drawn]) -> str:
    """A line of the table."""
    z = np.array([one.normalised for one in drawn])
    ratio = float(np.sqrt(np.mean(z**2)))
    # places and axes of one calibration are correlated; calibrations are independent
    std = float(np.std(np.mean(z**2, axis=(1, 2)))) / (2.0 * ratio * np.sqrt(len(z)))
    inside = 100.0 * float(np.mean(np.abs(z) < 1.96))
    typical = 1e3 * float(np.median([one.predicted_m for one in drawn]))
    return (
        f"| {name} | {len(drawn)} | {typical:.2f} mm | {ratio:.3f} ± {std:.3f} | {inside:.0f} % |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulated", type=int, default=200)
    parser.add_argument("--rendered", type=int, default=200)
    options = parser.parse_args()
    print("| calibrations | number | predicted ± | actual over predicted | in the 95 % interval |")
    print("|---|---|---|---|---|", flush=True)
    print(row("lens from a board", list(board_known(options.simulated))), flush=True)
    print(row("lens from the grid alone", list(grid_alone(options.simulated))), flush=True)
    drawn, refused = from_pictures(options.rendered)
    print(row("the same, grid found in rendered images", drawn))
    print(f"\nImages rejected: {refused} of {refused + len(drawn)}.")


if __name__ == "__main__":
    main()
