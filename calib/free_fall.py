"""Lengths on the ball plane from a fall: gravity is a scale that nobody has to tape."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.calibration import Calibration, Source
from calib.scene import SceneCalibration, assembled
from metrology import CalibrationError

__all__ = ["with_free_fall"]

FloatArray = NDArray[np.float64]

NAME = "free fall"
DISAGREE_AT = 3.0
STEPS = 8
# Not among the fitted sources: what a printed grid's pitch is good to
PITCH_STD = 0.005


def with_free_fall(
    calibration: SceneCalibration,
    apparent_gravity: tuple[float, float],
    true_gravity: float,
    *,
    px: ArrayLike | None = None,
) -> SceneCalibration:
    """Fuse a measured free fall into a calibration.

    Parameters
    ----------
    calibration : SceneCalibration
        The calibration the fall was measured with.
    apparent_gravity : (value, std)
        Acceleration of free fall that the flight shows with this calibration, drag taken off, m/s²;
        the standard uncertainty holds the noise of the track and twice the relative uncertainty of
        the capture rate, not that of the calibration.
    true_gravity : float
        Local gravity, m/s².
    px : (N, 2) array, optional
        Where in the picture the ball fell; the middle of the picture if not given.

    Returns
    -------
    SceneCalibration
        With a further warning if the fall contradicts the calibration.

    Raises
    ------
    CalibrationError
        If no such fall can be (not positive), or it puts the ball behind the wall.
    """
    value, std = apparent_gravity
    if not (value > 0.0 and std > 0.0 and true_gravity > 0.0):
        raise CalibrationError(
            f"a free fall of {value:.3g} ± {std:.2g} m/s² tells no scale",
            hint="Track more of the flight, or leave free fall out.",
        )
    before = calibration.fit
    places = [[before.lens.cx, before.lens.cy]] if px is None else np.atleast_2d(np.asarray(px))
    scale = _LogScale(calibration, np.asarray(places, dtype=np.float64))
    wanted, spread = float(np.log(true_gravity / value)), std / value
    slope = before.gradient(scale)
    prior = float(slope @ before.covariance @ slope)
    warnings = calibration.warnings
    if abs(wanted) > DISAGREE_AT * np.hypot(np.sqrt(prior), spread):
        warnings += (_contradiction(calibration, slope, wanted, apparent_gravity, true_gravity),)
    return assembled(_updated(before, scale, wanted, spread), calibration.grid, warnings)


class _LogScale:
    """Log of how long a vertical length on the ball plane comes out, against the first camera."""

    def __init__(self, calibration: SceneCalibration, px: FloatArray) -> None:
        self.px = px
        self.up_px = np.linalg.inv(calibration.jacobian(px))[..., 1]
        # A length of the picture's fiftieth part: straight, yet far above rounding
        longest = np.linalg.norm(self.up_px, axis=-1, keepdims=True)
        self.length = 0.02 * calibration.fit.lens.height / longest
        self.up_px = self.up_px * self.length

    def __call__(self, c: Calibration) -> float:
        depth = c.ball_plane_offset
        above = c.grid_camera.to_plane(self.px + 0.5 * self.up_px, depth)[:, 1]
        below = c.grid_camera.to_plane(self.px - 0.5 * self.up_px, depth)[:, 1]
        return float(np.mean(np.log((above - below) / self.length[:, 0])))


def _updated(before: Calibration, scale: _LogScale, wanted: float, spread: float) -> Calibration:
    """Iterated Kalman update; the sources keep their names, each with what is left of it."""
    prior = before.covariance
    first = scale(before)
    now = before
    for _ in range(STEPS):
        slope = now.gradient(scale)
        gain = prior @ slope / (slope @ prior @ slope + spread**2)
        surprise = wanted - (scale(now) - first) - slope @ (before.vector - now.vector)
        now = before.with_parameters(before.vector + gain * surprise)
    left = np.eye(len(gain)) - np.outer(gain, slope)
    sources = [Source(s.name, left @ s.covariance @ left.T) for s in before.sources]
    sources.append(Source(NAME, np.outer(gain, gain) * spread**2))
    return replace(now, sources=tuple(sources))


def _contradiction(
    calibration: SceneCalibration,
    slope: FloatArray,
    wanted: float,
    apparent: tuple[float, float],
    true_gravity: float,
) -> str:
    """Say what disagrees, and which input would have to be off by the fewest uncertainties."""
    candidates = [(abs(wanted) / PITCH_STD, "the pitch of the grid", "")]
    for source in calibration.fit.sources:
        effect = float(np.sqrt(max(0.0, slope @ source.covariance @ slope)))
        if effect > 0.0:
            depth = float((source.covariance @ slope)[11]) * wanted / effect**2
            would = f" (ball plane {1e2 * (calibration.ball_plane_offset.value + depth):.0f} cm)"
            candidates.append((abs(wanted) / effect, source.name, would))
    _, likeliest, would = min(candidates)
    sense = "short" if wanted > 0.0 else "long"
    faster = 100.0 * math.expm1(0.5 * wanted)
    return (
        f"the ball falls with {apparent[0]:.2f} ± {apparent[1]:.2f} m/s² instead of "
        f"{true_gravity:.2f}: lengths on its plane come out {100.0 * abs(math.expm1(-wanted)):.1f} % "
        f"too {sense}; likeliest wrong: {likeliest}{would}, or the capture rate "
        f"(by {faster:+.1f} %)"
    )
