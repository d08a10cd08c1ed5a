"""Restitution of the first bounce, from the flights before and after it.

Both flights are parabolas; where they meet, the speeds along the vertical are taken. A ratio needs
neither scale nor rate, and a slanted camera changes both speeds alike at one place. Drag acts along
the paths and is fitted with what balls usually have.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from measuring.flight_fit import slow_error_whitening
from measuring.inputs import QuantityName
from measuring.motions import ROLL_STD, FlightFrames, running_integral, steady_stretch
from metrology import Contribution, Quantity, TooLittleDataError, UncertaintySource
from metrology.least_squares import fit
from vision.tracks import Track, Tracks

__all__ = ["bounce_restitution"]

FloatArray = NDArray[np.float64]

_AIR, _AIR_STD = 0.05, 0.08
"""Drag at the floor over the weight, and its std (assumed: 0.02 for a basketball at 3 m/s, 0.13 for
a table tennis ball)."""

_CONTACT_S = 0.005
"""s, std of the duration of the contact (assumed: balls touch a hard floor for 2 to 10 ms)."""

_MAX_COR = 1.1
"""Restitution beyond which it was no bounce of a passive ball (chosen)."""


def bounce_restitution(tracks: Tracks, clock: FloatArray, fps: float | None) -> Quantity | None:
    """Restitution of the first bounce between two flights; None where none is in view.

    Parameters
    ----------
    tracks : Tracks
    clock : (F,) array
        Times of all frames of the clip, in frames.
    fps : float or None
        Frame rate, 1/s, where it is known.
    """
    flights = _flights(tracks)
    if flights is None:
        return None
    name = QuantityName.COR_BOUNCE.value
    fall = np.array(tracks.motion.fall_px or (0.0, 1.0))
    down = fall / np.hypot(*fall)
    try:
        falling, rising = (_stretch(one, clock) for one in flights)
    except TooLittleDataError as problem:
        return Quantity.missing(name, "1", f"before or after the bounce {problem.message}")
    origin = float(0.5 * (falling.time[-1] + rising.time[0]))

    def restitution(turn: float) -> tuple[_MetFlights, FloatArray]:
        cosine, sine = math.cos(turn), math.sin(turn)
        up = -np.array([cosine * down[0] - sine * down[1], sine * down[0] + cosine * down[1]])
        return _met((falling, rising), up, origin)

    met, covariance = restitution(0.0)
    if not (met.before < 0.0 < met.after and met.cor < _MAX_COR):
        return Quantity.missing(
            name, "1", "the flights before and after the bounce do not meet as of one ball"
        )
    slope = _gradient(lambda values: _MetFlights.of(values).cor, met.values)
    noise = math.sqrt(float(slope @ covariance @ slope))
    rolled = abs(restitution(ROLL_STD)[0].cor - restitution(-ROLL_STD)[0].cor) / 2.0
    lasts = 1.0 if fps is None else _CONTACT_S * fps
    # while it touches the floor it does not fly, and both speeds are those of its ends
    ratio = abs(met.after / met.before)
    apart = lasts * abs(1.0 / ratio - ratio) / (met.after - met.before)
    lasting = met.cor * abs(met.pull) * apart
    lines = (
        Contribution(UncertaintySource.TRACK_NOISE, noise),
        Contribution(UncertaintySource.CONTACT_TIME, lasting),
        Contribution(UncertaintySource.CAMERA_ROLL, rolled),
    )
    kept = tuple(sorted((one for one in lines if one.std > 0.0), key=lambda one: -one.std))
    return Quantity.measured(name, met.cor, "1", kept)


def _flights(tracks: Tracks) -> tuple[Track, Track] | None:
    """The ball before and after its first bounce, up to the events next to it."""
    ball, events = tracks.ball, sorted(tracks.motion.events, key=lambda event: event[1])
    at = next((frame for kind, frame in events if kind == "bounce"), None)
    if at is None:
        return None
    since = max((frame for _, frame in events if frame < at), default=int(ball.frame[0]) - 1)
    until = min((frame for _, frame in events if frame > at), default=int(ball.frame[-1]) + 1)
    before = ball.where((ball.frame > since) & (ball.frame < at))
    after = ball.where((ball.frame > at) & (ball.frame < until))
    return before, after


def _stretch(ball: Track, clock: FloatArray) -> FlightFrames:
    """The rows of a flight that fit one parabola, px and frames, y downwards."""
    std = np.sqrt(np.diagonal(ball.covariance_px2, axis1=1, axis2=2))
    unknown = np.full(len(ball), np.nan)
    path = FlightFrames(clock[ball.frame], ball.centre_px, std, unknown, unknown)
    return steady_stretch(path)


@dataclass(frozen=True)
class _MetFlights:
    """Two flights where they meet: speeds upwards before and after, their ratio, acceleration."""

    values: FloatArray
    before: float
    after: float
    pull: float
    cor: float

    @classmethod
    def of(cls, values: FloatArray) -> "_MetFlights":
        low, fast, start, slow, pull = values[:5].tolist()
        time = (start - low) / (fast - slow)
        before, after = fast + pull * time, slow + pull * time
        return cls(values, before, after, pull, -after / before)


def _met(
    flights: tuple[FlightFrames, FlightFrames], up: FloatArray, origin: float
) -> tuple[_MetFlights, FloatArray]:
    """Where two flights meet, and the covariance of their unknowns (6, 6).

    Unknown are height and speed of both at the origin of time, the acceleration, and drag over
    weight at the floor.
    """
    rows, seen = [], []
    speeds = [_speed(one, origin) for one in flights]
    usual = 0.5 * sum(float(np.hypot(*one(0.0))) for one in speeds)
    weight = float(np.hypot(*_pull(flights))) / usual**2
    for place, (one, slowed) in enumerate(zip(flights, speeds, strict=True)):
        time = one.time - origin
        design = np.zeros((len(time), 6))
        design[:, 2 * place], design[:, 2 * place + 1] = 1.0, time
        design[:, 4], design[:, 5] = 0.5 * time**2, weight * _slowed(slowed, time) @ up
        std = np.sqrt(one.std**2 @ up**2)
        std = np.maximum(std, 0.3 * float(np.median(std)))[:, None]
        whiten = slow_error_whitening((one.time - one.time[0]) / float(np.ptp(one.time)))
        rows.append(whiten(design / std))
        seen.append(whiten((one.place @ up)[:, None] / std)[:, 0])
    prior, spread = np.zeros(6), np.full(6, np.inf)
    prior[5], spread[5] = _AIR, _AIR_STD
    design, target = np.vstack(rows), np.concatenate(seen)
    fitted = fit(
        lambda values: np.asarray(values @ design.T - target),
        np.zeros(6),
        prior,
        spread,
        stacked=True,
    )
    return _MetFlights.of(fitted.values), fitted.covariance


def _speed(flight: FlightFrames, origin: float) -> Callable[[float | FloatArray], FloatArray]:
    """Velocity of a parabola through a flight at times from the origin, (2,) or (N, 2)."""
    bend, slope = np.polyfit(flight.time - origin, flight.place, 2)[:2]
    return lambda time: slope + 2.0 * np.multiply.outer(time, bend)


def _pull(flights: tuple[FlightFrames, FlightFrames]) -> FloatArray:
    """Mean acceleration of both, px per frame²."""
    bends = [np.polyfit(one.time, one.place, 2)[0] for one in flights]
    return np.asarray(2.0 * np.mean(bends, axis=0))


def _slowed(speed: Callable[[float | FloatArray], FloatArray], time: FloatArray) -> FloatArray:
    """Displacement (N, 2) by a drag of one per px, from the origin of time on."""
    grid = np.linspace(min(0.0, float(time.min())), max(0.0, float(time.max())), 401)
    velocity = speed(grid)
    once = running_integral(-np.hypot(*velocity.T)[:, None] * velocity, grid)
    twice = running_integral(once - _at(0.0, grid, once), grid)
    return _at(time, grid, twice) - _at(0.0, grid, twice)


def _at(time: float | FloatArray, grid: FloatArray, values: FloatArray) -> FloatArray:
    """Values (M, 2) on a grid at times: (2,) or (N, 2)."""
    return np.stack([np.interp(time, grid, axis) for axis in values.T], axis=-1)


def _gradient(of: Callable[[FloatArray], float], values: FloatArray) -> FloatArray:
    steps = 1e-5 * np.maximum(np.abs(values), 1e-3)
    return np.array(
        [(of(values + step) - of(values - step)) / (2.0 * step.sum()) for step in np.diag(steps)]
    )
