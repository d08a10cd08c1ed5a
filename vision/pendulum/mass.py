"""The pendulum mass as it was followed: its poses, and what it hides."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ball.outline.cutout import Hides
from vision.pendulum.arc import Arc
from vision.pendulum.rigid import Patch, Pose

__all__ = ["MassPoses"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Opacity above which a pixel belongs to the mass; low, so that its soft edge counts.
_SOLID = 0.1


@dataclass(frozen=True)
class MassPoses:
    """The mass in each frame in which it was found.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices.
    poses : tuple of Pose
        Where it lay.
    patch : Patch
        Its look.
    arc : Arc
        Circle through its anchors.
    reference : int
        Frame in which the patch has turn 0.
    """

    frame: IntArray
    poses: tuple[Pose, ...]
    patch: Patch
    arc: Arc
    reference: int

    @property
    def anchor(self) -> FloatArray:
        """Anchors (N, 2), px."""
        return np.array([pose.anchor for pose in self.poses])

    def hides(self, index: int) -> Hides | None:
        """Where the mass stands in a frame, as something that may hide the ball."""
        place = int(np.searchsorted(self.frame, index))
        if place >= len(self.frame) or self.frame[place] != index:
            return None
        pose = self.poses[place]
        left, top = int(np.floor(self.patch.x.min())) - 1, int(np.floor(self.patch.y.min())) - 1
        columns = np.rint(self.patch.x - left).astype(np.int64)
        rows = np.rint(self.patch.y - top).astype(np.int64)
        solid = np.zeros((rows.max() + 2, columns.max() + 2), dtype=bool)
        solid[rows, columns] = self.patch.opacity > _SOLID
        cosine, sine = np.cos(pose.turn), np.sin(pose.turn)

        def inside(x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
            dx, dy = x - pose.anchor[0], y - pose.anchor[1]
            column = np.rint(cosine * dx + sine * dy - left).astype(np.int64)
            row = np.rint(-sine * dx + cosine * dy - top).astype(np.int64)
            within = (column >= 0) & (row >= 0) & (column < solid.shape[1]) & (row < solid.shape[0])
            hidden = np.zeros(x.shape, dtype=bool)
            hidden[within] = solid[row[within], column[within]]
            return hidden

        return inside
