"""What follows from a fitted impact: speeds, angle, landing, restitution (Eqs 2, 7-10, 17, 18)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipelines.measure.fits.beside import BESIDE, gravity_share, speed_by_pendulum, speed_per_frame
from pipelines.measure.fits.contact_fit import ContactFit, ImpactView, arm_along_bar, touch_times
from pipelines.measure.fits.flight_fit import FlightFit
from pipelines.measure.fits.impact import Impact
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
    **BESIDE,
    "eq7_by_gravity": "m/s",
}
"""Name and unit of each derived value, in the order of the vectors below."""


@dataclass(frozen=True)
class _State:
    """One draw of everything fitted."""

    before: FloatArray
    after: FloatArray
    flight: FloatArray
    rest: FloatArray
    lead: float


def derived_values(impact: Impact, inputs: Inputs) -> FloatArray:
    """Values in the order of `DERIVED`; NaN where a part is missing."""
    return _evaluate(impact, inputs, None)


def random_covariance(impact: Impact, inputs: Inputs) -> FloatArray:
    """Covariance of `derived_values` from the noise of the tracks, by finite differences."""
    blocks: list[tuple[str, FloatArray]] = [("flight", impact.flight.fitted.covariance)]
    rest = np.diag(impact.tracks.rest_std_m**2)
    blocks.append(("rest", rest))
    if impact.view is not None and impact.contact is not None:
        blocks.append(("before", impact.view.before.fitted.covariance))
        blocks.append(("after", impact.view.after.fitted.covariance))
        blocks.append(("lead", np.array([[impact.contact.lead_std**2]])))
    total = np.zeros((len(DERIVED), len(DERIVED)))
    for name, covariance in blocks:
        values, vectors = np.linalg.eigh(covariance)
        for value, vector in zip(values, vectors.T, strict=True):
            if value <= 0:
                continue
            step = np.sqrt(value) * vector
            ahead = _evaluate(impact, inputs, (name, step))
            behind = _evaluate(impact, inputs, (name, -step))
            slope = 0.5 * (ahead - behind)
            total += np.outer(slope, slope)
    free = impact.free_flight.fitted.covariance[6, 6]
    gravity = list(DERIVED).index("gravity")
    total[gravity, :] = total[:, gravity] = 0.0
    total[gravity, gravity] = free
    frames = list(DERIVED).index("ball_speed_per_frame")
    total[frames, frames] = speed_per_frame(impact.tracks, impact.flight)[1] ** 2
    return total


def _shifted(
    impact: Impact, step: tuple[str, FloatArray] | None
) -> tuple[FlightFit, ImpactView | None, float, FloatArray]:
    name, move = step if step is not None else ("", np.zeros(1))
    flight, view = impact.flight, impact.view
    lead = 0.0 if impact.contact is None else impact.contact.lead
    rest = impact.tracks.rest_m
    if name == "flight":
        flight = replace(flight, fitted=replace(flight.fitted, values=flight.fitted.values + move))
    if name == "rest":
        rest = rest + move
    if view is not None:
        view = replace(view, flight=flight, rest=rest)
        for side in ("before", "after"):
            if name == side:
                swing = getattr(view, side)
                fitted = replace(swing.fitted, values=swing.fitted.values + move)
                view = replace(view, **{side: replace(swing, fitted=fitted)})
    return flight, view, lead + (float(move[0]) if name == "lead" else 0.0), rest


def _evaluate(impact: Impact, inputs: Inputs, step: tuple[str, FloatArray] | None) -> FloatArray:
    flight, view, lead, rest = _shifted(impact, step)
    out = dict.fromkeys(DERIVED, np.nan)
    release = flight.reference_s
    if view is not None and impact.contact is not None:
        middle = 0.5 * (impact.contact.onset_s + impact.contact.release_s)
        onset, release = touch_times(view, lead, middle)
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
    distance = out["landing_distance"]
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
