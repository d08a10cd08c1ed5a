"""Constants of the gate, read off one world and scored on another."""

import numpy as np
import pytest

from bench.concealed.calibration import Claim, Trusts, trusts_of
from bench.concealed.contest.exact_evidence import weighed
from mismatch.candidates import Candidate
from mismatch.explain import CATALOGUE_TRUST, GROUP_TRUST
from mismatch.fitting.scan import Scan
from physics.effects import CATALOGUE


def claim(raw, right, grouped=False, names=1):
    stated = raw * CATALOGUE_TRUST**names * (GROUP_TRUST if grouped else 1.0)
    return Claim(stated, right, right, grouped, names)


def test_constants_are_those_that_would_have_made_a_world_honest():
    alone = [claim(1.0, True)] * 18
    beside = [claim(1.0, k < 6, grouped=True) for k in range(10)]
    trusts = trusts_of([*alone, *beside])
    assert trusts.catalogue == pytest.approx(19 / 20)
    # Six of ten right, of which 9.5 were to be by the first constant alone.
    assert trusts.group == pytest.approx(6 / 9.5)
    assert sum(trusts.stated(c) for c in beside) == pytest.approx(6.0)


def test_what_is_in_use_is_taken_off_before_others_are_put_on():
    used = Trusts(CATALOGUE_TRUST, GROUP_TRUST)
    one = claim(0.9, True, grouped=True, names=2)
    assert one.untrusted == pytest.approx(0.9)
    assert used.stated(one) == pytest.approx(one.stated)


def test_the_linear_evidence_weighs_sets_by_size_and_forms():
    pool = tuple(Candidate(CATALOGUE[one][0], (), 1) for one in ("magnus", "drag", "buoyancy"))
    size = np.array([p.scale for c in pool for p in c.effect.strengths])
    information = np.diag(400.0 / size**2)
    columns = ((0,), (1,), (2,))
    nothing = Scan(pool, columns, information, 0.5 * 20.0 / size, np.zeros(3))
    assert weighed(nothing).ids == ()
    two = Scan(pool, columns, information, np.array([160.0, 160.0, 1.0]) / size, np.zeros(3))
    found = weighed(two)
    assert found.ids == ("drag", "magnus")
    assert found.inclusion["magnus"] > 0.9 > 0.2 > found.inclusion["buoyancy"]
