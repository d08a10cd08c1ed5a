"""Test a fit for lack of fit by trials that repeat one setting.

Repeats of a setting differ by chance alone, so what settings differ by beyond that is missing from
the model. Trials are permuted over the settings, which needs no assumption on the noise.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mismatch.fitting.fit import Fit, spread_laws
from mismatch.forward import NUISANCES, Forward
from mismatch.records import settings_of
from physics.domain import FloatArray

__all__ = ["IN_ANOTHER_ORDER", "MIN_P_VALUE", "RepeatsTest", "lack_of_fit", "repeats_of"]

IN_ANOTHER_ORDER = (
    "the same settings in another order, or on another day: does what they differ by stay with the"
    " setting, or with the session"
)
"""What to measure where settings differ and no law says by what."""

PERMUTATIONS = 1999
"""Permutations of the trials; p-values have steps of 1/2000."""

MIN_P_VALUE = 2e-3
"""Probability of so large a difference by chance below which a fit lacks something. Convention: one
campaign in five hundred."""

TIME_BINS = 4
"""Parts of a record in which residuals are averaged. Chosen; insensitive between 2 and 8."""


@dataclass(frozen=True)
class RepeatsTest:
    """Difference between settings, compared with that between repeats of a setting.

    Attributes
    ----------
    settings, trials : int
        Settings with repeats, and the trials at them.
    ratio : float
        Variance between settings over that between repeats, of the quantity that differs most.
    p_value : float
        Probability of such a ratio, or a larger one, of any quantity by chance.
    quantity : str
        The quantity that differs most.
    """

    settings: int
    trials: int
    ratio: float
    p_value: float
    quantity: str

    @property
    def lacks(self) -> bool:
        """Whether the settings differ by more than chance."""
        return self.p_value < MIN_P_VALUE

    @property
    def in_words(self) -> str:
        """The result in one sentence."""
        where = f"{self.trials} trials repeat {self.settings} settings"
        p_value = f"p = {self.p_value:.2g}" if self.p_value > MIN_P_VALUE else "p < 0.002"
        if not self.lacks:
            return (
                f"{where}: what the model leaves differs no more between settings than between"
                f" repeats ({p_value})"
            )
        return (
            f"{where}: what the model leaves of {self.quantity} varies {self.ratio:.1f} times as"
            f" much between settings as between repeats ({p_value}), so something that depends on"
            " the setting is missing"
        )


def lack_of_fit(
    setting: NDArray[np.int64], quantities: Mapping[str, FloatArray]
) -> RepeatsTest | None:
    """Compare residual quantities (T,) between settings with those between repeats.

    Returns
    -------
    RepeatsTest or None
        None with fewer than two settings that have repeats.
    """
    kept = setting >= 0
    kept &= np.array([np.count_nonzero(setting == one) > 1 for one in setting], dtype=bool)
    varied = {name: v for name, v in quantities.items() if kept.any() and _varies(v[kept])}
    _, group = np.unique(setting[kept], return_inverse=True)
    settings, trials = int(group.max(initial=-1)) + 1, int(kept.sum())
    if settings < 2 or not varied:
        return None
    columns = np.stack([v[kept] for v in varied.values()], axis=1)
    seen = _ratios(columns, group)
    rng = np.random.default_rng(17)
    drawn = np.array(
        [_ratios(columns[rng.permutation(trials)], group).max() for _ in range(PERMUTATIONS)]
    )
    first = int(np.argmax(seen))
    p_value = (1 + np.count_nonzero(drawn >= seen[first])) / (1 + PERMUTATIONS)
    return RepeatsTest(settings, trials, float(seen[first]), float(p_value), list(varied)[first])


def _varies(values: FloatArray) -> bool:
    return bool(np.isfinite(values).all() and np.ptp(values) > 0.0)


def _ratios(columns: FloatArray, group: NDArray[np.int64]) -> FloatArray:
    """F ratio of each column (T, n): variance between groups over that within."""
    count = np.bincount(group)
    means = np.stack([np.bincount(group, one) for one in columns.T]) / count
    between = (count * np.square(means - columns.mean(axis=0)[:, None])).sum(axis=1)
    within = np.square(columns.T - means[:, group]).sum(axis=1)
    freedom = max(len(group) - len(count), 1)
    return np.asarray(
        (between / (len(count) - 1)) / np.maximum(within / freedom, 1e-12 * between + 1e-300)
    )


def repeats_of(forward: Forward, fit: Fit) -> RepeatsTest | None:
    """Lack of fit of strikes whose back-swings and balls repeat; None for other records.

    Compared are what each trial's own values had to take up, and its mean residuals.
    """
    if forward.mode != "impact":
        return None
    records = forward.records
    setting = settings_of(records.backswing, list(records.ball_index))
    own = spread_laws(forward, fit.model, fit.nuisance, fit.law_offsets)
    quantities = {
        name.replace("_", " "): own[:, column]
        for column, name in enumerate(NUISANCES["impact"])
        if name != "clock"
    }
    rows, used = records.ball_time.shape[1], records.used
    for axis, name in enumerate(("x", "y", "z", "the angle")):
        part = slice(axis * rows, (axis + 1) * rows) if axis < 3 else slice(3 * rows, None)
        for place, piece in enumerate(np.array_split(np.arange(used.shape[1])[part], TIME_BINS), 1):
            count = used[:, piece].sum(axis=1)
            if piece.size and count.all():
                mean = np.where(used[:, piece], fit.residual[:, piece], 0.0).sum(axis=1) / count
                quantities[f"{name} in quarter {place} of the record"] = mean
    return lack_of_fit(setting, quantities)
