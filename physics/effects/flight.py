"""Effects with a force on the ball in flight."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from metrology.measurands import DRAG_COEFFICIENT
from physics.domain import Number, Vector
from physics.effects.base import (
    Coordinate,
    Effect,
    FlightState,
    Form,
    Level,
    Parameter,
    Phase,
    Size,
    Values,
)

__all__ = [
    "SPIN_ACROSS",
    "WIND_ASIDE",
    "WIND_UPWARD",
    "AsymmetricWake",
    "Buoyancy",
    "CoefficientCurve",
    "DensityLapse",
    "Drag",
    "DragByReynolds",
    "DragCrisis",
    "DragThroughLayer",
    "Magnus",
    "RecoveringCrisis",
    "SaturatingLift",
    "SpinDecay",
    "SpinDecayBySquare",
    "Wind",
    "WindOverFloor",
]


class CoefficientCurve(Protocol):
    """Drag coefficient by Reynolds number."""

    def __call__(self, reynolds: Number) -> Number:
        """C_D at `reynolds`, float or array."""
        ...


MIN_SPIN = 1e-3
"""Spin, rad/s, that keeps the spin's magnitude differentiable at zero (chosen: negligible)."""


@dataclass(frozen=True)
class Drag(Effect):
    """Resistance of the air with a constant coefficient."""

    id: str = "drag"
    statement: str = "The air slows the ball in proportion to the square of its speed."
    law: str = r"\mathbf F = -\tfrac12 \rho C_d A |\mathbf v| \mathbf v"
    source: str = "Eq. 3 of the paper; Newton, Principia II, prop. 40"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "drag_coefficient",
            "1",
            0.5,
            DRAG_COEFFICIENT.lowest,
            DRAG_COEFFICIENT.highest,
            meaning="replaces the model's value",
        ),
    )
    separating: str = "the same ball at a clearly different launch speed, over a longer flight"
    certain: bool = True
    looseness: float = 0.05
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.BALL)

    def coefficient(self, values: Values, flight: FlightState) -> Number:
        """C_D in the ball's state."""
        return values["drag_coefficient"]

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Opposite to the velocity, with its square."""
        k = -flight.dynamic_area * self.coefficient(values, flight) * flight.speed
        return k * flight.vx, k * flight.vy, k * flight.vz


@dataclass(frozen=True)
class DragByReynolds(Drag):
    """Resistance of the air with a coefficient that depends on the Reynolds number.

    Attributes
    ----------
    curve : CoefficientCurve
        C_D(Re).
    """

    form: str = Form.BY_REYNOLDS_NUMBER
    law: str = r"\mathbf F = -\tfrac12 \rho C_d(Re) A |\mathbf v| \mathbf v"
    source: str = "Eqs 3, 4 of the paper"
    parameters: tuple[Parameter, ...] = ()
    curve: CoefficientCurve = field(kw_only=True)

    def coefficient(self, values: Values, flight: FlightState) -> Number:
        """C_D of the curve at the ball's Reynolds number."""
        return self.curve(flight.reynolds)


USUAL_REYNOLDS = 4e4
"""Reynolds number to which the stated value of a varying coefficient refers (convention: a ball of
20 cm at 3 m/s)."""


@dataclass(frozen=True)
class DragThroughLayer(Drag):
    """Air resistance whose coefficient grows as the flow slows and its boundary layer thickens."""

    form: str = Form.THICKENING_LAYER
    law: str = (
        r"\mathbf F = -\tfrac12 \rho C_d A |\mathbf v| \mathbf v,\quad"
        r" C_d \propto (1 + \delta / \sqrt{Re})^2"
    )
    source: str = "Abraham, Phys. Fluids 13, 2194 (1970), with 9.06 for a smooth sphere"
    parameters: tuple[Parameter, ...] = (
        *Drag().parameters,
        Parameter("layer", "1", 9.06, 0.0, 200.0, meaning="thickness times the root of Re"),
    )
    requires: tuple[str, ...] = ("drag",)
    certain: bool = False
    levels: tuple[Level, ...] = (Level.CAMPAIGN,)

    def coefficient(self, values: Values, flight: FlightState) -> Number:
        """C_D of the ball with its boundary layer."""
        around = 1.0 + values["layer"] / np.sqrt(np.maximum(flight.reynolds, 1.0))
        usual = 1.0 + values["layer"] / np.sqrt(USUAL_REYNOLDS)
        thicker: Number = np.square(around / usual)
        return values["drag_coefficient"] * thicker


@dataclass(frozen=True)
class DragCrisis(Effect):
    """The decrease of the drag coefficient where the boundary layer becomes turbulent."""

    id: str = "drag_crisis"
    statement: str = "Above a critical speed the drag coefficient falls (drag crisis)."
    law: str = r"C_d(Re) = C_{d,0} - \Delta C_d / (1 + e^{-(Re - Re_c)/(w Re_c)})"
    source: str = "Achenbach, J. Fluid Mech. 54, 565 (1972)"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter("coefficient_drop", "1", 0.2, 0.0, 0.6, meaning="fall of the drag coefficient"),
        Parameter(
            "critical_reynolds",
            "1",
            3e4,
            8e3,
            5e5,
            grid=(2.5e4, 4e4, 5.5e4, 7e4, 9e4, 1.2e5, 2e5),
            meaning="Reynolds number at the middle of the fall",
        ),
        Parameter("width", "1", 0.1, 0.02, 0.5, grid=(0.06, 0.2), meaning="relative to it"),
    )
    separating: str = "launch speeds on both sides of the critical speed"
    requires: tuple[str, ...] = ("drag",)
    looseness: float = 0.3
    by_air: bool = True

    def fallen(self, values: Values, reynolds: Number) -> Number:
        """Fraction of the decrease at the Reynolds number."""
        critical = values["critical_reynolds"]
        argument = (reynolds - critical) / (values["width"] * critical)
        share: Number = 0.5 * (1.0 + np.tanh(0.5 * argument))
        return share

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Drag saved by the lower coefficient."""
        fallen = self.fallen(values, flight.reynolds)
        k = flight.dynamic_area * values["coefficient_drop"] * fallen * flight.speed
        return k * flight.vx, k * flight.vy, k * flight.vz


FALL_WIDTH = 0.1
"""Width of the decrease for a rough sphere over its critical Reynolds number (chosen: from nine
tenths to one tenth between 0.8 and 1.2 of it)."""


@dataclass(frozen=True)
class RecoveringCrisis(DragCrisis):
    """A decrease of the drag coefficient that partly recovers at higher Reynolds numbers."""

    form: str = Form.RECOVERING
    law: str = (
        r"C_d(Re) = C_{d,0} - \Delta C_d\,(1 - r \log_{10}(Re/Re_c)) /"
        r" (1 + e^{-(Re - Re_c)/(w Re_c)})"
    )
    source: str = (
        "Achenbach, J. Fluid Mech. 54, 565 (1972), for smooth and 65, 113 (1974), for rough spheres"
    )
    parameters: tuple[Parameter, ...] = (
        *DragCrisis().parameters[:2],
        # A smooth sphere recovers 0.10 of 0.43 in a decade, rough ones nearly all.
        Parameter(
            "recovery", "1", 0.5, 0.0, 2.0, grid=(0.25, 1.0),
            meaning="fraction of the decrease recovered per decade of Reynolds number",
        ),
    )  # fmt: skip

    def fallen(self, values: Values, reynolds: Number) -> Number:
        """Fraction of the decrease minus the recovery at the Reynolds number."""
        critical = values["critical_reynolds"]
        decades = np.log10(np.maximum(reynolds / critical, 1.0))
        left = np.maximum(1.0 - values["recovery"] * decades, 0.0)
        return super().fallen({**values, "width": FALL_WIDTH}, reynolds) * left


@dataclass(frozen=True)
class DensityLapse(Effect):
    """Air density that decreases with height."""

    id: str = "density_lapse"
    statement: str = "The air gets thinner with height, and with it the drag."
    law: str = r"\rho(y) = \rho_0 e^{-y/H}"
    source: str = "barometric formula; ISA scale height of density about 10 km near the ground"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "inverse_scale_height",
            "1/m",
            1e-4,
            0.0,
            4e-4,
            meaning="1/H",
            width=1.5e-5,
            expected=1.05e-4,
        ),
    )
    separating: str = "flights through the same speeds at another height"
    requires: tuple[str, ...] = ("drag",)
    looseness: float = 0.02
    by_air: bool = True
    coordinate: Coordinate = Coordinate.HEIGHT

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Drag saved by the lower density."""
        thinned = -np.expm1(-np.asarray(flight.y) * values["inverse_scale_height"])
        k = flight.dynamic_area * flight.drag_coefficient * flight.speed * thinned
        return k * flight.vx, k * flight.vy, k * flight.vz


def _spin(axis: str, meaning: str) -> Parameter:
    """A spin parameter; no throw or strike gives a spin beyond a few times v/R."""
    return Parameter(axis, "rad/s", 0.3, -4.0, 4.0, meaning=meaning, in_units_of=Size.SPIN)


SPIN_ACROSS = tuple(_spin(f"spin_{axis}", f"about {axis}") for axis in ("x", "y"))


@dataclass(frozen=True)
class Magnus(Effect):
    """Lift on a spinning ball."""

    id: str = "magnus"
    statement: str = "The ball spins and the air lifts it at right angles to its path (Magnus)."
    law: str = r"\mathbf F = \tfrac12 \rho A R\, \boldsymbol\omega \times \mathbf v"
    source: str = "Magnus 1852; Robinson and Robinson, Phys. Scr. 88, 018101 (2013)"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (_spin("spin", "counter-clockwise: back-spin"),)
    separating: str = "a mark on the ball that shows its spin"
    looseness: float = 0.15
    axes: int = 2
    by_air: bool = True
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.TRIAL)

    def _coefficient(self, size: Number, flight: FlightState) -> Number:
        """Lift coefficient per spin ratio S = Rω/v."""
        return 1.0

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Lift with a coefficient of one per spin ratio Rω/v, or less where the law saturates."""
        wx, wy, wz = values.get("spin_x", 0.0), values.get("spin_y", 0.0), values["spin"]
        size = np.sqrt(np.square(wx) + np.square(wy) + np.square(wz) + MIN_SPIN**2)
        k = 0.5 * flight.dynamic_area * flight.diameter * self._coefficient(size, flight)
        return (
            k * (wy * flight.vz - wz * flight.vy),
            k * (wz * flight.vx - wx * flight.vz),
            k * (wx * flight.vy - wy * flight.vx),
        )


@dataclass(frozen=True)
class SaturatingLift(Magnus):
    """Lift on a spinning ball that saturates with the spin ratio."""

    form: str = Form.SATURATING
    law: str = r"C_L = 1 / (2.32 + 0.4 / S),\quad S = R\omega / v"
    source: str = "Nathan, Am. J. Phys. 76, 119 (2008)"

    def _coefficient(self, size: Number, flight: FlightState) -> Number:
        """Fit to measured lift on spinning balls."""
        ratio = 0.5 * flight.diameter * size / np.maximum(flight.speed, 1e-6)
        return 1.0 / (2.32 * ratio + 0.4)


@dataclass(frozen=True)
class SpinDecay(Effect):
    """Decay of the spin during the flight."""

    id: str = "spin_decay"
    statement: str = "The ball's spin, and the lift with it, decays during the flight."
    law: str = r"\omega(t) = \omega_0 e^{-\lambda t}"
    source: str = "Smits and Smith, Science and Golf II (1994)"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter("decay_rate", "1/s", 1.0, 0.0, 20.0, meaning="inverse time constant"),
    )
    separating: str = "a mark on the ball that shows its spin over the whole flight"
    requires: tuple[str, ...] = ("magnus",)
    looseness: float = 0.2
    by_air: bool = True
    coordinate: Coordinate = Coordinate.TIME

    def lost(self, values: Values, time: Number) -> Number:
        """Fraction of the spin that is lost, negative."""
        gone: Number = np.expm1(-np.asarray(time) * values["decay_rate"])
        return gone

    def force(self, values: Values, flight: FlightState) -> Vector:
        """The lost lift."""
        lost = self.lost(values, flight.time)
        k = 0.5 * flight.dynamic_area * flight.diameter * flight.spin * lost
        return -k * flight.vy, k * flight.vx, np.zeros_like(np.asarray(flight.vz) * k)


@dataclass(frozen=True)
class SpinDecayBySquare(SpinDecay):
    """Decay of the spin by a torque with its square."""

    form: str = Form.BY_THE_SQUARE
    law: str = r"\omega(t) = \omega_0 / (1 + \lambda t)"
    source: str = (
        "a torque coefficient that does not change with the spin, as of rough balls; Sawatzki,"
        " Acta Mech. 9, 159 (1970), for smooth ones"
    )

    def lost(self, values: Values, time: Number) -> Number:
        """Fraction of the spin that is lost, negative."""
        gone = np.asarray(time) * values["decay_rate"]
        share: Number = -gone / (1.0 + gone)
        return share


WIND_UPWARD = Parameter("wind_y", "m/s", 0.5, -15.0, 15.0, meaning="positive upward")
WIND_ASIDE = Parameter("wind_z", "m/s", 0.5, -15.0, 15.0, meaning="positive along z")


@dataclass(frozen=True)
class Wind(Effect):
    """A steady draught along the line of flight, or in more directions."""

    id: str = "wind"
    statement: str = "The air itself moves: a steady draught along the line of flight."
    law: str = r"\mathbf F = -\tfrac12 \rho C_d A |\mathbf v - \mathbf w| (\mathbf v - \mathbf w)"
    source: str = "drag on the velocity relative to the air"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter("wind_x", "m/s", 0.5, -15.0, 15.0, meaning="positive with the ball"),
    )
    separating: str = "one shot in the opposite direction, or one drop from rest"
    requires: tuple[str, ...] = ("drag",)
    looseness: float = 0.15
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    by_air: bool = True
    coordinate: Coordinate = Coordinate.HEIGHT

    def _share(self, flight: FlightState) -> Number:
        """Fraction of the stated wind at the ball."""
        return 1.0

    def blowing(self, values: Values, flight: FlightState) -> Vector:
        """Wind velocity at the ball, m/s."""
        share = self._share(flight)
        across = (values.get("wind_y", 0.0), values.get("wind_z", 0.0))
        return share * values["wind_x"], share * across[0], share * across[1]

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Drag on the relative velocity minus drag on the velocity."""
        k = flight.dynamic_area * flight.drag_coefficient
        still = flight.speed
        wx, wy, wz = self.blowing(values, flight)
        ux, uy, uz = flight.vx - wx, flight.vy - wy, flight.vz - wz
        moving = np.sqrt(np.square(ux) + np.square(uy) + np.square(uz))
        return (
            k * (still * flight.vx - moving * ux),
            k * (still * flight.vy - moving * uy),
            k * (still * flight.vz - moving * uz),
        )


@dataclass(frozen=True)
class WindOverFloor(Wind):
    """A draught with a boundary layer on the floor."""

    form: str = Form.HELD_BY_THE_FLOOR
    law: str = (
        r"\mathbf F = -\tfrac12 \rho C_d A |\mathbf v - \mathbf w| (\mathbf v - \mathbf w),\quad"
        r" w \propto y^{1/7}"
    )
    source: str = "Prandtl (1925): the seventh-root profile of a turbulent layer over a plane"

    def _share(self, flight: FlightState) -> Number:
        """Fraction of the stated wind at the ball's height; 1 at one metre above the floor."""
        return np.asarray(np.maximum(flight.y, 0.0) ** (1.0 / 7.0))


@dataclass(frozen=True)
class Buoyancy(Effect):
    """The weight of the air that the ball displaces."""

    id: str = "buoyancy"
    statement: str = "The displaced air carries part of the ball's weight (buoyancy)."
    law: str = r"F_y = f \rho V g"
    source: str = "Archimedes; f = 1 in full"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter("fraction", "1", 1.0, 0.0, 4.0, meaning="1 for Archimedes' value"),
    )
    separating: str = "one drop from rest of this ball next to a small dense one"
    looseness: float = 0.1
    by_air: bool = True

    def force(self, values: Values, flight: FlightState) -> Vector:
        """Vertical force."""
        lift: Number = values["fraction"] * flight.air_density * flight.volume * flight.gravity
        nothing = np.zeros_like(np.asarray(flight.vx) * lift)
        return nothing, lift + nothing, nothing


@dataclass(frozen=True)
class AsymmetricWake(Effect):
    """Lift on a ball that does not spin, from seams or a valve."""

    id: str = "asymmetric_wake"
    statement: str = "The wake is asymmetric (seam, valve): a lift that grows with speed squared."
    law: str = r"\mathbf F = \tfrac12 \rho C_s A |\mathbf v|\, \hat{\mathbf z} \times \mathbf v"
    source: str = "Mehta, Annu. Rev. Fluid Mech. 17, 151 (1985)"
    phase: Phase = "flight"
    parameters: tuple[Parameter, ...] = (
        Parameter("side_coefficient", "1", 0.1, -0.8, 0.8, meaning="positive lifts the ball"),
    )
    separating: str = "the same ball turned by half a turn on its support"
    looseness: float = 0.2
    axes: int = 2
    by_air: bool = True
    coordinate: Coordinate = Coordinate.TIME

    def force(self, values: Values, flight: FlightState) -> Vector:
        """At right angles to the velocity in the plane of flight."""
        k = flight.dynamic_area * values["side_coefficient"] * flight.speed
        return -k * flight.vy, k * flight.vx, np.zeros_like(np.asarray(flight.vz) * k)
