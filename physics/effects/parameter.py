"""A number that a law leaves open, and what is known of it beforehand."""

from dataclasses import dataclass

__all__ = ["Parameter"]

OUTLIER_COST = 12.0
"""Chi-square units for a value from the list of outliers: odds of one to four hundred."""

USUAL = 6.0
"""Widths up to which a value is no outlier: beyond six standard deviations a Gaussian prior has
odds of one in 5e8, below those of `OUTLIER_COST`."""

OUTLIER_WIDTH = 0.005
"""Relative width of such a value: a wrong frame rate or ruler is wrong by a round factor, read as
well as a nominal rate is kept, half a per cent."""


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

    @property
    def is_shape(self) -> bool:
        """Whether the parameter says where or how, but not how much."""
        return bool(self.grid)

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
