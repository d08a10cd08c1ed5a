"""Which answers stay beside the best one."""

import pytest

from mismatch.search.naming import CREDIBLE, _credible

TOLERANCE = 7.0


@pytest.mark.parametrize("twins", [2, 3, 6])
def test_what_fits_alike_stays_however_many(twins):
    gaps = {(f"law_{k}",): 0.0 for k in range(twins)}
    assert _credible(gaps, TOLERANCE) == frozenset(gaps)


def test_a_long_tail_of_unlikely_ones_is_left():
    gaps = {("best",): 0.0, ("near",): 0.5} | {(f"far_{k}",): 6.9 for k in range(2)}
    assert _credible(gaps, TOLERANCE) == {("best",), ("near",)}


def test_what_is_left_is_less_than_the_rest_of_the_probability():
    gaps = {(f"law_{k}",): 0.9 * k for k in range(8)}
    weights = {ids: 2.718281828 ** (-gap / 2.2) for ids, gap in gaps.items()}
    kept = sum(weights[ids] for ids in _credible(gaps, TOLERANCE))
    assert kept >= CREDIBLE * sum(weights.values())
