"""What a contact leaves behind, and a table of such outcomes by impact speed."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from scipy.interpolate import PchipInterpolator

from metrology import DomainError
from physics.arrays import FloatArray, Number

__all__ = ["ContactOutcome", "OutcomeTable"]


@dataclass(frozen=True)
class ContactOutcome:
    """The state at release, with floats or with arrays of one entry per contact.

    Attributes
    ----------
    impact_speed : float or array
        Speed of the contact point at onset, ω₀ L, m/s.
    cor : float or array
        Separation speed along the face's normal at release over `impact_speed`.
    contact_time : float or array
        s.
    pendulum_speed_after : float or array
        ω₁ L at release, m/s.
    pendulum_angle : float or array
        φ at release, rad.
    ball_x, ball_y : float or array
        Ball's centre at release, m; x from its rest position, y from the floor.
    ball_vx, ball_vy : float or array
        Its velocity, m/s.
    ball_spin : float or array
        About z, counter-clockwise positive, rad/s.
    """

    impact_speed: Number
    cor: Number
    contact_time: Number
    pendulum_speed_after: Number
    pendulum_angle: Number
    ball_x: Number
    ball_y: Number
    ball_vx: Number
    ball_vy: Number
    ball_spin: Number = 0.0

    @property
    def ball_speed(self) -> Number:
        """Speed of the ball at release, m/s."""
        return np.hypot(self.ball_vx, self.ball_vy)

    @property
    def launch_angle(self) -> Number:
        """Direction of the ball's velocity above the horizontal, rad."""
        return np.arctan2(self.ball_vy, self.ball_vx)

    def at(self, index: int) -> Self:
        """One contact of a batch, as floats."""
        values = {
            f.name: float(np.ravel(getattr(self, f.name))[index])
            if np.ndim(getattr(self, f.name))
            else getattr(self, f.name)
            for f in fields(self)
        }
        return type(self)(**values)


class OutcomeTable:
    """Contact outcomes interpolated by impact speed (monotone cubic, scipy's PCHIP).

    Parameters
    ----------
    outcomes : ContactOutcome
        Arrays of at least two contacts, by increasing impact speed, m/s.

    Raises
    ------
    DomainError
        If there are fewer than two, or the speeds do not increase.
    """

    def __init__(self, outcomes: ContactOutcome) -> None:
        speed = np.atleast_1d(np.asarray(outcomes.impact_speed, dtype=np.float64))
        if speed.size < 2 or np.any(np.diff(speed) <= 0.0):
            raise DomainError(
                "a table of contact outcomes needs two or more impact speeds, in increasing order"
            )
        self.outcomes = outcomes
        self.range = (float(speed[0]), float(speed[-1]))
        names = [f.name for f in fields(ContactOutcome) if f.name != "impact_speed"]
        self._names = names
        columns = np.stack(
            [np.broadcast_to(getattr(outcomes, name), speed.shape) for name in names], axis=-1
        )
        self._curve = PchipInterpolator(speed, columns, extrapolate=True)

    def __call__(self, impact_speed: float | FloatArray) -> ContactOutcome:
        """Outcome at `impact_speed` (m/s, float or array); beyond `range` it is extrapolated."""
        values = self._curve(impact_speed)
        scalar = np.ndim(impact_speed) == 0
        columns = {
            name: float(values[..., i]) if scalar else values[..., i]
            for i, name in enumerate(self._names)
        }
        return ContactOutcome(impact_speed=impact_speed, **columns)

    def covers(self, impact_speed: float) -> bool:
        """Whether `impact_speed` lies inside the table."""
        return self.range[0] <= impact_speed <= self.range[1]
