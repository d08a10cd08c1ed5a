"""Density and viscosity of air compared with published values."""

import pytest

from metrology import DomainError
from physics.air import Air, moist_air_density, moist_air_viscosity


def test_density_agrees_with_published_values_of_cipm_2007() -> None:
    # Picard et al. 2008 and the tables that follow it: 20 degC, 101325 Pa, 50 %: 1.1992 kg/m3
    assert moist_air_density(293.15, 101325.0, 0.5) == pytest.approx(1.1992, abs=2e-4)
    # dry air at 20 degC: 1.2041 kg/m3 (1.2045 with today's carbon dioxide)
    assert moist_air_density(293.15, 101325.0, 0.0) == pytest.approx(1.2045, abs=3e-4)


def test_density_tends_to_the_ideal_gas_at_low_pressure() -> None:
    ideal = 1000.0 * 28.96546e-3 / (8.314472 * 293.15)
    assert moist_air_density(293.15, 1000.0, 0.0) == pytest.approx(ideal, rel=1e-5)


def test_humid_air_is_lighter_and_less_viscous() -> None:
    assert moist_air_density(299.15, 101325.0, 1.0) < moist_air_density(299.15, 101325.0, 0.0)
    assert moist_air_viscosity(299.15, 101325.0, 1.0) < moist_air_viscosity(299.15, 101325.0, 0.0)


def test_viscosity_of_dry_air() -> None:
    # Kadoya et al. 1985: 18.45 uPa s at 300 K
    assert moist_air_viscosity(300.0, 101325.0, 0.0) == pytest.approx(18.46e-6, rel=5e-3)


def test_outside_its_range_the_formula_says_so() -> None:
    assert Air.moist(298.15, 101325.0, 0.4).notes == ()
    notes = Air.moist(310.0, 50e3, 0.4).notes
    assert len(notes) == 2
    assert "CIPM-2007" in notes[0]


@pytest.mark.parametrize(
    ("temperature", "pressure", "humidity"),
    [(20.0, 101325.0, 0.5), (293.15, -1.0, 0.5), (293.15, 101325.0, 50.0), (345.0, 2e4, 1.0)],
)
def test_impossible_air_is_refused(temperature: float, pressure: float, humidity: float) -> None:
    with pytest.raises(DomainError):
        Air.moist(temperature, pressure, humidity)


def test_reynolds_number() -> None:
    assert Air(1.2, 1.8e-5).reynolds(3.0, 0.2) == pytest.approx(4e4)
