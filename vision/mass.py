"""The pendulum mass as it was followed: its poses, what it hides, and its striking face."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.arc import Arc
from vision.cutout import Hides
from vision.rest import Rest
from vision.rigid import Patch, Pose, warped

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

    def face_lead(self, rest: Rest) -> tuple[float, float]:
        """How far the striking face leads the line from pivot to anchor at the ball's height.

        Parameters
        ----------
        rest : Rest
            The ball before it is struck.

        Returns
        -------
        lead, std : float
            Of the face along the arc, px, and its standard uncertainty.
        """
        place = int(np.argmin(np.abs(self.frame - rest.last)))
        pose = self.poses[place]
        arm = pose.anchor - self.arc.centre_px
        arm = arm / np.hypot(*arm)
        ahead = np.array([arm[1], -arm[0]])
        if ahead @ rest.direction < 0:
            ahead = -ahead
        height = float((rest.centre_px - pose.anchor) @ arm)
        x, y = warped(self.patch, np.zeros(2), pose.turn)
        forward = x * ahead[0] + y * ahead[1]
        down = x * arm[0] + y * arm[1]
        leads = [
            _face_crossing(forward, self.patch.opacity, np.abs(down - height - row) < 0.75)
            for row in (-3.0, -1.5, 0.0, 1.5, 3.0)
        ]
        known = np.array([lead for lead in leads if lead is not None])
        if len(known) == 0:
            half = float(np.sqrt(self.patch.opacity.sum()) / 2)
            return half, 0.5 * half
        spread = float(np.std(known)) if len(known) > 1 else 0.5
        return float(np.median(known)), max(spread, 0.1)


def _face_crossing(
    forward: FloatArray, opacity: FloatArray, row: NDArray[np.bool_]
) -> float | None:
    """Where the opacity along one row of the patch falls through a half."""
    if np.count_nonzero(row) < 6:
        return None
    order = np.argsort(forward[row])
    place, value = forward[row][order], opacity[row][order]
    steps = np.arange(place[0], place[-1], 0.25)
    smooth = np.interp(steps, place, value)
    above = np.nonzero(smooth > 0.5)[0]
    if len(above) == 0 or above[-1] + 1 >= len(steps):
        return None
    last = above[-1]
    drop = smooth[last] - smooth[last + 1]
    return float(steps[last] + 0.25 * (smooth[last] - 0.5) / max(drop, 1e-6))
