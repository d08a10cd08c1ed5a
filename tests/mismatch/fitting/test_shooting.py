"""Long free swings compared with trajectories integrated by scipy."""

from dataclasses import replace

import numpy as np
import pytest

from bench.real.made import CART, STRING, write_swings
from measuring.setup.file import load_setup
from mismatch.candidates import candidates_for
from mismatch.fitting.fit import Ending, fit_model, free_parameters, seen_swings
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import Prepared, prepare
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign

LOSSES = ("bearing_friction", "viscous_damping", "pendulum_drag")


def _prepared(tmp_path, rig, rate=None) -> Prepared:
    write_swings(rig, tmp_path, rate)
    setup = load_setup(tmp_path / "setup.toml")
    campaign = load_campaign(None, tmp_path / "pendulum.csv", setup)
    return prepare(campaign, baseline_from_setup(setup, campaign))


def _fitted(prepared: Prepared, *ids: str):
    model = prepared.fit.model
    effects = [CATALOGUE[name][0] for name in ids]
    for effect in effects:
        model = model.having(effect, effect.neutral)
    free = free_parameters(model, effects)
    start = (prepared.fit.nuisance, prepared.fit.law_offsets)
    return fit_model(prepared.forward, model, free, start)


def _rms(prepared: Prepared, fit) -> float:
    weights = prepared.forward.records.weights
    seen = weights > 0.0
    return float(np.sqrt(np.mean((fit.residual[seen] / weights[seen]) ** 2)))


@pytest.mark.parametrize("rate", [None, 25.0])
def test_dry_and_quadratic_losses_are_found_over_many_periods(tmp_path, rate):
    rig = replace(CART, starts=(2.3, -1.6, -0.9))
    prepared = _prepared(tmp_path, rig, rate)
    fit = _fitted(prepared, "bearing_friction", "pendulum_drag")
    inertia = 0.25 * rig.stated_length**2
    assert fit.ending is Ending.CONVERGED
    assert _rms(prepared, fit) < 1.15 * rig.noise
    assert fit.value(0)[0] == pytest.approx(rig.dry * inertia, rel=0.02)
    assert fit.value(1)[0] == pytest.approx(rig.quadratic * inertia, rel=0.02)
    # The stated length is 13 % short: frequencies come from the record.
    ratio = 0.5 * np.log(rig.stated_length / rig.length)
    found = np.log(prepared.forward.pace) + fit.nuisance[:, 2]
    assert found == pytest.approx(ratio, abs=2e-3)


def test_noise_is_separated_from_a_sparsely_sampled_swing(tmp_path):
    prepared = _prepared(tmp_path, replace(CART, starts=(2.3, 1.9)), 25.0)
    # A quartic through 36 rows leaves tenths of a radian of the motion.
    assert prepared.noise.sigma[:, 3] == pytest.approx(CART.noise, rel=1.0)


def test_a_zero_offset_is_no_force(tmp_path):
    rig = replace(STRING, starts=(0.42, -0.36))
    prepared = _prepared(tmp_path, rig)
    fit = _fitted(prepared, "viscous_damping", "pendulum_drag")
    assert fit.nuisance[:, 3] == pytest.approx(rig.zero, abs=3e-4)
    assert _rms(prepared, fit) < 1.1 * rig.noise


def test_the_frequency_of_a_swing_is_estimated_before_the_fit(tmp_path):
    prepared = _prepared(tmp_path, replace(CART, starts=(2.3, 1.0)))
    seen = seen_swings(prepared.forward.records)
    true = np.sqrt(9.80665 / CART.length)
    assert [one.rate for one in seen] == pytest.approx([true, true], rel=0.04)


def test_a_law_out_of_phase_with_the_record_is_no_answer(tmp_path):
    prepared = _prepared(tmp_path, replace(CART, starts=(2.3, 1.9)))
    bare = _fitted(prepared)
    assert _rms(prepared, bare) > 0.05
    assert _rms(prepared, _fitted(prepared, *LOSSES)) < 1.1 * CART.noise


def test_a_law_far_behind_is_followed_alone_and_left_in_a_set(tmp_path):
    """Half of a right pair fits ten times worse than a wrong law, and was left at once."""
    prepared = _prepared(tmp_path, replace(CART, starts=(2.3, -1.6)))
    forward, base = prepared.forward, prepared.fit
    effects = [CATALOGUE[name][0] for name in LOSSES]
    pool = {c.id: c for c in candidates_for(forward, base.model, effects, unnamed=False)}
    none = np.zeros(1)
    alone = fit_hypothesis(forward, base, [pool["pendulum_drag"]], [none])
    rival = 0.1 * alone.fit.objective
    again = fit_hypothesis(forward, base, [pool["pendulum_drag"]], [none], rival=rival)
    assert again.fit.objective == pytest.approx(alone.fit.objective)
    pair = [pool["pendulum_drag"], pool["viscous_damping"]]
    assert fit_hypothesis(forward, base, pair, [none, none]).fit.ending is Ending.CONVERGED
    behind = fit_hypothesis(forward, base, pair, [none, none], rival=1e-3 * rival)
    assert behind.fit.ending is Ending.LOST
