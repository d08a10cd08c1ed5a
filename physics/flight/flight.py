"""Flights to the floor: one by scipy's adaptive solver, many at once by fixed steps.

The equation of motion of a ball in the air: gravity, and the forces of the effect catalogue.

The one right-hand side of every flight: one ball followed by scipy, thousands marched in a batch,
the simulator's, the renderer's, the measuring fit's and the mismatch engine's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import EllipsisType

import numpy as np

from metrology import DomainError
from physics.domain import FloatArray, Number, require_finite, require_positive
from physics.effects.base import FlightState, Term
from physics.effects.flight import Drag, DragByReynolds, Magnus
from physics.follow import Event, SolvedPath, follow_until
from physics.integrator import runge_kutta_step

__all__ = ["FlightModel", "FlightPath", "fly", "land_many"]


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
        for term in self._acting:
            at = term.where
            now = self._seen(time, state, at, _part(drag, at), _part(spin, at))
            for axis, force in enumerate(term.effect.force(term.values, now)):
                slope[(3 + axis, at)] += force / self.mass
        return slope

    def _seen(
        self,
        time: Number,
        state: FloatArray,
        at: slice | EllipsisType,
        drag: Number = 0.0,
        spin: Number = 0.0,
    ) -> FlightState:
        x, y, z, vx, vy, vz = (part[at] for part in state)
        return FlightState(
            time, x, y, z, vx, vy, vz, self.mass, self.diameter, self.air_density,
            self.air_viscosity, self.gravity, drag, spin, self.impact_speed, self.order,
        )  # fmt: skip

    @cached_property
    def _acting(self) -> tuple[Term, ...]:
        return tuple(term for term in self.terms if term.flies)

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
        if not any(isinstance(term.effect, DragByReynolds) for term in self._acting):
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
