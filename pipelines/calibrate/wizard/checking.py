"""A known length against the calibration."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from metrology import UsageError, measurands, read_number
from pipelines.calibrate.wizard.outlook import length_between

__all__ = ["Verdict", "verdict"]

FloatArray = NDArray[np.float64]

DISAGREES_AT = 3.0
"""Standard deviations: less than one true length in 300 is further off."""


@dataclass(frozen=True)
class Verdict:
    """What a known length says.

    Attributes
    ----------
    text : str
    disagrees : bool
        Whether it contradicts the calibration.
    """

    text: str
    disagrees: bool = False


def verdict(
    calibration: Calibration, first: FloatArray, second: FloatArray, known: str, *, on_wall: bool
) -> Verdict:
    """Measure between two places and compare.

    Parameters
    ----------
    calibration : Calibration
    first, second : (2,) array
        Px.
    known : str
        The length as somebody wrote it, empty for none.
    on_wall : bool
        Else on the ball's plane.
    """
    length = length_between(calibration, first, second, on_wall=on_wall)
    plane = "on the wall" if on_wall else "on the ball's plane"
    if not np.isfinite(length.value):
        return Verdict("One end looks past the wall.", disagrees=True)
    told = f"{length.value:.4f} ± {length.std:.4f} m between the ends, {plane}."
    if not known.strip():
        return Verdict(told)
    try:
        true = read_number(known, measurands.DISTANCE)
    except UsageError as problem:
        return Verdict(f"{told} {problem.in_one_line}", disagrees=True)
    off = length.value - true
    ratio = abs(off) / length.std
    agrees = "agrees" if ratio < DISAGREES_AT else "disagrees: check the grid's pitch and the ends"
    return Verdict(
        f"{told} {1e3 * off:+.1f} mm off, {ratio:.1f} standard deviations: {agrees}.",
        ratio >= DISAGREES_AT,
    )
