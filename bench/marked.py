"""Positions of objects marked by eye in real clips."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

__all__ = ["MarkedObject", "marked_objects"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class MarkedObject:
    """Positions of one object: frame, centre (N, 2) and uncertainty (N,), px."""

    frame: NDArray[np.int64]
    centre: FloatArray
    std: FloatArray


def marked_objects(path: Path) -> list[MarkedObject]:
    """The objects of a file, by name."""
    table = pd.read_csv(path)
    if "object" not in table:
        table["object"] = "ball"
    return [
        MarkedObject(
            one["frame"].to_numpy(np.int64),
            one[["x_px", "y_px"]].to_numpy(np.float64),
            one["uncertainty_px"].to_numpy(np.float64),
        )
        for _, one in table.fillna({"object": "ball"}).groupby("object")
    ]
