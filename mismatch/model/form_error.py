"""What a law's form may be wrong by: smooth relative errors along the law's own coordinate.

A law is right up to a form that differs from apparatus to apparatus. Its error is written as the
law itself times a smooth function of the coordinate that it depends on (Legendre polynomials, which
for smooth functions stand for a Gaussian process with a long correlation length), each weight with
a Gaussian prior around nothing. What a contact hands over may be off in each of its parts.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.polynomial import legendre

from mismatch.model.forward import Forward
from physics.domain import FloatArray, Number, Vector
from physics.effects import (
    CameraView,
    Contact,
    Coordinate,
    Effect,
    FlightState,
    Outcome,
    Parameter,
    SwingState,
    Values,
)

__all__ = ["FormError", "form_errors"]

ORDERS = (1, 2, 3)
"""Orders of the Legendre polynomials that a law's form may be off by: straight, bent once, bent
twice."""
IMPACT_ORDERS = (0, 1)
SIDEWAYS = frozenset({"z", "vz"})
"""Parts of an outcome that no face moves: a strike is planar."""
PARTS = tuple(f.name for f in fields(Outcome) if f.name not in SIDEWAYS)
WEIGHT = Parameter("weight", "1", 0.1, -1e6, 1e6, meaning="relative error of the form")


@dataclass(frozen=True)
class FormError(Effect):
    """One smooth relative error of a law that a model holds.

    Attributes
    ----------
    of : Effect
        The law.
    held : tuple of (name, value)
        Its parameters where the error is looked for.
    hook : str
        Which of its hooks.
    order : int
        Of the polynomial.
    low, high : float
        Range of the coordinate.
    part : str
        Of what a contact hands over; "" otherwise.
    """

    of: Effect | None = None
    held: tuple[tuple[str, float], ...] = ()
    hook: str = "force"
    order: int = 1
    low: float = 0.0
    high: float = 1.0
    part: str = ""

    @property
    def hooks(self) -> frozenset[str]:
        """The one hook."""
        return frozenset({self.hook})

    @property
    def _law(self) -> Effect:
        if self.of is None:
            raise TypeError("an error of a form needs a law that it belongs to")
        return self.of

    @property
    def _held(self) -> Mapping[str, float]:
        return dict(self.held)

    def _smooth(self, coordinate: Number) -> FloatArray:
        middle, half = 0.5 * (self.low + self.high), 0.5 * max(self.high - self.low, 1e-12)
        place = np.clip((np.asarray(coordinate, dtype=np.float64) - middle) / half, -1.2, 1.2)
        weights = np.zeros(self.order + 1)
        weights[-1] = 1.0
        return np.asarray(legendre.legval(place, weights))

    def force(self, values: Values, flight: FlightState) -> Vector:
        """The law's force times the error."""
        k = values["weight"] * self._smooth(_flight_place(self._law.coordinate, flight))
        fx, fy, fz = self._law.force(self._held, flight)
        return k * fx, k * fy, k * fz

    def torque(self, values: Values, swing: SwingState) -> Number:
        """The law's torque times the error."""
        rate = self._law.coordinate is Coordinate.RATE
        place = np.abs(swing.omega) if rate else np.asarray(swing.phi)
        return values["weight"] * self._smooth(place) * self._law.torque(self._held, swing)

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """One part of the outcome off by a share of what the law changes."""
        changed = self._law.contact(self._held, contact, outcome)
        size = _sizes(contact, outcome, changed)[self.part]
        smooth = self._smooth(contact.impact_speed)
        return replace(
            outcome, **{self.part: getattr(outcome, self.part) + values["weight"] * smooth * size}
        )

    def clock(self, values: Values, time: Number) -> Number:
        """The law's change of the clock times the error."""
        return time + values["weight"] * self._smooth(time) * (
            self._law.clock(self._held, time) - time
        )

    def image(self, values: Values, view: CameraView) -> Vector:
        """The law's displacement times the error, along the way."""
        k = values["weight"] * self._smooth((view.x - view.centre_x) / view.half_width)
        x, y, z = self._law.image(self._held, view)
        return view.x + k * (x - view.x), view.y + k * (y - view.y), view.z + k * (z - view.z)


def _flight_place(coordinate: Coordinate, flight: FlightState) -> Number:
    places: Mapping[Coordinate, Number] = {
        Coordinate.TIME: flight.time,
        Coordinate.HEIGHT: flight.y,
        Coordinate.PLACE: flight.x,
    }
    return places.get(coordinate, flight.speed)


def _sizes(contact: Contact, before: Outcome, after: Outcome) -> dict[str, FloatArray]:
    """How large an error of each part is, when the whole change is taken for unsure."""
    moved = {name: np.asarray(getattr(after, name) - getattr(before, name)) for name in PARTS}
    speed = np.sqrt(
        np.square(moved["vx"]) + np.square(moved["vy"]) + np.square(moved["pendulum_speed"])
    )
    gap = np.asarray(before.contact_time)
    longer = np.abs(moved["contact_time"]) + speed / np.maximum(contact.impact_speed, 1e-6) * gap
    way = np.hypot(moved["x"], moved["y"]) + 0.5 * gap * speed
    angle = np.abs(moved["pendulum_angle"]) + 0.5 * gap * speed / contact.length
    return {
        "vx": speed, "vy": speed, "pendulum_speed": speed, "x": way, "y": way,
        "contact_time": longer, "pendulum_angle": angle,
    }  # fmt: skip


def form_errors(forward: Forward, law: Effect, values: Mapping[str, float]) -> tuple[Effect, ...]:
    """Every error that a law's form may have, for the campaign that `forward` predicts.

    None where the law is declared exact.
    """
    if law.looseness <= 0.0:
        return ()
    held = tuple((name, float(value)) for name, value in values.items())
    blank = FormError(
        "form_error", "", "", "", law.phase, (WEIGHT,), sharp=law.sharp, of=law, held=held
    )
    found: list[Effect] = []
    if "contact" in law.hooks:
        speeds = forward.nominal_speed()
        low, high = float(speeds.min()), float(speeds.max())
        found += [
            replace(blank, hook="contact", part=part, order=order, low=low, high=high)
            for part in PARTS
            for order in IMPACT_ORDERS
        ]
    spans = {
        "force": forward.flight_span(law.coordinate),
        "torque": forward.swing_span(law.coordinate),
        "clock": (0.0, float(np.median(forward.flight_time))),
        "image": (-1.0, 1.0),
    }
    for hook in sorted(law.hooks & spans.keys()):
        low, high = spans[hook]
        found += [replace(blank, hook=hook, order=n, low=low, high=high) for n in ORDERS]
    return tuple(found)
