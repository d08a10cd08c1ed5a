"""Fit of a strike: swing and flight on each side, and the contact (Fig. 13).

Before and after contact the gap between face and ball follows from free swing, rest and flight,
each fitted on its own side only. The gap does not determine how far the face leads the bar; the
ball's motion during the push does: a longer contact rounds the corner between rest and flight.

Also here: the position of the face of the mass, and the contact of two balls or pucks.
"""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum, auto
from functools import cache, lru_cache
from importlib import resources

import numpy as np
from numpy.typing import NDArray

from measuring.flight_fit import (
    MAX_CONTACT_S,
    FlightFit,
    FlightPriors,
    LandingSeen,
    SwingFit,
    fit_flight,
    fit_swing,
    flight_end,
    flight_whitening,
    landing_seen,
)
from measuring.inputs import Inputs
from measuring.metres import (
    ARM_RELATIVE_STD,
    MAX_ESTIMATE_DIFFERENCE,
    MetricTracks,
    arm_along_bar,
    to_length,
)
from measuring.setup.file import Origin
from metrology import MeasurementError, NoFitError, NotFoundError
from physics import bodies
from physics.contact import damping_for_cor
from vision.tracks import FollowedObject, Track, Tracks

__all__ = [
    "NEAR_PLANE_FRACTION",
    "STEEL_DENSITY",
    "ContactFit",
    "Impact",
    "ImpactView",
    "departure",
    "disc_contact",
    "face_speeds",
    "find_impact",
    "fit_contact",
    "gap_after",
    "gap_before",
    "moved_impact",
    "next_strike_time",
    "other_strikes",
    "pivot_in_plane",
    "touch_times",
]

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

_PULSE_SAMPLES = 201
"""Samples of a tabulated pulse (derived: linear interpolation of a half sine is off by (π/200)²/8,
at most 3e-5 of its peak)."""

_PULSE_STEPS = 1000
"""Integration steps of a contact (chosen: the pulse is off by 1e-6 of its peak)."""

_EXPONENT_STEP = 0.15
"""Step between tabulated exponents of the force law (chosen: about `EXPONENT_STD`); pulses are
interpolated linearly."""


@dataclass(frozen=True)
class ContactPulse:
    """A dimensionless contact: time 0 to 1 from onset to release, approach speed × duration = 1.

    Attributes
    ----------
    phase : (P,) array
        Time from onset over the duration of contact.
    compression : (P,) array
        Compression over approach speed × duration.
    path : (P,) array
        Distance the ball has moved over its speed at release × duration.
    """

    phase: FloatArray
    compression: FloatArray
    path: FloatArray


def contact_pulse(exponent: float, cor: float) -> ContactPulse:
    """Pulse of a Hunt–Crossley contact F = k δⁿ (1 + c δ') (Hunt & Crossley 1975).

    Parameters
    ----------
    exponent : float
        n: 1 a linear spring, 1.5 Hertz's law.
    cor : float
        Coefficient of restitution of the pulse.

    Returns
    -------
    ContactPulse
        Interpolated between exponents in steps of 0.15 and to the nearest hundredth of `cor`.
    """
    place = (exponent - 1.0) / _EXPONENT_STEP
    lower = math.floor(place)
    fraction = place - lower
    one = _solved(lower, round(cor, 2))
    other = _solved(lower + 1, round(cor, 2))
    return ContactPulse(
        one.phase,
        (1.0 - fraction) * one.compression + fraction * other.compression,
        (1.0 - fraction) * one.path + fraction * other.path,
    )


@lru_cache(maxsize=256)
def _solved(step: int, cor: float) -> ContactPulse:
    """Pulse from the first integral of the law: δⁿ⁺¹ / (n + 1) = ∫ u / (1 + d u) du from v to 1."""
    power = 2.0 + step * _EXPONENT_STEP
    damping = _damping(cor)
    # substituted speeds: they fall as x^power at both ends, so that compression grows as x there
    ends = np.linspace(0.0, 1.0, _PULSE_STEPS + 1)
    middles = 0.5 * (ends[1:] + ends[:-1])
    rate, _ = _eased(ends, power, cor)
    compression = _compressed(rate, damping, power)
    between, slope = _eased(middles, power, cor)
    force = _compressed(between, damping, power) ** (power - 1.0) * (1.0 + damping * between)
    time = np.concatenate([[0.0], np.cumsum(slope / force) / _PULSE_STEPS])
    phase = np.linspace(0.0, 1.0, _PULSE_SAMPLES)
    speed = 1.0 - np.interp(phase, time / time[-1], rate)
    travel = np.cumsum(0.5 * (speed[1:] + speed[:-1])) * (phase[1] - phase[0])
    return ContactPulse(
        phase,
        np.interp(phase, time / time[-1], compression) / time[-1],
        np.concatenate([[0.0], travel]) / speed[-1],
    )


@lru_cache(maxsize=128)
def _damping(cor: float) -> float:
    """Damping for one coefficient of restitution, of any exponent."""
    return float(damping_for_cor(cor))


def _eased(x: FloatArray, power: float, cor: float) -> tuple[FloatArray, FloatArray]:
    """Speed from 1 to -cor over x from 0 to 1, flat as x^power at both ends, and its slope."""
    begun, left = x**power, (1.0 - x) ** power
    whole = begun + left
    slope = power * (x * (1.0 - x)) ** (power - 1.0) / whole**2
    return 1.0 - (1.0 + cor) * begun / whole, (1.0 + cor) * slope


def _compressed(rate: FloatArray, damping: float, power: float) -> FloatArray:
    """Compression at which the speed has fallen from 1 to `rate`."""
    if damping == 0.0:
        energy = 0.5 * (1.0 - rate**2)
    else:
        lost = np.log1p(damping * (1.0 - rate) / (1.0 + damping * rate))
        energy = ((1.0 - rate) - lost / damping) / damping
    return np.asarray(np.maximum(power * energy, 0.0) ** (1.0 / power))


# Inflated balls: between a linear spring and Hertz's 3/2 (Cross, Am. J. Phys. 67, 222, 1999).
EXPONENT, EXPONENT_STD = 1.3, 0.12

OUTLINE_AHEAD, OUTLINE_AHEAD_STD = 0.05, 0.06
"""Fraction of the compression by which the centre of the fitted outline leads the ball's centre.

Derived bounds: the rear of the outline moves in by the whole compression, the front does not, so a
circle through all of it leads by up to 0.5, one without the rear by 0; robust fits drop most of
it."""

# Deviation of the ball's path from the pulse, over speed gained × Δt (chosen).
PULSE_SHAPE_STD = 0.003

_SEARCH_S = 0.06
"""s on each side of a time near the contact in which the two meet (derived: longest contact)."""

_FINE_TIMES = 32
"""Onsets and releases of the fine grid (derived: eight to a standard uncertainty)."""

_CONTACT_REFINEMENTS = 2
"""Finer grids (derived: each is finer by eight, and half a frame over 64 is below any std)."""

_NEGLIGIBLE = 20.0
"""Cost above the least at which a contact has no weight (derived: probability of 5e-5)."""

_TICK_S = 1e-5
"""s over which a gap's speed is taken (derived: short against any contact)."""

_EXPONENTS = np.linspace(1.1, 1.5, 4)
"""Exponents of the force law in the grid (chosen: `EXPONENT` ± 1.7 `EXPONENT_STD`)."""

_ROBUST_FROM = 2.0

_CROSSING_SAMPLES = 6
"""Samples around a zero crossing for a cubic (chosen: 1.5 times its unknowns)."""

BOUND_RELATIVE_STD = 0.05
"""Relative std of the upper bound of contact times (chosen; damping adds some per cent)."""

_IMPOSSIBLE = 0.0027
"""Probability of the seen face below which no contact of the ball is possible (convention: 3
sigma)."""

_MIN_TRAVEL_M = 1e-6
"""m, least travel until release (numerical)."""

_MIN_CONTACT_S = 1e-4
"""s, minimum duration of a fitted contact (steel on steel; a pulse needs a length)."""

COR_DIFFERENCE_STD = 0.05
"""Dimensionless, std between the COR from speeds and that of a head-on contact (assumed; friction
and spin take part of an oblique impact)."""


@dataclass(frozen=True)
class FaceHypothesis:
    """A hypothesis for the lead of the face over the line from pivot to mass.

    Attributes
    ----------
    lead, std : float
        m.
    fraction : float
        Prior probability of the hypothesis.
    """

    lead: float
    std: float
    fraction: float = 1.0

    def density(self, lead: FloatArray) -> FloatArray:
        """Prior density at leads, 1/m."""
        off = (lead - self.lead) / self.std
        return np.asarray(
            self.fraction * np.exp(-0.5 * off**2) / (self.std * math.sqrt(2.0 * math.pi))
        )

    def blurred(self, resolution: float) -> "FaceHypothesis":
        """The same seen through a grid whose points are `resolution` apart, m."""
        return replace(self, std=math.hypot(self.std, 0.5 * resolution))


@cache
def face_prior() -> dict[str, dict[str, float]]:
    """Where the face is beside where it was seen, ball radii, and how long balls stay in contact.

    Fitted by `training.fit_contact`.
    """
    text = resources.files("measuring").joinpath("face_prior.json").read_text("utf-8")
    return {
        part: {name: fitted["value"] for name, fitted in values.items()}
        for part, values in json.loads(text).items()
        if isinstance(values, dict)
    }


class FaceEvidence(Enum):
    """Evidence for the face: observation only, combined with the impact angle, or alternatives."""

    OBSERVED = auto()
    COMBINED = auto()
    ALTERNATIVES = auto()


@dataclass(frozen=True)
class ImpactView:
    """Data and fits on both sides of the contact, in the ball plane, x along the flight, SI.

    Attributes
    ----------
    before, after : SwingFit
        The free swing on each side.
    flight : FlightFit
        The flight after release.
    rest, rest_std : (2,) arrays
        Ball's centre at rest.
    pivot : (2,) array
        Pivot of the pendulum.
    radius : float
        Ball's radius.
    time_s, position_m, std_m : (M,), (M, 2), (M,) arrays
        Observed centre of the ball's outline in the frames around contact, and its std along the
        flight.
    face_offset, face_offset_std : float
        Lead of the face over the line from pivot to mass.
    longest_s : float
        Upper bound of the contact time, s: a softer ball would be flat under its own weight.
    bob_arm : float or None
        Pivot to the centre of a round bob; None where the mass has a flat face.
    face_alternatives : tuple of FaceHypothesis
        Alternative hypotheses; empty if the evidence agrees.
    face_evidence : FaceEvidence
        Which evidence was used.
    """

    before: SwingFit
    after: SwingFit
    flight: FlightFit
    rest: FloatArray
    rest_std: FloatArray
    pivot: FloatArray
    radius: float
    time_s: FloatArray
    position_m: FloatArray
    std_m: FloatArray
    face_offset: float
    face_offset_std: float
    longest_s: float = math.inf
    bob_arm: float | None = None
    face_alternatives: tuple[FaceHypothesis, ...] = ()
    face_evidence: FaceEvidence = FaceEvidence.COMBINED


@dataclass(frozen=True)
class ContactFit:
    """The contact.

    Attributes
    ----------
    onset_s, release_s : float
        First and last touch, s from the first frame.
    face : (2,) array
        Fitted offset of the face at onset and at release, m.
    face_covariance : (2, 2) array
        m².
    exponent : float
        Exponent of the contact law that the fit preferred.
    residuals : (M,) array
        Standardised residuals of the ball's path through the contact.
    """

    onset_s: float
    release_s: float
    face: FloatArray
    face_covariance: FloatArray
    exponent: float
    residuals: FloatArray


def gap_before(view: ImpactView, time_s: FloatArray) -> FloatArray:
    """Distance from the bar's line to the surface of the ball at rest, along the face normal, m."""
    phi = view.before.angles(time_s)
    return _distance_along_normal(view.rest - view.pivot, phi) - view.radius


def gap_after(view: ImpactView, time_s: FloatArray) -> FloatArray:
    """The same to the ball in flight, m."""
    phi = view.after.angles(time_s)
    return _distance_along_normal(view.flight.states(time_s)[:, :2] - view.pivot, phi) - view.radius


def _distance_along_normal(arm: FloatArray, phi: FloatArray) -> FloatArray:
    normal = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    return np.asarray((arm * normal).sum(axis=-1))


def fit_contact(view: ImpactView, around_s: float, *, check_bound: bool = True) -> ContactFit:
    """Fit onset and release.

    Parameters
    ----------
    view : ImpactView
        Both sides of the contact.
    around_s : float
        A time near the contact, s.
    check_bound : bool
        Whether contacts longer than the ball allows are refused; False when inputs are moved off
        their best estimate to propagate uncertainty.

    Raises
    ------
    NotFoundError
        If face and ball never meet or separate, or if the contact lasts too long for the ball.
    NoFitError
        If they separate before they meet: one of the two paths is wrong.
    """
    whitening = flight_whitening(view.time_s)
    fine = _every_contact(view, around_s)
    prior = _prior(view, fine)
    if not np.isfinite(prior).any():
        raise _no_contact(math.nan, view)
    if check_bound:
        _require_possible(view, fine, prior, around_s)
    fine = fine.at(prior < prior.min() + _NEGLIGIBLE)
    for _ in range(_CONTACT_REFINEMENTS):
        finer = _every_contact(view, around_s, fine.at(_posterior(view, whitening, fine).likely))
        if not np.isfinite(_prior(view, finer)).any():
            break
        fine = finer
    found = _posterior(view, whitening, fine)
    face, covariance = _mean_and_covariance(found.cost + found.beyond, fine.face)
    # the shift by the bound is unexplained, so it counts as uncertainty
    unbound, _ = _mean_and_covariance(found.cost, fine.face)
    covariance += np.outer(unbound - face, unbound - face)
    onset, release = touch_times(view, face, around_s)
    best = int(np.argmin(found.cost + found.beyond))
    if not np.isfinite([onset, release]).all():
        onset, release = float(fine.onset_s[best]), float(fine.release_s[best])
    exponent, left = float(found.fit.exponent[best]), found.fit.left[:, best]
    return ContactFit(onset, release, face, covariance, exponent, left)


@dataclass(frozen=True)
class _Contacts:
    """Contacts to try, on an even grid of onset and release (N,), s.

    They imply the motion at both ends, and the offset of the face there (N, 2), m. Neighbours are
    `step_s` apart, by which the face moves by `resolution` (2,), m.
    """

    onset_s: FloatArray
    release_s: FloatArray
    ends: "_Ends"
    face: FloatArray
    log_speeds: FloatArray
    step_s: tuple[float, float]
    resolution: FloatArray

    @classmethod
    def of(cls, view: ImpactView, sides: list[FloatArray]) -> "_Contacts":
        """Those whose impulse can have moved the ball from rest to its flight.

        At their onset the gap closes, at their release it opens. Both are taken from even `sides`.
        """
        pairs = np.nonzero(sides[1] - sides[0][:, np.newaxis] >= _MIN_CONTACT_S)
        ends = _Ends.of(view, sides, pairs)
        possible = (ends.implied_cor > -0.5) & (ends.implied_cor < 1.5)
        ends, pairs = ends.at(possible), (pairs[0][possible], pairs[1][possible])
        face, speeds = np.empty((2, 2, len(pairs[0])))
        for side, gap in enumerate((gap_before, gap_after)):
            there = gap(view, sides[side])
            face[side] = there[pairs[side]]
            speeds[side] = ((gap(view, sides[side] + _TICK_S) - there) / _TICK_S)[pairs[side]]
        meet = (speeds[0] < 0.0) & (speeds[1] > 0.0)
        usual = np.abs(np.median(speeds, axis=1)) if len(meet) else np.zeros(2)
        weight = np.log(np.abs(np.where(meet, speeds, 1.0))).sum(axis=0)
        onset, release = (side[pair] for side, pair in zip(sides, pairs, strict=True))
        step_s = (float(sides[0][1] - sides[0][0]), float(sides[1][1] - sides[1][0]))
        resolution = usual * np.array(step_s)
        return cls(onset, release, ends, face.T, weight, step_s, resolution).at(meet)

    def at(self, chosen: BoolArray) -> "_Contacts":
        return replace(
            self,
            onset_s=self.onset_s[chosen],
            release_s=self.release_s[chosen],
            ends=self.ends.at(chosen),
            face=self.face[chosen],
            log_speeds=self.log_speeds[chosen],
        )


def _every_contact(view: ImpactView, around_s: float, within: _Contacts | None = None) -> _Contacts:
    """Contacts on an even grid; `within` narrows it to the times of its contacts."""
    half_frame_s = 0.5 * float(np.median(np.diff(view.flight.time_s)))
    if within is None or len(within.onset_s) == 0:
        times = np.arange(-_SEARCH_S, _SEARCH_S, half_frame_s) + around_s
        sides = [times, times]
    else:
        near = zip((within.onset_s, within.release_s), within.step_s, strict=True)
        sides = [np.linspace(at.min() - step, at.max() + step, _FINE_TIMES) for at, step in near]
    return _Contacts.of(view, sides)


def _prior(view: ImpactView, tried: _Contacts) -> FloatArray:
    """Twice the negative log prior density of contacts, without a constant, (N,).

    What is narrower than the grid is widened to it, so that it is not missed between two contacts.
    """
    left_over = 1.0 - sum(one.fraction for one in view.face_alternatives)
    seen = FaceHypothesis(view.face_offset, view.face_offset_std, left_over)
    at_onset = sum(
        one.blurred(tried.resolution[0]).density(tried.face[:, 0])
        for one in (seen, *view.face_alternatives)
    )
    moved = tried.face[:, 1] - tried.face[:, 0]
    track = face_prior()["parting"]
    parting = sum(
        FaceHypothesis(0.0, track[f"{name}_std_radii"] * view.radius, fraction)
        .blurred(float(np.hypot(*tried.resolution)))
        .density(moved)
        for name, fraction in (
            ("holding", 1.0 - track["fraction"]),
            ("slipping", track["fraction"]),
        )
    )
    with np.errstate(divide="ignore"):
        return np.asarray(-2.0 * (np.log(at_onset) + np.log(parting) + tried.log_speeds))


def _require_possible(
    view: ImpactView, tried: _Contacts, prior: FloatArray, around_s: float
) -> None:
    """Refuse a face that was not seen where any contact of the ball would need it."""
    lasting = tried.release_s - tried.onset_s
    cost = prior + _bound_penalty(lasting, view)
    probability = float(np.exp(-0.5 * cost).sum()) * math.prod(tried.step_s)
    if probability > _IMPOSSIBLE:
        return
    onset, release = touch_times(view, view.face_offset, around_s)
    raise _no_contact(release - onset, view)


@dataclass(frozen=True)
class _Posterior:
    """Costs of contacts (N,), that of the bound aside, and their fits."""

    fit: "_Candidates"
    cost: FloatArray
    beyond: FloatArray

    @property
    def likely(self) -> BoolArray:
        total = self.cost + self.beyond
        return np.asarray(total < total.min() + _NEGLIGIBLE)


def _posterior(view: ImpactView, whitening: "_Whitening", tried: _Contacts) -> _Posterior:
    fit = _candidates(view, whitening, tried.ends)
    beyond = _bound_penalty(tried.release_s - tried.onset_s, view)
    prior = _prior(view, tried) + _duration_prior(tried.release_s - tried.onset_s)
    left = fit.left[:, int(np.argmin(fit.cost(1.0) + prior + beyond))]
    widened = max(1.0, float(np.mean(np.minimum(left**2, 9.0))))
    return _Posterior(fit, fit.cost(widened) + prior, beyond)


def _duration_prior(lasting_s: FloatArray) -> FloatArray:
    """Twice the negative log prior density of contact times, without a constant, (N,)."""
    usual, log_s = face_prior()["log_duration"], np.log(lasting_s)
    off = (log_s - usual["centre"]) / usual["half_width"]
    return np.asarray(2.0 * (log_s + np.log1p(off**2)))


def _mean_and_covariance(cost: FloatArray, face: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (2,) and covariance (2, 2) of the face offsets for given costs (-2 log posterior)."""
    fraction = np.exp(-0.5 * (cost - cost.min()))
    fraction /= fraction.sum()
    mean = fraction @ face
    off = face - mean
    return mean, np.einsum("n,ni,nj->ij", fraction, off, off)


def _bound_penalty(lasting_s: FloatArray, view: ImpactView) -> FloatArray:
    """Penalty of contacts longer than the ball allows."""
    over = np.maximum(lasting_s / view.longest_s - 1.0, 0.0) / BOUND_RELATIVE_STD
    return np.asarray(over**2)


def _no_contact(lasting_s: float, view: ImpactView) -> MeasurementError:
    lasts = 1e3 * lasting_s
    if math.isnan(lasts):
        return NotFoundError(
            "the paths of the mass and the ball never meet",
            hint="Check --ball-at and --mass-at, or film square to the plane of the swing.",
        )
    if lasts < 0.0:
        return NoFitError(
            f"the mass separates from the ball {-lasts:.0f} ms before it meets it: wrong objects "
            "were tracked",
            hint="Point at the ball with --ball-at X,Y and at the mass with --mass-at X,Y.",
        )
    return NotFoundError(
        f"the contact would last {lasts:.0f} ms, but a ball that is round at rest stays in contact "
        f"for at most {1e3 * view.longest_s:.0f} ms: the striker was not the object tracked, or "
        "the capture rate is wrong",
        hint="Point at the mass with --mass-at X,Y, and check --fps and --ball.",
    )


_Whitening = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class _Candidates:
    """Fits of contacts to the paths of ball and mass.

    Attributes
    ----------
    exponent : (N,) array
        The most probable.
    left : (R, N) array
        Whitened residuals.
    priors : (N,) array
        Prior cost of the exponent.
    """

    exponent: FloatArray
    left: FloatArray
    priors: FloatArray

    def cost(self, widened: float) -> FloatArray:
        """Robust sums of squares, residuals over the root of `widened`, and the priors, (M,)."""
        return _robust(self.left) / widened + self.priors


def _robust(left: FloatArray) -> FloatArray:
    """Sum of squared residuals (R, ...), linear beyond 2 standard deviations."""
    soft = _ROBUST_FROM**2 * 2.0 * (np.sqrt(1.0 + left**2 / _ROBUST_FROM**2) - 1.0)
    return np.asarray(soft.sum(axis=0))


def _candidates(view: ImpactView, whitening: _Whitening, ends: "_Ends") -> _Candidates:
    """Best exponent for each contact, with the outline lag solved for."""
    left, per_lag, lag_std = _path_residuals(view, whitening, ends)
    left = left - OUTLINE_AHEAD * per_lag
    lag = (per_lag * left).sum(axis=0) / ((per_lag**2).sum(axis=0) + lag_std**-2)
    left = np.concatenate([left - lag * per_lag, (lag / lag_std)[np.newaxis]])
    priors = np.broadcast_to(((_EXPONENTS - EXPONENT) / EXPONENT_STD) ** 2, lag.shape)
    best = np.argmin(_robust(left) + priors, axis=1)
    every = np.arange(len(best))
    return _Candidates(_EXPONENTS[best], left[:, every, best], priors[every, best])


def touch_times(view: ImpactView, face: float | FloatArray, around_s: float) -> tuple[float, float]:
    """Onset and release for a face's offset, (2,) at onset and release or one for both, s.

    NaN if they never meet. For a contact too short for the frame rate release may come before
    onset.
    """
    time = around_s + np.linspace(-_SEARCH_S, _SEARCH_S, 121)
    at_onset, at_release = np.broadcast_to(face, 2)
    onset = _crossings(time, (gap_before(view, time) - at_onset)[np.newaxis])
    release = _crossings(time, (at_release - gap_after(view, time))[np.newaxis])
    return float(onset[0]), float(release[0])


def face_speeds(view: ImpactView, onset: float, release: float) -> tuple[float, float]:
    """Approach speed at onset and separation speed at release, normal to the face, m/s (Eq. 2)."""
    approach, parting = _face_speeds(view, np.array([onset]), np.array([release]))
    return float(approach[0]), float(parting[0])


def _face_speeds(
    view: ImpactView, onset: FloatArray, release: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Approach speeds at onsets and separation speeds at releases, s."""
    phi, omega = view.before.states(onset)
    approach = omega * arm_along_bar(view.rest - view.pivot, phi)
    phi, omega = view.after.states(release)
    state = view.flight.states(release)
    normal = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    arm = np.moveaxis(state[:, :2] - view.pivot, -1, 0)
    parting = (state[:, 2:] * normal).sum(axis=-1) - omega * arm_along_bar(arm, phi)
    return approach, parting


def _crossings(time_s: FloatArray, gap: FloatArray) -> FloatArray:
    """First downward zero crossing of gaps (L, T), from a local cubic, s; NaN if there is none."""
    falls = (gap[:, :-1] > 0) & (gap[:, 1:] <= 0)
    rows = np.flatnonzero(falls.any(axis=1))
    first = np.clip(np.argmax(falls[rows], axis=1) - 2, 0, len(time_s) - _CROSSING_SAMPLES)
    near = first[:, np.newaxis] + np.arange(_CROSSING_SAMPLES)
    gaps, times = gap[rows[:, np.newaxis], near], time_s[near]
    # time as a cubic of the scaled gap
    scaled = gaps / np.abs(gaps).max(axis=1, keepdims=True)
    solved = np.linalg.pinv(scaled[..., np.newaxis] ** np.arange(4))[:, 0]
    found = np.full(len(gap), math.nan)
    found[rows] = times[:, 0] + (solved * (times - times[:, :1])).sum(axis=1)
    return found


@dataclass(frozen=True)
class _Ends:
    """Motion at both ends of contacts, one per offset: arrays (L,), the normals (L, 2)."""

    onset_s: FloatArray
    duration: FloatArray
    normal: FloatArray
    speed: FloatArray
    implied_cor: FloatArray
    cor: FloatArray
    approach: FloatArray
    by_speeds: FloatArray

    @classmethod
    def of(cls, view: ImpactView, sides: list[FloatArray], pairs: tuple[IntArray, ...]) -> "_Ends":
        """Of contacts whose onset and release are `pairs` of times."""
        (onsets, releases), (first, last) = sides, pairs
        onset = onsets[first]
        duration = releases[last] - onset
        state = view.flight.states(releases)
        # the push turns the ball's way by less than its own noise turns a way of millimetres
        speed = np.hypot(*state[:, 2:].T)
        normal = state[:, 2:] / speed[:, np.newaxis]
        travel = np.maximum(((state[:, :2] - view.rest) * normal).sum(axis=-1), _MIN_TRAVEL_M)
        approach, parting = _face_speeds(view, onsets, releases)
        normal, speed, travel, parting = (one[last] for one in (normal, speed, travel, parting))
        approach = approach[first]
        # the centroid of the impulse puts the path length at release at v Δt / (1 + e)
        cor = speed * duration / travel - 1.0
        by_speeds = (parting / approach - cor) / COR_DIFFERENCE_STD
        return cls(
            onset,
            duration,
            normal,
            speed,
            cor,
            np.clip(cor, 0.2, 0.999),
            approach,
            by_speeds,
        )

    def at(self, chosen: BoolArray) -> "_Ends":
        return _Ends(*(getattr(self, one.name)[chosen] for one in fields(self)))


def _path_residuals(
    view: ImpactView, whitening: _Whitening, ends: _Ends
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Whitened residuals of ball and COR, their change per unit of outline lag, and its std.

    The first two (R, L, E) for L contacts and E exponents, the last (L, E).
    """
    pulses = _Pulses.of(ends.cor)
    duration = ends.duration[:, np.newaxis]
    phase = (view.time_s[:, np.newaxis] - ends.onset_s) / ends.duration
    path = duration * pulses.path_length(phase)
    lagging = pulses.at(phase, pulses.compression) * (ends.approach * ends.duration)[:, np.newaxis]
    moved = (view.position_m - view.rest) @ ends.normal.T
    std = np.hypot(view.std_m[:, np.newaxis], PULSE_SHAPE_STD * ends.speed * ends.duration)
    off = (moved[..., np.newaxis] - path * ends.speed[:, np.newaxis]) / std[..., np.newaxis]
    speeds = np.broadcast_to(ends.by_speeds[:, np.newaxis], (1, *path.shape[1:]))
    left = np.concatenate([whitening(off), speeds])
    per_lag = np.zeros_like(left)
    per_lag[:-1] = whitening(lagging / std[..., np.newaxis])
    # the mass beside the ball moves its outline, too, while they touch
    usual = float(np.median(view.std_m)) if len(view.std_m) else 0.0
    usual *= face_prior()["beside_mass"]["over_std"]
    beside = usual / np.maximum(lagging.max(axis=0, initial=0.0), 1e-9)
    return left, per_lag, np.hypot(OUTLINE_AHEAD_STD, beside)


@dataclass(frozen=True)
class _Pulses:
    """Compression and path on an even grid of phases.

    Tables (U, P, E) for U coefficients of restitution and E exponents; `which` of the U each of L
    contacts has (L,).
    """

    compression: FloatArray
    path: FloatArray
    which: NDArray[np.int64]

    @classmethod
    def of(cls, cor: FloatArray) -> "_Pulses":
        values, which = np.unique(np.round(cor, 2), return_inverse=True)
        every = [_pulses_of(one) for one in values.tolist()]
        compression, path = (np.stack(columns) for columns in zip(*every, strict=True))
        return cls(compression, path, which)

    def at(self, phase: FloatArray, table: FloatArray) -> FloatArray:
        """Table interpolated at phases (N, L) of each contact, (N, L, E)."""
        last = table.shape[1] - 1
        place = np.clip(phase, 0.0, 1.0) * last
        below = np.minimum(place.astype(np.int64), last - 1)
        part = (place - below)[..., np.newaxis]
        lower, upper = table[self.which, below], table[self.which, below + 1]
        return np.asarray(lower * (1.0 - part) + upper * part)

    def path_length(self, phase: FloatArray) -> FloatArray:
        """Path length at phases (N, L), over speed at release × duration, (N, L, E)."""
        beyond = np.maximum(phase - 1.0, 0.0)
        return self.at(phase, self.path) + beyond[..., np.newaxis]


@lru_cache(maxsize=128)
def _pulses_of(cor: float) -> tuple[FloatArray, FloatArray]:
    """Compression and path (P, E) for one coefficient of restitution."""
    pulses = [contact_pulse(float(exponent), cor) for exponent in _EXPONENTS]
    compression, path = ([getattr(one, name) for one in pulses] for name in ("compression", "path"))
    return np.stack(compression, axis=-1), np.stack(path, axis=-1)


UNKNOWN_SLANT = 0.25
"""Slope of the line of sight from a camera of unknown position (assumed)."""

STEEL_DENSITY, THICKNESS_RELATIVE_STD = 7850.0, 0.3
"""kg/m³, density of steel; relative std of the thickness of a mass against a steel cube of the same
mass (chosen)."""

THICKNESSES = (0.4, 2.0)
"""Range of the thickness of a mass over that of such a cube (chosen)."""

_SIGNIFICANT_SLANT = 3.0
"""Standard uncertainties at which the slope of the line of sight is significant (convention)."""

NEAR_PLANE_FRACTION = 1.0 / 3.0
"""Fraction of half the thickness by which the tracked plane is in front of the mass's middle.

Derived: of three visible upright edges of an oblique block two are on its near side, one on its far
side. Speeds before the strike are unbiased over clips of two renderers; 0.6 biases them by -0.5 %.
"""

STRUCK_OFF_CENTRE_M = 0.002
"""m, std of the point of impact from the middle of the face, set up by eye and ruler (assumed)."""

MAX_OUTLINE_EXCESS = 0.02
"""Of the ball's radius: maximum effect of a transfer curve on outlines of 8 px and more (chosen);
more has another cause."""

OUTLINE_EXCESS_RELATIVE_STD = 0.5
"""Relative std of the outline's excess: ball and mass differ in contrast (chosen)."""

IMPACT_ANGLE_STD = np.radians(0.4)
"""rad, std of the bar's angle at contact if the face is not seen (assumed: a bubble level has 0.3°,
and the bar moves during contact)."""

_MAX_ARM_DIFFERENCE = 0.1
"""Relative difference of arm lengths beyond which it is another apparatus (chosen; in path-traced
scenes the rms error of the arm is 0.05 where the ball gives the scale)."""

PIVOT_STD_FRACTION = 0.15
"""Std of the pivot over half the thickness of the mass (chosen): the swing turns its sides to the
camera, which moves the centre of the arc."""


def pivot_in_plane(tracks: MetricTracks, inputs: Inputs) -> FloatArray:
    """Pivot in the ball plane; the tracked arc is nearer to the camera by part of the thickness.

    Parameters
    ----------
    tracks : MetricTracks
        With a pendulum.
    inputs : Inputs
        Properties of the pendulum.

    Returns
    -------
    (2,) array
        m.
    """
    assert tracks.pivot_m is not None
    if tracks.eye_m is None or tracks.spherical:
        return tracks.pivot_m
    half = _half_thickness(inputs)
    significant = abs(tracks.face_slant or 0.0) > _SIGNIFICANT_SLANT * tracks.face_slant_std
    if significant and _face_visible(tracks, inputs):
        half = (tracks.edge_offset_m - tracks.middle_offset_m) / abs(tracks.face_slant or 1.0)
    nearer = NEAR_PLANE_FRACTION * half / float(tracks.eye_m[2])
    foot = tracks.eye_m[:2]
    return np.asarray(foot + (tracks.pivot_m - foot) / (1.0 + nearer))


def offset_of_face(
    tracks: MetricTracks,
    inputs: Inputs,
    radius: float,
    onset: float,
    evidence: FaceEvidence | None = None,
) -> tuple[FaceEvidence, tuple[FaceHypothesis, ...]]:
    """Hypotheses for the face offset before the contact fit: observed, and from the impact angle.

    Parameters
    ----------
    tracks : MetricTracks
        With a pendulum.
    inputs : Inputs
        Properties of pendulum and ball.
    radius : float
        Of the ball, m.
    onset : float
        Approximate onset of contact, s.
    evidence : FaceEvidence, optional
        Evidence to use, if already decided.

    Returns
    -------
    evidence : FaceEvidence
    hypotheses : tuple of FaceHypothesis
        The combined estimate, or the alternatives and the hypothesis of another part.
    """
    assert tracks.pivot_m is not None
    pivot = pivot_in_plane(tracks, inputs)
    arm = tracks.rest_m - pivot
    seen, seen_std = _seen_offset(tracks, inputs)
    phi = float(np.interp(onset, tracks.swing_time_s, tracks.swing_rad))
    seen += float((tracks.pivot_m - pivot) @ [np.cos(phi), np.sin(phi)])
    angle = inputs.rig.launch_angle
    other_part = _other_part(seen, seen_std, radius)
    if angle is None:
        return FaceEvidence.OBSERVED, (
            FaceHypothesis(seen, seen_std, 1.0 - other_part.fraction),
            other_part,
        )
    cosine, sine = math.cos(angle.value), math.sin(angle.value)
    from_angle = float(arm[0] * cosine + arm[1] * sine) - radius
    pivot_std = PIVOT_STD_FRACTION * _half_thickness(inputs)
    from_angle_std = math.hypot(IMPACT_ANGLE_STD * float(np.hypot(*arm)), pivot_std)
    if evidence is None:
        evidence = FaceEvidence.COMBINED
        if angle.value_from is Origin.PRESET and not _arm_as_presets(arm, phi):
            evidence = FaceEvidence.OBSERVED
        elif abs(seen - from_angle) > MAX_ESTIMATE_DIFFERENCE * math.hypot(
            seen_std, from_angle_std
        ):
            evidence = FaceEvidence.ALTERNATIVES
    if evidence is FaceEvidence.OBSERVED:
        return evidence, (FaceHypothesis(seen, seen_std, 1.0 - other_part.fraction), other_part)
    if evidence is FaceEvidence.ALTERNATIVES:
        fraction = 0.5 * (1.0 - other_part.fraction)
        by_eye, by_hand = (
            FaceHypothesis(seen, seen_std, fraction),
            FaceHypothesis(from_angle, from_angle_std, fraction),
        )
        return evidence, (by_eye, by_hand, other_part)
    weights = np.array([seen_std, from_angle_std]) ** -2.0
    lead = float(weights @ [seen, from_angle] / weights.sum())
    return evidence, (FaceHypothesis(lead, float(weights.sum() ** -0.5)),)


def _other_part(seen: float, seen_std: float, radius: float) -> FaceHypothesis:
    """Hypothesis that the observed face is another part of the mass."""
    prior = face_prior()["other_part"]
    std = math.hypot(seen_std, prior["std_radii"] * radius)
    return FaceHypothesis(seen, std, prior["fraction"])


def _arm_as_presets(arm: FloatArray, phi: float) -> bool:
    """Whether an arm (2,), m, fits the apparatus of the presets' impact angles."""
    usual = bodies.PAPER_PENDULUM.length
    return abs(float(arm_along_bar(arm, phi)) - usual) < _MAX_ARM_DIFFERENCE * usual


def _seen_offset(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """Offset of the face's middle, from its rims or its foremost edge, m, and its std."""
    if _face_visible(tracks, inputs) and not tracks.spherical:
        return tracks.middle_offset_m, float(
            np.hypot(tracks.middle_offset_std_m, _depth_shift(tracks))
        )
    excess, excess_std = _outline_excess(tracks, inputs)
    seen, seen_std = (
        tracks.edge_offset_m - excess,
        float(np.hypot(tracks.edge_offset_std_m, excess_std)),
    )
    if tracks.spherical:
        # the line of sight to a sphere's edge is tangent off the plane of its middle
        return seen / math.hypot(1.0, tracks.face_slant or 0.0), seen_std
    ahead, ahead_std = _edge_before_face(tracks, inputs)
    return seen - ahead, float(np.hypot(seen_std, ahead_std))


def _outline_excess(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """Excess of outlines over the true edge, m, and its std.

    The half-intensity contour of a blurred edge depends on the camera's unknown transfer curve and
    sharpening, which shift every edge of a dark object in front of a bright wall equally. The ball
    of known size shows by how much; between two rims of one face it cancels.
    """
    if inputs.ball is None or not tracks.scaled_by_wall:
        return 0.0, 0.0
    excess = tracks.radius_m - 0.5 * inputs.ball.diameter
    if abs(excess) > MAX_OUTLINE_EXCESS * tracks.radius_m:
        return 0.0, MAX_OUTLINE_EXCESS * tracks.radius_m
    return excess, OUTLINE_EXCESS_RELATIVE_STD * abs(excess)


def _face_visible(tracks: MetricTracks, inputs: Inputs) -> bool:
    """Whether the observed strip is as wide as the face can appear from there."""
    if not np.isfinite(tracks.middle_offset_std_m):
        return False
    if tracks.face_slant is None:
        low, high = 0.0, UNKNOWN_SLANT
    else:
        std = tracks.face_slant_std
        low, high = -tracks.face_slant - std, -tracks.face_slant + std
    strip = (tracks.edge_offset_m - tracks.middle_offset_m) / _half_thickness(inputs)
    return THICKNESSES[0] * low < strip < THICKNESSES[1] * high


def _depth_shift(tracks: MetricTracks) -> float:
    """Shift from a ball not struck in the middle of the face's depth, m."""
    return STRUCK_OFF_CENTRE_M * abs(tracks.face_slant or UNKNOWN_SLANT)


def _edge_before_face(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """Lead of the foremost visible edge over the middle of the face, m, and its uncertainty.

    From a camera off to one side, the near or far edge of a thick mass leads the contact point.
    """
    half = _half_thickness(inputs)
    if tracks.face_slant is None:
        return 0.0, UNKNOWN_SLANT * half
    ahead = abs(tracks.face_slant) * half
    return ahead, half * float(
        np.hypot(THICKNESS_RELATIVE_STD * tracks.face_slant, tracks.face_slant_std)
    )


def _half_thickness(inputs: Inputs) -> float:
    """Half the thickness of a steel cube of the pendulum's mass, m."""
    return float(0.5 * (inputs.pendulum.mass / STEEL_DENSITY) ** (1.0 / 3.0))


UNSEEN_HALF_CONTACT_S, UNSEEN_HALF_CONTACT_STD_S = 0.006, 0.003
"""s, middle to end of an unseen contact and its std (inflated balls: 10 to 20 ms)."""

SWING_STRETCH_S = 0.08
"""s of swing on each side (chosen: 1/20 of the paper's period of 1.5 s, over which damping and
friction are negligible)."""

NEAR_BEFORE_S, NEAR_AFTER_S = 0.01, 0.005
"""s before onset and after release whose frames enter the contact fit (chosen)."""

_SELECTION_ROUNDS = 3
"""Rounds of selecting frames and fitting (assumed to converge: the next round hardly moves onset
and release)."""

MIN_DEPARTURE_RADII = 0.5
"""Radii from rest at which the ball has surely left (chosen); nearer, shadows imitate motion."""

MAX_RESIDUAL_RADII = 0.15
"""Radii, maximum median residual of a free flight (chosen); more is not a ball in flight."""

MAX_PLACEMENT_RADII, MAX_LOG_RADIUS_DIFFERENCE, MIN_FRAMES_PLACED = 0.3, 0.15, 3
"""Radii within which a ball is put back, log ratio of radii of the same ball, and frames whose
chance agreement is negligible (assumed)."""

MIN_FRAMES_AT_REST = 5
"""Frames at rest that distinguish a ball put back from a bounce passing by (chosen)."""

MAX_SAG_FRACTION = 0.01
"""Of the diameter, by which a ball at rest is flattened by its weight (derived: outlines are round
to 1 %; a softer ball is not tracked as one)."""

MIN_STRIKE_COR, MAX_STRIKE_COR = 0.1, 1.15
"""COR, dimensionless (chosen): a passive contact returns at most 1, plus measurement error; below
0.1 it did not bounce."""


@dataclass(frozen=True)
class Impact:
    """A strike in the ball plane.

    Attributes
    ----------
    tracks : MetricTracks
        Tracks used by the fit.
    flight : FlightFit
        After release.
    free_flight : FlightFit
        The same with gravity fitted.
    view, contact : ImpactView and ContactFit, or None
        None without a pendulum, or if it is not tracked on both sides; `reason` says why.
    last_flight_s : float
        Last frame of the flight that is in view, s.
    landing : LandingSeen or None
        Touch-down from the frames around it alone; otherwise `landing_reason` says why not.
    """

    tracks: MetricTracks
    flight: FlightFit
    free_flight: FlightFit
    view: ImpactView | None
    contact: ContactFit | None
    reason: str
    last_flight_s: float
    landing: LandingSeen | None = None
    landing_reason: str = ""


def departure(tracks: MetricTracks) -> float:
    """Time at which the ball has left its rest, s.

    Raises
    ------
    NotFoundError
        If it never does.
    """
    std = np.sqrt(np.trace(tracks.ball_cov_m2, axis1=1, axis2=2))
    moved = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    away = moved > np.maximum(6.0 * std, 6.0 * float(np.hypot(*tracks.rest_std_m)))
    gone = away & (moved > MIN_DEPARTURE_RADII * tracks.radius_m)
    sustained = gone & np.append(gone[1:], gone[-1]) & np.append(gone[2:], [gone[-1]] * 2)
    places = np.flatnonzero(sustained)
    if len(places) == 0:
        raise NotFoundError(
            "the ball never leaves its rest position in this clip",
            hint="Film the strike itself, or point at the ball with --ball-at X,Y.",
        )
    # backwards from the flight: earlier disturbances of the outline are not its start
    at_rest = np.flatnonzero(~away[: places[0]])
    first = 0 if len(at_rest) == 0 else int(at_rest[-1]) + 1
    return float(tracks.ball_time_s[first])


def next_strike_time(tracks: MetricTracks, flown: float) -> float | None:
    """Time at which the ball is at rest again before leaving once more, s; None if it is not.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    flown : float
        Last frame of the flight that was measured, s.
    """
    away = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    at_rest = np.flatnonzero(
        (tracks.ball_time_s > flown) & (away < MAX_RESIDUAL_RADII * tracks.radius_m)
    )
    if len(at_rest) < MIN_FRAMES_AT_REST or not np.any(away[at_rest[-1] :] > tracks.radius_m):
        return None
    return float(tracks.ball_time_s[at_rest[0]])


def other_strikes(tracks: Tracks) -> tuple[FollowedObject, ...]:
    """Other strikes: balls of the same size that leave the same rest position.

    Parameters
    ----------
    tracks : Tracks
        In pixels.
    """
    if tracks.rest_frames is None:
        return ()
    ball, (first, last) = tracks.ball, tracks.rest_frames
    radius = float(np.median(ball.radius_px))
    still = (ball.frame >= first) & (ball.frame <= last)
    if not np.any(still):
        return ()
    rest = np.median(ball.centre_px[still], axis=0)
    return tuple(other for other in tracks.others if _was_at_rest(other.track, rest, radius, ball))


def _was_at_rest(track: Track, rest: FloatArray, radius: float, ball: Track) -> bool:
    """Whether a ball was at rest at a place while the other was elsewhere, and left it."""
    away = np.hypot(*(track.centre_px - rest).T)
    at_rest = np.flatnonzero(away < MAX_PLACEMENT_RADII * radius)
    if len(at_rest) < MIN_FRAMES_PLACED or not np.any(away[at_rest[-1] :] > radius):
        return False
    there = ball.frame[np.hypot(*(ball.centre_px - rest).T) < radius]
    alike = abs(float(np.log(np.median(track.radius_px) / radius))) < MAX_LOG_RADIUS_DIFFERENCE
    return alike and not np.any(np.isin(track.frame[at_rest], there))


def find_impact(
    tracks: MetricTracks, inputs: Inputs, started: tuple[float, float, float] | None = None
) -> Impact:
    """Fit swing, flight and contact, each on its own frames, in a few rounds.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    inputs : Inputs
        Forces and bodies.
    started : (3,) tuple of float, optional
        Initial onset and release, and the end of the flight, s.

    Raises
    ------
    NotFoundError, TooLittleDataError
        If the ball never leaves, or is tracked too briefly afterwards.
    """
    left = departure(tracks)
    landed = flight_end(tracks, inputs, left) if started is None else started[2]
    latest = left + MAX_CONTACT_S
    # half of a flight as short as a contact may be is fitted, until a contact shows its beginning
    guess = latest if tracks.pivot_m is None else min(latest, 0.5 * (left + landed))
    onset, release = (left - 0.008, guess) if started is None else started[:2]
    view: ImpactView | None = None
    contact: ContactFit | None = None
    reason = "no pendulum mass found in the clip; point at it with --mass-at X,Y"
    evidence: FaceEvidence | None = None
    flight = _flight(tracks, inputs, release, landed, free=False)
    for _ in range(_SELECTION_ROUNDS if started is None else 1):
        if tracks.pivot_m is None:
            break
        view = None
        try:
            view = _view(
                tracks, inputs, flight, _Frames.of(tracks, onset, release), evidence=evidence
            )
            view, contact = _fit_contact_with_alternatives(
                view, tracks, inputs, 0.5 * (onset + release)
            )
            evidence = view.face_evidence
        except MeasurementError as problem:
            view, contact, reason = None, None, problem.in_one_line
            break
        onset, release = contact.onset_s, contact.release_s
        flight = _flight(tracks, inputs, release, landed, free=False)
        view = replace(view, flight=flight)
    if view is not None and contact is not None:
        reason = _striker_refusal(view, contact)
        if reason:
            view, contact = None, None
            flight = _flight(tracks, inputs, latest, landed, free=False)
    since = release if contact is not None else latest
    if contact is None:
        # the intersection of rest and flight is the middle of the contact; with a wrong rate it
        # may be anywhere, so it is limited
        near = MAX_CONTACT_S + 2.0 * float(np.median(np.diff(tracks.ball_time_s)))
        corner = float(np.clip(_corner(tracks, flight), left - near, left + near))
        release = corner + UNSEEN_HALF_CONTACT_S
        flight = _flight(tracks, inputs, release, landed, free=False, since=since)
    free = _flight(tracks, inputs, release, landed, free=True, since=since)
    _require_flight(free, tracks)
    landing, unseen = _landing(tracks, inputs, flight)
    last = float(flight.time_s[-1])
    return Impact(tracks, flight, free, view, contact, reason, last, landing, unseen)


def _landing(
    tracks: MetricTracks, inputs: Inputs, flight: FlightFit
) -> tuple[LandingSeen | None, str]:
    """Stated or observed touch-down, or why there is none."""
    if tracks.landing is not None:
        place, spread = tracks.landing
        lands_at = flight.falls_to(float(place[1]))
        apart = np.pad(spread, ((1, 0), (1, 0)))
        return LandingSeen(np.nan if lands_at is None else lands_at, place, apart, False), ""
    if inputs.fall is None:
        return None, "the height of the support is unknown; set [support] height"
    lands_at = flight.falls_to(float(tracks.rest_m[1]) - inputs.fall)
    if lands_at is None:
        return None, "the flight does not reach the floor"
    try:
        return landing_seen(tracks, inputs, lands_at), ""
    except NotFoundError as problem:
        return None, problem.in_one_line


def moved_impact(near: Impact, tracks: MetricTracks, inputs: Inputs) -> Impact:
    """Impact after a small change of inputs: every fit to first order on the same frames.

    Parameters
    ----------
    near : Impact
        Before the change.
    tracks : MetricTracks
        The same frames after the change.
    inputs : Inputs
        After the change.

    Raises
    ------
    NotFoundError
        If face and ball no longer meet.
    """
    # the clock may have changed
    clock_ratio = float(tracks.ball_time_s[-1] / near.tracks.ball_time_s[-1])
    flight = _moved_flight(near.tracks, near.flight, tracks, inputs, clock_ratio, free=False)
    free = _moved_flight(near.tracks, near.free_flight, tracks, inputs, clock_ratio, free=True)
    if near.view is None or near.contact is None:
        shift = _corner(tracks, flight) - clock_ratio * _corner(near.tracks, near.flight)
        flight = flight.restarted(flight.reference_s + shift)
        near = replace(near, tracks=tracks, flight=flight, free_flight=free)
        return replace(near, landing=_landing(tracks, inputs, flight)[0])
    frames = _Frames.of(near.tracks, near.view.before.reference_s, near.view.after.reference_s)
    view = _view(tracks, inputs, flight, frames.on_clock(clock_ratio), near.view)
    middle = 0.5 * clock_ratio * (near.contact.onset_s + near.contact.release_s)
    contact = fit_contact(view, middle, check_bound=False)
    near = replace(near, tracks=tracks, flight=flight, free_flight=free, view=view, contact=contact)
    return replace(near, landing=_landing(tracks, inputs, flight)[0])


def _moved_flight(
    before: MetricTracks,
    near: FlightFit,
    tracks: MetricTracks,
    inputs: Inputs,
    clock_ratio: float,
    *,
    free: bool,
) -> FlightFit:
    used = np.isin(before.ball_time_s, near.time_s)
    return _fitted_flight(
        tracks, inputs, used, clock_ratio * near.reference_s, free=free, near=near
    )


def _striker_refusal(view: ImpactView, contact: ContactFit) -> str:
    """Why the tracked mass can't be the striker; empty if it can."""
    approach, parting = face_speeds(view, contact.onset_s, contact.release_s)
    if approach > 0.0 and MIN_STRIKE_COR < parting / approach < MAX_STRIKE_COR:
        return ""
    return (
        f"the object tracked as the mass meets the ball at {approach:.2f} m/s and leaves it at "
        f"{parting:.2f} m/s, which no strike does; it may be a shadow. Point at the mass with "
        "--mass-at X,Y, or check --fps and the pendulum's properties"
    )


def _require_flight(free: FlightFit, tracks: MetricTracks) -> None:
    """Refuse motion that is not free flight: a pendulum, a hand, a rolling ball."""
    off = float(np.median(np.hypot(*free.residual_m.T)))
    if off > MAX_RESIDUAL_RADII * tracks.radius_m:
        raise NotFoundError(
            f"the tracked object is not in free flight: median residual {100 * off:.1f} cm",
            hint="Point at the ball with --ball-at X,Y, and check the capture rate (--fps).",
        )


def _flight(
    tracks: MetricTracks,
    inputs: Inputs,
    release: float,
    landed: float,
    *,
    free: bool,
    since: float | None = None,
) -> FlightFit:
    frame_s = float(np.median(np.diff(tracks.ball_time_s)))
    begin = release if since is None else since
    used = (tracks.ball_time_s > begin + 1.5 * frame_s) & (tracks.ball_time_s < landed)
    return _fitted_flight(tracks, inputs, used, release, free=free)


def _fitted_flight(
    tracks: MetricTracks,
    inputs: Inputs,
    used: NDArray[np.bool_],
    reference_s: float,
    *,
    free: bool,
    near: FlightFit | None = None,
) -> FlightFit:
    drag, drag_std = inputs.drag_per_metre
    gravity_std = np.inf if free else inputs.rig.gravity.std
    return fit_flight(
        tracks.ball_time_s[used],
        tracks.ball_m[used],
        tracks.ball_cov_m2[used],
        reference_s,
        FlightPriors(inputs.gravity, gravity_std, drag, drag_std, 0.0, inputs.lift_std),
        near,
    )


def _corner(tracks: MetricTracks, flight: FlightFit) -> float:
    """Time at which the flight's tangent meets the rest position: middle of the contact, s."""
    state = flight.states(np.array([flight.reference_s]))[0]
    velocity = state[2:]
    back = float((tracks.rest_m - state[:2]) @ velocity / (velocity @ velocity))
    return flight.reference_s + back


@dataclass(frozen=True)
class _Frames:
    """Frames used for a contact from onset to release, s: of the pendulum and of the ball."""

    onset: float
    release: float
    swing_before: BoolArray
    swing_after: BoolArray
    ball_near: BoolArray

    @classmethod
    def of(cls, tracks: MetricTracks, onset: float, release: float) -> "_Frames":
        time, ball = tracks.swing_time_s, tracks.ball_time_s
        begin, end = onset - NEAR_BEFORE_S, release + NEAR_AFTER_S
        return cls(
            onset,
            release,
            (time < onset) & (time > onset - SWING_STRETCH_S),
            (time > release) & (time < release + SWING_STRETCH_S),
            (ball > begin) & (ball < end),
        )

    def on_clock(self, clock_ratio: float) -> "_Frames":
        """The same frames on a clock scaled by `clock_ratio`."""
        return replace(self, onset=clock_ratio * self.onset, release=clock_ratio * self.release)


def _view(
    tracks: MetricTracks,
    inputs: Inputs,
    flight: FlightFit,
    frames: _Frames,
    moved_from: ImpactView | None = None,
    *,
    evidence: FaceEvidence | None = None,
) -> ImpactView:
    assert tracks.pivot_m is not None
    time = tracks.swing_time_s
    stiffness = inputs.pendulum_stiffness
    spread = inputs.rig.stiffness_relative_std * stiffness

    def swing(used: BoolArray, reference_s: float, near: SwingFit | None) -> SwingFit:
        angle, std = tracks.swing_rad[used], tracks.swing_std_rad[used]
        return fit_swing(time[used], angle, std, reference_s, stiffness, spread, near)

    radius = tracks.radius_m if inputs.ball is None else 0.5 * inputs.ball.diameter
    if moved_from is not None:
        evidence = moved_from.face_evidence
    near = frames.ball_near
    velocity = flight.states(np.array([frames.release]))[0, 2:]
    way = velocity / np.hypot(*velocity)
    before = swing(frames.swing_before, frames.onset, moved_from.before if moved_from else None)
    pivot = pivot_in_plane(tracks, inputs)
    view = ImpactView(
        before=before,
        after=swing(frames.swing_after, frames.release, moved_from.after if moved_from else None),
        flight=flight,
        rest=tracks.rest_m,
        rest_std=tracks.rest_std_m,
        pivot=_at_given_length(pivot, tracks, inputs, before.state(frames.onset)[0]),
        radius=radius,
        time_s=tracks.ball_time_s[near],
        position_m=tracks.ball_m[near],
        std_m=np.sqrt(np.einsum("i,nij,j->n", way, tracks.ball_cov_m2[near], way)),
        face_offset=0.0,
        face_offset_std=math.inf,
        longest_s=_longest_contact(inputs, radius),
        bob_arm=tracks.bob_arm_m,
    )
    return _with_face(view, tracks, inputs, frames.onset, evidence)


def _at_given_length(
    pivot: FloatArray, tracks: MetricTracks, inputs: Inputs, phi: float
) -> FloatArray:
    """The pivot moved along the bar to the weighted mean of observed and given length.

    A short arc determines the length of its radius poorly. A length that contradicts the observed
    one is left to the check, and so is one of the presets, which may be of another apparatus.
    """
    length = inputs.rig.length
    if length.value_from is Origin.PRESET:
        return pivot
    given_std = max(length.relative_std, 1e-4)
    arm = tracks.rest_m - pivot
    return pivot + to_length(arm, phi, inputs.pendulum.length, ARM_RELATIVE_STD, given_std)


def _with_face(
    view: ImpactView,
    tracks: MetricTracks,
    inputs: Inputs,
    onset: float,
    evidence: FaceEvidence | None,
) -> ImpactView:
    """The view with the hypotheses for the face before the contact fit."""
    evidence, (first, *others) = offset_of_face(tracks, inputs, view.radius, onset, evidence)
    return replace(
        view,
        face_offset=first.lead,
        face_offset_std=first.std,
        face_alternatives=tuple(others),
        face_evidence=evidence,
    )


def _fit_contact_with_alternatives(
    view: ImpactView, tracks: MetricTracks, inputs: Inputs, around_s: float
) -> tuple[ImpactView, ContactFit]:
    """Contact fit and its view.

    If observed face and given angle exclude any contact together, they become alternatives.
    """
    try:
        return view, fit_contact(view, around_s)
    except MeasurementError:
        if view.face_evidence is not FaceEvidence.COMBINED:
            raise
    view = _with_face(view, tracks, inputs, view.before.reference_s, FaceEvidence.ALTERNATIVES)
    return view, fit_contact(view, around_s)


def _longest_contact(inputs: Inputs, radius: float) -> float:
    """Upper bound of the contact time of a ball that its own weight does not flatten visibly, s.

    With a sag of s = m g / k the contact lasts for half a period, π √(m / k) = π √(s / g); the mass
    of the striker and a law that stiffens with compression only shorten it.
    """
    return math.pi * math.sqrt(2.0 * MAX_SAG_FRACTION * radius / inputs.gravity)


_GAP_LINE_FRAMES = 10
"""Frames of a line on each side of the contact (chosen; gliding discs hardly slow down)."""

FACE_RADIUS_STD_PX = 0.3
"""px, std of the distance of two outlines at contact (assumed: both edges, motion blur)."""


@dataclass(frozen=True)
class DiscContact:
    """Contact time of two round bodies.

    Attributes
    ----------
    time_s, std_s : float
        Contact, s from the first frame.
    longest_s : float
        Upper bound of the duration (k = 2).
    """

    time_s: float
    std_s: float
    longest_s: float


def disc_contact(tracks: Tracks) -> DiscContact | None:
    """Find when the striker met the struck ball.

    The striker's gap closes along a line that reaches zero at first contact; the struck ball leaves
    along a line that starts at its rest. The contact is between the two.

    Parameters
    ----------
    tracks : Tracks
        With the struck ball as `ball` and the striker as the first of `others`.

    Returns
    -------
    DiscContact or None
        None without a striker, or if it is not tracked on both sides.
    """
    if tracks.pendulum is not None or not tracks.others or tracks.rest_frames is None:
        return None
    ball, striker, last = tracks.ball, tracks.others[0].track, tracks.rest_frames[1]
    still = ball.frame <= last - 1
    if still.sum() < 3:
        return None
    rest = np.median(ball.centre_px[still], axis=0)
    radii_sum = float(np.median(ball.radius_px) + np.median(striker.radius_px))
    gap = np.hypot(*(striker.centre_px - rest).T) - radii_sum
    closing = _line_to_zero(
        striker, gap, (striker.frame < last) & (striker.frame >= last - _GAP_LINE_FRAMES)
    )
    away = np.hypot(*(ball.centre_px - rest).T)
    leaving = _line_to_zero(
        ball, away, (ball.frame > last + 1) & (ball.frame <= last + _GAP_LINE_FRAMES)
    )
    if closing is None or leaving is None:
        return None
    touch, touch_std, speed = closing
    touch_std = math.hypot(touch_std, FACE_RADIUS_STD_PX / abs(speed))
    left, left_std, _ = leaving
    weights = np.array([touch_std, left_std]) ** -2.0
    time = float(weights @ [touch, left] / weights.sum())
    return DiscContact(
        time,
        float(weights.sum() ** -0.5),
        max(left - touch, 0.0) + 2.0 * math.hypot(touch_std, left_std),
    )


def _line_to_zero(
    track: Track, distance: FloatArray, used: NDArray[np.bool_]
) -> tuple[float, float, float] | None:
    """Time at which a line through distances reaches zero, its std, and its slope (px/s)."""
    if used.sum() < 4:
        return None
    time = track.time_s[used]
    middle = float(time.mean())
    slope, offset = np.polyfit(time - middle, distance[used], 1)
    if slope == 0:
        return None
    left = distance[used] - slope * (time - middle) - offset
    noise = float(np.sqrt((left**2).sum() / (used.sum() - 2)))
    at = -offset / slope
    spread = float(((time - middle) ** 2).sum())
    std = noise / abs(slope) * math.sqrt(1.0 / used.sum() + at**2 / spread)
    return middle + at, std, float(slope)
