"""Join swing, contact and flight on one clock that starts at first contact."""

from dataclasses import dataclass

import numpy as np

from bench.concealed.world.shots import Array, Shots
from bench.concealed.world.solver import Path
from bench.concealed.world.stages import Contact, collide, fly, swing_down, swing_on

__all__ = ["Motion", "move"]


@dataclass(frozen=True)
class Motion:
    """Positions of ball and pendulum of each shot at any time, s after first contact."""

    shots: Shots
    before: Path
    touch_time: Array
    contact: Contact
    after: Path
    flight: Path
    flight_time: Array

    @property
    def release_time(self) -> Array:
        """Release, s after first contact, (n,)."""
        return self.contact.release_time

    @property
    def landing_time(self) -> Array:
        """Landing, s after first contact, (n,)."""
        return self.contact.release_time + self.flight_time

    def ball(self, time: Array, body: int) -> Array:
        """Centre of the ball (len(time), 2) in one shot."""
        released = self.release_time[body]
        rest = [0.0, self.shots.support_height[body] + self.shots.radius[body]]
        place = np.tile(rest, (len(time), 1))
        touching = (time > 0) & (time <= released)
        place[touching] = self.contact.path.at(time[touching], body)[:, 2:4]
        flying = time > released
        place[flying] = self.flight.at(time[flying] - released, body)[:, :2]
        return place

    def pendulum(self, time: Array, body: int) -> Array:
        """Pendulum angle (len(time),) of one shot."""
        released = self.release_time[body]
        angle = np.empty(len(time))
        early, late = time <= 0, time > released
        touching = ~early & ~late
        angle[early] = self.before.at(time[early] + self.touch_time[body], body)[:, 0]
        angle[touching] = self.contact.path.at(time[touching], body)[:, 0]
        angle[late] = self.after.at(time[late] - released, body)[:, 0]
        return angle


def move(shots: Shots, follow: float = 0.2) -> Motion:
    """Integrate all shots; the pendulum for `follow` seconds after release."""
    before, touch = swing_down(shots)
    contact = collide(shots, before.each_at(touch)[:, 1])
    after = swing_on(shots, contact.release[:, :2], follow)
    flight, flight_time = fly(shots, contact.release[:, 2:])
    return Motion(shots, before, touch, contact, after, flight, flight_time)
