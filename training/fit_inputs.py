"""Fit the prior odds of usual errors of the inputs against a missing law.

Searches campaigns with keys with their inputs held, and fits usual errors of inputs and instruments
in place of what is found. Where these are ahead by `PRIOR_COST`, the engine opens them. In careful
laboratories they should be, in campaigns with a concealed law they should not. A careful laboratory
of which only errors are named that it has is on neither side.
Run `python -m training.fit_inputs --careful FOLDER --concealed FOLDER … --cache FOLDER`.
"""

import argparse
import json
from collections.abc import Collection, Iterable
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from bench.concealed.second.careful import INSTRUMENTS
from bench.concealed.statistics import wilson
from measuring.setup.file import load_setup
from metrology import write_text_whole
from mismatch.fitting.prepare import prepare
from mismatch.search.inputs import PRIOR_COST, lead_of_inputs
from mismatch.search.naming import name_effects
from physics.effects import CATALOGUE
from pipelines.explain.campaign import baseline_from_setup, load_campaign

__all__ = ["fit_cost", "lead"]

STRONG = 60.0
"""Chi-square units by which either side may be ahead and still say something of the odds: beyond,
the form of a law is at fault. Chosen; insensitive between 20 and 200."""


def lead(folder: Path, cache: Path, errors: Collection[str] = ()) -> float | None:
    """Evidence of the inputs over the names of a campaign.

    None where nothing is named, or nothing but `errors` that the campaign has.
    """
    output = cache / f"{folder.parent.name}-{folder.name}-lead.json"
    if not output.exists():
        setup = load_setup(folder / "setup.toml")
        campaign = load_campaign(folder / "ball.csv", folder / "pendulum.csv", setup)
        prepared = prepare(campaign, baseline_from_setup(setup, campaign))
        catalogue = [effect for forms in CATALOGUE.values() for effect in forms]
        naming = name_effects(prepared.forward, prepared.fit, catalogue)
        names = () if naming.best is None else naming.best.ids
        write_text_whole(output, json.dumps((lead_of_inputs(prepared, naming), names)))
    found, names = json.loads(output.read_text(encoding="utf-8"))
    return None if found is None or set(names) <= {*errors} else float(found)


def fit_cost(careful: Iterable[float], concealed: Iterable[float]) -> tuple[float, float]:
    """Cost at which the odds e^(lead − cost)/2 are most probable, and its standard uncertainty."""
    ahead = np.clip(np.array([*careful]), -STRONG, STRONG)
    behind = np.clip(np.array([*concealed]), -STRONG, STRONG)

    def surprise(cost: float) -> float:
        wrong = np.concatenate([cost - ahead, behind - cost])
        return float(np.sum(np.logaddexp(0.0, 0.5 * wrong)))

    cost = float(minimize_scalar(surprise, bounds=(-STRONG, STRONG), method="bounded").x)
    chance = 1.0 / (1.0 + np.exp(-0.5 * (np.concatenate([ahead, behind]) - cost)))
    information = 0.25 * float(np.sum(chance * (1.0 - chance)))
    return cost, 1.0 / np.sqrt(max(information, 1e-12))


def _leads(source: Path, cache: Path, most: int, errors: Collection[str] = ()) -> list[float]:
    folders = [p.parent for p in sorted(source.glob("*/setup.toml"))]
    struck = [folder for folder in folders if (folder / "ball.csv").exists()]
    return [one for folder in struck[:most] if (one := lead(folder, cache, errors)) is not None]


def _print_reliability(careful: list[float], concealed: list[float], cost: float) -> None:
    """Stated probability of careful inputs by thirds of all campaigns, and how many are careful."""
    leads = np.clip(np.array([*careful, *concealed]), -STRONG, STRONG)
    right = np.repeat([1.0, 0.0], [len(careful), len(concealed)])
    chance = 1.0 / (1.0 + np.exp(-0.5 * (leads - cost)))
    for third in np.array_split(np.argsort(chance), 3):
        if third.size:
            stated, seen = chance[third].mean(), right[third].mean()
            print(f"stated {stated:.2f}, careful {seen:.2f} of {third.size} campaigns")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m training.fit_inputs")
    parser.add_argument("--careful", type=Path, required=True)
    parser.add_argument("--concealed", type=Path, nargs="+", required=True)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--most", type=int, default=24, help="campaigns of each folder")
    options = parser.parse_args()
    options.cache.mkdir(parents=True, exist_ok=True)
    errors = {law.id for law in INSTRUMENTS}
    careful = _leads(options.careful, options.cache, options.most, errors)
    concealed = [
        one for source in options.concealed for one in _leads(source, options.cache, options.most)
    ]
    for name, leads, right in (("careful", careful, True), ("concealed", concealed, False)):
        count = sum((one > PRIOR_COST) == right for one in leads)
        low, high = wilson(count, len(leads))
        print(f"{name}: {count} of {len(leads)} on the right side ({low:.2f} to {high:.2f})")
    cost, std = fit_cost(careful, concealed)
    print(f"cost: {cost:.1f} ± {std:.1f}, used: {PRIOR_COST}")
    _print_reliability(careful, concealed, cost)


if __name__ == "__main__":
    main()
