"""Constants of the gate, read off one world and scored on another."""

import pytest

from bench.concealed.calibration import Claim, Trusts, trusts_of
from mismatch.explain import CATALOGUE_TRUST, GROUP_TRUST


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
