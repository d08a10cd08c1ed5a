"""Fit arc and angles of a swinging body to gray levels of several pictures.

The body is a layer in front of the known scene (`vision.pendulum.arc`). Along a known arc its
position is one number, the angle. A bundle adjustment fits all pictures at once: they share pivot
and view; each has an angle and a brightness of its own, which are eliminated picture by picture
(Schur complement; Triggs et al., Bundle adjustment: a modern synthesis, 2000). A bar that slides
along itself or a short arc leaves a free registration undetermined; one pivot for all pictures
fixes it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.compiled import (
    CORRELATED_PIXELS,
    MIN_VISIBLE,
    gains_along,
    most_gained,
    registration_moments,
)
from vision.pendulum.arc import ImagedSwing, Patch, disc, sampled

__all__ = [
    "Bundle",
    "Glimpse",
    "Placed",
    "RegistrationStep",
    "bundle",
    "differing",
    "learnt_look",
    "locate_along",
    "registration_step",
    "segmented",
    "thick_part",
]

FloatImage = NDArray[np.float32]

FloatArray = NDArray[np.float64]

_NO_WAYS = np.zeros((0, 6))

_COARSE_POINTS = 700

"""Points of a patch in the coarse search (chosen): they only choose where the fine one starts."""

_COARSE_PX = 1.2

"""px between tried places: within the reach of the fine search, which is about the blur of an
edge."""

_STEPS = 10

"""Steps of the fine search at most: one that has not settled by then does not settle."""

_DONE_PX, _SETTLED_PX = 1e-2, 0.3

"""px: a step that matters to no measurement, a tenth of the best outline's uncertainty; and one
still small enough to be believed."""

_NEARLY_AS_GOOD = 0.9

"""Of the best gain: places as good as this are all tried (chosen)."""


@dataclass(frozen=True)
class Glimpse:
    """One picture in which the body is looked for.

    Attributes
    ----------
    picture, behind : (H, W) float32 arrays
        As filmed, and what lies behind the body, in reference brightness.
    gain : float
        Brightness of the picture over that of the scene.
    noise : float
        Of a pixel, gray levels.
    hidden : tuple of float or None
        Centre x, y and radius of a disc that may be in front, px.
    """

    frame: int
    picture: FloatImage
    behind: FloatImage
    gain: float
    noise: float
    hidden: tuple[float, float, float] | None


@dataclass(frozen=True)
class RegistrationStep:
    """The body held against a picture somewhere on its arc.

    Attributes
    ----------
    normal : (k + 1, k + 1) array
        Robust normal equations of ways in which the placing may change and, last, the brightness.
    pull : (k + 1,) array
        Their right side: the step is −normal⁻¹ pull.
    scale : float
        Usual size of the residual, gray levels.
    seen : float
        Part of the opaque body in view and not hidden.
    gain_of_it : float
        Log-likelihood gained over the scene without the body.
    explained : float
        Part of what differs from the scene that the body explains; 1 is all of it.
    rms_residual : float
        Weighted root mean square residual over noise.
    """

    normal: FloatArray
    pull: FloatArray
    scale: float
    seen: float
    gain_of_it: float
    explained: float
    rms_residual: float


@dataclass(frozen=True)
class Placed:
    """Where along its arc the body is in one picture.

    Attributes
    ----------
    angle, std : float
        rad.
    rms_residual : float
        Usual residual over noise.
    seen, explained, gain_of_it : float
        See `RegistrationStep`.
    """

    angle: float
    std: float
    rms_residual: float
    seen: float
    explained: float
    gain_of_it: float


def registration_step(
    patch: Patch,
    placing: FloatArray,
    glimpse: Glimpse,
    ways: FloatArray = _NO_WAYS,
    *,
    compare: bool = True,
) -> RegistrationStep | None:
    """Hold the body against a picture; None where too little of it is in view.

    Parameters
    ----------
    patch : Patch
        The body about its middle.
    placing : (6,) array
        Where its middle is, px, and what maps its offsets, row by row.
    glimpse : Glimpse
        The picture.
    ways : (k, 6) array
        Changes of the placing.
    compare : bool
        Whether to compare with the scene alone, too.
    """
    count = len(ways) + 1
    normal, pull = np.empty((count, count)), np.empty(count)
    seen, scale, gained, explained, squares, weights = registration_moments(
        patch.points,
        placing,
        ways,
        glimpse.picture,
        glimpse.behind,
        glimpse.gain,
        glimpse.noise,
        disc(glimpse.hidden),
        compare,
        normal,
        pull,
    )
    if seen < MIN_VISIBLE:
        return None
    rms_residual = float(np.sqrt(squares / (weights + 1e-9))) / glimpse.noise
    each = patch.each
    return RegistrationStep(
        each * normal, each * pull, scale, seen, each * gained, explained, rms_residual
    )


def differing(patch: Patch, placing: FloatArray, glimpse: Glimpse) -> float:
    """The gain of a look that would explain all of what differs from the scene where it lies."""
    away = placing[2:].reshape(2, 2) @ [patch.x, patch.y]
    at = placing[:2] + away.T
    height, width = glimpse.picture.shape
    seen = ((at > 1) & (at < [width - 2, height - 2])).all(axis=1)
    if glimpse.hidden is not None:
        x, y, radius = glimpse.hidden
        seen &= (at[:, 0] - x) ** 2 + (at[:, 1] - y) ** 2 > radius**2
    shown, scene = (sampled(one, *at[seen].T) for one in (glimpse.picture, glimpse.behind))
    return most_gained(shown - glimpse.gain * scene, patch.opacity[seen], glimpse.noise)


def locate_along(
    patch: Patch, swing: ImagedSwing, glimpse: Glimpse, guess: float, reach: float
) -> Placed | None:
    """Find the angle at which the body explains a picture best.

    Parameters
    ----------
    patch : Patch
        The body, about its middle.
    swing : ImagedSwing
        Its arc.
    glimpse : Glimpse
        The picture.
    guess, reach : float
        Where to look: this angle, and how far to either side, rad.

    Returns
    -------
    Placed or None
        None where too little of it is in view, or it settles nowhere.
    """
    arm = float(np.hypot(*(swing.centre_px - swing.pivot_px)))
    around = int(np.ceil(reach * arm / _COARSE_PX))
    tried = guess + np.arange(-around, around + 1) * (_COARSE_PX / arm)
    gains = gains_along(
        _thinned(patch).points,
        np.array([swing.placing(float(angle)) for angle in tried]),
        glimpse.picture,
        glimpse.behind,
        glimpse.gain,
        glimpse.noise,
        disc(glimpse.hidden),
    )
    if not np.isfinite(gains).any():
        return None
    best: Placed | None = None
    for place in np.argsort(-gains)[:2]:
        if best is not None and gains[place] < _NEARLY_AS_GOOD * gains.max():
            continue
        found = _settled(patch, swing, glimpse, float(tried[place]))
        if found is not None and (best is None or found.gain_of_it > best.gain_of_it):
            best = found
    return best


def _thinned(patch: Patch) -> Patch:
    step = max(1, len(patch.x) // _COARSE_POINTS)
    return Patch(patch.x[::step], patch.y[::step], patch.look[::step], patch.opacity[::step])


def _settled(patch: Patch, swing: ImagedSwing, glimpse: Glimpse, angle: float) -> Placed | None:
    """Gauss–Newton on the angle, brightness fitted along with it."""
    arm = float(np.hypot(*(swing.centre_px - swing.pivot_px)))
    held, normal, step = None, 0.0, np.inf
    for _ in range(_STEPS):
        way = swing.way_per_radian(angle)[None]
        held = registration_step(patch, swing.placing(angle), glimpse, way, compare=False)
        if held is None:
            return None
        share = held.normal[0, 1] / max(float(held.normal[1, 1]), 1e-9)
        normal = float(held.normal[0, 0] - share * held.normal[1, 0])
        if normal <= 0.0:
            return None
        pull = float(held.pull[0] - share * held.pull[1])
        step = float(np.clip(-pull / normal, -1.5 / arm, 1.5 / arm))
        if abs(step) * arm < _DONE_PX:
            break
        angle += step
    if held is None or abs(step) * arm >= _SETTLED_PX:
        return None
    there = registration_step(patch, swing.placing(angle), glimpse)
    if there is None:
        return None
    std = float(np.sqrt(CORRELATED_PIXELS / normal)) * held.scale
    return Placed(angle, std, there.rms_residual, there.seen, there.explained, there.gain_of_it)


_ROUNDS = 12

"""Rounds of the damped search at most: one that has not settled by then does not settle."""

_MIN_COUNT = 4

"""Glimpses that must hold: a pivot and two slants are four unknowns."""

# An oblique view of up to some 25° shortens a plane by a tenth; more is not expected.
_VIEW_STD = 0.06

_PIVOT_SHARE = 0.5

_DAMPING = (1e-3, 1e3)

"""Factors on the diagonal (Levenberg-Marquardt): the first hardly damps, and beyond the last a step
is a thousandth of the free one."""

_DONE = 1e-4

"""Relative gain of the likelihood in a round that is none (chosen)."""


@dataclass(frozen=True)
class Bundle:
    """A swing fitted to pictures.

    Attributes
    ----------
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
    oblique: bool = True,
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
    oblique : bool
        Whether the camera may look at it from the side.

    Returns
    -------
    Bundle or None
        None where the body is in view in fewer than four of the pictures.
    """
    arm = float(np.hypot(*(swing.centre_px - swing.pivot_px)))
    stds = np.array([*[_PIVOT_SHARE * arm] * 2, *[_VIEW_STD if oblique else 1e-6] * 2])
    home = np.array([*swing.pivot_px, 0.0, 1.0])
    fixed = angles == 0.0
    damping = _DAMPING[0]
    here = _normal(patch, swing, glimpses, angles)
    if np.count_nonzero(here.own) < _MIN_COUNT:
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


_MIN_FIT_SIGMA, _MAX_FIT_SIGMA = 1.5, 5.0
"""Standard deviation of a body's own light over the noise; and that beyond which a pixel counts no
more (chosen: a body's light changes a little as it swings)."""
_OWN_LIGHT = 2.0
"""Log odds that an appearance of its own costs a pixel (derived: half the log of the pictures)."""


_FAINT, _LIT, _MIXED, _MIN_KEPT = 0.02, 0.3, 0.5, 0.25
"""Fractions: of a body's usual log odds, less than which is no part of it; of a pixel's log odds
that a shadow leaves where it is none; of a body that is no shadow, from which on the rest is taken
for its shadow; and of a first outline that a second keeps (chosen)."""
_CLOSED, _ARM, _CORNER, _RAGGED = 0.12, 0.65, 0.3, 0.25
"""Gaps in a body that are closed, over the root of its area; and thickness of an arm over that of
its body (chosen); and what an opening by that takes off a right angle (derived: 0.41 × 0.65);
and what is ragged at its edge (chosen)."""


_MIN_OPACITY = 0.1
"""Minimum opacity of a point of a body (chosen)."""
_UNDECIDED = 2.0
"""Log odds, besides that cost, below which a pixel is undecided (derived: odds of 7 to 1)."""


def segmented(
    patch: Patch, swing: ImagedSwing, glimpses: Sequence[Glimpse], angles: FloatArray
) -> Patch:
    """Decide anew which points of a patch move with the body, by comparison with the scene.

    Parameters
    ----------
    patch : Patch
        Points on a grid of one pixel, with some around the body.
    angles : (K,) array
        Angle in each picture, rad; NaN where it is not known.

    Returns
    -------
    Patch
        The points of the body and next to it; as it was where hardly any moves with it.
    """
    offsets = np.column_stack([patch.x, patch.y])
    shown, behind, weight = [], [], []
    for glimpse, angle in zip(glimpses, angles, strict=True):
        if np.isfinite(angle):
            spot = offsets @ swing.spread(float(angle)).T + swing.middle(float(angle))
            shown.append(sampled(glimpse.picture, *spot.T) / glimpse.gain)
            behind.append(sampled(glimpse.behind, *spot.T))
            weight.append(_free(spot, glimpse))
    seen, free = np.array(shown), np.array(weight, dtype=np.float64)
    count = free.sum(axis=0)
    look = (free * seen).sum(axis=0) / np.maximum(count, 1.0)
    noise = _MIN_FIT_SIGMA * glimpses[0].noise
    most = _MAX_FIT_SIGMA**2
    left = np.minimum(np.square((seen - look) / noise), most)
    alone = np.minimum(np.square((seen - np.array(behind)) / noise), most)
    odds = 0.5 * ((alone - left) * free).sum(axis=0) - _OWN_LIGHT
    # a shadow dims what it falls on evenly
    scene = np.array(behind)
    square = np.maximum((free * scene * scene).sum(axis=0), 1e-6)
    ratio = np.clip((free * seen * scene).sum(axis=0) / square, 0.0, 1.0)
    dimmed = np.minimum(np.minimum(np.square((seen - ratio * scene) / noise), most), alone)
    beyond = 0.5 * ((dimmed - left) * free).sum(axis=0) - _OWN_LIGHT
    column, row = (np.rint(one - one.min()).astype(np.int64) for one in (patch.x, patch.y))

    def grid(values: FloatArray) -> FloatImage:
        image = np.zeros((row.max() + 1, column.max() + 1), dtype=np.float32)
        image[row, column] = values
        return image

    smooth = cv2.blur(grid(np.where(count > 0.0, odds, 0.0)), (3, 3))
    start = grid(patch.opacity) > 0.5
    sure = start & (smooth > 0.0)
    if not sure.any():
        return patch
    body = smooth > _FAINT * float(np.percentile(smooth[sure], 90.0))
    lit = body & (cv2.blur(grid(np.where(count > 0.0, beyond, 0.0)), (3, 3)) > _LIT * smooth)
    if smooth[lit & start].sum() > _MIXED * smooth[body & start].sum():
        body = lit
    # where both explain the pictures alike it stays what it was
    core = cv2.erode(start.astype(np.uint8), _disc(2)) > 0
    member = thick_part(body | (core & (np.abs(smooth + _OWN_LIGHT) < _UNDECIDED)), start)
    if member.sum() < _MIN_KEPT * start.sum():
        return patch
    # at its edge each pixel shows a mixture of the body's light farther in and the scene's
    inner = cv2.erode(member.astype(np.uint8), _disc(1)) > 0
    if not inner.any():
        return patch
    weights = cv2.blur(inner.astype(np.float32), (5, 5))
    inward = cv2.blur(grid(look) * inner, (5, 5)) / np.maximum(weights, 1e-6)
    own = np.where(inner, grid(look), inward)[row, column].astype(np.float64)
    change = own - scene
    mixed = (free * (seen - scene) * change).sum(axis=0)
    opacity = np.clip(mixed / np.maximum((free * change * change).sum(axis=0), 1.0), 0.0, 1.0)
    opacity = np.where(inner[row, column], 1.0, opacity)
    edge = (cv2.dilate(member.astype(np.uint8), _disc(1)) > 0) & (weights > 0.0)
    kept = (opacity > _MIN_OPACITY) & edge[row, column]
    if not kept.any():
        return patch
    return Patch(patch.x[kept], patch.y[kept], own[kept], opacity[kept])


def thick_part(body: NDArray[np.bool_], near: FloatArray | NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The thick part of a body, without its arm.

    Parameters
    ----------
    body : (h, w) bool array
        With small holes where it is as light as the scene.
    near : (h, w) array
        Weight of each pixel: its part is the one around the deepest pixel by this weight.

    Returns
    -------
    (h, w) bool array
    """
    area = max(float(np.count_nonzero(body)), 1.0)
    pad = int(_CLOSED * np.sqrt(area)) + 1
    padded = np.pad(body.astype(np.uint8), pad)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, _disc(pad))
    depth = cv2.distanceTransform(closed, cv2.DIST_L2, 5)
    weighted = depth * np.pad(np.asarray(near, dtype=np.float64), pad)
    middle = np.unravel_index(int(np.argmax(weighted)), depth.shape)
    thick = cv2.morphologyEx(closed, cv2.MORPH_OPEN, _disc(round(_ARM * float(depth[middle]))))
    labels = cv2.connectedComponents(thick)[1]
    part = (labels == labels[middle] if labels[middle] else closed > 0).astype(np.uint8)
    # the opening rounds corners off
    closed = cv2.morphologyEx(closed, cv2.MORPH_OPEN, _disc(round(_RAGGED * float(depth[middle]))))
    around = cv2.dilate(part, _disc(round(_CORNER * float(depth[middle]))))
    within = (np.asarray(closed) > 0) & (np.asarray(around) > 0)
    return np.asarray(within[pad:-pad, pad:-pad])


def _disc(radius: int) -> NDArray[np.uint8]:
    size = 2 * max(radius, 0) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)


def _free(spot: FloatArray, glimpse: Glimpse) -> NDArray[np.bool_]:
    """Which points (n, 2) of a picture are in view and not hidden."""
    height, width = glimpse.picture.shape
    free = ((spot > 1) & (spot < [width - 2, height - 2])).all(axis=1)
    if glimpse.hidden is not None:
        x, y, radius = glimpse.hidden
        free &= (spot[:, 0] - x) ** 2 + (spot[:, 1] - y) ** 2 > radius**2
    return np.asarray(free)


def learnt_look(
    patch: Patch,
    swing: ImagedSwing,
    glimpses: Sequence[Glimpse],
    angles: FloatArray,
    *,
    opaque: float = 0.0,
) -> Patch:
    """Average the appearance of points of some opacity over pictures with other scenes behind."""
    total, weight = np.zeros(len(patch.x)), np.zeros(len(patch.x))
    offsets = np.column_stack([patch.x, patch.y])
    for glimpse, angle in zip(glimpses, angles, strict=True):
        if not np.isfinite(angle):
            continue
        spot = offsets @ swing.spread(float(angle)).T + swing.middle(float(angle))
        free = _free(spot, glimpse)
        shown = sampled(glimpse.picture, spot[:, 0], spot[:, 1])
        total += free * shown / glimpse.gain
        weight += free
    enough = weight >= max(3.0, 0.25 * len(glimpses))
    enough &= patch.opacity >= opaque
    look = np.where(enough, total / np.maximum(weight, 1.0), patch.look)
    return replace(patch, look=look)
