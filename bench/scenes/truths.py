"""Load the true positions of rendered clips and of real clips marked by eye."""

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

RATES = {
    "projectile": 240.0,
    "puck": 240.0,
    "diabolo": 240.0,
    "freefall": 1000.0,
    "balltoss_480p15": 15.15,
    "red": 25.0,
    "tennis_ball_bounce": 10.0,
}
USUAL_RATE = 30.0


@dataclass(frozen=True)
class Truth:
    """True positions of one object: frame, centre (N, 2), radius and uncertainty (N,), px.

    `steady`: positions as seen by a camera that does not move, as rendered clips store them.
    """

    name: str
    frame: NDArray[np.int64]
    centre: FloatArray
    radius: FloatArray
    std: FloatArray
    steady: bool = False


def outline(camera: dict[str, Any], ball: FloatArray, radius: float) -> tuple[FloatArray, float]:
    """Centre and mean radius of a sphere's outline in the image, px."""
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


def scene_truth(folder: Path) -> Truth:
    """The ball from release to landing, while entirely in view."""
    truth = json.loads((folder / "truth.json").read_text())
    setup = json.loads((folder / "setup.json").read_text())
    camera, rows = truth["camera"], truth["frames"]
    land = truth["flight"].get("frame_land") or np.inf
    frames, centres, radii = [], [], []
    for index in range(truth["contact"]["last"] + 2, int(min(len(rows["x_m"]), land))):
        place = np.array([rows["x_m"][index], rows["y_m"][index], truth["ball_plane_z"]])
        centre, radius = outline(camera, place, 0.5 * setup["ball"]["diameter_m"])
        inside = np.all(centre > radius) and np.all(
            centre < np.array([camera["W"], camera["H"]]) - radius - 1
        )
        if inside:
            frames.append(index)
            centres.append(centre)
            radii.append(radius)
    return Truth(
        "ball", np.array(frames), np.array(centres), np.array(radii), np.zeros(len(frames)), True
    )


def marked_truths(path: Path) -> list[Truth]:
    """The objects marked by eye in a real clip."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    truths = []
    for name in sorted({row.get("object") or "ball" for row in rows}):
        chosen = [row for row in rows if (row.get("object") or "ball") == name]
        table = np.array(
            [
                [float(r[key]) for key in ("frame", "x_px", "y_px", "radius_px", "uncertainty_px")]
                for r in chosen
            ]
        )
        truths.append(
            Truth(name, table[:, 0].astype(np.int64), table[:, 1:3], table[:, 3], table[:, 4])
        )
    return truths


def clips_of(shared: Path) -> Iterator[tuple[Path, str, list[Truth], float]]:
    """Every clip with its truths and capture rate."""
    for room in ("scenes", "rendered"):
        for folder in sorted(path for path in (shared / room).iterdir() if path.is_dir()):
            rate = json.loads((folder / "truth.json").read_text())["fps_nominal"]
            yield folder / "clip.mp4", folder.name, [scene_truth(folder)], float(rate)
    files = sorted(
        p for p in (shared / "clips").iterdir() if p.suffix in {".mp4", ".mov", ".avi", ".gif"}
    )
    for path in files:
        marked = shared / "clips" / "truth" / f"{path.stem}.csv"
        truths = marked_truths(marked) if marked.exists() else []
        rate = next((r for key, r in RATES.items() if path.name.startswith(key)), USUAL_RATE)
        yield path, path.stem, truths, rate
