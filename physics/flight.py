"""The ball in the air: forces, integration, closed form.

Flights to the floor: one by scipy's adaptive solver, many at once by fixed steps.

The equation of motion of a ball in the air: gravity, and the forces of the effect catalogue.

The one right-hand side of every flight: one ball followed by scipy, thousands marched in a batch,
the simulator's, the renderer's, the measuring fit's and the mismatch engine's.

Flights in the plane of the picture, compiled: what a fit marches a thousand times.

`FlightModel` with drag and lift alone, by what a clip shows: K and the lift, not the masses and
coefficients behind them. A flight is x, y (m), vx, vy (m/s), K = ρ S C_D / 2 m (1/m), lift
(acceleration normal to the velocity per speed, 1/s; positive lifts a ball that flies to +x) and
gravity (m/s²).

The paper's flight in closed form (Eqs 13 to 16): horizontal drag, no vertical drag.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import EllipsisType

import numpy as np

from metrology import DomainError
from metrology.compiled import compiled
from physics.air import Air
from physics.bodies import GRAVITY, Ball
from physics.domain import (
    FloatArray,
    Number,
    require_finite,
    require_non_negative,
    require_positive,
)
from physics.effects.base import FlightState, Term
from physics.effects.flight import Drag, DragByReynolds, DragThroughLayer, Magnus
from physics.integrator import Event, SolvedPath, follow_until, runge_kutta_step

__all__ = [
    "FlightModel",
    "FlightPath",
    "Landing",
    "Launch",
    "drag_constant",
    "drag_free_distance",
    "flown",
    "fly",
    "land",
    "land_many",
    "rates",
    "time_of_fall",
]


@dataclass(frozen=True)
class FlightModel:
    """Ball, air and what acts on the ball; SI, floats or arrays that broadcast with the batch.

    Attributes
    ----------
    mass, diameter : Number
        kg, m.
    air_density, air_viscosity, gravity : Number
        kg/m³, Pa s, m/s² downwards.
    terms : sequence of Term
        Effects with a force; others are ignored.
    impact_speed, order : Number
        As in `FlightState`, for effects that change from trial to trial.
    """

    mass: Number
    diameter: Number
    air_density: Number
    air_viscosity: Number
    gravity: Number
    terms: Sequence[Term] = ()
    impact_speed: Number = 0.0
    order: Number = 0.0

    def with_terms(self, *terms: Term) -> "FlightModel":
        """The same ball and air with further effects."""
        return replace(self, terms=(*self.terms, *terms))

    def rates(self, time: Number, state: FloatArray) -> FloatArray:
        """Rates of (x, y, z, vx, vy, vz).

        Parameters
        ----------
        time : float or (...) array
            Since release, s.
        state : (6, ...) array
            m and m/s; x along the wall, y up, z off the wall.

        Returns
        -------
        (6, ...) array
            m/s and m/s².
        """
        slope = np.empty_like(state)
        slope[:3] = state[3:]
        slope[3:] = 0.0
        slope[4] = -self.gravity
        drag, spin = self._held(time, state)
        for at, terms in self._by_members:
            # effects that act in the same members see the same state
            seen = self._seen(time, state, at, _part(drag, at), _part(spin, at))
            forces = [term.effect.force(term.values, seen) for term in terms]
            for axis, along in enumerate(zip(*forces, strict=True), start=3):
                slope[(axis, at)] += sum(along[1:], along[0]) / self.mass
        return slope

    def _seen(
        self,
        time: Number,
        state: FloatArray,
        at: slice | EllipsisType,
        drag: Number = 0.0,
        spin: Number = 0.0,
    ) -> FlightState:
        x, y, z, vx, vy, vz = state if at is ... else state[:, at]
        return FlightState(
            time, x, y, z, vx, vy, vz, self.mass, self.diameter, self.air_density,
            self.air_viscosity, self.gravity, drag, spin, self.impact_speed, self.order,
        )  # fmt: skip

    @cached_property
    def _acting(self) -> tuple[Term, ...]:
        return tuple(term for term in self.terms if term.flies)

    @cached_property
    def _by_members(self) -> list[tuple[slice | EllipsisType, list[Term]]]:
        """Acting terms by the members of the batch that they act in."""
        found: list[tuple[slice | EllipsisType, list[Term]]] = []
        for term in self._acting:
            same = next((terms for at, terms in found if at == term.where), None)
            if same is None:
                found.append((term.where, [term]))
            else:
                same.append(term)
        return found

    @cached_property
    def _held_by_size(self) -> dict[int, tuple[Number, Number]]:
        """What `_held` found, by the size of the batch, where it does not change on the way."""
        return {}

    def _held(self, time: Number, state: FloatArray) -> tuple[Number, Number]:
        """Drag coefficient and spin of the model, for the effects that build on them."""
        size = state.shape[1] if state.ndim > 1 else 1
        if size in self._held_by_size:
            return self._held_by_size[size]
        drag: Number = 0.0
        spin: Number = 0.0
        if not all(isinstance(term.effect, Drag | Magnus) for term in self._acting):
            for term in self._acting:
                at = term.where
                if isinstance(term.effect, Drag):
                    here = term.effect.coefficient(term.values, self._seen(time, state, at))
                    drag = drag + _spread(here, at, state.shape)
                elif isinstance(term.effect, Magnus):
                    spin = spin + _spread(term.values["spin"], at, state.shape)
        if not any(isinstance(t.effect, DragByReynolds | DragThroughLayer) for t in self._acting):
            self._held_by_size[size] = drag, spin
        return drag, spin


def _spread(value: Number, at: slice | EllipsisType, shape: tuple[int, ...]) -> Number:
    """A value of some members as a column over the whole batch, nought in the others."""
    if isinstance(at, EllipsisType):
        return value
    column = np.zeros((shape[1], *np.shape(value)[1:]))
    column[at] = value
    return column


def _part(value: Number, at: slice | EllipsisType) -> Number:
    """A value in the members that an effect acts in."""
    return value[at] if isinstance(value, np.ndarray) and value.ndim else value


STEP = 0.02

"""s: fourth-order steps of this length keep flights of balls under a second to 0.1 mm."""

NEWTON_ROUNDS, CLOSE_ENOUGH = 6, 1e-12

"""Rounds of Newton's method on the last step at most, and m off the floor where it stops."""


@dataclass(frozen=True)
class FlightPath:
    """A path from launch (time 0) to landing (last row).

    World frame: x along the wall, y up, z towards the camera.

    Attributes
    ----------
    time : (N,) array
        s.
    position, velocity : (N, 3) array
        Ball's centre, m and m/s.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray

    @property
    def landing_time(self) -> float:
        """Seconds after launch."""
        return float(self.time[-1])

    @property
    def landing_position(self) -> FloatArray:
        """(3,) array, m."""
        return np.asarray(self.position[-1])

    @property
    def landing_velocity(self) -> FloatArray:
        """(3,) array, m/s."""
        return np.asarray(self.velocity[-1])


def fly(
    model: FlightModel,
    position: Sequence[float],
    velocity: Sequence[float],
    *,
    floor: float = 0.0,
    longest: float = 60.0,
    samples: int = 201,
    tolerance: float = 1e-10,
) -> FlightPath:
    """Fly a ball until its centre comes down to `floor` (steps b to e of the paper).

    Parameters
    ----------
    model : FlightModel
        Ball, air and forces, as floats.
    position, velocity : three floats
        At launch, m and m/s.
    floor : float
        Height of the centre at landing, m (the ball's radius where its lowest point touches down).
    longest : float
        Longest flight followed, s.
    samples : int
        Rows of the path.
    tolerance : float
        Relative and absolute tolerance of the solver (DOP853).

    Returns
    -------
    FlightPath

    Raises
    ------
    DomainError
        If the ball starts below the floor or does not land within `longest`.
    """
    start = np.array([*position, *velocity], dtype=np.float64)
    for name, part in (("position", start[:3]), ("velocity", start[3:])):
        require_finite(f"the {name} at launch", part)
    require_positive("the longest flight", longest, "s")
    if start[1] < floor:
        raise DomainError(f"a flight can't start below the floor ({start[1]:.3f} < {floor:.3f} m)")
    path = _path(model, start, floor, longest, tolerance)
    time = np.linspace(0.0, path.end, samples)
    states = path.at(time).T
    states[-1] = path.state
    return FlightPath(time, states[:, :3], states[:, 3:])


def _path(
    model: FlightModel, start: FloatArray, floor: float, longest: float, tolerance: float
) -> SolvedPath:
    def lands(_: float, state: FloatArray) -> float:
        return float(state[1]) - floor

    path = follow_until(
        model.rates,
        start,
        (0.0, longest),
        [Event(lands, -1.0)],
        method="DOP853",
        relative=max(tolerance, 3e-14),
        absolute=tolerance,
    )
    if path.ended_by is None:
        raise _not_landed("the ball has", longest)
    return path


def _not_landed(who: str, longest: float) -> DomainError:
    return DomainError(
        f"{who} not landed after {longest:g} s",
        hint="Is there gravity, and is the wind or lift of a believable size?",
    )


def land_many(
    model: FlightModel,
    state: FloatArray,
    *,
    floor: Number = 0.0,
    step: float = STEP,
    longest: float = 20.0,
) -> tuple[FloatArray, FloatArray]:
    """Fly many balls to the floor at once.

    Parameters
    ----------
    model : FlightModel
        Its numbers and its terms' values floats or (N,) arrays.
    state : (6, N) array
        At launch, m and m/s.
    floor : float or (N,) array
        Height of the ball's centre at landing, m.
    step : float
        Step, s.
    longest : float
        Longest flight followed, s.

    Returns
    -------
    time : (N,) array
        Landing times, s after launch.
    state : (6, N) array
        At landing.

    Raises
    ------
    DomainError
        If a ball has not landed within `longest`, or starts below the floor.
    """
    level = np.broadcast_to(np.asarray(floor, dtype=np.float64), state.shape[1:])
    if np.any(state[1] < level):
        raise DomainError("a flight can't start below the floor")
    landed = np.zeros(level.shape, dtype=bool)
    since = np.zeros(level.shape)
    bracket = state
    for count in range(int(np.ceil(longest / step))):
        after = runge_kutta_step(model.rates, count * step, state, step)
        arrives = (after[1] <= level) & ~landed & (after[4] < 0.0)
        if arrives.any():
            bracket = np.where(arrives, state, bracket)
            since = np.where(arrives, count * step, since)
            landed |= arrives
        if landed.all():
            return _land(model, bracket, since, step, level)
        state = after
    raise _not_landed(f"{int(np.sum(~landed))} of {landed.size} balls have", longest)


def _land(
    model: FlightModel, bracket: FloatArray, since: FloatArray, step: float, level: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Newton's method on the last step's length, from where each ball was still above the floor."""
    fall = np.full(since.shape, 0.5 * step)
    there = bracket
    for _ in range(NEWTON_ROUNDS):
        there = runge_kutta_step(model.rates, since, bracket, fall)
        miss = there[1] - level
        if np.max(np.abs(miss)) < CLOSE_ENOUGH:
            break
        fall = np.clip(fall - miss / np.minimum(there[4], -1e-9), 0.0, step)
    return since + fall, there


_STEP_S, _LEAST_STEP_S = 0.05, 1e-6

"""Runge–Kutta steps: a ball that drag slows by a tenth in a second is right to 1e-8 m with them."""

_NEWTON_STEPS = 6

"""Steps: Newton doubles the digits in each, and a sample of the path starts with three."""

# A search may try forces that would blow the path up.
_MOST_DRAG, _MOST_LIFT, _MOST_GRAVITY = 1.0, 5.0, 99.0


@compiled
def rates(flight: FloatArray, state: FloatArray, rate: FloatArray) -> None:
    """Put the rates (4,) of a state x, y, vx, vy into `rate`, m/s and m/s²."""
    drag = min(max(flight[4], -_MOST_DRAG), _MOST_DRAG)
    lift = min(max(flight[5], -_MOST_LIFT), _MOST_LIFT)
    gravity = min(max(flight[6], -_MOST_GRAVITY), _MOST_GRAVITY)
    vx, vy = state[2], state[3]
    resist = drag * math.hypot(vx, vy)
    rate[0], rate[1] = vx, vy
    rate[2] = -resist * vx - lift * vy
    rate[3] = -resist * vy + lift * vx - gravity


@compiled
def _march(flight: FloatArray, step: float, states: FloatArray, slopes: FloatArray) -> None:
    """Fill states and slopes (n + 1, 4) on an even grid from time 0, by Runge–Kutta."""
    state, second, third, fourth = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    for k in range(4):
        states[0, k] = flight[k]
    last = len(states) - 1
    for n in range(last):
        rates(flight, states[n], slopes[n])
        for k in range(4):
            state[k] = states[n, k] + 0.5 * step * slopes[n, k]
        rates(flight, state, second)
        for k in range(4):
            state[k] = states[n, k] + 0.5 * step * second[k]
        rates(flight, state, third)
        for k in range(4):
            state[k] = states[n, k] + step * third[k]
        rates(flight, state, fourth)
        for k in range(4):
            more = slopes[n, k] + 2.0 * (second[k] + third[k]) + fourth[k]
            states[n + 1, k] = states[n, k] + step / 6.0 * more
    rates(flight, states[last], slopes[last])


@compiled
def _read(
    states: FloatArray, slopes: FloatArray, step: float, time: float, found: FloatArray
) -> None:
    """The state (4,) at a time, by the cubic between two steps; the last one is continued."""
    place = time / step
    cell = min(max(int(place), 0), len(states) - 2)
    u = place - cell
    square, cube = u * u, u * u * u
    for k in range(4):
        found[k] = (
            states[cell, k] * (2.0 * cube - 3.0 * square + 1.0)
            + slopes[cell, k] * step * (cube - 2.0 * square + u)
            + states[cell + 1, k] * (3.0 * square - 2.0 * cube)
            + slopes[cell + 1, k] * step * (cube - square)
        )


@compiled
def flown(flights: FloatArray, elapsed: FloatArray) -> FloatArray:
    """States x, y, vx, vy (K, N, 4) of flights (K, 7) at times (N,) from their reference, s.

    Times before the reference are marched back to. A path that a search drives to infinity is
    worth nothing, and says so by NaN.
    """
    found = np.empty((len(flights), len(elapsed), 4))
    earliest, latest = 0.0, 0.0
    for n in range(len(elapsed)):
        earliest, latest = min(earliest, elapsed[n]), max(latest, elapsed[n])
    for back in (True, False):
        until = min(earliest, -_LEAST_STEP_S) if back else max(latest, _LEAST_STEP_S)
        steps = math.ceil(abs(until) / _STEP_S)
        states, slopes = np.empty((steps + 1, 4)), np.empty((steps + 1, 4))
        for row in range(len(flights)):
            _march(flights[row], until / steps, states, slopes)
            for n in range(len(elapsed)):
                if (elapsed[n] < 0.0) == back:
                    _read(states, slopes, until / steps, elapsed[n], found[row, n])
    return found


@compiled
def time_of_fall(flight: FloatArray, height: float, longest: float) -> float:
    """Time after which a flight (7,) comes down to a height (m), s; NaN if not within `longest`."""
    steps = math.ceil(max(longest, _LEAST_STEP_S) / _STEP_S)
    step = max(longest, _LEAST_STEP_S) / steps
    states, slopes = np.empty((steps + 1, 4)), np.empty((steps + 1, 4))
    _march(flight, step, states, slopes)
    here = np.empty(4)
    for n in range(steps):
        if states[n, 1] > height and states[n + 1, 1] <= height:
            at = n * step
            for _ in range(_NEWTON_STEPS):
                _read(states, slopes, step, at, here)
                at -= (here[1] - height) / here[3]
            return at
    return math.nan


@dataclass(frozen=True)
class Launch:
    """Where and how the ball leaves, in the paper's reading of the contact.

    Attributes
    ----------
    speed : float or array
        v_B, m/s.
    angle : float or array
        θ above the horizontal, rad.
    advance : float or array
        v_M^avg Δt: how far the ball was carried along θ during contact, m.
    """

    speed: Number
    angle: Number
    advance: Number


@dataclass(frozen=True)
class Landing:
    """Flight time (s) and distance of the centre from its rest position (m); floats or arrays."""

    time: Number
    distance: Number


def drag_constant(ball: Ball, air: Air, drag_coefficient: Number) -> Number:
    """K = ρ S C_D / (2 m), 1/m."""
    require_non_negative("the drag coefficient", drag_coefficient)
    return 0.5 * air.density * ball.area / ball.mass * drag_coefficient


def _dragged(distance: Number, constant: Number) -> Number:
    """ln(1 + K d) / K, exact as K → 0."""
    product = np.asarray(constant * distance, dtype=np.float64)
    small = np.abs(product) < 1e-5
    safe = np.where(small, 1.0, product)
    series = 1.0 - product / 2.0 + product**2 / 3.0
    result: Number = distance * np.where(small, series, np.log1p(safe) / safe)
    return result


def drag_free_distance(distance: Number, constant: Number) -> Number:
    """(exp(K d) − 1) / K, m, exact as K → 0: the distance without drag in the same time."""
    product = np.asarray(constant * distance, dtype=np.float64)
    small = np.abs(product) < 1e-5
    safe = np.where(small, 1.0, product)
    series = 1.0 + product / 2.0 + product**2 / 6.0
    result: Number = distance * np.where(small, series, np.expm1(safe) / safe)
    return result


def land(
    launch: Launch, support_height: Number, constant: Number, gravity: float = GRAVITY
) -> Landing:
    """Landing by Eqs 15 (with its bracket put right) and 16.

    t = (v sin θ + √((v sin θ)² + 2 g (h_s + a sin θ))) / g,
    x = ln(1 + K v cos θ t) / K + a cos θ, with a the advance during contact.

    Parameters
    ----------
    launch : Launch
    support_height : float or array
        h_s: how far the ball's lowest point falls to the floor, m.
    constant : float or array
        K, 1/m; 0 is allowed.
    gravity : float
        m/s².

    Returns
    -------
    Landing

    Raises
    ------
    DomainError
        If there is no gravity, or the ball starts below the floor.
    """
    require_positive("gravity", gravity, "m/s^2")
    require_non_negative("the drag constant", constant, "1/m")
    rise = launch.speed * np.sin(launch.angle)
    height = support_height + launch.advance * np.sin(launch.angle)
    under_root = rise * rise + 2.0 * gravity * height
    if np.any(under_root < 0.0):
        raise DomainError("the ball starts below the floor and never reaches it")
    time: Number = (rise + under_root**0.5) / gravity
    along: Number = launch.speed * np.cos(launch.angle) * time
    if np.any(constant * along <= -1.0):
        raise DomainError("a ball launched backwards this fast has no closed-form path")
    return Landing(time, _dragged(along, constant) + launch.advance * np.cos(launch.angle))
