"""Who is who where paths end or meet: heads joined to tails by one global assignment.

A chain that is best by itself may change from one thing to another: from a puck to the one that it
strikes, say. So at every moment at which a path ends or two meet, all paths are cut, and heads and
tails are joined anew by the assignment that is best for all together (Kuhn 1955, `scipy.optimize.
linear_sum_assignment`): each tail begins near where its head would have gone. A thing that lies
still and is struck is still near its place in the next frame, the striker is not.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vision.ball.linking import Path

__all__ = ["untangled"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MEETING_RADII = 3.0
_LOOKS_BACK = 4
# Off its prediction by this (radii, and px) costs one; more than the cap costs no more.
_OFF_RADII, _OFF_PX = 0.25, 1.0
_CAP = 12.0
_SWOLLEN = 0.15
# Joining otherwise than the chains did must be better by this.
_CLEARLY = 1.5
_FEWEST = 3
_MOST_MEETINGS = 12


def untangled(paths: list[Path]) -> list[Path]:
    """Exchange tails where another assignment explains all paths better.

    Parameters
    ----------
    paths : list of Path
        What `link_circles` returned.

    Returns
    -------
    list of Path
        Of the same candidates; a head or tail that belongs to nothing else stands for itself.
    """
    for moment in _moments(paths):
        paths = _rejoined(paths, moment)
    return paths


def _moments(paths: list[Path]) -> list[int]:
    """Frames after which a path ends while another is near, in time order."""
    found: set[int] = set()
    for path in paths:
        last = int(path.frame[-1])
        for other in paths:
            if other is path or not int(other.frame[0]) < last < int(other.frame[-1]):
                continue
            after = int(np.searchsorted(other.frame, last, side="right"))
            gap = float(np.hypot(*(other.centre_px[after] - path.centre_px[-1])))
            if gap < _MEETING_RADII * max(path.radius, other.radius):
                found.add(last)
    return sorted(found)[:_MOST_MEETINGS]


def _rejoined(paths: list[Path], moment: int) -> list[Path]:
    """Cut all paths after a frame and join heads and tails anew."""
    live = [path for path in paths if path.frame[0] <= moment < path.frame[-1]]
    ended = [path for path in paths if path.frame[-1] == moment]
    rest = [path for path in paths if not any(path is one for one in live + ended)]
    heads = [path.where(path.frame <= moment) for path in live] + ended
    tails = [path.where(path.frame > moment) for path in live]
    if not tails:
        return paths
    cost = np.array([[_cost(head, tail) for tail in tails] for head in heads])
    before = float(sum(cost[place, place] for place in range(len(tails))))
    rows, columns = linear_sum_assignment(cost)
    if before - float(cost[rows, columns].sum()) < _CLEARLY:
        return paths
    joined = list(rest)
    for row, head in enumerate(heads):
        own = columns[rows == row]
        if len(own) and cost[row, own[0]] < _CAP:
            joined.append(head.then(tails[int(own[0])]))
        else:
            joined += [thing for thing in (head,) if len(thing.frame) >= _FEWEST]
            joined += [tails[int(at)] for at in own if len(tails[int(at)].frame) >= _FEWEST]
    return joined


def _cost(head: Path, tail: Path) -> float:
    """How far a tail begins from where its head would have gone, in tolerances."""
    frame = head.frame[-_LOOKS_BACK:].astype(np.float64)
    place = head.centre_px[-_LOOKS_BACK:]
    if len(frame) > 1:
        slope, start = np.polyfit(frame - frame[-1], place, 1)
    else:
        slope, start = np.zeros(2), place[-1]
    expected = start + slope * (float(tail.frame[0]) - frame[-1])
    radius = head.radius
    off = float(np.hypot(*(tail.centre_px[0] - expected))) / (_OFF_RADII * radius + _OFF_PX)
    swollen = abs(float(np.log(tail.radius / radius))) / _SWOLLEN
    return min(off + swollen, _CAP)
