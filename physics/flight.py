"""Flight of a ball: equation of motion, numerical integration and closed form.

`FlightModel` is the equation of motion with gravity and the forces of the effect catalogue, used by
simulation, rendering, measuring and the mismatch engine; `fly` solves one flight adaptively and
`land_many` many at once with fixed steps. `flown` and `time_of_fall` are compiled flights in the
picture plane with drag and lift only, for fits: a flight is x, y (m), vx, vy (m/s), K = ρ S C_D / 2
m (1/m), lift (acceleration normal to the velocity per speed, 1/s; positive lifts a ball that flies
to +x) and gravity (m/s²). `land` is the paper's closed form (Eqs 13 to 16) with horizontal drag
only.
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
from physics.effects.base import FlightState, Term, rows_of
from physics.effects.flight import Drag, DragByReynolds, DragThroughLayer, Magnus
from physics.integrator import SolvedPath, ZeroCrossing, follow_until, runge_kutta_step

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
    """Equation of motion of a ball in air; SI, floats or arrays that broadcast with the batch.

    Attributes
    ----------
    mass, diameter : Number
        kg, m.
    air_density, air_viscosity, gravity : Number
        kg/m³, Pa s, m/s² downwards.
    terms : sequence of Term
        Effects with a force; others are ignored.
    impact_speed, order : Number
        As in `FlightState`, for effects that depend on the trial.
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
            # Effects that act in the same members share one state.
            seen = self._seen(time, state, at, _part(drag, at), _part(spin, at))
            forces = [term.effect.force(term.values, seen) for term in terms]
            for axis, along in enumerate(zip(*forces, strict=True), start=3):
                slope[(axis, at)] += sum(along[1:], along[0]) / rows_of(self.mass, at)
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
        stated = (self.mass, self.diameter, self.air_density)
        mass, diameter, density = (rows_of(one, at) for one in stated)
        return FlightState(
            time, x, y, z, vx, vy, vz, mass, diameter, density, self.air_viscosity, self.gravity,
            drag, spin, self.impact_speed, self.order,
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
        """Results of `_held` by batch size, where they are constant during the flight."""
        return {}

    def _held(self, time: Number, state: FloatArray) -> tuple[Number, Number]:
        """Drag coefficient and spin, for the effects that build on them."""
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
    """A value of some members as a column over the whole batch, zero in the others."""
    if isinstance(at, EllipsisType):
        return value
    column = np.zeros((shape[1], *np.shape(value)[1:]))
    column[at] = value
    return column


def _part(value: Number, at: slice | EllipsisType) -> Number:
    """A value in the members that an effect acts in."""
    return value[at] if isinstance(value, np.ndarray) and value.ndim else value


FLIGHT_STEP_S = 0.02
"""Step, s (measured: flights of balls under a second are accurate to 0.1 mm)."""

MAX_LANDING_ROUNDS, LANDING_TOLERANCE_M = 6, 1e-12
"""Maximum Newton iterations for the last step, and height error at convergence, m (chosen)."""


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
    """Simulate a flight until the centre reaches `floor` (steps b to e of the paper).

    Parameters
    ----------
    model : FlightModel
        Ball, air and forces, as floats.
    position, velocity : three floats
        At launch, m and m/s.
    floor : float
        Height of the centre at landing, m (the ball's radius, if its lowest point lands).
    longest : float
        Maximum duration, s.
    samples : int
        Rows of the path.
    tolerance : float
        Relative and absolute tolerance of the solver (DOP853).

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
        [ZeroCrossing(lands, -1.0)],
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
        hint="Check gravity, and the size of wind and lift.",
    )


def land_many(
    model: FlightModel,
    state: FloatArray,
    *,
    floor: Number = 0.0,
    step: float = FLIGHT_STEP_S,
    longest: float = 20.0,
) -> tuple[FloatArray, FloatArray]:
    """Simulate many flights to the floor at once.

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
        Maximum duration, s.

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
    """Newton's method for the last step's length, from the last state above the floor."""
    fall = np.full(since.shape, 0.5 * step)
    there = bracket
    for _ in range(MAX_LANDING_ROUNDS):
        there = runge_kutta_step(model.rates, since, bracket, fall)
        miss = there[1] - level
        if np.max(np.abs(miss)) < LANDING_TOLERANCE_M:
            break
        fall = np.clip(fall - miss / np.minimum(there[4], -1e-9), 0.0, step)
    return since + fall, there


_STEP_S, _MIN_FLIGHT_STEP_S = 0.05, 1e-6
"""Runge–Kutta step and its minimum, s (measured: a ball that drag slows by a tenth per second is
accurate to 1e-8 m)."""

_FALL_NEWTON_STEPS = 6
"""Newton iterations (derived: each doubles the digits, starting from three)."""

_MAX_DRAG, _MAX_LIFT, _MAX_GRAVITY = 1.0, 5.0, 99.0
"""Limits of K (1/m), lift (1/s) and gravity (m/s²) in a search (chosen), so that paths stay
finite."""


@compiled
def rates(flight: FloatArray, state: FloatArray, rate: FloatArray) -> None:
    """Write the rates (4,) of a state x, y, vx, vy into `rate`, m/s and m/s²."""
    drag = min(max(flight[4], -_MAX_DRAG), _MAX_DRAG)
    lift = min(max(flight[5], -_MAX_LIFT), _MAX_LIFT)
    gravity = min(max(flight[6], -_MAX_GRAVITY), _MAX_GRAVITY)
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
    """State (4,) at a time, by the cubic between two steps; the end cubics extrapolate."""
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

    Times before the reference are integrated backwards. A path that a search drives to infinity
    gives NaN.
    """
    found = np.empty((len(flights), len(elapsed), 4))
    earliest, latest = 0.0, 0.0
    for n in range(len(elapsed)):
        earliest, latest = min(earliest, elapsed[n]), max(latest, elapsed[n])
    for back in (True, False):
        until = min(earliest, -_MIN_FLIGHT_STEP_S) if back else max(latest, _MIN_FLIGHT_STEP_S)
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
    steps = math.ceil(max(longest, _MIN_FLIGHT_STEP_S) / _STEP_S)
    step = max(longest, _MIN_FLIGHT_STEP_S) / steps
    states, slopes = np.empty((steps + 1, 4)), np.empty((steps + 1, 4))
    _march(flight, step, states, slopes)
    here = np.empty(4)
    for n in range(steps):
        if states[n, 1] > height and states[n + 1, 1] <= height:
            at = n * step
            for _ in range(_FALL_NEWTON_STEPS):
                _read(states, slopes, step, at, here)
                at -= (here[1] - height) / here[3]
            return at
    return math.nan


@dataclass(frozen=True)
class Launch:
    """Launch of the ball after the paper's impulsive contact.

    Attributes
    ----------
    speed : float or array
        v_B, m/s.
    angle : float or array
        θ above the horizontal, rad.
    advance : float or array
        v_M^avg Δt: displacement of the ball along θ during contact, m.
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
    """Landing by Eqs 15 (with its bracket corrected) and 16.

    t = (v sin θ + √((v sin θ)² + 2 g (h_s + a sin θ))) / g,
    x = ln(1 + K v cos θ t) / K + a cos θ, with a the advance during contact.

    Parameters
    ----------
    support_height : float or array
        h_s: height of the ball's lowest point above the floor, m.
    constant : float or array
        K, 1/m; 0 is allowed.
    gravity : float
        m/s².

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
