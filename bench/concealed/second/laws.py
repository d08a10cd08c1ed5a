"""Concealed laws of the second world, none in the form of the engine's catalogue.

A law has one parameter, its amplitude `a`; at a = 0 nothing changes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["NAMED", "UNNAMED", "Law"]

Array = NDArray[np.float64]
Hook = Callable[..., Any]
ALONG = ("along_velocity", "horizontal")
UPWARD = ("vertical", "normal_to_velocity")
EITHER = (*ALONG, *UPWARD)


@dataclass(frozen=True)
class Law:
    """One law to conceal.

    Attributes
    ----------
    name, id, phase : str
        Its name here, the id of the answer, and the phase in which it acts.
    form : str
        Form of the law, for the list in the proof.
    unit, limit : float
        A small amplitude for finite differences, and the largest plausible one.
    signs : tuple of int
        Possible signs.
    channels : tuple of str
        Directions of the mismatch that count as right.
    force, torque, contact, release, restitution, start, clock, image : callable, optional
        The quantities it changes; None changes nothing.
    """

    name: str
    id: str
    phase: str
    form: str
    unit: float
    limit: float
    signs: tuple[int, ...] = (1,)
    channels: tuple[str, ...] = ()
    force: Hook | None = None
    torque: Hook | None = None
    contact: Hook | None = None
    release: Hook | None = None
    restitution: Hook | None = None
    start: Hook | None = None
    clock: Hook | None = None
    image: Hook | None = None
    lever: bool = False
    softer: bool = False


BOTH = (1, -1)


def _drag(a: float, f: Any) -> tuple[Array, Array]:
    coefficient = a * (np.maximum(f.reynolds, 1.0) / 4e4) ** -0.2
    k = -f.pressure_area * coefficient * f.speed
    return k * f.vx, k * f.vy


def _crisis(a: float, f: Any) -> tuple[Array, Array]:
    u = np.clip((f.speed - 2.4) / 2.2, 0.0, 1.0)
    k = f.pressure_area * a * u * u * (3.0 - 2.0 * u) * f.speed
    return k * f.vx, k * f.vy


def _lift(a: float, f: Any) -> tuple[Array, Array]:
    ratio = 0.5 * f.diameter * abs(a) / f.speed
    k = np.sign(a) * f.pressure_area * 0.6 * (1.0 - np.exp(-2.2 * ratio)) * f.speed
    return -k * f.vy, k * f.vx


def _draught(a: float, f: Any) -> tuple[Array, Array]:
    wind = a * np.log1p(np.maximum(f.y, 0.0) / 0.05) / np.log1p(10.0)
    ux, k = f.vx - wind, -f.pressure_area * f.drag_coefficient
    moving = np.hypot(ux, f.vy)
    return k * (moving * ux - f.speed * f.vx), k * (moving - f.speed) * f.vy


def _lighter(a: float, f: Any) -> tuple[Array, Array]:
    air = a * f.density * np.pi / 6.0 * f.diameter**3
    k = -f.pressure_area * f.drag_coefficient * f.speed / f.mass
    return -0.5 * air * k * f.vx, air * f.gravity - 0.5 * air * (k * f.vy - f.gravity)


def _seam(a: float, f: Any) -> tuple[Array, Array]:
    k = f.pressure_area * a * np.cos(1.5 * f.time) * f.speed
    return -k * f.vy, k * f.vx


def _greased(a: float, phi: Array, omega: Array) -> Array:
    return -a * (0.8 + 0.2 * np.sqrt(np.abs(omega))) * np.tanh(omega / 2e-3)


def _oil(a: float, phi: Array, omega: Array) -> Array:
    return -a * omega * (np.abs(omega) + 1e-6) ** -0.15


def _board(a: float, phi: Array, omega: Array) -> Array:
    return -a * omega * (np.abs(omega) + 1e-6) ** 0.75


def _rubbing(a: float, c: Any) -> tuple[Array, Array, Array]:
    """Stribeck friction under the load left by the push, until lift-off."""
    load = np.maximum(c.mass * c.gravity - c.push * c.normal_y, 0.0) * (c.rise < 1e-4)
    friction = a * (0.7 + 0.3 * np.exp(-np.abs(c.vx) / 0.3)) * load * np.tanh(c.vx / 0.02)
    return -friction, 0.0 * friction, 0.0 * friction


def _rough_face(a: float, c: Any) -> tuple[Array, Array, Array]:
    """The push rotated about the ball's centre, with sliding friction of the face."""
    turn = -np.arcsin(np.clip(2.0 * a / c.diameter, -0.9, 0.9))
    cosine, sine = np.cos(turn) - 1.0, np.sin(turn)
    sliding = -c.vx * c.normal_y + c.vy * c.normal_x
    rub = -0.08 * c.push * np.tanh(sliding / 0.05) * np.minimum(abs(turn) / 0.02, 1.0)
    fx = c.push * (cosine * c.normal_x - sine * c.normal_y) - rub * c.normal_y
    fy = c.push * (sine * c.normal_x + cosine * c.normal_y) + rub * c.normal_x
    return fx, fy, 0.0 * fx


def _kick(a: float, r: Any) -> None:
    gained = a * np.sqrt(r.impact_speed)
    r.vy = r.vy + gained
    r.y = r.y + 0.35 * gained * r.contact_time


def _yielding(a: float, r: Any) -> None:
    kept = 1.0 - a * r.impact_speed / 2.5
    r.vx, r.vy, r.omega = r.vx * kept, r.vy * kept, r.omega * kept


def _bent_lens(a: float, x: Array, y: Array, rest_y: float) -> tuple[Array, Array]:
    dx, dy = x - 0.9, y - 0.55
    square = dx**2 + dy**2
    k = a * square * (1.0 - 0.12 * square)
    return x + k * dx, y + k * dy


def _twisted(a: float, x: Array, y: Array, rest_y: float) -> tuple[Array, Array]:
    dx, dy = x - 0.7, y - 0.5
    turn = a * (1.0 + 0.3 * dx)
    return 0.7 + dx - np.sin(turn) * dy, 0.5 + dy + np.sin(turn) * dx


def _leaning_plane(a: float, x: Array, y: Array, rest_y: float) -> tuple[Array, Array]:
    k = a * (1.0 + 0.15 * x)
    return x + k * (x - 1.0), y + k * (y - 0.6)


def _two_gaps(a: float, time: Array) -> Array:
    return np.asarray(time + a * ((time > 0.06) + 0.6 * (time > 0.15)))


NAMED: tuple[Law, ...] = (
    Law("drag", "drag", "flight", "C_D falls with Re to the power 0.2", 0.02, 0.4, BOTH,
        ALONG, force=_drag),
    Law("crisis", "drag_crisis", "flight", "C_D falls along a cubic from 2.4 to 4.6 m/s",
        0.02, 0.35, (1,), ALONG, force=_crisis),
    Law("lift", "magnus", "flight", "C_L = 0.6 (1 - exp(-2.2 S))", 0.5, 60.0, BOTH,
        UPWARD, force=_lift),
    Law("draught", "wind", "flight", "a logarithmic profile above the floor", 0.05, 3.0, BOTH,
        ALONG, force=_draught),
    Law("lighter", "buoyancy", "flight", "displaced and added mass of air", 0.1, 1.5, (1,),
        UPWARD, force=_lighter),
    Law("seam", "asymmetric_wake", "flight", "a side force that rotates with a slow spin",
        0.01, 0.3, BOTH, UPWARD, force=_seam),
    Law("softening", "velocity_dependent_cor", "contact", "e falls in a step at 2.5 m/s",
        0.003, 0.1, BOTH, restitution=lambda a, v, order: 1.0 - a * np.tanh((v - 2.5) / 1.2)),
    Law("arm", "effective_mass", "contact", "another lever arm throughout the contact",
        0.003, 0.08, BOTH, lever=True),
    Law("rough_face", "oblique_impact", "contact", "a push rotated about the centre, with sliding"
        " friction", 0.001, 0.03, BOTH, contact=_rough_face),
    Law("rubbing", "support_friction", "contact",
        "Stribeck friction under the load left by the push", 0.1, 2.0, (1,), contact=_rubbing),
    Law("kick", "support_recoil", "contact", "an impulse proportional to the root of the speed",
        0.003, 0.15, BOTH, release=_kick),
    Law("yielding", "pivot_recoil", "contact", "a loss fraction that grows with the speed",
        0.003, 0.1, (1,), release=_yielding),
    Law("softer", "contact_displacement", "contact", "a softer ball, longer in contact", 0.02, 0.4,
        BOTH, softer=True),
    Law("greased", "bearing_friction", "swing", "dry, plus a fifth with the root of the rate",
        0.02, 0.8, (1,), ("angle",), torque=_greased),
    Law("oil", "viscous_damping", "swing", "torque with the rate to the power 0.85", 0.01, 0.5,
        (1,), ("angle",), torque=_oil),
    Law("board", "pendulum_drag", "swing", "torque with the rate to the power 1.75", 0.005, 0.3,
        (1,), ("angle",), torque=_board),
    Law("eccentric", "backswing_offset", "swing", "a protractor off the axle", 0.002, 0.07,
        BOTH, start=lambda a, angle: angle + a * np.cos(0.5 * angle)),
    Law("drifting_rate", "time_base", "measurement",
        "a rate error that drifts by a tenth", 0.0005, 0.05,
        BOTH, clock=lambda a, t: t / (1.0 + a * (1.0 + 0.2 * t))),
    Law("uneven_scale", "length_scale", "measurement", "pixels that are not square", 0.001, 0.06,
        BOTH, image=lambda a, x, y, rest_y: (x * (1.0 + a), y * (1.0 + 0.92 * a))),
    Law("twisted", "camera_roll", "measurement",
        "roll about the image centre that grows along x", 0.001, 0.06, BOTH, image=_twisted),
    Law("bent_lens", "lens_distortion", "measurement", "third and fifth order", 0.001, 0.1, BOTH,
        image=_bent_lens),
    Law("leaning_plane", "parallax", "measurement", "a tilted plane of flight", 0.001, 0.12,
        BOTH, image=_leaning_plane),
    Law("two_gaps", "dropped_frames", "measurement",
        "two gaps of different length", 2e-4, 0.01, (1,),
        clock=_two_gaps),
)  # fmt: skip


def _power(a: float, f: Any) -> tuple[Array, Array]:
    k = -a * f.speed**0.35
    return k * f.vx, k * f.vy


def _cubic(a: float, f: Any) -> tuple[Array, Array]:
    k = -a * f.speed**2.2
    return k * f.vx, k * f.vy


def _pull(a: float, f: Any) -> tuple[Array, Array]:
    dx, dy = (0.55 - f.x) / 0.09, (0.35 - f.y) / 0.09
    size = a / (1.0 + dx**2 + dy**2) ** 2
    return size * dx, size * dy


def _puff(a: float, f: Any) -> tuple[Array, Array]:
    u = np.clip((f.time - 0.08) / 0.09, 0.0, 1.0)
    return a * np.sin(np.pi * u) ** 2, 0.0 * f.x


def _flutter(a: float, f: Any) -> tuple[Array, Array]:
    swing = np.sin(2.0 * np.pi * f.time / 0.35 * (1.0 + f.time / 0.4))
    return a * swing * np.exp(-f.time / 0.4) + 0.0 * f.x, 0.0 * f.x


def _cushion(a: float, f: Any) -> tuple[Array, Array]:
    height = np.maximum(f.y - 0.5 * f.diameter, 0.0)
    return 0.0 * f.x, a / (1.0 + height / 0.06) ** 2


def _ramp(a: float, f: Any) -> tuple[Array, Array]:
    return -a * np.maximum(f.x - 0.4, 0.0), 0.0 * f.x


def _catch(a: float, phi: Array, omega: Array) -> Array:
    return a / (1.0 + ((phi + 0.3) / 0.04) ** 2) ** 2


UNNAMED: tuple[Law, ...] = (
    Law("power", "unnamed", "flight", "speed to the power 1.35", 0.003, 1.0, (1,), ALONG,
        force=_power),
    Law("cubic", "unnamed", "flight", "speed to the power 3.2", 0.0005, 0.2, (1,), ALONG,
        force=_cubic),
    Law("pull", "unnamed", "flight", "a pull that falls as the fourth power beyond 9 cm",
        0.02, 5.0, BOTH, EITHER, force=_pull),
    Law("puff", "unnamed", "flight", "a squared sine of 90 ms", 0.02, 3.0, BOTH, ALONG,
        force=_puff),
    Law("flutter", "unnamed", "flight", "a decaying chirp", 0.02, 3.0, BOTH, ALONG,
        force=_flutter),
    Law("cushion", "unnamed", "flight", "an inverse square of the height", 0.05, 4.0, BOTH,
        UPWARD, force=_cushion),
    Law("ramp", "unnamed", "flight", "a force that grows with the distance beyond 40 cm", 0.02, 3.0,
        (1,), ALONG, force=_ramp),
    Law("catch", "unnamed", "swing", "a squared Lorentzian in the angle", 0.05, 4.0, BOTH,
        ("angle",), torque=_catch),
    Law("setting", "unnamed", "across_trials",
        "e approaches a limit over the trials", 0.002, 0.1, BOTH,
        restitution=lambda a, v, order: 1.0 + a * (np.exp(-3.0 * (order + 0.5)) - 0.32)),
)  # fmt: skip
