"""A body that swings about a pivot, as a camera sees it: the picture of a rotation in a plane.

Seen squarely, its points go round circles. Seen aslant, each circle is an ellipse; all of them
share the pivot and the view, a 2 × 2 matrix that is upper triangular, since turning and scaling the
plane of the swing in itself changes nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ImagedSwing"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ImagedSwing:
    """Where the points of a swinging body are seen.

    Attributes
    ----------
    pivot_px : (2,) array
        The pivot, px; in view or not.
    shear, stretch : float
        The view: a plane seen squarely has 0 and 1.
    centre_px : (2,) array
        The middle of the body in the reference picture, px.
    turns : bool
        Whether its look turns with the arm; that of a smooth sphere does not.
    """

    pivot_px: FloatArray
    shear: float
    stretch: float
    centre_px: FloatArray
    turns: bool

    @property
    def view(self) -> FloatArray:
        """From the plane of the swing to the picture, (2, 2)."""
        return np.array([[1.0, self.shear], [0.0, self.stretch]])

    def turning(self, angle: float) -> FloatArray:
        """The picture (2, 2) of a turn by `angle`, rad from +x towards +y in the plane."""
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        return np.asarray(self.view @ turn @ np.linalg.inv(self.view))

    def middle(self, angle: float) -> FloatArray:
        """Where the middle of the body is, (2,), px."""
        return np.asarray(self.pivot_px + self.turning(angle) @ (self.centre_px - self.pivot_px))

    def spread(self, angle: float) -> FloatArray:
        """What maps offsets from the middle in the reference picture to those now, (2, 2)."""
        return self.turning(angle) if self.turns else np.eye(2)

    def angle_of(self, point_px: FloatArray) -> FloatArray:
        """Angle at which the middle is nearest to points (..., 2) in direction, rad."""
        back = np.linalg.inv(self.view)
        here = (point_px - self.pivot_px) @ back.T
        start = back @ (self.centre_px - self.pivot_px)
        angle = np.arctan2(here[..., 1], here[..., 0]) - np.arctan2(start[1], start[0])
        return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))

    def per_radian(self, angle: float) -> tuple[FloatArray, FloatArray]:
        """What a small turn moves: the middle (2,) px/rad, and offsets from it (2, 2) 1/rad."""
        quarter = self.turning(angle + 0.5 * np.pi)
        moved = np.asarray(quarter @ (self.centre_px - self.pivot_px))
        return moved, quarter if self.turns else np.zeros((2, 2))
