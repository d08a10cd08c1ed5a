"""Unusable swings are refused or noted."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from bench.real.made import STRING, write_swings
from measuring.setup.file import load_setup
from metrology import UsageError
from pipelines.explain.campaign import load_campaign
from pipelines.explain.command import explain_files


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    target = tmp_path_factory.mktemp("string")
    write_swings(STRING, target)
    return target


def _explained(folder, table):
    table.to_csv(folder / "odd.csv", index=False)
    return explain_files(None, folder / "odd.csv", folder / "setup.toml")


def test_angles_in_degrees_are_refused(folder):
    table = pd.read_csv(folder / "pendulum.csv")
    table["phi_rad"] = np.degrees(table["phi_rad"]) * 0.2
    with pytest.raises(UsageError, match="rad to each side"):
        _explained(folder, table)


def test_times_in_milliseconds_are_refused(folder):
    table = pd.read_csv(folder / "pendulum.csv")
    table["t_s"] *= 1000.0
    with pytest.raises(UsageError, match="small swings take"):
        _explained(folder, table)


def test_millions_of_rows_are_thinned_with_a_note(folder):
    count = 100_000
    time = np.linspace(0.0, 20.0, count)
    table = pd.DataFrame({"trial": 1, "t_s": time, "phi_rad": 0.3 * np.cos(3.2 * time)})
    table.to_csv(folder / "long.csv", index=False)
    campaign = load_campaign(None, folder / "long.csv", load_setup(folder / "setup.toml"))
    assert campaign.trials[0].pendulum_time.size <= 8000
    assert any("reduced" in note for note in campaign.notes)


INERTIA = 0.4 * 0.5**2
"""kg m²: of 0.4 kg at 0.5 m."""


def _verdict(folder, time, angles, noise, rng):
    """The verdict on noisy angles, one row a trial, of a bob of that inertia."""
    (folder / "setup.toml").write_text(
        '[pendulum]\nlength = "0.5 m"\ncom = "0.5 m"\nmass = "0.4 kg"\n'
        f'inertia = "{INERTIA} kg m^2"\n'
    )
    parts = [
        pd.DataFrame({"trial": k, "t_s": time, "phi_rad": one + rng.normal(0.0, noise, time.size)})
        for k, one in enumerate(angles)
    ]
    return _explained(folder, pd.concat(parts)).verdict


def _braked(folder, seconds, brake):
    """The verdict on three swings against a torque over inertia, brake(angle, rate)."""
    time = np.arange(0.0, seconds, 1.0 / 40.0)

    def rates(_, state):
        return [state[1], -9.80665 / 0.5 * np.sin(state[0]) - brake(*state)]

    angles = [
        solve_ivp(rates, (0.0, seconds), [at, 0.0], "LSODA", time, rtol=1e-9, atol=1e-10).y[0]
        for at in (0.7, -0.5, 0.4)
    ]
    return _verdict(folder, time, angles, 0.001, np.random.default_rng(7))


@pytest.mark.slow
def test_a_local_brake_is_unnamed_and_no_bearing_friction(tmp_path):
    place = 0.12
    verdict = _braked(
        tmp_path, 5.0, lambda angle, rate: 0.5 * np.exp(-0.5 * (angle / place) ** 2) * rate
    )
    (found,) = verdict.effects
    assert found.id == "unnamed"
    assert found.parameters[0].value == pytest.approx(0.5 * INERTIA, rel=0.03)
    assert found.parameters[2].value == pytest.approx(place, rel=0.05)


@pytest.mark.slow
def test_a_sticky_patch_is_unnamed_and_no_bearing_friction(tmp_path):
    """A patch of dry friction was bearing_friction 0.96, both its shapes at their upper bounds."""
    place = 0.22

    def patch(angle, rate):
        return 0.12 / (1.0 + ((angle - place) / 0.05) ** 4) * np.tanh(rate / 0.01)

    (found,) = _braked(tmp_path, 10.0, patch).effects
    assert found.id == "unnamed"
    assert found.probability > 0.5
    assert found.parameters[1].value == pytest.approx(place, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 0.06])
def test_an_isochronous_swing_is_no_pendulum_or_in_degrees(tmp_path, damping):
    rate, time = np.sqrt(9.80665 / 0.5), np.arange(0.0, 5.0, 1.0 / 30.0)
    # the damped harmonic oscillator, in closed form
    turning = np.sqrt(rate**2 - 0.25 * damping**2)
    angles = [
        width * np.exp(-0.5 * damping * time) * np.cos(turning * time + 0.3 * trial)
        for trial, width in enumerate((1.1, -0.7, 0.9, 0.35))
    ]
    verdict = _verdict(tmp_path, time, angles, 0.0012, np.random.default_rng(4))
    found = {effect.id: effect.parameters[0] for effect in verdict.effects}
    assert verdict.verdict == "ambiguous"
    assert set(found) == {"unnamed"} | ({"viscous_damping"} if damping else set())
    assert found["unnamed"].value == pytest.approx(0.4 * 9.80665 * 0.5, rel=0.015)
    if damping:
        assert found["viscous_damping"].value == pytest.approx(damping * INERTIA, rel=0.02)
    assert all(effect.probability < 0.5 for effect in verdict.effects)
    assert "degrees" in verdict.remainder.statement
