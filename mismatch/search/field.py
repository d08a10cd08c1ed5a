"""A force of unknown law as a smooth curve over one coordinate: what no catalogue holds.

Cubic B-splines over time, place, height or speed, their weights with one Gaussian prior (a Gaussian
process with the correlation length of a knot). The prior's width is the one of highest evidence;
what the freedom costs is the evidence's own price for it, so that such a field competes on equal
terms with every set of named effects.
"""

from dataclasses import dataclass

import numpy as np

from mismatch.model.forward import Forward
from physics.domain import FloatArray, Number, Vector
from physics.effects import Coordinate, Effect, FlightState, Parameter, Phase, Size, Values

__all__ = ["Field", "smooth_fields"]

KNOTS = 9
"""Weights of one curve: pieces of an eighth of the coordinate, shorter than most gusts."""

WIDTH = 0.05
"""In weights of the ball, where no evidence has chosen it yet."""

LOOKS = 3.0
"""Chi-square units for having chosen the width among a handful."""

WORDS = {
    Coordinate.TIME: "the time since release",
    Coordinate.PLACE: "the place along the way",
    Coordinate.HEIGHT: "the height",
    Coordinate.SPEED: "the speed",
}

UNITS = {
    Coordinate.TIME: "s",
    Coordinate.PLACE: "m",
    Coordinate.HEIGHT: "m",
    Coordinate.SPEED: "m/s",
}

FELT = 0.1
"""Share of its largest value from which a force is said to act."""


def _weights() -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"force_{k}", "N", 0.02, -300.0, 300.0, meaning=f"height of the spline at knot {k}",
            width=WIDTH, expected=0.0, in_units_of=Size.BALL_WEIGHT, width_in=Size.BALL_WEIGHT,
        )
        for k in range(KNOTS)
    )  # fmt: skip


@dataclass(frozen=True)
class Field(Effect):
    """A force along a direction as a smooth curve over one coordinate.

    Attributes
    ----------
    low, high : float
        Range of the coordinate, where the first and last spline have their middle.
    looks : float
        Chi-square units that finding it costs beyond the evidence.
    """

    id: str = "unnamed"
    statement: str = "A force that no simple law describes."
    law: str = r"F = \sum_k F_k B_k(c)"
    source: str = "cubic B-splines with a Gaussian prior, fitted to this campaign"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = _weights()
    form: str = "horizontal"
    separating: str = "the same shot with the apparatus moved or at another time"
    looseness: float = 0.0
    low: float = 0.0
    high: float = 1.0
    looks: float = LOOKS

    def size(self, values: Values, place: Number) -> FloatArray:
        """The curve itself, N, at values of the coordinate."""
        scaled = (np.asarray(place) - self.low) / (self.high - self.low) * (KNOTS - 1)
        terms = [values[p.name] * _spline(scaled - k) for k, p in enumerate(self.parameters)]
        return np.asarray(np.sum(np.broadcast_arrays(*terms), axis=0))

    def in_words(self, values: Values) -> str:
        """Where the force is strongest, how strong, and where it has fallen to a tenth of that."""
        grid = np.linspace(self.low, self.high, 201)
        size = self.size(values, grid)
        top = int(np.argmax(np.abs(size)))
        unit = UNITS[self.coordinate]
        felt = grid[np.abs(size) > FELT * abs(size[top])]
        reach = f"from {felt.min():.3g} {unit} to {felt.max():.3g} {unit}"
        return (
            f"{size[top]:+.3g} N at most, where {WORDS[self.coordinate]} is {grid[top]:.3g} {unit};"
            f" more than a tenth of that {reach}"
        )

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Sum of splines, along the direction."""
        place = {
            Coordinate.TIME: flight.time,
            Coordinate.PLACE: flight.x,
            Coordinate.HEIGHT: flight.y,
        }.get(self.coordinate, flight.speed)
        size = self.size(values, place) + 0.0 * np.asarray(flight.x)
        nothing = np.zeros_like(size)
        if self.form == "horizontal":
            return size, nothing, nothing
        if self.form == "vertical":
            return nothing, size, nothing
        k = size / np.maximum(flight.speed, 1e-6)
        if self.form == "along_velocity":
            return k * flight.vx, k * flight.vy, k * flight.vz
        return -k * flight.vy, k * flight.vx, nothing


def _spline(apart: FloatArray) -> FloatArray:
    """Cardinal cubic B-spline of unit knots, one at its middle."""
    u = np.minimum(np.abs(apart), 2.0)
    inner = 1.0 - 1.5 * u**2 * (1.0 - 0.5 * u)
    outer = 0.25 * (2.0 - u) ** 3
    return np.asarray(np.where(u < 1.0, inner, outer))


def smooth_fields(forward: Forward) -> tuple[Field, ...]:
    """Every smooth field of a force that makes sense for a campaign."""
    if forward.mode != "impact":
        return ()
    found = []
    for coordinate in (Coordinate.TIME, Coordinate.PLACE, Coordinate.HEIGHT, Coordinate.SPEED):
        along = coordinate is Coordinate.SPEED
        ways = ("along_velocity", "normal_to_velocity") if along else ("horizontal", "vertical")
        low, high = forward.flight_span(coordinate)
        said = (
            f"A force that changes with {WORDS[coordinate]}, as a curve that no simple law gives."
        )
        found += [
            Field(form=way, coordinate=coordinate, low=low, high=max(high, low + 1e-3),
                  statement=said)
            for way in ways
        ]  # fmt: skip
    return tuple(found)
