"""Load clips with their true quantities and the options of measuring them."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from measuring.chain import MeasureOptions
from measuring.setup.file import load_setup
from measuring.setup.tables import CameraSetup, Setup, WallSetup

SHIPPED = Path(__file__).parents[1] / "sample_videos" / "clips"


@dataclass(frozen=True)
class Case:
    """A clip with its true capture rate and quantities, and the measuring options."""

    name: str
    path: Path
    options: MeasureOptions
    fps: float
    truth: dict[str, float]


def ray_traced(folder: Path) -> Case:
    """A clip of the independent renderer, whose truth file uses other names."""
    truth = json.loads((folder / "truth.json").read_text())
    lab = json.loads((folder / "setup.json").read_text())
    tape = lab["tape_uncertainty_m"]
    setup = Setup(
        camera=CameraSetup(float(lab["camera_nominal_fps"]), (lab["camera_to_wall_m"], tape)),
        wall=WallSetup(
            lab["grid_pitch_m"], lab["gradations_m"], (lab["ball_plane_to_wall_m"], tape)
        ),
    )
    return Case(
        name=folder.name,
        path=folder / "clip.mp4",
        options=MeasureOptions(setup=setup, ball=truth["ball"]),
        fps=truth["fps_true"],
        truth=true_quantities(truth, lab),
    )


def true_quantities(truth: dict[str, Any], lab: dict[str, Any]) -> dict[str, float]:
    """Quantities by their names in results; start and end of contact count from the first frame."""
    contact, flight = truth["contact"], truth["flight"]
    started = contact["frame_on"] / truth["fps_true"]
    inertia = lab["pendulum"]["inertia_kg_m2"]
    return {
        "contact_frames": contact["frames_in_contact_at_mid_exposure"],
        "contact_time": contact["dt_s"],
        "contact_start": started,
        "contact_end": started + contact["dt_s"],
        "pendulum_speed_before": truth["v_M0"],
        "pendulum_speed_after": truth["v_M"],
        "ball_speed": truth["v_B_speed"],
        "launch_angle": truth["launch_deg"],
        "landing_distance": flight["x_land_m"],
        "landing_distance_on_wall": truth["apparent_wall"]["displacement_x"],
        "landing_time": flight["t_land_s"],
        **dict.fromkeys(("cor_speeds", "cor_launch", "cor_range", "cor"), truth["COR"]),
        "external_impulse": lab["ball"]["mass_kg"] * truth["v_B_speed"],
        "energy_loss": 0.5 * inertia * (truth["omega0"] ** 2 - truth["omega1"] ** 2),
        "backswing_angle": truth["backswing_deg_true"],
        "ball_plane_offset": abs(truth["ball_plane_z"]),
        "camera_distance": abs(truth["camera"]["location"][2]),
        "gravity_check": flight["g"],
    }


def shipped(truth_path: Path) -> Case:
    """A shipped clip."""
    name = truth_path.name.removesuffix(".truth.json")
    lab = load_setup(truth_path.with_name(f"{name}.toml"))
    return rendered(truth_path, f"{name} (shipped)", MeasureOptions(setup=lab))


def rendered(truth_path: Path, called: str, options: MeasureOptions) -> Case:
    """A clip of this project's renderer, measured with the given options."""
    truth = json.loads(truth_path.read_text())
    name = truth_path.name.removesuffix(".truth.json")
    quantities = {key: line["value"] for key, line in truth["quantities"].items()}
    known = {key: float(value) for key, value in quantities.items() if value is not None}
    known |= {"cor": known["cor_speeds"], "gravity_check": truth["physics"]["gravity"]}
    return Case(
        name=called,
        path=truth_path.with_name(f"{name}.mp4"),
        options=options,
        fps=truth["shutter"]["fps"],
        truth=known,
    )
