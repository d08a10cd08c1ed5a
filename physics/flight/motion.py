"""The equation of motion of a ball in the air: gravity, and the forces of the effect catalogue.

The one right-hand side of every flight: one ball followed by scipy, thousands marched in a batch,
the simulator's, the renderer's, the measuring fit's and the mismatch engine's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import EllipsisType

import numpy as np

from physics.arrays import FloatArray, Number
from physics.effects.base import FlightState
from physics.effects.flight import Drag, DragByReynolds, Magnus
from physics.effects.term import Term

__all__ = ["FlightModel", "PlanarFlight"]


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


@dataclass(frozen=True)
class PlanarFlight:
    """`FlightModel` with drag and lift alone, in the plane of the picture, by what a fit finds.

    A clip shows K and the lift, not the masses and coefficients behind them; four components
    instead of six make a fit's Jacobian cheap.

    Attributes
    ----------
    drag : Number
        K = ρ S C_D / 2 m, 1/m.
    lift : Number
        Acceleration normal to the velocity per speed, 1/s; positive lifts a ball that flies to +x.
    gravity : Number
        m/s².
    """

    drag: Number
    lift: Number
    gravity: Number

    def rates(self, time: Number, state: FloatArray) -> FloatArray:
        """Rates (4, ...) of (x, y, vx, vy), m/s and m/s²; the time does not matter."""
        _x, _y, vx, vy = state
        resist = self.drag * np.hypot(vx, vy)
        return np.array(
            [vx, vy, -resist * vx - self.lift * vy, -resist * vy + self.lift * vx - self.gravity]
        )


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
