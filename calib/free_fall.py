"""Lengths on the ball plane from a fall: gravity is a scale that nobody has to tape."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.calibration import Calibration
from calib.evidence import Evidence, FreeFall, Known
from calib.grid.grid import WallGrid
from calib.plausibility import plausible
from calib.pose import LensPrior, calibrate
from metrology import CalibrationError

__all__ = ["CalibrationByFall", "with_free_fall"]

FloatArray = NDArray[np.float64]

DISAGREE_AT = 3.0
# Not among the fitted inputs: what the pitch of a printed grid is good to
PITCH_STD = 0.005
PATH_POINTS = 9


@dataclass(frozen=True)
class CalibrationByFall:
    """A calibration that a free fall took part in.

    Attributes
    ----------
    calibration : Calibration
    contradiction : str or None
        What disagrees, where the fall contradicts everything else; None where it does not.
    """

    calibration: Calibration
    contradiction: str | None = None


def with_free_fall(
    calibration: Calibration,
    grid: WallGrid,
    evidence: Evidence,
    apparent_gravity: tuple[float, float],
    true_gravity: float,
    *,
    px: ArrayLike | None = None,
    lens: LensPrior | None = None,
) -> CalibrationByFall:
    """Fit a calibration anew with a measured free fall as a further input.

    Parameters
    ----------
    calibration : Calibration
        The calibration, as fitted, that the fall was measured with.
    grid : WallGrid
        The grid it was fitted to.
    evidence : Evidence
        What else it was fitted to.
    apparent_gravity : (value, std)
        Acceleration of free fall that the flight shows with this calibration, drag taken off, m/s²;
        the standard uncertainty holds the noise of the track and twice the relative uncertainty of
        the capture rate, not that of the calibration.
    true_gravity : float
        Local gravity, m/s².
    px : (N, 2) array, optional
        Where in the picture the ball flew; the middle of the picture if not given.
    lens : LensPrior, optional
        Lens known beforehand, as in the first fit.

    Returns
    -------
    CalibrationByFall

    Raises
    ------
    CalibrationError
        If there is no such fall (its acceleration is not positive), or it puts the ball behind the
        wall.
    """
    value, std = apparent_gravity
    if not (value > 0.0 and std > 0.0 and true_gravity > 0.0):
        raise CalibrationError(
            f"a free fall of {value:.3g} ± {std:.2g} m/s² tells no scale",
            hint="Track more of the flight, or leave free fall out.",
        )
    time, path = _path(calibration, value, px)
    fall = FreeFall(path, time, np.full(len(time), 1e-4), Known(true_gravity, std))
    fused = plausible(calibrate(grid, replace(evidence, fall=fall), lens=lens))

    def log_acceleration(c: Calibration) -> float:
        y = c.position(path)[0][:, 1]
        return math.log(-2.0 * float(np.polyfit(time, y, 2)[0]))

    slope = calibration.gradient(log_acceleration)
    prior = float(slope @ calibration.covariance @ slope)
    wanted = math.log(true_gravity / value)
    if abs(wanted) < DISAGREE_AT * math.hypot(math.sqrt(max(prior, 0.0)), std / value):
        return CalibrationByFall(fused)
    told = _contradiction(calibration, slope, wanted, apparent_gravity, true_gravity)
    return CalibrationByFall(replace(fused, warnings=(*fused.warnings, told)), contradiction=told)


def _path(
    calibration: Calibration, gravity: float, px: ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    """A throw that shows the given acceleration, where the ball flew: times and outline centres."""
    width, height = calibration.lens.width, calibration.lens.height
    if px is None:
        px = np.array([[0.5 * width, 0.35 * height], [0.5 * width, 0.65 * height]])
    seen = calibration.position(px)[0]
    low, high = seen.min(axis=0), seen.max(axis=0)
    reach = math.sqrt(2.0 * (high[1] - low[1]) / gravity)
    time = np.linspace(-reach, reach, PATH_POINTS)
    centre = np.stack(
        [
            0.5 * (low[0] + high[0]) + 0.5 * (high[0] - low[0]) * time / reach,
            high[1] - 0.5 * gravity * time**2,
            np.full(PATH_POINTS, calibration.ball_plane_offset),
        ],
        axis=-1,
    )
    if calibration.ball_radius is None:
        return time, calibration.camera.project(centre)
    return time, calibration.camera.sphere_outline(centre, calibration.ball_radius)[0]


def _contradiction(
    calibration: Calibration,
    slope: FloatArray,
    wanted: float,
    apparent: tuple[float, float],
    true_gravity: float,
) -> str:
    """Say what disagrees, and which input would have to be off by the fewest uncertainties."""
    candidates: list[tuple[float, str]] = [(abs(wanted) / PITCH_STD, "the pitch of the grid")]
    for source in calibration.sources:
        effect = math.sqrt(max(0.0, float(slope @ source.covariance @ slope)))
        if effect > 0.0:
            candidates.append((abs(wanted) / effect, source.name))
    faster = 100.0 * math.expm1(0.5 * wanted)
    percent = 100.0 * abs(math.expm1(-wanted))
    return (
        f"the ball falls with {apparent[0]:.2f} ± {apparent[1]:.2f} m/s² instead of "
        f"{true_gravity:.2f}: lengths on its plane come out {percent:.1f} % too "
        f"{'short' if wanted > 0.0 else 'long'}; likeliest wrong: {min(candidates)[1]}, or the "
        f"capture rate, which would have to be {faster:+.1f} % different"
    )
