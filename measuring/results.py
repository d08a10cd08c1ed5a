"""Quantities from the evaluated fits, each with its budget or reason."""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from calib.calibration import Calibration
from measuring.budget import (
    DERIVED,
    ClipConditions,
    JointCovariance,
    joint_covariance,
    merged,
)
from measuring.checker.fall import MIN_FALL_ROWS
from measuring.checks import (
    CONTACT,
    COR,
    FLIGHT,
    OTHER_SPEEDS,
    PENDULUM,
    RATE_AND_SCALE,
    Check,
    CheckKind,
    CheckOutcome,
    CheckResult,
    Contradiction,
    SpeedComparison,
    apply_contradictions,
    ball_size,
    compare_speeds,
    contact_contradiction,
    passive_contact,
    pendulum_length,
)
from measuring.flight_fit import MAX_CONTACT_S
from measuring.gravity import (
    ESTIMATES,
    contradicts_gravity,
    cor_weights,
    fused_cor,
    gravity_check,
    scale_std,
)
from measuring.impact import (
    UNSEEN_HALF_CONTACT_STD_S,
    Impact,
    disc_contact,
    pivot_in_plane,
)
from measuring.inputs import QUANTITY_UNITS, Inputs, QuantityName, kinds_of
from measuring.metres import (
    MAX_ESTIMATE_DIFFERENCE,
    MetricTracks,
    arm_along_bar,
    radius_relative_std,
)
from measuring.motions import MotionResults
from metrology import Contribution, Quantity, UncertaintySource
from vision.tracks import MotionKind, Tracks

__all__ = [
    "Evaluated",
    "NoScale",
    "Results",
    "frames_within",
    "missing_input",
    "motion_seen",
    "needed",
    "reading_on_wall",
    "results_of",
    "stated_landing_off",
    "stated_pivot_off",
]

FloatArray = NDArray[np.float64]

NOT_ASKED = "it was not asked for"
_NO_FALL = "the flight that was followed is too short to show a fall; film more of it"
_UNDETERMINED = "it could not be determined from this clip"
_PIXEL_NAMES = frozenset(name.value for name in QuantityName if name.value not in QUANTITY_UNITS)
_NEEDS_METRES = {"m", "m/s", "N s", "J"}
MAX_LANDING_GAP_S = 0.03
"""s, maximum gap before landing covered by the fitted flight (chosen)."""
_MIN_SPEED = 1e-3
"""m/s, minimum speed for predicting where the ball leaves the picture (chosen)."""
_PLASTIC = 1.32471795724474602596
"""Real root of x³ = x + 1: steps of 1/x and 1/x² fill a square evenly (Roberts 2018)."""
_BACKSWING_NAME = "backswing_angle"
NO_MOTION = "the motion is neither free flight nor a swing"
_FEW_PICTURES = (
    "the moving object is seen in only {} pictures, and {} are needed to recognise a flight or a"
    " swing: pass every picture of the recording, or mark the object in more of them"
)
_NOT_BEFORE = "the pendulum is not in view before the strike"
_AVERAGED_FRAMES = 8
"""Frames averaged for the first angle and each rate (assumed; 13 ms at 600 fps)."""
MAX_SWING_ENERGY_ERROR = 0.25
"""Maximum relative difference from the kinetic energy of a free swing (chosen: covers friction and
wrong dimensions; a release elsewhere differs more)."""
MAX_UNSEEN_FALL_STD = 0.5
"""Of gravity: std of the fall above which, without a strike, flight is not established (chosen)."""
MAX_DEPTH_RELATIVE_STD = 0.3
"""Relative std of a depth above which, mostly from assumptions, it is not stated (chosen)."""
ASSUMED_SOURCES = (UncertaintySource.LENS_UNKNOWN, UncertaintySource.BALL_PLANE_GUESS)
_DEPTHS = (
    UncertaintySource.BALL_PLANE_OFFSET,
    UncertaintySource.BALL_DIAMETER,
    UncertaintySource.CAMERA_DISTANCE,
)
_UNRESOLVED = (
    "the contact is not resolved: within the noise of their paths mass and ball may never meet"
)
NO_CLOCK = (
    "the capture rate is unknown and can't be estimated from free fall:"
    " give it with --fps RATE, or capture_fps in the setup file"
)
_OF_GEOMETRY = ("ball_plane_offset", "camera_distance", "landing_distance_on_wall")
_LANDING_NAMES = ("landing_distance", "landing_time", "landing_distance_on_wall", "cor_range")


_CHECKED_QUANTITIES = frozenset(
    {
        *("contact_time", "contact_start", "contact_end", "gravity"),
        *("ball_speed", *OTHER_SPEEDS, "eq7_by_gravity"),
    }
)
"""Derived values compared by checks that may widen or withhold any quantity of a strike."""

_DERIVED_FROM: dict[str, frozenset[str]] = {
    QuantityName.LANDING_DISTANCE: frozenset({"landing_moment", "landing_beyond_flight"}),
    QuantityName.LANDING_TIME: frozenset({"landing_moment"}),
    QuantityName.LANDING_DISTANCE_ON_WALL: frozenset(
        {"landing_distance", "landing_height", "landing_moment"}
    ),
    # the estimates of one coefficient are compared with each other
    **dict.fromkeys(COR, frozenset({*ESTIMATES, "landing_moment", "landing_distance_seen"})),
}
"""Derived values that a quantity needs in addition to that of its own name."""


def needed(wanted: Collection[str] | None) -> frozenset[str]:
    """Derived values needed by quantities and by the checks on them.

    Parameters
    ----------
    wanted : collection of str or None
        Names of quantities; None for all.
    """
    if wanted is None:
        return frozenset(DERIVED)
    derived = _CHECKED_QUANTITIES.union(*(_DERIVED_FROM.get(name, frozenset()) for name in wanted))
    return (derived | frozenset(wanted)) & frozenset(DERIVED)


@dataclass(frozen=True)
class Evaluated:
    """Values of the fits with their uncertainty, before they become quantities.

    Attributes
    ----------
    values : (Q,) array
        In the order of `DERIVED`.
        In the order of `DERIVED`.
        Their covariance from the noise of the tracks.
        Covariance from track noise.
        Source to (Q,) contributions.
    refusal : str
        Why there is no impact.
    names : frozenset of str
        Evaluated values; the others are NaN.
    """

    scene: ClipConditions
    metric: MetricTracks | None
    impact: Impact | None
    values: FloatArray
    random: FloatArray
    systematic: dict[UncertaintySource, FloatArray]
    refusal: str
    names: frozenset[str] = frozenset(DERIVED)


@dataclass(frozen=True)
class NoScale:
    """Why the wall gives no scale.

    Attributes
    ----------
    reason : str
        Empty if it does.
    contradicts : bool
        Whether the grid contradicts the ball's size, so that neither can be trusted.
    """

    reason: str = ""
    contradicts: bool = False


@dataclass(frozen=True)
class Results:
    """Results of a clip; attributes as in `Measurement`."""

    quantities: tuple[Quantity, ...]
    other_speeds: tuple[Quantity, ...]
    gravity: Quantity
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    joint: JointCovariance

    def withheld(self, reason: str) -> "Results":
        """The results without any value, for one reason."""
        return replace(
            self,
            quantities=tuple(Quantity.missing(q.name, q.unit, reason) for q in self.quantities),
            other_speeds=(),
            gravity=Quantity.missing(self.gravity.name, self.gravity.unit, reason),
            joint=JointCovariance((), np.zeros((0, 0))),
        )


def results_of(
    evaluated: Evaluated,
    tracks: Tracks,
    no_grid: NoScale,
    motion: MotionResults | None = None,
    wanted: Collection[str] | None = None,
) -> Results:
    """Quantities in the contract's order, other speeds, checks and warnings.

    `motion` holds the quantities of a motion other than a strike; `wanted` names the quantities
    asked for, None all; the others are missing with that reason.
    """
    reasons = _reasons(evaluated, tracks, no_grid)
    found: dict[str, Quantity] = {}
    for index, (name, unit) in enumerate(DERIVED.items()):
        found[name] = _quantity(evaluated, index, name, unit, reasons)
    found["contact_frames"] = _contact_frames(evaluated, tracks, reasons)
    lasting = found["contact_time"]
    found |= _if_too_short(lasting)
    found |= _met_by_another(evaluated, tracks)
    if _asked(wanted, _OF_GEOMETRY):
        found |= _geometry(evaluated, found, no_grid.reason, motion)
    if _asked(wanted, {QuantityName.BACKSWING_ANGLE}):
        found["backswing_angle"] = _backswing(evaluated)
    random, systematic = evaluated.random, evaluated.systematic
    cor, agreement = fused_cor(evaluated.values, random, systematic, found)
    weights = cor_weights(random, systematic, found)
    found["cor"] = cor
    gravity, by_gravity = gravity_check(found["gravity"], evaluated.scene)
    speeds = compare_speeds(found)
    bound = _contact_bound(evaluated)
    size = _size(evaluated, tracks, found)
    arm = _arm(evaluated, tracks)
    covered = (agreement, speeds and speeds.check, by_gravity, bound)
    against = [one for one in (size, arm, passive_contact(found)) if one]
    checks = [*(one for one in covered if one), *(one.check for one in against)]
    other_speeds = tuple(found[name] for name in OTHER_SPEEDS)
    contradictions = _contradictions(evaluated, found, agreement, speeds, gravity, by_gravity)
    contradictions += [contradiction for one in against for contradiction in one.contradictions]
    touching = None if speeds is None else contact_contradiction(speeds, bound)
    motion = motion or MotionResults()
    contradictions += _not_met_as_followed(evaluated, lasting, motion)
    contradictions += (*stated_pivot_off(tracks), *stated_landing_off(evaluated))
    found = apply_contradictions(
        found, [*contradictions, *([] if touching is None else [touching])]
    )
    checks += motion.checks
    gravity = motion.gravity or gravity
    found |= motion.quantities
    if tracks.motion.measured_as is MotionKind.NONE:
        gravity = Quantity.missing(
            gravity.name, gravity.unit, f"it needs a flight, but {motion_seen(tracks)}"
        )
    found = _of_this_motion(found, tracks, wanted)
    return Results(
        tuple(found.values()),
        other_speeds,
        gravity,
        tuple(checks),
        tuple(item.statement for item in checks if item.outcome is CheckOutcome.FAILED),
        joint_covariance([*found.values(), *other_speeds], random, systematic, {"cor": weights}),
    )


def motion_seen(tracks: Tracks) -> str:
    """The motion that is recognised, or why there is none."""
    motion, seen = tracks.motion, len(tracks.ball)
    if motion.measured_as is MotionKind.NONE and seen < MIN_FALL_ROWS:
        return _FEW_PICTURES.format(seen, MIN_FALL_ROWS)
    if motion.kind is MotionKind.NONE:
        return NO_MOTION
    doubt = ", of which no quantity is measured" if motion.measured_as is MotionKind.NONE else ""
    if motion.is_doubtful:
        doubt = f" with a probability of only {motion.probability:.2f}"
    return f"the motion is a {motion.kind.noun}{doubt}"


def _asked(wanted: Collection[str] | None, names: Collection[str]) -> bool:
    return wanted is None or any(name in wanted for name in names)


def _of_this_motion(
    found: dict[str, Quantity], tracks: Tracks, wanted: Collection[str] | None
) -> dict[str, Quantity]:
    """Quantities in the contract's order; those of other motions, or not asked for, say so."""
    measured_as = tracks.motion.measured_as
    out: dict[str, Quantity] = {}
    for name, unit in QUANTITY_UNITS.items():
        item = found.get(name)
        if not _asked(wanted, {name}):
            item = Quantity.missing(name, unit, NOT_ASKED)
        elif item is None or (measured_as not in kinds_of(name) and not item.known):
            shown_by = " or a ".join(str(one.value) for one in kinds_of(name))
            needs = f"it needs a {shown_by}, but {motion_seen(tracks)}"
            item = Quantity.missing(name, unit, needs)
        out[name] = item
    return out | {name: item for name, item in found.items() if name in _PIXEL_NAMES}


def _size(evaluated: Evaluated, tracks: Tracks, found: dict[str, Quantity]) -> CheckResult | None:
    """Check the ball's size against its diameter, if the depth has another source, too.

    Otherwise the two agree by construction.
    """
    calibration, metric = evaluated.scene.calibration, evaluated.metric
    diameter = evaluated.scene.inputs.rig.ball_diameter
    if calibration is None or metric is None or diameter is None or not tracks.ball.sized:
        return None
    offset_source = UncertaintySource.BALL_PLANE_OFFSET
    if all(estimate.source is not offset_source for estimate in calibration.depth_estimates):
        return None
    relative_std = math.hypot(radius_relative_std(tracks.ball), diameter.relative_std)
    return ball_size(2.0 * metric.radius_m, relative_std, diameter.value, found)


def _arm(evaluated: Evaluated, tracks: Tracks) -> CheckResult | None:
    """Check the observed arm against the pendulum's length, if there is a scale."""
    impact, scene = evaluated.impact, evaluated.scene
    if impact is None or impact.contact is None or impact.view is None:
        return None
    if scene.calibration is None and not math.isfinite(scale_std(scene, tracks)):
        return None
    view = impact.view
    angle = float(view.before.angles(np.array([impact.contact.onset_s]))[0])
    pivot = pivot_in_plane(impact.tracks, evaluated.scene.inputs)
    seen = float(arm_along_bar(view.rest - pivot, angle))
    return pendulum_length(seen, evaluated.scene.inputs) if seen > 0.0 else None


def _contact_bound(evaluated: Evaluated) -> Check | None:
    """Check the contact time against the upper bound for the ball."""
    impact = evaluated.impact
    if impact is None or impact.contact is None or impact.view is None:
        return None
    lasting = impact.contact.release_s - impact.contact.onset_s
    index = list(DERIVED).index("contact_time")
    std = math.sqrt(
        max(float(evaluated.random[index, index]), 0.0)
        + sum(float(column[index]) ** 2 for column in evaluated.systematic.values())
    )
    longest = impact.view.longest_s
    if not math.isfinite(longest):
        return None
    text = (
        f"contact time {1e3 * lasting:.1f} ± {1e3 * std:.1f} ms; possible for such a ball:"
        f" at most {1e3 * longest:.0f} ms"
    )
    power = float(scipy.special.ndtr((longest - lasting) / max(std, 1e-9)))
    sure = lasting + 2.0 * std < longest
    outcome = CheckOutcome.PASSED if sure else CheckOutcome.UNDECIDED
    return Check(CheckKind.CONTACT_BOUND, outcome, text, power)


def _contradictions(
    evaluated: Evaluated,
    found: dict[str, Quantity],
    agreement: Check | None,
    speeds: SpeedComparison | None,
    gravity: Quantity,
    by_gravity: Check | None,
) -> list[Contradiction]:
    """Contradictions from failed checks."""
    contradictions = []
    if speeds is not None and speeds.check.outcome is CheckOutcome.FAILED:
        statement = speeds.check.statement
        contradictions.append(Contradiction(FLIGHT, speeds.flight_difference, False, statement))
        contradictions.append(Contradiction(PENDULUM, speeds.pendulum_difference, False, statement))
    if by_gravity is not None and by_gravity.outcome is CheckOutcome.FAILED:
        true = evaluated.scene.inputs.gravity
        value, std = gravity.value or 0.0, gravity.std or math.inf
        known = () if evaluated.scene.calibration is None else evaluated.scene.calibration.warnings
        statement = "; ".join((by_gravity.statement, *known))
        plain = contradicts_gravity(value, true, std)
        contradictions.append(
            Contradiction(RATE_AND_SCALE, abs(value / true - 1.0), plain, statement)
        )
    struck = evaluated.impact is not None and evaluated.impact.contact is not None
    # with a given rate a fall too short to be weighed contradicts nothing
    given = struck or evaluated.scene.rate.known
    if not given and by_gravity is not None and by_gravity.outcome is CheckOutcome.UNDECIDED:
        unseen = (gravity.std or 0.0) > MAX_UNSEEN_FALL_STD * evaluated.scene.inputs.gravity
        statement = f"flight is not established for the tracked object: {by_gravity.statement}"
        contradictions.append(
            Contradiction(RATE_AND_SCALE if unseen else frozenset(), math.inf, unseen, statement)
        )
    if agreement is not None and agreement.outcome is CheckOutcome.FAILED:
        known_cors = [found[name].value or 0.0 for name in ESTIMATES if found[name].known]
        apart = (max(known_cors) - min(known_cors)) / max(abs(found["cor"].value or 1.0), 1e-6)
        contradictions.append(Contradiction(COR, 0.5 * apart, False, agreement.statement))
    return contradictions


def stated_pivot_off(tracks: Tracks) -> list[Contradiction]:
    """What contradicts a pivot that a person stated: the mass turns about another point."""
    pendulum = tracks.pendulum
    if pendulum is None or pendulum.seen_pivot is None:
        return []
    seen, covariance = pendulum.seen_pivot
    apart = pendulum.pivot_px - seen
    squared = float(apart @ np.linalg.solve(covariance + pendulum.pivot_covariance_px2, apart))
    if squared < MAX_ESTIMATE_DIFFERENCE**2:
        return []
    away = float(np.hypot(*apart))
    statement = (
        f"The stated pivot is {away:.0f} px from the point about which the mass turns in the"
        " picture, more than its uncertainty explains. Angles, speeds and contact time hold only if"
        " the stated pivot is right: check --pivot-at, or leave it out."
    )
    return [Contradiction(PENDULUM | CONTACT, away / pendulum.arm_px, False, statement)]


def stated_landing_off(evaluated: Evaluated) -> list[Contradiction]:
    """What contradicts a landing that a person stated: the flight goes elsewhere, or not there."""
    if not _states_landing(evaluated):
        return []
    names = list(DERIVED)
    index = names.index("landing_beyond_flight")
    apart = float(evaluated.values[index])
    variances = [float(column[index]) ** 2 for column in evaluated.systematic.values()]
    std = math.sqrt(float(evaluated.random[index, index]) + sum(variances))
    if abs(apart) < MAX_ESTIMATE_DIFFERENCE * std:
        return []
    found = "The fitted flight does not come down to the stated landing point."
    if math.isfinite(apart):
        found = (
            f"The stated landing point is {1e3 * abs(apart):.0f} mm"
            f" {'beyond' if apart > 0.0 else 'short of'} the fitted flight at that height, more"
            " than its uncertainty explains."
        )
    distance = abs(float(evaluated.values[names.index(QuantityName.LANDING_DISTANCE)]))
    error = abs(apart) / distance if math.isfinite(apart) and distance > 0.0 else math.inf
    statement = (
        f"{found} Landing distance and time and their COR hold only if the point is right: check"
        " --landing-at, or leave it out."
    )
    affected = frozenset(map(QuantityName, (*_LANDING_NAMES, QuantityName.COR)))
    return [Contradiction(affected, error, False, statement)]


def _not_met_as_followed(
    evaluated: Evaluated, lasting: Quantity, motion: MotionResults
) -> list[Contradiction]:
    """Contradictions if the paths of mass and ball are not those of a strike."""
    impact, contradictions = evaluated.impact, []
    if impact is not None and impact.view is not None and lasting.std is not None:
        longest = min(impact.view.longest_s, MAX_CONTACT_S)
        if lasting.std > longest:
            statement = (
                f"the contact is not resolved: its standard uncertainty is {1e3 * lasting.std:.0f} "
                f"ms; possible for such a ball: at most {1e3 * longest:.0f} ms"
            )
            contradictions.append(Contradiction(CONTACT | PENDULUM, math.inf, True, statement))
    for check in motion.checks:
        if check.kind is CheckKind.STEADY_FALL and check.outcome is CheckOutcome.FAILED:
            everything = FLIGHT | CONTACT | PENDULUM
            contradictions.append(Contradiction(everything, math.inf, True, check.statement))
    return contradictions


def _quantity(
    evaluated: Evaluated, index: int, name: str, unit: str, reasons: dict[str, str]
) -> Quantity:
    if name in reasons:
        return Quantity.missing(name, unit, reasons[name])
    if name not in evaluated.names:
        return Quantity.missing(name, unit, NOT_ASKED)
    if evaluated.impact is None or not np.isfinite(evaluated.values[index]):
        return Quantity.missing(name, unit, evaluated.refusal or _unknown(evaluated, name))
    variance = float(evaluated.random[index, index])
    if math.isnan(variance):
        return Quantity.missing(name, unit, _UNRESOLVED)
    noise = math.sqrt(max(variance, 0.0))
    budget = merged(evaluated.systematic, index, noise)
    if evaluated.impact.contact is None and name in (
        QuantityName.BALL_SPEED,
        QuantityName.LAUNCH_ANGLE,
    ):
        budget = (*budget, _moment_of_release(evaluated, name))
    return Quantity.measured(name, float(evaluated.values[index]), unit, budget)


def _moment_of_release(evaluated: Evaluated, name: str) -> Contribution:
    """Contribution of an unseen end of contact: gravity changes the velocity meanwhile."""
    assert evaluated.impact is not None
    flight = evaluated.impact.flight
    states = flight.states(flight.reference_s + np.array([0.0, UNSEEN_HALF_CONTACT_STD_S]))
    speeds = np.hypot(states[:, 2], states[:, 3])
    angles = np.degrees(np.arctan2(states[:, 3], states[:, 2]))
    change = speeds[1] - speeds[0] if name == QuantityName.BALL_SPEED else angles[1] - angles[0]
    return Contribution(UncertaintySource.RELEASE_INSTANT, abs(float(change)))


def missing_input(inputs: Inputs, name: str, *, landing_stated: bool = False) -> str | None:
    """Input that a quantity needs for any clip and that is not given, or None."""
    if name in (QuantityName.COR_LAUNCH, QuantityName.EXTERNAL_IMPULSE) and (
        inputs.ball is None or inputs.ball.mass is None
    ):
        return "the mass of the ball is unknown; give it as in --ball '220 mm, 0.35 kg'"
    if name in _LANDING_NAMES and inputs.fall is None and not landing_stated:
        return (
            "the height of the support is unknown; set [support] height in the setup file,"
            " or point at the landing with --landing-at"
        )
    return None


def _states_landing(evaluated: Evaluated) -> bool:
    """Whether a person stated the place of the landing."""
    return evaluated.metric is not None and evaluated.metric.landing is not None


def _unknown(evaluated: Evaluated, name: str) -> str:
    stated = _states_landing(evaluated)
    missing = missing_input(evaluated.scene.inputs, name, landing_stated=stated)
    if missing is not None:
        return missing
    if name == "gravity" and evaluated.impact is not None:
        return _NO_FALL
    if evaluated.impact is not None and evaluated.impact.contact is None:
        return evaluated.impact.reason
    if name == QuantityName.COR_RANGE and evaluated.impact is not None:
        return evaluated.impact.landing_reason or _UNDETERMINED
    return _UNDETERMINED


def _reasons(evaluated: Evaluated, tracks: Tracks, no_grid: NoScale) -> dict[str, str]:
    """Quantities that must be withheld although they could be computed."""
    reasons: dict[str, str] = {}
    if not evaluated.scene.rate.known:
        reasons = dict.fromkeys(DERIVED, NO_CLOCK)
    scene, impact = evaluated.scene, evaluated.impact
    stated = _states_landing(evaluated)
    if scene.calibration is None:
        if not stated:
            landing = f"it needs the wall grid, or --landing-at: {no_grid.reason}"
            reasons |= dict.fromkeys(_LANDING_NAMES, landing)
        wanted = [name for name, unit in DERIVED.items() if unit in _NEEDS_METRES]
        if not math.isfinite(scale_std(scene, tracks)):
            text = f"neither a wall grid nor the ball's size gives a scale ({no_grid.reason})"
            reasons |= dict.fromkeys([*wanted, "gravity", "launch_angle", *_LANDING_NAMES], text)
        elif no_grid.contradicts and impact is not None:
            reasons |= dict.fromkeys([*wanted, *_LANDING_NAMES], no_grid.reason)
    if impact is not None and not stated:
        landed = evaluated.values[list(DERIVED).index("landing_moment")]
        if np.isfinite(landed) and not _landing_in_view(evaluated, float(landed)):
            ends = "is last tracked" if _goes_on_in_view(evaluated) else "leaves the picture"
            text = (
                f"the ball {ends} at {impact.last_flight_s:.3f} s,"
                f" {landed - impact.last_flight_s:.3f} s before it lands"
            )
            reasons |= dict.fromkeys(_LANDING_NAMES, text)
    return reasons


def _landing_in_view(evaluated: Evaluated, landed: float) -> bool:
    """Whether the ball is tracked to its landing, or nearly, and lands inside the picture."""
    impact, calibration = evaluated.impact, evaluated.scene.calibration
    assert impact is not None
    frame_s = 1.0 / evaluated.scene.rate.fps
    if landed - impact.last_flight_s <= 2.0 * frame_s:
        return True
    if landed - impact.last_flight_s > MAX_LANDING_GAP_S or calibration is None:
        return False
    return _in_picture(evaluated, landed)


def _goes_on_in_view(evaluated: Evaluated) -> bool:
    """Whether the ball is still in the picture one diameter after it was last tracked."""
    impact, ball = evaluated.impact, evaluated.scene.inputs.ball
    if impact is None or ball is None or evaluated.scene.calibration is None:
        return False
    last = impact.last_flight_s
    velocity = impact.flight.states(np.array([last]))[0, 2:4]
    on = ball.diameter / max(float(np.hypot(*velocity)), _MIN_SPEED)
    return _in_picture(evaluated, last + on)


def _in_picture(evaluated: Evaluated, moment: float) -> bool:
    """Whether the ball's centre is inside the picture at a time of its flight."""
    impact, calibration = evaluated.impact, evaluated.scene.calibration
    assert impact is not None
    assert calibration is not None
    x, y = impact.flight.states(np.array([moment]))[0, :2]
    spot = np.array([impact.tracks.direction * x, y, calibration.ball_plane_offset])
    u, v = calibration.camera.project(spot)
    lens = calibration.lens
    return bool(0 <= u <= lens.width - 1 and 0 <= v <= lens.height - 1)


def _contact_frames(evaluated: Evaluated, tracks: Tracks, reasons: dict[str, str]) -> Quantity:
    """Frames with mid-exposure within the contact (Fig. 13), and the std of their number."""
    impact = evaluated.impact
    if impact is None or impact.contact is None:
        reason = evaluated.refusal if impact is None else impact.reason
        return Quantity.missing("contact_frames", "1", reason)
    names = list(DERIVED)
    start, end, lasting = (
        names.index(name) for name in ("contact_start", "contact_end", "contact_time")
    )
    frame_s = 1.0 / evaluated.scene.rate.fps
    onset, release = evaluated.values[[start, end]] / frame_s
    std = [_apart_from_the_rate(evaluated, index) / frame_s for index in (start, end, lasting)]
    count, spread = frames_within(float(onset), float(release), (std[0], std[1], std[2]))
    return Quantity.measured(
        "contact_frames", count, "1", (Contribution(UncertaintySource.FRAME_COUNT, spread),)
    )


def frames_within(
    onset: float, release: float, std: tuple[float, float, float]
) -> tuple[int, float]:
    """Number of frames within a contact, and its standard uncertainty.

    Parameters
    ----------
    onset, release : float
        In frames.
    std : (3,) tuple of float
        Standard uncertainties of onset, release and of the time between them, frames.
    """
    count = math.floor(release) - math.ceil(onset) + 1
    # onset and release are correlated: the face offset moves them apart
    correlation = (std[0] ** 2 + std[1] ** 2 - std[2] ** 2) / (2.0 * std[0] * std[1])
    first, second = _even_draws()
    correlation = min(max(correlation, -1.0), 1.0)
    begun = onset + std[0] * first
    ended = release + std[1] * (correlation * first + math.sqrt(1.0 - correlation**2) * second)
    counts = np.maximum(np.floor(ended) - np.ceil(begun) + 1.0, 0.0)
    off = np.abs(counts - count)
    # a count is not Gaussian: an std below 0.5 would exclude every other count at k = 2, and a
    # count of 1 % probability must not be four standard uncertainties off
    covered = float(np.quantile(off, _COVERAGE, method="inverted_cdf"))
    return count, max(float(np.sqrt(np.mean(off**2))), covered / 2.0, float(off.max()) / 4.0)


_COVERAGE = 0.95
"""Coverage of two standard uncertainties (convention)."""


@cache
def _even_draws() -> FloatArray:
    """Quasi-random draws of two independent standard normals, (2, 1024)."""
    steps = np.arange(1, 1025)[np.newaxis] / np.array([[_PLASTIC], [_PLASTIC**2]])
    return np.asarray(scipy.special.ndtri((0.5 + steps) % 1.0))


def _apart_from_the_rate(evaluated: Evaluated, index: int) -> float:
    """Standard uncertainty of a time in frames, s, without that of the capture rate."""
    systematic = sum(
        float(column[index]) ** 2
        for name, column in evaluated.systematic.items()
        if name is not UncertaintySource.CAPTURE_RATE
    )
    return max(math.sqrt(evaluated.random[index, index] + systematic), 1e-6)


def _met_by_another(evaluated: Evaluated, tracks: Tracks) -> dict[str, Quantity]:
    """Contact with a second ball or puck instead of a pendulum."""
    met = disc_contact(tracks) if tracks.motion.kind is MotionKind.COLLISION else None
    if met is None or not evaluated.scene.rate.known:
        return {}
    clock = met.time_s * evaluated.scene.rate.std / evaluated.scene.rate.fps
    budget = (
        Contribution(UncertaintySource.TRACK_NOISE, met.std_s),
        Contribution(UncertaintySource.CAPTURE_RATE, clock),
    )
    start = Quantity.measured("contact_start", met.time_s, "s", budget)
    return {"contact_start": start} | _too_short(met.longest_s)


def _too_short(longest_s: float) -> dict[str, Quantity]:
    """Withhold contact time and frames of a contact not longer than this (k = 2), s."""
    short = (
        "the contact is too short for this frame rate, or not resolved: it lasts at most"
        f" {longest_s:.2g} s; film at a higher rate"
    )
    return {
        name: Quantity.missing(name, unit, short)
        for name, unit in (("contact_end", "s"), ("contact_time", "s"), ("contact_frames", "1"))
    }


def _if_too_short(lasting: Quantity) -> dict[str, Quantity]:
    """The same if the contact time is not significantly above zero."""
    if lasting.value is None or lasting.std is None:
        return {}
    if lasting.value > _ONE_SIDED_95 * lasting.std:
        return {}
    return _too_short(max(lasting.value, 0.0) + 2.0 * lasting.std)


_ONE_SIDED_95 = 1.645
"""Standard uncertainties above zero with a probability of 95 % (convention)."""


def _geometry(
    evaluated: Evaluated,
    found: dict[str, Quantity],
    no_grid: str,
    motion: MotionResults | None,
) -> dict[str, Quantity]:
    calibration = evaluated.scene.calibration
    names = ("ball_plane_offset", "camera_distance")
    if calibration is None:
        missing = {name: Quantity.missing(name, "m", no_grid) for name in names}
        wall = Quantity.missing("landing_distance_on_wall", "m", no_grid)
        return missing | {"landing_distance_on_wall": wall}
    if evaluated.impact is None and not any(
        item.known for item in (MotionResults() if motion is None else motion).quantities.values()
    ):
        # no tracked object is established to be a ball in its plane
        no_grid = evaluated.refusal or "no motion of a ball was measured"
        return {
            name: Quantity.missing(name, "m", no_grid)
            for name in (*names, "landing_distance_on_wall")
        }
    out = {
        names[0]: _depth(names[0], calibration, lambda c: c.ball_plane_offset),
        names[1]: _depth(names[1], calibration, lambda c: c.camera_distance),
    }
    landing = found["landing_distance"]
    if landing.value is None:
        wall = Quantity.missing("landing_distance_on_wall", "m", str(landing.reason))
        return out | {"landing_distance_on_wall": wall}
    return out | {"landing_distance_on_wall": reading_on_wall(evaluated, landing)}


def _depth(name: str, calibration: Calibration, value: Callable[[Calibration], float]) -> Quantity:
    """A depth with the longer side of its interval as std; missing if it is mostly assumed.

    Without measured distances, depths have a relative uncertainty: the interval is exp(±s).
    """
    found = value(calibration)
    budget = calibration.budget(value)
    relative_std = float(np.sqrt(sum(line.std**2 for line in budget))) / max(abs(found), 1e-9)
    assumed = sum(line.std**2 for line in budget if line.source in ASSUMED_SOURCES)
    if relative_std > MAX_DEPTH_RELATIVE_STD and assumed > 0.5 * (relative_std * found) ** 2:
        return Quantity.missing(
            name,
            "m",
            "the wall is nearly square to the camera, so its image gives only distance and focal"
            " length together: measure the distance to the wall, or name a lens.toml in the setup"
            " file",
        )
    longer = float(np.expm1(min(relative_std, 1.0)) / relative_std) if relative_std > 0 else 1.0
    widened = tuple(replace(line, std=line.std * longer) for line in budget)
    return Quantity.measured(name, found, "m", widened)


def reading_on_wall(evaluated: Evaluated, landing: Quantity) -> Quantity:
    """Reading of the landing point on the wall, relative to that of the rest position."""
    calibration, impact = evaluated.scene.calibration, evaluated.impact
    assert calibration is not None
    assert impact is not None
    assert landing.value is not None
    rest = impact.tracks.rest_m
    direction = impact.tracks.direction
    height = evaluated.values[list(DERIVED).index("landing_height")]
    depth = calibration.ball_plane_offset
    spots = np.array(
        [
            [direction * rest[0], rest[1], depth],
            [direction * (rest[0] + landing.value), height, depth],
        ]
    )
    seen = calibration.on_wall(calibration.camera.project(spots))
    reading = direction * float(seen[1, 0] - seen[0, 0])
    enlarged = reading / landing.value
    budget = tuple(
        replace(line, std=line.std * enlarged)
        for line in landing.budget
        # depth and distance affect the corrected value, not the reading
        if line.source not in _DEPTHS
    )
    return Quantity.measured("landing_distance_on_wall", reading, "m", budget)


def _backswing(evaluated: Evaluated) -> Quantity:
    """Angle at which the pendulum is released, if that is in view."""
    scene = evaluated.scene
    if evaluated.metric is None:
        return Quantity.missing(_BACKSWING_NAME, "deg", _NOT_BEFORE)
    stiffness = scene.inputs.pendulum_stiffness if scene.rate.known else None
    return release_angle(evaluated.metric, scene.zero_std_rad, stiffness)


def release_angle(metric: MetricTracks, zero_std_rad: float, stiffness: float | None) -> Quantity:
    """Release angle of the pendulum, if its motion before the strike agrees with it.

    Parameters
    ----------
    metric : MetricTracks
        Angle of the pendulum over time.
    zero_std_rad : float
        Standard uncertainty of the zero of all angles, rad.
    stiffness : float or None
        Square of its angular frequency, 1/s²; None if the frame rate is unknown.

    Returns
    -------
    Quantity
        Degrees behind the vertical; missing if the motion contradicts it.
    """
    if len(metric.swing_rad) < _AVERAGED_FRAMES:
        return Quantity.missing(_BACKSWING_NAME, "deg", _NOT_BEFORE)
    first = slice(0, _AVERAGED_FRAMES)
    rate = float(np.polyfit(metric.swing_time_s[first], metric.swing_rad[first], 1)[0])
    if abs(rate) > 0.3:
        return Quantity.missing(
            _BACKSWING_NAME, "deg", "the pendulum is already swinging when it enters the picture"
        )
    start = float(np.median(metric.swing_rad[first]))
    fastest, angle = _fastest(metric)
    if math.cos(angle) < 0.0:
        return Quantity.missing(
            _BACKSWING_NAME,
            "deg",
            "the tracked object is above its pivot where it is fastest, which no pendulum is: its"
            " arc is too short or too noisy to locate the pivot",
        )
    if stiffness is not None and not _swings_from(start, angle, fastest, stiffness):
        return Quantity.missing(
            _BACKSWING_NAME,
            "deg",
            f"it is first visible at {-math.degrees(start):.1f}°, but its later motion contradicts"
            " a release there: it was released elsewhere, or frames are missing",
        )
    std = math.degrees(float(np.median(metric.swing_std_rad[first])))
    return Quantity.measured(
        _BACKSWING_NAME,
        -math.degrees(start),
        "deg",
        (
            Contribution(UncertaintySource.PENDULUM_ZERO, math.degrees(zero_std_rad)),
            Contribution(UncertaintySource.TRACK_NOISE, std),
        ),
    )


def _fastest(metric: MetricTracks) -> tuple[float, float]:
    """Maximum rate (rad/s) and the angle (rad) at which it occurs."""
    rows = sliding_window_view(np.arange(len(metric.swing_rad)), _AVERAGED_FRAMES)
    time, angle = metric.swing_time_s[rows], metric.swing_rad[rows]
    since = time - time.mean(axis=1, keepdims=True)
    rates = (since * angle).sum(axis=1) / (since**2).sum(axis=1)
    fastest = int(np.argmax(np.abs(rates)))
    return float(rates[fastest]), float(angle[fastest].mean())


def _swings_from(start: float, angle: float, rate: float, stiffness: float) -> bool:
    """Whether a rate (rad/s) at an angle (rad) has the energy of a release at the start angle."""
    gained = 2.0 * stiffness * (math.cos(angle) - math.cos(start))
    return abs(gained - rate**2) < MAX_SWING_ENERGY_ERROR * rate**2
