"""Errors of camera, clock and length scale in the concealed campaigns."""

from dataclasses import dataclass

import numpy as np

from bench.concealed.world.shots import Array

__all__ = ["CameraFaults"]

# Height of the field of view in the ball's plane, read once per frame by a rolling shutter.
VIEW_HEIGHT = 1.2
LENS_RADIUS = 1.5


@dataclass(frozen=True)
class CameraFaults:
    """Measurement errors of one campaign; all zero for none."""

    rate_error: float = 0.0
    """True capture rate is nominal * (1 + rate_error)."""
    scale_error: float = 0.0
    """Lengths are multiplied by 1 + scale_error about the origin."""
    roll: float = 0.0
    """The image is rotated by this angle (rad, counter-clockwise) about (`pole_x`, `pole_y`)."""
    pole_x: float = 0.0
    pole_y: float = 0.0
    parallax: float = 0.0
    """The ball's image on the wall is enlarged by this fraction about `axis_foot`."""
    axis_foot: tuple[float, float] = (1.0, 0.6)
    lens: float = 0.0
    """Residual radial distortion: radius grows by lens * (r / 1.5 m)^2 about `axis_foot`."""
    readout: float = 0.0
    """s; readout time of the rolling shutter over the height of the image."""
    origin: float = 0.0
    """Offset of the origin (m) along `origin_direction` (rad)."""
    origin_direction: float = 0.0
    gap_frames: float = 0.0
    """Frames lost without a gap in the frame counter, once in each trial."""
    gap_instant: float = -1.0
    """Time of the loss, s after first contact; negative for a random time in each trial."""

    def true_times(self, elapsed: Array, hiccup: float, nominal_fps: float) -> Array:
        """True time, s after first contact, of samples at counter times `elapsed` after it."""
        instant = hiccup if self.gap_instant < 0 else self.gap_instant
        late = self.gap_frames / nominal_fps * (elapsed > instant)
        return elapsed / (1 + self.rate_error) + late

    def row_delay(self, height: Array, rest_height: float) -> Array:
        """Delay, s, of the row at `height` (m) relative to the row of the ball at rest."""
        return self.readout * (rest_height - height) / VIEW_HEIGHT

    def seen(self, place: Array) -> Array:
        """Positions (n, 2) as measured in the image, without noise."""
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
