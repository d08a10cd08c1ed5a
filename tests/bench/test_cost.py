"""Campaigns whose cost is measured, and what the largest ones may need."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pandas as pd
import pytest

from bench.explain_cost import make_strikes, make_swing, measure_cost


def test_strikes_are_drawn_in_any_number(tmp_path):
    make_strikes(12, tmp_path)
    table = pd.read_csv(tmp_path / "ball.csv")
    assert table["trial"].nunique() == 12
    assert table["ball"].nunique() == 2


@pytest.mark.slow
def test_a_swing_of_two_minutes_fits_into_400_megabytes(tmp_path):
    """24,000 readings took 3 GB."""
    make_swing(tmp_path)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        cost = pool.submit(measure_cost, tmp_path).result()
    assert cost.megabytes < 400.0
    assert {name.split()[0] for name in cost.named} == {"bearing_friction", "viscous_damping"}
