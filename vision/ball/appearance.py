"""An object beyond the ends of its track: its own picture is sought there.

What is behind it may be unknown or as bright as its rim; what it looks like is known from the
frames in which its outline was fitted. These also show how well the picture fits there and beside
it, and how far it lies from the outline: the limit of a match, its offset and its uncertainty are
read off them, object by object.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.ball.outline import nothing_found
from vision.scene import FilmedScene

__all__ = ["extended_by_appearance"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]
IntArray = NDArray[np.int64]

_SHOWN = 5
"""Frames in the mean picture. Derived: its noise falls to less than half, and it turns little."""

_JUDGED = 40
"""Frames in which the mean picture is compared. Derived: quantiles of one in ten to a half."""

_RIM = 0.9
"""Radii to which the picture is compared. Derived: blur mixes the rim with what is behind it."""

_BESIDE = 0.7
"""Radii from the best place beyond which another is beside it. Derived: discs share half."""

_NEAR = 0.3
"""Radii within which a match is at the outline. Derived: as of a centre found by votes."""

_LOST_AFTER = 5
"""Frames without a match after which the object is lost. Convention."""

_BYTES, _AHEAD = 60_000_000, 24
"""Bytes of windows kept at a time; frames of motion that they hold. Convention."""


@dataclass(frozen=True)
class _Match:
    """Where a picture fits best, how badly (gray levels squared), and how badly beside it.

    `std` along x and y (px) is from the scatter that its sectors show.
    """

    centre: FloatArray
    std: FloatArray
    misfit: float
    beside: float


@dataclass(frozen=True)
class _LearntLook:
    """What an object looks like near one end of its track.

    Attributes
    ----------
    picture : (K, K, 3) float32 array
    weight : (K, K, 3) float32 array
        1 within the object.
    radius : float
        px.
    sectors : (K, K) int array
        By angle.
    offset : (2,) array
        Of matches from outlines, px.
    wider : float
        Scatter of matches in known frames over what they state, if that is more.
    most : float
        Misfit from which a match is rather of something else.
    """

    picture: FloatImage
    weight: FloatImage
    radius: float
    sectors: IntArray
    offset: FloatArray
    wider: float
    most: float


def extended_by_appearance(scene: FilmedScene, found: BallFits) -> BallFits:
    """Go on from both ends of a track for as long as something looks like the object.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    found : BallFits
        Outlines of the object.

    Returns
    -------
    BallFits
        The same and further rows.
    """
    whole = found
    for direction in (-1, 1):
        if len(found) < 2 * _SHOWN or not _goes_on(scene, found, direction):
            continue
        look = _learnt(scene, found, direction)
        if look is not None:
            matches = _followed(scene, look, found, direction)
            more = _as_fits(look, matches, float(np.median(found.fits.contrast)))
            more = more.at(~_agreeing(more, found))
            whole = whole.at(~np.isin(whole.frame, more.frame)).together(more)
    return whole


def _agreeing(matches: BallFits, found: BallFits) -> NDArray[np.bool_]:
    """Matches of frames in which an outline is found and agrees."""
    _, own, theirs = np.intersect1d(matches.frame, found.frame, return_indices=True)
    std = np.sqrt(np.diagonal(matches.fits.covariance[own], axis1=1, axis2=2))
    near = np.all(np.abs(matches.centre[own] - found.centre[theirs]) < _SPREADS * std, axis=1)
    agree = np.zeros(len(matches), dtype=bool)
    agree[own[near]] = True
    return agree


_SPREADS = 3.0
"""Standard deviations within which an outline agrees with a match. Convention."""


def _goes_on(scene: FilmedScene, found: BallFits, direction: int) -> bool:
    """Whether frames are left on a side, and the object is whole within the picture there."""
    end = found.at(np.array([-1 if direction > 0 else 0]))
    beyond = (scene.held - end.frame[0]) * direction > 0
    room = np.minimum(end.centre[0], np.array(scene.shape[::-1]) - end.centre[0])
    return bool(beyond.any() and room.min() > end.radius[0])


def _learnt(scene: FilmedScene, found: BallFits, direction: int) -> _LearntLook | None:
    """The look at one end; None where it does not tell the object from what is beside it."""
    near = found.at(np.arange(len(found))[::-direction][: _SHOWN + _JUDGED])
    radius = float(np.median(near.radius))
    half = int(np.ceil(radius)) + 1
    reach = 1.2 * radius + 3.0
    ahead = _Ahead(scene, near.frame)
    speed = float(np.hypot(*np.ptp(near.centre, axis=0))) / _AHEAD
    windows = [
        ahead.window(int(index), place, reach + half, speed)
        for index, place in zip(near.frame, near.centre, strict=True)
    ]
    shown = [_patch(windows[k], near.centre[k], half) for k in range(_SHOWN)]
    across = np.arange(-half, half + 1)
    inside = np.clip(_RIM * radius + 0.5 - np.hypot(across[:, None], across), 0.0, 1.0)
    weight = np.repeat(inside[:, :, None], 3, axis=2).astype(np.float32)
    turn = np.arctan2(across[:, None], across) / (2.0 * np.pi) + 0.5
    sectors = np.minimum((_SECTORS * turn).astype(np.int64), _SECTORS - 1)
    picture = np.asarray(np.mean(shown, axis=0), dtype=np.float32)
    look = _LearntLook(picture, weight, radius, sectors, np.zeros(2), 1.0, np.inf)
    matches = [_match(windows[k], look, near.centre[k], reach) for k in range(_SHOWN, len(near))]
    return _judged(look, matches, near.centre[_SHOWN:])


def _judged(
    look: _LearntLook, matches: list[_Match | None], centre: FloatArray
) -> _LearntLook | None:
    """A look with what its matches in known frames say of it; None where they are no better."""
    known = [(one, place) for one, place in zip(matches, centre, strict=True) if one is not None]
    if len(known) < _SHOWN:
        return None
    away = np.array([one.centre - place for one, place in known])
    offset = np.median(away, axis=0)
    stated = np.array([one.std for one, _ in known])
    scatter = np.median(np.abs(away - offset) / stated) / 0.6745
    here = np.log([max(one.misfit, 1e-3) for one, _ in known])
    beside = np.log([max(one.beside, 1e-3) for one, _ in known])
    worst, least = float(np.quantile(here, 0.9)), float(np.quantile(beside, 0.1))
    near = np.abs(away).max(axis=1) < _NEAR * look.radius
    if np.mean(near) < 0.9 or worst > least:
        return None
    most = float(np.exp(0.5 * (worst + least)))
    return replace(look, offset=offset, wider=max(float(scatter), 1.0), most=most)


_MIN_STD = 0.1
"""px. Derived: parabolas through sampled misfits are off by so much."""


@dataclass(frozen=True)
class _Window:
    """Part of a frame (H, W, 3), and where its first column and row are."""

    image: NDArray[np.uint8]
    first: IntArray

    def holds(self, low: IntArray, high: IntArray) -> bool:
        """Whether a box (x, y) is within it."""
        last = self.first + self.image.shape[1::-1]
        return bool(np.all(low >= self.first) and np.all(high <= last))


def _box(scene: FilmedScene, centre: FloatArray, reach: float) -> tuple[IntArray, IntArray]:
    """First column and row about a place, and those after the last, within the picture."""
    limit = np.array(scene.shape[::-1])
    low = np.clip(np.floor(centre - reach), 0, limit - 1).astype(np.int64)
    high = np.clip(np.ceil(centre + reach) + 1, low + 1, limit).astype(np.int64)
    return low, high


class _Ahead:
    """Windows of the frames beyond one end of a track, decoded in blocks."""

    def __init__(self, scene: FilmedScene, frames: IntArray) -> None:
        self._scene = scene
        self._frames = frames
        self._held: dict[int, _Window] = {}

    def window(self, index: int, guess: FloatArray, reach: float, speed: float) -> _Window:
        """What a frame shows within reach of a place, and further the faster the object is."""
        box = _box(self._scene, guess, reach)
        if index not in self._held or not self._held[index].holds(*box):
            self._decode(index, guess, reach + _AHEAD * speed)
        return self._held[index]

    def _decode(self, index: int, centre: FloatArray, reach: float) -> None:
        low, high = _box(self._scene, centre, reach)
        count = max(int(_BYTES // (3 * np.prod(high - low))), 1)
        at = int(np.flatnonzero(self._frames == index)[0])
        wanted = np.sort(self._frames[at : at + count])
        self._held = {
            one: _Window(image[low[1] : high[1], low[0] : high[0]].copy(), low)
            for one, image in self._scene.coloured(wanted)
        }


def _patch(window: _Window, centre: FloatArray, half: int) -> FloatImage:
    x, y = centre - window.first
    size = (2 * half + 1, 2 * half + 1)
    patch = cv2.getRectSubPix(window.image.astype(np.float32), size, (float(x), float(y)))
    return np.asarray(patch, dtype=np.float32)


def _match(window: _Window, look: _LearntLook, guess: FloatArray, reach: float) -> _Match | None:
    """The best place within reach of a guess; None where the object would leave the window."""
    half = look.picture.shape[0] // 2
    low = np.maximum(np.floor(guess - reach).astype(int) - half - window.first, 0)
    high = np.maximum(np.ceil(guess + reach).astype(int) + half + 1 - window.first, 0)
    part = window.image[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    if min(part.shape[:2]) < look.picture.shape[0] + 2:
        return None
    squares = cv2.matchTemplate(part, look.picture, cv2.TM_SQDIFF, mask=look.weight)
    misfit = np.asarray(squares / look.weight.sum(), dtype=np.float32)
    row, column = (int(one) for one in np.unravel_index(np.argmin(misfit), misfit.shape))
    rows, columns = np.ogrid[: misfit.shape[0], : misfit.shape[1]]
    far = np.hypot(rows - row, columns - column) > _BESIDE * look.radius
    off, std = _between(part, look, row, column)
    return _Match(
        np.array([column, row]) + off + low + half + window.first - look.offset,
        std,
        float(misfit[row, column]),
        float(misfit[far].min()) if far.any() else np.inf,
    )


def _between(
    part: FloatImage, look: _LearntLook, row: int, column: int
) -> tuple[FloatArray, FloatArray]:
    """Best place from the best pixel along x and y, and its standard deviation, px.

    Each sector of the object asks for a shift of its own; how these differ gives the deviation,
    whatever spoils some of them.
    """
    size = look.picture.shape[0]
    limit = np.array(part.shape[:2]) - size

    def misfit(down: int, right: int) -> FloatArray:
        top, left = np.clip([row + down, column + right], 0, limit)
        squares = look.weight * (part[top : top + size, left : left + size] - look.picture) ** 2
        summed = np.bincount(look.sectors.ravel(), squares.sum(axis=2).ravel(), _SECTORS)
        return np.asarray(summed, dtype=np.float64)

    here = misfit(0, 0)
    off, std = np.zeros(2), np.zeros(2)
    for axis, (down, right) in enumerate(((0, 1), (1, 0))):
        before, after = misfit(-down, -right), misfit(down, right)
        pull, bend = 0.5 * (before - after), before - 2.0 * here + after
        whole = max(float(bend.sum()), 1e-6)
        off[axis] = np.clip(pull.sum() / whole, -1.0, 1.0)
        left = pull - bend * off[axis]
        std[axis] = np.sqrt(np.sum(left**2) * _SECTORS / (_SECTORS - 1.0)) / whole
    return off, np.maximum(std, _MIN_STD)


_SECTORS = 8
"""Of the object. Convention: each of some pixels also where it is small."""


def _followed(
    scene: FilmedScene, look: _LearntLook, found: BallFits, direction: int
) -> dict[int, _Match]:
    """Matches by frame about and beyond one end, as long as something there looks alike."""
    # the outermost outlines may be of what is beside the object
    rows = np.arange(len(found))[::-direction][_SHOWN : _SHOWN + _LED_BY][::-1]
    time, place = found.frame[rows].astype(np.float64).tolist(), list(found.centre[rows])
    matches: dict[int, _Match] = {}
    held = scene.held
    left = held[held > time[-1]] if direction > 0 else held[held < time[-1]][::-1]
    ahead = _Ahead(scene, left)
    missed = 0
    for index in left.tolist():
        velocity = np.polyfit(time[-_LED_BY:], np.array(place[-_LED_BY:]), 1)[0]
        guess = place[-1] + velocity * (index - time[-1])
        speed = float(np.hypot(*velocity))
        # it may be struck, or come to rest, between two frames
        reach = _NEAR * look.radius + 2.0 + 1.2 * speed * abs(index - time[-1])
        size = look.picture.shape[0]
        one = _match(ahead.window(index, guess, reach + size, speed), look, guess, reach)
        missed += one is None or one.misfit > look.most
        if one is None or missed > _LOST_AFTER:
            break
        if one.misfit <= look.most:
            missed, matches[index] = 0, one
            time.append(float(index))
            place.append(one.centre)
    return matches


_LED_BY = 4
"""Rows that tell the velocity. Derived: it is then good to a third of a centre's scatter."""


def _as_fits(look: _LearntLook, matches: dict[int, _Match], contrast: float) -> BallFits:
    frame = np.array(sorted(matches), dtype=np.int64)
    fits = nothing_found(len(frame))
    fits.found[:] = True
    fits.centre[:] = np.array([matches[one].centre for one in frame.tolist()]).reshape(-1, 2)
    std = look.wider * np.array([matches[one].std for one in frame.tolist()]).reshape(-1, 2)
    fits.radius[:] = look.radius
    fits.covariance[:] = std[:, :, None] ** 2 * np.eye(2)
    fits.bound[:] = fits.covariance / 9.0
    fits.rms_residual[:], fits.contrast[:] = 1.0, contrast
    return BallFits(frame, fits, frozenset(frame.tolist()))
