"""When mass and ball touch, between frames (Fig. 13).

Before and after contact the gap between face and ball follows from free swing, rest and flight,
each fitted on its own side only. What the gap leaves open is how far the face leads the bar; the
way the ball moves while it is pushed tells that: a longer contact rounds the corner between rest
and flight.

The shape of a contact: how far the ball has come while the force between mass and ball lasts.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from metrology import NotFoundError
from physics.contact import damping_for_cor
from pipelines.measure.flight_fit import FlightFit, SwingFit, slow_error_whitening

__all__ = [
    "ContactFit",
    "ImpactView",
    "arm_along_bar",
    "face_speeds",
    "fit_contact",
    "gap_after",
    "gap_before",
    "touch_times",
]

FloatArray = NDArray[np.float64]

_POINTS = 201
"""Points of a tabulated pulse: a half sine drawn through them is off by (π/200)²/8, or 3e-5 of its
peak, at most."""

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
    exponent = 1.0 + step * _STEP
    damping = float(damping_for_cor(cor))

    def rates(_: float, state: FloatArray) -> list[float]:
        compression, rate = float(state[0]), float(state[1])
        force = max(compression, 0.0) ** exponent * max(1.0 + damping * rate, 0.0)
        return [rate, -force]

    def released(time: float, state: FloatArray) -> float:
        return float(state[0]) if time > 0.1 else 1.0

    released.terminal = True  # type: ignore[attr-defined]
    solution = scipy.integrate.solve_ivp(
        rates, (0.0, 50.0), [0.0, 1.0], events=released, rtol=1e-8, atol=1e-10, dense_output=True
    )
    duration = float(solution.t[-1])
    dense: Any = solution.sol
    phase = np.linspace(0.0, 1.0, _POINTS)
    compression, rate = dense(phase * duration)
    speed = 1.0 - rate
    path = scipy.integrate.cumulative_trapezoid(speed / speed[-1], phase, initial=0)
    return ContactPulse(phase, compression / duration, path)


# Inflated balls lie between a linear spring and Hertz's 3/2 (Cross, Am. J. Phys. 67, 222, 1999).
EXPONENT, EXPONENT_STD = 1.3, 0.12

OUTLINE_AHEAD, OUTLINE_AHEAD_STD = 0.05, 0.06

"""Share of the compression by which the middle of the fitted outline is ahead of the ball's centre.

The outline's rear is pressed in by the whole compression, its front is not: a circle through all of
it moves ahead by up to half, one that leaves the rear out by nothing; robust fits leave most of it
out."""

# How far balls' paths through the contact differ from such a law's, over the speed gained × Δt.
SHAPE_STD = 0.003

# What is tried: offsets in standard uncertainties of the prior, exponents in the law's range.
_OFFSETS = np.linspace(-3.0, 3.0, 19)

_EXPONENTS = np.linspace(1.1, 1.5, 4)
"""Exponents of the force law that are integrated over: within 1.7 standard deviations of the usual
one."""

_SOFT_FROM = 2.0

BOUND_SHARE = 0.05

"""Share: how sharp the bound of contact times is; damping makes a contact some per cent longer."""

CONTRADICTS = 9.0

"""Twice the log-likelihood that is lost where the bound contradicts what is seen: 3 sigma."""

COR_STD = 0.05
"""Dimensionless, between the COR of the speeds and that of a contact head-on, supposed: friction
and spin take their part of an oblique blow."""


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
        How far the face leads the line from pivot to mass, as seen.
    longest_s : float
        The longest contact that such a ball can have (`physics.contact`), s.
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


def fit_contact(view: ImpactView, around_s: float) -> ContactFit:
    """Fit onset and release.

    Parameters
    ----------
    view : ImpactView
        Both sides of the contact.
    around_s : float
        A time near the contact, s.

    Raises
    ------
    NotFoundError
        If face and ball never meet, or never part, or if no such ball stays in touch so long.
    """
    offsets = view.face_offset + view.face_offset_std * _OFFSETS
    whitening = _Whitening(
        slow_error_whitening(view.time_s, offset=True),
        slow_error_whitening(view.swing_time_s, offset=True),
    )
    tried = _all_tried(view, whitening, offsets, around_s)
    if all(one is None for one in tried):
        raise NotFoundError(
            "the mass and the ball never meet along their paths",
            hint="Check --ball-at and --mass-at, or film square to the plane of the swing.",
        )
    likely = min((one for one in tried if one is not None), key=lambda one: one.cost(1.0))
    left = likely.left
    widened = max(1.0, float(np.mean(np.minimum(left**2, 9.0))))
    cost = np.array([np.inf if one is None else one.cost(widened) for one in tried])
    cost += _OFFSETS**2
    beyond = _beyond(tried, view.longest_s)
    if float((cost + beyond).min()) > float(cost.min()) + CONTRADICTS:
        raise _too_long(likely, view)
    cost += beyond
    share = np.exp(-0.5 * (cost - cost.min()))
    share /= share.sum()
    face_offset = float(share @ offsets)
    std = float(np.sqrt(share @ (offsets - face_offset) ** 2))
    found = _all_tried(view, whitening, np.array([face_offset]), around_s)[0] or likely
    return ContactFit(found.onset_s, found.release_s, face_offset, std, found.exponent, found.left)


def _beyond(tried: "list[_Tried | None]", longest_s: float) -> FloatArray:
    """Prior penalty of contacts that last longer than the ball can, for each offset."""
    last = [0.0 if one is None else one.release_s - one.onset_s for one in tried]
    over = np.maximum(np.array(last) / longest_s - 1.0, 0.0)
    return np.asarray((over / BOUND_SHARE) ** 2)


def _too_long(likely: "_Tried", view: ImpactView) -> NotFoundError:
    lasts = 1e3 * (likely.release_s - likely.onset_s)
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
    """An offset of the face with the contact it implies, and how well that fits."""

    onset_s: float
    release_s: float
    exponent: float
    left: FloatArray
    priors: float

    def cost(self, widened: float) -> float:
        """Robust sum of squares, residuals over the root of `widened`, and the priors."""
        soft = _SOFT_FROM**2 * 2.0 * (np.sqrt(1.0 + self.left**2 / _SOFT_FROM**2) - 1.0)
        return float(soft.sum()) / widened + self.priors


def _all_tried(
    view: ImpactView, whitening: _Whitening, offsets: FloatArray, around_s: float
) -> list[_Tried | None]:
    """For each offset the best of a few exponents, with the outline's lag solved for."""
    onset, release = _touches(view, offsets, around_s)
    meet = np.isfinite(onset) & np.isfinite(release)
    found: list[_Tried | None] = [None] * len(offsets)
    if not meet.any():
        return found
    ends = _Ends.of(view, onset[meet], release[meet])
    left, per_lag = _path_residuals(view, whitening, ends, _EXPONENTS)
    left = left - OUTLINE_AHEAD * per_lag
    lag = (per_lag * left).sum(axis=0) / ((per_lag**2).sum(axis=0) + OUTLINE_AHEAD_STD**-2)
    priors = ((_EXPONENTS - EXPONENT) / EXPONENT_STD) ** 2 + (lag / OUTLINE_AHEAD_STD) ** 2
    for place, index in enumerate(np.flatnonzero(meet)):
        alike = [
            _Tried(
                float(ends.onset_s[place]),
                float(ends.onset_s[place] + ends.duration[place]),
                float(exponent),
                left[:, place, column] - lag[place, column] * per_lag[:, place, column],
                float(priors[place, column]),
            )
            for column, exponent in enumerate(_EXPONENTS)
        ]
        found[index] = min(alike, key=lambda one: one.cost(1.0))
    return found


def touch_times(view: ImpactView, face_offset: float, around_s: float) -> tuple[float, float]:
    """Onset and release for a given offset of the face, s; NaN where they never meet."""
    onset, release = _touches(view, np.array([face_offset]), around_s)
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


def _touches(
    view: ImpactView, offsets: FloatArray, around_s: float
) -> tuple[FloatArray, FloatArray]:
    """Onset and release (L,) for offsets of the face (L,), s; NaN where they never meet or part."""
    grid = around_s + np.linspace(-0.06, 0.06, 121)
    closing, opening = gap_before(view, grid), gap_after(view, grid)
    onset = np.array([_crossing(grid, closing - face_offset) for face_offset in offsets])
    release = np.array([_crossing(grid, face_offset - opening) for face_offset in offsets])
    return onset, np.maximum(release, onset + 1e-4)


def _crossing(time_s: FloatArray, gap: FloatArray) -> float:
    """Where a gap falls through zero, from a cubic through its neighbourhood, s; NaN if nowhere."""
    places = np.flatnonzero((gap[:-1] > 0) & (gap[1:] <= 0))
    if len(places) == 0:
        return math.nan
    place = int(places[0])
    lo, hi = max(place - 2, 0), min(place + 4, len(gap))
    # time as a cubic of the gap in units of its size here, by its four nearest powers
    scale = float(np.abs(gap[lo:hi]).max())
    powers = (gap[lo:hi, np.newaxis] / scale) ** np.arange(4)
    return float(time_s[lo] + np.linalg.lstsq(powers, time_s[lo:hi] - time_s[lo])[0][0])


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
    view: ImpactView, whitening: _Whitening, ends: _Ends, exponents: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals of ball, pendulum and COR, and what one unit of outline lag adds.

    Both (R, L, E) for L contacts and E exponents.
    """
    shape = (len(ends.duration), len(exponents))
    pulses = [[contact_pulse(float(n), float(e)) for n in exponents] for e in ends.cor]
    path, lagging = np.empty((2, len(view.time_s), *shape))
    swung = np.empty((len(view.swing_time_s), *shape))
    for index, (onset, duration) in enumerate(zip(ends.onset_s, ends.duration, strict=True)):
        phase = (view.time_s - onset) / duration
        swing_phase = (view.swing_time_s - onset) / duration
        for column, pulse in enumerate(pulses[index]):
            path[:, index, column] = duration * _way(pulse, phase)
            lagging[:, index, column] = np.interp(phase, pulse.phase, pulse.compression)
            swung[:, index, column] = duration * _way(pulse, swing_phase)
    lagging *= (ends.approach * ends.duration)[:, np.newaxis]
    moved = (view.position_m - view.rest) @ ends.normal.T
    std = np.hypot(view.std_m[:, np.newaxis], SHAPE_STD * ends.speed * ends.duration)
    off = (moved[..., np.newaxis] - path * ends.speed[:, np.newaxis]) / std[..., np.newaxis]
    ball = whitening.ball(off)
    held = whitening.mass(_pendulum_held_back(view, ends, swung))
    speeds = np.broadcast_to(ends.by_speeds[:, np.newaxis], (1, *shape))
    left = np.concatenate([ball, held, speeds])
    per_lag = np.zeros_like(left)
    per_lag[: len(view.time_s)] = whitening.ball(lagging / std[..., np.newaxis])
    return left, per_lag


def _way(pulse: ContactPulse, phase: FloatArray) -> FloatArray:
    """Way gone at phases of a contact and after it, over speed at release × duration."""
    return np.asarray(np.interp(phase, pulse.phase, pulse.path) + np.maximum(phase - 1.0, 0.0))


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
