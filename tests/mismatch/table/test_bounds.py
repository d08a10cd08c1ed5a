"""Impossible numbers in a trial table are refused before the fit."""

import numpy as np
import pytest

from metrology import UsageError
from mismatch.trial_table import TrialTable


def _table(values: float, std: float) -> TrialTable:
    return TrialTable(("a",), (None,), np.full((1, 3), values), np.full((1, 3), std), np.zeros(1))


@pytest.mark.parametrize(
    ("values", "std", "said"),
    [
        (-1.0, 0.1, "must be positive"),
        (1.0, 0.0, "must be positive"),
        (1.0, 1e-300, "smaller than anybody's"),
        (1.0, 1e300, "beyond all bounds"),
        (1e300, 0.1, "beyond all bounds"),
    ],
)
def test_bounds(values: float, std: float, said: str) -> None:
    _table(1.0, 0.1)
    _table(1.0, np.nan)
    with pytest.raises(UsageError, match=said):
        _table(values, std)
