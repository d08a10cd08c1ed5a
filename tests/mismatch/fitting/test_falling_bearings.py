"""Bearing friction that falls with the rate needs no further effect."""

from dataclasses import replace

import numpy as np
import pytest

from mismatch.explain import explain
from mismatch.fitting.fit import PIECE_STEPS, rows_at_rest
from mismatch.records import Baseline, CampaignRecords, Trial, lay_out
from physics.bodies import Pendulum
from physics.effects import CATALOGUE, Form, Term
from physics.integrator import integrate
from physics.swing import SwingModel
from tests.mismatch.fitting.rubbing import swung

LENGTH, MASS, NOISE = 0.45, 0.3, 1.5e-3
STIFFNESS = 9.80665 / LENGTH
DRY, MORE, SLOW, LINEAR = 0.12, 0.7, 0.6, 0.06
BODY = Pendulum(length=LENGTH, inertia=MASS * LENGTH**2, mass=MASS, com=LENGTH)
BASELINE = Baseline({}, pendulum=BODY)


def rubbing(rate: float) -> float:
    """Friction over inertia, 1/s²: a Lorentzian of the rate, not in the catalogue."""
    return DRY * (1.0 + MORE / (1.0 + (rate / SLOW) ** 2))


def stretched(rate: float) -> float:
    """The form in the catalogue, with the exponent 1.5."""
    return DRY * (1.0 + MORE * np.exp(-((abs(rate) / SLOW) ** 1.5)))


def campaign(linear: float, seed: int) -> tuple[CampaignRecords, Baseline]:
    """Four swings of eight seconds at 60 Hz."""
    rng, time, trials = np.random.default_rng(seed), np.arange(0.0, 8.0, 1.0 / 60.0), []
    for number, start in enumerate((0.7, -0.45, 0.95, -0.6)):
        seen = swung(start, time + 0.1, STIFFNESS, rubbing, linear) + NOISE * rng.standard_normal(
            time.size
        )
        trials.append(Trial(str(number), np.zeros(0), np.zeros((0, 3)), time, seen))
    return CampaignRecords(tuple(trials)), BASELINE


@pytest.mark.slow
@pytest.mark.parametrize("linear", [0.0, LINEAR])
def test_friction_falling_with_the_rate_needs_no_other_loss(linear):
    verdict = explain(*campaign(linear, 3))
    named = {effect.id: effect for effect in verdict.effects}
    assert set(named) == {"bearing_friction"} | ({"viscous_damping"} if linear else set())
    friction = {p.name: p.value for p in named["bearing_friction"].parameters}
    fallen = np.exp(-((1.0 / friction["rate"]) ** friction["steepness"]))
    found = friction["dry_torque"] * (1.0 + friction["breakaway"] * fallen) / BODY.inertia
    assert found == pytest.approx(rubbing(1.0), rel=0.04)


def test_falling_friction_is_integrated_through_turning_points():
    span, steps = 4.0 * 2.0 * np.pi / np.sqrt(STIFFNESS), 4 * PIECE_STEPS
    forms = {effect.form: effect for effect in CATALOGUE["bearing_friction"]}
    true = swung(0.4, np.linspace(0.0, span, steps + 1), STIFFNESS, stretched)
    shape = {"dry_torque": DRY * BODY.inertia, "rate": SLOW, "steepness": 1.5}
    off = []
    for more in (0.0, MORE):
        law = Term(forms[Form.FALLING], shape | {"breakaway": more})
        model = replace(SwingModel.of(BODY, [law]), step=np.array(span / steps))
        path = integrate(model.rates, np.array([0.4, 0.0]), np.array(span), steps)
        off.append(float(np.abs(path.states[:, 0] - true).max()))
    assert off[1] < 8e-4
    assert off[0] > 4e-3


def test_rest_is_detected_in_noise():
    time = np.arange(0.0, 10.0, 1.0 / 60.0)
    still = swung(0.12, time, STIFFNESS, rubbing)
    assert np.ptp(still[-90:]) == 0.0
    rng, missed = np.random.default_rng(5), 0
    for _ in range(30):
        trials = tuple(
            Trial(str(n), np.zeros(0), np.zeros((0, 3)), time,
                  still + NOISE * rng.standard_normal(time.size))
            for n in range(10)
        )  # fmt: skip
        records = lay_out(CampaignRecords(trials), BASELINE)
        missed += int((~rows_at_rest(records, np.sqrt(STIFFNESS)).any(axis=1)).sum())
    assert missed <= 3
