"""Uncertainty budget of a strike: effect of each input by itself (GUM 5.1).

The fits are optima, and the shift of an optimum with an input is one linear solve (`moved_fit`),
chained from fit to fit. Repeating every fit gives the same at many times the cost, except where a
fit has no smooth optimum; it remains available as a check (`Propagation.REFIT`). Derived values:
speeds, angle, landing, restitution (Eqs 2, 7-10, 17, 18).
"""

import math
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.solve import LOG_FOCAL_STD
from measuring.checks import (
    OTHER_SPEEDS,
    eq7_gravity_excess,
    speed_by_pendulum,
    speed_per_frame,
)
from measuring.flight_fit import FlightFit, SwingFit
from measuring.impact import (
    Impact,
    ImpactView,
    find_impact,
    moved_impact,
    touch_times,
)
from measuring.inputs import Inputs
from measuring.metres import (
    AssumedLens,
    BallScale,
    MetricTracks,
    arm_along_bar,
    assumed_lens,
    ball_scale,
)
from metrology import Contribution, Defaults, MeasurementError, Quantity, UncertaintySource
from physics.bodies import Pendulum
from vision.clip.footage import CaptureRate
from vision.tracks import Tracks

__all__ = [
    "DERIVED",
    "ClipConditions",
    "JointCovariance",
    "Propagation",
    "derived_values",
    "impact_after_move",
    "joint_covariance",
    "merged",
    "random_covariance",
    "systematic_budget",
    "values_after_move",
    "values_of",
]

FloatArray = NDArray[np.float64]

DERIVED: dict[str, str] = {
    "contact_time": "s",
    "contact_start": "s",
    "contact_end": "s",
    "pendulum_speed_before": "m/s",
    "pendulum_speed_after": "m/s",
    "ball_speed": "m/s",
    "launch_angle": "deg",
    "landing_distance": "m",
    "landing_time": "s",
    "cor_speeds": "1",
    "cor_launch": "1",
    "cor_range": "1",
    "external_impulse": "N s",
    "energy_loss": "J",
    "gravity": "m/s^2",
    "landing_moment": "s",
    "landing_height": "m",
    "landing_distance_seen": "m",
    "landing_beyond_flight": "m",
    **OTHER_SPEEDS,
    "eq7_by_gravity": "m/s",
}
"""Name and unit of each derived value, in the order of the vectors below."""


@dataclass(frozen=True)
class _Shift:
    """Shift of each fitted part from its best estimate; None for no shift.

    Attributes
    ----------
    flight : (7,) array or None
    before, after : (3,) arrays or None
        Of the swings.
    rest : (2,) array or None
        m.
    face : (2,) array or None
        Of the face's offset at onset and release, m.
    landing : (2,) array or None
        Of the observed or stated touch-down, m.
    """

    flight: FloatArray | None = None
    before: FloatArray | None = None
    after: FloatArray | None = None
    rest: FloatArray | None = None
    face: FloatArray | None = None
    landing: FloatArray | None = None


@dataclass(frozen=True)
class _DrawnParts:
    """Fitted parts after a shift."""

    flight: FlightFit
    view: ImpactView | None
    face: FloatArray
    rest: FloatArray
    landing: FloatArray | None


def derived_values(
    impact: Impact, inputs: Inputs, names: Container[str] = frozenset(DERIVED)
) -> FloatArray:
    """Values in the order of `DERIVED`; NaN where a part is missing or a name is not requested."""
    return _evaluate(impact, inputs, _Shift(), names)


def random_covariance(
    impact: Impact, inputs: Inputs, names: Container[str] = frozenset(DERIVED)
) -> FloatArray:
    """Covariance of `derived_values` from track noise, by finite differences."""
    total = np.zeros((len(DERIVED), len(DERIVED)))
    for shift, covariance in _blocks(impact):
        values, vectors = np.linalg.eigh(covariance)
        for value, vector in zip(values, vectors.T, strict=True):
            if value <= 0:
                continue
            step = np.sqrt(value) * vector
            ahead = _evaluate(impact, inputs, shift(step), names)
            behind = _evaluate(impact, inputs, shift(-step), names)
            slope = 0.5 * (ahead - behind)
            total += np.outer(slope, slope)
    free = impact.free_flight.fitted.covariance[6, 6]
    gravity = list(DERIVED).index("gravity")
    total[gravity, :] = total[:, gravity] = 0.0
    total[gravity, gravity] = free
    frames = list(DERIVED).index("ball_speed_per_frame")
    total[frames, frames] = speed_per_frame(impact.tracks, impact.flight)[1] ** 2
    return total


def _blocks(impact: Impact) -> list[tuple[Callable[[FloatArray], _Shift], FloatArray]]:
    """Independent parts: how a step shifts each, and its covariance."""
    blocks: list[tuple[Callable[[FloatArray], _Shift], FloatArray]] = [
        (lambda step: _Shift(flight=step), impact.flight.fitted.covariance),
        (lambda step: _Shift(rest=step), np.diag(impact.tracks.rest_std_m**2)),
    ]
    if impact.view is not None and impact.contact is not None:
        blocks += [
            (lambda step: _Shift(before=step), impact.view.before.fitted.covariance),
            (lambda step: _Shift(after=step), impact.view.after.fitted.covariance),
            (lambda step: _Shift(face=step), impact.contact.face_covariance),
        ]
    if impact.landing is not None:
        spread = impact.landing.covariance[1:, 1:]
        blocks.append((lambda step: _Shift(landing=step), spread))
    return blocks


def _shifted(impact: Impact, shift: _Shift) -> _DrawnParts:
    flight, view, rest = impact.flight, impact.view, impact.tracks.rest_m
    face = np.zeros(2) if impact.contact is None else impact.contact.face
    landing = None if impact.landing is None else impact.landing.place_m
    if shift.flight is not None:
        fitted = replace(flight.fitted, values=flight.fitted.values + shift.flight)
        flight = replace(flight, fitted=fitted)
    if shift.rest is not None:
        rest = rest + shift.rest
    if shift.face is not None:
        face = face + shift.face
    if shift.landing is not None and landing is not None:
        landing = landing + shift.landing
    if view is not None:
        view = replace(
            view,
            flight=flight,
            rest=rest,
            before=_moved_parts(view.before, shift.before),
            after=_moved_parts(view.after, shift.after),
        )
    return _DrawnParts(flight, view, face, rest, landing)


def _moved_parts(swing: SwingFit, step: FloatArray | None) -> SwingFit:
    if step is None:
        return swing
    return replace(swing, fitted=replace(swing.fitted, values=swing.fitted.values + step))


class _Strike:
    """Values that follow from the fitted parts, computed on demand."""

    def __init__(self, impact: Impact, inputs: Inputs, shift: _Shift) -> None:
        self.impact = impact
        self.inputs = inputs
        self.parts = _shifted(impact, shift)

    @cached_property
    def contact(self) -> tuple[float, float] | None:
        """Onset and release, s; None if no contact is observed or the two never meet."""
        view, contact = self.parts.view, self.impact.contact
        if view is None or contact is None:
            return None
        times = touch_times(view, self.parts.face, 0.5 * (contact.onset_s + contact.release_s))
        return times if np.isfinite(times).all() else None

    @cached_property
    def release_s(self) -> float:
        return self.parts.flight.reference_s if self.contact is None else self.contact[1]

    @cached_property
    def state(self) -> FloatArray:
        """Position and velocity of the ball at release, (4,)."""
        return np.asarray(self.parts.flight.states(np.array([self.release_s]))[0])

    @cached_property
    def floor(self) -> float | None:
        """Height of the ball's centre at landing, m: where it was stated, else from the support."""
        if self.impact.tracks.landing is not None and self.parts.landing is not None:
            return float(self.parts.landing[1])
        fall = self.inputs.fall
        return None if fall is None else float(self.parts.rest[1]) - fall

    @cached_property
    def landing(self) -> tuple[float, FloatArray] | None:
        """Time and state (4,) of landing; None if the ball does not land."""
        landed = None if self.floor is None else self.parts.flight.falls_to(self.floor)
        if landed is None:
            return None
        return landed, self.parts.flight.states(np.array([landed]))[0]

    @cached_property
    def distance(self) -> float:
        """Distance of the landing from rest, m: where it was stated, else from the flight."""
        if self.impact.tracks.landing is not None:
            return self.distance_seen
        return self.distance_flown

    @cached_property
    def distance_flown(self) -> float:
        """Distance from rest at which the fitted flight lands, m; NaN if it does not."""
        return self.of_landing(lambda _, there: float(there[0] - self.parts.rest[0]))

    @cached_property
    def distance_seen(self) -> float:
        """Distance of the observed touch-down from rest, m; NaN if it is not observed."""
        if self.parts.landing is None:
            return np.nan
        return float(self.parts.landing[0] - self.parts.rest[0])

    @cached_property
    def swung(self) -> "_Swung | None":
        if self.parts.view is None or self.contact is None:
            return None
        return _Swung.of(self.parts.view, self.parts.rest, self.contact, self.inputs)

    @cached_property
    def per_frame(self) -> float:
        return speed_per_frame(self.impact.tracks, self.impact.flight)[0]

    @cached_property
    def ball_mass(self) -> float | None:
        return None if self.inputs.ball is None else self.inputs.ball.mass

    def of_contact(self, value: Callable[[float, float], float]) -> float:
        """A value of onset and release; NaN without a contact."""
        return np.nan if self.contact is None else value(*self.contact)

    def of_landing(self, value: Callable[[float, FloatArray], float]) -> float:
        """A value of time and state of landing; NaN without a landing."""
        return np.nan if self.landing is None else value(*self.landing)

    def of_swings(self, value: "Callable[[_Swung], float]") -> float:
        """A value of the swings; NaN if they are not observed."""
        return np.nan if self.swung is None else value(self.swung)

    def of_masses(self, value: "Callable[[_Swung, float], float]") -> float:
        """A value of the swings and the ball's mass; NaN if either is missing."""
        if self.swung is None or self.ball_mass is None:
            return np.nan
        return value(self.swung, self.ball_mass)

    def eq7(self, swung: "_Swung", mass: float) -> float:
        return speed_by_pendulum(self.inputs.pendulum, mass, swung.speed_before, swung.speed_after)

    def eq7_by_gravity(self, swung: "_Swung", mass: float) -> float:
        middle, pull = swung.middle, (self.inputs.gravity, swung.lasting)
        return eq7_gravity_excess(self.inputs.pendulum, mass, middle, swung.arm, pull)

    def cor_range(self, swung: "_Swung", mass: float) -> float:
        if self.floor is None or not np.isfinite(self.distance_seen):
            return np.nan
        place = np.array([self.parts.rest[0] + self.distance_seen, self.floor])
        launched = _launch_to(self.parts.flight, self.state, place)
        return np.nan if launched is None else swung.cor_of(launched, mass)


@dataclass(frozen=True)
class _Swung:
    """The pendulum on both sides of a contact.

    Attributes
    ----------
    rest : (2,) array
        Of the ball, m.
    phi_before, phi_after : float
        Angle at onset and release, rad.
    omega_before, omega_after : float
        Angular velocity there, rad/s.
    arm : float
        Pivot to the point of contact along the bar, m.
    lasting : float
        Duration of contact, s.
    """

    view: ImpactView
    rest: FloatArray
    inputs: Inputs
    phi_before: float
    phi_after: float
    omega_before: float
    omega_after: float
    arm: float
    lasting: float

    @classmethod
    def of(
        cls, view: ImpactView, rest: FloatArray, contact: tuple[float, float], inputs: Inputs
    ) -> "_Swung":
        onset, release = contact
        phi_before, omega_before = view.before.state(onset)
        phi_after, omega_after = view.after.state(release)
        omega_after *= inputs.after_factor
        arm = inputs.arm_factor * arm_along_bar(rest - view.pivot, phi_before)
        lasting = release - onset
        return cls(
            view, rest, inputs, phi_before, phi_after, omega_before, omega_after, arm, lasting
        )

    @property
    def middle(self) -> float:
        """Angle at mid-contact, rad."""
        return 0.5 * (self.phi_before + self.phi_after)

    @property
    def speed_before(self) -> float:
        return self.omega_before * self.arm

    @property
    def speed_after(self) -> float:
        return self.omega_after * self.arm

    @property
    def true_rate(self) -> float:
        # a wrong pivot changes angles by the ratio of the arms, but not speeds
        return self.arm / self.inputs.pendulum.length

    @property
    def energy_loss(self) -> float:
        spent = (self.omega_before**2 - self.omega_after**2) * self.true_rate**2
        return 0.5 * self.inputs.pendulum.inertia * spent

    def cor(self, state: FloatArray, omega_after: float) -> float:
        """Separation over approach speed along the contact normal (Eq. 2), at the contact point.

        For a round bob the direction of the push determines the probability that the normal is the
        line of centres instead of that of a flat face; its variance is an uncertainty.
        """
        face = self._cor_along(state, omega_after, self.phi_before, self.phi_after)
        centres = self._angles_of_centres(state)
        if centres is None:
            return face
        sphere = self._cor_along(state, omega_after, *centres)
        probability = self._probability_of_centres(state, float(np.mean(centres)))
        probability += self.inputs.normal_sigmas * np.sqrt(probability * (1.0 - probability))
        return float(face + probability * (sphere - face))

    def _cor_along(self, state: FloatArray, omega_after: float, first: float, last: float) -> float:
        """COR along normals at given angles at onset and release, rad."""
        factor = self.inputs.arm_factor
        normal = np.array([np.cos(last), np.sin(last)])
        arm_after = factor * arm_along_bar(state[:2] - self.view.pivot, last)
        parting = float(state[2:] @ normal) - omega_after * arm_after
        approach = factor * arm_along_bar(self.rest - self.view.pivot, first)
        return float(parting / (self.omega_before * approach))

    def _angles_of_centres(self, state: FloatArray) -> tuple[float, float] | None:
        """Angles of the line from a round bob's centre to the ball's at onset and release, rad."""
        arm = self.view.bob_arm
        if arm is None:
            return None

        def angle(ball: FloatArray, phi: float) -> float:
            away = ball - self.view.pivot - arm * np.array([np.sin(phi), -np.cos(phi)])
            return float(np.arctan2(away[1], away[0]))

        return angle(self.rest, self.phi_before), angle(state[:2], self.phi_after)

    def _probability_of_centres(self, state: FloatArray, centres: float) -> float:
        """Probability that the normal is the line of centres, from the direction of the push."""
        push = float(np.arctan2(state[3] + self.inputs.gravity * self.lasting, state[2]))
        off = np.array([push - self.middle, push - centres]) / Defaults.PUSH_SLANT.std
        return float(scipy.special.expit(0.5 * (off[0] ** 2 - off[1] ** 2)))

    def cor_of(self, launched: FloatArray, mass: float) -> float:
        """COR where the ball's momentum gives the pendulum's speed after contact (Eqs 8-10)."""
        body, pivot = self.inputs.pendulum, self.view.pivot
        lever = (launched[:2] - pivot) / self.true_rate
        angular_momentum = mass * (lever[0] * launched[3] - lever[1] * launched[2])
        weight = body.mass * body.com * np.sin(self.middle) + mass * 0.5 * (
            lever[0] + (self.rest[0] - pivot[0]) / self.true_rate
        )
        lost = self.inputs.gravity * weight * self.lasting
        turned = float(
            self.omega_before - (angular_momentum + lost) / (body.inertia * self.true_rate)
        )
        return self.cor(launched, turned)


_VALUE_OF: dict[str, Callable[[_Strike], float]] = {
    "contact_time": lambda s: s.of_contact(lambda onset, release: release - onset),
    "contact_start": lambda s: s.of_contact(lambda onset, _: onset),
    "contact_end": lambda s: s.of_contact(lambda _, release: release),
    "pendulum_speed_before": lambda s: s.of_swings(lambda w: w.speed_before),
    "pendulum_speed_after": lambda s: s.of_swings(lambda w: w.speed_after),
    "ball_speed": lambda s: float(np.hypot(*s.state[2:])),
    "launch_angle": lambda s: float(np.degrees(np.arctan2(s.state[3], s.state[2]))),
    "landing_distance": lambda s: s.distance,
    "landing_time": lambda s: (
        np.nan if s.contact is None else s.of_landing(lambda landed, _: landed) - s.contact[0]
    ),
    "cor_speeds": lambda s: s.of_swings(lambda w: w.cor(s.state, w.omega_after)),
    "cor_launch": lambda s: s.of_masses(lambda w, mass: w.cor_of(s.state, mass)),
    "cor_range": lambda s: s.of_masses(s.cor_range),
    "external_impulse": lambda s: (
        np.nan if s.ball_mass is None else s.ball_mass * float(np.hypot(*s.state[2:]))
    ),
    "energy_loss": lambda s: s.of_swings(lambda w: w.energy_loss),
    "gravity": lambda s: _fall(s.impact.free_flight),
    "landing_moment": lambda s: s.of_landing(lambda landed, _: landed),
    "landing_height": lambda s: s.of_landing(lambda _, there: float(there[1])),
    "landing_distance_seen": lambda s: s.distance_seen,
    "landing_beyond_flight": lambda s: s.distance_seen - s.distance_flown,
    "ball_speed_per_frame": lambda s: s.per_frame,
    "ball_speed_eq7": lambda s: s.of_masses(s.eq7),
    "eq7_by_gravity": lambda s: s.of_masses(s.eq7_by_gravity),
}


def _fall(free: FlightFit) -> float:
    """Acceleration of a flight fitted without a prior; NaN where its frames do not determine it."""
    return float(free.fitted.values[6]) if free.fitted.determined[6] else np.nan


def _evaluate(impact: Impact, inputs: Inputs, shift: _Shift, names: Container[str]) -> FloatArray:
    strike = _Strike(impact, inputs, shift)
    return np.array([_VALUE_OF[name](strike) if name in names else np.nan for name in DERIVED])


def _launch_to(flight: FlightFit, state: FloatArray, place: FloatArray) -> FloatArray | None:
    """Release state in the measured direction whose flight lands at `place` (Eqs 13-17).

    Drag and lift are those fitted to this flight, while Eq. 17 has only drag.
    """
    forces = flight.fitted.values[4:]

    def miss(fraction: float) -> float:
        values = np.concatenate([state[:2], state[2:] * fraction, forces])
        landed = flight.falls_to(float(place[1]), values)
        if landed is None:
            return float(state[0] - place[0])
        return float(flight.states(np.array([landed]), values)[0, 0] - place[0])

    if miss(0.7) * miss(1.4) > 0:
        return None
    fraction = float(scipy.optimize.brentq(miss, 0.7, 1.4, xtol=1e-7))
    return np.concatenate([state[:2], state[2:] * fraction])


_STEP_SIGMAS = 0.3
"""Standard deviations of a step (chosen: linear range, far above rounding)."""

_SMALLER_STEPS = (0.5, 0.2)
"""Standard deviations of a step where a full one has no solution (chosen)."""

_MAX_SINE = 0.98
"""Maximum sine of the slant (chosen: some 80°)."""

_MIN_AXIS = 1e-12
"""Of the largest eigenvalue of the correlation: below is rounding (chosen)."""


class Propagation(StrEnum):
    """How the effect of a changed input is found."""

    RESPONSE = "response"
    """To first order, by linear response of every fit."""
    REFIT = "refit"
    """By repeating every fit."""


@dataclass(frozen=True)
class ClipConditions:
    """Conditions common to the whole clip that may be wrong.

    Attributes
    ----------
    calibration : Calibration or None
        None if the scale comes from the ball's size.
    scale : float
        Factor on lengths without a calibration.
    roll_rad, slant_rad : float
        Rotation of the camera about its axis, and about the vertical, without a calibration.
    lens : AssumedLens or None
        Assumed lens without a calibration.
    metres_per_px : (2,) tuple of float or None
        Given scale in the plane of motion, with its standard uncertainty.
    zero_rad, zero_std_rad : float
        Offset of all pendulum angles, and its std.
    pivot_px : (2,) tuple of float
        Offset of the pivot in the picture.
    pivot_steps_px : tuple of (2,) tuples of float
        One standard deviation of the pivot along either principal axis.
    round_bob : bool
        Whether a round bob strikes, whose contact normal may differ from its arm's.
    """

    inputs: Inputs
    rate: CaptureRate
    calibration: Calibration | None
    scale: float = 1.0
    roll_rad: float = 0.0
    slant_rad: float = 0.0
    lens: AssumedLens | None = None
    metres_per_px: tuple[float, float] | None = None
    zero_rad: float = 0.0
    zero_std_rad: float = 0.0
    pivot_px: tuple[float, float] = (0.0, 0.0)
    pivot_steps_px: tuple[tuple[float, float], ...] = ()
    round_bob: bool = False

    @property
    def slant_std_rad(self) -> float:
        """Std of the slant."""
        return Defaults.CAMERA_SLANT.std if self.lens is None else self.lens.slant_std_rad

    def plane_of_ball(self, tracks: Tracks) -> BallScale:
        """Mapping of the plane of motion without a calibration."""
        lens = self.lens or assumed_lens(tracks.ball, tracks.background.shape)
        return ball_scale(
            tracks,
            lens,
            1.0 if self.inputs.ball is None else self.inputs.ball.diameter,
            metres_per_px=None if self.metres_per_px is None else self.metres_per_px[0],
            stretched=self.scale,
            roll_rad=self.roll_rad,
            slant_rad=self.slant_rad,
        )

    def through(self, focal_px: float) -> "ClipConditions":
        """The same scene with another focal length and the same change of scale per pixel."""
        assert self.lens is not None
        sine = math.sin(self.slant_rad) * focal_px / self.lens.focal_px
        slant = math.asin(min(max(sine, -_MAX_SINE), _MAX_SINE))
        return replace(self, slant_rad=slant, lens=replace(self.lens, focal_px=focal_px))

    def places_as(self, other: "ClipConditions") -> bool:
        """Whether pixels and frames map to the same metres and seconds as under `other`."""
        return (
            self.calibration is other.calibration
            and self.rate is other.rate
            and self._moved_by == other._moved_by
        )

    @property
    def _moved_by(self) -> tuple[object, ...]:
        turned = self.roll_rad, self.slant_rad, self.zero_rad
        focal = None if self.lens is None else self.lens.focal_px
        return (self.scale, *turned, self.metres_per_px, self.pivot_px, focal)


def values_after_move(
    impact: Impact,
    tracks: MetricTracks,
    inputs: Inputs,
    propagation: Propagation = Propagation.RESPONSE,
    names: Container[str] = frozenset(DERIVED),
) -> FloatArray:
    """Derived values after a small change of inputs.

    Parameters
    ----------
    impact : Impact
        Fitted before the change.
    tracks : MetricTracks
        The same frames, in metres and seconds after the change.
    inputs : Inputs
        After the change.
    names : container of str
        Requested values.

    Returns
    -------
    (Q,) array
        In the order of `DERIVED`; NaN if undetermined or not requested.
    """
    return values_of(impact_after_move(impact, tracks, inputs, propagation), inputs, names)


def values_of(
    impact: Impact | None, inputs: Inputs, names: Container[str] = frozenset(DERIVED)
) -> FloatArray:
    """`derived_values` of an impact; NaN if undetermined."""
    try:
        if impact is not None:
            return derived_values(impact, inputs, names)
    except MeasurementError:
        pass
    return np.full(len(DERIVED), np.nan)


def impact_after_move(
    impact: Impact, tracks: MetricTracks, inputs: Inputs, propagation: Propagation
) -> Impact | None:
    """Impact after a small change of inputs; None if there is none any more.

    Parameters
    ----------
    impact, tracks, inputs, propagation
        See `values_after_move`.
    """
    try:
        if propagation is Propagation.RESPONSE:
            return moved_impact(impact, tracks, inputs)
        times = None
        if impact.contact is not None:
            fraction = float(tracks.ball_time_s[-1] / impact.tracks.ball_time_s[-1])
            # keep the frames: one more or less at the floor changes gravity by its noise
            ended = impact.last_flight_s + 0.5 * float(np.median(np.diff(impact.flight.time_s)))
            contact = impact.contact
            times = (fraction * contact.onset_s, fraction * contact.release_s, fraction * ended)
        return find_impact(tracks, inputs, times)
    except MeasurementError:
        return None


_Sides: TypeAlias = tuple[ClipConditions, ...]


def systematic_budget(
    scene: ClipConditions, values: Callable[[ClipConditions], FloatArray], scale_std: float
) -> dict[UncertaintySource, FloatArray]:
    """Contribution of each input to each value.

    Parameters
    ----------
    scene : ClipConditions
        Evaluates the fits under other conditions; (Q,).
    values : callable
        Does the chain again for a scene; (Q,).
    scale_std : float
        Relative std of the given scale, or of the scale from the ball's size, without a
        calibration.

    Returns
    -------
    dict
        Source to (Q,) one-sigma contributions, NaN where a value is missing.
    """
    base = values(scene)

    def column(sides: _Sides) -> FloatArray:
        # the larger effect of both directions counts
        away = [np.abs(values(side) - base) for side in sides]
        return np.asarray(np.fmax.reduce(away))

    moves = _moved(scene, scale_std, 1.0)
    columns = [column(sides) for _, sides in moves]
    # use a smaller step for an input so uncertain that a full step has no solution
    for fraction in _SMALLER_STEPS:
        nearer = _moved(scene, scale_std, fraction)
        for place, found in enumerate(columns):
            if np.isnan(found[np.isfinite(base)]).any():
                columns[place] = column(nearer[place][1]) / fraction
    table: dict[UncertaintySource, FloatArray] = {}
    for (source, _), found in zip(moves, columns, strict=True):
        known = table.get(source, found * 0.0)
        table[source] = np.fmax(np.hypot(known, found), np.fmax(known, found))
    if scene.calibration is not None:
        table |= _by_calibration(
            scene.calibration, base, lambda c: values(replace(scene, calibration=c))
        )
    return table


def _by_calibration(
    calibration: Calibration, base: FloatArray, values: Callable[[Calibration], FloatArray]
) -> dict[UncertaintySource, FloatArray]:
    """Contribution of each source of the calibration, by steps along its principal axes.

    Distance, focal length and depth may each have an std of 30 % while the scale of the ball plane
    has 0.1 %: only steps along this correlation stay in the linear range.
    """
    std = np.sqrt(np.maximum(np.diag(calibration.covariance), 0.0))
    free = std > 0
    scaled = calibration.covariance[np.ix_(free, free)] / np.outer(std[free], std[free])
    lengths, axes = np.linalg.eigh(scaled)
    kept = lengths > _MIN_AXIS
    axes, lengths = axes[:, kept], np.sqrt(lengths[kept])
    slope = np.zeros((len(base), len(lengths)))
    for index, (axis, length) in enumerate(zip(axes.T, lengths, strict=True)):
        step = np.zeros(len(std))
        step[free] = _STEP_SIGMAS * length * std[free] * axis
        slope[:, index] = (
            values(calibration.with_parameters(calibration.vector + step)) - base
        ) / (_STEP_SIGMAS * length)
    table = {}
    for part in calibration.sources:
        fraction = part.covariance[np.ix_(free, free)] / np.outer(std[free], std[free])
        spread = ((slope @ (axes.T @ fraction @ axes)) * slope).sum(axis=1)
        table[part.name] = np.sqrt(np.maximum(spread, 0.0))
    return table


def _moved(
    scene: ClipConditions, scale_std: float, fraction: float
) -> list[tuple[UncertaintySource, _Sides]]:
    """Conditions with each input changed by a fraction of its std, in both directions if needed."""
    inputs, rate = scene.inputs, scene.rate
    moved: list[tuple[UncertaintySource, _Sides]] = []

    def move(source: UncertaintySource, *sides: ClipConditions) -> None:
        moved.append((source, sides))

    if rate.known:
        faster = replace(rate, fps=rate.fps + fraction * rate.std)
        move(UncertaintySource.CAPTURE_RATE, replace(scene, rate=faster))
    rig = inputs.rig
    for source, body in _other_pendulums(inputs, fraction):
        move(source, replace(scene, inputs=replace(inputs, pendulum=body)))
    nearer = replace(
        inputs, arm_factor=inputs.arm_factor * (1 + fraction * Defaults.VISIBLE_DEPTH.std)
    )
    move(UncertaintySource.PENDULUM_ARM, replace(scene, inputs=nearer))
    if scene.zero_std_rad > 0.0:
        turned = replace(scene, zero_rad=scene.zero_rad + fraction * scene.zero_std_rad)
        move(UncertaintySource.PENDULUM_ZERO, turned)
    for x, y in scene.pivot_steps_px:
        elsewhere = replace(scene, pivot_px=(fraction * x, fraction * y))
        move(UncertaintySource.PENDULUM_PIVOT, elsewhere)
    ringing = replace(
        inputs, after_factor=inputs.after_factor * (1 + fraction * Defaults.RINGING.std)
    )
    move(UncertaintySource.PENDULUM_RINGING, replace(scene, inputs=ringing))
    if scene.round_bob:
        other = replace(inputs, normal_sigmas=inputs.normal_sigmas + fraction)
        move(UncertaintySource.CONTACT_NORMAL, replace(scene, inputs=other))
    if inputs.fall is not None and rig.support_height is not None:
        higher = replace(inputs, fall=inputs.fall + fraction * rig.support_height.std)
        move(UncertaintySource.SUPPORT_HEIGHT, replace(scene, inputs=higher))
    if inputs.ball is not None and inputs.ball.mass is not None and rig.ball_mass is not None:
        ball = replace(inputs.ball, mass=inputs.ball.mass + fraction * rig.ball_mass.std)
        move(UncertaintySource.BALL_MASS, replace(scene, inputs=replace(inputs, ball=ball)))
    if scene.calibration is None:
        moved += _moved_views(scene, scale_std, fraction)
    return moved


def _moved_views(
    scene: ClipConditions, scale_std: float, fraction: float
) -> Iterator[tuple[UncertaintySource, _Sides]]:
    """Conditions with another view of a camera that is not calibrated."""
    rolled = replace(scene, roll_rad=fraction * Defaults.CAMERA_ROLL.std)
    yield UncertaintySource.CAMERA_ROLL, (rolled,)
    slant_step = fraction * scene.slant_std_rad
    slants = scene.slant_rad + slant_step, scene.slant_rad - slant_step
    yield UncertaintySource.CAMERA_SLANT, tuple(replace(scene, slant_rad=one) for one in slants)
    if scene.lens is not None:
        usual, longer = scene.lens, math.exp(fraction * LOG_FOCAL_STD)
        lenses = (usual.focal_px * longer, usual.focal_px / longer)
        yield UncertaintySource.LENS_UNKNOWN, tuple(scene.through(focal) for focal in lenses)
    if np.isfinite(scale_std):
        by_ball = scene.metres_per_px is None
        source = UncertaintySource.BALL_DIAMETER if by_ball else UncertaintySource.SCALE
        yield source, (replace(scene, scale=scene.scale * (1 + fraction * scale_std)),)


def _other_pendulums(inputs: Inputs, fraction: float) -> list[tuple[UncertaintySource, Pendulum]]:
    """Pendulums with each property increased by a fraction of its standard uncertainty.

    Mass and centre of mass only affect the stiffness of the swing, which its fit includes.
    """
    body, rig = inputs.pendulum, inputs.rig
    others = [
        (
            UncertaintySource.PENDULUM_INERTIA,
            replace(body, inertia=body.inertia * (1 + fraction * rig.inertia.relative_std)),
        ),
        (
            UncertaintySource.PENDULUM_LENGTH,
            replace(body, length=body.length * (1 + fraction * rig.length.relative_std)),
        ),
    ]
    if rig.effective_mass is not None:
        heavier = replace(
            body, effective_mass=rig.effective_mass.value + fraction * rig.effective_mass.std
        )
        others.append((UncertaintySource.EFFECTIVE_MASS, heavier))
    return others


def merged(
    table: dict[UncertaintySource, FloatArray], index: int, noise: float
) -> tuple[Contribution, ...]:
    """Budget of one value, largest first, from systematic contributions and track noise."""
    lines = [Contribution(UncertaintySource.TRACK_NOISE, noise)]
    lines += [Contribution(name, float(column[index])) for name, column in table.items()]
    kept = [line for line in lines if np.isfinite(line.std) and line.std > 0]
    return tuple(sorted(kept, key=lambda line: -line.std))


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariance of the quantities of a clip.

    Attributes
    ----------
    covariance : (N, N) array
        In their units; the diagonal holds the squares of their std.
    """

    names: tuple[str, ...]
    covariance: FloatArray


def joint_covariance(
    quantities: Sequence[Quantity],
    random: FloatArray,
    systematic: dict[UncertaintySource, FloatArray],
    means: Mapping[str, FloatArray],
) -> JointCovariance:
    """Covariance of quantities that have common sources; others are independent.

    Parameters
    ----------
    random : (Q, Q) array
        Covariance of the derived values from the tracks' noise.
    systematic : dict
        Source to the (Q,) contributions, with their signs.
    means : mapping of str to (Q,) array
        Weights of the derived values in quantities that are means of them.
    """
    known = [item for item in quantities if item.known and item.std is not None]
    derived = list(DERIVED)
    rows = np.zeros((len(known), len(derived)))
    for row, item in zip(rows, known, strict=True):
        if item.name in means:
            row[:] = means[item.name]
        elif item.name in DERIVED:
            row[derived.index(item.name)] = 1.0
    common = np.zeros((len(known), len(known)))
    if random.size:
        common = rows @ np.nan_to_num(random) @ rows.T
        for column in systematic.values():
            term = rows @ np.nan_to_num(column)
            common += np.outer(term, term)
    std = np.array([item.std for item in known], dtype=np.float64)
    # a quantity whose std was widened for another reason correlates less with the others
    seen = np.sqrt(np.maximum(np.diag(common), 0.0))
    scale = np.divide(np.minimum(std, seen), seen, out=np.zeros_like(std), where=seen > 0.0)
    common *= np.outer(scale, scale)
    np.fill_diagonal(common, std**2)
    return JointCovariance(tuple(item.name for item in known), common)
