"""Lack of fit by repeats: settings that differ are seen, scatter between repeats is not."""

from dataclasses import replace

import numpy as np

from mismatch.records import settings_of
from mismatch.repeats import lack_of_fit
from mismatch.trial_table import explain_table
from tests.mismatch.table.trial_tables import lab, simulated_table

SETTING = np.repeat(np.arange(6), 5)


def test_settings_that_differ_are_seen_and_the_quantity_is_named():
    rng = np.random.default_rng(0)
    off = np.array([0.4, -0.5, 0.3, -0.2, 0.5, -0.4])[SETTING]
    found = lack_of_fit(
        SETTING,
        {"calm": rng.normal(size=30), "bent": 3.0 * off + rng.normal(scale=0.3, size=30)},
    )
    assert found.lacks
    assert found.quantity == "bent"
    assert "6 settings" in found.in_words


def test_scatter_between_repeats_gives_uniform_p_values():
    rng = np.random.default_rng(1)
    chances = [
        lack_of_fit(SETTING, {"a": rng.standard_t(3, 30), "b": rng.normal(size=30)}).p_value
        for _ in range(40)
    ]
    assert 0.3 < np.mean(chances) < 0.7
    assert sum(p < 0.05 for p in chances) <= 6


def test_without_repeats_nothing_is_said():
    assert lack_of_fit(np.arange(8), {"a": np.arange(8.0)}) is None
    setting = settings_of(np.array([1.0, 1.0, 2.0, np.nan]), ["a", "b", "a", "a"])
    assert len(set(setting[:3])) == 3
    assert setting[3] == -1


def test_a_table_whose_levels_differ_by_more_than_their_repeats_is_no_match():
    table = simulated_table(5, backswing=True, repeats=5)
    assert "no more between settings" in explain_table(table, lab()).verdict.remainder.statement
    _, level = np.unique(table.backswing, return_inverse=True)
    factor = 1.0 + 0.012 * np.array([1.0, -1.0, 1.0, -1.0])[level]
    values = table.values * np.column_stack([np.ones(table.trials), factor, factor**2])
    verdict = explain_table(replace(table, values=values), lab()).verdict
    assert verdict.verdict != "no_mismatch"
    assert not verdict.remainder.white
    assert "depends on the setting" in verdict.remainder.statement
