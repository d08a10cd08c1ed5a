"""One engine for tracks and tables? The tables' exact evidence on the linearised tracks.

Around the refitted baseline the tracks are linear in small strengths, so the evidence of every set
of up to two effects is a closed formula, all forms and places of a law averaged, as for tables. No
set is refitted and no law's form is loose: what that costs is what this prints.
"""

import argparse
import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import logsumexp

from bench.concealed.campaign import Key
from bench.concealed.foreign import convert_all
from bench.concealed.foreign_keys import foreign_key
from mismatch.candidates import candidates_for
from mismatch.fitting.prepare import prepare
from mismatch.fitting.scan import Scan, scan
from physics.domain import FloatArray
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign
from pipelines.setup.file import load_setup

SIZE_PRIOR = (0.5, 0.4, 0.1)
"""Prior probability that nothing, one or two things are missing."""

USUAL_SIZES = 3.0
"""Prior width of a strength in its scales, where no width is known."""

FORMS_IN_PAIRS = 3
"""Forms and places of each law that take part in pairs, its best ones alone."""

SURE = 0.9


@dataclass(frozen=True)
class Weighed:
    """The likeliest set, its probability, and the probability of every id."""

    ids: tuple[str, ...]
    probability: float
    inclusion: dict[str, float]


def _log_evidence(scored: Scan, widths: FloatArray, members: Sequence[int]) -> float:
    which = np.array([column for m in members for column in scored.columns[m]])
    width, score = widths[which], scored.score[which]
    block = scored.information[np.ix_(which, which)]
    looks = sum(getattr(scored.candidates[m].effect, "looks", 0.0) for m in members)
    gain = float(score @ np.linalg.solve(block + np.diag(width**-2.0), score))
    price = np.linalg.slogdet(np.eye(width.size) + width[:, None] * block * width)[1]
    return 0.5 * (gain - float(price) - looks)


def weighed(scored: Scan) -> Weighed:
    """Every single and every pair by evidence and prior."""
    strengths = [p for one in scored.candidates for p in one.effect.strengths]
    widths = np.array([min(p.width, USUAL_SIZES * p.scale) for p in strengths])
    forms: dict[str, list[int]] = {}
    for index, candidate in enumerate(scored.candidates):
        forms.setdefault(candidate.id, []).append(index)
    alone = {m: _log_evidence(scored, widths, (m,)) for m in range(len(scored.candidates))}
    found: dict[tuple[str, ...], float] = {(): math.log(SIZE_PRIOR[0])}
    for one, members in forms.items():
        together = float(logsumexp([alone[m] for m in members])) - math.log(len(members))
        found[(one,)] = together + math.log(SIZE_PRIOR[1] / len(forms))
    best = {one: sorted(m, key=lambda k: -alone[k])[:FORMS_IN_PAIRS] for one, m in forms.items()}
    pairs = list(itertools.combinations(sorted(forms), 2))
    for first, second in pairs:
        both = [_log_evidence(scored, widths, (a, b)) for a in best[first] for b in best[second]]
        together = float(logsumexp(both)) - math.log(len(both))
        found[(first, second)] = together + math.log(SIZE_PRIOR[2] / len(pairs))
    total = float(logsumexp(list(found.values())))
    chances = {ids: math.exp(value - total) for ids, value in found.items()}
    top = max(chances, key=lambda ids: chances[ids])
    inclusion = {one: sum(p for ids, p in chances.items() if one in ids) for one in forms}
    return Weighed(top, chances[top], inclusion)


def _answered(folder: Path) -> Weighed:
    setup = load_setup(folder / "setup.toml")
    campaign = load_campaign(folder / "ball.csv", folder / "pendulum.csv", setup)
    ready = prepare(campaign, baseline_from_setup(setup, campaign))
    effects = [effect for forms in CATALOGUE.values() for effect in forms]
    pool = candidates_for(ready.forward, ready.model, effects)
    return weighed(scan(ready.forward, ready.fit, pool).with_likely_widths())


def _line(name: str, key: Key, answer: Weighed) -> str:
    truth = {hidden.id for hidden in key.effects}
    said = [f"{one} {p:.2f}" for one, p in answer.inclusion.items() if p > 1.0 - SURE]
    wrong = any(p >= SURE and one not in truth for one, p in answer.inclusion.items())
    verdict = "yes" if set(answer.ids) == truth else "sure and wrong" if wrong else "no"
    return f"| {name} | {key.level} | {' + '.join(sorted(truth))} | {', '.join(said)} | {verdict} |"


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.concealed.contest.exact_evidence", description=__doc__
    )
    parser.add_argument("source", type=Path, help="folder of foreign campaigns")
    parser.add_argument("cache", type=Path, help="where the converted campaigns go")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=100)
    options = parser.parse_args()
    print("| campaign | level | concealed | probabilities above 0.1 | that set |")
    print("|---|---|---|---|---|")
    start = time.process_time()
    folders = convert_all(options.source, options.cache)[options.first :][: options.count]
    for folder in folders:
        key = foreign_key(options.source / folder.name / "answer.json")
        print(_line(folder.name, key, _answered(folder)), flush=True)
    print(f"\n{(time.process_time() - start) / max(len(folders), 1):.1f} s a campaign")


if __name__ == "__main__":
    main()
