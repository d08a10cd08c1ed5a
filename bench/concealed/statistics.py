"""Proportions with intervals, and scores of stated probabilities."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Proportion", "brier_score", "calibration_error", "wilson"]


@dataclass(frozen=True)
class Proportion:
    """`right` of `total`, with the 95 % Wilson interval."""

    right: int
    total: int

    @property
    def value(self) -> float:
        """The proportion; NaN if the total is zero."""
        return self.right / self.total if self.total else float("nan")

    def __str__(self) -> str:
        if not self.total:
            return "–"
        low, high = wilson(self.right, self.total)
        share = f"{100 * self.value:.1f} % ({self.right}/{self.total}"
        return f"{share}; {100 * low:.1f}–{100 * high:.1f})"


def wilson(right: int, total: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's score interval (J. Am. Stat. Assoc. 22, 209 (1927))."""
    share = right / total
    middle = (share + z**2 / (2 * total)) / (1 + z**2 / total)
    half = z / (1 + z**2 / total) * np.sqrt(share * (1 - share) / total + z**2 / (4 * total**2))
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def calibration_error(
    stated: Sequence[float], right: Sequence[bool], bins: int = 10
) -> tuple[float, list[tuple[float, float, int]]]:
    """Mean difference of probability and frequency, and (stated, frequency, count) per bin."""
    if not stated:
        return float("nan"), []
    p, hit = np.asarray(stated, float), np.asarray(right, float)
    which = np.minimum((p * bins).astype(int), bins - 1)
    rows = [
        (float(p[which == b].mean()), float(hit[which == b].mean()), int((which == b).sum()))
        for b in range(bins)
        if (which == b).any()
    ]
    return sum(abs(s - f) * n for s, f, n in rows) / len(p), rows


def brier_score(stated: Sequence[float], right: Sequence[bool]) -> float:
    """Mean square of stated probability minus outcome (Mon. Weather Rev. 78, 1 (1950))."""
    if not stated:
        return float("nan")
    return float(np.mean(np.square(np.asarray(stated, float) - np.asarray(right, float))))
