"""A measured quantity: value, standard uncertainty, unit, and its budget (GUM, JCGM 100)."""

import math
from dataclasses import dataclass

from metrology.sources import UncertaintySource

__all__ = ["Contribution", "Quantity"]


@dataclass(frozen=True)
class Contribution:
    """One line of an uncertainty budget.

    Attributes
    ----------
    source : UncertaintySource
        The input the uncertainty comes from.
    std : float
        What it adds to the quantity, one standard deviation, in the quantity's unit.
    """

    source: UncertaintySource
    std: float


@dataclass(frozen=True)
class Quantity:
    """A number that can be defended, or the reason why there is none.

    Attributes
    ----------
    name : str
        Name as in the results table ("launch_angle").
    value : float or None
        Best estimate; None where it could not be measured.
    std : float or None
        Combined standard uncertainty, k = 1.
    unit : str
        Unit of value and std ("m", "s", "deg", "m/s", "1").
    reason : str or None
        Why there is no value.
    budget : tuple of Contribution
        Independent contributions whose root sum of squares is `std`.
    """

    name: str
    value: float | None
    std: float | None
    unit: str
    reason: str | None = None
    budget: tuple[Contribution, ...] = ()

    @classmethod
    def measured(
        cls, name: str, value: float, unit: str, budget: tuple[Contribution, ...]
    ) -> "Quantity":
        """Build a quantity whose standard uncertainty is the root sum of squares of its budget."""
        std = math.sqrt(sum(line.std**2 for line in budget))
        return cls(name, float(value), std, unit, None, budget)

    @classmethod
    def missing(cls, name: str, unit: str, reason: str) -> "Quantity":
        """Build a quantity that could not be measured, with the reason why."""
        return cls(name, None, None, unit, reason)

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return self.value is not None
