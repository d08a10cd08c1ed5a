"""The paper's flight in closed form (Eqs 13 to 16): horizontal drag, no vertical drag."""

from dataclasses import dataclass

import numpy as np

from metrology import DomainError
from physics.bodies import GRAVITY, Ball
from physics.domain import Number, require_non_negative, require_positive
from physics.flight.air import Air

__all__ = ["Landing", "Launch", "drag_constant", "drag_free_distance", "land"]


@dataclass(frozen=True)
class Launch:
    """Where and how the ball leaves, in the paper's reading of the contact.

    Attributes
    ----------
    speed : float or array
        v_B, m/s.
    angle : float or array
        θ above the horizontal, rad.
    advance : float or array
        v_M^avg Δt: how far the ball was carried along θ during contact, m.
    """

    speed: Number
    angle: Number
    advance: Number


@dataclass(frozen=True)
class Landing:
    """Flight time (s) and distance of the centre from its rest position (m); floats or arrays."""

    time: Number
    distance: Number


def drag_constant(ball: Ball, air: Air, drag_coefficient: Number) -> Number:
    """K = ρ S C_D / (2 m), 1/m."""
    require_non_negative("the drag coefficient", drag_coefficient)
    return 0.5 * air.density * ball.area / ball.mass * drag_coefficient


def _dragged(distance: Number, constant: Number) -> Number:
    """ln(1 + K d) / K, exact as K → 0."""
    product = np.asarray(constant * distance, dtype=np.float64)
    small = np.abs(product) < 1e-5
    safe = np.where(small, 1.0, product)
    series = 1.0 - product / 2.0 + product**2 / 3.0
    result: Number = distance * np.where(small, series, np.log1p(safe) / safe)
    return result


def drag_free_distance(distance: Number, constant: Number) -> Number:
    """(exp(K d) − 1) / K, m, exact as K → 0: the distance without drag in the same time."""
    product = np.asarray(constant * distance, dtype=np.float64)
    small = np.abs(product) < 1e-5
    safe = np.where(small, 1.0, product)
    series = 1.0 + product / 2.0 + product**2 / 6.0
    result: Number = distance * np.where(small, series, np.expm1(safe) / safe)
    return result


def land(
    launch: Launch, support_height: Number, constant: Number, gravity: float = GRAVITY
) -> Landing:
    """Landing by Eqs 15 (with its bracket put right) and 16.

    t = (v sin θ + √((v sin θ)² + 2 g (h_s + a sin θ))) / g,
    x = ln(1 + K v cos θ t) / K + a cos θ, with a the advance during contact.

    Parameters
    ----------
    launch : Launch
    support_height : float or array
        h_s: how far the ball's lowest point falls to the floor, m.
    constant : float or array
        K, 1/m; 0 is allowed.
    gravity : float
        m/s².

    Returns
    -------
    Landing

    Raises
    ------
    DomainError
        If there is no gravity, or the ball starts below the floor.
    """
    require_positive("gravity", gravity, "m/s^2")
    require_non_negative("the drag constant", constant, "1/m")
    rise = launch.speed * np.sin(launch.angle)
    height = support_height + launch.advance * np.sin(launch.angle)
    under_root = rise * rise + 2.0 * gravity * height
    if np.any(under_root < 0.0):
        raise DomainError("the ball starts below the floor and never reaches it")
    time: Number = (rise + under_root**0.5) / gravity
    along: Number = launch.speed * np.cos(launch.angle) * time
    if np.any(constant * along <= -1.0):
        raise DomainError("a ball launched backwards this fast has no closed-form path")
    return Landing(time, _dragged(along, constant) + launch.advance * np.cos(launch.angle))
