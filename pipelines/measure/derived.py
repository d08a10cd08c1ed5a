"""What follows from a fitted impact: speeds, angle, landing, restitution (Eqs 2, 7-10, 17, 18)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipelines.measure.checks.speeds import (
    OTHER_SPEEDS,
    gravity_share,
    speed_by_pendulum,
    speed_per_frame,
)
from pipelines.measure.fits.contact_fit import ContactFit, ImpactView, arm_along_bar, touch_times
from pipelines.measure.fits.flight_fit import FlightFit
from pipelines.measure.fits.impact import Impact
from pipelines.measure.fits.swing_fit import SwingFit
from pipelines.measure.inputs import Inputs

__all__ = ["DERIVED", "derived_values", "random_covariance"]

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
    "landing_height": "m",
    "landing_distance_seen": "m",
    **OTHER_SPEEDS,
    "eq7_by_gravity": "m/s",
}
"""Name and unit of each derived value, in the order of the vectors below."""


@dataclass(frozen=True)
class _Shift:
    """How far each fitted part is moved from its best estimate; None leaves it alone.

    Attributes
    ----------
    flight : (7,) array or None
    before, after : (3,) arrays or None
        Of the swings.
    rest : (2,) array or None
        m.
    lead : (1,) array or None
        Of the face, m.
    landing : (1,) array or None
        Of touch-down as seen, along the flight, m.
    """

    flight: FloatArray | None = None
    before: FloatArray | None = None
    after: FloatArray | None = None
    rest: FloatArray | None = None
    face_offset: FloatArray | None = None
    landing: FloatArray | None = None


@dataclass(frozen=True)
class _DrawnParts:
    """One draw of everything fitted."""

    flight: FlightFit
    view: ImpactView | None
    face_offset: float
    rest: FloatArray
    landing_x: float | None


def derived_values(impact: Impact, inputs: Inputs) -> FloatArray:
    """Values in the order of `DERIVED`; NaN where a part is missing."""
    return _evaluate(impact, inputs, _Shift())


def random_covariance(impact: Impact, inputs: Inputs) -> FloatArray:
    """Covariance of `derived_values` from the noise of the tracks, by finite differences."""
    total = np.zeros((len(DERIVED), len(DERIVED)))
    for shift, covariance in _blocks(impact):
        values, vectors = np.linalg.eigh(covariance)
        for value, vector in zip(values, vectors.T, strict=True):
            if value <= 0:
                continue
            step = np.sqrt(value) * vector
            ahead = _evaluate(impact, inputs, shift(step))
            behind = _evaluate(impact, inputs, shift(-step))
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
    """The independent parts: how a step moves each, and its covariance."""
    blocks: list[tuple[Callable[[FloatArray], _Shift], FloatArray]] = [
        (lambda step: _Shift(flight=step), impact.flight.fitted.covariance),
        (lambda step: _Shift(rest=step), np.diag(impact.tracks.rest_std_m**2)),
    ]
    if impact.view is not None and impact.contact is not None:
        face_offset = np.array([[impact.contact.face_offset_std**2]])
        blocks += [
            (lambda step: _Shift(before=step), impact.view.before.fitted.covariance),
            (lambda step: _Shift(after=step), impact.view.after.fitted.covariance),
            (lambda step: _Shift(face_offset=step), face_offset),
        ]
    if impact.landing is not None:
        spread = impact.landing.covariance[1:2, 1:2]
        blocks.append((lambda step: _Shift(landing=step), spread))
    return blocks


def _shifted(impact: Impact, shift: _Shift) -> _DrawnParts:
    flight, view, rest = impact.flight, impact.view, impact.tracks.rest_m
    face_offset = 0.0 if impact.contact is None else impact.contact.face_offset
    landing_x = None if impact.landing is None else float(impact.landing.place_m[0])
    if shift.flight is not None:
        fitted = replace(flight.fitted, values=flight.fitted.values + shift.flight)
        flight = replace(flight, fitted=fitted)
    if shift.rest is not None:
        rest = rest + shift.rest
    if shift.face_offset is not None:
        face_offset += float(shift.face_offset[0])
    if shift.landing is not None and landing_x is not None:
        landing_x += float(shift.landing[0])
    if view is not None:
        view = replace(
            view,
            flight=flight,
            rest=rest,
            before=_moved(view.before, shift.before),
            after=_moved(view.after, shift.after),
        )
    return _DrawnParts(flight, view, face_offset, rest, landing_x)


def _moved(swing: SwingFit, step: FloatArray | None) -> SwingFit:
    if step is None:
        return swing
    return replace(swing, fitted=replace(swing.fitted, values=swing.fitted.values + step))


def _evaluate(impact: Impact, inputs: Inputs, shift: _Shift) -> FloatArray:
    parts = _shifted(impact, shift)
    flight, view, rest = parts.flight, parts.view, parts.rest
    out = dict.fromkeys(DERIVED, np.nan)
    release = flight.reference_s
    if view is not None and impact.contact is not None:
        middle = 0.5 * (impact.contact.onset_s + impact.contact.release_s)
        onset, release = touch_times(view, parts.face_offset, middle)
        out["contact_start"], out["contact_end"] = onset, release
        out["contact_time"] = release - onset
    state = flight.states(np.array([release]))[0]
    out["ball_speed"] = float(np.hypot(*state[2:]))
    out["launch_angle"] = float(np.degrees(np.arctan2(state[3], state[2])))
    if inputs.fall is not None:
        landed = flight.falls_to(float(rest[1]) - inputs.fall)
        if landed is not None:
            at = flight.states(np.array([landed]))[0]
            out["landing_time"] = landed
            out["landing_distance"] = float(at[0] - rest[0])
            out["landing_height"] = float(at[1])
        if parts.landing_x is not None:
            out["landing_distance_seen"] = parts.landing_x - float(rest[0])
    out["gravity"] = float(impact.free_flight.fitted.values[6])
    out["ball_speed_per_frame"] = speed_per_frame(impact.tracks, impact.flight)[0]
    mass = None if inputs.ball is None else inputs.ball.mass
    if mass is not None:
        out["external_impulse"] = mass * out["ball_speed"]
    if view is not None and impact.contact is not None:
        _add_restitution(out, view, flight, rest, (out["contact_start"], release), inputs)
    return np.array([out[name] for name in DERIVED])


def _add_restitution(
    out: dict[str, float],
    view: ImpactView,
    flight: FlightFit,
    rest: FloatArray,
    contact: tuple[float, float],
    inputs: Inputs,
) -> None:
    onset, release = contact
    phi_before, omega_before = view.before.state(onset)
    phi_after, omega_after = view.after.state(release)
    omega_after *= inputs.after_share
    share = inputs.arm_share
    arm = share * arm_along_bar(rest - view.pivot, phi_before)
    body = inputs.pendulum
    out["pendulum_speed_before"] = omega_before * arm
    out["pendulum_speed_after"] = omega_after * arm
    # a misplaced pivot puts angles off by the ratio of the arms, speeds it leaves alone
    true_rate = arm / body.length
    spent = (omega_before**2 - omega_after**2) * true_rate**2
    out["energy_loss"] = 0.5 * body.inertia * spent
    state = flight.states(np.array([release]))[0]
    out["cor_speeds"] = _cor(state, omega_after, omega_before, phi_after, view, arm, share)
    mass = None if inputs.ball is None else inputs.ball.mass
    if mass is None:
        return
    slowed = out["pendulum_speed_before"], out["pendulum_speed_after"]
    out["ball_speed_eq7"] = speed_by_pendulum(body, mass, *slowed)
    out["eq7_by_gravity"] = gravity_share(
        body, mass, 0.5 * (phi_before + phi_after), arm, (inputs.gravity, release - onset)
    )

    def turned(launched: FloatArray) -> float:
        reach = (launched[:2] - view.pivot) / true_rate
        carried = mass * (reach[0] * launched[3] - reach[1] * launched[2])
        middle = 0.5 * (phi_before + phi_after)
        weight = body.mass * body.com * np.sin(middle) + mass * 0.5 * (
            reach[0] + (rest[0] - view.pivot[0]) / true_rate
        )
        lost = inputs.gravity * weight * (release - onset)
        return float(omega_before - (carried + lost) / (body.inertia * true_rate))

    out["cor_launch"] = _cor(state, turned(state), omega_before, phi_after, view, arm, share)
    distance = out["landing_distance_seen"]
    if np.isfinite(distance) and inputs.fall is not None:
        launched = _launch_that_reaches(flight, state, rest, distance, inputs)
        if launched is not None:
            out["cor_range"] = _cor(
                launched, turned(launched), omega_before, phi_after, view, arm, share
            )


def _cor(
    state: FloatArray,
    omega_after: float,
    omega_before: float,
    phi: float,
    view: ImpactView,
    arm: float,
    share: float,
) -> float:
    """Parting over approach speed along the face's normal (Eq. 2), at the point of contact."""
    normal = np.array([np.cos(phi), np.sin(phi)])
    reach = share * arm_along_bar(state[:2] - view.pivot, phi)
    parting = float(state[2:] @ normal) - omega_after * reach
    return float(parting / (omega_before * arm))


def _launch_that_reaches(
    flight: FlightFit, state: FloatArray, rest: FloatArray, distance: float, inputs: Inputs
) -> FloatArray | None:
    """Release state with the measured direction whose flight lands at `distance` (Eqs 13-17).

    The forces in the air are those that this flight shows, where Eq. 17 knows only drag.
    """
    forces = flight.fitted.values[4:]
    fall = inputs.fall
    assert fall is not None

    def miss(share: float) -> float:
        values = np.concatenate([state[:2], state[2:] * share, forces])
        landed = flight.falls_to(float(rest[1]) - fall, values)
        if landed is None:
            return -distance
        there = flight.states(np.array([landed]), values)[0]
        return float(there[0] - rest[0]) - distance

    if miss(0.7) * miss(1.4) > 0:
        return None
    share = float(brentq(miss, 0.7, 1.4, xtol=1e-7))
    return np.concatenate([state[:2], state[2:] * share])


def contact_interval(contact: ContactFit) -> tuple[float, float]:
    """Onset and release, s."""
    return contact.onset_s, contact.release_s
