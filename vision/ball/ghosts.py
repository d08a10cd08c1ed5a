"""Ghosts: circles of edges that only the static scene has, where something was or will be.

A thing that lies still for most of a clip becomes part of the static scene; before it comes, or
after it has left, its outline shows all the same, but it is not in the picture. There the scene is
put right from the frames that show what is behind it, and the thing itself is seen again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ball.circles import Circles
from vision.scene.scene import Scene

__all__ = ["uncovered"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_PRESENCE = 0.35
_COVERAGE = 0.65
_SAME_RADII, _SAME_SIZE = 0.2, 0.2
_MOST_GHOSTS = 3
_FEWEST_LOOKS = 4
_MOST_FRAMES = 9
_MARGIN_RADII, _MARGIN_PX = 1.1, 1.0
_FADE_PX = 2.0
# Other things hide the scene out to a little beyond their outline.
_BEYOND_PX = 2.0


@dataclass(frozen=True)
class _Ghost:
    """Where the static scene shows a round thing that is not there in these frames."""

    frame: IntArray
    centre: FloatArray
    radius: float


def uncovered(scene: Scene, found: dict[int, Circles]) -> bool:
    """Take ghosts out of the static scene.

    Parameters
    ----------
    scene : Scene
        Whose background is put right.
    found : dict of int to Circles
        All candidates by frame.

    Returns
    -------
    bool
        Whether there was a ghost, and the candidates should be looked for again.
    """
    ghosts = _ghosts(found)
    for ghost in ghosts:
        _uncover(scene, ghost, found)
    return bool(ghosts)


def _ghosts(found: dict[int, Circles]) -> list[_Ghost]:
    """Outlines without presence that stand in one place in several looks, most seen first."""
    rows = [
        (frame, *circles.centre_px[place], circles.radius_px[place])
        for frame, circles in sorted(found.items())
        for place in np.nonzero((circles.presence < _PRESENCE) & (circles.coverage > _COVERAGE))[0]
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    ghosts: list[_Ghost] = []
    while len(table) >= _FEWEST_LOOKS and len(ghosts) < _MOST_GHOSTS:
        gap = np.hypot(table[:, None, 1] - table[None, :, 1], table[:, None, 2] - table[None, :, 2])
        size = np.abs(np.log(table[:, None, 3] / table[None, :, 3]))
        like = (gap < _SAME_RADII * table[:, 3] + 1.0) & (size < _SAME_SIZE)
        best = int(np.argmax(like.sum(axis=1)))
        member = like[best]
        if member.sum() < _FEWEST_LOOKS:
            break
        middle = np.median(table[member, 1:], axis=0)
        frames = np.unique(table[member, 0]).astype(np.int64)
        ghosts.append(_Ghost(frames, middle[:2], float(middle[2])))
        table = table[~member]
    return ghosts


def _uncover(scene: Scene, ghost: _Ghost, found: dict[int, Circles]) -> None:
    chosen = np.unique(np.linspace(0, len(ghost.frame) - 1, _MOST_FRAMES).astype(np.int64))
    frames = ghost.frame[chosen]
    centre, radius = ghost.centre, ghost.radius
    rows, columns = np.ogrid[: scene.shape[0], : scene.shape[1]]
    away = np.hypot(columns - centre[0], rows - centre[1])
    reach = _MARGIN_RADII * radius + _MARGIN_PX
    where = np.clip((reach + _FADE_PX - away) / _FADE_PX, 0.0, 1.0).astype(np.float32)
    hidden = []
    for frame in frames:
        others = found[int(frame)]
        mask = np.zeros(scene.shape, dtype=bool)
        for place in range(len(others)):
            there = others.presence[place] > _PRESENCE and others.coverage[place] > 0.7
            if there:
                x, y = others.centre_px[place]
                mask |= np.hypot(columns - x, rows - y) < others.radius_px[place] + _BEYOND_PX
        hidden.append(mask)
    scene.uncover(frames, hidden, where)
