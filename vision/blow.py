"""What a pendulum's sure blow says of objects and of kinds of motion."""

import json
from functools import cache
from importlib import resources
from typing import NamedTuple

__all__ = ["BlowWeights", "blow_weights"]


class BlowWeights(NamedTuple):
    """Logarithms by which odds grow, fitted by `training/fit_blow.py`.

    Attributes
    ----------
    choice : float
        Of an object that was struck, to be the measured one.
    strike : float
        Of its motion, to be a strike.
    """

    choice: float
    strike: float


@cache
def blow_weights() -> BlowWeights:
    """Read the weights."""
    data = json.loads(resources.files("vision").joinpath("blow.json").read_text("utf-8"))
    return BlowWeights(*(float(data[name]["value"]) for name in BlowWeights._fields))
