"""Time window of an unnamed force."""

import numpy as np
import pytest

from mismatch.explain import explain
from mismatch.search.unnamed import Gust
from tests.mismatch.synthetic import struck_campaign


@pytest.mark.slow
@pytest.mark.parametrize("length", [pytest.param(0.04, marks=pytest.mark.slow), 0.09])
def test_start_and_end_of_a_gust_are_found(length):
    blown = {"strength": 0.8, "middle": 0.15, "duration": length}
    verdict = explain(*struck_campaign((Gust(), blown), seed=8, trials=5))
    assert {effect.id for effect in verdict.effects} == {"unnamed"}
    where = verdict.location
    assert where is not None
    assert (where.phase, where.channel) == ("flight", "horizontal")
    # The window is counted from release, about 15 ms after the first touch; a flight takes 0.3 s.
    touch = 0.015
    assert where.t_start_s == pytest.approx(0.15 - 0.5 * length + touch, abs=0.015)
    assert where.t_end_s == pytest.approx(0.15 + 0.5 * length + touch, abs=0.015)
    assert np.isfinite(where.t_end_s)
