"""Step size of the forward model compared with much finer steps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sample_videos
from measuring.setup.file import load_setup
from mismatch.candidates import candidates_for
from mismatch.fitting.prepare import Prepared, prepare
from mismatch.records import BallModel, Baseline, CampaignRecords, Trial
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign

CAMPAIGN = Path(sample_videos.__file__).parent / "campaign"
STRONG = 10.0
"""Multiple of the largest expected strength."""

RELATIVE = 5e-4
"""Error of a displacement over the largest one: a hundredth of usual errors of a form."""


@pytest.fixture(scope="module")
def prepared() -> Prepared:
    known = load_setup(CAMPAIGN / "setup.toml")
    campaign = load_campaign(CAMPAIGN / "ball.csv", CAMPAIGN / "pendulum.csv", known)
    return prepare(campaign, baseline_from_setup(known, campaign))


def test_smooth_laws_of_flight_need_no_finer_steps(prepared: Prepared) -> None:
    assert prepared.forward.mode == "impact"
    _assert_steps_suffice(prepared)


def _assert_steps_suffice(prepared: Prepared, most: float = 1e-3) -> None:
    forward = prepared.forward
    finer = replace(forward, steps=16 * forward.steps)
    catalogue = [effect for forms in CATALOGUE.values() for effect in forms]
    pool = candidates_for(forward, prepared.model, catalogue)
    without = finer.predict([prepared.model], prepared.fit.nuisance[None])[0]
    looked: set[object] = set()
    for candidate in pool:
        law = candidate.effect
        if law.sharp or "force" not in law.hooks or candidate.key in looked:
            continue
        looked.add(candidate.key)
        shape = dict(candidate.shape)
        values = {
            p.name: shape[p.name]
            if p.name in shape
            else float(np.clip(p.neutral + STRONG * p.scale, p.lower, p.upper))
            for p in law.parameters
        }
        model = replace(prepared.model, entries=(*prepared.model.entries, (law, values)))
        coarse, fine = (
            one.predict([model], prepared.fit.nuisance[None])[0] for one in (forward, finer)
        )
        off = np.abs(coarse - fine) * forward.records.weights
        moved = np.abs(fine - without) * forward.records.weights
        assert np.nanmax(off) < max(most, RELATIVE * moved.max()), (law.id, law.form)
    assert len(looked) > 8


@pytest.mark.parametrize(("mass", "diameter"), [(0.0577, 0.066), (0.0027, 0.04)])
def test_smooth_throws_need_no_finer_steps(mass: float, diameter: float) -> None:
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 0.6, 0.01)
    trials = []
    for number in range(3):
        start = np.array([0.0, 1.0]), np.array([3.0 + number, 4.0])
        way = start[0] + start[1] * time[:, None] + np.array([0.0, -4.9]) * time[:, None] ** 2
        seen = np.column_stack([way + 1e-3 * rng.standard_normal(way.shape), np.full(60, np.nan)])
        trials.append(Trial(str(number), time, seen, np.zeros(0), np.zeros(0)))
    baseline = Baseline({"": BallModel("", mass, diameter)})
    known = prepare(CampaignRecords(tuple(trials)), baseline)
    assert known.forward.mode == "flight"
    assert known.forward.thrown_share > 1
    _assert_steps_suffice(known, 3e-3)


def test_models_predicted_together_are_predicted_as_alone(prepared: Prepared) -> None:
    """What models share is followed once: each has to get its own strike, flight and image."""
    forward, fit = prepared.forward, prepared.fit
    catalogue = [forms[0] for forms in CATALOGUE.values() if forms[0].strengths]
    models = [fit.model]
    for law in catalogue:
        strong = {p.name: float(np.clip(p.neutral + p.scale, p.lower, p.upper))
                  for p in law.strengths}  # fmt: skip
        models.append(fit.model.having(law, law.neutral | strong).order())
    own = np.repeat(fit.nuisance[None], len(models), axis=0)
    own[3] += 1e-3
    together = forward.predict(models, own)
    for place, model in enumerate(models):
        alone = forward.predict([model], own[place][None])[0]
        off = np.abs(together[place] - alone) * forward.records.weights
        assert off.max() < 1e-2, model.ids
    # Spin decays only with spin, and air thins only above the floor: those two move nothing.
    assert len({one.tobytes() for one in together}) >= len(models) - 2
