"""A swinging body held against pictures: what it explains of them, and where along its arc.

The body is a layer in front of the known scene (`vision.pendulum.rigid`): a picture shows
α·T + (1 − α)·B where it lies. Along a known arc its place is one number, the angle.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.pendulum.arc import ImagedSwing
from vision.pendulum.rigid import Patch, sampled

__all__ = ["Glimpse", "Held", "Placed", "hold", "hold_at", "locate_along"]

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]

# Neighbouring residuals share interpolation and coding errors; so many pixels count as one.
CORRELATED_PIXELS = 4.0
LEAST_SEEN = 0.33
_ROBUST = 3.0
_SLOPE = np.array([-0.5, 0.0, 0.5])
_FLAT = np.array([0.25, 0.5, 0.25])
_COARSE_POINTS = 700
_COARSE_PX = 1.2
_STEPS = 10
_DONE_PX, _SETTLED_PX = 1e-2, 0.3
_NEARLY_AS_GOOD = 0.9


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
class Held:
    """The body held against a picture somewhere on its arc.

    Attributes
    ----------
    residual : (n,) array
        Picture minus layer, gray levels.
    weight : (n,) array
        What counts: in view, not hidden, and not far off.
    slope : (n, 2) array
        How the residual changes as the point moves by a pixel along x and y.
    look : (n,) array
        What a brighter body adds to the layer, per unit.
    scale : float
        Usual size of the residual, gray levels.
    seen : float
        Part of the opaque body in view and not hidden.
    gain_of_it : float
        Log-likelihood gained over the scene without the body.
    explained : float
        Part of what differs from the scene that the body explains; 1 is all of it.
    """

    residual: FloatArray
    weight: FloatArray
    slope: FloatArray
    look: FloatArray
    scale: float
    seen: float
    gain_of_it: float
    explained: float


@dataclass(frozen=True)
class Placed:
    """Where along its arc the body is in one picture.

    Attributes
    ----------
    angle, std : float
        rad.
    misfit : float
        Usual residual over noise.
    seen, explained, gain_of_it : float
        See `Held`.
    """

    angle: float
    std: float
    misfit: float
    seen: float
    explained: float
    gain_of_it: float


def hold(patch: Patch, swing: ImagedSwing, angle: float, glimpse: Glimpse) -> Held | None:
    """Hold the body against a picture at an angle; None where too little of it is in view."""
    return hold_at(patch, swing.middle(angle), swing.spread(angle), glimpse)


def hold_at(patch: Patch, middle: FloatArray, spread: FloatArray, glimpse: Glimpse) -> Held | None:
    """Hold a body with its middle (2,) there, its offsets mapped by `spread` (2, 2)."""
    spot = np.column_stack([patch.x, patch.y]) @ spread.T + middle
    height, width = glimpse.picture.shape
    free = ((spot > 1) & (spot < [width - 2, height - 2])).all(axis=1)
    if glimpse.hidden is not None:
        x, y, radius = glimpse.hidden
        free &= (spot[:, 0] - x) ** 2 + (spot[:, 1] - y) ** 2 > radius**2
    seen = float(patch.opacity @ free) / float(patch.opacity.sum())
    if seen < LEAST_SEEN:
        return None
    left, top = np.maximum(np.floor(spot.min(axis=0)).astype(int) - 3, 0)
    right, bottom = np.ceil(spot.max(axis=0)).astype(int) + 4
    window = (slice(top, max(bottom, top + 1)), slice(left, max(right, left + 1)))
    u, v = spot[:, 0] - left, spot[:, 1] - top
    shown = _sampled(glimpse.picture[window], u, v)
    scene = _sampled(glimpse.behind[window], u, v) * glimpse.gain
    clear = 1.0 - patch.opacity
    whole = patch.look * glimpse.gain
    look = patch.opacity * whole
    difference = shown - clear[:, None] * scene
    # the light on the thing changes a little as it turns: brightness is free
    counted = look * free
    bright = float(counted @ difference[:, 0]) / max(float(counted @ look), 1e-9)
    residual = difference[:, 0] - bright * look
    size = np.abs(residual[free])
    scale = max(1.4826 * float(np.median(size)), 0.7 * glimpse.noise)
    weight = free / (1.0 + (residual / (_ROBUST * scale)) ** 2) ** 2
    without = shown[:, 0] - scene[:, 0]
    return Held(
        residual,
        weight,
        difference[:, 1:],
        look,
        scale,
        seen,
        float(_gained(without[free], residual[free], patch.opacity[free], glimpse.noise)),
        _explained(without[free], residual[free], patch.opacity[free]),
    )


def _gained(without: FloatArray, left: FloatArray, opacity: FloatArray, noise: float) -> np.float64:
    """Log-likelihood of robust residuals with the body over that without it."""

    def cost(residual: FloatArray) -> FloatArray:
        return np.asarray(np.log1p((residual / (_ROBUST * noise)) ** 2))

    gain = (_ROBUST**2 / 2) * (cost(without) - cost(left))
    return np.sum(opacity * gain) / CORRELATED_PIXELS


def _explained(without: FloatArray, left: FloatArray, opacity: FloatArray) -> float:
    """1 − what is left over what there was, by absolute values, which a few stray pixels spare."""
    there = float(opacity @ np.abs(without))
    return 1.0 - float(opacity @ np.abs(left)) / max(there, 1e-9)


def _sampled(window: FloatImage, u: FloatArray, v: FloatArray) -> FloatArray:
    """Value and slopes of a window at points, (n, 3)."""
    value = sampled(window, u, v)
    gx = cv2.sepFilter2D(window, cv2.CV_32F, _SLOPE, _FLAT)
    gy = cv2.sepFilter2D(window, cv2.CV_32F, _FLAT, _SLOPE)
    slopes = [sampled(np.asarray(one, np.float32), u, v, cv2.INTER_LINEAR) for one in (gx, gy)]
    return np.column_stack([value, *slopes]).astype(np.float64)


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
    coarse = _thinned(patch)
    held = [hold(coarse, swing, float(angle), glimpse) for angle in tried]
    gains = np.array([-np.inf if one is None else one.gain_of_it for one in held])
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
    offsets = np.column_stack([patch.x, patch.y])
    for _ in range(_STEPS):
        held = hold(patch, swing, angle, glimpse)
        if held is None:
            return None
        shift, turned = swing.per_radian(angle)
        pull = np.einsum("ni,ni->n", held.slope, offsets @ turned.T + shift)
        weighted = held.weight * pull
        cross, own = float(weighted @ held.look), float((held.weight * held.look) @ held.look)
        normal = float(weighted @ pull) - cross**2 / max(own, 1e-9)
        if normal <= 0.0:
            return None
        step = float(np.clip(-(weighted @ held.residual) / normal, -1.5 / arm, 1.5 / arm))
        found = _placed(held, glimpse, angle, normal)
        if abs(step) * arm < _DONE_PX:
            return found
        angle += step
    return found if abs(step) * arm < _SETTLED_PX else None


def _placed(held: Held, glimpse: Glimpse, angle: float, normal: float) -> Placed:
    std = float(np.sqrt(CORRELATED_PIXELS / normal)) * held.scale
    spread = float(held.weight @ held.residual**2) / float(held.weight.sum() + 1e-9)
    misfit = float(np.sqrt(spread)) / glimpse.noise
    return Placed(angle, std, misfit, held.seen, held.explained, held.gain_of_it)
