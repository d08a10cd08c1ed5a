"""Credible set of answers."""

import pytest

from mismatch.search.naming import CREDIBLE, _credible

TOLERANCE = 7.0


@pytest.mark.parametrize("twins", [2, 3, 6])
def test_equally_good_answers_are_all_kept(twins):
    gaps = {(f"law_{k}",): 0.0 for k in range(twins)}
    assert _credible(gaps, TOLERANCE) == frozenset(gaps)


def test_a_tail_of_improbable_answers_is_dropped():
    gaps = {("best",): 0.0, ("near",): 0.5} | {(f"far_{k}",): 6.9 for k in range(2)}
    assert _credible(gaps, TOLERANCE) == {("best",), ("near",)}


def test_the_dropped_probability_is_below_the_limit():
    gaps = {(f"law_{k}",): 0.9 * k for k in range(8)}
    weights = {ids: 2.718281828 ** (-gap / 2.2) for ids, gap in gaps.items()}
    kept = sum(weights[ids] for ids in _credible(gaps, TOLERANCE))
    assert kept >= CREDIBLE * sum(weights.values())
