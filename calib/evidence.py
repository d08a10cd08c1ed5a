"""What is known about a scene besides its grid: taped distances, the ball's size, its free fall."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from metrology import Defaults

__all__ = ["BallOutlines", "Evidence", "FreeFall", "Known"]

FloatArray = NDArray[np.float64]

RADIUS_COMMON_STD_PX, RADIUS_COMMON_OVER_RANDOM = 0.05, 4.0
"""px, and times the random part: what all radii of a clip are off by together. What biases an
outline (shading, blur, compression) biases it in every frame, and more where a frame tells less of
it; radii of rendered and filmed balls of known size, `bench.tracking`."""


@dataclass(frozen=True)
class Known:
    """A number somebody measured, with its standard uncertainty."""

    value: float
    std: float


@dataclass(frozen=True, eq=False)
class BallOutlines:
    """Outlines of a ball of known size.

    Attributes
    ----------
    centre_px : (N, 2) array
        Centres of the outlines, px.
    radius_px : (N,) array
        Radii of the outlines, px.
    std_px : (N,) array
        Their independent standard uncertainties, px.
    diameter : Known
        Diameter of the ball, m.
    common_std_px : float
        What all radii may be off by together (blur, threshold, shading), px.
    """

    centre_px: FloatArray
    radius_px: FloatArray
    std_px: FloatArray
    diameter: Known
    common_std_px: float = RADIUS_COMMON_STD_PX

    @classmethod
    def followed(
        cls, centre_px: FloatArray, radius_px: FloatArray, std_px: FloatArray, diameter: Known
    ) -> Self:
        """Outlines as following a ball gives them, with what they are off by together."""
        common = np.hypot(RADIUS_COMMON_STD_PX, RADIUS_COMMON_OVER_RANDOM * np.median(std_px))
        return cls(centre_px, radius_px, std_px, diameter, float(common))


@dataclass(frozen=True, eq=False)
class FreeFall:
    """A stretch of free flight.

    Attributes
    ----------
    centre_px : (N, 2) array
        Centres of the ball's outline, px.
    time_s : (N,) array
        Times, s.
    std_px : (N,) array
        Standard uncertainty of each centre along one axis, px.
    acceleration : Known
        Mean downward acceleration to expect, m/s²: gravity, less what the air takes; its
        uncertainty holds that of the capture rate too.
    """

    centre_px: FloatArray
    time_s: FloatArray
    std_px: FloatArray
    acceleration: Known


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that may be known; every part optional.

    Attributes
    ----------
    rest_px : (2,) array or None
        Centre of the ball's outline at rest: the world's origin in x.
    rest_height : float
        Height of the ball's centre at rest above y = 0, m.
    ball_radius : float or None
        Radius of the ball, m, for the correction from outline centre to centre.
    camera_distance : Known or None
        Camera to wall, along the wall's normal, m.
    camera_x, camera_y : Known or None
        Where the camera stands, world coordinates, m.
    axis_foot_x, axis_foot_y : Known or None
        Where the optical axis meets the wall, world coordinates, m.
    ball_plane_offset : Known or None
        Ball plane in front of the wall by tape, m.
    outlines : BallOutlines or None
    fall : FreeFall or None
    pitch_relative_std : float
        Standard uncertainty of the grid's pitch over the pitch; not 0.
    """

    rest_px: FloatArray | None = None
    rest_height: float = 0.0
    ball_radius: float | None = None
    camera_distance: Known | None = None
    camera_x: Known | None = None
    camera_y: Known | None = None
    axis_foot_x: Known | None = None
    axis_foot_y: Known | None = None
    ball_plane_offset: Known | None = None
    outlines: BallOutlines | None = None
    fall: FreeFall | None = None
    pitch_relative_std: float = Defaults.GRID_PITCH.std

    @property
    def taped(self) -> bool:
        """Whether tape alone tells the scale of the ball plane: then a fall is left as a check."""
        return self.camera_distance is not None and self.ball_plane_offset is not None
