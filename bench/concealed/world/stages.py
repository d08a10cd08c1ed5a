"""Force laws and integration of swing, contact and flight."""

from dataclasses import dataclass

import numpy as np

from bench.concealed.world.shots import Array, Shots
from bench.concealed.world.solver import Path, first_crossing, integrate

__all__ = ["Contact", "collide", "cor_target", "flight_force", "fly", "swing_down", "swing_on"]

SWING_STEP = 1e-3
FLIGHT_STEP = 5e-4
WORLD_CONTACT_STEPS = 240
GUST_EDGE = 0.004


def _torque(shots: Shots, angle: Array, speed: Array) -> Array:
    """Torque on the pendulum about its axis, N m; dry friction is smoothed below 1 mrad/s."""
    notch = (angle - shots.notch_angle) / shots.notch_width
    return (
        -shots.pendulum_mass * shots.gravity * shots.com * np.sin(angle)
        - shots.dry_torque * np.tanh(speed / 1e-3)
        - shots.viscous_torque * speed
        - shots.quadratic_torque * speed * np.abs(speed)
        + shots.notch_torque * np.exp(-0.5 * notch**2)
    )


def _swing_rate(shots: Shots, state: Array) -> Array:
    return np.stack([state[:, 1], _torque(shots, state[:, 0], state[:, 1]) / shots.inertia], axis=1)


def swing_down(shots: Shots) -> tuple[Path, Array]:
    """Swing from rest at the back-swing to first contact: trajectory and contact time."""
    start = np.stack([-shots.backswing, np.full(len(shots), 1e-9)], axis=1)
    path = integrate(
        lambda _, state: _swing_rate(shots, state),
        start,
        np.full(len(shots), SWING_STEP),
        4000,
        lambda _, state: bool((state[:, 0] > shots.contact_angle + 0.01).all()),
    )
    return path, first_crossing(path, lambda state: state[..., 0] - shots.contact_angle)


def swing_on(shots: Shots, start: Array, seconds: float) -> Path:
    """Swing after release from `start` (n, 2)."""
    steps = int(seconds / SWING_STEP) + 2
    return integrate(
        lambda _, state: _swing_rate(shots, state), start, np.full(len(shots), SWING_STEP), steps
    )


def cor_target(shots: Shots, impact_speed: Array) -> Array:
    """Coefficient of restitution the ball shows at an impact speed (n,)."""
    law = shots.cor_a * np.exp(shots.cor_b * impact_speed + shots.cor_c) + shots.cor_d
    return law + shots.cor_extra + shots.cor_slope * (impact_speed - 2.5)


@dataclass(frozen=True)
class Contact:
    """Trajectory of (angle, rate, x, y, vx, vy) during contact, and its final state."""

    path: Path
    release_time: Array
    release: Array
    impact_speed: Array
    cor: Array


def _anchor(shots: Shots, arm: Array, angle: Array) -> Array:
    """Centre of the striking face relative to the pivot, (2, n)."""
    return np.stack(
        [
            arm * np.sin(angle) + shots.face_offset * np.cos(angle),
            -arm * np.cos(angle) + shots.face_offset * np.sin(angle),
        ]
    )


def _geometry(shots: Shots, state: Array) -> tuple[Array, Array, Array, Array]:
    """Face normal (2, n), ball centre from the pivot (2, n), compression and its rate (n,)."""
    arm = shots.length * (1 + shots.arm_error)
    tilt = shots.tilt_extra + np.arcsin(shots.off_centre / shots.radius)
    first, angle, speed = shots.contact_angle, state[..., 0], state[..., 1]
    # The face is tilted about its anchor on the arm, so that first contact does not move.
    normal = np.stack([np.cos(angle + tilt), np.sin(angle + tilt)])
    anchor = _anchor(shots, arm, angle)
    touch = _anchor(shots, arm, first) + shots.radius * np.stack(
        [np.cos(first + tilt), np.sin(first + tilt)]
    )
    centre = np.stack(
        [
            state[..., 2] + touch[0],
            state[..., 3] - shots.support_height - shots.radius + touch[1],
        ]
    )
    compression = shots.radius - ((centre - anchor) * normal).sum(axis=0)
    rate = -(state[..., 4] * normal[0] + state[..., 5] * normal[1]) + speed * (
        normal[1] * centre[0] - normal[0] * centre[1]
    )
    return normal, centre, compression, rate


def _contact_rate(shots: Shots, damping: Array, stiffness: Array, state: Array) -> Array:
    normal, centre, compression, rate = _geometry(shots, state)
    squeezed = np.maximum(compression, 0.0)
    force = stiffness * squeezed**shots.force_exponent * np.maximum(1 + damping * rate, 0.0)
    lever = normal[1] * centre[0] - normal[0] * centre[1]
    angular = (_torque(shots, state[:, 0], state[:, 1]) - force * lever) / shots.inertia
    ax = force * normal[0] / shots.mass - shots.support_friction * shots.gravity
    ay = force * normal[1] / shots.mass - shots.gravity
    carried = (state[:, 3] <= shots.support_height + shots.radius + 1e-12) & (ay < 0)
    return np.stack(
        [state[:, 1], angular, state[:, 4], state[:, 5], ax, np.where(carried, 0.0, ay)], axis=1
    )


def _touch(shots: Shots, damping: Array, start: Array) -> Contact:
    impact_speed = start[:, 1] * shots.length * (1 + shots.arm_error)
    reduced = 1 / (1 / shots.mass + shots.length**2 / shots.inertia)
    # A longer contact is a softer ball: time scales as stiffness^(-1/(exponent + 1)).
    stiffness = shots.stiffness / (1 + shots.contact_stretch) ** (shots.force_exponent + 1)
    deepest = ((shots.force_exponent + 1) * reduced * impact_speed**2 / (2 * stiffness)) ** (
        1 / (shots.force_exponent + 1)
    )
    step = 4.4 * deepest / impact_speed / WORLD_CONTACT_STEPS
    path = integrate(
        lambda _, state: _contact_rate(shots, damping, stiffness, state),
        start,
        step,
        3 * WORLD_CONTACT_STEPS,
        lambda time, state: bool((_geometry(shots, state)[2] < -1e-6).all()),
    )
    time = first_crossing(path, lambda state: -_geometry(shots, state)[2])
    release = path.each_at(time)
    cor = -_geometry(shots, release)[3] / impact_speed
    return Contact(path, time, release, impact_speed, cor)


def collide(shots: Shots, touch_speed: Array) -> Contact:
    """The contact, its damping set so that the separation speed obeys the restitution law."""
    n = len(shots)
    start = np.zeros((n, 6))
    start[:, 0], start[:, 1] = shots.contact_angle, touch_speed
    start[:, 3] = shots.support_height + shots.radius
    speed = touch_speed * shots.length * (1 + shots.arm_error)
    target = cor_target(shots, speed)
    old = (1 - target) / (target * speed)
    contact = _touch(shots, old, start)
    old_error = contact.cor - target
    new = old + old_error / speed
    for _ in range(8):
        contact = _touch(shots, new, start)
        error = contact.cor - target
        if np.max(np.abs(error)) < 1e-8:
            break
        change = np.where(np.abs(error - old_error) > 1e-15, error - old_error, np.inf)
        old, new, old_error = new, new - error * (new - old) / change, error
    return _after_losses(shots, contact, touch_speed)


def _after_losses(shots: Shots, contact: Contact, touch_speed: Array) -> Contact:
    """Loss at release to a compliant pivot and a compliant support."""
    release = contact.release.copy()
    release[:, 1] -= shots.pivot_loss * (touch_speed - release[:, 1])
    release[:, 1] *= 1 - shots.shared_loss
    release[:, 4:6] *= ((1 - shots.support_loss) * (1 - shots.shared_loss))[:, None]
    # The impulse is spread over the contact: half of it has already moved the ball at release.
    kick = shots.support_kick * contact.impact_speed
    release[:, 3] += 0.5 * kick * contact.release_time
    release[:, 5] += kick
    return Contact(contact.path, contact.release_time, release, contact.impact_speed, contact.cor)


def flight_force(shots: Shots, time: Array, state: Array) -> Array:
    """Force (n, 2) on the ball in flight besides its weight; state (n, 4) is x, y, vx, vy."""
    area = np.pi * shots.radius**2
    pressure = 0.5 * shots.density * area
    air = state[:, 2:] - np.stack([shots.wind, np.zeros(len(shots))], axis=1)
    speed = np.hypot(air[:, 0], air[:, 1]) + 1e-12
    crisis = 1 / (1 + np.exp(-(speed - shots.crisis_speed) / (0.08 * shots.crisis_speed)))
    coefficient = shots.drag_coefficient - shots.crisis_drop * crisis
    force = -(pressure * coefficient * speed)[:, None] * air
    spin = shots.spin * np.exp(-shots.spin_decay_rate * time)
    lift = pressure * (shots.radius * spin + shots.wake_lift * speed)
    force += lift[:, None] * np.stack([-air[:, 1], air[:, 0]], axis=1)
    volume = 4 / 3 * np.pi * shots.radius**3
    force[:, 1] += shots.buoyancy * shots.density * volume * shots.gravity
    return force + _uncatalogued(shots, time, state)


def _uncatalogued(shots: Shots, time: Array, state: Array) -> Array:
    velocity = state[:, 2:]
    speed = np.hypot(velocity[:, 0], velocity[:, 1]) + 1e-12
    force = -(shots.power_force * speed ** (shots.power - 1))[:, None] * velocity
    away = np.stack([shots.magnet_x - state[:, 0], shots.magnet_y - state[:, 1]], axis=1)
    near = np.exp(-0.5 * (away**2).sum(axis=1) / shots.magnet_width**2) / shots.magnet_width
    force += (shots.magnet_force * near)[:, None] * away
    blown = 0.5 * (
        np.tanh((time - shots.gust_start) / GUST_EDGE)
        - np.tanh((time - shots.gust_start - shots.gust_length) / GUST_EDGE)
    )
    force[:, 0] += shots.gust_force * blown
    force[:, 1] += shots.ground_force * np.exp(
        -np.maximum(state[:, 1] - shots.radius, 0) / shots.ground_height
    )
    return force


def fly(shots: Shots, start: Array, longest: float = 3.0) -> tuple[Path, Array]:
    """Flight from `start` (n, 4) to the floor: trajectory and time."""

    def rate(time: Array, state: Array) -> Array:
        force = flight_force(shots, time, state) / shots.mass[:, None]
        force[:, 1] -= shots.gravity
        return np.concatenate([state[:, 2:], force], axis=1)

    path = integrate(
        rate,
        start,
        np.full(len(shots), FLIGHT_STEP),
        int(longest / FLIGHT_STEP),
        lambda _, state: bool((state[:, 1] < shots.radius - 1e-3).all()),
    )
    return path, first_crossing(path, lambda state: shots.radius - state[..., 1])
