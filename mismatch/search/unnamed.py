"""Laws and smooth curves for forces that are in no catalogue.

Laws are a strength with the unit of a force, torque or ratio times a shape without a unit. Curves
are cubic B-splines over time, place, height, speed or direction of a flight, angle or rate of a
swing, or the order of trials; they are forces, torques, or errors of reading. Their weights have
one Gaussian prior, whose width is the one of highest evidence. All carry the id ``unnamed``.
"""

from dataclasses import dataclass, replace

import numpy as np

from mismatch.forward import Forward
from physics.domain import FloatArray, Number, Vector
from physics.effects import (
    CameraView,
    Contact,
    Coordinate,
    Effect,
    Extent,
    FlightState,
    Outcome,
    Parameter,
    Phase,
    Size,
    SwingState,
    Values,
)
from physics.effects.impact import change_restitution, turn_launch

__all__ = [
    "Ageing",
    "Bump",
    "ClockCurve",
    "Drift",
    "Field",
    "Gust",
    "Magnet",
    "NearFloor",
    "Notch",
    "PeriodicForce",
    "PictureCurve",
    "PlacedBrake",
    "Pull",
    "ReadingCurve",
    "ResistanceCurve",
    "RestoringTorque",
    "SmoothCurve",
    "SpeedPower",
    "TorqueField",
    "Well",
    "smooth_fields",
    "unnamed_laws",
]

SOURCE = "fitted to this campaign"


def _along(direction: str, strength: FloatArray, flight: FlightState) -> Vector:
    """A force of given strength along a named direction."""
    axes = ("horizontal", "vertical", "out_of_plane")
    if direction in axes:
        size = strength + 0.0 * np.asarray(flight.vx)
        x, y, z = (size if direction == one else np.zeros_like(size) for one in axes)
        return x, y, z
    k = strength / np.maximum(flight.speed, 1e-6)
    if direction == "along_velocity":
        return k * flight.vx, k * flight.vy, k * flight.vz
    return -k * flight.vy, k * flight.vx, 0.0 * k * flight.vz


def _strength(scale: float = 0.02) -> Parameter:
    """A force, its scale and bounds in weights of the ball."""
    return Parameter(
        "strength", "N", scale, -300.0, 300.0, meaning="size of the force",
        in_units_of=Size.BALL_WEIGHT,
    )  # fmt: skip


def _shares(low: float, high: float, count: int) -> tuple[float, ...]:
    return tuple(float(v) for v in np.linspace(low, high, count))


@dataclass(frozen=True)
class UnnamedLaw(Effect):
    """A law in no catalogue; where nothing else is said it acts on a flight."""

    id: str = "unnamed"
    statement: str = ""
    law: str = ""
    source: str = SOURCE
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = ()
    looseness: float = 0.2


@dataclass(frozen=True)
class SpeedPower(UnnamedLaw):
    """A force along, or normal to, the velocity with a power of the speed."""

    statement: str = "A force in proportion to a power of the speed."
    law: str = r"F = k\,(|v| / 1\,\mathrm{m/s})^p"
    parameters: tuple[Parameter, ...] = (
        _strength(),
        Parameter("power", "1", 0.7, -1.0, 6.0, grid=(0.0, 0.5, 1.0, 1.3, 1.6, 3.0, 4.0)),
    )
    form: str = "along_velocity"
    separating: str = "another launch speed"
    sharp: bool = False

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Power law."""
        size = values["strength"] * np.maximum(flight.speed, 1e-6) ** values["power"]
        return _along(self.form, size, flight)


@dataclass(frozen=True)
class Gust(UnnamedLaw):
    """A force that acts for a while."""

    statement: str = "A force that acts during a part of the flight."
    law: str = r"F = F_0\,w((t - t_0)/\tau)"
    parameters: tuple[Parameter, ...] = (
        _strength(),
        Parameter(
            "middle", "s", 0.1, -0.5, 1e4, grid=_shares(0.06, 1.1, 11), over=Extent.FLIGHT_TIME
        ),
        Parameter(
            "duration", "s", 0.1, 0.02, 1e4, grid=(0.12, 0.3), over=Extent.FLIGHT_TIME
        ),
    )  # fmt: skip
    form: str = "horizontal"
    separating: str = "the same shot at another time of day, fans and doors shut"
    coordinate: Coordinate = Coordinate.TIME

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Full strength within the window, with edges of a twelfth of its length."""
        edge = values["duration"] / 12.0
        begin = flight.time - (values["middle"] - 0.5 * values["duration"])
        end = flight.time - (values["middle"] + 0.5 * values["duration"])
        window = 0.5 * (np.tanh(begin / edge) - np.tanh(end / edge))
        return _along(self.form, values["strength"] * window, flight)


@dataclass(frozen=True)
class PeriodicForce(UnnamedLaw):
    """A force that swings to and fro during the flight, in step with the release."""

    statement: str = "A force that swings to and fro during the flight."
    law: str = r"F = A \sin 2\pi f t + B \cos 2\pi f t"
    parameters: tuple[Parameter, ...] = (
        replace(_strength(), name="sine"),
        replace(_strength(), name="cosine"),
        Parameter(
            "period", "s", 0.1, 0.02, 1e4, grid=(0.2, 0.3, 0.45, 0.7, 1.0), over=Extent.FLIGHT_TIME
        ),
    )  # fmt: skip
    form: str = "horizontal"
    separating: str = "the same shot at another time of day, fans and doors shut"
    coordinate: Coordinate = Coordinate.TIME

    def force(self, values: Values, flight: FlightState) -> Vector:
        """One frequency, any phase."""
        phase = 2.0 * np.pi * np.asarray(flight.time) / values["period"]
        size = values["sine"] * np.sin(phase) + values["cosine"] * np.cos(phase)
        return _along(self.form, size, flight)


@dataclass(frozen=True)
class NearFloor(UnnamedLaw):
    """A force that grows towards the floor."""

    statement: str = "A force that grows towards the floor."
    law: str = r"F = F_0\,e^{-(y - d/2)/\lambda}"
    parameters: tuple[Parameter, ...] = (
        _strength(),
        Parameter("decay_length", "m", 0.05, 0.005, 5.0, grid=(0.03, 0.06, 0.1, 0.2)),
    )
    form: str = "vertical"
    separating: str = "a flight well above the floor"
    coordinate: Coordinate = Coordinate.HEIGHT

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Exponential in the height of the ball's lowest point."""
        height = flight.y - 0.5 * np.asarray(flight.diameter)
        size = values["strength"] * np.exp(-np.clip(height / values["decay_length"], -3.0, 60.0))
        return _along(self.form, size, flight)


@dataclass(frozen=True)
class Magnet(UnnamedLaw):
    """A pull towards a point, or a push away from it, within a short reach."""

    statement: str = "A force towards a point, within a short reach of it."
    law: str = (
        r"\mathbf F = F_0\,\frac{\mathbf q}{w} e^{-q^2/2w^2},\ \mathbf q = \mathbf r_0 - \mathbf r"
    )
    parameters: tuple[Parameter, ...] = (
        _strength(),
        Parameter("place_x", "m", 0.06, -1e4, 1e4, grid=_shares(0.05, 0.95, 8), over=Extent.WAY),
        Parameter("place_y", "m", 0.1, -1e4, 1e4, grid=_shares(-0.1, 1.1, 4), over=Extent.HEIGHT),
        Parameter("reach", "m", 0.035, 0.005, 1e3, grid=(0.035, 0.1), over=Extent.LENGTH_OF_WAY),
    )
    form: str = "towards a point"
    separating: str = "the same shot with the apparatus moved by half a metre"
    coordinate: Coordinate = Coordinate.PLACE

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Radial, strongest at one reach from the point."""
        dx, dy = values["place_x"] - flight.x, values["place_y"] - flight.y
        reach = values["reach"]
        size = np.exp(-0.5 * (np.square(dx) + np.square(dy)) / np.square(reach)) / reach
        k = values["strength"] * size
        return k * dx, k * dy, np.zeros_like(k)


@dataclass(frozen=True)
class Bump(UnnamedLaw):
    """A force in a stretch of the path, whatever the height."""

    statement: str = "A force in a stretch of the path."
    law: str = r"F = F_0\,e^{-(x - x_0)^2/2w^2}"
    parameters: tuple[Parameter, ...] = (
        _strength(),
        Parameter("place", "m", 0.06, -1e4, 1e4, grid=_shares(0.05, 0.95, 8), over=Extent.WAY),
        Parameter("reach", "m", 0.035, 0.005, 1e3, grid=(0.035, 0.1), over=Extent.LENGTH_OF_WAY),
    )
    form: str = "horizontal"
    separating: str = "the same shot with the apparatus moved by half a metre"
    coordinate: Coordinate = Coordinate.PLACE

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Gaussian in the distance flown."""
        apart = (flight.x - values["place"]) / values["reach"]
        return _along(self.form, values["strength"] * np.exp(-0.5 * np.square(apart)), flight)


@dataclass(frozen=True)
class Pull(Bump):
    """A force along the path that turns its sign at a place: a pull towards it or a push away."""

    statement: str = "A force towards a place on the path, within a short distance of it."
    law: str = r"F = F_0\,q\,e^{-q^2/2},\quad q = (x_0 - x)/w"
    form: str = "horizontal"

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Derivative of a Gaussian in the distance flown."""
        apart = (values["place"] - flight.x) / values["reach"]
        size = values["strength"] * apart * np.exp(-0.5 * np.square(apart))
        return _along(self.form, size, flight)


@dataclass(frozen=True)
class Notch(UnnamedLaw):
    """A torque at one place of the swing."""

    statement: str = "A torque on the pendulum near one angle of its swing."
    law: str = r"\tau = \tau_0\,e^{-(\varphi - \varphi_0)^2/2w^2}"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "strength", "N m", 0.3, -300.0, 300.0, meaning="size of the torque",
            in_units_of=Size.PENDULUM_TORQUE,
        ),
        Parameter(
            "place", "rad", 0.1, -3.2, 3.2,
            grid=(-1.6, -1.2, -0.9, -0.7, -0.5, -0.35, -0.2, -0.1, 0.0, 0.1, 0.25, 0.4, 0.6),
        ),
        Parameter("reach", "rad", 0.03, 0.005, 1.0, grid=(0.03, 0.08)),
    )  # fmt: skip
    form: str = "angle"
    separating: str = "a slow swing by hand through that angle"
    coordinate: Coordinate = Coordinate.ANGLE

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Gaussian in the angle."""
        apart = (swing.phi - values["place"]) / values["reach"]
        return values["strength"] * np.exp(-0.5 * np.square(apart))


@dataclass(frozen=True)
class Well(Notch):
    """A torque towards an angle, or away from it, within a short reach: a magnet under the bob."""

    statement: str = "A torque towards one angle of the swing, within a short reach of it."
    law: str = r"\tau = \tau_0\,q\,e^{-q^2/2},\quad q = (\varphi_0 - \varphi)/w"
    parameters: tuple[Parameter, ...] = (
        Notch().parameters[0],
        Parameter("place", "rad", 0.1, -0.6, 0.6, grid=(-0.4, -0.2, -0.1, 0.0, 0.1, 0.2, 0.4)),
        Notch().parameters[2],
    )

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Derivative of a Gaussian in the angle."""
        apart = (values["place"] - swing.phi) / values["reach"]
        return values["strength"] * apart * np.exp(-0.5 * np.square(apart))


@dataclass(frozen=True)
class PlacedBrake(Notch):
    """Damping near the lowest point alone: eddy currents between the poles of a magnet.

    Far from it, where swings of one size all turn back, it would pass for any loss at all.
    """

    statement: str = "The swing is braked near its lowest point, in proportion to its rate there."
    law: str = r"\tau = -c\,\dot\varphi\,e^{-(\varphi - \varphi_0)^2/2w^2}"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "strength", "N m s", 0.1, 0.0, 300.0, meaning="torque per rate, where it is most",
            in_units_of=Size.PENDULUM_TORQUE,
        ),
        Parameter("place", "rad", 0.05, -0.25, 0.25, grid=(-0.1, 0.0, 0.1)),
        Parameter("reach", "rad", 0.03, 0.005, 0.3, grid=(0.03, 0.1)),
    )  # fmt: skip

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Viscous, times a Gaussian in the angle."""
        apart = (swing.phi - values["place"]) / values["reach"]
        return -values["strength"] * swing.omega * np.exp(-0.5 * np.square(apart))


@dataclass(frozen=True)
class PlacedFriction(Notch):
    """Dry friction near one angle alone: a sticky patch of a bearing, a hair that is brushed.

    Wider than its reach allows it would pass for dry friction everywhere.
    """

    statement: str = "Dry friction near one angle of the swing brakes whatever passes it."
    law: str = r"\tau = -\tau_0\,\mathrm{sgn}\,\dot\varphi\,e^{-(\varphi - \varphi_0)^2/2w^2}"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "strength", "N m", 0.3, 0.0, 300.0, meaning="size of the torque where it is most",
            in_units_of=Size.PENDULUM_TORQUE,
        ),
        Parameter(
            "place", "rad", 0.1, -0.8, 0.8,
            grid=(-0.5, -0.35, -0.2, -0.1, 0.0, 0.1, 0.2, 0.35, 0.5),
        ),
        Parameter("reach", "rad", 0.03, 0.005, 0.15, grid=(0.05,)),
    )  # fmt: skip

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Against the motion, times a Gaussian in the angle."""
        apart = (swing.phi - values["place"]) / values["reach"]
        return -values["strength"] * swing.sense * np.exp(-0.5 * np.square(apart))


@dataclass(frozen=True)
class RestoringTorque(UnnamedLaw):
    """A restoring torque that wide swings feel otherwise than gravity's, small ones alike.

    Where it makes up for all that the sine falls short of the angle, swings of any width keep one
    period: a torsion wire, a spring, a cycloid.
    """

    statement: str = "Wide swings are drawn back otherwise than by gravity alone."
    law: str = r"\tau = -k\,(\varphi - \sin\varphi)"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "strength", "N m", 1.0, -300.0, 300.0, meaning="torque beyond the sine's",
            in_units_of=Size.PENDULUM_TORQUE,
        ),
    )  # fmt: skip
    form: str = "angle"
    separating: str = "the same swings by hand, with a spring balance"
    coordinate: Coordinate = Coordinate.ANGLE
    sharp: bool = False

    def torque(self, values: Values, swing: SwingState) -> Number:
        """In proportion to what the sine leaves of the angle."""
        return -values["strength"] * (swing.phi - np.sin(swing.phi))


@dataclass(frozen=True)
class Ageing(UnnamedLaw):
    """Something that drifts from trial to trial."""

    statement: str = "The contact changes from trial to trial (ageing)."
    law: str = r"e = e_0 + s\,i"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = (
        Parameter("drift", "1", 0.02, -2.0, 2.0, meaning="change from the first trial to the last"),
    )
    form: str = "coefficient of restitution"
    separating: str = "the same shots once more in reversed order"
    sharp: bool = False

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """In proportion to the trial's place in the campaign."""
        if self.form == "launch angle":
            return turn_launch(outcome, values["drift"] * contact.order)
        return change_restitution(contact, outcome, values["drift"] * contact.order)


def _normal_power() -> SpeedPower:
    """Normal to the velocity; the first and second power have names (Magnus, asymmetric wake)."""
    strength, power = SpeedPower().parameters
    grid = (0.0, 0.5, 3.0)
    return SpeedPower(form="normal_to_velocity", parameters=(strength, replace(power, grid=grid)))


def unnamed_laws(mode: str) -> tuple[Effect, ...]:
    """Every law that makes sense for a campaign of that mode."""
    directions = ("horizontal", "vertical")
    flight: tuple[Effect, ...] = (
        SpeedPower(),
        _normal_power(),
        *(Gust(form=one) for one in directions),
        *(PeriodicForce(form=one) for one in directions),
        *(NearFloor(form=one) for one in directions),
        *(Bump(form=one) for one in directions),
        Magnet(),
        Pull(),
        Gust(form="out_of_plane", axes=3),
        PeriodicForce(form="out_of_plane", axes=3),
        Bump(form="out_of_plane", axes=3),
    )
    if mode == "impact":
        return (*flight, Notch(), Ageing(), Ageing(form="launch angle"))
    swing: tuple[Effect, ...] = (
        Notch(), Well(), PlacedBrake(), PlacedFriction(), RestoringTorque(),
    )  # fmt: skip
    return flight if mode == "flight" else swing


KNOTS = 9

"""Weights of one curve: pieces of an eighth of the coordinate, shorter than most gusts."""

COARSE_KNOTS = 4

"""Weights of a coefficient that changes slowly: thirds of its coordinate."""

DRIFT_KNOTS = 4

"""Weights of a drift over the trials: thirds of a campaign, which rarely has more than a dozen."""

MIN_TRIALS = 6

"""Trials from which a drift is more than what each of them may be off by itself."""

READING_WIDTH = 5e-3

"""rad, a third of a degree: reading of a protractor, where no evidence has chosen another width."""

PICTURE_WIDTH = 2e-3

"""m: reading of a place off a wall; likewise."""

CLOCK_WIDTH = 5e-4

"""s, a fraction of a frame; likewise."""

WIDTH = 0.05

"""In weights of the ball, where no evidence has chosen it yet."""

TORQUE_WIDTH = 0.3

"""N m for the paper's pendulum, a hundredth of its weight's torque; likewise."""

RESTITUTION_WIDTH = 0.01

ANGLE_WIDTH = 0.005

"""What repeats imperfectly from trial to trial, as usual; likewise."""

LOOKS = 3.0

"""Chi-square units for having chosen the width among a handful."""

WORDS = {
    Coordinate.TIME: "the time since release",
    Coordinate.PLACE: "the place along the path",
    Coordinate.HEIGHT: "the height",
    Coordinate.SPEED: "the speed",
    Coordinate.DIRECTION: "the direction of flight above the horizontal",
    Coordinate.ANGLE: "the angle",
    Coordinate.RATE: "the size of the angular velocity",
    Coordinate.ORDER: "the place of the trial in the campaign",
}

UNITS = {
    Coordinate.TIME: "s",
    Coordinate.PLACE: "m",
    Coordinate.HEIGHT: "m",
    Coordinate.SPEED: "m/s",
    Coordinate.DIRECTION: "rad",
    Coordinate.ANGLE: "rad",
    Coordinate.RATE: "rad/s",
    Coordinate.ORDER: "",
}

FELT = 0.1

"""Share of its largest value from which a force is said to act."""


def _weights(
    what: str, unit: str, width: float, size: Size = Size.ONE, knots: int = KNOTS
) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"{what}_{k}", unit, 0.4 * width, -300.0, 300.0, width=width, expected=0.0,
            meaning=f"height of the spline at knot {k}", in_units_of=size, width_in=size,
        )
        for k in range(knots)
    )  # fmt: skip


@dataclass(frozen=True)
class SmoothCurve(Effect):
    """A curve over one coordinate, whatever it acts on.

    Attributes
    ----------
    low, high : float
        Range of the coordinate, where the first and last spline have their middle.
    search_cost : float
        Chi-square units that finding it costs beyond the evidence.
    """

    id: str = "unnamed"
    statement: str = ""
    law: str = r"F = \sum_k F_k B_k(c)"
    source: str = "cubic B-splines with a Gaussian prior, fitted to this campaign"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = ()
    looseness: float = 0.0
    sharp: bool = False
    low: float = 0.0
    high: float = 1.0
    search_cost: float = LOOKS

    def size(self, values: Values, place: Number) -> FloatArray:
        """The curve itself, in the unit of its weights, at values of the coordinate."""
        last = len(self.parameters) - 1
        scaled = (np.asarray(place) - self.low) / (self.high - self.low) * last
        knots = np.arange(last + 1).reshape(-1, *(1,) * scaled.ndim)
        splines = _spline(scaled - knots)
        weights = np.array([values[parameter.name] for parameter in self.parameters])
        axes = max(weights.ndim, splines.ndim)
        # all at once: a flight's path asks for this at every step
        lifted = [
            one.reshape(last + 1, *(1,) * (axes - one.ndim), *one.shape[1:])
            for one in (weights, splines)
        ]
        return np.asarray((lifted[0] * lifted[1]).sum(axis=0))

    def in_words(self, values: Values) -> str:
        """Where it is strongest, how strong, and where it has fallen to a tenth of that."""
        grid = np.linspace(self.low, self.high, 201)
        size = self.size(values, grid)
        top = int(np.argmax(np.abs(size)))
        unit = UNITS[self.coordinate]
        mine = "" if self.parameters[0].unit == "1" else f" {self.parameters[0].unit}"
        felt = grid[np.abs(size) > FELT * abs(size[top])]
        if self.coordinate is Coordinate.ORDER:
            return f"{size[0]:+.3g}{mine} in the first trial, {size[-1]:+.3g}{mine} in the last"
        reach = f"from {felt.min():.3g} {unit} to {felt.max():.3g} {unit}"
        return (
            f"{size[top]:+.3g}{mine} at most, where {WORDS[self.coordinate]} is"
            f" {grid[top]:.3g} {unit}; more than a tenth of that {reach}"
        )


@dataclass(frozen=True)
class Field(SmoothCurve):
    """A force along a direction as a smooth curve over one coordinate."""

    statement: str = "A force that no simple law describes."
    parameters: tuple[Parameter, ...] = _weights("force", "N", WIDTH, Size.BALL_WEIGHT)
    form: str = "horizontal"
    separating: str = "the same shot with the apparatus moved or at another time"

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Sum of splines, along the direction."""
        size = self.size(values, flight.along(self.coordinate)) + 0.0 * np.asarray(flight.x)
        return _along(self.form, size, flight)


@dataclass(frozen=True)
class ResistanceCurve(Field):
    """A resistance with the square of the speed whose coefficient changes along a coordinate.

    The weights are forces at the reference speed on a body of the reference diameter.
    """

    statement: str = "A resistance whose coefficient changes, as a curve that no simple law gives."
    law: str = r"F = -(d/d_0)^2 (v/v_0)^2 \sum_k F_k B_k(c)"
    parameters: tuple[Parameter, ...] = _weights(
        "force", "N", WIDTH, Size.BALL_WEIGHT, knots=COARSE_KNOTS
    )
    form: str = "along_velocity"
    separating: str = "the same throw at another launch angle, and the body weighed after it"
    reference_speed: float = 1.0
    reference_diameter: float = 1.0

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Sum of splines times dynamic pressure and area."""
        size = self.size(values, flight.along(self.coordinate))
        size = size * np.square(np.asarray(flight.diameter) / self.reference_diameter)
        return _along(self.form, size * np.square(flight.speed / self.reference_speed), flight)


@dataclass(frozen=True)
class TorqueField(SmoothCurve):
    """A torque on the pendulum as a smooth curve over its angle, or against the motion by rate."""

    statement: str = "A torque that no simple law describes."
    law: str = r"\tau = \sum_k \tau_k B_k(c)"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = _weights(
        "torque", "N m", TORQUE_WIDTH, Size.PENDULUM_TORQUE
    )
    form: str = "over the angle"
    separating: str = "a slow swing by hand, and a free swing over many periods"
    coordinate: Coordinate = Coordinate.ANGLE

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Sum of splines; over the rate it turns its sign with the motion."""
        if self.coordinate is Coordinate.ANGLE:
            return self.size(values, swing.phi)
        return -self.size(values, np.abs(swing.omega)) * swing.sense


@dataclass(frozen=True)
class Drift(SmoothCurve):
    """A contact that changes over the trials along a smooth curve."""

    statement: str = "The contact changes over the trials, as a curve that no simple law gives."
    law: str = r"e = e_0 + \sum_k e_k B_k(i)"
    phase: Phase = "contact"
    parameters: tuple[Parameter, ...] = _weights(
        "change", "1", RESTITUTION_WIDTH, knots=DRIFT_KNOTS
    )
    form: str = "coefficient of restitution"
    separating: str = "the same shots once more in reversed order"
    coordinate: Coordinate = Coordinate.ORDER

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """By the trial's place in the campaign."""
        size = self.size(values, contact.order)
        if self.form == "launch angle":
            return turn_launch(outcome, size)
        return change_restitution(contact, outcome, size)


@dataclass(frozen=True)
class ReadingCurve(SmoothCurve):
    """An angle that is read off by a smooth function of itself, whatever the body's direction."""

    statement: str = "The angle is read off by an error that depends on the angle itself."
    law: str = r"\varphi_{rec} = \varphi + \sum_k c_k B_k(\varphi)"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = _weights("error", "rad", READING_WIDTH)
    form: str = "reading of the angle"
    separating: str = "angles of the body at rest, set with a protractor over the whole range"
    coordinate: Coordinate = Coordinate.ANGLE

    def angle(self, values: Values, view: CameraView) -> Number:
        """The angle plus the curve."""
        return view.phi + self.size(values, view.phi)


@dataclass(frozen=True)
class PictureCurve(SmoothCurve):
    """A place that is read off by a smooth function of itself, whatever the ball's direction."""

    statement: str = "The ball's place is read off by an error that depends on the place itself."
    law: str = r"\mathbf r_{rec} = \mathbf r + \mathbf e \sum_k c_k B_k(\mathbf r)"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = _weights("error", "m", PICTURE_WIDTH)
    form: str = "reading along the path"
    separating: str = "a ruler at several places in view, or the same flight elsewhere in view"
    coordinate: Coordinate = Coordinate.PLACE
    planar: bool = True

    def image(self, values: Values, view: CameraView) -> Vector:
        """The place plus the curve, along the path or up."""
        off = self.size(values, view.x if self.coordinate is Coordinate.PLACE else view.y)
        if self.form == "reading of the height":
            return view.x, view.y + off, view.z
        return view.x + off, view.y, view.z


@dataclass(frozen=True)
class ClockCurve(SmoothCurve):
    """A clock that is off by a smooth function of time, alike in all trials."""

    statement: str = "The clock is off by an error that changes with the time since release."
    law: str = r"t = t_{rec} + \sum_k c_k B_k(t_{rec})"
    phase: Phase = "measurement"
    parameters: tuple[Parameter, ...] = _weights("error", "s", CLOCK_WIDTH)
    form: str = "reading of the time"
    separating: str = "a clock of known rate in view (a blinking LED)"
    coordinate: Coordinate = Coordinate.TIME

    def clock(self, values: Values, time: Number) -> Number:
        """The time plus the curve."""
        return time + self.size(values, time)


def _spline(apart: FloatArray) -> FloatArray:
    """Cardinal cubic B-spline of unit knots, one at its middle."""
    far = np.maximum(2.0 - np.abs(apart), 0.0)
    near = np.maximum(far - 1.0, 0.0)
    # products: a power of three takes ten times as long
    return np.asarray(0.25 * far * far * far - near * near * near)


FIELDS = (
    (Coordinate.TIME, ("horizontal", "vertical", "out_of_plane")),
    (Coordinate.PLACE, ("horizontal", "vertical", "out_of_plane")),
    (Coordinate.HEIGHT, ("horizontal", "vertical", "out_of_plane")),
    (Coordinate.SPEED, ("along_velocity", "normal_to_velocity")),
    (Coordinate.DIRECTION, ("along_velocity", "normal_to_velocity")),
)

"""Coordinates of a flight, and the directions that a force along each is searched in."""


def _forces(forward: Forward) -> list[SmoothCurve]:
    seen = np.atleast_1d(forward.records.ball_used.any(axis=(0, 1)))
    found: list[SmoothCurve] = []
    for coordinate, directions in FIELDS:
        if not seen[1] or (coordinate is not Coordinate.HEIGHT and not seen[0]):
            # A record of heights alone determines a force over height alone.
            continue
        low, high = forward.flight_span(coordinate)
        said = (
            f"A force that changes with {WORDS[coordinate]}, as a curve that no simple law gives."
        )
        found += [
            Field(form=one, coordinate=coordinate, low=low, high=max(high, low + 1e-3),
                  statement=said)
            for one in directions
            if (seen[0] or one != directions[0]) and (seen[2] or one != "out_of_plane")
        ]  # fmt: skip
    return found


RESISTED = (Coordinate.TIME, Coordinate.PLACE, Coordinate.HEIGHT, Coordinate.DIRECTION)

"""Coordinates along which a coefficient of resistance may change."""


def _resistances(forward: Forward) -> list[SmoothCurve]:
    """Coefficients of resistance that change; a record of heights alone shows its height alone."""
    seen = np.atleast_1d(forward.records.ball_used.any(axis=(0, 1)))
    if not (seen[0] and seen[1]):
        return []
    slow, fast = forward.flight_span(Coordinate.SPEED)
    found: list[SmoothCurve] = []
    for coordinate in RESISTED:
        low, high = forward.flight_span(coordinate)
        found.append(
            ResistanceCurve(
                coordinate=coordinate, low=low, high=max(high, low + 1e-3),
                reference_speed=max(0.5 * (slow + fast), 1e-3),
                reference_diameter=float(np.median(forward.records.diameter)),
                statement=f"A resistance with the square of the speed whose coefficient changes"
                f" with {WORDS[coordinate]}.",
            )
        )  # fmt: skip
    return found


def _torques(forward: Forward) -> list[SmoothCurve]:
    found: list[SmoothCurve] = []
    for coordinate, form in (
        (Coordinate.ANGLE, "over the angle"), (Coordinate.RATE, "against the motion"),
    ):  # fmt: skip
        low, high = forward.swing_span(coordinate)
        found.append(
            TorqueField(
                form=form, coordinate=coordinate, low=low, high=max(high, low + 1e-3),
                statement=f"A torque that changes with {WORDS[coordinate]}, as a curve that no"
                " simple law gives.",
            )
        )  # fmt: skip
    return found


def _readings(forward: Forward) -> tuple[SmoothCurve, ...]:
    """Errors of reading an angle, where angles were recorded."""
    if not forward.records.pendulum_used.any():
        return ()
    angle = forward.records.pendulum_angle[forward.records.pendulum_used]
    low, high = float(angle.min()), float(angle.max())
    return (ReadingCurve(low=low, high=max(high, low + 1e-3)),)


def _places_and_times(forward: Forward) -> list[SmoothCurve]:
    """Errors of reading a ball's place by the place, and its time by the time."""
    seen = np.atleast_1d(forward.records.ball_used.any(axis=(0, 1)))
    readings = [("reading along the path", seen[0]), ("reading of the height", seen[1])]
    found: list[SmoothCurve] = []
    for coordinate, known in ((Coordinate.PLACE, seen[0]), (Coordinate.HEIGHT, seen[1])):
        low, high = forward.flight_span(coordinate)
        found += [
            PictureCurve(form=form, coordinate=coordinate, low=low, high=max(high, low + 1e-3))
            for form, read in readings
            if read and known
        ]
    low, high = forward.flight_span(Coordinate.TIME)
    return [*found, ClockCurve(low=low, high=max(high, low + 1e-3))]


def _drifts(forward: Forward) -> list[SmoothCurve]:
    if forward.records.trials < MIN_TRIALS:
        return []
    low, high = float(forward.records.order.min()), float(forward.records.order.max())
    turned = _weights("change", "rad", ANGLE_WIDTH, knots=DRIFT_KNOTS)
    return [
        Drift(low=low, high=high),
        Drift(low=low, high=high, form="launch angle", parameters=turned),
    ]


def smooth_fields(forward: Forward) -> tuple[SmoothCurve, ...]:
    """Every smooth field that makes sense for a campaign."""
    if forward.mode == "swing":
        # Over many periods a torque takes up any sum of losses and what a record's errors leave:
        # it fitted an encoder's swings better than dry friction did, and predicted them worse.
        return _readings(forward)
    forces = [*_forces(forward), *_resistances(forward), *_places_and_times(forward)]
    if forward.mode == "flight":
        return tuple(forces)
    swings = _torques(forward) if forward.records.pendulum_used.any() else []
    return (*forces, *swings, *_drifts(forward), *_readings(forward))
