"""Pendulum, ball and support, contact-time law and energies; the paper's presets."""

import math
from dataclasses import dataclass, field

from metrology import Defaults
from physics.domain import (
    FloatOrArray,
    Number,
    require_angle,
    require_non_negative,
    require_positive,
)
from physics.restitution import CorLaw, ExponentialCor

__all__ = [
    "BALLS",
    "BASKETBALL",
    "GRAVITY",
    "JOKKU",
    "PAPER_PENDULUM",
    "PAPER_SUPPORT",
    "Ball",
    "ContactTimeLaw",
    "Pendulum",
    "Support",
    "lost_by_pendulum",
    "lost_by_pendulum_approximate",
]


@dataclass(frozen=True)
class ContactTimeLaw:
    """Δt(v) = Δt₀ (v / v₀)^(−(n − 1)/(n + 1)): a spring of force k δⁿ, by dimensional analysis.

    With n = 1 (a linear spring) the contact time does not depend on speed, with n = 3/2 (Hertz) it
    falls as v^(−1/5). An inflated shell lies between.

    Attributes
    ----------
    reference_time : float
        Δt₀, s.
    reference_speed : float
        v₀, m/s.
    exponent : float
        n, the power of the compression in the contact force; 1 to 3.
    """

    reference_time: float
    reference_speed: float = 2.5
    exponent: float = 1.34

    def __post_init__(self) -> None:
        require_positive("a contact time", self.reference_time, "s")
        require_positive("the speed of a reference contact time", self.reference_speed, "m/s")
        require_positive("the exponent of the contact force", self.exponent)

    def __call__(self, speed: FloatOrArray) -> FloatOrArray:
        """Contact time in s at impact speed `speed` (m/s), shaped as `speed`."""
        power = -(self.exponent - 1.0) / (self.exponent + 1.0)
        ratio: FloatOrArray = (speed / self.reference_speed) ** power
        return self.reference_time * ratio


GRAVITY = Defaults.GRAVITY.known

"""m/s²."""


@dataclass(frozen=True)
class Pendulum:
    """A rigid bar with a mass at its end, rotating about a fixed horizontal axis.

    Attributes
    ----------
    length : float
        Pivot to the point that meets the ball, along the bar, m.
    inertia : float
        Moment of inertia about the pivot, kg m².
    mass : float
        Total mass, kg.
    com : float
        Pivot to centre of mass, m.
    effective_mass : float or None
        The mass that Eqs 8 to 10 put at the contact point, kg; None uses I/L², which the equation
        of motion implies.
    face_offset : float
        Distance of the striking face in front of the line from the pivot through the bar, m. It
        places the pivot relative to the ball and has little other influence.
    """

    length: float
    inertia: float
    mass: float
    com: float
    effective_mass: float | None = None
    face_offset: float = 0.0

    def __post_init__(self) -> None:
        require_positive("the pendulum's length", self.length, "m")
        require_positive("the pendulum's inertia", self.inertia, "kg m^2")
        require_positive("the pendulum's mass", self.mass, "kg")
        require_positive("the pendulum's centre of mass", self.com, "m")
        require_non_negative("the pendulum's face offset", self.face_offset, "m")
        if self.effective_mass is not None:
            require_positive("the pendulum's effective mass", self.effective_mass, "kg")

    @property
    def inertial_mass(self) -> float:
        """I/L², kg: the point mass at the contact point with the same moment of inertia."""
        return self.inertia / self.length**2

    @property
    def mass_at_contact(self) -> float:
        """The effective mass M_E used in Eqs 8 to 10, kg."""
        return self.inertial_mass if self.effective_mass is None else self.effective_mass


@dataclass(frozen=True)
class Ball:
    """An inflated ball with its laws of restitution and contact time.

    Attributes
    ----------
    name : str
        Name in the setup file and the column ``ball``.
    mass, diameter : float
        kg, m.
    launch_angle : float
        Impact angle past the pendulum's lowest point, rad: the contact normal and, in the paper,
        the launch direction point this far above the horizontal.
    cor : CorLaw
        Coefficient of restitution by impact speed.
    contact_time : ContactTimeLaw
        Contact time by impact speed. The paper plots it (Fig. 13) without numbers; the presets'
        values are assumptions, taken from simulated reference contacts of such balls (14 to 19 ms,
        falling as v^−0.145, hence the exponent 1.34), neither measured nor the paper's.
    cor_range : (2,) tuple of float
        Impact speeds between which `cor` was fitted, m/s.
    surface : str
        Name of the drag curve of the surface: "smooth", "soccer" or "basketball".
    inertia_factor : float
        Moment of inertia about the centre over m R²; 2/3 for a thin shell.
    """

    name: str
    mass: float
    diameter: float
    launch_angle: float
    cor: CorLaw
    contact_time: ContactTimeLaw = field(default_factory=lambda: ContactTimeLaw(0.0155))
    cor_range: tuple[float, float] = (0.0, math.inf)
    surface: str = "smooth"
    inertia_factor: float = 2.0 / 3.0

    def __post_init__(self) -> None:
        require_positive(f"the mass of {self.name}", self.mass, "kg")
        require_positive(f"the diameter of {self.name}", self.diameter, "m")
        require_angle(f"the launch angle of {self.name}", self.launch_angle, math.pi / 2)
        require_positive(f"the inertia factor of {self.name}", self.inertia_factor)

    @property
    def radius(self) -> float:
        """Half the diameter, m."""
        return 0.5 * self.diameter

    @property
    def area(self) -> float:
        """Cross-section, m²."""
        return math.pi * self.radius**2

    @property
    def volume(self) -> float:
        """m³."""
        return 4.0 / 3.0 * math.pi * self.radius**3


@dataclass(frozen=True)
class Support:
    """Support of the ball before the strike.

    Attributes
    ----------
    height : float
        Height of the ball's lowest point at rest above the floor, m.
    friction : float
        Coulomb friction between ball and support while they touch.
    """

    height: float
    friction: float = 0.0

    def __post_init__(self) -> None:
        require_non_negative("the height of the support", self.height, "m")
        require_non_negative("the friction of the support", self.friction)


PAPER_PENDULUM = Pendulum(
    length=0.5541, inertia=1.579, mass=6.0, com=0.4553, effective_mass=5.1667, face_offset=0.045
)

"""Table 2. The face offset is not printed; it is that of the simulated reference contacts
(assumed)."""

PAPER_SUPPORT = Support(height=0.3120)

"""Table 2."""

JOKKU = Ball(
    name="jokku",
    mass=0.353,
    diameter=0.20175,
    launch_angle=math.radians(8.5),
    cor=ExponentialCor(0.1305, 0.2685, 0.1953, 0.6746),
    contact_time=ContactTimeLaw(0.0150),
    cor_range=(1.1233, 3.9162),
    surface="soccer",
)

"""Table 4 and Eq. 24 (a jokku ball is the ball of Korean foot volleyball)."""

BASKETBALL = Ball(
    name="basketball",
    mass=0.605,
    diameter=0.24590,
    launch_angle=math.radians(11.8),
    cor=ExponentialCor(0.2235, 0.2221, 0.7226, 0.8327),
    contact_time=ContactTimeLaw(0.0163),
    cor_range=(1.0364, 3.8250),
    surface="basketball",
)

"""Table 4 and Eq. 25."""

BALLS = {JOKKU.name: JOKKU, BASKETBALL.name: BASKETBALL}


def kinetic_energy(pendulum: Pendulum, speed: Number) -> Number:
    """½ I (v/L)², J, for the contact point's speed v in m/s."""
    return 0.5 * pendulum.inertia * (speed / pendulum.length) ** 2


def lost_by_pendulum(pendulum: Pendulum, before: Number, after: Number) -> Number:
    """½ I (ω₁² − ω₂²), J: energy lost by the pendulum, to the ball and to deformation (Eq. 19)."""
    return kinetic_energy(pendulum, before) - kinetic_energy(pendulum, after)


def lost_by_pendulum_approximate(pendulum: Pendulum, before: Number, impulse: Number) -> Number:
    """Eqs 20, 21 with dimensions corrected: v_M⁰ F̃, J. Too large by 1/(1 − F̃/(2 M v))."""
    return before * impulse
