"""What follows from a failed check: which quantities hang on it, and how far they are in doubt.

When a check that found nothing may say "passed".
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from metrology import Contribution, Quantity, UncertaintySource
from pipelines.measure.inputs import QuantityName

__all__ = [
    "COR",
    "FLIGHT",
    "LEAST_POWER",
    "PENDULUM",
    "RATE_AND_SCALE",
    "WITHHELD_BEYOND",
    "Contradiction",
    "doubted",
]

WITHHELD_BEYOND = 0.1

"""Share of a quantity that a contradiction may put in doubt before it says nothing any more,
supposed."""

COR = frozenset(
    {
        QuantityName.COR_SPEEDS,
        QuantityName.COR_LAUNCH,
        QuantityName.COR_RANGE,
        QuantityName.COR,
    }
)

FLIGHT = COR | {
    QuantityName.BALL_SPEED,
    QuantityName.LAUNCH_ANGLE,
    QuantityName.LANDING_DISTANCE,
    QuantityName.LANDING_DISTANCE_ON_WALL,
    QuantityName.LANDING_TIME,
    QuantityName.EXTERNAL_IMPULSE,
    QuantityName.CONTACT_TIME,
    QuantityName.CONTACT_END,
    QuantityName.CONTACT_FRAMES,
}

"""What hangs on the fitted flight."""

PENDULUM = COR | {
    QuantityName.PENDULUM_SPEED_BEFORE,
    QuantityName.PENDULUM_SPEED_AFTER,
    QuantityName.ENERGY_LOSS,
}

"""What hangs on the pendulum's motion, its inertia and the masses."""

CONTACT = frozenset(
    {
        QuantityName.CONTACT_TIME,
        QuantityName.CONTACT_START,
        QuantityName.CONTACT_END,
        QuantityName.CONTACT_FRAMES,
    }
)

"""What hangs on where the mass' face meets the ball."""

RATE_AND_SCALE = frozenset(QuantityName) - {
    QuantityName.CONTACT_FRAMES,
    QuantityName.BACKSWING_ANGLE,
    QuantityName.SWING_PERIOD,
    QuantityName.SWING_DAMPING,
}

"""What hangs on the capture rate or the scale of lengths, or on the track that both are read from:
a fall that is not gravity's may be the fault of any."""


@dataclass(frozen=True)
class Contradiction:
    """A contradiction.

    Attributes
    ----------
    quantities : frozenset of QuantityName
        What hangs on it.
    share : float
        How far they may be off, over their value; of an angle over 1 rad.
    plain : bool
        Whether it is beyond repair: they are withheld.
    statement : str
        The reason, where they are.
    """

    quantities: frozenset[QuantityName]
    share: float
    plain: bool
    statement: str


def doubted(found: dict[str, Quantity], doubts: Iterable[Contradiction]) -> dict[str, Quantity]:
    """The quantities, widened or withheld by what contradicts them."""
    out = dict(found)
    for doubt in doubts:
        withheld = doubt.plain or doubt.share > WITHHELD_BEYOND
        for name in doubt.quantities:
            item = out.get(name)
            if item is None or item.value is None:
                continue
            out[name] = (
                Quantity.missing(name.value, item.unit, doubt.statement)
                if withheld
                else _widened(item, doubt.share)
            )
    return out


def _widened(item: Quantity, share: float) -> Quantity:
    assert item.value is not None
    reach = math.degrees(1.0) if item.unit == "deg" else abs(item.value)
    line = Contribution(UncertaintySource.CONTRADICTION, share * reach)
    budget = tuple(sorted((*item.budget, line), key=lambda one: -one.std))
    return Quantity.measured(item.name, item.value, item.unit, budget)


LEAST_POWER = 0.5

"""Probability of noticing an error that matters; a check that would rather miss it can't tell."""
