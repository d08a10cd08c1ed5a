"""A number that a law leaves open, and what is known of it beforehand."""

from dataclasses import dataclass
from enum import Enum

__all__ = ["Extent", "Parameter", "Size"]

OUTLIER_COST = 12.0
"""Chi-square units for a value from the list of outliers: odds of one to four hundred."""

USUAL = 6.0
"""Widths up to which a value is no outlier: beyond six standard deviations a Gaussian prior has
odds of one in 5e8, below those of `OUTLIER_COST`."""

OUTLIER_WIDTH = 0.005
"""Relative width of such a value: a wrong frame rate or ruler is wrong by a round factor, read as
well as a nominal rate is kept, half a per cent."""


class Extent(Enum):
    """What a campaign stretches a shape's grid, scale and lower bound over.

    They are then given in shares of it: 0 where it begins, 1 where it ends; of a length or a
    duration, in shares of its size.
    """

    FIXED = "fixed"
    RECORD_TIME = "record time"
    FLIGHT_TIME = "flight time"
    WAY = "way"
    HEIGHT = "height"
    LENGTH_OF_WAY = "length of the way"


class Size(Enum):
    """What the bodies of a campaign multiply a parameter's scale and bounds, or its width, by."""

    ONE = "1"
    BALL_WEIGHT = "m g of the ball"
    PENDULUM_TORQUE = "m g d of the pendulum, over that of the paper's"
    BOARD = "air density times the fifth power of the pendulum's length"


@dataclass(frozen=True)
class Parameter:
    """A number that an effect's law leaves open.

    Attributes
    ----------
    name : str
        As in results and setup files.
    unit : str
        "1" for none.
    scale : float
        Size that would be unremarkable; the width of its prior.
    lower, upper : float
        What nature allows. A fit outside rejects the effect.
    neutral : float
        Value at which the effect vanishes.
    grid : tuple of float
        For a shape (a place, a width, an exponent), which says where the law acts but not how
        strongly: values to try first. Empty for a strength.
    meaning : str
        In words.
    width : float
        Standard deviation of what is found in practice: a ruler is read within a few per cent.
        A size far beyond it counts against the effect. Infinite where the bounds say it all.
    expected : float, optional
        What nature is known to give it, with that width; the neutral value if not given.
    outliers : tuple of float
        Values that do happen, far beyond the width (a clip played back at half its rate).
    over : Extent
        What the grid is stretched over; as it stands by default.
    in_units_of : Size
        What scale and bounds are multiplied by; nothing by default.
    width_in : Size
        Likewise for the width.
    """

    name: str
    unit: str
    scale: float
    lower: float
    upper: float
    neutral: float = 0.0
    grid: tuple[float, ...] = ()
    meaning: str = ""
    width: float = float("inf")
    expected: float | None = None
    outliers: tuple[float, ...] = ()
    over: Extent = Extent.FIXED
    in_units_of: Size = Size.ONE
    width_in: Size = Size.ONE

    @property
    def is_shape(self) -> bool:
        """Whether the parameter says where or how, but not how much."""
        return bool(self.grid)

    @property
    def is_known(self) -> bool:
        """Whether nature gives it a size other than none."""
        return self.expected is not None and self.expected != self.neutral

    @property
    def is_held(self) -> bool:
        """Whether it is one weight of many, each held near nothing by its width."""
        return self.expected is not None and self.expected == self.neutral

    def believable(self, value: float) -> bool:
        """Whether a value is within bounds and, where outliers are listed, usual or one of them."""
        edge = 1e-6 * max(abs(self.lower), abs(self.upper))
        if not self.lower - edge <= value <= self.upper + edge:
            return False
        near = abs(value - self.neutral) <= USUAL * self.width
        reach = 2.0 * OUTLIER_WIDTH
        return (
            not self.outliers
            or near
            or any(abs(value - one) <= reach * (1.0 + abs(one)) for one in self.outliers)
        )

    def prior_penalty(self, value: float) -> float:
        """What a value costs in chi-square units by its prior: a Gaussian, and rare spikes."""
        middle = self.neutral if self.expected is None else self.expected
        plain = ((value - middle) / self.width) ** 2
        spikes = (
            OUTLIER_COST + ((value - one) / (OUTLIER_WIDTH * (1.0 + abs(one)))) ** 2
            for one in self.outliers
        )
        return float(min(plain, *spikes)) if self.outliers else float(plain)
