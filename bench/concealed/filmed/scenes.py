"""The filmed campaigns: concealed effects, scenes and setup files."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calib.camera import rotation_matrix
from physics.bodies import BALLS, PAPER_PENDULUM
from physics.effects import Term, effect_named
from physics.swing import frictionless_speed
from sample_videos.scene import BallLook, Scene
from sample_videos.shot import Physics, Shot, default_scene, staged

__all__ = ["FILMED", "Filmed", "Take", "setup_text", "takes"]

FILMED_BACKSWINGS_DEG = (45.0, 60.0, 75.0, 90.0) * 2
FILMED_SIZE = (432, 240)
FILMED_REACH = 1.95
DRAG = 0.47
STATED_FPS = 600.0
SHOT_BALL = BALLS["jokku"]
SCATTER_DEG, COR_SCATTER = 0.2, 0.005
TAPE_STD = 0.003


@dataclass(frozen=True)
class Filmed:
    """One campaign on film.

    Attributes
    ----------
    name : str
    id : str
        Effect the engine should name; "" for none.
    description : str
        What is concealed.
    effects : mapping
        Effects of flight and swing with their parameters, unknown to the laboratory.
    fps : float
        True capture rate; the setup file gives 600.
    roll : float
        Of the camera, rad.
    grid : bool
        Whether there is a wall grid and the camera's position was measured.
    look
        Surface of the ball: patches that show its spin, or plain.
    """

    name: str
    id: str
    description: str
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fps: float = STATED_FPS
    roll: float = 0.0
    grid: bool = True
    look: Literal["jokku", "plain"] = "jokku"


FILMED = (
    Filmed("none", "", "nothing"),
    Filmed(
        "spin", "magnus", "back-spin of 15 rad/s on a plain ball",
        effects={"magnus": {"spin": 15.0}}, look="plain",
    ),
    Filmed("rate", "time_base", "590 instead of 600 frames a second", fps=590.0),
    Filmed(
        "tilt", "camera_roll", "a camera tilted by 1.5 degrees, no grid",
        roll=np.radians(1.5), grid=False,
    ),
    Filmed(
        "draught", "wind", "a wind of 2 m/s against the ball",
        effects={"wind": {"wind_x": -2.0}},
    ),
    Filmed("bearing", "bearing_friction", "a dry bearing of 0.8 N m",
           effects={"bearing_friction": {"dry_torque": 0.8}}),
    Filmed("topspin", "magnus", "top-spin of 12 rad/s", effects={"magnus": {"spin": -12.0}}),
    Filmed("seam", "asymmetric_wake", "an asymmetric wake with lift, C_S = 0.12",
           effects={"asymmetric_wake": {"side_coefficient": 0.12}}),
    Filmed(
        "crisis", "drag_crisis", "a drag that falls by 0.25 about a Reynolds number of 50,000",
        effects={"drag_crisis": {"coefficient_drop": 0.25, "critical_reynolds": 5e4, "width": 0.1}},
    ),
    Filmed("faster", "time_base", "612 instead of 600 frames a second", fps=612.0),
    Filmed(
        "following", "wind", "a wind of 1.5 m/s with a plain ball",
        effects={"wind": {"wind_x": 1.5}}, look="plain",
    ),
    Filmed("none_plain", "", "nothing, plain ball", look="plain"),
    Filmed("level", "", "nothing, no grid", grid=False),
    Filmed(
        "headwind", "wind", "a wind of 2 m/s against the ball, no grid",
        effects={"wind": {"wind_x": -2.0}}, grid=False,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Take:
    """One clip to be rendered."""

    name: str
    backswing_deg: float
    scene: Scene
    shot: Shot


def _scene(filmed: Filmed) -> Scene:
    scene = default_scene(ball=SHOT_BALL, size=FILMED_SIZE, reach=FILMED_REACH, seed=17)
    wall = scene.room.wall
    camera = scene.camera
    if not filmed.grid:
        wall = replace(wall, contrast=0.0, fine_contrast=0.0)
    if filmed.roll:
        turn = rotation_matrix([0.0, 0.0, -filmed.roll])
        camera = replace(camera, rotation=turn @ camera.rotation)
    return replace(
        scene,
        camera=camera,
        look=BallLook(filmed.look),
        room=replace(scene.room, wall=wall),
        shutter=replace(scene.shutter, fps=filmed.fps),
        encoding=replace(scene.encoding, rate_factor=16.0),
    )


def takes(filmed: Filmed, seed: int = 1) -> list[Callable[[], Take]]:
    """The clips of a campaign, each drawn on demand."""

    def take(number: int) -> Take:
        rng = np.random.default_rng([seed, FILMED.index(filmed), number])
        nominal = FILMED_BACKSWINGS_DEG[number]
        scene = replace(_scene(filmed), seed=100 * seed + number)
        scene = replace(
            scene,
            launch_angle=SHOT_BALL.launch_angle + np.radians(rng.normal(0.0, SCATTER_DEG)),
        )
        backswing = nominal + rng.normal(0.0, SCATTER_DEG)
        speed = float(
            frictionless_speed(PAPER_PENDULUM, np.radians(backswing), SHOT_BALL.launch_angle, 9.806)
        )
        physics = Physics(
            0.0,
            drag_coefficient=DRAG,
            cor=float(np.asarray(SHOT_BALL.cor(np.array(speed)))) + rng.normal(0.0, COR_SCATTER),
            effects=tuple(Term(effect_named(n), dict(v)) for n, v in filmed.effects.items()),
        )
        scene, shot = staged(backswing, scene, physics=physics, after=6)
        return Take(f"{filmed.name}_{number + 1}", nominal, scene, shot)

    return [lambda k=k: take(k) for k in range(len(FILMED_BACKSWINGS_DEG))]  # type: ignore[misc]


def setup_text(filmed: Filmed) -> str:
    """Setup file of a campaign: measured distances, ball, pendulum."""
    rng = np.random.default_rng([31, FILMED.index(filmed)])
    scene = _scene(filmed)
    foot = scene.camera.axis_foot
    lengths = [scene.camera.position[2], foot[0], foot[1], scene.room.plane]
    far, x, y, plane = (f"{v + rng.normal(0, TAPE_STD):.3f} +- 0.005 m" for v in lengths)
    body = scene.pendulum
    wall = f"""
[wall]
grid = "50 mm"
fine_grid = "10 mm"
ball_plane_offset = "{plane}"
"""
    tape = f'''distance_to_wall = "{far}"
principal_point_on_wall = ["{x}", "{y}"]
'''
    return f"""[camera]
capture_fps = {STATED_FPS:g}
shutter = "{scene.shutter.exposure:g} s"
{tape if filmed.grid else ""}{wall if filmed.grid else ""}
[pendulum]
length = "{body.length} m"
inertia = "{body.inertia} kg m^2"
mass = "{body.mass} kg"
com = "{body.com} m"

[support]
height = "{scene.support.height} m"

[scatter]
backswing = "{SCATTER_DEG} deg"
launch_angle = "{SCATTER_DEG} deg"
cor = {COR_SCATTER}
cor_law = 0.01
launch_angle_law = "0.3 deg"

[ball]
preset = "{SHOT_BALL.name}"

[model]
effects = ["gravity", "drag"]

[model.drag]
drag_coefficient = {DRAG}
"""
