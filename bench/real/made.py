"""Simulate recordings of other laboratories, instrument errors included.

No force law comes from the engine: swings by LSODA, flights by DOP853, each with the errors of its
instrument (zero offset, wrong length, quantised readings).
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from metrology import write_text_whole

__all__ = [
    "CART",
    "ENCODER",
    "STRING",
    "SwingRig",
    "write_flights",
    "write_rolling",
    "write_swings",
]

GRAVITY = 9.80665


@dataclass(frozen=True)
class SwingRig:
    """A pendulum with its losses and its encoder.

    Attributes
    ----------
    length : float
        Of the equivalent point mass, m; the setup file gives `stated_length`.
    dry, linear, quadratic : float
        Losses per inertia: rad/s², 1/s, 1.
    zero : float
        Angle that the encoder shows at rest, rad.
    noise, step : float
        Standard deviation and resolution of a reading, rad.
    rate, duration : float
        Hz, s.
    starts : tuple of float
        Angle of each release, rad.
    encoder_offset : float
        Forward offset of the encoder axis from the pendulum's, over the arm.
    play : float
        Backlash of a reading in either direction, rad.
    of_each : tuple of float
        Factor on the losses of each release; 1 for all if empty.
    """

    length: float
    stated_length: float
    dry: float
    linear: float
    quadratic: float
    zero: float
    noise: float
    step: float
    rate: float
    duration: float
    starts: tuple[float, ...]
    encoder_offset: float = 0.0
    play: float = 0.0
    of_each: tuple[float, ...] = ()


CART = SwingRig(
    0.31, 0.27, 0.45, 0.0, 0.05, 0.0, 0.002, 2.0 * np.pi / 2400, 200.0, 9.0,
    (2.3, -1.6, 1.9, -1.25, 2.0, -0.9),
)  # fmt: skip
"""A pendulum on a cart's axle: dry and quadratic losses, six pieces of nine seconds."""

STRING = SwingRig(
    0.94, 0.88, 0.0, 0.011, 0.021, 0.0098, 0.0011, 1e-5, 30.0, 24.0, (0.42, 0.36, -0.39, 0.45)
)
"""A weight on a string: linear and quadratic losses, and a tilted protractor."""

ENCODER = SwingRig(
    0.26, 0.26, 0.155, 0.0, 0.0, 0.006, 4e-4, 2.0 * np.pi / 1200, 50.0, 12.0, (1.6, 1.45, -1.5),
    encoder_offset=0.0105, play=np.pi / 1200, of_each=(1.0, 0.97, 1.02),
)  # fmt: skip
"""A pendulum on a coarse encoder that counts one edge per step, its disc off the axis; dry bearing
friction that varies between releases."""


def _swing(rig: SwingRig, start: float, time: np.ndarray, factor: float = 1.0) -> np.ndarray:
    stiffness = GRAVITY / rig.length

    def rate(_: float, state: np.ndarray) -> list[float]:
        rubbing = rig.dry * np.tanh(state[1] / 1e-3)
        loss = rubbing + rig.linear * state[1] + rig.quadratic * state[1] * abs(state[1])
        return [state[1], -stiffness * np.sin(state[0]) - factor * loss]

    path = solve_ivp(
        rate, (0.0, time[-1]), [start, 0.0], "LSODA", t_eval=time, rtol=1e-9, atol=1e-10
    )
    angle, pace = path.y
    return np.asarray(angle - rig.encoder_offset * np.cos(angle) - rig.play * np.sign(pace))


def write_swings(rig: SwingRig, target: Path, rate: float | None = None, seed: int = 5) -> None:
    """Write pendulum.csv and setup.toml of a rig, at its own sampling rate or at another."""
    target.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, rig.duration, 1.0 / (rate or rig.rate))
    parts = []
    for number, start in enumerate(rig.starts, 1):
        # Recordings do not start at a turning point.
        before = rng.uniform(0.3, 2.0)
        factor = rig.of_each[number - 1] if rig.of_each else 1.0
        seen = _swing(rig, start, np.concatenate([[0.0], before + time]), factor)[1:]
        seen = seen + rig.zero + rig.noise * rng.standard_normal(time.size)
        clock = np.round(time + rng.uniform(0.0, 5.0), 5)
        phi = np.round(seen / rig.step) * rig.step
        parts.append(pd.DataFrame({"trial": number, "t_s": clock, "phi_rad": np.round(phi, 6)}))
    pd.concat(parts).to_csv(target / "pendulum.csv", index=False, lineterminator="\n")
    length = rig.stated_length
    write_text_whole(
        target / "setup.toml",
        f'[pendulum]\nlength = "{length} m"\ncom = "{length} m"\nmass = "0.25 kg"\n'
        f'inertia = "{0.25 * length**2:.6g} kg m^2"\n',
    )


def write_rolling(target: Path, seed: int = 6) -> None:
    """Write ball.csv and setup.toml of a ball slowed by rolling resistance."""
    target.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 1.6, 1.0 / 60.0)
    parts = []
    for number, speed in enumerate((1.1, 0.8, 1.4, 0.95, 1.25), 1):
        slowing = 0.18 + 0.05 * speed
        way = speed * time - 0.5 * slowing * time**2
        noise = 0.0012 * rng.standard_normal((2, time.size))
        parts.append(
            pd.DataFrame(
                {"trial": number, "t_s": time, "x_m": way + noise[0], "y_m": 0.0335 + noise[1]}
            )
        )
    pd.concat(parts).round(6).to_csv(target / "ball.csv", index=False, lineterminator="\n")
    write_text_whole(
        target / "setup.toml",
        '[ball]\nmass = "58 g"\ndiameter = "67 mm"\n[model]\neffects = ["gravity"]\n',
    )


def _spun(spin: np.ndarray, mass: float, radius: float) -> Callable[..., np.ndarray]:
    area, density = np.pi * radius**2, 1.19

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        velocity = state[3:]
        speed = float(np.linalg.norm(velocity))
        turning = radius * float(np.linalg.norm(spin)) / speed
        lift = turning / (2.0 * turning + 0.9)
        along = -0.44 * speed * velocity
        across = lift * speed**2 * np.cross(spin, velocity)
        across = across / (np.linalg.norm(np.cross(spin, velocity)) + 1e-12)
        pull = 0.5 * density * area / mass * (along + across)
        return np.concatenate([velocity, pull - np.array([0.0, GRAVITY, 0.0])])

    return rate


def write_flights(target: Path, flights: int = 20, seed: int = 7) -> None:
    """Write ball.csv and setup.toml of table-tennis flights in 3-D, each with its own spin."""
    target.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(1, flights + 1):
        time = np.arange(0.0, rng.uniform(0.4, 0.7), 1.0 / 120.0)
        spin = rng.normal(0.0, (40.0, 40.0, 120.0))
        speed, up, aside = rng.uniform(4.0, 8.0), rng.uniform(0.1, 0.5), rng.normal(0.0, 0.1)
        velocity = speed * np.array([np.cos(up) * np.cos(aside), np.sin(up), np.sin(aside)])
        start = np.concatenate([rng.normal([0.0, 1.0, 0.0], 0.1), velocity])
        path = solve_ivp(
            _spun(spin, 0.0027, 0.02), (0.0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-9
        )
        seen = path.y[:3].T + 0.003 * rng.standard_normal((time.size, 3))
        part = pd.DataFrame(seen.round(6), columns=["x_m", "y_m", "z_m"])
        part.insert(0, "t_s", time.round(6))
        part.insert(0, "trial", number)
        parts.append(part)
    pd.concat(parts).to_csv(target / "ball.csv", index=False, lineterminator="\n")
    write_text_whole(
        target / "setup.toml",
        '[ball]\nmass = "2.7 g"\ndiameter = "40 mm"\n[model]\neffects = ["gravity"]\n',
    )
