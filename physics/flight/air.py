"""Air: density of moist air after CIPM-2007, viscosity after Sutherland and Wilke."""

import math
from dataclasses import dataclass
from typing import Self

from metrology import Defaults, DomainError
from physics.domain import require_non_negative, require_positive

__all__ = ["PAPER_AIR", "Air", "moist_air_density", "moist_air_viscosity", "vapour_fraction"]

GAS_CONSTANT = 8.314472
"""J/(mol K), the value CIPM-2007 was evaluated with."""

MOLAR_MASS_DRY = 28.96546e-3
"""kg/mol, dry air with 400 µmol/mol of CO₂ (CIPM-2007, Eq. 4)."""

MOLAR_MASS_WATER = 18.01528e-3
"""kg/mol (CIPM-2007, section 2)."""

CIPM_TEMPERATURE = (288.15, 300.15)
"""K, 15 to 27 °C: where CIPM-2007 is established (section 1)."""

CIPM_PRESSURE = (600e2, 1100e2)
"""Pa, 600 to 1100 hPa: likewise."""


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
        Where a formula was used outside the range it was checked in.
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
        """Air from what a lab reads off the wall.

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
            With a note where temperature or pressure leave the range of CIPM-2007
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
            f"water boils at {temperature} K and {pressure} Pa: there is no moist air"
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
