"""Keys of the foreign campaigns in the form ours have."""

import json
from pathlib import Path
from typing import Any

from bench.concealed.campaign import Hidden, Key, TrialTruth

__all__ = ["CONTRACT_ID", "foreign_key"]

CONTRACT_ID = {
    "offcentre": "oblique_impact",
    "cor_velocity": "velocity_dependent_cor",
    "contact_arm": "effective_mass",
    "coulomb": "bearing_friction",
    "viscous": "viscous_damping",
    "pend_drag": "pendulum_drag",
    "frame_rate": "time_base",
    "scale_error": "length_scale",
    "lens": "lens_distortion",
    "dropped": "dropped_frames",
    "power13": "unnamed",
    "magnet": "unnamed",
    "gust": "unnamed",
    "ground_effect": "unnamed",
    "notch": "unnamed",
    "aging": "unnamed",
}
PHASE = {"camera": "measurement"}
# What drifts with the order of the trials has a word of its own in the contract.
DRIFTS = frozenset({"aging"})
CHANNELS = {
    "power13": ("along_velocity", "horizontal"),
    "gust": ("along_velocity", "horizontal"),
    "ground_effect": ("vertical", "normal_to_velocity"),
    "notch": ("angle",),
}


def _hidden(effect: dict[str, Any], delta_chi2: float, alike: list[str]) -> Hidden:
    name = effect["name"]
    return Hidden(
        name=name,
        id=CONTRACT_ID.get(name, name),
        phase=(
            "across_trials" if name in DRIFTS else PHASE.get(effect["acts_in"], effect["acts_in"])
        ),
        knob=effect["strength_parameter"],
        amplitude=effect["parameters"][effect["strength_parameter"]],
        constants={},
        channels=CHANNELS.get(name, ()),
        local=False,
        delta_chi2=delta_chi2,
        alike=tuple(sorted({CONTRACT_ID.get(other, other) for other in alike})),
    )


def foreign_key(path: Path) -> Key:
    """The key of a foreign campaign from its answer.json."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    total, alone = raw["delta_chi2"], raw["delta_chi2_of_each_effect_alone"]
    alike = raw["indistinguishable_single_effects_expected"]
    effects = tuple(
        _hidden(effect, alone.get(effect["name"], total), alike) for effect in raw["effects"]
    )
    trials = tuple(
        TrialTruth(
            touch=trial["t_first_contact_label"],
            release=trial["t_first_contact_label"] + trial["dt_s"],
            landing=trial["t_first_contact_label"] + trial["t_land_s"],
        )
        for trial in raw["trials"]
    )
    kind = {"none": "null"}.get(raw["kind"], raw["kind"])
    return Key(raw["case"], 0, kind, raw["level"], total, None, (), effects, trials)
