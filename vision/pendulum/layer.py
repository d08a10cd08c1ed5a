"""A swinging body held against pictures: what it explains of them, and where along its arc.

The body is a layer in front of the known scene (`vision.pendulum.rigid`): a picture shows
α·T + (1 − α)·B where it lies. Along a known arc its place is one number, the angle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.compiled import CORRELATED_PIXELS, LEAST_SEEN, gains_along, registration_moments
from vision.pendulum.arc import ImagedSwing
from vision.pendulum.rigid import Patch, disc

__all__ = ["Glimpse", "Placed", "RegistrationStep", "locate_along", "registration_step"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

_NO_WAYS = np.zeros((0, 6))
_COARSE_POINTS = 700
"""Points of a patch in the coarse search, supposed: they only choose where the fine one starts."""
_COARSE_PX = 1.2
"""px between tried places: within the reach of the fine search, which is about the blur of an
edge."""
_STEPS = 10
"""Steps of the fine search at most: one that has not settled by then does not settle."""
_DONE_PX, _SETTLED_PX = 1e-2, 0.3
"""px: a step that matters to no measurement, a tenth of the best outline's uncertainty; and one
still small enough to be believed."""
_NEARLY_AS_GOOD = 0.9
"""Of the best gain: places as good as this are all tried, supposed."""


@dataclass(frozen=True)
class Glimpse:
    """One picture in which the body is looked for.

    Attributes
    ----------
    frame : int
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
    if seen < LEAST_SEEN:
        return None
    rms_residual = float(np.sqrt(squares / (weights + 1e-9))) / glimpse.noise
    return RegistrationStep(normal, pull, scale, seen, gained, explained, rms_residual)


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
