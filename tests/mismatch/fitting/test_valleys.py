"""Parameters correlated with nuisances are found from any start."""

import numpy as np
import pytest

from bench.concealed.second.draw import draw_campaign
from measuring.setup.file import load_setup
from mismatch.candidates import candidates_for
from mismatch.fitting.fit import fit_model, free_parameters
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.search.naming import Naming, _confirmed
from physics.effects import CATALOGUE, Form
from pipelines.explain.campaign import baseline_from_setup, load_campaign


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """Strikes 30 mm off centre, partly absorbed by the launch angle."""
    folder = tmp_path_factory.mktemp("turned")
    key = draw_campaign(2026, 24, folder / "files", folder / "keys")
    assert [hidden.id for hidden in key.effects] == ["oblique_impact"]
    files = folder / "files"
    setup = load_setup(files / "setup.toml")
    campaign = load_campaign(files / "ball.csv", files / "pendulum.csv", setup)
    return prepare(campaign, baseline_from_setup(setup, campaign))


def test_a_tilted_face_is_found_from_any_start(turned):
    (effect,) = (e for e in CATALOGUE["oblique_impact"] if e.form == Form.RUBBING_FACE)
    base, found = turned.fit, []
    for start in (0.0, 0.02):
        model = base.model.having(effect, effect.neutral | {"offset": start}).order()
        free = free_parameters(model, [effect])
        fit = fit_model(turned.forward, model, free, (base.nuisance, base.law_offsets))
        found.append(fit.objective)
    assert max(found) - min(found) < 1.0
    assert base.objective - max(found) > 700.0


def test_an_answer_of_one_start_is_refitted_from_others(turned):
    forward, base = turned.forward, turned.fit
    (effect,) = (e for e in CATALOGUE["oblique_impact"] if e.form == Form.RUBBING_FACE)
    pool = candidates_for(forward, base.model, [effect], unnamed=False)
    astray = fit_hypothesis(forward, base, pool, [np.array([0.03, 0.0])], rounds=1)
    unsure = Naming(astray, (astray,), 12.0, scan(forward, base, pool))
    sure = _confirmed(forward, base, unsure)
    assert unsure.agreed == 1
    assert sure.agreed == 2
    assert sure.best.gain > 700.0 > astray.gain
