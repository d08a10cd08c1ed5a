"""Integrate swing, contact and flight of the second world with scipy."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from bench.concealed.second.laws import Law

__all__ = ["Concealed", "Motion", "Shots", "collide", "move"]

Array = NDArray[np.float64]
Concealed = tuple[tuple[Law, float], ...]
TOLERANCE = 1e-9
EXPONENT = 1.5
FOLLOWED = 0.2
"""s; the pendulum is integrated this long after release."""


@dataclass(frozen=True)
class Shots:
    """A batch of shots; every field (n,), SI, angles in rad."""

    mass: Array
    diameter: Array
    contact_angle: Array
    stiffness: Array
    cor: tuple[Array, Array]
    length: Array
    inertia: Array
    weight_arm: Array
    rest_y: Array
    density: Array
    viscosity: Array
    drag_coefficient: Array
    backswing: Array
    cor_extra: Array
    tilt: Array
    order: Array
    gravity: float = 9.806

    def __len__(self) -> int:
        return len(self.mass)


@dataclass(frozen=True)
class Motion:
    """Trajectories of each shot as splines of the time since first contact."""

    release: Any
    landing: Array
    pendulum: tuple[CubicSpline, ...]
    ball: tuple[CubicSpline, ...]
    rest_y: Array

    def ball_at(self, time: Array, shot: int) -> Array:
        """(n, 2) m; at rest before contact, on a line until release."""
        gap = float(self.release.contact_time[shot])
        rest = np.array([0.0, self.rest_y[shot]])
        flown = self.ball[shot](np.maximum(time - gap, 0.0))
        share = np.clip(time / gap, 0.0, 1.0)[:, None]
        carried = rest + share * (self.ball[shot](0.0) - rest)
        return np.where((time < gap)[:, None], carried, flown)

    def angle_at(self, time: Array, shot: int) -> Array:
        """(n,) rad."""
        return np.asarray(self.pendulum[shot](time))


def _restitution_table() -> tuple[Array, Array]:
    """Restitution of a Kuwabara–Kono contact as a function of its scaled damping."""
    damping = np.linspace(0.0, 1.2, 49)

    def rate(_: float, state: Array) -> Array:
        depth, speed = state.reshape(2, -1)
        root = np.sqrt(np.maximum(depth, 0.0))
        force = np.maximum(root**3 + damping * root * speed, 0.0) * (depth > 0.0)
        return np.concatenate([speed, -force])

    start = np.concatenate([np.zeros(49), np.ones(49)])
    end = solve_ivp(rate, (0.0, 9.0), start, rtol=1e-8, atol=1e-10, method="DOP853").y[:, -1]
    return damping, -end[49:]


DAMPING, RESTITUTION = _restitution_table()


def _torque(shots: Shots, concealed: Concealed, phi: Array, omega: Array) -> Array:
    total = -shots.weight_arm * shots.gravity * np.sin(phi)
    for law, a in concealed:
        if law.torque is not None:
            total = total + law.torque(a, phi, omega)
    return total


def _swing(shots: Shots, concealed: Concealed, start: Array, seconds: float) -> tuple[Array, Array]:
    n = len(shots)

    def rate(_: float, state: Array) -> Array:
        phi, omega = state.reshape(2, n)
        return np.concatenate([omega, _torque(shots, concealed, phi, omega) / shots.inertia])

    times = np.linspace(0.0, seconds, max(int(seconds / 1e-3), 8))
    solved = solve_ivp(
        rate, (0.0, seconds), start.reshape(-1), t_eval=times, rtol=TOLERANCE, atol=1e-10,
        max_step=0.02,
    )  # fmt: skip
    return times, solved.y.reshape(2, n, -1)


def _fall(shots: Shots, concealed: Concealed) -> tuple[Array, Array, Array, Array]:
    """Times, states (2, n, k), time of first contact (n,) and angular velocity there (n,)."""
    backswing = shots.backswing
    for law, a in concealed:
        if law.start is not None:
            backswing = law.start(a, backswing)
    period = 2.0 * np.pi * np.sqrt(shots.inertia / (shots.weight_arm * shots.gravity))
    start = np.stack([-backswing, np.zeros(len(shots))])
    times, path = _swing(shots, concealed, start, 0.62 * float(period.max()) + 0.1)
    touch = np.empty(len(shots))
    speed = np.empty(len(shots))
    for i in range(len(shots)):
        spline = CubicSpline(times, path[:, i].T)
        first = int(np.argmax(path[0, i] > shots.contact_angle[i]))
        low, high = times[first - 1], times[first]
        for _ in range(48):
            middle = 0.5 * (low + high)
            below = spline(middle)[0] < shots.contact_angle[i]
            low, high = (middle, high) if below else (low, middle)
        touch[i], speed[i] = low, spline(low)[1]
    return times, path, touch, speed


def collide(shots: Shots, omega: Array, concealed: Concealed) -> Any:
    """The contact and the state at release."""
    n = len(shots)
    lever, stiffness = shots.length, shots.stiffness
    for law, a in concealed:
        lever = lever * (1.0 + a) if law.lever else lever
        stiffness = stiffness * (1.0 + a) ** -2.5 if law.softer else stiffness
    impact = lever * omega
    reduced = 1.0 / (1.0 / shots.mass + lever**2 / shots.inertia)
    target = shots.cor[0] * np.exp(-0.27 * impact) + shots.cor[1]
    for law, a in concealed:
        if law.restitution is not None:
            target = target * law.restitution(a, impact, shots.order)
    target = target + shots.cor_extra
    depth = (reduced * impact**2 / stiffness) ** (1.0 / (EXPONENT + 1.0))
    scaled = np.interp(-target, -RESTITUTION, DAMPING)
    damping = scaled * stiffness * depth / impact
    end = float((4.2 * depth / impact).max())

    def parts(state: Array) -> tuple[Array, ...]:
        phi, rate, x, y, vx, vy = state.reshape(6, n)
        direction = phi + shots.tilt
        nx, ny = np.cos(direction), np.sin(direction)
        along = x * nx + (y - shots.rest_y) * ny
        squeezed = lever * (phi - shots.contact_angle) - along
        closing = lever * rate - vx * nx - vy * ny
        return phi, rate, x, y, vx, vy, nx, ny, squeezed, closing

    def motion(_: float, state: Array) -> Array:
        phi, rate, _x, y, vx, vy, nx, ny, squeezed, closing = parts(state)
        root = np.sqrt(np.maximum(squeezed, 0.0))
        push = np.maximum(stiffness * root**3 + damping * root * closing, 0.0) * (squeezed > 0.0)
        fx, fy, torque = push * nx, push * ny, -push * lever
        here = SimpleNamespace(
            push=push, normal_x=nx, normal_y=ny, vx=vx, vy=vy, rise=y - shots.rest_y,
            mass=shots.mass, gravity=shots.gravity, diameter=shots.diameter,
        )  # fmt: skip
        for law, a in concealed:
            if law.contact is not None:
                more = law.contact(a, here)
                fx, fy, torque = fx + more[0], fy + more[1], torque + more[2]
        ay = fy / shots.mass - shots.gravity
        ay = np.where((y <= shots.rest_y + 1e-9) & (ay < 0.0), 0.0, ay)
        turning = (_torque(shots, concealed, phi, rate) + torque) / shots.inertia
        return np.concatenate([rate, turning, vx, vy, fx / shots.mass, ay])

    start = np.stack([shots.contact_angle, omega, np.zeros(n), shots.rest_y, *np.zeros((2, n))])
    times = np.linspace(0.0, end, 500)
    solved = solve_ivp(
        motion, (0.0, end), start.reshape(-1), t_eval=times, rtol=1e-7, atol=1e-9,
        max_step=end / 150,
    ).y.reshape(6, n, -1)  # fmt: skip
    return _released(shots, impact, times, solved, parts, concealed)


def _released(
    shots: Shots, impact: Array, times: Array, path: Array, parts: Any, concealed: Concealed
) -> Any:
    n = len(shots)
    squeezed = np.stack([parts(path[:, :, k].reshape(-1))[8] for k in range(len(times))], axis=1)
    gap, states = np.empty(n), np.empty((6, n))
    for i in range(n):
        apart = int(np.argmax(squeezed[i, 2:] <= 0.0)) + 2
        part = slice(apart - 2, apart + 2)
        gap[i] = np.interp(0.0, -squeezed[i, part], times[part])
        states[:, i] = CubicSpline(times[part], path[:, i, part].T)(gap[i])
    closing = parts(states.reshape(-1))[9]
    release = SimpleNamespace(
        contact_time=gap, phi=states[0], omega=states[1], x=states[2], y=states[3],
        vx=states[4], vy=states[5], impact_speed=impact, cor=-closing / impact,
    )  # fmt: skip
    for law, a in concealed:
        if law.release is not None:
            law.release(a, release)
    return release


def _fly(shots: Shots, concealed: Concealed, release: Any) -> tuple[Array, Array]:
    n = len(shots)

    def rate(time: float, state: Array) -> Array:
        x, y, vx, vy = state.reshape(4, n)
        speed = np.hypot(vx, vy) + 1e-9
        area = 0.5 * shots.density * np.pi / 4.0 * shots.diameter**2
        here = SimpleNamespace(
            time=time, x=x, y=y, vx=vx, vy=vy, speed=speed, pressure_area=area, mass=shots.mass,
            diameter=shots.diameter, density=shots.density, gravity=shots.gravity,
            drag_coefficient=shots.drag_coefficient,
            reynolds=shots.density * speed * shots.diameter / shots.viscosity,
        )  # fmt: skip
        k = -area * shots.drag_coefficient * speed
        fx, fy = k * vx, k * vy
        for law, a in concealed:
            if law.force is not None:
                more = law.force(a, here)
                fx, fy = fx + more[0], fy + more[1]
        return np.concatenate([vx, vy, fx / shots.mass, fy / shots.mass - shots.gravity])

    start = np.concatenate([release.x, release.y, release.vx, release.vy])
    climb = np.maximum(release.vy, 0.0)
    seconds = (climb + np.sqrt(climb**2 + 2.0 * shots.gravity * release.y)) / shots.gravity
    end = 1.25 * float(seconds.max()) + 0.05
    times = np.linspace(0.0, end, int(end / 1.5e-3))
    solved = solve_ivp(
        rate, (0.0, end), start, t_eval=times, rtol=TOLERANCE, atol=1e-10, max_step=0.01
    )
    return times, solved.y.reshape(4, n, -1)


def move(shots: Shots, concealed: Concealed = ()) -> Motion:
    """Whole shots."""
    times, path, touch, omega = _fall(shots, concealed)
    release = collide(shots, omega, concealed)
    later, after = _swing(shots, concealed, np.stack([release.phi, release.omega]), FOLLOWED)
    air, flight = _fly(shots, concealed, release)
    pendulum, ball, landing = [], [], np.empty(len(shots))
    for i in range(len(shots)):
        before = times < touch[i] - 2e-3
        knots = np.concatenate([times[before] - touch[i], [0.0], release.contact_time[i] + later])
        angles = np.concatenate([path[0, i, before], [shots.contact_angle[i]], after[0, i]])
        pendulum.append(CubicSpline(knots, angles))
        ball.append(CubicSpline(air, flight[:2, i].T))
        low = int(np.argmax(flight[1, i] < 0.5 * shots.diameter[i]))
        landing[i] = release.contact_time[i] + np.interp(
            -0.5 * shots.diameter[i], -flight[1, i, low - 1 : low + 1], air[low - 1 : low + 1]
        )
    return Motion(release, landing, tuple(pendulum), tuple(ball), shots.rest_y)
