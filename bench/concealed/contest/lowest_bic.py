"""The plain recipe: every effect and pair by least squares, the lowest BIC named, nothing else.

It is given the engine's own forward model, noise and catalogue, so that what differs is the recipe:
no bootstrap of the null, no groups, no forces without a name.
"""

import time
from itertools import combinations
from pathlib import Path

import numpy as np

from bench.concealed.contest.answer import Answer, Named
from metrology import ImpactVisionError
from mismatch.candidates import candidates_for
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import Scan, scan
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign
from pipelines.setup.file import load_setup

__all__ = ["lowest_bic"]

SEEDS = 12
"""Singles from which pairs are made."""


def _cost(scored: Scan, members: tuple[int, ...], rows: int) -> float:
    """BIC against the refitted baseline; shapes count as parameters as strengths do."""
    gain, _ = scored.gain(*members)
    free = sum(len(scored.columns[m]) + len(scored.candidates[m].shape) for m in members)
    return free * float(np.log(rows)) - gain


def lowest_bic(folder: Path) -> Answer:
    """Answer of lowest BIC for a campaign folder."""
    start = time.perf_counter()
    ball, pendulum = folder / "ball.csv", folder / "pendulum.csv"
    setup = load_setup(folder / "setup.toml")
    try:
        campaign = load_campaign(
            ball if ball.exists() else None, pendulum if pendulum.exists() else None, setup
        )
        prepared = prepare(campaign, baseline_from_setup(setup, campaign))
    except ImpactVisionError as problem:
        return Answer("failed", seconds=time.perf_counter() - start, failure=str(problem))
    effects = [effect for forms in CATALOGUE.values() for effect in forms]
    candidates = tuple(
        candidate
        for candidate in candidates_for(prepared.forward, prepared.fit.model, effects)
        if candidate.id != "unnamed"
    )
    scored = scan(prepared.forward, prepared.fit, candidates)
    rows = prepared.fit.count
    singles = sorted((_cost(scored, (i,), rows), (i,)) for i in range(len(candidates)))
    pairs = [
        (_cost(scored, (a, b), rows), (a, b))
        for (_, (a,)), (_, (b,)) in combinations(singles[:SEEDS], 2)
        if candidates[a].id != candidates[b].id
    ]
    seconds = time.perf_counter() - start
    _, members = min([(0.0, ()), *singles, *pairs], key=lambda item: item[0])
    if not members:
        return Answer("no_mismatch", seconds=seconds)
    named = tuple(Named(name, None, {}) for name in sorted({candidates[m].id for m in members}))
    return Answer("explained", named, seconds=seconds)
