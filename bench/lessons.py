"""Film the clips of the lessons, measure them and write the results the pages show.

Run: python -m bench.lessons [--keep-clips]

Writes docs/lessons/NAME.mp4 with its truth and docs/results/lessons.json. The lesson "strike" uses
a clip of sample_videos.
"""

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from bench.insert import rounded
from calib.camera import Camera, Lens
from impact_vision import measure
from metrology.files import write_text_whole
from physics.bodies import GRAVITY
from sample_videos.film import Film
from sample_videos.render import write_clip
from sample_videos.scene import Encoding, Scene, Shutter
from sample_videos.shot import HermiteCurve, Piece, SampledMotion, default_scene

ROOT = Path(__file__).parents[1]
LESSONS = ROOT / "docs" / "lessons"
RESULTS = ROOT / "docs" / "results" / "lessons.json"
FPS = 240.0
"""Capture rate, 1/s; convention of slow-motion telephones."""
ARM = 0.60
"""Pivot to the centre of the swinging ball, m; chosen."""
COR = 0.75
"""Ratio of speeds after and before a bounce; chosen."""
SIZE = (400, 224)
"""Picture, px; chosen: a square of the wall is 9 px."""
VIEW = 2.0
"""Width of the picture in the ball's plane, m; chosen."""
LATENCY = 0.003
"""Start of the motion's curve to the first frame, s; chosen."""
START = 0.05
"""Rest before the motion begins, s; chosen."""

Pieces = tuple[Piece, ...]
Pair = tuple[float, float]


def _piece(time: Any, x: Any, y: Any, vx: Any, vy: Any, z: float) -> Piece:
    t = np.asarray(time, dtype=np.float64)
    one = np.ones_like(t)
    return Piece(
        t,
        np.stack([x * one, y * one, z * one], axis=1),
        np.stack([vx * one, vy * one, 0.0 * one], axis=1),
    )


def _falling(start: float, end: float, at: Pair, v: Pair, z: float) -> Piece:
    """Free fall from `at` with velocity `v`."""
    t = np.linspace(start, end, 40)
    s = t - start
    return _piece(
        t, at[0] + v[0] * s, at[1] + v[1] * s - GRAVITY * s**2 / 2, v[0], v[1] - GRAVITY * s, z
    )


def _drop(radius: float, z: float) -> tuple[Pieces, float, dict[str, float]]:
    height = 1.05
    end = math.sqrt(2 * (height - radius) / GRAVITY)
    rest = _piece([-START, 0.0], 1.0, height, 0.0, 0.0, z)
    fall = _falling(0.0, end, (1.0, height), (0.0, 0.0), z)
    return (rest, fall), end - 0.01, {"fall_acceleration": GRAVITY}


def _throw(radius: float, z: float) -> tuple[Pieces, float, dict[str, float]]:
    v = (2.2, 3.2)
    first = v[1] - GRAVITY * LATENCY
    truth = {
        "fall_acceleration": GRAVITY,
        "flight_speed": math.hypot(v[0], first),
        "flight_angle": math.degrees(math.atan2(first, v[0])),
    }
    return (_falling(-START, 0.75, (0.15, 0.40), v, z),), 0.70, truth


def _swing(radius: float, z: float) -> tuple[Pieces, float, dict[str, float]]:
    amplitude, end = math.radians(30.0), 3.6

    def rate(_: float, state: Any) -> list[float]:
        return [state[1], -GRAVITY / ARM * math.sin(state[0])]

    t = np.linspace(-START, end, 1200)
    found = solve_ivp(rate, (t[0], t[-1]), [amplitude, 0.0], t_eval=t, rtol=1e-10, atol=1e-12)
    angle, omega = found.y
    pivot = (1.0, 1.10)
    x, y = pivot[0] + ARM * np.sin(angle), pivot[1] - ARM * np.cos(angle)
    piece = _piece(t, x, y, ARM * omega * np.cos(angle), ARM * omega * np.sin(angle), z)
    k = math.sin(amplitude / 2)
    # arithmetic-geometric mean: exact period of a simple pendulum
    a, b = 1.0, math.sqrt(1 - k * k)
    for _ in range(6):
        a, b = (a + b) / 2, math.sqrt(a * b)
    return (piece,), end - 0.05, {"swing_period": 2 * math.pi * math.sqrt(ARM / GRAVITY) / a}


def _bounce(radius: float, z: float) -> tuple[Pieces, float, dict[str, float]]:
    height, x, v = 1.0, 0.5, 0.5
    first = math.sqrt(2 * (height - radius) / GRAVITY)
    rise = COR * GRAVITY * first
    pieces = [_falling(-START, first, _back(x, height, v), (v, GRAVITY * START), z)]
    at, start = x + v * first, first
    for _ in range(2):
        end = start + 2 * rise / GRAVITY
        pieces.append(_falling(start, end, (at, radius), (v, rise), z))
        at, start, rise = at + v * (end - start), end, rise * COR
    return tuple(pieces), start - 0.01, {"cor_bounce": COR}


def _back(x: float, height: float, v: float) -> tuple[float, float]:
    """Position `START` before the highest point."""
    return x - v * START, height - GRAVITY * START**2 / 2


MOTIONS: dict[str, Callable[[float, float], tuple[Pieces, float, dict[str, float]]]] = {
    "drop": _drop,
    "throw": _throw,
    "swing": _swing,
    "bounce": _bounce,
}
RATES = {"swing": 60.0}
"""Other capture rates, 1/s."""
BALL, GRID = "201.75mm", "50mm"
"""Options of the commands on the pages."""
STRIKE = ROOT / "sample_videos" / "clips" / "jokku_90_small.mp4"
SHOWN = {
    "fall_acceleration",
    "flight_speed",
    "flight_angle",
    "swing_period",
    "contact_time",
    "ball_speed",
    "launch_angle",
    "landing_distance",
    "cor",
    "cor_bounce",
}
"""Quantities on the pages."""


def _camera(scene: Scene) -> Camera:
    """Camera square to the wall whose picture is `VIEW` wide in the ball's plane."""
    distance = 4.0
    focal = (SIZE[0] - 1) * (distance - scene.room.plane) / VIEW
    lens = Lens.centred(*SIZE, focal, k1=-0.01)
    return Camera.facing_wall(lens, [1.0, 0.60, distance], yaw=0.004, roll=0.002)


def film(name: str) -> dict[str, float]:
    """Write the clip of a lesson and its truth; returns the truth."""
    scene: Scene = default_scene(size=SIZE, seed=5)
    pieces, end, truth = MOTIONS[name](scene.ball.radius, scene.room.plane)
    motion = SampledMotion(
        ball=HermiteCurve(pieces),
        pendulum=HermiteCurve.constant([0.0]),
        compression=HermiteCurve.constant(np.zeros(3)),
        turn=HermiteCurve.constant([0.0]),
        spin_axis=np.array([0.0, 0.0, 1.0]),
        attitude=np.eye(3),
    )
    fps = RATES.get(name, FPS)
    scene = replace(
        scene,
        camera=_camera(scene),
        room=replace(scene.room, show_rig=False, show_support=False),
        shutter=Shutter(fps=fps, exposure=1 / 2000, first=-START + LATENCY),
        frames=round((end + START - LATENCY) * fps),
        encoding=Encoding(bitrate=5.0 * SIZE[0] * SIZE[1]),
    )
    clip = LESSONS / f"{name}.mp4"
    write_clip(Film(scene, motion).frames(), clip, scene.encoding)
    truth = {name: round(value, 6) for name, value in truth.items()}
    clip.with_suffix(".truth.json").write_text(json.dumps(truth, indent=1) + "\n", "utf-8")
    return truth


def measured(name: str, truth: dict[str, float]) -> dict[str, Any]:
    """Motion kind and quantities of a lesson's clip, each with the true value."""
    if name == "strike":
        found = measure(STRIKE, setup=STRIKE.with_suffix(".toml"), cache=False)
    else:
        rate = RATES.get(name, FPS)
        found = measure(LESSONS / f"{name}.mp4", fps=rate, ball=BALL, wall_grid=GRID, cache=False)
    quantities = {
        key: {"value": q.value, "std": q.std, "unit": q.unit, "true": truth.get(key)}
        for key, q in found.quantities.items()
        if q.value is not None and key in SHOWN and key in truth
    }
    return {"kind": str(found.motion.kind.value), "quantities": quantities}


def main() -> None:
    """Film, measure and write the results."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--keep-clips", action="store_true", help="measure the clips that exist")
    options = parser.parse_args()
    results: dict[str, Any] = {}
    for name in (*MOTIONS, "strike"):
        if name == "strike":
            plain = json.loads(STRIKE.with_suffix(".truth.json").read_text("utf-8"))["quantities"]
            truth = {key: q["value"] for key, q in plain.items()}
            truth["cor"] = truth["cor_speeds"]
        elif options.keep_clips:
            truth = json.loads((LESSONS / f"{name}.truth.json").read_text("utf-8"))
        else:
            truth = film(name)
        results[name] = measured(name, truth)
        print(name, results[name])
    RESULTS.parent.mkdir(exist_ok=True)
    write_text_whole(RESULTS, json.dumps(rounded(results), indent=1) + "\n")


if __name__ == "__main__":
    main()
