"""Consistency checks of a measurement, and their effect on the quantities.

Checks: the ball's speed by the paper's methods (per frame, Fig. 18; Eqs 7 and 8) against the fit,
the ball's observed size, the pendulum's length, and a COR of at most 1.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import scipy

from measuring.flight_fit import SLOW_OVER_RANDOM, FlightFit
from measuring.inputs import Inputs, QuantityName
from measuring.metres import ARM_RELATIVE_STD, MetricTracks
from measuring.setup.file import Origin
from metrology import Contribution, Quantity, UncertaintySource
from metrology.quantity import format_value
from physics.bodies import Pendulum

__all__ = [
    "CONTACT",
    "COR",
    "FLIGHT",
    "MAX_CONTRADICTION",
    "MIN_CHECK_POWER",
    "OTHER_SPEEDS",
    "PENDULUM",
    "RATE_AND_SCALE",
    "Check",
    "CheckKind",
    "CheckOutcome",
    "CheckResult",
    "Contradiction",
    "SpeedComparison",
    "apply_contradictions",
    "ball_size",
    "compare_speeds",
    "contact_contradiction",
    "eq7_gravity_excess",
    "passive_contact",
    "pendulum_length",
    "size_at_scale",
    "speed_by_pendulum",
    "speed_per_frame",
]

MAX_CONTRADICTION = 0.1
"""Relative error of a quantity above which a contradiction withholds it instead of widening it
(assumed)."""

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
"""Quantities that depend on the fitted flight."""

PENDULUM = COR | {
    QuantityName.PENDULUM_SPEED_BEFORE,
    QuantityName.PENDULUM_SPEED_AFTER,
    QuantityName.ENERGY_LOSS,
    QuantityName.EXTERNAL_IMPULSE,
}
"""Quantities that depend on the pendulum's motion, its inertia and the masses."""

_BY_MASSES = frozenset({QuantityName.COR_LAUNCH, QuantityName.COR_RANGE, QuantityName.COR})
"""Quantities that depend on the mass ratio of ball and pendulum."""

CONTACT = frozenset(
    {
        QuantityName.CONTACT_TIME,
        QuantityName.CONTACT_START,
        QuantityName.CONTACT_END,
        QuantityName.CONTACT_FRAMES,
    }
)
"""Quantities that depend on where the face of the mass meets the ball."""

RATE_AND_SCALE = frozenset(QuantityName) - {
    QuantityName.CONTACT_FRAMES,
    QuantityName.BACKSWING_ANGLE,
    QuantityName.SWING_PERIOD,
    QuantityName.SWING_DAMPING,
}
"""Quantities that depend on capture rate or scale, or on the track used to check both; a fall that
contradicts gravity may have its cause in any of them."""


class CheckKind(StrEnum):
    """What a measurement is tested against."""

    GRAVITY = "gravity"
    COR_AGREEMENT = "agreement of the COR estimates"
    BALL_SPEEDS = "ball speed by the paper's methods"
    CONTACT_BOUND = "longest contact time possible for the ball"
    BALL_SIZE = "size of the ball at the scale of its plane"
    PENDULUM_LENGTH = "length of the pendulum"
    PASSIVE = "speed after a passive contact"
    RELEASE = "where the flight begins"
    STEADY_FALL = "same acceleration in both halves of the flight"
    MOMENTUM = "momentum of two equal bodies"


class CheckOutcome(StrEnum):
    """Outcome of a check."""

    PASSED = "passed"
    FAILED = "failed"
    UNDECIDED = "can't tell"
    """The check could not have detected a relevant deviation."""


@dataclass(frozen=True)
class Check:
    """A consistency test of the measurement.

    Attributes
    ----------
    statement : str
        The outcome in a sentence, with its numbers.
    power : float or None
        Probability that a relevant deviation fails the check.
    """

    kind: CheckKind
    outcome: CheckOutcome
    statement: str
    power: float | None = None

    @property
    def name(self) -> str:
        """What is tested, in plain text."""
        return self.kind.value

    @property
    def passed(self) -> bool | None:
        """None if undecided."""
        return (
            None
            if self.outcome is CheckOutcome.UNDECIDED
            else (self.outcome is CheckOutcome.PASSED)
        )


@dataclass(frozen=True)
class Contradiction:
    """A contradiction found by a check.

    Attributes
    ----------
    quantities : frozenset of QuantityName
        Affected quantities.
    relative_error : float
        Their possible error over their value; for an angle over 1 rad.
    certain : bool
        Whether they are withheld regardless of `relative_error`.
    statement : str
        The reason if they are withheld.
    """

    quantities: frozenset[QuantityName]
    relative_error: float
    certain: bool
    statement: str


def apply_contradictions(
    found: dict[str, Quantity], contradictions: Iterable[Contradiction]
) -> dict[str, Quantity]:
    """Widen or withhold the quantities affected by contradictions."""
    out = dict(found)
    for contradiction in contradictions:
        withheld = contradiction.certain or contradiction.relative_error > MAX_CONTRADICTION
        for name in contradiction.quantities:
            item = out.get(name)
            if item is None or item.value is None:
                continue
            out[name] = (
                Quantity.missing(name.value, item.unit, contradiction.statement)
                if withheld
                else _widened(item, contradiction.relative_error)
            )
    return out


def _widened(item: Quantity, relative_error: float) -> Quantity:
    assert item.value is not None
    scale = math.degrees(1.0) if item.unit == "deg" else abs(item.value)
    line = Contribution(UncertaintySource.CONTRADICTION, relative_error * scale)
    budget = tuple(sorted((*item.budget, line), key=lambda one: -one.std))
    return Quantity.measured(item.name, item.value, item.unit, budget)


MIN_CHECK_POWER = 0.5
"""Minimum probability of detecting a relevant error for a check to pass (chosen)."""

OTHER_SPEEDS: dict[str, str] = {"ball_speed_per_frame": "m/s", "ball_speed_eq7": "m/s"}
"""Name and unit of values shown in addition to the quantities of the contract."""

_STEPS = 4
"""Frame steps of the displacement after release (chosen: fewer are noisy, more are affected by
gravity and air)."""

_CHECK_SIGMAS = 3.0
"""Standard deviations (convention: exceeded by 1 correct clip in 370)."""

RELEVANT_SPEED_FRACTION = 0.1
"""Of the ball's speed: smallest disagreement relevant to a coefficient of restitution (chosen)."""


def speed_per_frame(tracks: MetricTracks, flight: FlightFit) -> tuple[float, float]:
    """Displacement per frame just after release: mean over the first frames of the flight.

    Returns
    -------
    speed, std : float
        m/s; the standard uncertainty comes from the two end points.
    """
    used = np.flatnonzero(np.isin(tracks.ball_time_s, flight.time_s))[: _STEPS + 1]
    displacement = tracks.ball_m[used[-1]] - tracks.ball_m[used[0]]
    took = float(tracks.ball_time_s[used[-1]] - tracks.ball_time_s[used[0]])
    spread = sum(float(np.trace(tracks.ball_cov_m2[end])) / 2 for end in (used[0], used[-1]))
    # few frames next to the mass: slowly varying errors of the outline do not average out
    return float(np.hypot(*displacement)) / took, math.sqrt(spread) * math.hypot(
        1.0, SLOW_OVER_RANDOM
    ) / took


def speed_by_pendulum(body: Pendulum, ball_mass: float, before: float, after: float) -> float:
    """Ball speed from the pendulum's loss of speed, M_E (v_M⁰ − v_M) / m_B (Eqs 7 and 8), m/s."""
    return body.mass_at_contact * (before - after) / ball_mass


def eq7_gravity_excess(
    body: Pendulum, ball_mass: float, angle: float, arm: float, pull: tuple[float, float]
) -> float:
    """Part of Eq. 7 that is no impulse on the ball: gravity slows the pendulum during contact.

    Parameters
    ----------
    ball_mass : float
        kg.
    angle : float
        Mean angle during contact, rad.
    arm : float
        Pivot to the point of contact, m.
    pull : (2,) tuple of float
        Gravity (m/s²) and duration of contact (s).

    Returns
    -------
    float
        Excess of Eq. 7, m/s of ball speed.
    """
    gravity, duration = pull
    slowed = body.mass * gravity * body.com * math.sin(angle) * duration / body.inertia
    return speed_by_pendulum(body, ball_mass, slowed * arm, 0.0)


@dataclass(frozen=True)
class SpeedComparison:
    """The check, and the relative differences of the other speeds from the fitted one.

    Attributes
    ----------
    flight_difference : float
        Displacement per frame against the fit, relevant to the flight; 0 if they agree.
    pendulum_difference : float
        Eq. 7 against the fit, relevant to the pendulum's speeds or the masses; 0 if they agree.
    """

    check: Check
    flight_difference: float
    pendulum_difference: float


def contact_contradiction(speeds: SpeedComparison, bound: Check | None) -> Contradiction | None:
    """Contradiction of the contact by the ball's speeds, or None.

    If Eq. 7 disagrees, the pendulum's properties may be wrong, which do not affect the contact. If
    in addition the contact may be too long for the ball, the tracked mass was not the striker.

    Parameters
    ----------
    bound : Check or None
        Check of the contact time against its upper bound.
    """
    surely_possible = bound is not None and bound.outcome is CheckOutcome.PASSED
    if speeds.pendulum_difference == 0.0 or surely_possible:
        return None
    statement = (
        speeds.check.statement if bound is None else f"{bound.statement}; {speeds.check.statement}"
    )
    return Contradiction(CONTACT, speeds.pendulum_difference, False, statement)


@dataclass(frozen=True)
class _Compared:
    apart: float
    std: float

    @property
    def differs(self) -> bool:
        return abs(self.apart) > _CHECK_SIGMAS * self.std


def compare_speeds(found: dict[str, Quantity]) -> SpeedComparison | None:
    """Check the paper's methods against the fitted speed at release.

    Parameters
    ----------
    found : dict
        Quantities by name, including those of `OTHER_SPEEDS` and the effect of gravity in Eq. 7.
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
    relevant = RELEVANT_SPEED_FRACTION * abs(fitted.value)
    power = float(scipy.special.ndtr(-_CHECK_SIGMAS + relevant / min(along.std, by_pendulum.std)))
    outcome = CheckOutcome.PASSED if power >= MIN_CHECK_POWER else CheckOutcome.UNDECIDED
    if along.differs or by_pendulum.differs:
        outcome = CheckOutcome.FAILED
        text = f"the ball's speeds disagree: {text}; {_suspects(along, by_pendulum)}"
    return SpeedComparison(
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
        return "release may be at another time, or another object was tracked"
    return "check masses and inertia in the setup file, and that the mass was tracked"


RELEVANT_SIZE_FRACTION = 0.05
"""Of the radius: smallest relevant deviation (chosen: 5 % moves the contact by 1/3 of it)."""


@dataclass(frozen=True)
class CheckResult:
    """A check and the contradictions found by it.

    Attributes
    ----------
    contradictions : tuple of Contradiction
        Empty if the check passed.
    """

    check: Check
    contradictions: tuple[Contradiction, ...]


def ball_size(
    observed_m: float, relative_std: float, given_m: float, found: dict[str, Quantity]
) -> CheckResult | None:
    """Check the observed size, at the scale of the ball plane, against the given diameter.

    Parameters
    ----------
    observed_m : float
        Observed diameter at a scale from another source, m.
    relative_std : float
        Relative standard uncertainty of both.
    given_m : float
        Given diameter, m.
    found : dict
        Quantities by name, before any is withheld.

    Returns
    -------
    CheckResult or None
        None without a speed, which gives the uncertainty of the scale.
    """
    speed, lasts = found[QuantityName.BALL_SPEED], found[QuantityName.CONTACT_TIME]
    if speed.value is None or speed.std is None:
        return None
    std = math.hypot(relative_std, speed.std / speed.value)
    check = size_at_scale(
        observed_m, std, given_m, "check the diameter, the grid's pitch and the measured distances"
    )
    if check.outcome is not CheckOutcome.FAILED:
        return CheckResult(check, ())
    apart = abs(observed_m / given_m - 1.0)
    contradictions = [Contradiction(RATE_AND_SCALE, apart, False, check.statement)]
    if lasts.value is not None:
        # face and surface of the ball touch and separate earlier or later by this
        moved = apart * given_m / (speed.value * lasts.value)
        contradictions.append(Contradiction(CONTACT, moved, False, check.statement))
    return CheckResult(check, tuple(contradictions))


def size_at_scale(observed_m: float, relative_std: float, given_m: float, advice: str) -> Check:
    """Check the observed diameter at the scale of its plane against the given one.

    Parameters
    ----------
    observed_m, relative_std : float
        Observed diameter, m, and relative standard uncertainty of both.
    given_m : float
        Given diameter, m.
    advice : str
        What to do if they differ.
    """
    # relative to the given diameter
    std = relative_std * observed_m / given_m
    power = float(scipy.special.ndtr(-_CHECK_SIGMAS + RELEVANT_SIZE_FRACTION / std))
    text = (
        f"the tracked object is {1e3 * observed_m:.3g} mm wide at the scale of its plane; the given"
        f" diameter is {1e3 * given_m:.3g} mm"
    )
    if abs(observed_m / given_m - 1.0) > _CHECK_SIGMAS * std:
        return Check(CheckKind.BALL_SIZE, CheckOutcome.FAILED, f"{text}: {advice}", power)
    outcome = CheckOutcome.PASSED if power >= MIN_CHECK_POWER else CheckOutcome.UNDECIDED
    return Check(CheckKind.BALL_SIZE, outcome, text, power)


RELEVANT_ARM_FRACTION = 0.2
"""Smallest relevant relative difference in length (chosen: 20 % of length is 50 % of inertia)."""


def pendulum_length(seen_m: float, inputs: Inputs) -> CheckResult:
    """Check the arm to the point of contact against the pendulum whose inertia is used.

    Parameters
    ----------
    seen_m : float
        Observed length in the ball plane, m.
    inputs : Inputs
        Properties of the pendulum and their sources.
    """
    length = inputs.rig.length
    std = math.hypot(ARM_RELATIVE_STD, length.relative_std)
    apart = math.log(seen_m / length.value)
    power = float(scipy.special.ndtr(-_CHECK_SIGMAS + RELEVANT_ARM_FRACTION / std))
    given = "assumed" if length.value_from is Origin.PRESET else "given in the setup file"
    seen = format_value(seen_m, ARM_RELATIVE_STD * seen_m, "m")
    text = f"the pendulum's observed arm is {seen} long, the one {given} {length.value:.2f} m"
    if abs(apart) <= _CHECK_SIGMAS * std:
        outcome = CheckOutcome.PASSED if power >= MIN_CHECK_POWER else CheckOutcome.UNDECIDED
        return CheckResult(Check(CheckKind.PENDULUM_LENGTH, outcome, text, power), ())
    text += (
        ": set this pendulum's length, inertia and mass ([pendulum] in the setup file), or check"
        " the scale"
    )
    # the inertia scales at least with the square of the length
    off = 2.0 * abs(apart)
    contradictions = [Contradiction(frozenset({QuantityName.ENERGY_LOSS}), off, False, text)]
    ball = inputs.ball
    if ball is not None and ball.mass is not None:
        by_masses = off * ball.mass / inputs.pendulum.mass_at_contact
        contradictions.append(Contradiction(_BY_MASSES, by_masses, False, text))
    check = Check(CheckKind.PENDULUM_LENGTH, CheckOutcome.FAILED, text, power)
    return CheckResult(check, tuple(contradictions))


def passive_contact(found: dict[str, Quantity]) -> CheckResult | None:
    """Check the COR against 1, the maximum of a passive contact.

    Parameters
    ----------
    found : dict
        Quantities by name, before any is withheld.

    Returns
    -------
    CheckResult or None
        None if the COR is unknown or not significantly above 1.
    """
    cor = found[QuantityName.COR]
    if cor.value is None or cor.std is None or cor.value - 1.0 <= _CHECK_SIGMAS * cor.std:
        return None
    text = (
        f"the coefficient of restitution is {cor.value:.3f} ± {cor.std:.3f}, but a passive contact"
        " has at most 1: another object than the mass or the ball was tracked, or the scale, the"
        " rate or the pendulum's properties are wrong. Check the overlay, and point with --mass-at"
        " X,Y and --ball-at X,Y"
    )
    # at least this much if the excess is the error of one speed
    contradiction = Contradiction(
        PENDULUM | {QuantityName.BALL_SPEED}, 1.0 - 1.0 / cor.value, False, text
    )
    return CheckResult(Check(CheckKind.PASSIVE, CheckOutcome.FAILED, text), (contradiction,))
