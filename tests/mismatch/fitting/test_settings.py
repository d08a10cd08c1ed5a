"""What repeats of a setting share: found at its size, and counted once."""

import numpy as np
import pytest

from mismatch import explain
from mismatch.fitting.prepare import prepare
from mismatch.fitting.settings import shared_by_repeats
from physics.effects import CATALOGUE
from tests.mismatch.synthetic import struck_campaign

SHARED = (0.4, 0.01, 0.004)


def _found(*, seed: int, trials: int = 12, **more):
    prepared = prepare(*struck_campaign(seed=seed, trials=trials, **more))
    return shared_by_repeats(prepared.forward, prepared.fit)


def test_sizes_of_what_settings_differ_by_are_found():
    found = [_found(seed=seed, at_settings=SHARED) for seed in range(5)]
    assert min(one.gain for one in found) > 9.0
    sizes = np.sqrt(np.mean(np.square([one.spread for one in found]), axis=0))
    assert sizes == pytest.approx([np.radians(0.4), 0.01, 0.004], rel=0.6)


def test_repeats_that_share_nothing_say_so():
    assert all(_found(seed=seed).gain < 9.0 for seed in range(4))


def test_settings_without_repeats_say_nothing():
    assert _found(seed=0, trials=4, at_settings=SHARED).gain == 0.0


def test_errors_of_settings_are_no_law_however_often_they_are_repeated():
    """A back-swing that was off in four ways by chance was backswing_offset, explained, 0.92."""
    verdict = explain(*struck_campaign(seed=2, trials=12, at_settings=SHARED))
    assert not any(effect.probability >= 0.5 for effect in verdict.effects)
    assert any("counts once" in note for note in verdict.notes)


def test_a_law_after_which_settings_differ_no_more_is_kept():
    law = CATALOGUE["velocity_dependent_cor"][0]
    campaign = struck_campaign((law, {law.strengths[0].name: 0.02}), seed=1, trials=12)
    prepared = prepare(*campaign)
    assert shared_by_repeats(prepared.forward, prepared.fit).gain > 9.0
    verdict = explain(*campaign)
    assert [effect.id for effect in verdict.effects] == ["velocity_dependent_cor"]
    assert not any("counts once" in note for note in verdict.notes)
