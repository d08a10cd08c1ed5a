"""Frames lost at an instant of its own in each trial.

A jump of the clock shows as the velocity from one instant on. One derivative, cut off at every
instant in turn, therefore scores all instants of a trial at once.
"""

from dataclasses import dataclass, replace

import numpy as np

from mismatch.fitting.fit import Fit
from mismatch.fitting.hypotheses import MISFIT
from mismatch.fitting.normal_equations import inverse_of, linearise
from mismatch.model.forward import Forward
from physics.arrays import FloatArray, Number
from physics.effects import CATALOGUE, Values
from physics.effects.measurement import DroppedFrames

__all__ = ["DroppedInEach", "dropped_in_each"]

INSTANTS = 160
LEAST_STEP = 1e-5
"""s of gap for the derivative."""


@dataclass(frozen=True)
class DroppedInEach(DroppedFrames):
    """The same number of frames lost in every trial, each time at another instant.

    Attributes
    ----------
    instants : tuple of float
        s after contact onset, by trial.
    looks : float
        What finding them costs (chi-square units).
    """

    form: str = "at an instant of its own in each trial"
    instants: tuple[float, ...] = ()
    looks: float = 0.0

    def clock(self, values: Values, time: Number) -> Number:
        """Jump once in each trial."""
        after = np.asarray(time, dtype=np.float64) - np.array(self.instants)[:, None]
        return np.asarray(time + values["gap"] * np.heaviside(after, 0.0))


def _since(forward: Forward, fit: Fit) -> FloatArray:
    """(T, 3S + P) time of every entry after contact onset (or the first sample)."""
    records = forward.records
    if forward.mode == "impact":
        clock = fit.nuisance[:, :1]
        ball, swing = records.ball_time - clock, records.pendulum_time - clock
    else:
        ball = records.ball_time - records.ball_time[:, :1]
        swing = records.pendulum_time - records.pendulum_time[:, :1]
    return np.concatenate([np.tile(ball, 3), swing], axis=1)


def dropped_in_each(forward: Forward, fit: Fit) -> DroppedInEach | None:
    """The law with each trial's likeliest instant for one common gap.

    None for swings alone, and where such gaps leave more than noise.
    """
    if forward.mode == "swing" or forward.records.trials < 2:
        return None
    common = CATALOGUE["dropped_frames"][0]
    lost = fit.model.having(common, {"gap": LEAST_STEP, "instant": -1e3})
    whole = fit.model.having(common, {"gap": 0.0, "instant": -1e3})
    system = linearise(
        forward, whole.order(), fit.nuisance, fit.law_offsets, (), [lost.order()], [LEAST_STEP]
    )
    slope = system.shared[..., -1]
    since = _since(forward, fit)
    used = forward.records.used
    scores, sizes, grids = [], [], []
    for trial in range(forward.records.trials):
        times = since[trial][used[trial]]
        low, high = (times.min(), times.max()) if times.size else (0.0, 1.0)
        grid = np.linspace(low, high, INSTANTS + 2)[1:-1]
        column = slope[trial][:, None] * (since[trial][:, None] > grid)
        own = system.own[trial]
        inner = own.T @ own + np.diag(system.prior)
        inner = inner + 1e-12 * np.diag(np.diag(inner))
        # A coordinate that no row of this trial shows makes the system singular.
        left = column - own @ (inverse_of(inner) @ (own.T @ column))
        scores.append(left.T @ system.residual[trial])
        sizes.append(np.einsum("mg,mg->g", left, column))
        grids.append(grid)
    score, size, grid = np.array(scores), np.array(sizes), np.array(grids)
    frame = float(np.median(np.diff(forward.records.ball_time, axis=1)))
    # Frames get lost; a record that gains some would be told otherwise.
    gaps = np.geomspace(0.05, 40.0, 40) * frame
    # What is left over for other reasons makes steps, too: differences count in units of it.
    gains = 2.0 * gaps[:, None, None] * score - np.square(gaps)[:, None, None] * size
    gains = gains / fit.misfit
    # Averaged over the instants, as likely all of them, a trial's evidence pays for its own search.
    largest = gains.max(axis=2)
    mean = np.exp(0.5 * (gains - largest[..., None])).mean(axis=2)
    evidence = (largest + 2.0 * np.log(mean)).sum(axis=1)
    best = int(np.argmax(evidence))
    which = np.argmax(gains[best], axis=1)[:, None]
    instants = np.take_along_axis(grid, which, axis=1)[:, 0]
    # At the chosen instants a fit finds a larger gap, and gains more than it may keep.
    fitted = np.square(np.take_along_axis(score, which, axis=1).sum())
    fitted /= max(float(np.take_along_axis(size, which, axis=1).sum()), 1e-30)
    if fit.chi2 - fitted > MISFIT * fit.expected:
        # A step at will in each trial takes a part of any misfit; it is believed if it takes all.
        return None
    gap = replace(common.parameters[0], lower=0.0)
    return DroppedInEach(
        parameters=(gap,),
        instants=tuple(float(t) for t in instants),
        looks=float(max(fitted - fit.misfit * evidence[best], 0.0)),
    )
