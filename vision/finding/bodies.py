"""Bodies of any shape: corners that turn and move together.

Where nothing round is likely to be the measured object, what swings or slides may be a box. Corners
that move as one rigid body for some frames are a body; a reference picture turned to where it was
last is matched with the next frame, so that errors do not add up.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.finding.detection import (
    WORKING_WIDTH_PX,
    Backgrounds,
    backgrounds_of,
    gradient,
    looked_like,
    reduced,
    smoothed,
    table_of,
)
from vision.finding.linking import Tracklet

if TYPE_CHECKING:
    from vision.scene import FilmedScene

__all__ = ["rigid_bodies"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Gray = NDArray[np.uint8]

_MIN_CORNERS = 6
"""Corners of a body. Derived: three tell a pose, and as many more that chance does not agree."""

_MIN_FOLLOWED = 0.5
"""Share of the frames in which a body must be followed. Convention: most of what is seen of it."""

_STARTS, _AHEAD = 6, 12
"""Reference pictures tried in each colour, and frames in which corners show that they move
together. Given by the budget: 0.1 s each."""

_MAX_GROUPS = 3
"""Bodies sought about each reference picture. Given by the budget."""

_OFF_PX = 0.7
"""Distance from a common pose up to which a corner agrees, px. Derived: four times its scatter."""

_UNTIL = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01)
"""Steps of a match at most, and the last one's length, px. Convention."""


@dataclass(frozen=True)
class _Followed:
    """A body in a clip's reduced pictures.

    Attributes
    ----------
    corners : (N, 2) float32 array
        In the reference picture, px.
    rows : (F,) int array
        Pictures in which it is followed.
    poses : (F, 2, 3) array
        From the reference picture to each.
    agreeing : (F,) array
        Share of the corners that agree with the pose.
    scatter : float
        Of the corners about the poses, px.
    start : int
        The reference picture.
    """

    corners: NDArray[np.float32]
    rows: IntArray
    poses: FloatArray
    agreeing: FloatArray
    scatter: float
    start: int

    @property
    def worth(self) -> float:
        """Corners that agree, over all pictures."""
        return float(self.agreeing.sum() * len(self.corners))

    @property
    def centre(self) -> FloatArray:
        """Of its corners in each picture (F, 2), px."""
        middle = self.corners.mean(axis=0)
        return np.asarray(self.poses[:, :, :2] @ middle + self.poses[:, :, 2])

    @property
    def radius(self) -> float:
        """Of the disc as large as what its corners span, px."""
        return float(np.sqrt(cv2.contourArea(cv2.convexHull(self.corners)) / np.pi))


def rigid_bodies(scene: "FilmedScene", frames: IntArray) -> list[Tracklet]:
    """Find bodies whose corners move together.

    Parameters
    ----------
    scene : FilmedScene
        The clip's frames, registered.
    frames : (K,) int array
        Those searched.

    Returns
    -------
    list of Tracklet
        Those with most corners first; centres are those of the corners.
    """
    pictures = np.stack(list(reduced(scene, frames, WORKING_WIDTH_PX)))
    scale = scene.shape[1] / pictures.shape[2]
    found = []
    for channel in range(3):
        gray = np.ascontiguousarray(pictures[..., channel])
        for start in np.linspace(0, len(gray) - 1, _STARTS + 2).astype(int)[1:-1].tolist():
            for corners in _groups(gray, start):
                one = _followed(gray, start, corners)
                if len(one.rows) > _MIN_FOLLOWED * len(gray):
                    found.append(one)
    found.sort(key=lambda one: -one.worth)
    apart = list[_Followed]()
    for one in found:
        if one.radius > 1.0 and all(_distance(one, other) > other.radius for other in apart):
            apart.append(one)
    known = backgrounds_of(pictures, scale) if apart else None
    return [] if known is None else [_tracklet(one, pictures, known, frames) for one in apart]


def _distance(one: _Followed, other: _Followed) -> float:
    """Median distance of two bodies in the pictures that show both, px."""
    _, own, theirs = np.intersect1d(one.rows, other.rows, return_indices=True)
    if len(own) == 0:
        return np.inf
    return float(np.median(np.hypot(*(one.centre[own] - other.centre[theirs]).T)))


def _groups(gray: NDArray[np.uint8], start: int) -> Iterator[NDArray[np.float32]]:
    """Corners of a picture that move together in the next ones, largest group first."""
    sought = cv2.goodFeaturesToTrack(gray[start], 600, 0.002, 3)
    if sought is None:
        return
    corners = sought.reshape(-1, 2)
    way = 1 if start + _AHEAD < len(gray) else -1
    now, held = corners.copy(), np.ones(len(corners), dtype=bool)
    last = start
    while abs(last - start) < _AHEAD and 0 <= last + way < len(gray):
        there = _moved(gray[last], gray[last + way], now)
        back = _moved(gray[last + way], gray[last], there)
        held &= np.hypot(*(back - now).T) < 0.5 * _OFF_PX
        now, last = there, last + way
    left = held & (np.hypot(*(now - corners).T) > 1.5 * _OFF_PX)
    for _ in range(_MAX_GROUPS):
        pose, agree = _pose(corners[left], now[left])
        if pose is None or np.count_nonzero(agree) < _MIN_CORNERS:
            return
        rows = np.flatnonzero(left)[agree]
        yield corners[rows]
        left[rows] = False


def _moved(one: Gray, other: Gray, places: NDArray[np.float32]) -> NDArray[np.float32]:
    """Where corners of a picture are in another (N, 2); NaN where they are lost."""
    places = np.nan_to_num(places, nan=_NOWHERE_PX)
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        one, other, places, np.empty_like(places), winSize=(11, 11), maxLevel=2, criteria=_UNTIL
    )
    return np.where(status == 1, found, np.float32(np.nan))


_NOWHERE_PX = -1000.0
"""Place of a corner that was lost; outside every picture, so that it is lost in the next, too."""


def _pose(
    here: NDArray[np.float32], there: NDArray[np.float32]
) -> tuple[FloatArray | None, NDArray[np.bool_]]:
    """How most of some corners moved and turned (2, 3), and which of them did."""
    if len(here) < _MIN_CORNERS:
        return None, np.zeros(len(here), dtype=bool)
    cv2.setRNGSeed(1)
    pose: Any
    pose, agree = cv2.estimateAffinePartial2D(
        here, there, method=cv2.RANSAC, ransacReprojThreshold=_OFF_PX, maxIters=500
    )
    if pose is None:
        return None, np.zeros(len(here), dtype=bool)
    return np.asarray(pose, dtype=np.float64), agree.ravel().astype(bool)


def _followed(gray: NDArray[np.uint8], start: int, corners: NDArray[np.float32]) -> _Followed:
    """Follow a body through the pictures before and after the reference."""
    poses, shares, squares = {start: np.eye(2, 3)}, {start: 1.0}, list[float]()
    size = np.array([gray.shape[2], gray.shape[1]])
    last = np.maximum(size - _ROOM_PX, 0)
    for way in (-1, 1):
        pose, row = np.eye(2, 3), start + way
        while 0 <= row < len(gray):
            guess = (corners @ pose[:, :2].T + pose[:, 2]).astype(np.float32)
            low = np.clip(guess.min(axis=0) - _ROOM_PX, 0, last).astype(int)
            high = np.clip(guess.max(axis=0) + _ROOM_PX, low + _ROOM_PX, size).astype(int)
            there = low + _moved(
                _turned(gray[start], pose, low, high),
                gray[row, low[1] : high[1], low[0] : high[0]],
                guess - low.astype(np.float32),
            )
            held = np.isfinite(there).all(axis=1)
            found, agree = _pose(corners[held], there[held])
            # most of the corners, and of its size: what comes nearer does so slowly
            if found is None or 2 * np.count_nonzero(agree) < len(corners):
                break
            if abs(np.log(np.hypot(*found[0, :2]))) > _MAX_GROWTH:
                break
            pose = found
            off = there[held][agree] - (corners[held][agree] @ found[:, :2].T + found[:, 2])
            squares.append(float(np.mean(off**2)))
            poses[row], shares[row] = pose, float(np.count_nonzero(agree)) / len(corners)
            row += way
    rows = np.array(sorted(poses), dtype=np.int64)
    return _Followed(
        corners, rows, np.array([poses[row] for row in rows.tolist()]),
        np.array([shares[row] for row in rows.tolist()]),
        float(np.sqrt(np.mean(squares))) if squares else _OFF_PX, start,
    )  # fmt: skip


def _turned(picture: Gray, pose: FloatArray, low: IntArray, high: IntArray) -> Gray:
    """A window of the reference picture as it lies in another."""
    shifted = np.column_stack([pose[:, :2], pose[:, 2] - low])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    return np.asarray(cv2.warpAffine(picture, shifted, size), dtype=np.uint8)


_ROOM_PX = 24
"""About the corners in a window, px. Derived: the reach of a match on the coarsest picture."""

_MAX_GROWTH = 0.2
"""Logarithm of the size over that in the reference. Convention: one that swings keeps its own."""


def _tracklet(
    one: _Followed, pictures: NDArray[np.uint8], known: Backgrounds, frames: IntArray
) -> Tracklet:
    """The rows of a body, with looks of the disc as large as it."""
    steep = np.hypot(*gradient(smoothed(pictures[one.start].astype(np.float32)))).max(axis=2)
    near = cv2.dilate(steep / known.edge_noise, np.ones((3, 3), np.uint8))
    column, row = np.clip(np.rint(one.corners).astype(int), 0, np.array(near.shape[::-1]) - 1).T
    sharpness = float(np.median(near[row, column]))
    discs = np.column_stack([one.centre, np.full(len(one.rows), one.radius)])
    shown = zip(pictures[one.rows], discs, strict=True)
    looks = np.concatenate([looked_like(each, known, disc[None]) for each, disc in shown])
    rows = [frames[one.rows], discs, one.agreeing, np.full(len(discs), sharpness), looks]
    seen = table_of(np.column_stack(rows).astype(np.float64), known.scale)
    return Tracklet(seen, one.worth, max(one.scatter * known.scale, _MIN_STD_PX))


_MIN_STD_PX = 0.1
"""px. Derived: what a codec moves all corners by together does not show in their scatter."""
