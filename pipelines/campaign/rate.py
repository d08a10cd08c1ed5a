"""One capture rate for all clips of a campaign that state none.

Every clip's free fall gives a rate; what they share (scale, drag) does not average out.
"""

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from metrology import write_text_whole
from pipelines.campaign.ledger import Entry
from vision.clip.footage import RateSource

__all__ = ["MAX_PILOTS", "CommonRate", "common_rate", "kept_rate"]

RATE_FILE = "rate.json"
"""File of the campaign's folder with the common rate."""

MAX_PILOTS = 8
"""Clips that are measured to estimate the rate, and then again with it (chosen: more hardly reduce
what all clips share)."""

_MIN_CLIPS = 3
"""Clips whose rates are compared (derived: two differences show whether one is an outlier)."""

_MAX_CHI2_PER_CLIP = 6.0
"""χ² per degree of freedom beyond which the clips have no common rate (chosen: above the 99.7 %
quantile for two degrees of freedom)."""


@dataclass(frozen=True)
class CommonRate:
    """A rate with what it was estimated from.

    Attributes
    ----------
    fps, std : float
        1/s.
    low, high : float
        Smallest and largest rate of a single clip, 1/s.
    """

    fps: float
    std: float
    clips: int
    low: float
    high: float

    def keep(self, folder: Path) -> None:
        """Write it into the campaign's folder, so that the next run uses the same."""
        write_text_whole(folder / RATE_FILE, json.dumps(vars(self), indent=1) + "\n")

    def notice(self) -> str:
        """What is assumed, and how to state it."""
        return (
            f"Frame rate not given: {self.clips} clips together give {self.fps:.5g} ±"
            f" {self.std:.2g} fps by gravity (singly {self.low:.5g} to {self.high:.5g}), which is"
            f" used for all. Pass --fps with the camera's rate, or set capture_fps in the setup"
            " file."
        )


def kept_rate(folder: Path) -> CommonRate | None:
    """The rate of an earlier run; None if there is none, or its file is damaged."""
    with suppress(OSError, ValueError, TypeError):
        found = CommonRate(**json.loads((folder / RATE_FILE).read_text(encoding="utf-8")))
        if 0.0 < found.std < found.fps < math.inf:
            return found
    return None


def common_rate(entries: Iterable[Entry]) -> CommonRate | None:
    """Rate of all clips whose rate was estimated from gravity; None if they are few or disagree.

    Parameters
    ----------
    entries : iterable of Entry
        Of the ledger.
    """
    bases = [entry.document.get("time_base") for entry in entries if entry.document is not None]
    known = [
        (float(base["capture_fps"]), float(base["std"]))
        for base in bases
        if isinstance(base, Mapping) and _is_estimated(base)
    ]
    if len(known) < _MIN_CLIPS:
        return None
    rate, std = np.array(known).T
    weight = std**-2.0
    fps = float(np.sum(weight * rate) / np.sum(weight))
    chi2 = float(np.sum(weight * (rate - fps) ** 2))
    if chi2 > _MAX_CHI2_PER_CLIP * (len(rate) - 1):
        return None
    own = float(np.var(rate, ddof=1))
    shared = max(float(np.median(std)) ** 2 - own, 0.0)
    joint = math.sqrt(shared + own / len(rate))
    return CommonRate(fps, joint, len(rate), float(rate.min()), float(rate.max()))


def _is_estimated(base: Mapping[str, Any]) -> bool:
    return base.get("source") == RateSource.ASSUMED and bool(base.get("std"))
