"""Free swings read by a coarse encoder with a displaced axis."""

from dataclasses import replace

import numpy as np
import pytest

from bench.real.made import CART, ENCODER, write_swings
from measuring.setup.file import load_setup
from mismatch.candidates import candidates_for
from mismatch.explain import explain
from mismatch.fitting.fit import Ending
from mismatch.fitting.hypotheses import Hypothesis, fit_hypothesis
from mismatch.fitting.prepare import Prepared, prepare
from mismatch.fitting.reading import resolution
from physics.effects import CATALOGUE
from physics.effects.measurement import PivotElsewhere, ReadingLag
from pipelines.explain.campaign import baseline_from_setup, load_campaign


def _loaded(tmp_path, rig):
    write_swings(rig, tmp_path)
    setup = load_setup(tmp_path / "setup.toml")
    campaign = load_campaign(None, tmp_path / "pendulum.csv", setup)
    return campaign, baseline_from_setup(setup, campaign)


def _prepared(tmp_path, rig) -> Prepared:
    return prepare(*_loaded(tmp_path, rig))


def _fitted(known: Prepared, *ids: str) -> Hypothesis:
    pool = candidates_for(known.forward, known.model, [CATALOGUE[one][0] for one in ids])
    members = [next(c for c in pool if c.id == one) for one in ids]
    strengths = [np.array([p.scale for p in m.effect.strengths]) for m in members]
    return fit_hypothesis(known.forward, known.fit, members, strengths)


def _found(fit, name: str) -> tuple[float, float]:
    (index,) = (k for k, item in enumerate(fit.free) if item.parameter.name == name)
    return fit.value(index)


@pytest.fixture(scope="module")
def known(tmp_path_factory) -> Prepared:
    return _prepared(tmp_path_factory.mktemp("encoder"), ENCODER)


def test_axis_and_backlash_of_an_encoder_are_found_with_its_bearing(known):
    rubbed = _fitted(known, "bearing_friction")
    assert rubbed.fit.ending is Ending.CONVERGED
    assert rubbed.reduced_chi2 < 1.2
    axis, std = _found(rubbed.fit, "pivot_x")
    assert axis == pytest.approx(ENCODER.encoder_offset * ENCODER.stated_length, abs=4.0 * std)
    assert axis > 10.0 * std
    play, std = _found(rubbed.fit, "lag")
    assert play == pytest.approx(ENCODER.play, abs=4.0 * std)
    assert play > 4.0 * std


def test_a_bearing_that_varies_is_fitted_release_by_release(known):
    rubbed = _fitted(known, "bearing_friction")
    factors = 1.0 + rubbed.fit.nuisance[:, 4]
    true = np.array(ENCODER.of_each)
    assert factors / factors.mean() == pytest.approx(true / true.mean(), abs=4e-3)
    inertia = 0.25 * ENCODER.stated_length**2
    torque, std = _found(rubbed.fit, "dry_torque")
    assert torque == pytest.approx(ENCODER.dry * inertia, abs=3.0 * std)


def test_factors_of_the_releases_are_relative_to_the_mean_loss(known):
    """With a large misfit, nothing else fixes the mean of the factors."""
    oiled = _fitted(known, "viscous_damping")
    assert np.ptp(oiled.fit.nuisance[:, 4]) > 0.03
    assert abs(oiled.fit.nuisance[:, 4].mean()) < 1e-6


def test_an_ideal_encoder_and_bearing_get_no_correction(tmp_path):
    known = _prepared(tmp_path, replace(CART, starts=(2.3, -1.6, 1.9)))
    assert known.forward.baseline.instruments == ()
    assert known.forward.uneven == 0.0


def test_an_implausible_encoder_offset_is_rejected(tmp_path):
    """An offset eight times the usual one is outside the prior."""
    known = _prepared(tmp_path, replace(ENCODER, encoder_offset=0.08))
    assert not any(isinstance(one, PivotElsewhere) for one in known.forward.baseline.instruments)


@pytest.mark.slow
def test_releases_with_half_the_loss_are_no_variation(tmp_path):
    known = _prepared(tmp_path, replace(ENCODER, of_each=(1.0, 0.5, 0.5)))
    assert known.forward.uneven == 0.0


@pytest.mark.parametrize(("step", "found"), [(2.0 * np.pi / 1200, True), (0.0, False)])
def test_the_resolution_follows_from_the_readings(tmp_path, step, found):
    known = _prepared(tmp_path, replace(ENCODER, step=step or 1e-6, noise=1e-3, play=0.0))
    seen = resolution(known.forward.records)
    assert seen == pytest.approx(step, rel=1e-3) if found else seen < 1e-5
    assert not any(isinstance(one, ReadingLag) for one in known.forward.baseline.instruments)


@pytest.mark.slow
def test_two_releases_of_an_encoder_name_only_its_bearing(tmp_path):
    rig = replace(ENCODER, starts=ENCODER.starts[:2], of_each=ENCODER.of_each[:2])
    verdict = explain(*_loaded(tmp_path, rig))
    assert [one.id for one in verdict.effects] == ["bearing_friction"]
    assert verdict.effects[0].probability > 0.5
