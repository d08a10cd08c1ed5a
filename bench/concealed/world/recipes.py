"""Effects that can be concealed: every catalogue id, and forces in no catalogue."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np

from bench.concealed.world.camera import CameraFaults
from bench.concealed.world.shots import Array, Shots

__all__ = ["CATALOGUE", "FOREIGN_KIND", "UNNAMED", "Recipe", "Strength", "apply"]

CAMERA_FIELDS = {f.name for f in fields(CameraFaults)}


@dataclass(frozen=True)
class Recipe:
    """One effect to conceal: its parameter, range, phase and direction.

    `unit` is a small value for finite differences, `limit` the largest plausible one.
    `channels` are the directions that count as right.
    """

    name: str
    id: str
    phase: str
    knob: str
    unit: float
    limit: float
    signs: tuple[int, ...] = (1,)
    channels: tuple[str, ...] = ()
    constants: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    local: bool = False


@dataclass(frozen=True)
class Strength:
    """A recipe with its drawn constants and its amplitude in the parameter's unit."""

    recipe: Recipe
    amplitude: float
    constants: Mapping[str, float] = field(default_factory=dict)


BOTH = (1, -1)
ALONG = ("along_velocity", "horizontal")
EITHER = ("along_velocity", "normal_to_velocity", "horizontal", "vertical")

CATALOGUE: dict[str, Recipe] = {
    recipe.name: recipe
    for recipe in (
        Recipe("drag", "drag", "flight", "drag_coefficient", 0.02, 0.45, BOTH),
        Recipe(
            "drag_crisis", "drag_crisis", "flight", "crisis_drop", 0.02, 0.35,
            constants={"crisis_speed": (3.0, 5.0)},
        ),
        Recipe("magnus", "magnus", "flight", "spin", 0.5, 60.0, BOTH),
        Recipe("wind", "wind", "flight", "wind", 0.05, 3.0, BOTH),
        Recipe("buoyancy", "buoyancy", "flight", "buoyancy", 0.1, 1.5),
        Recipe("asymmetric_wake", "asymmetric_wake", "flight", "wake_lift", 0.01, 0.3, BOTH),
        Recipe(
            "velocity_dependent_cor", "velocity_dependent_cor", "contact",
            "cor_slope", 0.003, 0.06, (-1, -1, 1),
        ),
        Recipe("effective_mass", "effective_mass", "contact", "arm_error", 0.003, 0.08, BOTH),
        Recipe("oblique_impact", "oblique_impact", "contact", "off_centre", 0.001, 0.03, BOTH),
        Recipe("support_friction", "support_friction", "contact", "support_friction", 0.05, 1.5),
        Recipe(
            "contact_displacement", "contact_displacement", "contact",
            "contact_stretch", 0.02, 0.5, BOTH,
        ),
        Recipe("pivot_recoil", "pivot_recoil", "contact", "pivot_loss", 0.01, 0.3),
        Recipe(
            "pivot_recoil_shared", "pivot_recoil", "contact", "shared_loss", 0.003, 0.1,
        ),
        Recipe("support_recoil", "support_recoil", "contact", "support_loss", 0.003, 0.1),
        Recipe(
            "support_recoil_up", "support_recoil", "contact", "support_kick", 0.003, 0.1, BOTH,
        ),
        Recipe("bearing_friction", "bearing_friction", "swing", "dry_torque", 0.02, 0.8),
        Recipe("viscous_damping", "viscous_damping", "swing", "viscous_torque", 0.01, 0.5),
        Recipe("pendulum_drag", "pendulum_drag", "swing", "quadratic_torque", 0.005, 0.3),
        Recipe("backswing_offset", "backswing_offset", "swing", "backswing", 0.002, 0.07, BOTH),
        Recipe("time_base", "time_base", "measurement", "rate_error", 0.0005, 0.05, BOTH),
        Recipe("length_scale", "length_scale", "measurement", "scale_error", 0.001, 0.06, BOTH),
        Recipe("camera_roll", "camera_roll", "measurement", "roll", 0.001, 0.06, BOTH),
        Recipe("parallax", "parallax", "measurement", "parallax", 0.001, 0.12, BOTH),
        Recipe("lens_distortion", "lens_distortion", "measurement", "lens", 0.002, 0.1, BOTH),
        Recipe("rolling_shutter", "rolling_shutter", "measurement", "readout", 0.0005, 0.012),
        Recipe("origin_offset", "origin_offset", "measurement", "origin", 0.0005, 0.03, BOTH),
        Recipe("dropped_frames", "dropped_frames", "measurement", "gap_frames", 0.1, 6.0),
    )
}  # fmt: skip

UNNAMED: dict[str, Recipe] = {
    recipe.name: recipe
    for recipe in (
        Recipe(
            "power_law", "unnamed", "flight", "power_force", 0.003, 1.0, (1,), ALONG,
            constants={"power": (-0.2, 3.5)},
        ),
        Recipe(
            "magnet", "unnamed", "flight", "magnet_force", 0.02, 5.0, BOTH, EITHER,
            constants={
                "magnet_x": (0.25, 0.9),
                "magnet_y": (0.2, 0.5),
                "magnet_width": (0.05, 0.15),
            },
            local=True,
        ),
        Recipe(
            "gust", "unnamed", "flight", "gust_force", 0.02, 3.0, BOTH, ALONG,
            constants={"gust_start": (0.04, 0.16), "gust_length": (0.03, 0.1)},
            local=True,
        ),
        Recipe(
            "ground_effect", "unnamed", "flight", "ground_force", 0.05, 4.0, BOTH,
            ("vertical", "normal_to_velocity"),
            constants={"ground_height": (0.05, 0.15)},
        ),
        Recipe(
            "notch", "unnamed", "swing", "notch_torque", 0.05, 4.0, BOTH, ("angle",),
            constants={"notch_angle": (-0.45, -0.12), "notch_width": (0.02, 0.08)},
            local=True,
        ),
        Recipe("ageing", "unnamed", "across_trials", "ageing", 0.002, 0.1, BOTH, ()),
    )
}  # fmt: skip

# Effects that the independent simulator is known to conceal.
FOREIGN_KIND = (
    "drag", "magnus", "drag_crisis", "buoyancy", "wind", "oblique_impact", "support_friction",
    "support_recoil", "support_recoil_up", "velocity_dependent_cor", "effective_mass",
    "bearing_friction",
    "viscous_damping", "pendulum_drag", "time_base", "camera_roll", "length_scale",
    "lens_distortion", "rolling_shutter", "dropped_frames",
)  # fmt: skip


def apply(strengths: list[Strength], shots: Shots, progress: Array) -> tuple[Shots, CameraFaults]:
    """Shots and camera with all effects in `strengths`.

    `progress` runs from -0.5 at the first trial to 0.5 at the last: the ball ages with it.
    """
    camera = CameraFaults()
    for strength in strengths:
        recipe, amplitude = strength.recipe, strength.amplitude
        shot_constants = {}
        for name, value in strength.constants.items():
            if name in CAMERA_FIELDS:
                camera = replace(camera, **{name: value})
            else:
                shot_constants[name] = np.full(len(shots), value)
        shots = replace(shots, **shot_constants)
        if recipe.knob in CAMERA_FIELDS:
            camera = replace(camera, **{recipe.knob: amplitude})
        elif recipe.knob == "ageing":
            shots = replace(shots, cor_extra=shots.cor_extra + amplitude * progress)
        else:
            moved = getattr(shots, recipe.knob) + amplitude
            shots = replace(shots, **{recipe.knob: moved})
    return shots, camera
