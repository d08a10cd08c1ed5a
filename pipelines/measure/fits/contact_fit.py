"""When mass and ball touch, between frames (Fig. 13).

Before and after contact the gap between face and ball follows from free swing, rest and flight,
each fitted on its own side only. What the gap leaves open is how far the face leads the bar; the
way the ball moves while it is pushed tells that: a longer contact rounds the corner between rest
and flight.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrology import NotFoundError
from pipelines.measure.fits.flight_fit import FlightFit
from pipelines.measure.fits.pulse import ContactPulse, contact_pulse
from pipelines.measure.fits.slow_errors import slow_error_whitening
from pipelines.measure.fits.swing_fit import SwingFit

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

# Inflated balls lie between a linear spring and Hertz's 3/2 (Cross, Am. J. Phys. 67, 222, 1999).
EXPONENT, EXPONENT_STD = 1.3, 0.12
# Share of the compression by which the middle of the visible outline lags the centre of mass.
OUTLINE_LAG_STD = 0.08
# How far balls' paths through the contact differ from such a law's, over the speed gained × Δt.
SHAPE_STD = 0.003
# What is tried: leads in standard uncertainties of what was known, exponents in the law's range.
_LEADS = np.linspace(-3.0, 3.0, 19)
_EXPONENTS = np.linspace(1.1, 1.5, 4)
_SOFT_FROM = 2.0
# Between the COR of the speeds and that of a contact head-on.
COR_STD = 0.05


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
    lead, lead_std : float
        How far the face leads the line from pivot to mass, as seen.
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
    lead: float
    lead_std: float


@dataclass(frozen=True)
class ContactFit:
    """The contact.

    Attributes
    ----------
    onset_s, release_s : float
        First and last touch, s from the first frame.
    lead, lead_std : float
        Fitted lead of the face, m.
    exponent : float
        Exponent of the contact law that the fit preferred.
    residuals : (M,) array
        Standardised residuals of the ball's path through the contact.
    """

    onset_s: float
    release_s: float
    lead: float
    lead_std: float
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
        If face and ball never meet, or never part.
    """
    leads = view.lead + view.lead_std * _LEADS
    whitening = _Whitening(
        slow_error_whitening(view.time_s, offset=True),
        slow_error_whitening(view.swing_time_s, offset=True),
    )
    tried = [_tried(view, whitening, float(lead), around_s) for lead in leads]
    if all(one is None for one in tried):
        raise NotFoundError(
            "the mass and the ball never meet along their paths",
            hint="Check --ball-at and --mass-at, or film square to the plane of the swing.",
        )
    likely = min((one for one in tried if one is not None), key=lambda one: one.cost(1.0))
    left = likely.left
    widened = max(1.0, float(np.mean(np.minimum(left**2, 9.0))))
    cost = np.array([np.inf if one is None else one.cost(widened) for one in tried])
    cost += _LEADS**2
    share = np.exp(-0.5 * (cost - cost.min()))
    share /= share.sum()
    lead = float(share @ leads)
    std = float(np.sqrt(share @ (leads - lead) ** 2))
    found = _tried(view, whitening, lead, around_s) or likely
    return ContactFit(found.onset_s, found.release_s, lead, std, found.exponent, found.left)


@dataclass(frozen=True)
class _Whitening:
    """What turns standardised residuals of ball and mass into independent ones."""

    ball: Callable[[FloatArray], FloatArray]
    mass: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class _Tried:
    """A lead of the face with the contact it implies, and how well that fits."""

    onset_s: float
    release_s: float
    exponent: float
    left: FloatArray
    priors: float

    def cost(self, widened: float) -> float:
        """Robust sum of squares, residuals over the root of `widened`, and the priors."""
        soft = _SOFT_FROM**2 * 2.0 * (np.sqrt(1.0 + self.left**2 / _SOFT_FROM**2) - 1.0)
        return float(soft.sum()) / widened + self.priors


def _tried(view: ImpactView, whitening: _Whitening, lead: float, around_s: float) -> _Tried | None:
    """The best of a few exponents, with the outline's lag solved for."""
    touch = _touch(view, lead, around_s)
    if touch is None:
        return None
    onset, release = touch
    ends = _Ends.of(view, onset, release)
    best: _Tried | None = None
    for exponent in _EXPONENTS:
        left, per_lag = _path_residuals(view, whitening, ends, float(exponent))
        lag = float(per_lag @ left) / (float(per_lag @ per_lag) + OUTLINE_LAG_STD**-2)
        priors = ((exponent - EXPONENT) / EXPONENT_STD) ** 2 + (lag / OUTLINE_LAG_STD) ** 2
        one = _Tried(onset, release, float(exponent), left - lag * per_lag, float(priors))
        if best is None or one.cost(1.0) < best.cost(1.0):
            best = one
    return best


def touch_times(view: ImpactView, lead: float, around_s: float) -> tuple[float, float]:
    """Onset and release for a given lead of the face, s; NaN where they never meet."""
    return _touch(view, lead, around_s) or (math.nan, math.nan)


def face_speeds(view: ImpactView, onset: float, release: float) -> tuple[float, float]:
    """Approach speed at onset and parting speed at release, along the face normal, m/s (Eq. 2)."""
    phi, omega = view.before.state(onset)
    approach = omega * arm_along_bar(view.rest - view.pivot, phi)
    phi, omega = view.after.state(release)
    state = view.flight.states(np.array([release]))[0]
    normal = np.array([np.cos(phi), np.sin(phi)])
    parting = float(state[2:] @ normal) - omega * arm_along_bar(state[:2] - view.pivot, phi)
    return approach, parting


def arm_along_bar(arm: FloatArray, phi: float) -> float:
    """Distance from the pivot to the point of contact, along the bar, m."""
    return float(arm[0] * np.sin(phi) - arm[1] * np.cos(phi))


def _touch(view: ImpactView, lead: float, around_s: float) -> tuple[float, float] | None:
    grid = around_s + np.linspace(-0.06, 0.06, 121)
    onset = _crossing(grid, gap_before(view, grid) - lead, falling=True)
    release = _crossing(grid, gap_after(view, grid) - lead, falling=False)
    if onset is None or release is None:
        return None
    return onset, max(release, onset + 1e-4)


def _crossing(time_s: FloatArray, gap: FloatArray, *, falling: bool) -> float | None:
    signed = gap if falling else -gap
    places = np.flatnonzero((signed[:-1] > 0) & (signed[1:] <= 0))
    if len(places) == 0:
        return None
    place = int(places[0])
    lo, hi = max(place - 2, 0), min(place + 4, len(gap))
    curve = np.polynomial.Polynomial.fit(gap[lo:hi], time_s[lo:hi], 3)
    return float(curve(0.0))


@dataclass(frozen=True)
class _Ends:
    """Motion at both ends of a contact that lasts from onset to release."""

    onset_s: float
    duration: float
    normal: FloatArray
    speed: float
    cor: float
    approach: float
    by_speeds: float

    @classmethod
    def of(cls, view: ImpactView, onset: float, release: float) -> "_Ends":
        duration = release - onset
        state = view.flight.states(np.array([release]))[0]
        normal = state[:2] - view.rest
        way = float(np.hypot(*normal))
        speed = float(state[2:] @ normal) / way
        # the impulse's centroid puts the way gone at release at v Δt / (1 + e)
        cor = speed * duration / way - 1.0
        approach, parting = face_speeds(view, onset, release)
        by_speeds = (parting / approach - cor) / COR_STD
        return cls(
            onset,
            duration,
            normal / way,
            speed,
            float(np.clip(cor, 0.2, 0.999)),
            approach,
            by_speeds,
        )


def _path_residuals(
    view: ImpactView, whitening: _Whitening, ends: _Ends, exponent: float
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals of ball, pendulum and COR, and what one unit of outline lag adds."""
    release = ends.onset_s + ends.duration
    pulse = contact_pulse(exponent, ends.cor)
    phase = np.clip((view.time_s - ends.onset_s) / ends.duration, 0.0, 1.0)
    path = np.interp(phase, pulse.phase, pulse.path) * ends.duration
    path += np.maximum(view.time_s - release, 0.0)
    lagging = np.interp(phase, pulse.phase, pulse.compression) * ends.approach * ends.duration
    moved = (view.position_m - view.rest) @ ends.normal
    std = np.hypot(view.std_m, SHAPE_STD * ends.speed * ends.duration)
    ball = whitening.ball((moved - path * ends.speed) / std)
    held = whitening.mass(_pendulum_held_back(view, ends.onset_s, release, pulse))
    left = np.concatenate([ball, held, [ends.by_speeds]])
    per_lag = np.zeros(len(left))
    per_lag[: len(phase)] = whitening.ball(lagging / std)
    return left, per_lag


def _pendulum_held_back(
    view: ImpactView, onset: float, release: float, pulse: ContactPulse
) -> FloatArray:
    """How far the pendulum stays behind its free swing: the ball's path by the mass ratio.

    Unlike the ball's outline, the mass keeps its shape.
    """
    duration = release - onset
    slowed = view.before.state(release)[1] - view.after.state(release)[1]
    phase = np.clip((view.swing_time_s - onset) / duration, 0.0, 1.0)
    path = np.interp(phase, pulse.phase, pulse.path) * duration
    path += np.maximum(view.swing_time_s - release, 0.0)
    behind = view.before.angles(view.swing_time_s) - view.swing_rad
    noise = view.swing_std_rad * math.sqrt(view.before.fitted.chi2_per_dof)
    std = np.hypot(noise, SHAPE_STD * slowed * duration)
    return np.asarray((behind - slowed * path) / std)
