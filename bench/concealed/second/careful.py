"""Draw strikes of careful laboratories: nothing is missing, every input is a little off."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.concealed.campaign import Hidden, Key, read_key, write_key
from bench.concealed.second.draw import Plan, draw_plan, perform
from bench.concealed.second.laws import Law
from bench.concealed.second.motion import Shots

__all__ = ["GENERATOR", "INSTRUMENTS", "draw_careful"]

# Increased whenever the campaigns of a seed change.
GENERATOR = 1
STATED = {
    "inertia": 0.002, "pendulum_mass": 0.001, "com": 0.001,
    "ball_mass": 0.001, "diameter": 0.001,
}  # fmt: skip
"""Relative standard uncertainties that a careful set-up file states."""
UNSTATED = 0.5
"""Fraction of the laboratories whose set-up file states no uncertainty."""
INSTRUMENTS = (
    Law("ruler", "length_scale", "measurement", "scale about the resting ball", 0.001, 0.05, (1,),
        image=lambda a, x, y, rest_y: (x * (1.0 + a), rest_y + (y - rest_y) * (1.0 + a))),
    Law("level", "camera_roll", "measurement", "roll about the resting ball", 0.001, 0.05, (1,),
        image=lambda a, x, y, rest_y: (x - a * (y - rest_y), y + a * x)),
    Law("clock", "time_base", "measurement", "a constant error of the rate", 3e-4, 0.05, (1,),
        clock=lambda a, t: t / (1.0 + a)),
)  # fmt: skip
"""Errors of ruler, level and clock; `unit` is their standard deviation."""


def _off(shots: Shots, errors: Mapping[str, float]) -> Shots:
    """The shots as they are where the stated inputs are off by `errors`."""
    diameter = shots.diameter * (1.0 + errors["diameter"])
    arm = shots.weight_arm * (1.0 + errors["pendulum_mass"]) * (1.0 + errors["com"])
    return replace(
        shots,
        mass=shots.mass * (1.0 + errors["ball_mass"]),
        diameter=diameter,
        rest_y=shots.rest_y + 0.5 * (diameter - shots.diameter),
        inertia=shots.inertia * (1.0 + errors["inertia"]),
        weight_arm=arm,
    )


def _laboratory(rng: np.random.Generator) -> tuple[Plan, tuple[tuple[Law, float], ...]]:
    """What happens in one laboratory, its set-up file, and the errors of its instruments."""
    plan = draw_plan(rng)
    errors = {name: float(rng.normal(0.0, size)) for name, size in STATED.items()}
    stated = {} if rng.random() < UNSTATED else STATED
    faults = tuple((law, float(rng.normal(0.0, law.unit))) for law in INSTRUMENTS)
    facts = replace(plan.facts, relative_std=stated)
    return replace(plan, shots=_off(plan.shots, errors), facts=facts), faults


def draw_careful(seed: int, number: int, folder: Path, keys: Path) -> Key:
    """Write campaign `number` of a seed to `folder` and its key to the folder `keys`.

    The key lists the errors of the instruments: to name one of them is no false name.
    """
    key_file = keys / f"{number:04d}.json"
    if key_file.exists():
        return read_key(key_file)
    keys.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, number, 3])
    plan, faults = _laboratory(rng)
    truths = perform(rng, plan, faults, folder)
    hidden = tuple(
        Hidden(law.name, law.id, law.phase, law.form, size, {}, (), False, 0.0, ())
        for law, size in faults
    )
    key = Key(number, seed, "careful", "none", 0.0, None, (), hidden, truths)
    write_key(key_file, key)
    return key
