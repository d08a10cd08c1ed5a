"""What follows from a failed check: which quantities hang on it, and how far they are in doubt.

When a check that found nothing may say "passed".

The ball's speed the paper's ways, beside the fit: per frame (Fig. 18), and by Eqs 7 and 8.

Whether the ball looks as large as it is said to be, where something else tells the scale.

Whether the pendulum is as long as the one whose inertia is used.

Whether the contact returns no more speed than it takes.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy

from metrology import Contribution, Quantity, UncertaintySource
from physics.bodies import Pendulum
from pipelines.measure.flight_fit import SLOW_OVER_RANDOM, FlightFit
from pipelines.measure.inputs import Inputs, QuantityName
from pipelines.measure.metres import MetricTracks
from pipelines.report import Check, CheckKind, CheckOutcome
from pipelines.setup.file import Origin

__all__ = [
    "CONTACT",
    "COR",
    "FLIGHT",
    "LEAST_POWER",
    "OTHER_SPEEDS",
    "PENDULUM",
    "RATE_AND_SCALE",
    "WITHHELD_BEYOND",
    "Contradiction",
    "HeldAgainst",
    "SpeedsAgree",
    "ball_size",
    "contact_doubted",
    "doubted",
    "gravity_share",
    "passive_contact",
    "pendulum_length",
    "size_at_scale",
    "speed_by_pendulum",
    "speed_per_frame",
    "speeds_agree",
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
    QuantityName.EXTERNAL_IMPULSE,
}

"""What hangs on the pendulum's motion, its inertia and the masses."""

_BY_MASSES = frozenset({QuantityName.COR_LAUNCH, QuantityName.COR_RANGE, QuantityName.COR})
"""What the ratio of ball and pendulum enters."""

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

OTHER_SPEEDS: dict[str, str] = {"ball_speed_per_frame": "m/s", "ball_speed_eq7": "m/s"}

"""Name and unit of what is shown beside the quantities of the contract."""

_STEPS = 4

"""Frame steps of the displacement just after release: fewer are noise, more are slowed by gravity
and air."""

_SIGMAS = 3.0

"""Standard deviations: of honest clips one in 370 fails by chance."""

RELEVANT_SHARE = 0.1

"""Of the ball's speed: a disagreement that would matter to a coefficient of restitution."""


def speed_per_frame(tracks: MetricTracks, flight: FlightFit) -> tuple[float, float]:
    """Displacement per frame just after release: mean over the first frames of the flight.

    Returns
    -------
    speed, std : float
        m/s; the standard uncertainty is that of the two ends.
    """
    used = np.flatnonzero(np.isin(tracks.ball_time_s, flight.time_s))[: _STEPS + 1]
    way = tracks.ball_m[used[-1]] - tracks.ball_m[used[0]]
    took = float(tracks.ball_time_s[used[-1]] - tracks.ball_time_s[used[0]])
    spread = sum(float(np.trace(tracks.ball_cov_m2[end])) / 2 for end in (used[0], used[-1]))
    # few frames beside the mass: what changes slowly along the outline does not average out of them
    return float(np.hypot(*way)) / took, math.sqrt(spread) * math.hypot(
        1.0, SLOW_OVER_RANDOM
    ) / took


def speed_by_pendulum(body: Pendulum, ball_mass: float, before: float, after: float) -> float:
    """Ball's speed from what the pendulum loses, M_E (v_M⁰ − v_M) / m_B (Eqs 7 and 8), m/s."""
    return body.mass_at_contact * (before - after) / ball_mass


def gravity_share(
    body: Pendulum, ball_mass: float, angle: float, arm: float, pull: tuple[float, float]
) -> float:
    """What of it is no impulse on the ball: the pendulum's own weight slows it meanwhile.

    Parameters
    ----------
    body : Pendulum
    ball_mass : float
        kg.
    angle : float
        Mean angle during contact, rad.
    arm : float
        Pivot to the point of contact, m.
    pull : (2,) tuple of float
        Gravity (m/s²) and how long the contact lasts (s).

    Returns
    -------
    float
        m/s of ball speed that Eq. 7 gives too much.
    """
    gravity, duration = pull
    slowed = body.mass * gravity * body.com * math.sin(angle) * duration / body.inertia
    return speed_by_pendulum(body, ball_mass, slowed * arm, 0.0)


@dataclass(frozen=True)
class SpeedsAgree:
    """The check, and by what share of the ball's speed each of the others contradicts it.

    Attributes
    ----------
    check : Check
    flight_apart : float
        Displacement per frame against the fit: the flight itself is in doubt. 0 where they agree.
    pendulum_apart : float
        Eq. 7 against the fit: the pendulum's speeds or the masses are in doubt.
    """

    check: Check
    flight_apart: float
    pendulum_apart: float


def contact_doubted(speeds: SpeedsAgree, bound: Check | None) -> Contradiction | None:
    """What the ball's speeds say of the contact; None where nothing.

    That the pendulum loses another momentum than the ball gains may be the fault of its numbers,
    which the contact does not hang on. Where the contact besides is not surely one that such a ball
    can have, what was followed is no mass that struck it.

    Parameters
    ----------
    speeds : SpeedsAgree
    bound : Check or None
        Of the contact time against the longest possible.
    """
    surely_possible = bound is not None and bound.outcome is CheckOutcome.PASSED
    if speeds.pendulum_apart == 0.0 or surely_possible:
        return None
    said = (
        speeds.check.statement if bound is None else f"{bound.statement}; {speeds.check.statement}"
    )
    return Contradiction(CONTACT, speeds.pendulum_apart, False, said)


@dataclass(frozen=True)
class _Compared:
    apart: float
    std: float

    @property
    def differs(self) -> bool:
        return abs(self.apart) > _SIGMAS * self.std


def speeds_agree(found: dict[str, Quantity]) -> SpeedsAgree | None:
    """Whether the paper's ways agree with the fitted speed at release.

    Parameters
    ----------
    found : dict
        Quantities by name, those of `OTHER_SPEEDS` and the share of gravity in Eq. 7 among them.
    """
    fitted, frames = found["ball_speed"], found["ball_speed_per_frame"]
    if fitted.value is None or frames.value is None:
        return None
    text = f"displacement per frame gives {frames.value:.3f} ± {frames.std:.3f} m/s"
    along = _compared(frames, fitted, 0.0)
    by_pendulum = _Compared(0.0, math.inf)
    pendulum, weight = found["ball_speed_eq7"], found["eq7_by_gravity"]
    if pendulum.value is not None and weight.value is not None:
        text += (
            f"; Eq. 7 gives {pendulum.value:.2f} ± {pendulum.std:.2f} m/s from the pendulum,"
            f" {weight.value:.2f} m/s of it because gravity slows the pendulum during contact"
        )
        by_pendulum = _compared(pendulum, fitted, weight.value)
    text += f"; the fitted flight {fitted.value:.3f} ± {fitted.std:.3f} m/s"
    relevant = RELEVANT_SHARE * abs(fitted.value)
    power = float(scipy.special.ndtr(-_SIGMAS + relevant / min(along.std, by_pendulum.std)))
    outcome = CheckOutcome.PASSED if power >= LEAST_POWER else CheckOutcome.UNDECIDED
    if along.differs or by_pendulum.differs:
        outcome = CheckOutcome.FAILED
        text = f"the ball's speeds disagree: {text}; {_suspects(along, by_pendulum)}"
    return SpeedsAgree(
        Check(CheckKind.BALL_SPEEDS, outcome, text, power),
        abs(along.apart) / abs(fitted.value) if along.differs else 0.0,
        abs(by_pendulum.apart) / abs(fitted.value) if by_pendulum.differs else 0.0,
    )


def _compared(one: Quantity, other: Quantity, excess: float) -> _Compared:
    assert one.value is not None
    assert other.value is not None
    return _Compared(one.value - excess - other.value, math.hypot(one.std or 0.0, other.std or 0.0))


def _suspects(along: _Compared, by_pendulum: _Compared) -> str:
    if along.differs:
        return "the flight does not begin where it seems to, or something else was followed"
    return "check masses and inertia in the setup file, and that the mass was followed"


RELEVANT_SIZE_SHARE = 0.05
"""Of the radius: a twentieth more or less moves the contact by a third of its time."""


@dataclass(frozen=True)
class HeldAgainst:
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
) -> HeldAgainst | None:
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
    HeldAgainst or None
        None where no speed tells how sure the scale is.
    """
    speed, lasts = found[QuantityName.BALL_SPEED], found[QuantityName.CONTACT_TIME]
    if speed.value is None or speed.std is None:
        return None
    std = math.hypot(share, speed.std / speed.value)
    check = size_at_scale(
        looks_m, std, given_m, "check the diameter, the grid's pitch and the taped distances"
    )
    if check.outcome is not CheckOutcome.FAILED:
        return HeldAgainst(check, ())
    apart = abs(looks_m / given_m - 1.0)
    doubts = [Contradiction(RATE_AND_SCALE, apart, False, check.statement)]
    if lasts.value is not None:
        # face and surface of the ball meet and part by so much earlier or later
        moved = apart * given_m / (speed.value * lasts.value)
        doubts.append(Contradiction(CONTACT, moved, False, check.statement))
    return HeldAgainst(check, tuple(doubts))


def size_at_scale(looks_m: float, share: float, given_m: float, advice: str) -> Check:
    """Check the diameter that a ball has at the scale of its plane against what is said of it.

    Parameters
    ----------
    looks_m, share : float
        As it looks, m, and the relative standard uncertainty of that beside what is given.
    given_m : float
        As it is said to be, m.
    advice : str
        What to do where they differ.
    """
    # what is uncertain by a share of itself is so by as much less where it is smaller
    std = share * looks_m / given_m
    power = float(scipy.special.ndtr(-_SIGMAS + RELEVANT_SIZE_SHARE / std))
    text = (
        f"the ball looks {1e3 * looks_m:.3g} mm across at the scale of its plane, and is said to"
        f" be {1e3 * given_m:.3g} mm"
    )
    if abs(looks_m / given_m - 1.0) > _SIGMAS * std:
        return Check(CheckKind.BALL_SIZE, CheckOutcome.FAILED, f"{text}: {advice}", power)
    outcome = CheckOutcome.PASSED if power >= LEAST_POWER else CheckOutcome.UNDECIDED
    return Check(CheckKind.BALL_SIZE, outcome, text, power)


ARM_SHARE = 0.05
"""Of the arm: how far it looks too long or too short in the plane of the ball, root mean square
over path-traced rooms."""

RELEVANT_ARM_SHARE = 0.2
"""Of the length: a fifth more or less makes the inertia that was measured on another pendulum
another by half."""


def pendulum_length(seen_m: float, inputs: Inputs) -> HeldAgainst:
    """Hold the arm to the point of contact against that of the pendulum whose inertia is used.

    Parameters
    ----------
    seen_m : float
        As it looks in the plane of the ball, m.
    inputs : Inputs
        The pendulum's numbers, and whether anybody gave them.
    """
    length = inputs.rig.length
    std = math.hypot(ARM_SHARE, length.relative_std)
    apart = math.log(seen_m / length.value)
    power = float(scipy.special.ndtr(-_SIGMAS + RELEVANT_ARM_SHARE / std))
    given = "the paper's" if length.value_from is Origin.PRESET else "that of the setup file"
    text = (
        f"the pendulum's arm looks {seen_m:.2f} m long up to where it meets the ball, and {given}"
        f" is {length.value:.2f} m"
    )
    if abs(apart) <= _SIGMAS * std:
        outcome = CheckOutcome.PASSED if power >= LEAST_POWER else CheckOutcome.UNDECIDED
        return HeldAgainst(Check(CheckKind.PENDULUM_LENGTH, outcome, text, power), ())
    text += (
        ": give this pendulum's length, inertia and mass ([pendulum] in the setup file), or check"
        " the scale"
    )
    # the inertia goes with the square of the length at least
    off = 2.0 * abs(apart)
    doubts = [Contradiction(frozenset({QuantityName.ENERGY_LOSS}), off, False, text)]
    ball = inputs.ball
    if ball is not None and ball.mass is not None:
        by_masses = off * ball.mass / inputs.pendulum.mass_at_contact
        doubts.append(Contradiction(_BY_MASSES, by_masses, False, text))
    check = Check(CheckKind.PENDULUM_LENGTH, CheckOutcome.FAILED, text, power)
    return HeldAgainst(check, tuple(doubts))


def passive_contact(found: dict[str, Quantity]) -> HeldAgainst | None:
    """Hold the COR against 1: more speed than it takes, no contact without a spring returns.

    Parameters
    ----------
    found : dict
        Quantities by name, before anything is doubted.

    Returns
    -------
    HeldAgainst or None
        None where the COR is not known, or may be 1 or less: that speaks for nothing.
    """
    cor = found[QuantityName.COR]
    if cor.value is None or cor.std is None or cor.value - 1.0 <= _SIGMAS * cor.std:
        return None
    text = (
        f"the coefficient of restitution comes out at {cor.value:.3f} ± {cor.std:.3f}, and no"
        " passive contact returns more speed than it takes: another thing than the mass or the"
        " ball was followed, or the scale, the rate or the pendulum's numbers are wrong; look at"
        " the overlay, and point with --mass-at X,Y and --ball-at X,Y"
    )
    # at least so far, where the excess alone is the error of one speed
    doubt = Contradiction(PENDULUM | {QuantityName.BALL_SPEED}, 1.0 - 1.0 / cor.value, False, text)
    return HeldAgainst(Check(CheckKind.PASSIVE, CheckOutcome.FAILED, text), (doubt,))
