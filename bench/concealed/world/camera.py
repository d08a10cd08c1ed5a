"""How the concealed world's camera, clock and rulers err."""

from dataclasses import dataclass

import numpy as np

from bench.concealed.world.shots import Array

__all__ = ["CameraFaults"]

# Height of the picture in the ball's plane: a rolling shutter runs down it once a frame.
VIEW_HEIGHT = 1.2
LENS_RADIUS = 1.5


@dataclass(frozen=True)
class CameraFaults:
    """Faults of one campaign's measurement; all zero is a perfect one."""

    rate_error: float = 0.0
    """True capture rate is nominal * (1 + rate_error)."""
    scale_error: float = 0.0
    """Lengths read (1 + scale_error) too long, about the world's origin."""
    roll: float = 0.0
    """The picture is turned by this angle (rad, counter-clockwise) about (`pole_x`, `pole_y`)."""
    pole_x: float = 0.0
    pole_y: float = 0.0
    parallax: float = 0.0
    """The ball's image on the wall is enlarged by this fraction about `axis_foot`."""
    axis_foot: tuple[float, float] = (1.0, 0.6)
    lens: float = 0.0
    """Radial distortion left over: radius grows by lens * (r / 1.5 m)^2 about `axis_foot`."""
    readout: float = 0.0
    """Seconds that the rolling shutter needs from the top to the bottom of the view."""
    origin: float = 0.0
    """Offset of the origin (m) along `origin_direction` (rad)."""
    origin_direction: float = 0.0
    gap_frames: float = 0.0
    """Frames lost without the counter noticing, once in each trial."""
    gap_instant: float = -1.0
    """When, s after the first touch; negative for an instant of its own in each trial."""

    def true_times(self, elapsed: Array, hiccup: float, nominal_fps: float) -> Array:
        """True time (s after first touch) of samples `elapsed` s after it by the frame counter."""
        instant = hiccup if self.gap_instant < 0 else self.gap_instant
        late = self.gap_frames / nominal_fps * (elapsed > instant)
        return elapsed / (1 + self.rate_error) + late

    def row_delay(self, height: Array, rest_height: float) -> Array:
        """Time (s) by which the row at `height` (m) is read after the one of the ball at rest."""
        return self.readout * (rest_height - height) / VIEW_HEIGHT

    def seen(self, place: Array) -> Array:
        """Positions (n, 2) as read from the picture, without noise."""
        foot = np.array(self.axis_foot)
        off_axis = place - foot
        off_axis = off_axis * (1 + self.parallax)
        radius = np.hypot(off_axis[:, 0], off_axis[:, 1])
        off_axis = off_axis * (1 + self.lens * (radius / LENS_RADIUS) ** 2)[:, None]
        scaled = (foot + off_axis) * (1 + self.scale_error)
        pole = np.array([self.pole_x, self.pole_y])
        c, s = np.cos(self.roll), np.sin(self.roll)
        turned = pole + (scaled - pole) @ np.array([[c, s], [-s, c]])
        shift = [np.cos(self.origin_direction), np.sin(self.origin_direction)]
        return np.asarray(turned + self.origin * np.array(shift), dtype=float)
