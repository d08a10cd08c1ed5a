"""Whether the ball looks as large as it is said to be, where something else tells the scale."""

import math
from dataclasses import dataclass

from scipy.special import ndtr

from metrology import Quantity
from pipelines.measure.checks.consequences import (
    CONTACT,
    LEAST_POWER,
    RATE_AND_SCALE,
    Contradiction,
)
from pipelines.measure.inputs import QuantityName
from pipelines.report import Check, CheckKind, CheckOutcome

__all__ = ["BallSize", "ball_size"]

_SIGMAS = 3.0
"""Standard deviations: of honest clips one in 370 fails by chance."""

RELEVANT_SHARE = 0.05
"""Of the radius: a twentieth more or less moves the contact by a third of its time."""


@dataclass(frozen=True)
class BallSize:
    """The check, and what it puts in doubt.

    Attributes
    ----------
    check : Check
    doubts : tuple of Contradiction
        Empty where both agree.
    """

    check: Check
    doubts: tuple[Contradiction, ...]


def ball_size(
    looks_m: float, share: float, given_m: float, found: dict[str, Quantity]
) -> BallSize | None:
    """Hold the size that was followed, at the scale of the ball plane, against the diameter.

    Parameters
    ----------
    looks_m : float
        Diameter as it looks where something else than the ball tells the scale, m.
    share : float
        Relative standard uncertainty of that and of what is given.
    given_m : float
        The diameter that is given, m.
    found : dict
        Quantities by name, before anything is doubted.

    Returns
    -------
    BallSize or None
        None where no speed tells how sure the scale is.
    """
    speed, lasts = found[QuantityName.BALL_SPEED], found[QuantityName.CONTACT_TIME]
    if speed.value is None or speed.std is None:
        return None
    apart = looks_m / given_m - 1.0
    std = math.hypot(share, speed.std / speed.value)
    power = float(ndtr(-_SIGMAS + RELEVANT_SHARE / std))
    text = (
        f"the ball looks {1e3 * looks_m:.0f} mm across at the scale of its plane, and is said to"
        f" be {1e3 * given_m:.0f} mm"
    )
    if abs(apart) <= _SIGMAS * std:
        outcome = CheckOutcome.PASSED if power >= LEAST_POWER else CheckOutcome.UNDECIDED
        return BallSize(Check(CheckKind.BALL_SIZE, outcome, text, power), ())
    text += ": check the diameter, the grid's pitch and the taped distances"
    doubts = [Contradiction(RATE_AND_SCALE, abs(apart), False, text)]
    if lasts.value is not None:
        # face and surface of the ball meet and part by so much earlier or later
        moved = abs(apart) * given_m / (speed.value * lasts.value)
        doubts.append(Contradiction(CONTACT, moved, False, text))
    return BallSize(
        Check(CheckKind.BALL_SIZE, CheckOutcome.FAILED, text, power),
        tuple(doubts),
    )
