"""Moist air (CIPM-2007; Sutherland, Wilke), and drag and lift curves of balls."""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np

from metrology import Defaults, DomainError
from physics.domain import FloatArray, Number, require_non_negative, require_positive

__all__ = [
    "BASKETBALL_DRAG",
    "DRAG_CURVES",
    "PAPER_AIR",
    "SMOOTH_SPHERE_DRAG",
    "SOCCER_DRAG",
    "SOCCER_LIFT",
    "SUBCRITICAL_DRAG",
    "Air",
    "DragCurve",
    "drag_curve",
    "moist_air_density",
    "moist_air_viscosity",
    "standard_drag",
]

GAS_CONSTANT = 8.314472

"""Molar gas constant used by CIPM-2007, J/(mol K) (convention)."""

MOLAR_MASS_DRY = 28.96546e-3

"""Molar mass of dry air with 400 µmol/mol of CO₂, kg/mol (convention: CIPM-2007, Eq. 4)."""

MOLAR_MASS_WATER = 18.01528e-3

"""Molar mass of water, kg/mol (convention: CIPM-2007, section 2)."""

CIPM_TEMPERATURE = (288.15, 300.15)

"""Range of CIPM-2007, K, 15 to 27 °C (convention: its section 1)."""

CIPM_PRESSURE = (600e2, 1100e2)

"""Range of CIPM-2007, Pa (convention: its section 1)."""


@dataclass(frozen=True)
class Air:
    """Air at rest around the ball.

    Attributes
    ----------
    density : float
        kg/m³; zero is allowed (a vacuum).
    viscosity : float
        Dynamic viscosity, Pa s.
    notes : tuple of str
        Notes on formulas used outside their verified range.
    """

    density: float
    viscosity: float
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        require_non_negative("the density of the air", self.density, "kg/m^3")
        require_positive("the viscosity of the air", self.viscosity, "Pa s")

    @classmethod
    def moist(
        cls,
        temperature: float,
        pressure: float = 101325.0,
        relative_humidity: float = 0.0,
    ) -> Self:
        """Air from temperature, pressure and humidity.

        Parameters
        ----------
        temperature : float
            K.
        pressure : float
            Pa.
        relative_humidity : float
            0 to 1.

        Returns
        -------
        Air
            With a note where temperature or pressure are outside the range of CIPM-2007
            (15 to 27 °C, 600 to 1100 hPa).

        Raises
        ------
        DomainError
            For temperatures outside 200 to 350 K, pressures that are not positive, or a humidity
            outside 0 to 1.
        """
        notes = []
        if not CIPM_TEMPERATURE[0] <= temperature <= CIPM_TEMPERATURE[1]:
            notes.append(
                f"air density: {temperature - 273.15:.1f} degC is outside the 15 to 27 degC"
                " in which CIPM-2007 is established"
            )
        if not CIPM_PRESSURE[0] <= pressure <= CIPM_PRESSURE[1]:
            notes.append(
                f"air density: {pressure / 100:.0f} hPa is outside the 600 to 1100 hPa"
                " in which CIPM-2007 is established"
            )
        return cls(
            moist_air_density(temperature, pressure, relative_humidity),
            moist_air_viscosity(temperature, pressure, relative_humidity),
            tuple(notes),
        )

    def reynolds(self, speed: float, diameter: float) -> float:
        """Reynolds number ρ v d / μ of a sphere (Eq. 4)."""
        return self.density * speed * diameter / self.viscosity


def vapour_fraction(temperature: float, pressure: float, relative_humidity: float) -> float:
    """Mole fraction of water vapour in moist air.

    CIPM-2007 (Picard, Davis, Gläser, Fujii, Metrologia 45, 149, 2008), equation A1.1 to A1.3.

    Parameters
    ----------
    temperature, pressure, relative_humidity : float
        K, Pa, 0 to 1.

    Returns
    -------
    float
        Moles of water per mole of moist air.

    Raises
    ------
    DomainError
        As `Air.moist`.
    """
    if not 200.0 <= temperature <= 350.0:
        raise DomainError(f"an air temperature of {temperature} K is outside 200 to 350 K")
    if not 0.0 <= relative_humidity <= 1.0:
        raise DomainError(
            f"a relative humidity of {relative_humidity} is outside 0 to 1",
            hint="Write 50 % as 0.5.",
        )
    require_positive("the air pressure", pressure, "Pa")
    celsius = temperature - 273.15
    saturation = math.exp(
        1.2378847e-5 * temperature**2
        - 1.9121316e-2 * temperature
        + 33.93711047
        - 6.3431645e3 / temperature
    )
    enhancement = 1.00062 + 3.14e-8 * pressure + 5.6e-7 * celsius**2
    fraction = relative_humidity * enhancement * saturation / pressure
    if fraction >= 1.0:
        raise DomainError(
            f"water boils at {temperature} K and {pressure} Pa, so there is no moist air"
        )
    return fraction


def moist_air_density(temperature: float, pressure: float, relative_humidity: float) -> float:
    """Density of moist air with 400 µmol/mol CO₂, kg/m³.

    CIPM-2007 (Picard et al., Metrologia 45, 149, 2008), equation 1; relative uncertainty of the
    formula 22e-6 within its range.

    Parameters
    ----------
    temperature, pressure, relative_humidity : float
        K, Pa, 0 to 1.

    Returns
    -------
    float
        kg/m³.
    """
    water = vapour_fraction(temperature, pressure, relative_humidity)
    celsius = temperature - 273.15
    ratio = pressure / temperature
    compressibility = (
        1.0
        - ratio
        * (
            1.58123e-6
            - 2.9331e-8 * celsius
            + 1.1043e-10 * celsius**2
            + (5.707e-6 - 2.051e-8 * celsius) * water
            + (1.9898e-4 - 2.376e-6 * celsius) * water**2
        )
        + ratio**2 * (1.83e-11 - 0.765e-8 * water**2)
    )
    dry = pressure * MOLAR_MASS_DRY / (compressibility * GAS_CONSTANT * temperature)
    return float(dry * (1.0 - water * (1.0 - MOLAR_MASS_WATER / MOLAR_MASS_DRY)))


def moist_air_viscosity(temperature: float, pressure: float, relative_humidity: float) -> float:
    """Dynamic viscosity of moist air, Pa s.

    Dry air: Sutherland's law (μ₀ = 1.716e-5 Pa s at 273.15 K, S = 110.4 K; White, Viscous Fluid
    Flow, table 1-2). Water vapour: Sutherland with μ₀ = 1.12e-5 Pa s at 350 K, S = 1064 K (same
    table). Mixture: Wilke, J. Chem. Phys. 18, 517 (1950). About 2 %.

    Parameters
    ----------
    temperature, pressure, relative_humidity : float
        K, Pa, 0 to 1.

    Returns
    -------
    float
        Pa s.
    """
    water = vapour_fraction(temperature, pressure, relative_humidity)
    dry_viscosity = _sutherland(temperature, 1.716e-5, 273.15, 110.4)
    water_viscosity = _sutherland(temperature, 1.12e-5, 350.0, 1064.0)

    def wilke(viscosity_ratio: float, mass_ratio: float) -> float:
        mixed = 1.0 + math.sqrt(viscosity_ratio / math.sqrt(mass_ratio))
        return mixed**2 / math.sqrt(8.0 * (1.0 + mass_ratio))

    air_water = wilke(dry_viscosity / water_viscosity, MOLAR_MASS_DRY / MOLAR_MASS_WATER)
    water_air = wilke(water_viscosity / dry_viscosity, MOLAR_MASS_WATER / MOLAR_MASS_DRY)
    dry = 1.0 - water
    return dry * dry_viscosity / (dry + water * air_water) + water * water_viscosity / (
        water + dry * water_air
    )


def _sutherland(temperature: float, reference: float, at: float, constant: float) -> float:
    warmer = temperature / at
    return reference * warmer * math.sqrt(warmer) * (at + constant) / (temperature + constant)


PAPER_AIR = Air(Defaults.AIR_DENSITY.known, Defaults.AIR_VISCOSITY.known)

"""Table 3 of the paper, 26 °C. The printed density is that of dry air at 1013 hPa."""

SUBCRITICAL_DRAG = Defaults.DRAG_COEFFICIENT.known

"""C_D of a sphere between Re = 1e3 and 1e5."""


def standard_drag(reynolds: Number) -> Number:
    """Drag of a smooth sphere below the drag crisis.

    C_D = 24/Re (1 + 0.15 Re^0.687) + 0.42 / (1 + 42500 Re^−1.16), Clift and Gauvin (1971); within
    6 % of the measurements up to Re = 3e5.
    """
    re = np.maximum(reynolds, 1e-9)
    stokes: Number = 24.0 / re * (1.0 + 0.15 * re**0.687)
    newton: Number = 0.42 / (1.0 + 42500.0 * re**-1.16)
    return stokes + newton


@dataclass(frozen=True)
class DragCurve:
    """C_D(Re): a subcritical level that falls to a supercritical one at the drag crisis.

    C_D = high + (low − high) / (1 + exp((Re − centre) / width)), with `low` the curve of
    `standard_drag` where it is None, and the supercritical level rising by `rise` per decade of Re.

    Attributes
    ----------
    low : float or None
        Level below the crisis.
    high, rise : float
        Level above the crisis (at 1.2 times the centre) and its rise per decade.
    centre, width : float
        Reynolds number of the crisis and the width of the fall.
    valid : (2,) tuple of float
        Reynolds numbers between which the source has data.
    source : str
        Source of the numbers.
    confirmed : bool
        Whether the numbers were found in the source or in two independent accounts of it.
    """

    name: str
    low: float | None
    high: float
    centre: float
    width: float
    valid: tuple[float, float]
    source: str
    confirmed: bool
    rise: float = 0.0

    def __call__(self, reynolds: Number) -> Number:
        """C_D at `reynolds`, float or array."""
        below = standard_drag(reynolds) if self.low is None else self.low
        share = 0.5 - 0.5 * np.tanh((reynolds - self.centre) / (2.0 * self.width))
        above: Number = self.high
        if self.rise:
            decades = np.log10(np.maximum(reynolds, 1.2 * self.centre) / (1.2 * self.centre))
            above = self.high + self.rise * decades
        return above + (below - above) * share

    def covers(self, lowest: float, highest: float) -> bool:
        """Whether the range of Reynolds numbers lies inside `valid`."""
        return self.valid[0] <= lowest and highest <= self.valid[1]

    def notes(self, lowest: float, highest: float) -> tuple[str, ...]:
        """Warnings about using the curve between two Reynolds numbers."""
        notes = []
        if not self.covers(lowest, highest):
            notes.append(
                f"the drag curve {self.name!r} is used at Re {lowest:.2g} to {highest:.2g};"
                f" its source covers {self.valid[0]:.2g} to {self.valid[1]:.2g}"
            )
        if not self.confirmed:
            notes.append(f"the drag curve {self.name!r} could not be confirmed in a primary source")
        return tuple(notes)


SMOOTH_SPHERE_DRAG = DragCurve(
    name="smooth",
    low=None,
    high=0.08,
    rise=0.10,
    centre=3.4e5,
    width=1.6e4,
    valid=(1.0, 4e6),
    source=(
        "Subcritical: Clift and Gauvin (1971). Crisis: Achenbach, J. Fluid Mech. 54, 565 (1972):"
        " 0.51 at Re 2e5, 0.39 at 3.3e5, 0.09 at 3.75e5, 0.07 at 4e5, 0.10 at 8e5, 0.18 at 4e6"
    ),
    confirmed=True,
)

"""Smooth sphere."""

SOCCER_DRAG = DragCurve(
    name="soccer",
    low=0.501,
    high=0.155,
    centre=12.19 * 0.2185 / 1.5e-5,
    width=1.309 * 0.2185 / 1.5e-5,
    valid=(7e4, 5e5),
    source=(
        "Goff and Carré, Eur. J. Phys. 31, 775 (2010), eq. 3: C_D = 0.155 + 0.346 / (1 + exp((v −"
        " 12.19 m/s) / 1.309 m/s)), a fit to wind-tunnel data of Asai et al. (2007); turned to"
        " Reynolds numbers with their A = 0.0375 m² and ν = 1.5e-5 m²/s"
    ),
    confirmed=True,
)

"""Soccer ball with panels; assumed for the smaller jokku ball, too."""

BASKETBALL_DRAG = DragCurve(
    name="basketball",
    low=0.50,
    high=0.25,
    centre=1.4e5,
    width=1.0e4,
    valid=(3e4, 1.2e5),
    source=(
        "Level below the crisis: 0.5, as used since Brancazio, Am. J. Phys. 49, 356 (1981). Crisis:"
        " placed where spheres of roughness k/d about 2e-3 have it (Achenbach, J. Fluid Mech. 65,"
        " 113, 1974); no wind-tunnel curve of a basketball could be found to confirm it"
    ),
    confirmed=False,
)

"""Pebbled basketball. The paper's flights end below Re = 1.1e5, where only the level matters."""

DRAG_CURVES = {curve.name: curve for curve in (SMOOTH_SPHERE_DRAG, SOCCER_DRAG, BASKETBALL_DRAG)}


def drag_curve(surface: str) -> DragCurve:
    """Drag curve of a surface by name.

    Raises
    ------
    DomainError
        If there is no such curve.
    """
    try:
        return DRAG_CURVES[surface]
    except KeyError:
        raise DomainError(
            f"unknown drag curve {surface!r}",
            hint=f"Use one of {', '.join(DRAG_CURVES)}, or a drag coefficient such as 0.47.",
        ) from None


@cache
def _through(places: tuple[float, ...], values: tuple[float, ...]) -> Any:
    # Importing takes a second, which other uses of this module need not wait for.
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(places, values)


@dataclass(frozen=True)
class LiftTable:
    """C_L(Sp) of a spinning ball: monotone cubic between tabulated points, constant beyond.

    Attributes
    ----------
    spin_parameter, lift : tuple of float
        Sp = ω R / v and C_L.
    valid_reynolds : (2,) tuple of float
        Reynolds numbers of the data; C_L hardly depends on Re within them.
    confirmed : bool
        As in `DragCurve`.
    """

    name: str
    spin_parameter: tuple[float, ...]
    lift: tuple[float, ...]
    valid_reynolds: tuple[float, float]
    source: str
    confirmed: bool

    def __call__(self, spin_parameter: Number, reynolds: Number) -> Number:
        """C_L at `spin_parameter`; `reynolds` is accepted for laws that depend on it."""
        top = self.spin_parameter[-1]
        sp: FloatArray = np.minimum(np.asarray(spin_parameter, dtype=np.float64), top)
        value = _through(self.spin_parameter, self.lift)(sp)
        return float(value) if np.ndim(value) == 0 else np.asarray(value)

    def covers(self, spin_parameter: float) -> bool:
        """Whether the table has data at this spin parameter."""
        return 0.0 <= spin_parameter <= self.spin_parameter[-1] and math.isfinite(spin_parameter)


SOCCER_LIFT = LiftTable(
    name="soccer",
    spin_parameter=(0.0, 0.04, 0.10, 0.20, 0.40),
    lift=(0.0, 0.10, 0.16, 0.23, 0.33),
    valid_reynolds=(1.5e5, 5e5),
    source=(
        "Table distributed with PyFME's soccer ball; of the size that Asai et al., Sports Eng. 10,"
        " 101 (2007), and Goff and Carré (2010) plot. The primary table could not be confirmed"
    ),
    confirmed=False,
)

"""Soccer ball at Reynolds numbers above the drag crisis."""
