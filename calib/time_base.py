"""The capture rate, checked against what keeps time in view: a blinking light, free fall."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology import CalibrationError

__all__ = ["RateEstimate", "rate_from_blinking", "rate_from_fall"]

FloatArray = NDArray[np.float64]

CLEAR = 8.0
"""Log-likelihood beyond that of the best of pure noise: odds of three thousand to one."""
FALSE_ALARM = 1e-3
"""Chance that noise is taken for a blinking light: one clip in a thousand."""


@dataclass(frozen=True)
class RateEstimate:
    """A capture rate and its standard uncertainty, frames per second."""

    fps: float
    std: float
    source: str


def rate_from_blinking(
    brightness: ArrayLike, blink_hz: float, *, blink_std_hz: float = 0.0, nominal_fps: float
) -> RateEstimate:
    """Capture rate from a light of known rate.

    Parameters
    ----------
    brightness : (N,) array
        Mean gray level of the place where the light is, frame by frame.
    blink_hz, blink_std_hz : float
        Rate of the light and its uncertainty, Hz.
    nominal_fps : float
        Rate thought to be right; only tells the blink from its aliases. The true rate must lie
        within a third of it.

    Returns
    -------
    RateEstimate

    Raises
    ------
    CalibrationError
        If nothing there blinks, or too fast for this camera.
    """
    signal = np.asarray(brightness, dtype=np.float64)
    if blink_hz > nominal_fps / 2.5:
        raise CalibrationError(
            f"a light of {blink_hz:g} Hz blinks too fast for about {nominal_fps:g} fps",
            hint="Use a light that blinks at less than two fifths of the capture rate.",
        )
    count = len(signal)
    if count * blink_hz / nominal_fps < 3.0:
        raise CalibrationError(
            "the clip holds fewer than three blinks",
            hint="Film longer, or use a light that blinks faster.",
        )
    time = np.arange(count, dtype=np.float64) - 0.5 * (count - 1)
    signal = np.asarray(signal - np.polynomial.Polynomial.fit(time, signal, 1)(time))
    expected = blink_hz / nominal_fps
    trial = np.arange(expected / 1.34, expected * 1.5, 0.1 / count)
    power = np.array([_sine_power(signal, time, f) for f in trial])
    best = float(trial[int(np.argmax(power))])
    for width in (0.1, 0.01, 0.001):
        near = best + np.linspace(-1.0, 1.0, 21) * width / count
        best = float(near[int(np.argmax([_sine_power(signal, time, f) for f in near]))])
    explained = _sine_power(signal, time, best)
    rest = float(signal @ signal) - explained
    noise = max(rest, 1e-12) / (count - 4)
    # An F test of two coefficients, for the best of as many independent frequencies as were tried
    independent = max(2.0, (trial[-1] - trial[0]) * count)
    if explained / (2.0 * noise) < CLEAR + np.log(independent / FALSE_ALARM) / 2.0:
        raise CalibrationError(
            f"nothing there blinks at {blink_hz:g} Hz",
            hint="Mark the light itself, and check its rate.",
        )
    amplitude2 = 2.0 * explained / count
    # Cramér–Rao bound of the frequency of a sine in white noise (Rife & Boorstyn 1974)
    std = np.sqrt(6.0 * noise / (np.pi**2 * amplitude2 * count * (count**2 - 1.0)))
    fps = blink_hz / best
    relative = np.hypot(std / best, blink_std_hz / blink_hz)
    return RateEstimate(fps, float(fps * relative), "blinking light")


def _sine_power(signal: FloatArray, time: FloatArray, frequency: float) -> float:
    """Sum of squares that the best sine of a frequency (per frame) takes away."""
    angle = 2.0 * np.pi * frequency * time
    design = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    right = design.T @ signal
    return float(right @ np.linalg.solve(design.T @ design, right))


def rate_from_fall(
    heights_m: ArrayLike,
    std_m: ArrayLike,
    frames: ArrayLike,
    *,
    acceleration: float,
    relative_scale_std: float = 0.0,
) -> RateEstimate:
    """Capture rate from free fall whose scale is known by other means.

    Parameters
    ----------
    heights_m, std_m : (N,) array
        Heights and their independent standard uncertainties, m.
    frames : (N,) array
        Frame numbers.
    acceleration : float
        Downward acceleration to expect, m/s².
    relative_scale_std : float
        Relative standard uncertainty of the scale of the heights.

    Returns
    -------
    RateEstimate

    Raises
    ------
    CalibrationError
        If the heights do not fall.
    """
    y, std = np.asarray(heights_m, dtype=np.float64), np.asarray(std_m, dtype=np.float64)
    n = np.asarray(frames, dtype=np.float64)
    n = n - n.mean()
    design = np.stack([np.ones_like(n), n, -0.5 * n**2], axis=1) / std[:, np.newaxis]
    inverse = np.linalg.inv(design.T @ design)
    per_frame2 = float((inverse @ design.T @ (y / std))[2])
    if per_frame2 <= 3.0 * np.sqrt(inverse[2, 2]):
        raise CalibrationError(
            "the heights do not fall freely", hint="Give a stretch of flight after the release."
        )
    fps = float(np.sqrt(acceleration / per_frame2))
    relative = 0.5 * np.hypot(np.sqrt(inverse[2, 2]) / per_frame2, relative_scale_std)
    return RateEstimate(fps, float(fps * relative), "free fall")
