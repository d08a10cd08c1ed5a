"""Convert a concealed amplitude to the catalogue's parameter."""

from collections.abc import Callable, Mapping
from typing import Any

from bench.concealed.campaign import Hidden
from bench.concealed.world.camera import LENS_RADIUS, VIEW_HEIGHT

__all__ = ["true_parameter"]


def _plain(hidden: Hidden, setup: Mapping[str, Any]) -> float:
    return hidden.amplitude


def _drag(hidden: Hidden, setup: Mapping[str, Any]) -> float:
    known = setup.get("model", {}).get("drag", {}).get("drag_coefficient", 0.0)
    return float(known) + hidden.amplitude


def _above_centre(hidden: Hidden, setup: Mapping[str, Any]) -> float:
    # A contact below the ball's centre launches it upwards, which is positive here.
    return -hidden.amplitude


def _gap(hidden: Hidden, setup: Mapping[str, Any]) -> float:
    return hidden.amplitude / float(setup["camera"]["capture_fps"])


# Recipes whose law differs from the catalogue's have no comparable parameter.
LAB_PARAMETERS: dict[str, tuple[str, Callable[[Hidden, Mapping[str, Any]], float]]] = {
    "drag": ("drag_coefficient", _drag),
    "drag_crisis": ("coefficient_drop", _plain),
    "magnus": ("spin", _plain),
    "wind": ("wind_x", _plain),
    "buoyancy": ("fraction", _plain),
    "asymmetric_wake": ("side_coefficient", _plain),
    "velocity_dependent_cor": ("slope", _plain),
    "oblique_impact": ("offset", _above_centre),
    "support_friction": ("friction_coefficient", _plain),
    "pivot_recoil_shared": ("lost_share", _plain),
    "support_recoil_up": ("vertical_share", _plain),
    "bearing_friction": ("dry_torque", _plain),
    "viscous_damping": ("viscous_coefficient", _plain),
    "pendulum_drag": ("drag_torque", _plain),
    "backswing_offset": ("offset", _plain),
    "time_base": ("rate_error", _plain),
    "length_scale": ("scale_error", _plain),
    "camera_roll": ("roll", _plain),
    "parallax": ("plane_error", _plain),
    "lens_distortion": ("radial", lambda hidden, _: hidden.amplitude / LENS_RADIUS**2),
    "rolling_shutter": ("delay", lambda hidden, _: hidden.amplitude / VIEW_HEIGHT),
    "dropped_frames": ("gap", _gap),
}


def true_parameter(hidden: Hidden, setup: Mapping[str, Any]) -> tuple[str, float] | None:
    """Name and true value of the catalogue parameter for a concealed amplitude."""
    entry = LAB_PARAMETERS.get(hidden.name)
    if entry is None:
        return None
    name, convert = entry
    return name, convert(hidden, setup)
