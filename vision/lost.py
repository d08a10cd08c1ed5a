"""Frames lost from a file without a trace in its times, told by how far all that moves leaps.

A flight, and a swing, run on by one law. Where frames are missing everything goes on at once as far
along its way as it would have gone in so many frames, and as fast as it then would be: no strike
and no mistake of what is followed does that. Laws are fitted on both sides of each moment, and the
counts of lost frames compete with a law that goes on, one that changes, and a leap elsewhere.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vision.tracks import PendulumTrack, Track

__all__ = ["LostFrames", "lost_frames"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NEAR, _LEAD = (16, 10, 6), (72, 48, 32, 20, 12, 6)
"""Frames that a law is fitted to, from the most on: enough to tell a step, and to lead it far."""

_UNSEEN = 16
"""Frames at most without a place: next to a leap as many are held for mistaken as foretell one."""

_DIM = 0.8
"""Share of the usual: an outline of which so much less stands out is half hidden."""

_ENDS = tuple((early, late) for early, late in product(range(4), range(4)) if early + late <= 4)
_WIDE, _AROUND = (2, 2), 4
_LEFT_OUT_PRICE = 4.0
"""Frames left out before and after a leap, since they may be foretold from its other side; those
with which it is looked for everywhere, and how near to that more closely; and nats for each."""

_DISTINCT = 6.0
"""Standard deviations by which things leap at least, supposed."""

_SWING_NATS = 5.0
"""Nats that a pendulum says at most: it may be followed wrongly where it leaps."""

_LEAST_STD_PX, _LEAST_STD_RADII = 0.03, 0.002
"""px, and radii: errors that neighbouring frames share, supposed."""

_SLACK_SPEED = 0.003
"""Of a velocity, what drag and lens make of a parabola's over some tens of frames, supposed."""

_LEAPS, _CHANGES = np.log(1e-3), np.log(1e-2)
"""Log probability that a file lacks frames at a given moment, or another thing is followed from
there; and that a law changes there, supposed."""

_SURE = 0.99
"""Probability from which frames are taken to be lost, and from which so many."""

_ASTRAY = 3.0
"""Radii within which another thing is followed."""

_SAME_SIZE = 0.1
"""Log radius by which one ball is told otherwise at most, supposed."""

_MISFIT = 3.0
"""Times its noise, and more, that a law leaves where it does not hold, as a root mean square."""


@dataclass(frozen=True)
class LostFrames:
    """Frames that a file lacks.

    Attributes
    ----------
    after, before : int
        Frames between which they are missing: the last of one law, and the first of the next.
    count : int
        How many they are likeliest to be.
    sure : bool
        Whether they are surely so many.
    """

    after: int
    before: int
    count: int
    sure: bool


@dataclass(frozen=True)
class _SeenThing:
    """What is known of one thing in some frames: places (N, axes) with their variances (N,)."""

    frame: IntArray
    place: FloatArray
    variance: FloatArray
    size: float

    def at(self, rows: NDArray[np.bool_]) -> "_SeenThing":
        return _SeenThing(self.frame[rows], self.place[rows], self.variance[rows], self.size)


@dataclass(frozen=True)
class _State:
    """Place, velocity and acceleration (3, axes) at a frame; covariance along one axis; misfit."""

    frame: int
    state: FloatArray
    covariance: FloatArray
    misfit: float = 0.0

    def after(self, frames: float) -> "_State":
        """So many frames later."""
        ahead = np.array([[1.0, frames, 0.5 * frames**2], [0.0, 1.0, frames], [0.0, 0.0, 1.0]])
        return _State(self.frame, ahead @ self.state, ahead @ self.covariance @ ahead.T)


def lost_frames(
    ball: Track, others: Sequence[Track] = (), pendulum: PendulumTrack | None = None
) -> LostFrames | None:
    """Find where a file most likely lacks frames.

    Parameters
    ----------
    ball : Track
        What was followed, wherever it was seen.
    others : sequence of Track
        What else was: it may be the ball before the leap, or after it.
    pendulum : PendulumTrack, optional
        It leaps at the same moment.

    Returns
    -------
    LostFrames or None
        None where everything runs on.
    """
    pieces = [_of(ball), *(_of(track) for track in others if len(track))]
    swing = None if pendulum is None else _of_swing(pendulum)
    told = [
        one
        for row in _leaping_rows(pieces[0], swing)
        for one in _told(_moments(pieces[0], row, _ENDS), swing)
    ]
    for other in pieces[1:]:
        for head, tail in ((pieces[0], other), (other, pieces[0])):
            told += _told(_between(head, tail), swing)
    return max(told, key=lambda one: one[0], default=(0.0, None))[1]


def _told(
    moments: Iterator["_Moment"], swing: "_SeenThing | None"
) -> Iterator[tuple[float, LostFrames]]:
    """Moments at which frames are lost, each with how well that explains what was followed."""
    for moment in moments:
        before, after = _law(moment.head, moment.counts, -1), _law(moment.tail, moment.counts, 1)
        if before is None or after is None:
            continue
        if max(before.misfit, after.misfit) > _MISFIT**2:
            continue
        found = _weighed(before, after, moment.head.size, swing)
        if found is not None and not _bent(moment):
            yield found[0] - _LEFT_OUT_PRICE * moment.left_out, found[1]


def _of(track: Track) -> _SeenThing:
    # an outline half hidden goes on slower than the ball
    clear = track.where(track.quality >= _DIM * np.median(track.quality))
    # next to a leap all is doubted, what is right as well
    usual = float(np.median(0.5 * np.trace(clear.covariance_px2, axis1=1, axis2=2)))
    variance = np.full(len(clear), usual)
    return _SeenThing(clear.frame, clear.centre_px, variance, float(np.median(clear.radius_px)))


def _of_swing(pendulum: PendulumTrack) -> _SeenThing:
    arm = pendulum.arm_px
    place = (arm * pendulum.angle_rad)[:, None]
    return _SeenThing(pendulum.track.frame, place, (arm * pendulum.angle_std_rad) ** 2, arm)


@dataclass(frozen=True)
class _Moment:
    """What was followed up to and from a moment, how many frames tell, and how many do not."""

    head: _SeenThing
    tail: _SeenThing
    counts: tuple[int, ...]
    left_out: int


def _moments(piece: _SeenThing, row: int, ends: Sequence[tuple[int, int]]) -> Iterator[_Moment]:
    """Moments next to one of a piece's rows."""
    rows = np.arange(len(piece.frame))
    near = piece.at(np.abs(rows - row + 0.5) < _NEAR[0])
    start = int(piece.frame[row])
    for early, late in ends:
        head, tail = near.at(near.frame < start - early), near.at(near.frame >= start + late)
        if min(len(head.frame), len(tail.frame)) < _NEAR[-1]:
            continue
        if tail.frame[0] - head.frame[-1] <= 1 + _UNSEEN:
            yield _Moment(head, tail, _NEAR, early + late)


def _leaping_rows(piece: _SeenThing, swing: _SeenThing | None) -> list[int]:
    """Rows near which a piece may leap."""
    found: set[int] = set()
    for row in range(_NEAR[-1], len(piece.frame) - _NEAR[-1] + 1):
        if any(_told(_moments(piece, row, [_WIDE]), swing)):
            found |= set(range(row - _AROUND, row + _AROUND + 1))
    return [row for row in sorted(found) if _NEAR[-1] <= row <= len(piece.frame) - _NEAR[-1]]


def _between(head: _SeenThing, tail: _SeenThing) -> Iterator[_Moment]:
    """Moments between the end of one thing and the beginning of another."""
    if not 0 <= int(tail.frame[0]) - int(head.frame[-1]) - 1 <= _UNSEEN:
        return
    if abs(np.log(tail.size / head.size)) > _SAME_SIZE:
        return
    for early, late in _ENDS:
        last, first = int(head.frame[-1]) - early, int(tail.frame[0]) + late
        before, after = head.at(head.frame <= last), tail.at(tail.frame >= first)
        if min(len(before.frame), len(after.frame)) >= _LEAD[-1]:
            yield _Moment(before, after, _LEAD, early + late)


def _law(piece: _SeenThing, counts: tuple[int, ...], side: int) -> _State | None:
    """The law of a piece's first frames, or with side -1 its last, at the outermost of them."""
    for count in counts:
        rows = slice(0, count) if side > 0 else slice(-count, None)
        frame, place = piece.frame[rows], piece.place[rows]
        if len(frame) < counts[-1]:
            return None
        end = int(frame[0] if side > 0 else frame[-1])
        time = (frame - end).astype(np.float64)
        powers = np.column_stack([np.ones_like(time), time, 0.5 * time * time])
        weight = 1.0 / piece.variance[rows]
        normal = (powers * weight[:, None]).T @ powers
        state = np.linalg.solve(normal, (powers * weight[:, None]).T @ place)
        left = ((place - powers @ state) ** 2).sum(axis=1)
        spare = place.shape[1] * max(len(frame) - 3, 1)
        worse = float((weight * left).sum()) / spare
        if worse < _MISFIT**2 or count == counts[-1]:
            # errors that frames share are stated, too, but don't scatter
            covariance = np.clip(worse, 0.01, None) * np.linalg.inv(normal)
            return _State(end, np.asarray(state), np.asarray(covariance), worse)
    return None


def _bent(moment: _Moment) -> bool:
    """Whether a path that bends once explains a moment as well as a leap between two laws.

    A thing that is set in motion a few frames before has a law of rest and motion in one, which
    leads to another place.
    """
    head, tail = moment.head.at(_last(moment.head, -1)), moment.tail.at(_last(moment.tail, 1))
    frame = np.concatenate([head.frame, tail.frame]).astype(np.float64)
    place, variance = np.concatenate([head.place, tail.place]), head.variance[0]
    time = (frame - frame[0]) / (frame[-1] - frame[0])
    run_on = np.column_stack([np.ones_like(time), time, time * time])
    after = np.arange(len(frame)) >= len(head.frame)
    two = np.column_stack([run_on * ~after[:, None], run_on * after[:, None]])
    leap = _left_over(two, place) / variance
    bends = [np.column_stack([run_on, np.maximum(time - knee, 0.0)]) for knee in time[2:-2]]
    bend = min(_left_over(bent, place) for bent in bends) / variance
    # evidence by the number of parameters of each axis: six of a leap, four of a bend
    price = place.shape[1] * (6 - 4) * np.log(len(frame))
    return bool(bend - leap < price + 2.0 * (_CHANGES - _LEAPS))


def _last(piece: _SeenThing, side: int) -> NDArray[np.bool_]:
    """Rows of a piece's first frames, or with side -1 its last."""
    rows = np.arange(len(piece.frame))
    return np.asarray(rows < _NEAR[0] if side > 0 else rows >= len(rows) - _NEAR[0])


def _left_over(columns: FloatArray, place: FloatArray) -> float:
    """Sum of the squares that a linear law leaves, px²."""
    found = np.linalg.lstsq(columns, place, rcond=None)[0]
    return float(((place - columns @ found) ** 2).sum())


def _weighed(
    before: _State, after: _State, size: float, swing: _SeenThing | None
) -> tuple[float, LostFrames] | None:
    """Log density if frames are lost between two laws, and how many; None where it is unlikely."""
    gap = after.frame - before.frame
    speed = float(np.hypot(*before.state[1])) if before.state.shape[1] > 1 else 0.0
    if speed * speed == 0.0:
        return None
    along = float((after.state[0] - before.state[0]) @ before.state[1]) / speed**2 - gap
    if not along > 0.5:
        return None
    std = np.sqrt(before.covariance[0, 0] + after.covariance[0, 0] + _shared(size))
    if (along - 0.5) * speed < _DISTINCT * std:
        return None
    counts = np.arange(max(1, int(0.6 * along) - 2), int(1.6 * along) + 4)
    chance = np.array([_apart(before, after, gap + int(count), size) for count in counts])
    chance -= np.log(counts * (counts + 1.0))
    chance += _LEAPS
    others = _otherwise(before, after, gap, size, speed)
    if swing is not None:
        on = _swung(swing, before.frame, after.frame, np.concatenate([[0], counts]))
        chance = chance + np.clip(on[1:] - on[0], -_SWING_NATS, _SWING_NATS)
    whole = float(np.logaddexp.reduce(np.concatenate([others, chance])))
    lost = float(np.logaddexp.reduce(chance))
    if np.exp(lost - whole) < _SURE:
        return None
    likeliest = int(np.argmax(chance))
    sure = bool(np.exp(chance[likeliest] - lost) > _SURE)
    return lost, LostFrames(before.frame, after.frame, int(counts[likeliest]), sure)


def _otherwise(before: _State, after: _State, gap: int, size: float, speed: float) -> FloatArray:
    """Log chances of a law that goes on, one that changes, and of another thing from there on."""
    on = _apart(before, after, gap, size)
    bend = float(np.hypot(*after.state[2])) + float(np.hypot(*before.state[2])) + speed / _NEAR[0]
    elsewhere = np.diag([(_ASTRAY * size) ** 2, speed**2, bend**2])
    return np.array(
        [
            on,
            _LEAPS + _apart(before, after, gap, size, elsewhere),
        ]
    )


def _apart(
    before: _State, after: _State, frames: int, size: float, other: FloatArray | None = None
) -> float:
    """Log density of what a law misses another by if so many frames lie between them, less 2π."""
    ahead = before.after(float(frames))
    apart = after.state - ahead.state
    speed = float(np.sqrt((before.state[1] ** 2).sum()))
    slack = np.diag(
        [_shared(size) + (_SLACK_SPEED * speed * frames) ** 2, (_SLACK_SPEED * speed) ** 2, 0]
    )
    covariance = ahead.covariance + after.covariance + slack
    if other is not None:
        covariance = covariance + other
    axes = apart.shape[1]
    _, spread = np.linalg.slogdet(covariance)
    return float(-0.5 * axes * spread - 0.5 * (apart * np.linalg.solve(covariance, apart)).sum())


def _shared(size: float) -> float:
    """Variance of what neighbouring frames are off by together, px²."""
    return (_LEAST_STD_PX + _LEAST_STD_RADII * size) ** 2


def _swung(swing: _SeenThing, last: int, first: int, counts: IntArray) -> FloatArray:
    """Log density of where a pendulum is after so many lost frames; nought where it tells none."""
    nothing = np.zeros(len(counts))
    head, tail = swing.at(swing.frame <= last), swing.at(swing.frame >= first)
    if min(len(head.frame), len(tail.frame)) < _NEAR[-1]:
        return nothing
    if last - head.frame[-1] > _UNSEEN or tail.frame[0] - first > _UNSEEN:
        return nothing
    before, after = _law(head, _NEAR, -1), _law(tail, _NEAR, 1)
    if before is None or after is None:
        return nothing
    between = after.frame - before.frame
    return np.array([_apart(before, after, between + int(count), 0.0) for count in counts])
