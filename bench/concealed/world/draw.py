"""Draw campaigns from a seed: laboratory, concealed effects and their strength."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from bench.concealed.campaign import Hidden, Key, TrialTruth, perform, read_key, write_key
from bench.concealed.world.design import Design, draw_design
from bench.concealed.world.labs import draw_lab
from bench.concealed.world.recipes import CATALOGUE, FOREIGN_KIND, UNNAMED, Recipe, Strength
from bench.concealed.world.strength import Visibility, visibility
from bench.concealed.world.throws import draw_throws, perform_throws, throws_visibility

__all__ = ["GENERATOR", "KINDS", "drag_stays_positive", "draw_campaign", "kind_of", "level_of"]

# Increased whenever the campaigns of a seed change, so that old caches are not used.
GENERATOR = 5

# Fifty consecutive campaigns contain every kind in the required proportion.
KINDS = tuple(["null"] * 13 + ["single"] * 20 + ["pair"] * 6 + ["twins"] * 2 + ["outside"] * 9)
LEVELS = {"weak": (3.0, 9.9), "medium": (15.0, 95.0), "strong": (150.0, 5000.0)}
ALIKE = 6.0


def level_of(delta_chi2: float) -> str:
    """Weak below 10, medium to 100, strong above."""
    return "weak" if delta_chi2 < 10 else "medium" if delta_chi2 <= 100 else "strong"


def kind_of(seed: int, number: int) -> str:
    """Kind of campaign `number` of a seed."""
    block = np.random.default_rng([seed, number // len(KINDS), 7]).permutation(KINDS)
    return str(block[number % len(KINDS)])


def _constants(rng: np.random.Generator, recipe: Recipe, design: Design) -> dict[str, float]:
    drawn = {name: float(rng.uniform(*span)) for name, span in recipe.constants.items()}
    if recipe.name == "camera_roll":
        poles = [(0.0, 0.0), (0.0, design.lab.support_height), (1.0, 0.6)]
        drawn["pole_x"], drawn["pole_y"] = poles[rng.integers(3)]
    if recipe.name == "dropped_frames" and rng.random() < 0.5:
        drawn["gap_instant"] = float(rng.uniform(0.03, 0.2))
    if recipe.name == "origin_offset":
        drawn["origin_direction"] = float(rng.uniform(0, 2 * np.pi))
    if "power" in drawn and abs(drawn["power"] - 2) < 0.5:
        drawn["power"] = 3.0 if drawn["power"] > 2 else 1.0
    return drawn


def _wanted(rng: np.random.Generator, level: str) -> float:
    low, high = LEVELS[level]
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _scaled(rng: np.random.Generator, design: Design, recipe: Recipe, target: float) -> Strength:
    """Amplitude at which the baseline's misfit is `target`, within the recipe's limit."""
    sign, limit = int(rng.choice(recipe.signs)), recipe.limit
    if recipe.name == "drag" and sign < 0:
        # Less drag than in the baseline, but not negative drag.
        limit = 0.9 * (design.lab.drag_coefficient or 0.0)
    strength = Strength(recipe, sign * recipe.unit, _constants(rng, recipe, design))
    for _ in range(2):
        found = visibility(design, [strength]).matrix[0, 0]
        size = abs(strength.amplitude) * np.sqrt(target / max(found, 1e-9))
        strength = replace(strength, amplitude=sign * float(min(size, limit)))
    return strength


def _signatures(design: Design) -> list[Strength]:
    """Every catalogue effect with a small amplitude and central constants."""
    return [
        Strength(r, r.unit, {name: (low + high) / 2 for name, (low, high) in r.constants.items()})
        for r in CATALOGUE.values()
    ]


def _hidden(strength: Strength, seen: Visibility, position: int, first_sign: int) -> Hidden:
    recipe = strength.recipe
    alike = {
        other.id
        for k, other in enumerate(CATALOGUE.values())
        if other.id != recipe.id and seen.delta_chi2([position], [first_sign + k]) < ALIKE
    }
    return Hidden(
        name=recipe.name,
        id=recipe.id,
        phase=recipe.phase,
        knob=recipe.knob,
        amplitude=strength.amplitude,
        constants=dict(strength.constants),
        channels=recipe.channels,
        local=recipe.local,
        delta_chi2=seen.delta_chi2([position]),
        alike=tuple(sorted(alike)),
    )


def _nearest(seen: Visibility, truth: list[int], first: int) -> float:
    """Misfit left by the best one or two catalogue effects."""
    effects = range(first, len(seen.matrix))
    return min(seen.delta_chi2(truth, list(pair)) for pair in combinations(effects, 2))


def drag_stays_positive(design: Design, chosen: Iterable[Strength]) -> bool:
    """Whether the drag of a pair stays positive at every speed."""
    taken = {"drag_coefficient": 1.0, "crisis_drop": -1.0}
    change = sum(taken.get(one.recipe.knob, 0.0) * one.amplitude for one in chosen)
    return (design.lab.drag_coefficient or 0.0) + change > 0.0


def _pick_pair(rng: np.random.Generator, design: Design, ids: Iterable[str]) -> list[Strength]:
    """Two strong effects, neither of which mimics the other."""
    pool = list(ids)
    picked: list[Strength] = []
    for _ in range(20):
        first, second = rng.choice(pool, 2, replace=False)
        chosen = [
            _scaled(rng, design, CATALOGUE[i], _wanted(rng, "strong")) for i in (first, second)
        ]
        if not drag_stays_positive(design, chosen):
            continue
        picked = chosen
        seen = visibility(design, chosen)
        if min(seen.delta_chi2([0], [1]), seen.delta_chi2([1], [0])) > 100:
            break
    return picked


def _choose(rng: np.random.Generator, kind: str, design: Design) -> list[Strength]:
    if kind == "null":
        return []
    if kind == "single":
        level = str(rng.choice(["weak", "medium", "strong"], p=[0.25, 0.375, 0.375]))
        pool = list(FOREIGN_KIND if rng.random() < 0.7 else CATALOGUE)
        recipe = CATALOGUE[pool[int(rng.integers(len(pool)))]]
        if design.lab.drag_coefficient is None:
            recipe = CATALOGUE["drag"]
            return [Strength(recipe, float(rng.uniform(0.2, 0.45)))]
        return [_scaled(rng, design, recipe, _wanted(rng, level))]
    if kind == "pair":
        return _pick_pair(rng, design, FOREIGN_KIND)
    recipe = UNNAMED[str(rng.choice(list(UNNAMED)))]
    return [_scaled(rng, design, recipe, float(np.exp(rng.uniform(np.log(150), np.log(5000)))))]


def _draw_twins(rng: np.random.Generator, number: int, seed: int, folder: Path) -> Key:
    throws = draw_throws(rng)
    name = str(rng.choice(["time_base", "length_scale"]))
    # The relative error of measured g is twice the clock's or once the length scale's.
    per_amplitude = 2.0 if name == "time_base" else 1.0
    target, sign = float(np.exp(rng.uniform(np.log(60), np.log(3000)))), int(rng.choice([-1, 1]))
    amplitude = sign * 0.01 * np.sqrt(target / throws_visibility(throws, 0.01, per_amplitude))
    errors = (amplitude, 0.0) if name == "time_base" else (0.0, amplitude)
    perform_throws(rng, throws, *errors, folder)
    recipe = CATALOGUE[name]
    twin = "length_scale" if name == "time_base" else "time_base"
    hidden = Hidden(
        name, name, recipe.phase, recipe.knob, float(amplitude), {}, (), False, target, (twin,)
    )
    return Key(number, seed, "twins", level_of(target), target, None, (name, twin), (hidden,), ())


def draw_campaign(seed: int, number: int, folder: Path, keys: Path) -> Key:
    """Write campaign `number` of a seed to `folder` and its key to the folder `keys`.

    A campaign already drawn by this generator is not changed.
    """
    key_file = keys / f"{number:04d}.json"
    if key_file.exists():
        return read_key(key_file)
    keys.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, number])
    kind = kind_of(seed, number)
    if kind == "twins":
        key = _draw_twins(rng, number, seed, folder)
        write_key(key_file, key)
        return key
    air = kind != "single" or rng.random() > 0.06
    design = draw_design(rng, draw_lab(rng, air))
    strengths = _choose(rng, kind, design)
    truths = perform(rng, design, strengths, folder)
    key = _key(seed, number, kind, design, strengths, truths)
    write_key(key_file, key)
    return key


def _key(
    seed: int,
    number: int,
    kind: str,
    design: Design,
    strengths: list[Strength],
    truths: tuple[TrialTruth, ...],
) -> Key:
    if not strengths:
        return Key(number, seed, kind, "none", 0.0, None, (), (), truths)
    seen = visibility(design, [*strengths, *_signatures(design)])
    n = len(strengths)
    hidden = tuple(_hidden(strength, seen, i, n) for i, strength in enumerate(strengths))
    total = seen.delta_chi2(list(range(n)))
    nearest = _nearest(seen, list(range(n)), n) if kind == "outside" else None
    return Key(number, seed, kind, level_of(total), total, nearest, (), hidden, truths)
