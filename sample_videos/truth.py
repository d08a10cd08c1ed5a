"""True values of a rendered clip, and its truth file."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.camera import Camera
from metrology import write_text_whole
from physics.bodies import lost_by_pendulum
from sample_videos.bodies import pivot, rest_centre, swing_rotation
from sample_videos.film import Film
from sample_videos.scene import Scene
from sample_videos.shot import Shot

__all__ = ["FrameTruth", "Truth", "film_truth", "truth_path", "write_truth"]

FloatArray = NDArray[np.float64]

FRAME_OF_REFERENCE = (
    "x right from the ball's centre at rest, y up from the floor, z out of the wall, m; pixel"
    " centres are integers, (0, 0) is the top-left one, y down; t = 0 at first touch, frame i is"
    " centred on frames.time_s[i]; px are those of the file, also where mirrored"
)


@dataclass(frozen=True)
class FrameTruth:
    """Per frame of the file, at mid-exposure as its own row sees it. px as in the file.

    Attributes
    ----------
    time : (N,) array
        s from first touch.
    ball_m : (N, 3) array
        Centre, m.
    ball_px : (N, 2) array
        Projection of the centre.
    outline_px : (N, 2) array
        Centroid of the outline of the undeformed sphere.
    radius_px : (N,) array
        Of the outline.
    compression_m : (N,) array
    phi_rad : (N,) array
    mass_px, face_px : (N, 2) array
        Centre of the striking block, and of its face.
    """

    time: FloatArray
    ball_m: FloatArray
    ball_px: FloatArray
    outline_px: FloatArray
    radius_px: FloatArray
    compression_m: FloatArray
    phi_rad: FloatArray
    mass_px: FloatArray
    face_px: FloatArray


@dataclass(frozen=True)
class Truth:
    """True values of a rendered clip.

    Attributes
    ----------
    shot : Shot or None
        None where the motion came from elsewhere.
    quantities : mapping of str to (float or None, str)
        Value and unit by the name that the results use; None where it is out of the picture.
    events : mapping of str to float
        Instants, s from first touch.
    """

    scene: Scene
    shot: Shot | None
    frames: FrameTruth
    quantities: Mapping[str, tuple[float | None, str]]
    events: Mapping[str, float]


def truth_path(clip: Path) -> Path:
    """Path of a clip's truth file: ``a.mp4`` has ``a.truth.json``."""
    return clip.with_name(f"{clip.stem}.truth.json")


def film_truth(film: Film, shot: Shot | None) -> Truth:
    """Truth of all frames that reach the file."""
    frames = _frames(film)
    if shot is None:
        return Truth(film.scene, None, frames, {}, {"contact_start": 0.0})
    events = {
        "contact_start": 0.0,
        "contact_end": shot.contact_time,
        "lift_off": shot.contact.lift_off,
        "landing": shot.landing_time,
    }
    return Truth(film.scene, shot, frames, _quantities(film.scene, shot, frames), events)


def _frames(film: Film) -> FrameTruth:
    scene, kept = film.scene, film.kept()
    half = scene.room.bob_radius or 0.5 * scene.room.block[0]
    block = np.array([scene.pendulum.face_offset - half, 0.0])
    rows = []
    for index in kept:
        camera, times = film.camera(index), film.row_times(index)
        middle = scene.frame_time(index)
        moment = film.motion.at([middle])
        ball_time = mass_time = middle
        if len(times) > 1:
            # the instant at which the row that sees the thing is exposed
            for _ in range(4):
                ball_time = _own_time(camera, film.motion.at([ball_time]).ball[0], times, middle)
                mass = _hanging(scene, film.motion.at([mass_time]).phi[0], block[0])
                mass_time = _own_time(camera, mass, times, middle)
            moment = film.motion.at([ball_time])
        phi = float(film.motion.at([mass_time]).phi[0])
        outline, radius = camera.sphere_outline(moment.ball[0], scene.ball.radius)
        px = camera.project(
            np.stack(
                [
                    moment.ball[0],
                    _hanging(scene, phi, block[0]),
                    _hanging(scene, phi, scene.pendulum.face_offset),
                ]
            )
        )
        seen = _mirrored(np.vstack([px, outline]), scene)
        depth = float(np.linalg.norm(moment.compression[0]))
        rows.append((middle, moment.ball[0], seen, float(radius), depth, phi))
    px = np.array([row[2] for row in rows])
    return FrameTruth(
        time=np.array([row[0] for row in rows]),
        ball_m=np.array([row[1] for row in rows]),
        ball_px=px[:, 0],
        outline_px=px[:, 3],
        radius_px=np.array([row[3] for row in rows]),
        compression_m=np.array([row[4] for row in rows]),
        phi_rad=np.array([row[5] for row in rows]),
        mass_px=px[:, 1],
        face_px=px[:, 2],
    )


def _own_time(camera: Camera, point: FloatArray, times: FloatArray, middle: float) -> float:
    v = float(camera.project(point)[1])
    if not np.isfinite(v):
        return middle
    slope = (times[-1] - times[0]) / (len(times) - 1)
    return float(times[0] + slope * np.clip(v, 0, len(times) - 1))


def _hanging(scene: Scene, phi: float, ahead: float) -> FloatArray:
    """World place of a point of the block, `ahead` of the bar's line at its end, m."""
    own = np.array([ahead, -scene.pendulum.length, 0.0])
    return np.asarray(pivot(scene) + swing_rotation(np.array(phi)) @ own)


def _mirrored(px: FloatArray, scene: Scene) -> FloatArray:
    if not scene.mirrored:
        return px
    return np.asarray([scene.camera.lens.width - 1.0, 0.0] + px * [-1.0, 1.0])


def _quantities(
    scene: Scene, shot: Shot, frames: FrameTruth
) -> dict[str, tuple[float | None, str]]:
    out, ball = shot.contact.outcome, scene.ball
    first = float(frames.time[0])
    touching = (frames.time >= 0.0) & (frames.time <= shot.contact_time)
    landing = shot.flight.landing_position
    rest = rest_centre(scene)
    camera = scene.camera
    in_view = frames.time[-1] >= shot.landing_time and _inside(camera, landing, ball.radius)
    on_wall = camera.to_plane(camera.project(np.stack([rest, landing])), 0.0)
    reach = float(landing[0] - rest[0])
    wall_reach = float(on_wall[1, 0] - on_wall[0, 0])
    speed = float(out.ball_speed)
    before, after = float(out.impact_speed), float(out.pendulum_speed_after)
    return {
        "contact_frames": (float(np.count_nonzero(touching)), "1"),
        "contact_time": (shot.contact_time, "s"),
        "contact_start": (0.0 - first, "s"),
        "contact_end": (shot.contact_time - first, "s"),
        "pendulum_speed_before": (before, "m/s"),
        "pendulum_speed_after": (after, "m/s"),
        "ball_speed": (speed, "m/s"),
        "launch_angle": (float(np.degrees(out.launch_angle)), "deg"),
        "landing_distance": (reach if in_view else None, "m"),
        "landing_distance_on_wall": (wall_reach if in_view else None, "m"),
        "landing_time": (shot.landing_time if in_view else None, "s"),
        "cor_speeds": (float(out.cor), "1"),
        "cor_launch": (float(out.cor), "1"),
        "cor_range": (float(out.cor) if in_view else None, "1"),
        "external_impulse": (ball.mass * speed, "N s"),
        "energy_loss": (float(lost_by_pendulum(scene.pendulum, before, after)), "J"),
        "backswing_angle": (float(np.degrees(shot.physics.backswing)), "deg"),
        "ball_plane_offset": (scene.room.plane, "m"),
        "camera_distance": (float(camera.position[2]), "m"),
    }


def _inside(camera: Camera, centre: FloatArray, radius: float) -> bool:
    outline, size = camera.sphere_outline(centre, radius)
    lens = camera.lens
    low, high = outline - size, outline + size
    return bool(np.all(low >= 0) and high[0] <= lens.width - 1 and high[1] <= lens.height - 1)


def write_truth(truth: Truth, clip: Path) -> Path:
    """Write the truth file next to a clip; return its path."""
    path = truth_path(clip)
    write_text_whole(path, json.dumps(_plain(truth), indent=1) + "\n")
    return path


def _plain(truth: Truth) -> dict[str, Any]:
    scene, frames = truth.scene, truth.frames
    camera, lens = scene.camera, scene.camera.lens
    described: dict[str, Any] = {
        "frame_of_reference": FRAME_OF_REFERENCE,
        "quantities": {
            name: {"value": value, "unit": unit} for name, (value, unit) in truth.quantities.items()
        },
        "events_s": dict(truth.events),
        "seed": scene.seed,
        "mirrored": scene.mirrored,
        "camera": {
            **{k: getattr(lens, k) for k in ("width", "height", "fx", "fy", "cx", "cy")},
            **{k: getattr(lens, k) for k in ("k1", "k2", "p1", "p2", "k3")},
            "rotation_world_to_camera": camera.rotation.tolist(),
            "position_m": camera.position.tolist(),
        },
        "pivot_m": pivot(scene).tolist(),
        "wall": asdict(scene.room.wall),
        "lighting": asdict(scene.room.lighting),
        "shutter": asdict(scene.shutter),
        "sensor": asdict(scene.sensor),
        "shake": asdict(scene.shake),
        "encoding": asdict(scene.encoding),
        "bodies": {
            "ball": {
                "name": scene.ball.name,
                "mass": scene.ball.mass,
                "diameter": scene.ball.diameter,
            },
            "pendulum": asdict(scene.pendulum),
            "support": asdict(scene.support),
            "contact_angle_rad": scene.contact_angle,
        },
    }
    if truth.shot is not None:
        described["physics"] = _physics(scene, truth.shot)
    described["frames"] = {
        "time_s": _rounded(frames.time, 9),
        "ball_m": _rounded(frames.ball_m, 7),
        "ball_px": _rounded(frames.ball_px, 5),
        "outline_px": _rounded(frames.outline_px, 5),
        "radius_px": _rounded(frames.radius_px, 5),
        "compression_m": _rounded(frames.compression_m, 7),
        "phi_rad": _rounded(frames.phi_rad, 7),
        "mass_px": _rounded(frames.mass_px, 5),
        "face_px": _rounded(frames.face_px, 5),
    }
    return described


def _rounded(values: FloatArray, digits: int) -> list[Any]:
    shown = np.round(values, digits)
    return [None if not np.all(np.isfinite(row)) else row.tolist() for row in np.asarray(shown)]


def _dissipated(scene: Scene, shot: Shot) -> float:
    """Energy that neither body has after the contact, J: less than what the pendulum loses."""
    out, ball, body, g = shot.contact.outcome, scene.ball, scene.pendulum, shot.physics.gravity
    lost = lost_by_pendulum(body, out.impact_speed, out.pendulum_speed_after)
    spin = 0.5 * ball.inertia_factor * ball.mass * (ball.radius * float(out.ball_spin)) ** 2
    lifted = body.mass * body.com * (np.cos(scene.contact_angle) - np.cos(out.pendulum_angle))
    lifted += ball.mass * (out.ball_y - rest_centre(scene)[1])
    return float(lost - 0.5 * ball.mass * out.ball_speed**2 - spin - g * lifted)


def _physics(scene: Scene, shot: Shot) -> dict[str, Any]:
    physics, out = shot.physics, shot.contact.outcome
    return {
        "backswing_deg": float(np.degrees(physics.backswing)),
        "gravity": physics.gravity,
        "air_density": physics.air.density,
        "air_viscosity": physics.air.viscosity,
        "drag_coefficient": (
            physics.drag_coefficient
            if isinstance(physics.drag_coefficient, float)
            else repr(physics.drag_coefficient)
        ),
        "lift_coefficient": physics.lift_coefficient,
        "face_friction": physics.face_friction,
        "further_forces": sum(term.flies for term in physics.effects),
        "spin_at_release": float(out.ball_spin),
        "release_m": [float(out.ball_x), float(out.ball_y)],
        "release_velocity": [float(out.ball_vx), float(out.ball_vy)],
        "pendulum_angle_at_release": float(out.pendulum_angle),
        "landing_m": shot.flight.landing_position.tolist(),
        "landing_velocity": shot.flight.landing_velocity.tolist(),
        "greatest_compression_m": float(shot.contact.compression.max()),
        "energy_dissipated": _dissipated(scene, shot),
    }
