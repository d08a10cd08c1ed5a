"""Impact speeds from drop heights, rebound heights and bounce times, with drag.

A ball that falls from rest obeys dv/dt = g − k v², one that rises dv/dt = −g − k v², with
k = ρ C_D(Re) A / (2 m). Both are integrated from the apex, where the speed is zero, by the
classical Runge-Kutta method; speeds, heights and times are then read from the same table.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from physics.air import Air, standard_drag
from physics.bodies import GRAVITY
from physics.domain import FloatArray

__all__ = ["FallingBall"]

_REBOUND_STEPS = 2000
"""Steps of the integration: the speed of a table-tennis ball changes by less than 1e-6 beyond."""

_FLIGHT_MARGIN = 1.5
"""Factor by which the table exceeds the time of free fall from the largest height."""


@dataclass(frozen=True)
class FallingBall:
    """A sphere that falls and rises vertically in air.

    Attributes
    ----------
    mass, diameter : float
        kg, m.
    longest : float
        Longest time of a fall or rise that is asked for, s.
    drag_factor : float
        Factor of the smooth sphere's drag coefficient; 0 without air.
    gravity : float
        m/s².
    """

    mass: float
    diameter: float
    air: Air
    longest: float
    drag_factor: float = 1.0
    gravity: float = GRAVITY

    def _deceleration(self, speed: float) -> float:
        """Drag over mass, m/s²."""
        if speed <= 0.0 or self.drag_factor == 0.0:
            return 0.0
        drag = float(standard_drag(self.air.reynolds(speed, self.diameter)))
        area = 0.25 * np.pi * self.diameter**2
        force = 0.5 * self.air.density * self.drag_factor * drag * area * speed**2
        return float(force / self.mass)

    def _from_apex(self, sign: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times, speeds and heights below the apex; sign −1 falling, +1 rising (in reverse)."""
        step = _FLIGHT_MARGIN * self.longest / _REBOUND_STEPS
        speed = np.zeros(_REBOUND_STEPS + 1)
        height = np.zeros(_REBOUND_STEPS + 1)

        def slope(v: float) -> float:
            return self.gravity + sign * self._deceleration(v)

        for i in range(_REBOUND_STEPS):
            v = speed[i]
            k1 = slope(v)
            k2 = slope(v + 0.5 * step * k1)
            k3 = slope(v + 0.5 * step * k2)
            k4 = slope(v + step * k3)
            speed[i + 1] = v + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            height[i + 1] = height[i] + step * (v + step / 6.0 * (k1 + k2 + k3))
        times: FloatArray = np.linspace(0.0, step * _REBOUND_STEPS, _REBOUND_STEPS + 1)
        return times, speed, height

    @cached_property
    def _fall(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self._from_apex(-1.0)

    @cached_property
    def _rise(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self._from_apex(1.0)

    def speed_after_fall(self, height: FloatArray) -> FloatArray:
        """Speed at the ground after a fall from rest, m/s."""
        _, speed, heights = self._fall
        # the speed is nearly proportional to the root of the height
        return np.interp(np.sqrt(height), np.sqrt(heights), speed)

    def speed_of_rise(self, height: FloatArray) -> FloatArray:
        """Speed at the ground of a ball that rises to a height, m/s."""
        _, speed, heights = self._rise
        return np.interp(np.sqrt(height), np.sqrt(heights), speed)

    def height_of_flight(self, time: FloatArray) -> FloatArray:
        """Height reached between two bounces so long apart, m."""
        falling, _, below = self._fall
        rising, _, above = self._rise
        root = np.sqrt(above)
        total = rising + np.interp(root, np.sqrt(below), falling)
        return np.interp(time, total, root) ** 2
