"""An unnamed curve and named effects are ordered by their evidence."""

from types import SimpleNamespace

import pytest

from mismatch.search import naming
from mismatch.search.naming import _goes_first


def answer(ids, gain):
    members = tuple(SimpleNamespace(effect=SimpleNamespace(strengths=())) for _ in ids)
    return SimpleNamespace(
        ids=ids, members=members, penalised_gain=gain, allowed=True, has_unnamed="unnamed" in ids
    )


@pytest.mark.parametrize(("pair", "first"), [(110.0, True), (90.0, False)])
def test_names_are_preferred_to_an_equally_good_curve(monkeypatch, pair, first):
    monkeypatch.setattr(
        naming, "_supported",
        lambda _, larger, smaller, threshold: (
            larger.penalised_gain - smaller.penalised_gain > threshold
        ),
    )  # fmt: skip
    curve, one = answer(("unnamed",), 100.0), answer(("bearing_friction",), 60.0)
    both = answer(("bearing_friction", "pendulum_drag"), pair)
    assert _goes_first(None, both, curve, [curve, one], 12.0) is first
    # It still has the cost of its own parameters.
    assert _goes_first(None, both, one, [one], 12.0)
    assert not _goes_first(None, answer(both.ids, 65.0), one, [one], 12.0)
