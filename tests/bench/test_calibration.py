"""Trust constants fitted to one world and scored on another."""

import pytest

from bench.concealed.calibration import Claim, Trusts, trusts_of
from mismatch.explain import CATALOGUE_TRUST, GROUP_TRUST


def claim(raw, right, grouped=False, names=1):
    stated = raw * CATALOGUE_TRUST**names * (GROUP_TRUST if grouped else 1.0)
    return Claim(stated, right, right, grouped, names)


def test_constants_calibrate_the_answers_of_a_world():
    alone = [claim(1.0, True)] * 18
    beside = [claim(1.0, k < 6, grouped=True) for k in range(10)]
    trusts = trusts_of([*alone, *beside])
    assert trusts.catalogue == pytest.approx(19 / 20)
    # Six of ten right; the first constant alone predicts 9.5.
    assert trusts.group == pytest.approx(6 / 9.5)
    assert sum(trusts.stated(c) for c in beside) == pytest.approx(6.0)


def test_the_constants_in_use_are_removed_before_others_apply():
    used = Trusts(CATALOGUE_TRUST, GROUP_TRUST)
    one = claim(0.9, True, grouped=True, names=2)
    assert one.untrusted == pytest.approx(0.9)
    assert used.stated(one) == pytest.approx(one.stated)
