"""A campaign scanned in parts has the scores of the whole one."""

import numpy as np
import pytest

from mismatch.candidates import candidates_for
from mismatch.fitting import scan as scanning
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import scan
from mismatch.sanity import DroppedInEach
from physics.effects import CATALOGUE
from tests.mismatch.synthetic import struck_campaign, thrown_campaign


@pytest.mark.parametrize("made", [struck_campaign, thrown_campaign])
def test_parts_of_a_campaign_add_up_to_the_whole(made, monkeypatch):
    prepared = prepare(*made())
    forward, base = prepared.forward, prepared.fit
    trials = forward.records.trials
    jumps = DroppedInEach(instants=tuple(0.05 + 0.01 * np.arange(trials)))
    effects = [effect for forms in CATALOGUE.values() for effect in forms]
    pool = candidates_for(forward, base.model, [*effects, jumps])
    whole = scan(forward, base, pool)
    monkeypatch.setattr(scanning, "TRIALS_AT_ONCE", 2)
    parts = scan(forward, base, pool)
    scale = np.sqrt(np.diag(whole.information))
    assert parts.information / np.outer(scale, scale) == pytest.approx(
        whole.information / np.outer(scale, scale), abs=1e-6
    )
    assert parts.score / scale == pytest.approx(whole.score / scale, abs=1e-4)
    assert parts.scattered == pytest.approx(whole.scattered, abs=1e-3)
