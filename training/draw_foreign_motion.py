"""Draw throws and free swings with foreign laws, to calibrate `vision explain`.

Every law differs in form from the catalogue's; half of them are in no catalogue. Each campaign is a
folder with the files a laboratory would have, and an `answer.json` with the ids that are right.
Run `python -m training.draw_foreign_motion FOLDER --count 24 --seed 1`.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

__all__ = ["SWINGS", "THROWS", "draw_campaign"]

Array = NDArray[np.float64]
Hook = Callable[..., Array]
GRAVITY = 9.806
AIR = 1.19
"""kg/m³"""


@dataclass(frozen=True)
class Law:
    """One law to conceal: its own name, the id that is right, its size and what it changes.

    `force` (size, time, state, ball) gives N, `torque` (size, time, angle, rate) rad/s² per unit of
    inertia, `picture` (size, time, x, y) the positions that are recorded, `clock` the true time.
    """

    name: str
    id: str
    size: tuple[float, float]
    force: Hook | None = None
    torque: Hook | None = None
    picture: Hook | None = None
    clock: Hook | None = None


def _along(state: Array, strength: Array | float) -> Array:
    return strength * state[2:] / max(float(np.hypot(*state[2:])), 1e-6)


def _speed(state: Array) -> float:
    return float(np.hypot(state[2], state[3]))


def _normal(state: Array, strength: float) -> Array:
    return strength * np.array([-state[3], state[2]]) / max(_speed(state), 1e-6)


def _tether(size: float, time: float, state: Array, weight: float) -> Array:
    """A soft thread that is taut beyond a length."""
    apart = state[:2] - np.array([0.2, 1.0])
    length = float(np.hypot(*apart))
    return np.asarray(-size * weight * max(length - 0.9, 0.0) * apart / length)


def _toward(size: float, time: float, state: Array, weight: float) -> Array:
    """A charge that is drawn by its image in a wall at 2.6 m."""
    return np.array([size * weight * 0.05 / max(2.6 - state[0], 0.15) ** 2, 0.0])


def _plume(size: float, time: float, state: Array, weight: float) -> Array:
    """Warm air rising over a radiator."""
    return np.array([0.0, size * weight / (1.0 + ((state[0] - 1.1) / 0.2) ** 4)])


def _evaporating(size: float, time: float, state: Array, weight: float) -> Array:
    """Resistance that grows while the body loses mass."""
    return _along(state, -0.02 * weight * (1.0 + 4.0 * size * time**0.7) * _speed(state) ** 2)


def _memory(size: float, time: float, state: Array, weight: float) -> Array:
    """A boundary layer that builds up after release."""
    return _along(state, -size * weight * _speed(state) * np.exp(-time / 0.12))


def _beating(size: float, time: float, state: Array, weight: float) -> Array:
    """A fan that beats slowly."""
    return np.array([size * weight * np.sin(7.0 * time + 0.5) * np.exp(-0.8 * time), 0.0])


def _lens(size: float, time: Array, x: Array, y: Array) -> Array:
    dx, dy = x - 1.3, y - 1.0
    square = dx**2 + dy**2
    factor = size * square * (1.0 - 0.2 * square)
    return np.stack([x + factor * dx, y + factor * dy])


THROWS: tuple[Law, ...] = (
    Law("re_drag", "drag", (0.25, 0.6),
        force=lambda k, t, s, w: _along(s, -0.03 * k * w * _speed(s) ** 1.85)),
    Law("saturating_lift", "magnus", (0.015, 0.04),
        force=lambda k, t, s, w: _normal(
            s, k * w * _speed(s) ** 2 * (1.0 - np.exp(-2.5 / max(_speed(s), 0.1))))),
    Law("slow_clock", "time_base", (0.01, 0.03),
        clock=lambda k, t: t * (1.0 + k * (1.0 + 0.15 * t))),
    Law("barrel", "lens_distortion", (0.006, 0.02), picture=_lens),
    Law("draught", "wind", (0.5, 1.5),
        force=lambda k, t, s, w: np.array(
            [0.03 * w * k * _speed(s) * np.log1p(max(s[1], 0.0) / 0.1) / 2.4, 0.0])),
    Law("tether", "unnamed", (0.3, 1.2), force=_tether),
    Law("image_charge", "unnamed", (0.3, 1.0), force=_toward),
    Law("plume", "unnamed", (0.05, 0.25), force=_plume),
    Law("evaporating", "unnamed", (0.3, 1.0), force=_evaporating),
    Law("building_layer", "unnamed", (0.02, 0.08), force=_memory),
    Law("beating", "unnamed", (0.03, 0.12), force=_beating),
)  # fmt: skip


def _sign(rate: float) -> float:
    return float(np.tanh(rate / 0.02))


SWINGS: tuple[Law, ...] = (
    Law("greased", "bearing_friction", (0.04, 0.1),
        torque=lambda k, t, a, r: -k * (0.85 + 0.15 * abs(r) ** 0.5) * _sign(r)),
    Law("oil", "viscous_damping", (0.02, 0.06), torque=lambda k, t, a, r: -k * r),
    Law("board", "pendulum_drag", (0.03, 0.1),
        torque=lambda k, t, a, r: -k * r * abs(r) ** 0.85),
    Law("rough_patch", "unnamed", (0.3, 0.9),
        torque=lambda k, t, a, r: -k * _sign(r) / (1.0 + ((a - 0.2) / 0.06) ** 6)),
    Law("one_sided_brush", "unnamed", (0.1, 0.4),
        torque=lambda k, t, a, r: -k * _sign(r) * (0.5 + 0.5 * np.tanh((a - 0.1) / 0.05))),
    Law("drying_bearing", "unnamed", (0.05, 0.15),
        torque=lambda k, t, a, r: -k * _sign(r) * (0.2 + 0.8 * (1.0 - np.exp(-t / 4.0)))),
    Law("magnet", "unnamed", (0.2, 0.8),
        torque=lambda k, t, a, r: -k * (a + 0.3) / (1.0 + ((a + 0.3) / 0.1) ** 4)),
)  # fmt: skip


def _slow_noise(rng: np.random.Generator, shape: tuple[int, ...], size: float) -> Array:
    """White noise and a third of slow noise with a memory of some rows."""
    slow = rng.normal(0.0, 1.0, shape)
    for row in range(1, shape[-1]):
        slow[..., row] = 0.8 * slow[..., row - 1] + 0.6 * slow[..., row]
    return size * (0.95 * rng.normal(0.0, 1.0, shape) + 0.3 * slow)


def _throw(rng: np.random.Generator, law: Law, size: float, folder: Path) -> None:
    mass, diameter = float(rng.uniform(0.02, 0.1)), float(rng.uniform(0.05, 0.1))
    rate, noise = float(rng.choice([120.0, 180.0, 240.0])), float(rng.uniform(0.0004, 0.0015))
    rows = []
    for trial in range(int(rng.integers(7, 12))):
        start = np.array([rng.uniform(0.0, 0.2), rng.uniform(0.9, 1.3),
                          rng.uniform(2.0, 4.0), rng.uniform(0.5, 2.5)])  # fmt: skip

        def slope(time: float, state: Array) -> Array:
            pushed = np.zeros(2)
            if law.force is not None:
                pushed = law.force(size, time, state, mass * GRAVITY) / mass
            return np.array([state[2], state[3], pushed[0], pushed[1] - GRAVITY])

        label = np.arange(0.0, rng.uniform(0.5, 0.75), 1.0 / rate)
        clock = law.clock
        true = label if clock is None else clock(size, label)
        solved = solve_ivp(slope, (0.0, float(true[-1]) + 0.01), start, dense_output=True,
                           rtol=1e-8, atol=1e-9, max_step=0.01)  # fmt: skip
        seen = solved.sol(true)[:2]
        if law.picture is not None:
            seen = law.picture(size, label, *seen)
        seen = seen + _slow_noise(rng, seen.shape, noise)
        rows += [(trial, "body", round(t, 6), round(x, 5), round(y, 5))
                 for t, x, y in zip(label, *seen, strict=True)]  # fmt: skip
    table = pd.DataFrame(rows, columns=["trial", "ball", "t_s", "x_m", "y_m"])
    table.to_csv(folder / "ball.csv", index=False, lineterminator="\n")
    (folder / "setup.toml").write_text(
        f'[camera]\ncapture_fps = {rate:g}\n[air]\ndensity = "{AIR} kg/m^3"\n'
        f'[balls.body]\nmass = "{mass:.5g} kg"\ndiameter = "{diameter:.5g} m"\n'
        f'[noise]\nposition = "{noise:.2g} m"\n[model]\neffects = ["gravity"]\n',
        encoding="utf-8",
    )


def _swing(rng: np.random.Generator, law: Law, size: float, folder: Path) -> None:
    length, rate = float(rng.uniform(0.25, 0.5)), float(rng.choice([60.0, 100.0]))
    noise, pull = float(rng.uniform(0.0006, 0.0015)), GRAVITY / length
    torque = law.torque
    rows = []
    for trial in range(int(rng.integers(3, 5))):

        def slope(time: float, state: Array) -> Array:
            braked = 0.0 if torque is None else torque(size, time, state[0], state[1])
            return np.array([state[1], -pull * np.sin(state[0]) + braked])

        label = np.arange(0.0, 9.0, 1.0 / rate)
        solved = solve_ivp(slope, (0.0, 9.0), [-rng.uniform(0.5, 1.2), 0.0], t_eval=label,
                           rtol=1e-8, atol=1e-9, max_step=0.01)  # fmt: skip
        seen = solved.y[0] + _slow_noise(rng, (label.size,), noise)
        rows += [(trial, round(t, 6), round(a, 6)) for t, a in zip(label, seen, strict=True)]
    table = pd.DataFrame(rows, columns=["trial", "t_s", "phi_rad"])
    table.to_csv(folder / "pendulum.csv", index=False, lineterminator="\n")
    (folder / "setup.toml").write_text(
        f'[camera]\ncapture_fps = {rate:g}\n[pendulum]\nlength = "{length:.4g} m"\n'
        f'inertia = "{0.5 * length**2:.6g} kg m^2"\nmass = "0.5 kg"\ncom = "{length:.4g} m"\n'
        f'[noise]\nangle = "{noise:.2g} rad"\n[model]\neffects = ["gravity"]\n',
        encoding="utf-8",
    )


def draw_campaign(seed: int, number: int, folder: Path) -> str:
    """Write campaign `number` of a seed to a folder; the name of what is concealed."""
    rng = np.random.default_rng([seed, number, 5])
    swings = number % 3 == 2
    laws = SWINGS if swings else THROWS
    law = laws[(number // 3 if swings else number - number // 3) % len(laws)]
    size = float(np.exp(rng.uniform(*np.log(law.size))))
    folder.mkdir(parents=True, exist_ok=True)
    (_swing if swings else _throw)(rng, law, size, folder)
    key = {"law": law.name, "ids": [law.id], "size": size,
           "record": "swings" if swings else "throws"}  # fmt: skip
    (folder / "answer.json").write_text(json.dumps(key), encoding="utf-8")
    return law.name


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m training.draw_foreign_motion")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for number in range(options.count):
        print(number, draw_campaign(options.seed, number, options.folder / f"{number:04d}"))


if __name__ == "__main__":
    main()
