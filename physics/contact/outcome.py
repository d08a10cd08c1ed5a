"""What a contact leaves behind, and a table of such outcomes by impact speed."""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from physics.arrays import Number

__all__ = ["ContactOutcome"]


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
