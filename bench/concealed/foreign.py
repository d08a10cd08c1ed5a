"""Convert campaigns of an independent simulator to the engine's input and keys."""

import json
import shutil
from pathlib import Path
from typing import Any

from bench.concealed.campaign import Hidden, Key, TrialTruth
from bench.concealed.setup_toml import BallFacts, LabFacts, Outcome, write_setup

__all__ = ["CONTRACT_ID", "convert", "foreign_key", "lab_facts"]

# Symbols of the foreign simulator.
OUTCOME_SYMBOLS = {
    "impact_speed": "v_M0",
    "cor": "e",
    "contact_time": "dt_s",
    "pendulum_speed_after": "v_M",
    "pendulum_angle": "phi_release",
    "ball_x": "x",
    "ball_y": "y",
    "ball_vx": "vx",
    "ball_vy": "vy",
}


def _ball(public: dict[str, Any]) -> BallFacts:
    return BallFacts(
        mass=public["mass_kg"],
        diameter=public["diameter_m"],
        launch_angle_deg=public["impact_angle_deg"],
        cor_law=public["cor_law"],
        contact_outcome=tuple(
            Outcome(**{ours: row[theirs] for ours, theirs in OUTCOME_SYMBOLS.items()})
            for row in public["baseline_contact"]
        ),
    )


def lab_facts(public: dict[str, Any]) -> LabFacts:
    """Facts known to the laboratory, from the public file of a foreign campaign."""
    pendulum, scatter = public["pendulum"], public["scatter"]
    return LabFacts(
        balls={name: _ball(ball) for name, ball in public["balls"].items()},
        pendulum_length=pendulum["L"],
        pendulum_inertia=pendulum["I"],
        pendulum_mass=pendulum["m"],
        pendulum_com=pendulum["d"],
        effective_mass=pendulum["M_eff_paper"],
        support_height=public["support_height_m"],
        air_density=public["air_density"],
        air_viscosity=public["air_viscosity"],
        position_noise=public["noise_xy_m"],
        angle_noise=public["noise_phi_rad"],
        capture_fps=public["fps_nominal"],
        scatter={
            "backswing": f"{scatter['backswing_deg']} deg",
            "launch_angle": f"{scatter['launch_angle_deg_per_trial']} deg",
            "cor": f"{scatter['cor_per_trial']}",
            "cor_law": f"{scatter['cor_law_offset']}",
            "launch_angle_law": f"{scatter['launch_angle_deg_offset']} deg",
        },
        drag_coefficient=public["Cd"] or None,
    )


def convert(source: Path, target: Path) -> None:
    """Write ball.csv, pendulum.csv and setup.toml of one foreign campaign, without its key."""
    target.mkdir(parents=True, exist_ok=True)
    for name in ("ball.csv", "pendulum.csv", "setup.toml"):
        if (source / name).exists():
            shutil.copyfile(source / name, target / name)
    if not (source / "public.json").exists():
        return
    public = json.loads((source / "public.json").read_text(encoding="utf-8"))
    write_setup(target / "setup.toml", lab_facts(public))


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
# Drifts with the order of the trials have the phase `across_trials`.
DRIFTS = frozenset({"aging"})
FOREIGN_CHANNELS = {
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
        channels=FOREIGN_CHANNELS.get(name, ()),
        local=False,
        delta_chi2=delta_chi2,
        alike=tuple(sorted({CONTRACT_ID.get(other, other) for other in alike})),
    )


def _third_key(raw: dict[str, Any]) -> Key:
    """The key of a campaign of the third world, whose laws carry the contract's ids."""
    total, alone = raw["delta_chi2"], raw["delta_chi2_of_each"]
    effects = tuple(
        Hidden(
            name=effect["law"], id=effect["id"], phase=effect["phase"], knob=effect["law"],
            amplitude=effect["value"], constants={}, channels=(), local=False,
            delta_chi2=alone.get(effect["law"], total), alike=tuple(raw["fair"]),
        )
        for effect in raw["effects"]
    )  # fmt: skip
    return Key(raw["case"], 0, raw["kind"], raw["level"], total, None, (), effects, ())


def foreign_key(path: Path) -> Key:
    """The key of a foreign campaign from its answer.json."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    if "ids" in raw:
        return _third_key(raw)
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
