"""Load clips with their true quantities for the measurement benchmarks."""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.measure.chain import MeasureOptions
from pipelines.setup.file import load_setup, rig_of
from pipelines.setup.tables import BallSetup, CameraSetup, Measured, Setup, WallSetup

FloatArray = NDArray[np.float64]
SHIPPED = Path(__file__).parents[1] / "sample_videos" / "clips"
DRAWN = ("ball.mass", "ball.diameter", "pendulum.", "support.", "wall.grid")


@dataclass(frozen=True)
class Case:
    """A clip with its true quantities, the ball's centre in flight and the measuring options.

    `phi_rad` is the pendulum's true angle in every frame.
    """

    name: str
    path: Path
    options: MeasureOptions
    fps: float
    truth: dict[str, float]
    centre_px: FloatArray
    phi_rad: FloatArray


def cases(*folders: Path) -> list[Case]:
    """The ray-traced clips in the folders, and the shipped clips."""
    truths = [path for folder in folders for path in sorted(folder.glob("*/truth.json"))]
    return [
        *(ray_traced(path.parent) for path in truths),
        *(shipped(path) for path in sorted(SHIPPED.glob("*.truth.json"))),
    ]


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
    rows = truth["frames"]
    time_s = np.array(rows["t_mid"])
    return Case(
        name=folder.name,
        path=folder / "clip.mp4",
        options=MeasureOptions(setup=setup, ball=truth["ball"]),
        fps=truth["fps_true"],
        truth=true_quantities(truth, lab),
        centre_px=in_flight(
            np.c_[rows["u_px"], rows["v_px"]],
            np.array(rows["r_px"]),
            time_s,
            (truth["contact"]["t_off_s"], truth["flight"]["t_land_s"]),
            (truth["camera"]["W"], truth["camera"]["H"]),
        ),
        phi_rad=np.array(rows["phi_rad"], dtype=np.float64),
    )


def as_written_down(case: Case, rng: np.random.Generator) -> Case:
    """The same clip with every given or assumed number displaced by a draw of its std."""
    known = case.options.setup
    camera, wall = known.camera, known.wall
    ball = known.ball if case.options.ball is None else BallSetup.preset(case.options.ball)
    drawn: dict[str, str] = {} if ball is None else {"ball.preset": ball.name}
    for number in rig_of(known, ball).numbers:
        if number.key.startswith(DRAWN):
            drawn[number.key] = f"{number.value + number.std * rng.normal():.9g} {number.unit}"

    def displaced(pair: Measured | None) -> Measured | None:
        return None if pair is None else (pair[0] + pair[1] * rng.normal(), pair[1])

    foot = camera.principal_point_on_wall
    if foot is not None:
        foot = tuple((value + std * rng.normal(), std) for value, std in foot)
    distance, plane = displaced(camera.distance_to_wall), displaced(wall.ball_plane_offset)
    setup = known.having(drawn)
    setup = replace(
        setup,
        camera=replace(setup.camera, distance_to_wall=distance, principal_point_on_wall=foot),
        wall=replace(setup.wall, ball_plane_offset=plane),
    )
    return replace(case, options=replace(case.options, setup=setup, ball=None))


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
    rows, events, camera = truth["frames"], truth["events_s"], truth["camera"]
    return Case(
        name=called,
        path=truth_path.with_name(f"{name}.mp4"),
        options=options,
        fps=truth["shutter"]["fps"],
        truth=known,
        centre_px=in_flight(
            np.array(rows["ball_px"]),
            np.array(rows["radius_px"]),
            np.array(rows["time_s"]),
            (events["contact_end"], events["landing"]),
            (camera["width"], camera["height"]),
        ),
        phi_rad=np.array(rows["phi_rad"], dtype=np.float64),
    )


def in_flight(
    centre: FloatArray,
    radius: FloatArray,
    time_s: FloatArray,
    flight_s: tuple[float, float],
    size: tuple[int, int],
) -> FloatArray:
    """The projected centres; NaN unless the ball is in flight and entirely in view."""
    margin = radius[:, None] + 2.0
    seen = ((centre > margin) & (centre < np.array(size) - 1.0 - margin)).all(axis=1)
    flying = (time_s > flight_s[0]) & (time_s < flight_s[1])
    return np.where((seen & flying)[:, None], centre, np.nan)
