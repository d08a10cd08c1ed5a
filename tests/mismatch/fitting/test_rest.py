"""Pendulums that come to rest away from zero because of dry friction."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mismatch.explain import explain
from mismatch.fitting.fit import PIECE_STEPS, rows_at_rest
from mismatch.fitting.prepare import prepare
from mismatch.records import Baseline, CampaignRecords, Trial
from physics.bodies import Pendulum
from physics.effects import CATALOGUE, Form, Term
from physics.integrator import integrate
from physics.swing import SwingModel
from tests.mismatch.fitting.rubbing import swung

LENGTH, MASS, NOISE = 0.5, 0.4, 2e-3
STIFFNESS = 9.80665 / LENGTH
RATE = np.sqrt(STIFFNESS)
DRY, LINEAR = 0.3, 0.05


@pytest.fixture(scope="module")
def stopped():
    """Four swings of twelve seconds, and the time at which each stops."""
    rng, trials, stops = np.random.default_rng(4), [], []
    time = np.arange(0.0, 12.0, 1.0 / 60.0)
    for number, start in enumerate((0.8, -0.5, 0.6, -0.35)):
        angle = swung(start, time, STIFFNESS, lambda _: DRY, LINEAR)
        stop = time[np.flatnonzero(np.abs(angle - angle[-1]) > 3.0 * NOISE)[-1]]
        seen = angle + NOISE * rng.standard_normal(time.size)
        trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, seen))
        stops.append(stop)
    body = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)
    return CampaignRecords(tuple(trials)), Baseline({}, pendulum=body), np.array(stops)


def test_rows_after_rest_are_excluded(stopped):
    campaign, baseline, stops = stopped
    period = 2.0 * np.pi / RATE
    at_rest = stops < 12.0 - 0.5 * period
    assert 2 <= at_rest.sum() < 4
    records = prepare(campaign, baseline).forward.records
    kept = np.where(records.pendulum_used, records.pendulum_time, 0.0).max(axis=1)
    assert kept[~at_rest] == pytest.approx(12.0 - 1.0 / 60.0)
    # The last swing is excluded as well, because its end is uncertain.
    early = stops - kept
    assert np.all((0.9 * period < early) & (early < 1.5 * period) | ~at_rest)


def test_a_viscously_damped_swing_is_kept_entirely():
    """With viscous losses, down to two standard deviations of a reading."""
    rng, time = np.random.default_rng(1), np.arange(0.0, 12.0, 1.0 / 60.0)
    fading = 0.4 * np.exp(-0.38 * time) * np.cos(RATE * time)
    seen = fading + NOISE * rng.standard_normal(time.size)
    trial = Trial("1", np.zeros(0), np.zeros((0, 3)), time, seen)
    body = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)
    records = prepare(CampaignRecords((trial,)), Baseline({}, pendulum=body)).forward.records
    assert not rows_at_rest(records, RATE).any()


def test_dry_friction_is_integrated_through_turning_points():
    span = 8.0 * 2.0 * np.pi / RATE
    steps = 8 * PIECE_STEPS
    pendulum = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)
    inertia = pendulum.inertia
    laws = [
        Term(CATALOGUE["bearing_friction"][0], {"dry_torque": DRY * inertia}),
        Term(CATALOGUE["viscous_damping"][0], {"viscous_coefficient": LINEAR * inertia}),
    ]
    model = replace(SwingModel.of(pendulum, laws), step=np.array(span / steps))
    for start in (1.0, 0.8, 0.6):
        path = integrate(model.rates, np.array([start, 0.0]), np.array(span), steps)
        true = swung(start, np.linspace(0.0, span, steps + 1), STIFFNESS, lambda _: DRY, LINEAR)
        assert path.states[:, 0] == pytest.approx(true, abs=5e-4)


@pytest.mark.slow
def test_a_bearing_that_stops_the_pendulum_is_only_friction(stopped):
    campaign, baseline, _ = stopped
    verdict = explain(campaign, baseline)
    named = {effect.id: effect.parameters[0] for effect in verdict.effects}
    assert set(named) == {"bearing_friction", "viscous_damping"}
    inertia = MASS * LENGTH**2
    for law, true in (("bearing_friction", DRY * inertia), ("viscous_damping", LINEAR * inertia)):
        assert named[law].value == pytest.approx(true, rel=0.03)


GIVE = 2e-4


def given(start: float, time: np.ndarray) -> np.ndarray:
    """Swing with a LuGre bearing, which deflects by 0.2 mrad before it slips."""

    def rate(_, s):
        angle, omega, bent = s
        slipping = omega - abs(omega) * bent / GIVE
        return [omega, -STIFFNESS * np.sin(angle) - DRY * bent / GIVE, slipping]

    path = solve_ivp(
        rate, (0.0, time[-1]), [start, 0.0, np.sign(start) * GIVE], "LSODA",
        t_eval=time, rtol=1e-8, atol=1e-10, max_step=5e-3,
    )  # fmt: skip
    return path.y[0]


def test_a_compliant_bearing_is_integrated_through_turning_points():
    span, steps = 6.0 * 2.0 * np.pi / RATE, 6 * PIECE_STEPS
    pendulum = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)
    forms = {effect.form: effect for effect in CATALOGUE["bearing_friction"]}
    true = given(0.8, np.linspace(0.0, span, steps + 1))
    off = {}
    for form in (Form.CONSTANT_TORQUE, Form.GIVING):
        law = Term(forms[form], {"dry_torque": DRY * pendulum.inertia, "give": GIVE})
        model = replace(SwingModel.of(pendulum, [law]), step=np.array(span / steps))
        path = integrate(model.rates, np.array([0.8, 0.0]), np.array(span), steps)
        off[form] = float(np.abs(path.states[:, 0] - true).max())
    assert off[Form.GIVING] < 5e-4
    assert off[Form.CONSTANT_TORQUE] > 3e-3


@pytest.mark.slow
def test_a_compliant_bearing_needs_no_other_torque():
    rng, trials = np.random.default_rng(8), []
    time = np.arange(0.0, 11.0, 1.0 / 50.0)
    for number, start in enumerate((0.7, -0.45, 0.9, -0.55, 0.62)):
        seen = given(start, time + 0.02) + 1.5e-3 * rng.standard_normal(time.size)
        trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, seen))
    body = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)
    (named,) = explain(CampaignRecords(tuple(trials)), Baseline({}, pendulum=body)).effects
    assert named.id == "bearing_friction"
    found = {p.name: p for p in named.parameters}
    assert found["dry_torque"].value == pytest.approx(DRY * body.inertia, rel=0.01)
    assert found["give"].value == pytest.approx(GIVE, rel=0.35)
