"""Which of the round things that moved is the ball."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ball.linking import Path
from vision.motion.lawful import lawful_stretch

__all__ = ["Choice", "choose_ball", "rivals", "trimmed"]

FloatArray = NDArray[np.float64]

# A thing that came less far than this (in radii) only wobbles: a swinging scale, a codec's blocks.
_LEAST_TRAVEL = 2.0
_RADIUS_TOLERANCE = 0.3
# Steepness over noise at which an outline counts as nothing, and as clear.
_FAINT, _CLEAR = 5.0, 60.0
_FEWEST_STILL = 3
_STILL_RADII = 0.15
# Something that lay still and then flies was struck: that is what clips are made for.
_STRUCK_BONUS = 2.0
# The more so where another thing came to it at that moment.
_MET_BONUS = 2.5
# A pendulum's way of two diameters of the ball bends by 7 to 9 %; what rolls or slides goes along
# a line.
_LEAST_APPROACH = 4.0
_STRAIGHT = 0.04
_FEWEST_CAME = 4
# An outline so complete, this much larger, may enclose a glint.
_CREDIBLE = 0.62
_ENCLOSING = 1.4


@dataclass(frozen=True)
class Choice:
    """The ball's path, other candidates', and whether the choice was close.

    Attributes
    ----------
    ball : Path
        The one chosen.
    others : tuple of Path
        Other round things that travelled and are about as clear, best first.
    struck : bool
        Whether another of them met it while it lay still.
    """

    ball: Path
    others: tuple[Path, ...]
    struck: bool


def trimmed(path: Path) -> Path:
    """Leave out candidates whose radius is not that of the clearest ones."""
    # a panel or a highlight inside the ball is round too: what counts is the length of edge seen
    worth = path.coverage**2 * np.log1p(path.sharpness) * path.radius_px**2
    order = np.argsort(np.log(path.radius_px))
    half = np.searchsorted(np.cumsum(worth[order]), 0.5 * worth.sum())
    typical = path.radius_px[order[min(half, len(order) - 1)]]
    keep = np.abs(np.log(path.radius_px / typical)) < _RADIUS_TOLERANCE
    keep &= path.sharpness > 0.3 * np.median(path.sharpness[keep])
    return path.where(keep)


def choose_ball(paths: list[Path], at: tuple[float, float, int | None] | None) -> Choice | None:
    """Choose the ball: clear all around, far-travelled, long in view; or what the user points at.

    Of several alike, it is the one that lay still and was met by another.

    Parameters
    ----------
    paths : list of Path
        What was linked.
    at : tuple, optional
        x, y (px) and frame (or None) of a point on the ball.

    Returns
    -------
    Choice or None
        None if nothing round moved.
    """
    clean = [trimmed(path) for path in paths]
    if at is not None:
        near = [path for path in clean if len(path.frame) >= 2 and _passes(path, at)]
        if not near:
            return None
        ball = min(near, key=lambda path: _gap(path, at))
        return Choice(
            ball, tuple(path for path in clean if path is not ball and _moves(path)), False
        )
    moving = _outermost([path for path in clean if _moves(path)])
    if not moving:
        return None
    scores = {
        id(path): _score(path)
        * (_MET_BONUS if any(_met_at_rest(path, other) for other in moving) else 1.0)
        for path in moving
    }
    ranked = sorted(moving, key=lambda path: scores[id(path)], reverse=True)
    best = ranked[0]
    alike = [path for path in ranked if path is best or _alike(path, best)]
    for path in alike:
        if any(_rolled_to(path, other) for other in alike if other is not path):
            others = tuple(other for other in alike if other is not path)
            return Choice(path, others, True)
    return Choice(best, tuple(alike[1:]), False)


def rivals(paths: list[Path]) -> list[Path]:
    """The clearest path of something that moves, and those that might be taken for it."""
    moving = _outermost([path for path in (trimmed(path) for path in paths) if _moves(path)])
    if not moving:
        return []
    best = max(moving, key=_score)
    return [path for path in moving if path is best or _alike(path, best)]


def _moves(path: Path) -> bool:
    return len(path.frame) >= 4 and path.travel >= _LEAST_TRAVEL


def _score(path: Path) -> float:
    """How much there is to a path: a clear outline, and a motion that a law explains."""
    steady = 1.0 / (1.0 + 10.0 * float(np.std(np.log(path.radius_px))))
    return float(_clarity(path) * steady * _smoothness(path) * _evidence(path))


def _clarity(path: Path) -> float:
    """How complete and clear the outline is; the steepness of a glint adds no more."""
    steepness = np.log(max(float(np.median(path.sharpness)), 1.0) / _FAINT)
    steep = np.clip(steepness / np.log(_CLEAR / _FAINT), 0.02, 1.3)
    size = np.clip(path.radius / 10.0, 0.1, 4.0) ** 0.25
    return float(np.median(path.coverage) ** 2 * steep * size)


def _evidence(path: Path) -> float:
    """Evidence for a lawful motion, nats; more where it lay still until then."""
    stretch = lawful_stretch(path.frame, path.centre_px, path.radius)
    before = path.frame < stretch.first
    lay_still = False
    if np.count_nonzero(before) >= _FEWEST_STILL:
        place = path.centre_px[before][-_FEWEST_STILL:]
        lay_still = bool(np.hypot(*np.ptp(place, axis=0)) < _STILL_RADII * path.radius + 1.0)
    return float((1.0 + stretch.evidence) * (_STRUCK_BONUS if lay_still else 1.0))


def _outermost(paths: list[Path]) -> list[Path]:
    """Without what lies in another and moves with it: a glint, a panel, a hub."""
    return [path for path in paths if not any(_within(path, other) for other in paths)]


def _within(path: Path, other: Path) -> bool:
    """Whether a path is of something inside the outline of another credible one."""
    if path.radius > other.radius / _ENCLOSING or np.median(other.coverage) < _CREDIBLE:
        return False
    _, own, theirs = np.intersect1d(path.frame, other.frame, return_indices=True)
    if len(own) < max(4, 0.5 * len(path.frame)):
        return False
    gap = np.hypot(*(path.centre_px[own] - other.centre_px[theirs]).T)
    inside = gap + path.radius_px[own] < 1.1 * other.radius_px[theirs]
    return bool(np.mean(inside) > 0.7 and _evidence(other) > 0.4 * _evidence(path))


def _smoothness(path: Path) -> float:
    """1 for motion that runs on, 0 for a hand's or a blob's jitter."""
    if len(path.frame) < 5:
        return 0.7
    step = np.diff(path.centre_px, axis=0) / np.diff(path.frame)[:, None]
    speed = float(np.median(np.hypot(*step.T)))
    bend = float(np.median(np.hypot(*np.diff(step, axis=0).T)))
    return 1.0 / (1.0 + bend / (speed + 0.02 * path.radius))


def _alike(path: Path, best: Path) -> bool:
    same_size = abs(np.log(path.radius / best.radius)) < 0.2
    return bool(
        same_size and path.clarity > 0.4 * best.clarity and _score(path) > 0.08 * _score(best)
    )


def _met_at_rest(path: Path, other: Path) -> bool:
    """Whether `path` lay still until `other` touched it."""
    start = path.centre_px[: max(3, len(path.frame) // 10)].mean(axis=0)
    away = np.hypot(*(path.centre_px - start).T)
    moved = np.nonzero(away > 0.7 * path.radius)[0]
    if len(moved) == 0 or moved[0] < 2:
        return False
    departure = path.frame[moved[0]]
    gap = np.hypot(*(other.centre_px - start).T)
    beside = np.abs(other.frame - departure) <= max(3, int(np.median(np.diff(path.frame))) * 3)
    own_start = other.centre_px[: max(3, len(other.frame) // 10)].mean(axis=0)
    came = np.hypot(*(own_start - start)) > 2.5 * path.radius
    return bool(np.any(beside) and gap[beside].min() < 3.2 * path.radius and came)


def _rolled_to(path: Path, other: Path) -> bool:
    """Whether the other met it at rest, and came along a line: what swings is a pendulum."""
    if not _met_at_rest(path, other):
        return False
    start = path.centre_px[: max(3, len(path.frame) // 10)].mean(axis=0)
    gone = np.hypot(*(path.centre_px - start).T) > 0.7 * path.radius
    came = other.centre_px[other.frame < path.frame[int(np.argmax(gone))]]
    came = came[np.hypot(*(came - came[0]).T) > 0.0]
    if len(came) < _FEWEST_CAME:
        return False
    along, _, _ = np.linalg.svd((came - came.mean(axis=0)).T, full_matrices=False)
    way = (came - came.mean(axis=0)) @ along
    length = float(np.ptp(way[:, 0]))
    sagitta = abs(float(np.polyfit(way[:, 0], way[:, 1], 2)[0])) * (0.5 * length) ** 2
    return length > _LEAST_APPROACH * path.radius and sagitta < _STRAIGHT * length


def _passes(path: Path, at: tuple[float, float, int | None]) -> bool:
    return _gap(path, at) < 1.5 * path.radius


def _gap(path: Path, at: tuple[float, float, int | None]) -> float:
    distance = np.hypot(path.centre_px[:, 0] - at[0], path.centre_px[:, 1] - at[1])
    if at[2] is not None:
        nearest = int(np.argmin(np.abs(path.frame - at[2])))
        return float(distance[max(0, nearest - 1) : nearest + 2].min())
    return float(distance.min())
