"""What moves how: motion models of followed things, and what happens in a clip.

How lawfully a thing moves: the stretch of its path that a constant acceleration explains.

A thrown, struck or falling ball runs along a parabola, a rolling one along a line; a hand, a blob
or a string of unrelated edges does not. Each look beyond the three that fix the motion, and that
lies where the motion says, would have lain there by chance with a probability of about tolerance
over travel; the logarithms add up to the evidence.

Whether a thing swings: a decaying oscillation on an arc, as one linear fit for each frequency.

A bob on a cord or rod of length l at the small angle φ = a cos(ωt) e^(-γt) is at x = l sin φ,
y = l cos φ: along the arc terms in ω, across it in 2ω, each decaying. With the decay taken to
first order all of them are linear in their amplitudes once ω is given.

What happens in a clip: a strike, a flight, a drop, a swing, a collision, or nothing.

The explanations compete. Each says where the followed thing is in the frames that it claims, to
within a scatter s; a frame that it leaves unexplained may be anywhere in the area A that was
travelled. Its log evidence is the sum of log(A / 2πs²) - d²/2s² over its frames, less
the price of its parameters (Schwarz 1978); a thing that follows no law has none. Errors of
neighbouring frames are alike, so that many frames count for no more than a few dozen.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.tracks import Motion, MotionKind, Track

__all__ = ["lawful_stretch", "motion_of"]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

_TRIALS = 200
"""Sets of looks tried: of two hundred one is free of outliers even where only a fifth of all looks
is right."""

# Of so many sets one agrees by chance more often than any given one does, nats.
_SEARCHED = float(np.log(_TRIALS))

_FEWEST = 5
"""Looks: a parabola has three unknowns, and two more show whether it is one."""

# Circles of edges scatter by about this: px, and in radii.
_PATH_SCATTER_PX = 0.7

_PATH_SCATTER_RADII = 0.12
"""Radii, scatter of a rough outline about its path, supposed."""

# A look that is off the motion costs so many nats: some are mistaken.
_OFF_PRICE = 1.0

_LEAST_TRAVEL = 1.0


@dataclass(frozen=True)
class LawfulStretch:
    """The part of a path that one constant acceleration explains.

    Attributes
    ----------
    first, last : int
        Its first and last frame.
    looks : int
        How many looks agree.
    evidence : float
        How much more likely they are so than by chance, nats; 0 where there is no such stretch.
    travel_px : float
        How far it goes, px.
    """

    first: int
    last: int
    looks: int
    evidence: float
    travel_px: float


def lawful_stretch(frame: IntArray, centre: FloatArray, radius: float) -> LawfulStretch:
    """Find the stretch of a path with the most evidence for a constant acceleration.

    Parameters
    ----------
    frame : (N,) int array
        Frames, increasing.
    centre : (N, 2) array
        Centres, px.
    radius : float
        Radius, px.

    Returns
    -------
    LawfulStretch
        With no evidence where the thing stays where it is.
    """
    count = len(frame)
    nothing = LawfulStretch(int(frame[0]), int(frame[0]), 0, 0.0, 0.0)
    if count < _FEWEST:
        return nothing
    tolerance = _PATH_SCATTER_PX + _PATH_SCATTER_RADII * radius
    chosen = _triples(count)
    off = _off(frame, centre, chosen, tolerance)
    first, last = _best_runs(off, chosen)
    best = nothing
    # The longest runs first: what cannot beat the best is not weighed.
    most = np.log1p(float(np.hypot(*np.ptp(centre, axis=0))) / tolerance)
    for trial in np.argsort(first - last, kind="stable"):
        run = slice(int(first[trial]), int(last[trial]) + 1)
        agree = ~off[trial, run]
        if (run.stop - run.start - 3) * most - _SEARCHED <= best.evidence:
            break
        place = centre[run][agree]
        travel = float(np.hypot(*np.ptp(place, axis=0)))
        if travel < _LEAST_TRAVEL * radius or len(place) < _FEWEST:
            continue
        spare = len(place) - 3
        evidence = spare * np.log1p(travel / tolerance) - _OFF_PRICE * np.count_nonzero(~agree)
        evidence -= _SEARCHED
        if evidence > best.evidence:
            best = LawfulStretch(
                int(frame[run.start]), int(frame[run.stop - 1]), len(place), evidence, travel
            )
    return best


def _off(
    frame: IntArray, centre: FloatArray, chosen: IntArray, tolerance: float
) -> NDArray[np.bool_]:
    """Which looks (T, N) lie off the parabolas through each set of three chosen ones."""
    begin, end = frame[chosen[:, 0]], frame[chosen[:, 2]]
    time = (frame[None] - begin[:, None]) / np.maximum(end - begin, 1).astype(np.float64)[:, None]
    powers = np.stack([np.ones_like(time), time, time * time], axis=2)
    motion = np.linalg.solve(np.take_along_axis(powers, chosen[:, :, None], axis=1), centre[chosen])
    away = centre - powers @ motion
    return np.asarray(np.hypot(away[..., 0], away[..., 1]) > tolerance)


def _triples(count: int) -> IntArray:
    """Sets of three looks at all distances, the same for all paths of a length.

    Short ones are as frequent as long ones: a thing that bounces often is lawful in between.
    """
    rng = np.random.default_rng(count)
    longest = float(count - 1)
    span = np.rint(4.0 * (longest / 4.0) ** rng.uniform(size=_TRIALS)).astype(np.int64)
    start = np.floor(rng.uniform(size=_TRIALS) * (count - span)).astype(np.int64)
    middle = start + 1 + np.floor(rng.uniform(size=_TRIALS) * (span - 1)).astype(np.int64)
    return np.column_stack([start, middle, start + span])


def _best_runs(off: NDArray[np.bool_], chosen: IntArray) -> tuple[IntArray, IntArray]:
    """First and last look of the run about each set of chosen ones in which most agree."""
    gain = np.where(off, -1.0, 0.5)
    total = np.concatenate([np.zeros((len(off), 1)), np.cumsum(gain, axis=1)], axis=1)
    place = np.arange(off.shape[1] + 1)
    before = np.where(place <= chosen[:, :1], total, np.inf)
    after = np.where(place > chosen[:, 2:], total, -np.inf)
    # Of equals the nearest to the chosen ones.
    first = off.shape[1] - np.argmin(before[:, ::-1], axis=1)
    return first, np.argmax(after, axis=1) - 1


_FREQUENCIES = 80
"""Frequencies tried for a swing, geometrically, and refined afterwards; supposed."""

# Periods shorter than so many frames are not told from noise.
_SHORTEST_PERIOD = 8.0

# Less than this part of a period is an arc that turns back: below it nothing is known of a swing.
_LEAST_PERIODS = 0.35

_ROUNDS = 4
"""Rounds of reweighting, supposed: outliers are out after a few."""

PARAMETERS = 15
"""Numbers of a swing: columns of both axes, and the frequency."""


@dataclass(frozen=True)
class Oscillation:
    """A swing.

    Attributes
    ----------
    omega : float
        Angular frequency, rad per frame.
    residual_px : (N,) array
        Distance of each position from it, px.
    periods : float
        How many periods were seen.
    """

    omega: float
    residual_px: FloatArray
    periods: float


def fit_oscillation(time: FloatArray, centre: FloatArray, scale_px: float) -> Oscillation | None:
    """Fit a swing to positions.

    Parameters
    ----------
    time : (N,) array
        Frames.
    centre : (N, 2) array
        Positions, px.
    scale_px : float
        Residual beyond which a position loses weight, px.

    Returns
    -------
    Oscillation or None
        None where there are too few positions.
    """
    if len(time) < 2 * PARAMETERS:
        return None
    span = float(time[-1] - time[0])
    spacing = span / (len(time) - 1)
    shortest = max(_SHORTEST_PERIOD, 4.0 * spacing)
    lowest, highest = 2 * np.pi * _LEAST_PERIODS / span, 2 * np.pi / shortest
    if highest <= lowest:
        return None
    shifted = time - time[0]
    best, cost = None, np.inf
    for omega in np.geomspace(lowest, highest, _FREQUENCIES):
        residual = _residual(shifted, centre, float(omega), scale_px)
        robust = float(np.mean(np.minimum(residual, 3.0 * scale_px)))
        if robust < cost:
            best, cost = Oscillation(float(omega), residual, omega * span / (2 * np.pi)), robust
    return best


def _residual(time: FloatArray, centre: FloatArray, omega: float, scale_px: float) -> FloatArray:
    span = float(time[-1])
    turn = omega * time
    ones = np.ones_like(time)
    design = np.column_stack(
        [
            ones,
            np.cos(turn),
            np.sin(turn),
            time / span * np.cos(turn),
            time / span * np.sin(turn),
            np.cos(2 * turn),
            np.sin(2 * turn),
        ]
    )
    weight = ones
    residual = np.zeros_like(time)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)[:, None]
        # A ridge: below half a period the columns are nearly one another's.
        normal = (design * root).T @ (design * root) + 1e-6 * len(time) * np.eye(design.shape[1])
        amplitude = np.linalg.solve(normal, (design * weight[:, None]).T @ centre)
        residual = np.hypot(*(centre - design @ amplitude).T)
        weight = 1.0 / (1.0 + (residual / scale_px) ** 2) ** 2
    return residual


_LEAST_REST = 5
"""Frames: what is at rest for fewer may only pass its turning point."""

# What a law leaves over: px, and in radii (deformation, drag, a camera that is not ideal).
_SCATTER_PX = 0.4

_SCATTER_RADII = 0.04
"""Radii, scatter of an outline about its path, supposed."""

_MOST_INDEPENDENT = 40.0
"""Frames that count as independent at most: errors of neighbours are alike, as the ball looks
alike."""

# A law may leave this part of the frames it claims unexplained (mistaken fits).
_STRAY = 0.05

# A swing is all of the motion, or none of it.
_SWINGING = 0.8

# Nothing is surer than this: what was not thought of is left.
_MOST_CERTAIN = 0.99

# A strike, a drop and a throw differ by how the motion begins. Odds where that was not seen.
_UNSEEN_STRIKER_ODDS = 3.0
# A free motion that begins so many frames, or this part of itself, after the rest began otherwise.
_AT_ONCE, _AT_ONCE_SHARE = 3, 0.25

# A drop goes along its acceleration: sideways by less than this part of the way.
_DROP_SIDEWAYS = 0.06

_DROP_ODDS = 30.0
"""Odds, supposed: of a fall straight down that begins at rest being a drop, or of one with speed
sideways being none."""

_BEGINS_AT_REST = 0.15
"""Of the way that a fall's speed covers in its span: slower is let go, not thrown."""

# Acceleration of a flight shows when it bends or speeds up the path by so many scatters.
_SEEN_ACCELERATION = 4.0


@dataclass(frozen=True)
class _Flight:
    """The stretch of free motion: frames, motion in it, and its log evidence, nats."""

    first: int
    last: int
    log_evidence: float
    velocity: FloatArray
    acceleration: FloatArray
    sagitta: float


def motion_of(
    ball: Track,
    rest_frames: tuple[int, int] | None,
    *,
    pendulum: bool,
    struck_by_another: bool,
) -> Motion:
    """Say what happened to the ball.

    Parameters
    ----------
    ball : Track
        What was followed.
    rest_frames : tuple of int or None
        First and last frame in which it lies still before it leaves.
    pendulum : bool
        Whether a pendulum was followed to it.
    struck_by_another : bool
        Whether another ball came to it while it lay still.

    Returns
    -------
    Motion
    """
    if rest_frames is not None and rest_frames[1] - rest_frames[0] < _LEAST_REST:
        # What is released stays that long about where it turns.
        rest_frames = None
    moving = ball.where(ball.frame >= (0 if rest_frames is None else rest_frames[1]))
    if len(moving) < _FEWEST:
        return Motion(MotionKind.NONE, 1.0, ("Too few frames show anything that moves.",))
    scatter = _SCATTER_PX + _SCATTER_RADII * float(np.median(ball.radius_px))
    area = float(np.prod(np.ptp(moving.centre_px, axis=0) + 2.0 * moving.radius_px[0]))
    flight = _flight(moving, scatter, area)
    swing = _swing_log_evidence(ball, scatter, area) if rest_frames is None else 0.0
    log_evidence = {
        MotionKind.NONE: _straight_log_evidence(moving, scatter, area)
        if rest_frames is None
        else 0.0
    }
    if swing > 0.0:
        log_evidence[MotionKind.SWING] = swing
    reasons: dict[MotionKind, tuple[str, ...]] = {
        MotionKind.NONE: ("What moves follows neither a free flight nor a swing, or rolls on.",),
        MotionKind.SWING: ("It goes to and fro on an arc.",),
    }
    if flight is not None:
        if rest_frames is None and flight.sagitta < _SEEN_ACCELERATION:
            log_evidence[MotionKind.NONE] = max(log_evidence[MotionKind.NONE], flight.log_evidence)
        for kind, odds, reason in _beginnings(flight, rest_frames, pendulum, struck_by_another):
            log_evidence[kind] = flight.log_evidence + np.log(odds)
            reasons[kind] = (reason,)
    return _judged(log_evidence, reasons, flight, rest_frames, ball)


def _judged(
    log_evidence: dict[MotionKind, float],
    reasons: dict[MotionKind, tuple[str, ...]],
    flight: _Flight | None,
    rest_frames: tuple[int, int] | None,
    ball: Track,
) -> Motion:
    best = max(log_evidence.values())
    weight = {kind: float(np.exp(value - best)) for kind, value in log_evidence.items()}
    total = sum(weight.values())
    spare = (1.0 - _MOST_CERTAIN) / len(MotionKind)
    probability = {
        kind: _MOST_CERTAIN * weight.get(kind, 0.0) / total + spare for kind in MotionKind
    }
    ranked = sorted(MotionKind, key=lambda kind: -probability[kind])
    kind = ranked[0]
    frames: tuple[int, int] | None = (int(ball.frame[0]), int(ball.frame[-1]))
    if kind is MotionKind.NONE:
        frames = None
    elif kind is not MotionKind.SWING and flight is not None:
        begins = flight.first if rest_frames is None else min(flight.first, rest_frames[1])
        frames = (begins, flight.last)
    return Motion(
        kind,
        probability[kind],
        reasons.get(kind, ()),
        frames,
        tuple((other, probability[other]) for other in ranked[1:]),
    )


def _flight(moving: Track, scatter: float, area: float) -> _Flight | None:
    radius = float(np.median(moving.radius_px))
    stretch = lawful_stretch(moving.frame, moving.centre_px, radius)
    if stretch.evidence <= 0.0:
        return None
    inside = (moving.frame >= stretch.first) & (moving.frame <= stretch.last)
    time = (moving.frame[inside] - stretch.first).astype(np.float64)
    place = moving.centre_px[inside]
    powers = np.column_stack([np.ones_like(time), time, 0.5 * time * time])
    motion = np.linalg.lstsq(powers, place, rcond=None)[0]
    residual = np.hypot(*(place - powers @ motion).T)
    velocity, acceleration = motion[1], motion[2]
    return _Flight(
        stretch.first,
        stretch.last,
        _log_evidence(residual, scatter, area, 6, len(moving)),
        velocity,
        acceleration,
        float(np.hypot(*acceleration)) * float(time[-1]) ** 2 / 8.0 / scatter,
    )


def _swing_log_evidence(ball: Track, scatter: float, area: float) -> float:
    swing = fit_oscillation(ball.frame.astype(np.float64), ball.centre_px, scatter)
    if swing is None:
        return 0.0
    if np.mean(swing.residual_px < 3.0 * scatter) < _SWINGING:
        return 0.0
    return _log_evidence(swing.residual_px, scatter, area, PARAMETERS, len(ball))


def _straight_log_evidence(moving: Track, scatter: float, area: float) -> float:
    """What rolls or slides goes straight on at an even speed; so does a little of any swing."""
    time = (moving.frame - moving.frame[0]).astype(np.float64)
    powers = np.column_stack([np.ones_like(time), time])
    motion = np.linalg.lstsq(powers, moving.centre_px, rcond=None)[0]
    residual = np.hypot(*(moving.centre_px - powers @ motion).T)
    return _log_evidence(residual, scatter, area, 4, len(moving))


def _log_evidence(
    residual: FloatArray, scatter: float, area: float, parameters: int, frames: int
) -> float:
    """Log evidence of an explanation of some of so many frames, nats."""
    gain = np.log(area / (2 * np.pi * scatter**2)) - 0.5 * (residual / scatter) ** 2
    gain = np.maximum(gain, np.log(_STRAY))
    share = min(1.0, _MOST_INDEPENDENT / frames)
    count = max(len(gain) * share, 1.0)
    return max(0.0, float(gain.sum()) * share - 0.5 * parameters * float(np.log(count)))


def _beginnings(
    flight: _Flight,
    rest_frames: tuple[int, int] | None,
    pendulum: bool,
    struck_by_another: bool,
) -> list[tuple[MotionKind, float, str]]:
    """How a free motion may have begun: kind, odds, and the reason for it."""
    drop = _drop_odds(flight, rest_frames is not None)
    said_drop = (MotionKind.DROP, drop, "It falls straight down from rest.")
    thrown = (MotionKind.FLIGHT, 1.0, "It flies freely, and nothing was seen to strike it.")
    if rest_frames is None:
        if flight.sagitta < _SEEN_ACCELERATION:
            # Along a line at an even speed: a short flight as well as a thing that rolls.
            return [(MotionKind.FLIGHT, float(np.exp(-flight.log_evidence)), thrown[2])]
        return [thrown, said_drop]
    if struck_by_another:
        return [
            (MotionKind.COLLISION, 100.0, "Another ball like it met it while it lay still."),
            (MotionKind.STRIKE, 1.0, "It lay still and left."),
        ]
    # What is struck flies at once; what is let go, or carried off first, does not.
    late = flight.first - rest_frames[1] > max(
        _AT_ONCE, _AT_ONCE_SHARE * (flight.last - flight.first)
    )
    if pendulum and not late:
        return [
            (MotionKind.STRIKE, 100.0, "It lay still, a pendulum met it, and it flew."),
            thrown,
        ]
    odds = 1.0 / _UNSEEN_STRIKER_ODDS if late else _UNSEEN_STRIKER_ODDS
    return [(MotionKind.STRIKE, odds, "It lay still and left at once."), thrown, said_drop]


def _drop_odds(flight: _Flight, from_rest: bool) -> float:
    """Odds of a drop against a throw."""
    span = float(flight.last - flight.first)
    size = float(np.hypot(*flight.acceleration))
    if size == 0.0 or flight.sagitta < _SEEN_ACCELERATION:
        return 1e-3
    down = flight.acceleration / size
    along = float(flight.velocity @ down) * span + 0.5 * size * span**2
    across = abs(float(flight.velocity[0] * down[1] - flight.velocity[1] * down[0])) * span
    upwards = float(flight.velocity @ down) < -0.05 * size * span
    if upwards or across > _DROP_SIDEWAYS * along:
        return 1.0 / _DROP_ODDS
    begins = float(np.hypot(*flight.velocity)) < _BEGINS_AT_REST * size * span
    return _DROP_ODDS if from_rest or begins else _DROP_ODDS / 3.0
