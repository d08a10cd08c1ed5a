"""From a measured grid and all else that is known to a calibrated scene: the one way there.

Measuring, the wizard and planning all come through here. Where nothing is taped, a fall weighs in:
gravity is a scale that nobody has to tape.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, Evidence, FreeFall, Known, plausible
from calib.grid.grid import WallGrid
from calib.pose import LensPrior, calibrate
from metrology import CalibrationError

__all__ = ["SeenFall", "Solved", "solve"]

FloatArray = NDArray[np.float64]

DISAGREE_AT = 3.0
"""Standard deviations: of honest falls one in 370 is farther off by chance."""
PATH_POINTS = 9
"""Places on the throw that stands for the flight: a parabola needs three, the rest shows what a
calibration bends."""
PATH_STD_PX = 1e-4
"""px, of these places: they follow from the calibration, and the fall's own uncertainty holds all
that is random."""


@dataclass(frozen=True, eq=False)
class SeenFall:
    """The acceleration that a flight shows in a calibrated scene, against what it should be.

    Attributes
    ----------
    apparent : Known
        As the calibration shows it, drag taken off, m/s²; the standard uncertainty holds the noise
        of the track and twice the relative uncertainty of the capture rate, not that of the
        calibration.
    gravity : float
        Local gravity, m/s².
    px : (N, 2) array or None
        Where in the picture the ball flew; None takes the middle of the picture.
    """

    apparent: Known
    gravity: float
    px: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Solved:
    """A calibrated scene and all that it follows from.

    Attributes
    ----------
    calibration : Calibration
    grid : WallGrid
    evidence : Evidence
        A fall that took part is not in it.
    lens : LensPrior or None
    contradiction : str or None
        What disagrees, where a fall contradicts everything else; it is left out then.
    """

    calibration: Calibration
    grid: WallGrid
    evidence: Evidence
    lens: LensPrior | None = None
    contradiction: str | None = None

    def weighing(self, fall: SeenFall) -> "Solved":
        """Solve anew with a fall, as this calibration shows it, as a further input.

        Raises
        ------
        CalibrationError
            If there is no such fall (its acceleration is not positive), or it puts the ball behind
            the wall.
        """
        value, std = fall.apparent.value, fall.apparent.std
        if not (value > 0.0 and std > 0.0 and fall.gravity > 0.0):
            raise CalibrationError(
                f"a free fall of {value:.3g} ± {std:.2g} m/s² tells no scale",
                hint="Track more of the flight, or leave free fall out.",
            )
        before = self.calibration
        time, path = _path(before, fall)
        told = FreeFall(path, time, np.full(len(time), PATH_STD_PX), Known(fall.gravity, std))

        def log_acceleration(c: Calibration) -> float:
            y = c.position(path)[0][:, 1]
            return math.log(-2.0 * float(np.polyfit(time, y, 2)[0]))

        slope = before.gradient(log_acceleration)
        prior = float(slope @ before.covariance @ slope)
        wanted = math.log(fall.gravity / value)
        if abs(wanted) >= DISAGREE_AT * math.hypot(math.sqrt(max(prior, 0.0)), std / value):
            return replace(self, contradiction=_contradiction(before, slope, wanted, fall))
        evidence = replace(self.evidence, fall=told)
        return replace(self, calibration=_fitted(self.grid, evidence, self.lens))


def solve(
    grid: WallGrid,
    evidence: Evidence | None = None,
    *,
    lens: LensPrior | None = None,
    see_fall: Callable[[Calibration], SeenFall | None] | None = None,
) -> Solved:
    """Calibrate a scene with all that is known of it.

    Parameters
    ----------
    grid : WallGrid
        The measured grid.
    evidence : Evidence, optional
        Tape, ball, free fall.
    lens : LensPrior, optional
        Lens known beforehand; without it the lens comes from the grid's straight lines.
    see_fall : callable, optional
        Tells the fall that a calibration shows, None where there is none; asked where tape does
        not tell the scale.

    Returns
    -------
    Solved

    Raises
    ------
    CalibrationError
        If no camera fits the grid.
    ContradictionError
        If the ball plane would be behind the wall or behind the camera.
    """
    evidence = evidence or Evidence()
    solved = Solved(_fitted(grid, evidence, lens), grid, evidence, lens)
    if see_fall is None or evidence.taped:
        return solved
    fall = see_fall(solved.calibration)
    return solved if fall is None else solved.weighing(fall)


def _fitted(grid: WallGrid, evidence: Evidence, lens: LensPrior | None) -> Calibration:
    try:
        return plausible(calibrate(grid, evidence, lens=lens))
    except np.linalg.LinAlgError as problem:
        raise CalibrationError(
            "no camera can be fitted: the crossings of the grid lie in one line",
            hint="Show more of the wall.",
        ) from problem


def _path(calibration: Calibration, fall: SeenFall) -> tuple[FloatArray, FloatArray]:
    """A throw that shows the given acceleration, where the ball flew: times and outline centres."""
    gravity, px = fall.apparent.value, fall.px
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
    calibration: Calibration, slope: FloatArray, wanted: float, fall: SeenFall
) -> str:
    """Say what disagrees, and which input would have to be off by the fewest uncertainties."""
    candidates: list[tuple[float, str]] = []
    for source in calibration.sources:
        effect = math.sqrt(max(0.0, float(slope @ source.covariance @ slope)))
        if effect > 0.0:
            candidates.append((abs(wanted) / effect, source.name))
    faster = 100.0 * math.expm1(0.5 * wanted)
    percent = 100.0 * abs(math.expm1(-wanted))
    return (
        f"the ball falls with {fall.apparent.value:.2f} ± {fall.apparent.std:.2f} m/s² instead of "
        f"{fall.gravity:.2f}: lengths on its plane come out {percent:.1f} % too "
        f"{'short' if wanted > 0.0 else 'long'}; likeliest wrong: {min(candidates)[1]}, or the "
        f"capture rate, which would have to be {faster:+.1f} % different"
    )
