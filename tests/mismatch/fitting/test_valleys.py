"""Strengths that trade with what repeats imperfectly are found from wherever the fit starts."""

import pytest

from bench.concealed.second.draw import draw_campaign
from mismatch.fitting.fit import fit_model, free_parameters
from mismatch.fitting.prepare import prepare
from physics.effects import CATALOGUE, Form
from pipelines.explain.campaign import baseline_from_setup, load_campaign
from pipelines.setup.file import load_setup


@pytest.fixture(scope="module")
def turned(tmp_path_factory):
    """Strikes by a face that meets the ball 30 mm off: the launch angle takes up what it may."""
    folder = tmp_path_factory.mktemp("turned")
    key = draw_campaign(2026, 24, folder / "files", folder / "keys")
    assert [hidden.id for hidden in key.effects] == ["oblique_impact"]
    files = folder / "files"
    setup = load_setup(files / "setup.toml")
    campaign = load_campaign(files / "ball.csv", files / "pendulum.csv", setup)
    return prepare(campaign, baseline_from_setup(setup, campaign))


def test_a_turned_face_is_found_from_any_start(turned):
    (effect,) = (e for e in CATALOGUE["oblique_impact"] if e.form == Form.SMOOTH_FACE)
    base, found = turned.fit, []
    for start in (0.0, 0.02):
        model = base.model.having(effect, effect.neutral | {"offset": start}).order()
        free = free_parameters(model, [effect])
        fit = fit_model(turned.forward, model, free, (base.nuisance, base.law_offsets))
        found.append(fit.objective)
    assert max(found) - min(found) < 1.0
    assert base.objective - max(found) > 1000.0
