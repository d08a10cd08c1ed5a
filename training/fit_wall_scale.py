"""Fit the uncertainty of a wall's local scale at the ball to drawn cameras.

Run: python -m training.fit_wall_scale

A ball flies in front of a wall with a grid, filmed by cameras turned by some 20° at most. Its scale
by the grid is compared with that by its fall, which is exact here. What is left comes from the
wall's perspective, which the checker removes in the ball's plane only approximately; it grows with
the tangent of the angle between the optical axis and the wall's normal.
"""

import math

import numpy as np

from calib.camera import Camera
from calib.solve import lens_of_view, planned_grid
from measuring.checker.scene import SceneFacts, equations_of, upright
from metrology import CalibrationError

CAMERAS = 400
RATE = 240.0
SIZE = (1280, 720)


def difference(rng: np.random.Generator) -> tuple[float, float] | None:
    """Tangent of the turn, and log of the scale by the grid over that by the fall."""
    width, height = SIZE
    lens = lens_of_view(width, height, rng.uniform(0.6, 1.2))
    away, offset = rng.uniform(3.0, 7.0), rng.uniform(0.2, 0.8)
    turn = rng.normal(0.0, rng.choice([0.0, 0.05, 0.1, 0.2]), 2)
    camera = Camera.facing_wall(
        lens, [0.0, 1.0, away], yaw=turn[0], pitch=turn[1], roll=rng.normal(0.0, 0.02)
    )
    time = np.arange(0.0, 0.45, 1.0 / RATE)
    flown = np.maximum(time - 0.1, 0.0)
    left = -0.5 * away * (width - 1) / lens.fx * rng.uniform(0.2, 0.8)
    path = np.column_stack(
        [
            left + rng.uniform(2.0, 5.0) * flown,
            1.0 + flown - 4.9 * flown**2,
            np.full(len(time), offset),
        ]
    )
    px = camera.project(path)
    seen = ((px > 20.0) & (px < [width - 20.0, height - 20.0])).all(axis=1)
    if seen.sum() < 70:
        return None
    try:
        grid = planned_grid(camera)
    except CalibrationError:
        return None
    facts = SceneFacts(
        frame=RATE * time[seen],
        centre_px=px[seen] + rng.normal(0.0, 0.02, (int(seen.sum()), 2)),
        radius_px=None,
        flies=True,
        rate=(RATE, 0.1),
        ball=None,
        grid=grid,
        camera_distance=(away / abs(camera.rotation[2, 2]), 0.005),
        plane_offset=(offset, 0.005),
    )
    inputs, relations = equations_of(upright(facts))
    known = {one.key: one.value for one in inputs}
    scale = {one.name: one for one in relations}
    if not {"the grid", "free fall"} <= scale.keys() or "ratio" not in known:
        return None
    by_grid = math.log(scale["the grid"].value * known["grid"] * known["ratio"])
    fall = scale["free fall"]
    by_fall = math.log(fall.value / known["rate"] ** 2) / fall.powers["scale"]
    return math.tan(math.hypot(*turn)), by_grid - by_fall


def main() -> None:
    """Print the fitted slope, and the rest where the camera faces the wall."""
    rng = np.random.default_rng(3)
    found = [one for _ in range(CAMERAS) if (one := difference(rng)) is not None]
    tangent, off = np.array(found).T
    square = tangent < 1e-9
    slope = math.sqrt(float(np.mean(off[~square] ** 2) / np.mean(tangent[~square] ** 2)))
    rest = math.sqrt(float(np.mean(off[square] ** 2)))
    print(f"{len(off)} cameras: std {slope:.3f} per tangent; facing the wall {rest:.4f}")


if __name__ == "__main__":
    main()
