"""What a setup states as uncertain is uncertain in what is printed."""

import numpy as np
import pytest

from bench.real.made import SwingRig, write_flights, write_swings
from measuring.setup.file import load_setup
from mismatch.candidates import candidates_for
from mismatch.fitting.hypotheses import fit_hypothesis
from mismatch.fitting.prepare import prepare
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign

SWINGS = SwingRig(0.5, 0.5, 0.05, 0.0, 0.0, 0.0, 1e-3, 1e-5, 50.0, 6.0, (0.8, -0.7))


def _strength(folder, law: str, stated: str, std: str) -> tuple[float, float]:
    """Value and standard uncertainty of a law's first strength, one input stated ± `std`."""
    setup = folder / "setup.toml"
    setup.write_text(setup.read_text().replace(f'{stated}"', f'{stated} ± {std}"'))
    known = load_setup(setup)
    ball, pendulum = folder / "ball.csv", folder / "pendulum.csv"
    campaign = load_campaign(
        ball if ball.exists() else None, pendulum if pendulum.exists() else None, known
    )
    prepared = prepare(campaign, baseline_from_setup(known, campaign))
    pool = candidates_for(prepared.forward, prepared.model, [CATALOGUE[law][0]], unnamed=False)
    start = [np.array([p.scale for p in pool[0].effect.strengths])]
    fit = fit_hypothesis(prepared.forward, prepared.fit, [pool[0]], start).fit
    mine = [fit.model.entries[item.entry][0] is pool[0].effect for item in fit.free]
    return fit.value(mine.index(True))


@pytest.mark.parametrize(
    ("write", "law", "stated"),
    [
        (lambda folder: write_swings(SWINGS, folder), "bearing_friction", "kg m^2"),
        (lambda folder: write_flights(folder, 4), "drag", "2.7 g"),
    ],
)
def test_a_strength_is_as_uncertain_as_the_body_that_it_acts_on(tmp_path, write, law, stated):
    found = {}
    for std in ("0.1 %", "5 %"):
        folder = tmp_path / std[0]
        write(folder)
        found[std] = _strength(folder, law, stated, std)
    (value, sure), (same, unsure) = found.values()
    assert same == pytest.approx(value, rel=0.01)
    assert sure < 0.02 * value
    assert unsure == pytest.approx(0.05 * value, rel=0.1)
