"""Ranges by three models from each strike's impact speed, against those measured (Table 5)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physics.bodies import Ball
from physics.forward import Experiment, closed_form_landing, impulsive_launch, numerical_landing

__all__ = ["Ranges", "ranges"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Ranges:
    """Landing distances of N strikes, m.

    Attributes
    ----------
    speed : (N,) array
        Impact speed, m/s.
    measured, measured_std : (N,) array
    numerical : (N,) array
        The paper's steps a to e with drag in both directions and the fitted law.
    variable : (N,) array
        Eqs 13 to 16 with the fitted law.
    constant : (N,) array
        Eqs 13 to 16 with the law's value at rest, as the paper's "constant".
    """

    speed: FloatArray
    measured: FloatArray
    measured_std: FloatArray
    numerical: FloatArray
    variable: FloatArray
    constant: FloatArray

    def rms(self) -> dict[str, float]:
        """Root mean square of model less measured, m, for each model."""
        return {
            name: float(np.sqrt(np.nanmean((getattr(self, name) - self.measured) ** 2)))
            for name in ("numerical", "variable", "constant")
        }


def ranges(
    experiment: Experiment,
    cor: Callable[[FloatArray], FloatArray],
    speed: FloatArray,
    measured: FloatArray,
    measured_std: FloatArray,
) -> Ranges:
    """Foretell the range of each strike.

    Parameters
    ----------
    experiment : Experiment
    cor : callable
        Fitted law: impact speed (m/s) to e.
    speed, measured, measured_std : (N,) array
        m/s and m.
    """
    ball: Ball = experiment.ball
    at_rest = np.full_like(speed, float(cor(np.zeros(1))[0]))
    values = np.clip(cor(speed), 1e-3, 1.0)
    at_rest = np.clip(at_rest, 1e-3, 1.0)
    time = np.asarray(ball.contact_time(speed))
    launch = impulsive_launch(experiment, speed, values, time)
    constant = impulsive_launch(experiment, speed, at_rest, time)
    return Ranges(
        speed,
        measured,
        measured_std,
        np.asarray(numerical_landing(experiment, launch).distance),
        np.asarray(closed_form_landing(experiment, launch).distance),
        np.asarray(closed_form_landing(experiment, constant).distance),
    )
