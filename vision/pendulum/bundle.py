"""Pivot, view and angles of a swing at once, from the pictures themselves.

A bundle adjustment on gray levels: all pictures share the pivot and the view, each has an angle and
a brightness of its own, which are eliminated picture by picture (Schur complement; Triggs et al.,
Bundle adjustment: a modern synthesis, 2000). A bar that slides along itself unnoticed, or a short
arc, leaves a free registration adrift; one pivot for all pictures holds it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.compiled import CORRELATED_PIXELS
from vision.pendulum.arc import ImagedSwing
from vision.pendulum.layer import Glimpse, registration_step
from vision.pendulum.rigid import Patch, sampled

__all__ = ["Bundle", "bundle", "learnt_look"]

FloatArray = NDArray[np.float64]

_ROUNDS = 12
"""Rounds of the damped search at most: one that has not settled by then does not settle."""
_FEWEST = 4
"""Glimpses that must hold: a pivot and two slants are four unknowns."""
# A camera up to some 25° aslant shortens a plane by a tenth; more is not expected.
_VIEW_STD = 0.06
_PIVOT_SHARE = 0.5
_DAMPING = (1e-3, 1e3)
"""Factors on the diagonal (Levenberg-Marquardt): the first hardly damps, and beyond the last a step
is a thousandth of the free one."""
_DONE = 1e-4
"""Relative gain of the likelihood in a round that is none, supposed."""


@dataclass(frozen=True)
class Bundle:
    """A swing fitted to pictures.

    Attributes
    ----------
    swing : ImagedSwing
    angles : (K,) array
        In each picture, rad; NaN where too little of the body is in view.
    gain : float
        Log-likelihood gained over scenes without the body, summed.
    explained : float
        Part of what differs from the scene that the body explains, mean over the pictures.
    covariance : (4, 4) array
        Of pivot x, y (px), shear and stretch.
    """

    swing: ImagedSwing
    angles: FloatArray
    gain: float
    explained: float
    covariance: FloatArray


@dataclass(frozen=True)
class _Normal:
    """Normal equations of the shared parameters, and how each angle follows them."""

    matrix: FloatArray
    pull: FloatArray
    own: FloatArray
    cross: FloatArray
    own_pull: FloatArray
    gain: float
    explained: float


def bundle(
    patch: Patch,
    swing: ImagedSwing,
    glimpses: Sequence[Glimpse],
    angles: FloatArray,
    *,
    aslant: bool = True,
) -> Bundle | None:
    """Fit a swing to pictures.

    Parameters
    ----------
    patch : Patch
        The body about its middle in the reference picture.
    swing : ImagedSwing
        First guess.
    glimpses : sequence of Glimpse
        The pictures.
    angles : (K,) array
        First guess of the angle in each, rad; 0 exactly is the reference and stays.
    aslant : bool
        Whether the camera may look aslant.

    Returns
    -------
    Bundle or None
        None where the body is in view in fewer than four of the pictures.
    """
    arm = float(np.hypot(*(swing.centre_px - swing.pivot_px)))
    stds = np.array([*[_PIVOT_SHARE * arm] * 2, *[_VIEW_STD if aslant else 1e-6] * 2])
    home = np.array([*swing.pivot_px, 0.0, 1.0])
    fixed = angles == 0.0
    damping = _DAMPING[0]
    here = _normal(patch, swing, glimpses, angles)
    if np.count_nonzero(here.own) < _FEWEST:
        return None
    shared = _shared(swing)
    for _ in range(_ROUNDS):
        matrix = here.matrix + np.diag(stds**-2.0)
        pull = here.pull + (shared - home) / stds**2
        step = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), pull)
        turn = -(here.own_pull + here.cross @ step) / np.maximum(here.own, 1e-9)
        turn = np.where(fixed | (here.own <= 0.0), 0.0, np.clip(turn, -3.0 / arm, 3.0 / arm))
        moved = _with(swing, shared + step)
        there = _normal(patch, moved, glimpses, angles + turn)
        before = here.gain - 0.5 * float((((shared - home) / stds) ** 2).sum())
        after = there.gain - 0.5 * float((((shared + step - home) / stds) ** 2).sum())
        if after > before - 1e-6:
            swing, angles, here, shared = moved, angles + turn, there, shared + step
            damping = max(damping / 5.0, 1e-6)
            if after - before < _DONE * abs(after):
                break
        else:
            damping *= 8.0
            if damping > _DAMPING[1]:
                break
    covariance = np.asarray(np.linalg.inv(here.matrix + np.diag(stds**-2.0)), dtype=np.float64)
    return Bundle(
        swing, np.where(here.own > 0.0, angles, np.nan), here.gain, here.explained, covariance
    )


def _shared(swing: ImagedSwing) -> FloatArray:
    return np.array([*swing.pivot_px, swing.shear, swing.stretch])


def _with(swing: ImagedSwing, shared: FloatArray) -> ImagedSwing:
    return replace(
        swing, pivot_px=shared[:2].copy(), shear=float(shared[2]), stretch=float(shared[3])
    )


def _normal(
    patch: Patch, swing: ImagedSwing, glimpses: Sequence[Glimpse], angles: FloatArray
) -> _Normal:
    """Normal equations at a guess; pictures in which too little is in view count for nothing."""
    count = len(glimpses)
    matrix, pull = np.zeros((4, 4)), np.zeros(4)
    own, own_pull, cross = np.zeros(count), np.zeros(count), np.zeros((count, 4))
    gain, explained = 0.0, []
    for place, glimpse in enumerate(glimpses):
        angle = float(angles[place])
        held = registration_step(patch, swing.placing(angle), glimpse, _ways(swing, angle))
        if held is None:
            continue
        certain = 1.0 / (held.scale**2 * CORRELATED_PIXELS)
        normal, down = certain * held.normal, certain * held.pull
        # brightness goes first
        normal, down = _without_last(normal, down)
        own[place], own_pull[place], cross[place] = normal[4, 4], down[4], normal[4, :4]
        reduced, reduced_pull = _without_last(normal, down)
        if angle == 0.0:
            reduced, reduced_pull = normal[:4, :4], down[:4]
        matrix += reduced
        pull += reduced_pull
        gain += held.gain_of_it
        explained.append(held.explained)
    usual = float(np.median(explained)) if explained else 0.0
    return _Normal(matrix, pull, own, cross, own_pull, gain, usual)


def _without_last(normal: FloatArray, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal equations with the last parameter eliminated."""
    share = normal[:-1, -1] / max(float(normal[-1, -1]), 1e-12)
    return normal[:-1, :-1] - np.outer(share, normal[-1, :-1]), pull[:-1] - share * pull[-1]


def _ways(swing: ImagedSwing, angle: float) -> FloatArray:
    """How a placing changes per unit of pivot x, y, shear, stretch and angle, (5, 6)."""
    away = swing.centre_px - swing.pivot_px
    ways = np.zeros((5, 6))
    ways[:2, :2] = (np.eye(2) - swing.turning(angle)).T
    for place, change in enumerate(swing.by_view(angle), start=2):
        ways[place, :2] = change @ away
        if swing.turns:
            ways[place, 2:] = change.ravel()
    ways[4] = swing.way_per_radian(angle)
    return ways


def learnt_look(
    patch: Patch, swing: ImagedSwing, glimpses: Sequence[Glimpse], angles: FloatArray
) -> Patch:
    """Average the look over pictures: the body lies before different parts of the scene."""
    total, weight = np.zeros(len(patch.x)), np.zeros(len(patch.x))
    offsets = np.column_stack([patch.x, patch.y])
    for glimpse, angle in zip(glimpses, angles, strict=True):
        if not np.isfinite(angle):
            continue
        spot = offsets @ swing.spread(float(angle)).T + swing.middle(float(angle))
        height, width = glimpse.picture.shape
        free = ((spot > 1) & (spot < [width - 2, height - 2])).all(axis=1)
        if glimpse.hidden is not None:
            x, y, radius = glimpse.hidden
            free &= (spot[:, 0] - x) ** 2 + (spot[:, 1] - y) ** 2 > radius**2
        shown = sampled(glimpse.picture, spot[:, 0], spot[:, 1])
        total += free * shown / glimpse.gain
        weight += free
    enough = weight >= max(3.0, 0.25 * len(glimpses))
    look = np.where(enough, total / np.maximum(weight, 1.0), patch.look)
    return replace(patch, look=look)
