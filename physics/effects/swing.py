"""Effects on the pendulum: torques, and an offset of the initial angle."""

import math
from dataclasses import dataclass, replace

import numpy as np

from physics.domain import Number
from physics.effects.base import (
    MIN_SMOOTHING_RATE,
    Coordinate,
    Effect,
    Form,
    Level,
    Parameter,
    Phase,
    Size,
    SwingState,
    Values,
)

__all__ = [
    "BackswingOffset",
    "BearingFriction",
    "FallingBearing",
    "GivingBearing",
    "GivingFallingBearing",
    "LoadedBearing",
    "PendulumDrag",
    "RollingDamping",
    "StribeckBearing",
    "ThinRodDrag",
    "ViscousDamping",
]


@dataclass(frozen=True)
class BearingFriction(Effect):
    """Dry friction of the bearing."""

    id: str = "bearing_friction"
    statement: str = "The bearing rubs dry: a constant torque against the motion (Coulomb)."
    law: str = r"\tau = -\tau_c\,\mathrm{sign}\,\dot\varphi"
    source: str = "Coulomb 1785; for pendulums Squire, Am. J. Phys. 54, 984 (1986)"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "dry_torque",
            "N m",
            0.1,
            0.0,
            5.0,
            meaning="torque of the dry bearing",
            in_units_of=Size.PENDULUM_TORQUE,
        ),
    )
    form: str = Form.CONSTANT_TORQUE
    separating: str = "a free swing over many periods: amplitude falls linearly under dry friction"
    looseness: float = 0.2
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    coordinate: Coordinate = Coordinate.RATE

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Constant, against the motion."""
        return -values["dry_torque"] * swing.sense


@dataclass(frozen=True)
class LoadedBearing(BearingFriction):
    """Dry friction in proportion to the bearing's load."""

    law: str = r"\tau = -\tau_c\,(\cos\varphi + \dot\varphi^2 d / g)\,\mathrm{sign}\,\dot\varphi"
    source: str = "Coulomb friction under the weight and the centripetal force of the pendulum"
    form: str = Form.UNDER_LOAD

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Largest where the pendulum is lowest and fast."""
        load = np.abs(np.cos(swing.phi) + np.square(swing.omega) * swing.com / swing.gravity)
        return load * super().torque(values, swing)


STRIBECK_RATE = 0.5
"""Rate at which mixed friction of a journal bearing sets in, rad/s (chosen: 0.1 to 1 in the
source)."""

BREAKAWAY = 1.5
"""Friction at rest over friction at speed, 1 (chosen: 1.2 to 2 in the source)."""


@dataclass(frozen=True)
class StribeckBearing(BearingFriction):
    """Dry friction that decreases from rest to a constant."""

    law: str = r"\tau = -\tau_c\,(1 + 0.5\,e^{-(\dot\varphi/0.5)^2})\,\mathrm{sign}\,\dot\varphi"
    source: str = "Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30, 1083 (1994)"
    form: str = Form.STRIBECK

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Half as much again at turning points."""
        more = (BREAKAWAY - 1.0) * np.exp(-np.square(swing.omega / STRIBECK_RATE))
        return (1.0 + more) * super().torque(values, swing)


@dataclass(frozen=True)
class GivingBearing(BearingFriction):
    """Dry friction of a bearing that yields elastically before it slips in the other direction."""

    law: str = r"\tau = -\tau_c\,(1 - 2\,e^{-s/s_0})\,\mathrm{sign}\,\dot\varphi"
    source: str = "Dahl, AIAA J. 14, 1675 (1976)"
    form: str = Form.GIVING
    parameters: tuple[Parameter, ...] = (
        *BearingFriction().parameters,
        Parameter(
            "give",
            "rad",
            3e-4,
            1e-6,
            0.02,
            grid=(2e-4,),
            meaning="angle after a turning point in which two thirds of the torque have reversed",
        ),
    )

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Elastic pull after turning points, over an angle so short that only weight acts in it.

        The pull is spread over at least a step of the solver, with its impulse and work unchanged.
        """
        weight = swing.mass * swing.gravity * swing.com / swing.inertia
        most = np.sqrt(weight * np.abs(np.sin(swing.phi)) * values["give"])
        inward = -np.sign(swing.phi)
        width = np.sqrt(
            (1.0 - 2.0 / math.pi) * np.square(most)
            + np.square(swing.gained)
            + MIN_SMOOTHING_RATE**2
        )
        off = (inward * swing.omega - math.sqrt(2.0 / math.pi) * most) / width
        pull = most / width * np.exp(-0.5 * np.square(off))
        return super().torque(values, swing) + values["dry_torque"] * inward * pull


FRICTION_DECREASE = (
    Parameter(
        "breakaway", "1", 0.4, 0.0, 2.0, grid=(0.5,),
        meaning="friction at rest over that at speed, minus one",
    ),
    Parameter(
        "rate", "rad/s", 0.4, 0.1, 5.0, grid=(0.15, 0.5, 1.5),
        meaning="rate at which the excess at rest has decreased to a third",
    ),
    Parameter(
        "steepness", "1", 0.5, 0.5, 2.0, grid=(1.0, 2.0),
        meaning="power of the rate in the exponent",
    ),
)  # fmt: skip
"""Parameters of the decrease of friction with rate: of the powers 1 is Tustin's (1947), 2 a
Gaussian, 1/2 the minimum of Bo and Pavelescu (1982); see Armstrong-Hélouvry, Dupont and Canudas
de Wit, Automatica 30, 1083 (1994)."""


def _falling(at_rest: Number, values: Values, swing: SwingState) -> Number:
    """Torque of friction that decreases with the rate, given the constant one.

    The decrease vanishes at turning points and needs no smoothing over a step.
    """
    slow = np.maximum(np.abs(swing.omega), 1e-9) / values["rate"]
    less = values["breakaway"] * -np.expm1(-(slow ** values["steepness"]))
    constant = (1.0 + values["breakaway"]) * at_rest
    return constant + values["dry_torque"] * less * np.sign(swing.omega)


@dataclass(frozen=True)
class FallingBearing(BearingFriction):
    """Dry friction that decreases with the rate, with free amount and scale."""

    law: str = r"\tau = -\tau_c\,(1 + b\,e^{-|\dot\varphi/\omega_s|^p})\,\mathrm{sign}\,\dot\varphi"
    source: str = StribeckBearing().source
    form: str = Form.FALLING
    parameters: tuple[Parameter, ...] = (*BearingFriction().parameters, *FRICTION_DECREASE)

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Largest at turning points."""
        return _falling(super().torque(values, swing), values, swing)


@dataclass(frozen=True)
class GivingFallingBearing(GivingBearing):
    """Dry friction that decreases with the rate, of a bearing that yields before it slips."""

    law: str = (
        r"\tau = -\tau_c\,(1 + b\,e^{-|\dot\varphi/\omega_s|^p})(1 - 2\,e^{-s/s_0})"
        r"\,\mathrm{sign}\,\dot\varphi"
    )
    source: str = "Canudas de Wit, Olsson, Åström and Lischinsky, IEEE Trans. AC 40, 419 (1995)"
    form: str = Form.GIVING_FALLING
    parameters: tuple[Parameter, ...] = (*GivingBearing().parameters, *FRICTION_DECREASE)

    def torque(self, values: Values, swing: SwingState) -> Number:
        """Elastic part scaled to the friction at the rate."""
        return _falling(super().torque(values, swing), values, swing)


@dataclass(frozen=True)
class ViscousDamping(Effect):
    """Damping in proportion to the rate."""

    id: str = "viscous_damping"
    statement: str = "The swing is damped in proportion to its rate (viscous bearing)."
    law: str = r"\tau = -c\,\dot\varphi"
    source: str = "Stokes 1851"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "viscous_coefficient",
            "N m s",
            0.03,
            0.0,
            3.0,
            meaning="torque per rate",
            in_units_of=Size.PENDULUM_TORQUE,
        ),
    )
    separating: str = "a free swing over many periods: amplitude falls exponentially"
    looseness: float = 0.1
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    coordinate: Coordinate = Coordinate.RATE

    def torque(self, values: Values, swing: SwingState) -> Number:
        """In proportion to the rate."""
        return -values["viscous_coefficient"] * swing.omega


@dataclass(frozen=True)
class RollingDamping(ViscousDamping):
    """Damping by the lubricant of a ball bearing."""

    form: str = Form.TWO_THIRDS
    statement: str = "The swing is damped by a lubricant that rolling balls squeeze and shear."
    law: str = r"\tau = -c\,|\dot\varphi|^{2/3} \operatorname{sign} \dot\varphi"
    source: str = "Palmgren, Ball and Roller Bearing Engineering (1959): the part free of load"
    parameters: tuple[Parameter, ...] = (
        replace(ViscousDamping().parameters[0], unit="N m s^(2/3)"),
    )

    def torque(self, values: Values, swing: SwingState) -> Number:
        """With the power two thirds of the rate."""
        size = np.cbrt(np.square(swing.omega))
        return -values["viscous_coefficient"] * size * np.sign(swing.omega)


@dataclass(frozen=True)
class PendulumDrag(Effect):
    """Air drag on the pendulum."""

    id: str = "pendulum_drag"
    statement: str = "The air brakes the pendulum with the square of its rate."
    law: str = r"\tau = -k\,|\dot\varphi|\dot\varphi"
    source: str = "Squire, Am. J. Phys. 54, 984 (1986)"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (
        # A board half as wide as the pendulum is long, and a drag coefficient near one.
        Parameter(
            "drag_torque",
            "N m s^2",
            0.005,
            0.0,
            0.5,
            meaning="torque per rate squared",
            in_units_of=Size.PENDULUM_TORQUE,
            width=0.1,
            width_in=Size.BOARD,
        ),
    )
    separating: str = "a free swing over many periods from a large angle"
    looseness: float = 0.1
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)
    coordinate: Coordinate = Coordinate.RATE

    def torque(self, values: Values, swing: SwingState) -> Number:
        """With the square of the rate."""
        return -values["drag_torque"] * np.abs(swing.omega) * swing.omega


@dataclass(frozen=True)
class ThinRodDrag(PendulumDrag):
    """Air drag on cords and thin rods, and on faces parallel to the motion."""

    form: str = Form.THREE_HALVES
    statement: str = (
        "The air brakes a thin rod, or along its faces, with the power 3/2 of the rate."
    )
    law: str = r"\tau = -k\,|\dot\varphi|^{1/2} \dot\varphi"
    source: str = (
        "C_D with the root of 1/Re: laminar boundary layer, Blasius, Z. Math. Phys. 56, 1 (1908),"
        " and about so for cylinders and spheres between Re of 1 and 1000"
    )
    parameters: tuple[Parameter, ...] = (replace(PendulumDrag().parameters[0], unit="N m s^(3/2)"),)

    def torque(self, values: Values, swing: SwingState) -> Number:
        """With the power three halves of the rate."""
        return -values["drag_torque"] * np.sqrt(np.abs(swing.omega)) * swing.omega


@dataclass(frozen=True)
class BackswingOffset(Effect):
    """A protractor with a wrong zero."""

    id: str = "backswing_offset"
    statement: str = "The protractor's zero is off: every swing starts from another angle."
    law: str = r"\theta_0 = \theta_{read} + \delta"
    source: str = "the reading of a protractor in 5° steps"
    phase: Phase = "swing"
    parameters: tuple[Parameter, ...] = (
        Parameter("offset", "rad", 0.01, -0.3, 0.3, meaning="added to every reading"),
    )
    separating: str = "a plumb line in view, or the start of the swing in view"
    looseness: float = 0.0
    levels: tuple[Level, ...] = (Level.CAMPAIGN, Level.SESSION)

    def start(self, values: Values, backswing: Number) -> Number:
        """Reading plus offset."""
        return backswing + values["offset"]
