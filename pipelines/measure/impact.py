"""Both sides of the contact and the contact between them, from tracks in metres.

Where the face of the pendulum mass is, from what is seen of it and what is known of it.

A strike between two balls or pucks: the moment they touch, from straight lines on each side.

When mass and ball touch, between frames (Fig. 13).

Before and after contact the gap between face and ball follows from free swing, rest and flight,
each fitted on its own side only. What the gap leaves open is how far the face leads the bar; the
way the ball moves while it is pushed tells that: a longer contact rounds the corner between rest
and flight.

The shape of a contact: how far the ball has come while the force between mass and ball lasts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrology import MeasurementError, NoFitError, NotFoundError
from physics import bodies
from physics.contact import contact_time_bound, damping_for_cor
from pipelines.measure.flight_fit import (
    LONGEST_CONTACT_S,
    FlightFit,
    FlightPriors,
    LandingSeen,
    SwingFit,
    fit_flight,
    fit_swing,
    flight_end,
    landing_seen,
    slow_error_whitening,
)
from pipelines.measure.inputs import Inputs
from pipelines.measure.metres import MetricTracks
from pipelines.setup.file import Origin
from vision.tracks import FollowedObject, Track, Tracks

__all__ = [
    "NEAR_SHARE",
    "STEEL",
    "ContactFit",
    "Impact",
    "ImpactView",
    "arm_along_bar",
    "departure",
    "disc_contact",
    "face_speeds",
    "find_impact",
    "fit_contact",
    "gap_after",
    "gap_before",
    "moved_impact",
    "strikes_apart",
    "struck_again",
    "touch_times",
]

FloatArray = NDArray[np.float64]

_POINTS = 201
"""Points of a tabulated pulse: a half sine drawn through them is off by (π/200)²/8, or 3e-5 of its
peak, at most."""

_SLICES = 1000
"""Of a contact that is integrated: its pulse is off by 1e-6 of the peak, measured."""

_STEP = 0.15
"""Step between tabulated exponents of the force law, about `EXPONENT_STD`: pulses in between are
interpolated."""


@dataclass(frozen=True)
class ContactPulse:
    """A contact in its own units: time 0 to 1 from onset to release, approach speed × duration = 1.

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
    place = (exponent - 1.0) / _STEP
    lower = math.floor(place)
    share = place - lower
    one = _solved(lower, round(cor, 2))
    other = _solved(lower + 1, round(cor, 2))
    return ContactPulse(
        one.phase,
        (1.0 - share) * one.compression + share * other.compression,
        (1.0 - share) * one.path + share * other.path,
    )


@lru_cache(maxsize=256)
def _solved(step: int, cor: float) -> ContactPulse:
    """The pulse from the law's first integral: δⁿ⁺¹ / (n + 1) = ∫ u / (1 + d u) du from v to 1."""
    power = 2.0 + step * _STEP
    damping = float(damping_for_cor(cor))
    # speeds that fall as x^power at both ends, where the compression then grows as x
    ends = np.linspace(0.0, 1.0, _SLICES + 1)
    middles = 0.5 * (ends[1:] + ends[:-1])
    rate, _ = _eased(ends, power, cor)
    compression = _compressed(rate, damping, power)
    between, slope = _eased(middles, power, cor)
    force = _compressed(between, damping, power) ** (power - 1.0) * (1.0 + damping * between)
    time = np.concatenate([[0.0], np.cumsum(slope / force) / _SLICES])
    phase = np.linspace(0.0, 1.0, _POINTS)
    speed = 1.0 - np.interp(phase, time / time[-1], rate)
    way = np.cumsum(0.5 * (speed[1:] + speed[:-1])) * (phase[1] - phase[0])
    return ContactPulse(
        phase,
        np.interp(phase, time / time[-1], compression) / time[-1],
        np.concatenate([[0.0], way]) / speed[-1],
    )


def _eased(x: FloatArray, power: float, cor: float) -> tuple[FloatArray, FloatArray]:
    """From 1 to -cor over x from 0 to 1, flat as x^power at both ends, and how steeply it falls."""
    begun, left = x**power, (1.0 - x) ** power
    whole = begun + left
    slope = power * (x * (1.0 - x)) ** (power - 1.0) / whole**2
    return 1.0 - (1.0 + cor) * begun / whole, (1.0 + cor) * slope


def _compressed(rate: FloatArray, damping: float, power: float) -> FloatArray:
    """Compression at which so much of the approach speed 1 is left."""
    if damping == 0.0:
        energy = 0.5 * (1.0 - rate**2)
    else:
        lost = np.log1p(damping * (1.0 - rate) / (1.0 + damping * rate))
        energy = ((1.0 - rate) - lost / damping) / damping
    return np.asarray(np.maximum(power * energy, 0.0) ** (1.0 / power))


# Inflated balls lie between a linear spring and Hertz's 3/2 (Cross, Am. J. Phys. 67, 222, 1999).
EXPONENT, EXPONENT_STD = 1.3, 0.12

OUTLINE_AHEAD, OUTLINE_AHEAD_STD = 0.05, 0.06

"""Share of the compression by which the middle of the fitted outline is ahead of the ball's centre.

The outline's rear is pressed in by the whole compression, its front is not: a circle through all of
it moves ahead by up to half, one that leaves the rear out by nothing; robust fits leave most of it
out."""

# How far balls' paths through the contact differ from such a law's, over the speed gained × Δt.
SHAPE_STD = 0.003

_FEWEST_TRIED, _MOST_TRIED = 19, 101
"""At how many places the face is tried."""

_FINE_M = 2.5e-3
"""m, between places that are tried: the mass comes as far in half a frame at 600 fps."""

_EXPONENTS = np.linspace(1.1, 1.5, 4)
"""Exponents of the force law that are integrated over: within 1.7 standard deviations of the usual
one."""

_SOFT_FROM = 2.0

_NEAR_CROSSING = 6
"""Times about a crossing that a cubic is laid through: half as many again as it has unknowns."""

BOUND_SHARE = 0.05

"""Share: how sharp the bound of contact times is; damping makes a contact some per cent longer."""

CONTRADICTS = 9.0

"""Twice the log-likelihood that is lost where the bound contradicts what is seen: 3 sigma."""

_BRIEFEST_S = 1e-4
"""s, of a contact that is fitted: steel on steel; a pulse of no length has no shape."""

COR_STD = 0.05
"""Dimensionless, between the COR of the speeds and that of a contact head-on, supposed: friction
and spin take their part of an oblique blow."""


@dataclass(frozen=True)
class FaceWay:
    """A way to tell how far the face leads the line from pivot to mass.

    Attributes
    ----------
    lead, std : float
        m.
    share : float
        Probability beforehand that it is this one that holds.
    reach : float
        Standard uncertainties beyond which it does not.
    """

    lead: float
    std: float
    share: float = 1.0
    reach: float = 3.0

    @property
    def offsets(self) -> FloatArray:
        """Leads to try, m."""
        fine = math.ceil(min(2.0 * self.reach * self.std / _FINE_M, _MOST_TRIED))
        tried = np.linspace(-self.reach, self.reach, max(_FEWEST_TRIED, fine))
        return self.lead + self.std * tried

    def prior_penalty(self, offsets: FloatArray) -> FloatArray:
        """Twice the negative log-probability of each of evenly spaced leads, but for a constant."""
        step = (offsets[1] - offsets[0]) / self.std
        return ((offsets - self.lead) / self.std) ** 2 - 2.0 * math.log(self.share * step)


class FaceTold(Enum):
    """What tells where the face is: only what is seen, both ways together, or either of them."""

    SEEN = auto()
    BOTH = auto()
    EITHER = auto()


@dataclass(frozen=True)
class ImpactView:
    """What is known on each side of the contact, in the ball plane, x towards the flight, m and s.

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
        Ball's outline in the frames around contact.
    swing_time_s, swing_rad, swing_std_rad : (K,) arrays
        Pendulum's angle in the frames around contact.
    face_offset, face_offset_std : float
        How far the face leads the line from pivot to mass.
    longest_s : float
        The longest contact that such a ball can have (`physics.contact`), s.
    bob_arm : float or None
        Pivot to the centre of a round bob; None where the mass has a flat face.
    face_otherwise : tuple of FaceWay
        The same as it may be instead; empty where nothing contradicts it.
    face_told : FaceTold
        What tells them.
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
    swing_time_s: FloatArray
    swing_rad: FloatArray
    swing_std_rad: FloatArray
    face_offset: float
    face_offset_std: float
    longest_s: float = math.inf
    bob_arm: float | None = None
    face_otherwise: tuple[FaceWay, ...] = ()
    face_told: FaceTold = FaceTold.BOTH


@dataclass(frozen=True)
class ContactFit:
    """The contact.

    Attributes
    ----------
    onset_s, release_s : float
        First and last touch, s from the first frame.
    face_offset, face_offset_std : float
        Fitted offset of the face, m.
    exponent : float
        Exponent of the contact law that the fit preferred.
    residuals : (M,) array
        Standardised residuals of the ball's path through the contact.
    """

    onset_s: float
    release_s: float
    face_offset: float
    face_offset_std: float
    exponent: float
    residuals: FloatArray


def gap_before(view: ImpactView, time_s: FloatArray, angle: FloatArray | None = None) -> FloatArray:
    """Distance from the bar's line to the resting ball's surface along the face normal, m."""
    phi = view.before.angles(time_s) if angle is None else angle
    return _reach(view.rest - view.pivot, phi) - view.radius


def gap_after(view: ImpactView, time_s: FloatArray, angle: FloatArray | None = None) -> FloatArray:
    """The same to the flying ball, m."""
    phi = view.after.angles(time_s) if angle is None else angle
    return _reach(view.flight.states(time_s)[:, :2] - view.pivot, phi) - view.radius


def _reach(arm: FloatArray, phi: FloatArray) -> FloatArray:
    normal = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    return np.asarray((arm * normal).sum(axis=-1))


def fit_contact(view: ImpactView, around_s: float, *, doubting: bool = True) -> ContactFit:
    """Fit onset and release.

    Parameters
    ----------
    view : ImpactView
        Both sides of the contact.
    around_s : float
        A time near the contact, s.
    doubting : bool
        Whether a contact that no such ball can have is refused: of inputs moved off their best
        estimate to see what follows, none is.

    Raises
    ------
    NotFoundError
        If face and ball never meet, or never part, or if no such ball stays in touch so long.
    NoFitError
        If they would part before they meet: one of the two paths is wrong.
    """
    left_over = 1.0 - sum(way.share for way in view.face_otherwise)
    ways = FaceWay(view.face_offset, view.face_offset_std, left_over), *view.face_otherwise
    offsets = np.concatenate([way.offsets for way in ways])
    whitening = _Whitening(
        slow_error_whitening(view.time_s, offset=True),
        slow_error_whitening(view.swing_time_s, offset=True),
    )
    gaps = _Gaps.of(view, around_s)
    tried = _all_tried(view, whitening, gaps, offsets)
    if tried is None:
        raise NotFoundError(
            "the mass and the ball never meet along their paths",
            hint="Check --ball-at and --mass-at, or film square to the plane of the swing.",
        )
    likely = int(np.argmin(tried.cost(1.0)))
    left = tried.left[:, likely]
    widened = max(1.0, float(np.mean(np.minimum(left**2, 9.0))))
    cost, beyond = np.full((2, len(offsets)), np.inf)
    cost[tried.place] = tried.cost(widened)
    cost += np.concatenate([way.prior_penalty(way.offsets) for way in ways])
    beyond[tried.place] = _beyond(tried.lasting_s, view)
    if doubting and float((cost + beyond).min()) > float(cost.min()) + CONTRADICTS:
        raise _no_contact(float(tried.lasting_s[likely]), view)
    unbound, _ = _weighed(cost, offsets)
    face_offset, std = _weighed(cost + beyond, offsets)
    # what a bound moves it leaves in doubt: it does not say why the paths would have it otherwise
    std = math.hypot(std, unbound - face_offset)
    at_mean = _all_tried(view, whitening, gaps, np.array([face_offset]))
    found, row = (tried, likely) if at_mean is None else (at_mean, 0)
    return ContactFit(
        float(found.onset_s[row]),
        float(found.release_s[row]),
        face_offset,
        std,
        float(found.exponent[row]),
        found.left[:, row],
    )


def _weighed(cost: FloatArray, offsets: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of the offset of the face, given what each costs."""
    share = np.exp(-0.5 * (cost - cost.min()))
    share /= share.sum()
    mean = float(share @ offsets)
    return mean, float(np.sqrt(share @ (offsets - mean) ** 2))


def _beyond(lasting_s: FloatArray, view: ImpactView) -> FloatArray:
    """Prior penalty of contacts that last longer than the ball can, or end before they begin.

    When the mass meets the ball and when it parts are each told to a frame at worst.
    """
    frame_s = float(np.median(np.diff(view.flight.time_s)))
    over = np.maximum(lasting_s / view.longest_s - 1.0, 0.0) / BOUND_SHARE
    return np.asarray(over**2 + np.minimum(lasting_s / frame_s, 0.0) ** 2)


def _no_contact(lasting_s: float, view: ImpactView) -> MeasurementError:
    lasts = 1e3 * lasting_s
    if lasts < 0.0:
        return NoFitError(
            f"the mass would part from the ball {-lasts:.0f} ms before it meets it: what was "
            "followed is not what struck, or not what was struck",
            hint="Point at the ball with --ball-at X,Y and at the mass with --mass-at X,Y.",
        )
    return NotFoundError(
        f"the contact would last {lasts:.0f} ms, but a ball of this mass and size stays in touch "
        f"for {1e3 * view.longest_s:.0f} ms at most: what was followed is not what struck it, or "
        "the capture rate is wrong",
        hint="Point at the mass with --mass-at X,Y, and check --fps and --ball.",
    )


@dataclass(frozen=True)
class _Whitening:
    """What turns standardised residuals of ball and mass into independent ones."""

    ball: Callable[[FloatArray], FloatArray]
    mass: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class _Tried:
    """Offsets of the face at which the two meet (M,), the contacts implied, and how well they fit.

    Attributes
    ----------
    place : (M,) int array
        Which of the offsets tried.
    onset_s, release_s : (M,) arrays
        Of the contact that was fitted, which lasts 0.1 ms at least.
    lasting_s : (M,) array
        From meeting to parting; below 0 where they would part first.
    exponent : (M,) array
        The likeliest.
    left : (R, M) array
        Whitened residuals.
    priors : (M,) array
        What exponent and lag cost.
    """

    place: NDArray[np.int64]
    onset_s: FloatArray
    release_s: FloatArray
    lasting_s: FloatArray
    exponent: FloatArray
    left: FloatArray
    priors: FloatArray

    def cost(self, widened: float) -> FloatArray:
        """Robust sums of squares, residuals over the root of `widened`, and the priors, (M,)."""
        return _robust(self.left) / widened + self.priors


def _robust(left: FloatArray) -> FloatArray:
    """Sum of the squares of residuals (R, ...), those beyond a few deviations linear."""
    soft = _SOFT_FROM**2 * 2.0 * (np.sqrt(1.0 + left**2 / _SOFT_FROM**2) - 1.0)
    return np.asarray(soft.sum(axis=0))


def _all_tried(
    view: ImpactView, whitening: _Whitening, gaps: "_Gaps", offsets: FloatArray
) -> _Tried | None:
    """For each offset the best of a few exponents, with the outline's lag solved for.

    None where the two meet at no offset.
    """
    onset, release = gaps.touches(offsets)
    meet = np.isfinite(onset) & np.isfinite(release)
    if not meet.any():
        return None
    lasting = (release - onset)[meet]
    ends = _Ends.of(view, onset[meet], onset[meet] + np.maximum(lasting, _BRIEFEST_S))
    left, per_lag = _path_residuals(view, whitening, ends)
    left = left - OUTLINE_AHEAD * per_lag
    lag = (per_lag * left).sum(axis=0) / ((per_lag**2).sum(axis=0) + OUTLINE_AHEAD_STD**-2)
    left = left - lag * per_lag
    priors = ((_EXPONENTS - EXPONENT) / EXPONENT_STD) ** 2 + (lag / OUTLINE_AHEAD_STD) ** 2
    best = np.argmin(_robust(left) + priors, axis=1)
    every = np.arange(len(best))
    return _Tried(
        np.flatnonzero(meet),
        ends.onset_s,
        ends.onset_s + ends.duration,
        lasting,
        _EXPONENTS[best],
        left[:, every, best],
        priors[every, best],
    )


def touch_times(view: ImpactView, face_offset: float, around_s: float) -> tuple[float, float]:
    """When they meet and part for an offset of the face, s; NaN where never.

    What is too short for the frame rate may seem to part first.
    """
    onset, release = _Gaps.of(view, around_s).touches(np.array([face_offset]))
    return float(onset[0]), float(release[0])


def face_speeds(view: ImpactView, onset: float, release: float) -> tuple[float, float]:
    """Approach speed at onset and parting speed at release, along the face normal, m/s (Eq. 2)."""
    approach, parting = _face_speeds(view, np.array([onset]), np.array([release]))
    return float(approach[0]), float(parting[0])


def _face_speeds(
    view: ImpactView, onset: FloatArray, release: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Approach and parting speeds (L,) of contacts from onset (L,) to release (L,), s."""
    phi, omega = view.before.states(onset)
    approach = omega * arm_along_bar(view.rest - view.pivot, phi)
    phi, omega = view.after.states(release)
    state = view.flight.states(release)
    normal = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    arm = np.moveaxis(state[:, :2] - view.pivot, -1, 0)
    parting = (state[:, 2:] * normal).sum(axis=-1) - omega * arm_along_bar(arm, phi)
    return approach, parting


def arm_along_bar(arm: FloatArray, phi: ArrayLike) -> Any:
    """Distance from the pivot to the point of contact (2,) or (2, L), along the bar, m."""
    return arm[0] * np.sin(phi) - arm[1] * np.cos(phi)


@dataclass(frozen=True)
class _Gaps:
    """From the bar's line to the ball before and after a contact (T,), m, at times around it, s."""

    time_s: FloatArray
    closing: FloatArray
    opening: FloatArray

    @classmethod
    def of(cls, view: ImpactView, around_s: float) -> "_Gaps":
        time = around_s + np.linspace(-0.06, 0.06, 121)
        return cls(time, gap_before(view, time), gap_after(view, time))

    def touches(self, offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Onset and release (L,) for offsets of the face (L,), s; NaN where there is none."""
        face = offsets[:, np.newaxis]
        return _crossings(self.time_s, self.closing - face), _crossings(
            self.time_s, face - self.opening
        )


def _crossings(time_s: FloatArray, gap: FloatArray) -> FloatArray:
    """Where gaps (L, T) first fall through zero, from a cubic near there, s; NaN if nowhere."""
    falls = (gap[:, :-1] > 0) & (gap[:, 1:] <= 0)
    rows = np.flatnonzero(falls.any(axis=1))
    first = np.clip(np.argmax(falls[rows], axis=1) - 2, 0, len(time_s) - _NEAR_CROSSING)
    near = first[:, np.newaxis] + np.arange(_NEAR_CROSSING)
    gaps, times = gap[rows[:, np.newaxis], near], time_s[near]
    # time as a cubic of the gap in units of its size here, by its nearest powers
    scaled = gaps / np.abs(gaps).max(axis=1, keepdims=True)
    solved = np.linalg.pinv(scaled[..., np.newaxis] ** np.arange(4))[:, 0]
    found = np.full(len(gap), math.nan)
    found[rows] = times[:, 0] + (solved * (times - times[:, :1])).sum(axis=1)
    return found


@dataclass(frozen=True)
class _Ends:
    """Motion at both ends of contacts, one for each offset: arrays (L,), the normals (L, 2)."""

    onset_s: FloatArray
    duration: FloatArray
    normal: FloatArray
    speed: FloatArray
    cor: FloatArray
    approach: FloatArray
    by_speeds: FloatArray

    @classmethod
    def of(cls, view: ImpactView, onset: FloatArray, release: FloatArray) -> "_Ends":
        duration = release - onset
        state = view.flight.states(release)
        normal = state[:, :2] - view.rest
        way = np.hypot(*normal.T)
        speed = (state[:, 2:] * normal).sum(axis=-1) / way
        # the impulse's centroid puts the way gone at release at v Δt / (1 + e)
        cor = speed * duration / way - 1.0
        approach, parting = _face_speeds(view, onset, release)
        by_speeds = (parting / approach - cor) / COR_STD
        return cls(
            onset,
            duration,
            normal / way[:, np.newaxis],
            speed,
            np.clip(cor, 0.2, 0.999),
            approach,
            by_speeds,
        )


def _path_residuals(
    view: ImpactView, whitening: _Whitening, ends: _Ends
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals of ball, pendulum and COR, and what one unit of outline lag adds.

    Both (R, L, E) for L contacts and E exponents.
    """
    pulses = _Pulses.of(ends.cor)
    duration = ends.duration[:, np.newaxis]
    phase = (view.time_s[:, np.newaxis] - ends.onset_s) / ends.duration
    path = duration * pulses.way(phase)
    lagging = pulses.at(phase, pulses.compression) * (ends.approach * ends.duration)[:, np.newaxis]
    swung = duration * pulses.way((view.swing_time_s[:, np.newaxis] - ends.onset_s) / ends.duration)
    moved = (view.position_m - view.rest) @ ends.normal.T
    std = np.hypot(view.std_m[:, np.newaxis], SHAPE_STD * ends.speed * ends.duration)
    off = (moved[..., np.newaxis] - path * ends.speed[:, np.newaxis]) / std[..., np.newaxis]
    ball = whitening.ball(off)
    held = whitening.mass(_pendulum_held_back(view, ends, swung))
    speeds = np.broadcast_to(ends.by_speeds[:, np.newaxis], (1, *path.shape[1:]))
    left = np.concatenate([ball, held, speeds])
    per_lag = np.zeros_like(left)
    per_lag[: len(view.time_s)] = whitening.ball(lagging / std[..., np.newaxis])
    return left, per_lag


@dataclass(frozen=True)
class _Pulses:
    """Compression and path (L, E, P) at even phases of L contacts with each of the exponents."""

    compression: FloatArray
    path: FloatArray

    @classmethod
    def of(cls, cor: FloatArray) -> "_Pulses":
        every = [_pulses_of(round(float(one), 2)) for one in cor]
        return cls(*(np.stack(columns) for columns in zip(*every, strict=True)))

    def at(self, phase: FloatArray, table: FloatArray) -> FloatArray:
        """What such a table says at phases (N, L) of each contact, (N, L, E)."""
        last = table.shape[-1] - 1
        place = np.clip(phase, 0.0, 1.0) * last
        below = np.minimum(place.astype(np.int64), last - 1)
        part = (place - below)[..., np.newaxis]
        contact = np.arange(len(table))
        return np.asarray(
            table[contact, :, below] * (1.0 - part) + table[contact, :, below + 1] * part
        )

    def way(self, phase: FloatArray) -> FloatArray:
        """Way gone at phases (N, L) and after them, over speed at release × duration, (N, L, E)."""
        beyond = np.maximum(phase - 1.0, 0.0)
        return self.at(phase, self.path) + beyond[..., np.newaxis]


@lru_cache(maxsize=128)
def _pulses_of(cor: float) -> tuple[FloatArray, FloatArray]:
    """Compression and path (E, P) for one coefficient of restitution."""
    pulses = [contact_pulse(float(exponent), cor) for exponent in _EXPONENTS]
    return np.array([one.compression for one in pulses]), np.array([one.path for one in pulses])


def _pendulum_held_back(view: ImpactView, ends: _Ends, swung: FloatArray) -> FloatArray:
    """How far the pendulum stays behind its free swing: the ball's path by the mass ratio.

    Unlike the ball's outline, the mass keeps its shape.
    """
    release = ends.onset_s + ends.duration
    slowed = view.before.states(release)[1] - view.after.states(release)[1]
    behind = view.before.angles(view.swing_time_s) - view.swing_rad
    noise = view.swing_std_rad * math.sqrt(view.before.fitted.chi2_per_dof)
    std = np.hypot(noise[:, np.newaxis], SHAPE_STD * slowed * ends.duration)
    off = behind[:, np.newaxis, np.newaxis] - slowed[:, np.newaxis] * swung
    return np.asarray(off / std[..., np.newaxis])


UNSEEN_SLANT = 0.25

"""Slope of a line of sight from a camera of which nothing is known but that it sees the strike."""

STEEL, THICKNESS_SHARE = 7850.0, 0.3

"""kg/m³; how far the thickness of a mass may be from that of a cube of steel as heavy."""

THICKNESSES = (0.4, 2.0)

"""Thickness a mass may have, over that of such a cube."""

_PLAINLY = 3.0

"""Times its uncertainty: from such a slope of the line of sight on the face is plainly seen."""

NEAR_SHARE = 1.0 / 3.0

"""Of half the thickness of a mass that the plane in which it is followed is in front of its middle:
of the three upright edges of a block seen aslant two are on its near side and one on its far side.
The speed before the strike is then right in the mean over clips of two renderers; with 0.6, as if
the near side alone were seen, it is half a per cent low."""

STRUCK_OFF_CENTRE_M = 0.002

"""m: how far off the middle of the face a ball is struck that was set up by eye and rule."""

MOST_OUTSIDE_SHARE = 0.02

"""Of the ball's radius: what a transfer curve makes of the outline of a ball of 8 px and more; what
is beyond is the fault of something else."""

OUTSIDE_STD_SHARE = 0.5

"""Of how far outlines lie outside: ball and mass differ in contrast."""

IMPACT_ANGLE_STD = np.radians(0.4)

"""rad, of the bar at contact where the face is not seen, supposed: a bubble level is good to 0.3°,
and the bar swings on during contact."""

_ANOTHER_ARM = 0.1
"""Relative: an arm whose length differs by more is another rig's. In path-traced rooms arms look
0.05 too long or short, root mean square, where the ball is the scale."""

ELSEWHERE_SHARE, ELSEWHERE_STD_RADII = 0.1, 0.25
"""Probability that what is seen for the face is something else of the mass, and ball's radii by
which that is off: a shaded bob, a rim that is not seen. So in 8 of 37 path-traced rooms."""

ON_THE_MASS_RADII = 0.4
"""Ball's radii by which it is off at most, supposed: what is further away is no part of a mass."""

_TWO_WAYS_APART = 3.0

"""Standard deviations between two ways to the same number from which on one of them is wrong."""

PIVOT_SHARE = 0.15

"""Of half the thickness of the mass: its sides turn to the camera as it swings, which moves the
centre of its arc."""


def pivot_in_plane(tracks: MetricTracks, inputs: Inputs) -> FloatArray:
    """Pivot in the ball plane.

    The arc that is followed is nearer to the camera by part of the half thickness.

    Parameters
    ----------
    tracks : MetricTracks
        With a pendulum.
    inputs : Inputs
        Its numbers.

    Returns
    -------
    (2,) array
        m.
    """
    assert tracks.pivot_m is not None
    if tracks.eye_m is None or tracks.spherical:
        return tracks.pivot_m
    half = _half_thickness(inputs)
    telling = abs(tracks.face_slant or 0.0) > _PLAINLY * tracks.face_slant_std
    if telling and _shows_its_face(tracks, inputs):
        half = (tracks.edge_offset_m - tracks.middle_offset_m) / abs(tracks.face_slant or 1.0)
    nearer = NEAR_SHARE * half / float(tracks.eye_m[2])
    foot = tracks.eye_m[:2]
    return np.asarray(foot + (tracks.pivot_m - foot) / (1.0 + nearer))


def offset_of_face(
    tracks: MetricTracks,
    inputs: Inputs,
    radius: float,
    onset: float,
    told: FaceTold | None = None,
) -> tuple[FaceTold, tuple[FaceWay, ...]]:
    """Offset of the face before contact is looked at: as seen, and from the impact angle.

    Parameters
    ----------
    tracks : MetricTracks
        With a pendulum.
    inputs : Inputs
        Its numbers.
    radius : float
        Of the ball, m.
    onset : float
        About when they touch, s.
    told : FaceTold, optional
        What tells it, where that is settled.

    Returns
    -------
    told : FaceTold
    ways : tuple of FaceWay
        One that two agree on; or each that may hold, and that none does.
    """
    assert tracks.pivot_m is not None
    pivot = pivot_in_plane(tracks, inputs)
    arm = tracks.rest_m - pivot
    seen, seen_std = _seen_offset(tracks, inputs)
    phi = float(np.interp(onset, tracks.swing_time_s, tracks.swing_rad))
    seen += float((tracks.pivot_m - pivot) @ [np.cos(phi), np.sin(phi)])
    angle = inputs.rig.launch_angle
    elsewhere = _elsewhere(seen, seen_std, radius)
    if angle is None:
        return FaceTold.SEEN, (FaceWay(seen, seen_std, 1.0 - elsewhere.share), elsewhere)
    cosine, sine = math.cos(angle.value), math.sin(angle.value)
    written = float(arm[0] * cosine + arm[1] * sine) - radius
    pivot_std = PIVOT_SHARE * _half_thickness(inputs)
    written_std = math.hypot(IMPACT_ANGLE_STD * float(np.hypot(*arm)), pivot_std)
    if told is None:
        told = FaceTold.BOTH
        if angle.value_from is Origin.PRESET and not _arm_as_presets(arm, phi):
            told = FaceTold.SEEN
        elif abs(seen - written) > _TWO_WAYS_APART * math.hypot(seen_std, written_std):
            told = FaceTold.EITHER
    if told is FaceTold.SEEN:
        return told, (FaceWay(seen, seen_std, 1.0 - elsewhere.share), elsewhere)
    if told is FaceTold.EITHER:
        share = 0.5 * (1.0 - elsewhere.share)
        by_eye, by_hand = FaceWay(seen, seen_std, share), FaceWay(written, written_std, share)
        return told, (by_eye, by_hand, elsewhere)
    weights = np.array([seen_std, written_std]) ** -2.0
    lead = float(weights @ [seen, written] / weights.sum())
    return told, (FaceWay(lead, float(weights.sum() ** -0.5)),)


def _elsewhere(seen: float, seen_std: float, radius: float) -> FaceWay:
    """Where the face is if what is seen for it is something else of the mass."""
    std = math.hypot(seen_std, ELSEWHERE_STD_RADII * radius)
    return FaceWay(seen, std, ELSEWHERE_SHARE, ON_THE_MASS_RADII * radius / std)


def _arm_as_presets(arm: FloatArray, phi: float) -> bool:
    """Whether an arm (2,), m, may be that of the rig to which the presets' impact angles belong."""
    usual = bodies.PAPER_PENDULUM.length
    return abs(float(arm_along_bar(arm, phi)) - usual) < _ANOTHER_ARM * usual


def _seen_offset(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """Offset of the face's middle: between its rims, or behind the foremost edge, m, and std."""
    if _shows_its_face(tracks, inputs) and not tracks.spherical:
        return tracks.middle_offset_m, float(
            np.hypot(tracks.middle_offset_std_m, _off_centre(tracks))
        )
    outside, outside_std = _outline_outside(tracks, inputs)
    seen, seen_std = (
        tracks.edge_offset_m - outside,
        float(np.hypot(tracks.edge_offset_std_m, outside_std)),
    )
    if tracks.spherical:
        # the line of sight to a sphere's edge touches it behind or before the plane of its middle
        return seen / math.hypot(1.0, tracks.face_slant or 0.0), seen_std
    ahead, ahead_std = _edge_before_face(tracks, inputs)
    return seen - ahead, float(np.hypot(seen_std, ahead_std))


def _outline_outside(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """How far outlines lie outside what they are of, m, and how well that is known.

    Where half the light lies in a blurred edge hangs on the camera's transfer curve and sharpening,
    which nobody knows: it moves every edge of a dark thing before a bright wall alike. The ball,
    whose size is known, shows by how much; between two rims of one strip it cancels.
    """
    if inputs.ball is None or not tracks.by_the_wall:
        return 0.0, 0.0
    outside = tracks.radius_m - 0.5 * inputs.ball.diameter
    if abs(outside) > MOST_OUTSIDE_SHARE * tracks.radius_m:
        return 0.0, MOST_OUTSIDE_SHARE * tracks.radius_m
    return outside, OUTSIDE_STD_SHARE * abs(outside)


def _shows_its_face(tracks: MetricTracks, inputs: Inputs) -> bool:
    """Whether the strip seen is as wide as the face of such a mass can look from there."""
    if not np.isfinite(tracks.middle_offset_std_m):
        return False
    if tracks.face_slant is None:
        low, high = 0.0, UNSEEN_SLANT
    else:
        std = tracks.face_slant_std
        low, high = -tracks.face_slant - std, -tracks.face_slant + std
    strip = (tracks.edge_offset_m - tracks.middle_offset_m) / _half_thickness(inputs)
    return THICKNESSES[0] * low < strip < THICKNESSES[1] * high


def _off_centre(tracks: MetricTracks) -> float:
    """What a ball that is not struck in the middle of the face's depth shifts, m."""
    return STRUCK_OFF_CENTRE_M * abs(tracks.face_slant or UNSEEN_SLANT)


def _edge_before_face(tracks: MetricTracks, inputs: Inputs) -> tuple[float, float]:
    """How far the foremost edge seen lies ahead of the middle of the face, m, and its uncertainty.

    From a camera off to one side, the near or the far edge of a thick mass stands out ahead of
    where the face meets the ball.
    """
    half = _half_thickness(inputs)
    if tracks.face_slant is None:
        return 0.0, UNSEEN_SLANT * half
    ahead = abs(tracks.face_slant) * half
    return ahead, half * float(np.hypot(THICKNESS_SHARE * tracks.face_slant, tracks.face_slant_std))


def _half_thickness(inputs: Inputs) -> float:
    """Half the thickness of the mass, m, were it a cube of steel."""
    return float(0.5 * (inputs.pendulum.mass / STEEL) ** (1.0 / 3.0))


BoolArray = NDArray[np.bool_]

UNSEEN_HALF_CONTACT_S, UNSEEN_HALF_CONTACT_STD_S = 0.006, 0.003

"""Middle to end of a contact nobody sees: inflated balls stay on for 10 to 20 ms."""

SWING_STRETCH_S = 0.08

"""s of a swing on either side: a twentieth of the paper's period of 1.5 s, over which damping and
bearing friction do not show."""

NEAR_BEFORE_S, NEAR_AFTER_S = 0.01, 0.005

"""s, before onset and after release: frames that show where ball and face part, beside the contact
itself."""

_ROUNDS = 3

"""Rounds of choosing frames and fitting, supposed: the choice hangs on onset and release, which the
next round hardly moves."""

FAR_RADII = 0.5

"""So far from its rest a ball is on its way: shadows and the face beside it feign less."""

STRAY_RADII = 0.15

"""Radii by which the median frame may be off a free flight: more is another thing than a flying
ball."""

PLACED_RADII, SAME_BALL, LOOKS_AT_REST = 0.3, 0.15, 3
"""Radii within which a ball was put back, log radius by which outlines of one ball differ, and
looks, of which three agree by chance hardly ever; supposed."""

FRAMES_AT_REST = 5

"""What lies at the place of rest for so many frames is no bounce that passes it."""

USUAL_SPEED = 2.5

"""m/s: a speed of approach of the paper's strikes; the longest contact hardly depends on it."""

LEAST_COR, MOST_COR = 0.1, 1.15

"""COR, dimensionless: no passive contact returns more speed than it takes, but the measurement may
by a little; below a tenth it did not bounce."""


@dataclass(frozen=True)
class Impact:
    """A strike in the ball plane.

    Attributes
    ----------
    tracks : MetricTracks
        What it was fitted to.
    flight : FlightFit
        After release.
    free_flight : FlightFit
        The same with gravity left to the data.
    view, contact : ImpactView and ContactFit, or None
        None where there is no pendulum, or it can't be followed on both sides; `reason` says why.
    reason : str
    last_flight_s : float
        Last frame of the flight that is in view, s.
    paths_contradict : bool
        Whether mass and ball would part before they meet: the flight may be the wrong one.
    landing : LandingSeen or None
        Touch-down from the frames around it alone; `landing_reason` says why there is none.
    landing_reason : str
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
    paths_contradict: bool = False


def departure(tracks: MetricTracks) -> float:
    """Time at which the ball has visibly left its rest, s.

    Raises
    ------
    NotFoundError
        If it never does.
    """
    std = np.sqrt(np.trace(tracks.ball_cov_m2, axis1=1, axis2=2))
    moved = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    away = moved > np.maximum(6.0 * std, 6.0 * float(np.hypot(*tracks.rest_std_m)))
    gone = away & (moved > FAR_RADII * tracks.radius_m)
    sustained = gone & np.append(gone[1:], gone[-1]) & np.append(gone[2:], [gone[-1]] * 2)
    places = np.flatnonzero(sustained)
    if len(places) == 0:
        raise NotFoundError(
            "the ball never leaves its rest in this clip",
            hint="Film the strike itself, or point at the ball with --ball-at X,Y.",
        )
    # back along the flight: what disturbed the outline while the ball lay still is not its start
    lying = np.flatnonzero(~away[: places[0]])
    first = 0 if len(lying) == 0 else int(lying[-1]) + 1
    return float(tracks.ball_time_s[first])


def struck_again(tracks: MetricTracks, flown: float) -> float | None:
    """When the ball lies at its rest again and then leaves it once more, s; None if it does not.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    flown : float
        Last frame of the flight that was measured, s.
    """
    away = np.hypot(*(tracks.ball_m - tracks.rest_m).T)
    lying = np.flatnonzero((tracks.ball_time_s > flown) & (away < STRAY_RADII * tracks.radius_m))
    if len(lying) < FRAMES_AT_REST or not np.any(away[lying[-1] :] > tracks.radius_m):
        return None
    return float(tracks.ball_time_s[lying[0]])


def strikes_apart(tracks: Tracks) -> tuple[FollowedObject, ...]:
    """Other strikes of the clip: balls as large that lay where the ball did, and left, too.

    Parameters
    ----------
    tracks : Tracks
        As followed, px.
    """
    if tracks.rest_frames is None:
        return ()
    ball, (first, last) = tracks.ball, tracks.rest_frames
    radius = float(np.median(ball.radius_px))
    still = (ball.frame >= first) & (ball.frame <= last)
    if not np.any(still):
        return ()
    rest = np.median(ball.centre_px[still], axis=0)
    return tuple(other for other in tracks.others if _lay_at(other.track, rest, radius, ball))


def _lay_at(track: Track, rest: FloatArray, radius: float, ball: Track) -> bool:
    """Whether a ball lay at a place while the other was not there, and left it."""
    away = np.hypot(*(track.centre_px - rest).T)
    lying = np.flatnonzero(away < PLACED_RADII * radius)
    if len(lying) < LOOKS_AT_REST or not np.any(away[lying[-1] :] > radius):
        return False
    there = ball.frame[np.hypot(*(ball.centre_px - rest).T) < radius]
    alike = abs(float(np.log(np.median(track.radius_px) / radius))) < SAME_BALL
    return alike and not np.any(np.isin(track.frame[lying], there))


def find_impact(
    tracks: MetricTracks, inputs: Inputs, started: tuple[float, float, float] | None = None
) -> Impact:
    """Fit swing, flight and contact, each on its own frames; the events settle in a few rounds.

    Parameters
    ----------
    tracks : MetricTracks
        Ball plane.
    inputs : Inputs
        Forces and bodies.
    started : (3,) tuple of float, optional
        Onset and release to start from, and the end of the flight, s.

    Raises
    ------
    NotFoundError, TooLittleDataError
        If the ball never leaves, or is not seen long enough after it left.
    """
    left = departure(tracks)
    onset, release, landed = started or (
        left - 0.008,
        left + LONGEST_CONTACT_S,
        flight_end(tracks, inputs, left),
    )
    view: ImpactView | None = None
    contact: ContactFit | None = None
    reason = "no pendulum mass is found in the clip; point at it with --mass-at X,Y"
    contradict = False
    told: FaceTold | None = None
    flight = _flight(tracks, inputs, release, landed, free=False)
    for _ in range(_ROUNDS if started is None else 1):
        if tracks.pivot_m is None:
            break
        view = None
        try:
            view = _view(tracks, inputs, flight, _Frames.of(tracks, onset, release), told=told)
            view, contact = _contact_told(view, tracks, inputs, 0.5 * (onset + release))
            told = view.face_told
        except MeasurementError as problem:
            contradict = view is not None and isinstance(problem, NoFitError)
            view, contact, reason = None, None, problem.in_one_line
            break
        onset, release = contact.onset_s, contact.release_s
        flight = _flight(tracks, inputs, release, landed, free=False)
        view = replace(view, flight=flight)
    if view is not None and contact is not None:
        reason = _not_the_striker(view, contact)
        if reason:
            view, contact = None, None
            flight = _flight(tracks, inputs, left + LONGEST_CONTACT_S, landed, free=False)
    since = release if contact is not None else left + LONGEST_CONTACT_S
    if contact is None:
        # the corner of rest and flight is the middle of the push; release comes half a contact on
        # and a flight that does not fit (a wrong rate) may have its corner anywhere
        near = LONGEST_CONTACT_S + 2.0 * float(np.median(np.diff(tracks.ball_time_s)))
        corner = float(np.clip(_corner(tracks, flight), left - near, left + near))
        release = corner + UNSEEN_HALF_CONTACT_S
        flight = _flight(tracks, inputs, release, landed, free=False, since=since)
    free = _flight(tracks, inputs, release, landed, free=True, since=since)
    _require_flight(free, tracks)
    landing, unseen = _landing(tracks, inputs, flight)
    last = float(flight.time_s[-1])
    return Impact(tracks, flight, free, view, contact, reason, last, landing, unseen, contradict)


def _landing(
    tracks: MetricTracks, inputs: Inputs, flight: FlightFit
) -> tuple[LandingSeen | None, str]:
    """Touch-down as it is seen, or why it is not."""
    if inputs.fall is None:
        return None, "the height of the support is not known; give [support] height"
    lands_at = flight.falls_to(float(tracks.rest_m[1]) - inputs.fall)
    if lands_at is None:
        return None, "the flight does not come down to the floor"
    try:
        return landing_seen(tracks, inputs, lands_at), ""
    except NotFoundError as problem:
        return None, problem.in_one_line


def moved_impact(near: Impact, tracks: MetricTracks, inputs: Inputs) -> Impact:
    """The impact after its inputs moved a little, every fit to first order on the same frames.

    Parameters
    ----------
    near : Impact
        Before.
    tracks : MetricTracks
        The same frames after the move.
    inputs : Inputs
        After the move.

    Raises
    ------
    NotFoundError
        If face and ball never meet any more.
    """
    # the clock may be what moves
    share = float(tracks.ball_time_s[-1] / near.tracks.ball_time_s[-1])
    flight = _moved_flight(near.tracks, near.flight, tracks, inputs, share, free=False)
    free = _moved_flight(near.tracks, near.free_flight, tracks, inputs, share, free=True)
    if near.view is None or near.contact is None:
        shift = _corner(tracks, flight) - share * _corner(near.tracks, near.flight)
        flight = flight.restarted(flight.reference_s + shift)
        near = replace(near, tracks=tracks, flight=flight, free_flight=free)
        return replace(near, landing=_landing(tracks, inputs, flight)[0])
    frames = _Frames.of(near.tracks, near.view.before.reference_s, near.view.after.reference_s)
    view = _view(tracks, inputs, flight, frames.on_clock(share), near.view)
    middle = 0.5 * share * (near.contact.onset_s + near.contact.release_s)
    contact = fit_contact(view, middle, doubting=False)
    near = replace(near, tracks=tracks, flight=flight, free_flight=free, view=view, contact=contact)
    return replace(near, landing=_landing(tracks, inputs, flight)[0])


def _moved_flight(
    before: MetricTracks,
    near: FlightFit,
    tracks: MetricTracks,
    inputs: Inputs,
    share: float,
    *,
    free: bool,
) -> FlightFit:
    used = np.isin(before.ball_time_s, near.time_s)
    return _fitted_flight(tracks, inputs, used, share * near.reference_s, free=free, near=near)


def _not_the_striker(view: ImpactView, contact: ContactFit) -> str:
    """Why the mass followed can't be what struck the ball; empty where it can."""
    approach, parting = face_speeds(view, contact.onset_s, contact.release_s)
    if approach > 0.0 and LEAST_COR < parting / approach < MOST_COR:
        return ""
    return (
        f"what was followed as the mass meets the ball at {approach:.2f} m/s and parts from it at "
        f"{parting:.2f} m/s, which no strike does: a shadow, perhaps; point at the mass with "
        "--mass-at X,Y, or check --fps and the pendulum's numbers"
    )


def _require_flight(free: FlightFit, tracks: MetricTracks) -> None:
    """Refuse what does not move like a ball in the air: a pendulum, a hand, a rolling ball."""
    off = float(np.median(np.hypot(*free.residual_m.T)))
    if off > STRAY_RADII * tracks.radius_m:
        raise NotFoundError(
            f"what was followed does not fly: its path is {100 * off:.1f} cm off any flight",
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
    """Where the flight's line meets the place of rest: the middle of an unseen contact, s."""
    state = flight.states(np.array([flight.reference_s]))[0]
    velocity = state[2:]
    back = float((tracks.rest_m - state[:2]) @ velocity / (velocity @ velocity))
    return flight.reference_s + back


@dataclass(frozen=True)
class _Frames:
    """Which frames tell of a contact from onset to release, s: of the pendulum and of the ball."""

    onset: float
    release: float
    swing_before: BoolArray
    swing_after: BoolArray
    swing_near: BoolArray
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
            (time > begin) & (time < end),
            (ball > begin) & (ball < end),
        )

    def on_clock(self, share: float) -> "_Frames":
        """The same frames where a second has become `share` of one."""
        return replace(self, onset=share * self.onset, release=share * self.release)


def _view(
    tracks: MetricTracks,
    inputs: Inputs,
    flight: FlightFit,
    frames: _Frames,
    moved_from: ImpactView | None = None,
    *,
    told: FaceTold | None = None,
) -> ImpactView:
    assert tracks.pivot_m is not None
    time = tracks.swing_time_s
    stiffness = inputs.pendulum_stiffness
    spread = inputs.rig.stiffness_share * stiffness

    def swing(used: BoolArray, reference_s: float, near: SwingFit | None) -> SwingFit:
        angle, std = tracks.swing_rad[used], tracks.swing_std_rad[used]
        return fit_swing(time[used], angle, std, reference_s, stiffness, spread, near)

    radius = tracks.radius_m if inputs.ball is None else 0.5 * inputs.ball.diameter
    if moved_from is not None:
        told = moved_from.face_told
    near, swinging = frames.ball_near, frames.swing_near
    view = ImpactView(
        before=swing(frames.swing_before, frames.onset, moved_from.before if moved_from else None),
        after=swing(frames.swing_after, frames.release, moved_from.after if moved_from else None),
        flight=flight,
        rest=tracks.rest_m,
        rest_std=tracks.rest_std_m,
        pivot=pivot_in_plane(tracks, inputs),
        radius=radius,
        time_s=tracks.ball_time_s[near],
        position_m=tracks.ball_m[near],
        std_m=np.sqrt(0.5 * np.trace(tracks.ball_cov_m2[near], axis1=1, axis2=2)),
        swing_time_s=time[swinging],
        swing_rad=tracks.swing_rad[swinging],
        swing_std_rad=tracks.swing_std_rad[swinging],
        face_offset=0.0,
        face_offset_std=math.inf,
        longest_s=_longest_contact(inputs),
        bob_arm=tracks.bob_arm_m,
    )
    return _with_face(view, tracks, inputs, frames.onset, told)


def _with_face(
    view: ImpactView, tracks: MetricTracks, inputs: Inputs, onset: float, told: FaceTold | None
) -> ImpactView:
    """The view with where the face is before contact is looked at."""
    told, (first, *others) = offset_of_face(tracks, inputs, view.radius, onset, told)
    return replace(
        view,
        face_offset=first.lead,
        face_offset_std=first.std,
        face_otherwise=tuple(others),
        face_told=told,
    )


def _contact_told(
    view: ImpactView, tracks: MetricTracks, inputs: Inputs, around_s: float
) -> tuple[ImpactView, ContactFit]:
    """The contact, and the view that led to it.

    Where what is seen of the face and the written angle rule out any contact together, one of the
    two is wrong.
    """
    try:
        return view, fit_contact(view, around_s)
    except MeasurementError:
        if view.face_told is not FaceTold.BOTH:
            raise
    view = _with_face(view, tracks, inputs, view.before.reference_s, FaceTold.EITHER)
    return view, fit_contact(view, around_s)


def _longest_contact(inputs: Inputs) -> float:
    """The longest that such a ball stays in touch, s; infinite where its mass is unknown."""
    ball = inputs.ball
    if ball is None or ball.mass is None:
        return np.inf
    face = inputs.pendulum.mass_at_contact
    return contact_time_bound(ball.mass, ball.diameter, face, USUAL_SPEED).longest


_LINE_FRAMES = 10

"""Frames of a line on either side of the meeting: gliding discs slow down little over them."""

RADIUS_STD_PX = 0.3

"""px, of the distance of two outlines at their touch, supposed: the edges of both, blurred by
motion."""


@dataclass(frozen=True)
class DiscContact:
    """When two round bodies met.

    Attributes
    ----------
    time_s, std_s : float
        The meeting, s from the first frame.
    longest_s : float
        The contact lasted no longer than this (k = 2).
    """

    time_s: float
    std_s: float
    longest_s: float


def disc_contact(tracks: Tracks) -> DiscContact | None:
    """Find when the striker met the struck ball.

    The striker's gap closes along a line that reaches zero at first touch; the struck ball leaves
    along a line that started at its rest. Between the two lies the contact.

    Parameters
    ----------
    tracks : Tracks
        With the struck ball as `ball` and the striker as the first of `others`.

    Returns
    -------
    DiscContact or None
        None where there is no striker, or it is not seen on both sides.
    """
    if tracks.pendulum is not None or not tracks.others or tracks.rest_frames is None:
        return None
    ball, striker, last = tracks.ball, tracks.others[0].track, tracks.rest_frames[1]
    still = ball.frame <= last - 1
    if still.sum() < 3:
        return None
    rest = np.median(ball.centre_px[still], axis=0)
    reach = float(np.median(ball.radius_px) + np.median(striker.radius_px))
    gap = np.hypot(*(striker.centre_px - rest).T) - reach
    closing = _line_to_zero(
        striker, gap, (striker.frame < last) & (striker.frame >= last - _LINE_FRAMES)
    )
    away = np.hypot(*(ball.centre_px - rest).T)
    leaving = _line_to_zero(
        ball, away, (ball.frame > last + 1) & (ball.frame <= last + _LINE_FRAMES)
    )
    if closing is None or leaving is None:
        return None
    touch, touch_std, speed = closing
    touch_std = math.hypot(touch_std, RADIUS_STD_PX / abs(speed))
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
    """Time at which a line through distances reaches zero, its std, and the slope (px/s)."""
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
