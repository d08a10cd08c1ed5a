"""One row of numbers per trial: impact speed, ball speed, range, with or without a back-swing."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metrology import TooLittleDataError, UsageError
from physics.arrays import FloatArray

__all__ = ["CHANNELS", "LEAST_TRIALS", "TrialTable"]

CHANNELS = ("impact_speed", "ball_speed", "range")
"""What a trial may tell, in the order of the arrays' last axis; m/s, m/s, m."""

LEAST_TRIALS = 4


@dataclass(frozen=True)
class TrialTable:
    """A campaign of which only a few numbers per trial are left.

    Attributes
    ----------
    names : tuple of str
        Of the T trials.
    balls : tuple of str or None
        Name of each trial's ball; None where the table has no such column.
    values : (T, 3) array
        Impact speed and ball's speed after contact (m/s), and range (m, ball's centre from rest to
        where it touches the floor); NaN where missing.
    stds : (T, 3) array
        Standard uncertainties; NaN where none is stated.
    backswing : (T,) array
        rad; NaN where missing.
    notes : tuple of str
        What was set right or left out while reading.
    """

    names: tuple[str, ...]
    balls: tuple[str | None, ...]
    values: FloatArray
    stds: FloatArray
    backswing: FloatArray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = self.values[np.isfinite(self.values)]
        if np.any(values <= 0.0):
            raise UsageError(
                "speeds and ranges must be positive",
                hint="The range runs from the ball's centre at rest the way the ball flies.",
            )
        if np.any(self.stds[np.isfinite(self.stds)] <= 0.0):
            raise UsageError(
                "a standard uncertainty must be positive", hint="Leave it empty where unknown."
            )

    @property
    def trials(self) -> int:
        """Number of rows."""
        return len(self.names)

    @property
    def present(self) -> NDArray[np.bool_]:
        """(3,) which channels the table has at all."""
        return np.asarray(np.isfinite(self.values).any(axis=0))

    def require_enough(self) -> None:
        """Refuse a table that can tell nothing.

        Raises
        ------
        UsageError
            If it has no result, or nothing that says how hard the ball was hit.
        TooLittleDataError
            If it has too few trials.
        """
        if not self.present[1:].any():
            raise UsageError(
                "the table has neither a ball speed nor a range",
                hint="Add a column ball_speed_m_s or range_m.",
            )
        started = np.isfinite(self.values[:, 0]) | np.isfinite(self.backswing)
        if not started.all():
            name = self.names[int(np.argmin(started))]
            raise UsageError(
                f"trial {name} has neither an impact speed nor a back-swing",
                hint="Fill impact_speed_m_s or backswing_deg, or leave the row out.",
            )
        useful = int(np.isfinite(self.values[:, 1:]).any(axis=1).sum())
        if useful < LEAST_TRIALS:
            raise TooLittleDataError(
                f"{useful} trials with a result are too little to tell anything",
                hint=f"At least {LEAST_TRIALS} trials at two or more impact speeds are needed.",
            )

    def chosen(self, rows: NDArray[np.bool_]) -> "TrialTable":
        """Table with the marked rows alone."""
        index = np.flatnonzero(rows)
        return replace(
            self,
            names=tuple(self.names[i] for i in index),
            balls=tuple(self.balls[i] for i in index),
            values=self.values[index],
            stds=self.stds[index],
            backswing=self.backswing[index],
        )
