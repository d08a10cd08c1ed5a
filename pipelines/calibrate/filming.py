"""A recording that is only planned: its scene, and what following it would give."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.camera.lens_fit import LensPrior
from calib.planning import (
    BALL_ERROR_PX,
    MASS_ERROR_PX,
    PictureNoise,
    edge_std,
    lens_of_view,
)
from physics.bodies import JOKKU, PAPER_PENDULUM, PAPER_SUPPORT, Ball, Pendulum, Support
from sample_videos.presets import default_scene, staged
from sample_videos.renderer.bodies import pivot, swing_rotation
from sample_videos.scene import Scene, Sensor
from sample_videos.shot import Shot
from vision.tracks import Face, Motion, MotionKind, PendulumTrack, Track, Tracks

__all__ = ["Filming", "film_scene", "planned_tracks"]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BEFORE_S = 0.084
"""s before contact where a planned clip begins: 50 frames at 600 fps, a swing fit's stretch."""
FACE_STD_PX = 0.2
"""px, of an edge of the face as following finds it, supposed."""
_EDGE = 1.0


@dataclass(frozen=True)
class Filming:
    """How a stroke will be filmed.

    Attributes
    ----------
    ball : Ball
    backswing_deg : float
    width, height : int
        px.
    fps : float
        Capture rate, 1/s.
    exposure_s : float
        Shutter.
    distance_m : float
        Camera to wall.
    plane_m : float
        Ball plane in front of the wall.
    view_rad : float or None
        Horizontal angle of view; None for one that just holds pendulum and landing.
    light : float
        1 where the wall is well exposed at 1/1000 s without any gain.
    gray_std : float or None
        Noise of the picture in gray levels of 255, instead of `light`.
    tape_std_m : float or None
        Standard uncertainty of the taped distances; None where nothing is taped.
    lens : LensPrior or None
        A lens known beforehand; its view holds, and its picture has `width` and `height`.
    pendulum : Pendulum
    support : Support
    seed : int
        Draws the small turns of a camera placed by eye, and the noise where it is rendered.
    """

    ball: Ball = JOKKU
    backswing_deg: float = 90.0
    width: int = 640
    height: int = 360
    fps: float = 600.0
    exposure_s: float = 1e-3
    distance_m: float = 4.0
    plane_m: float = 0.45
    view_rad: float | None = None
    light: float = 1.0
    gray_std: float | None = None
    tape_std_m: float | None = 0.005
    lens: LensPrior | None = None
    pendulum: Pendulum = PAPER_PENDULUM
    support: Support = PAPER_SUPPORT
    seed: int = 1

    @property
    def noise(self) -> PictureNoise:
        """Of the picture."""
        by_light = PictureNoise.by_light(self.light, self.exposure_s)
        return by_light if self.gray_std is None else replace(by_light, gray_std=self.gray_std)


def film_scene(filming: Filming) -> tuple[Scene, Shot]:
    """The scene as the camera will see it, and the stroke.

    Raises
    ------
    DomainError, UsageError
        If the stroke can't happen, or can't be filmed like that.
    """

    def scene_reaching(reach: float) -> Scene:
        scene = default_scene(
            ball=filming.ball,
            size=(filming.width, filming.height),
            reach=reach,
            distance=filming.distance_m,
            plane=filming.plane_m,
            pendulum=filming.pendulum,
            support=filming.support,
            seed=filming.seed,
        )
        first = -(math.floor(BEFORE_S * filming.fps) + 0.37) / filming.fps
        shutter = replace(scene.shutter, fps=filming.fps, exposure=filming.exposure_s, first=first)
        return replace(scene, shutter=shutter, sensor=_sensor(filming))

    _, shot = staged(filming.backswing_deg, scene_reaching(2.0))
    scene = scene_reaching(float(shot.flight.landing_position[0]))
    camera = scene.camera
    if filming.lens is not None:
        scene = replace(scene, camera=replace(camera, lens=filming.lens.lens))
    elif filming.view_rad is not None:
        lens = lens_of_view(filming.width, filming.height, filming.view_rad)
        scene = replace(scene, camera=replace(camera, lens=replace(lens, k1=camera.lens.k1)))
    return staged(filming.backswing_deg, scene, after=max(4, int(0.02 * filming.fps)))


def _sensor(filming: Filming) -> Sensor:
    """A sensor with that noise: gain on little light is a well that is full sooner."""
    usual = Sensor()
    if filming.gray_std is None:
        share = min(filming.light * filming.exposure_s / 1e-3, 1.0)
        return replace(usual, full_well=usual.full_well * share)
    low, high = 1e-4, 1e3
    for _ in range(60):
        share = math.sqrt(low * high)
        noisier = PictureNoise.by_light(share, 1e-3).gray_std > filming.gray_std
        low, high = (share, high) if noisier else (low, share)
    return replace(usual, full_well=usual.full_well * low)


def planned_tracks(filming: Filming, scene: Scene, shot: Shot) -> Tracks:
    """What following the clip will give: true places, and the uncertainty they will carry."""
    shutter, camera = scene.shutter, scene.camera
    time = shutter.first + np.arange(scene.frames) / shutter.fps
    moment = shot.motion.at(time)
    centre, radius = camera.sphere_outline(moment.ball, scene.ball.radius)
    ball = _track(filming, shutter.fps, centre, radius, BALL_ERROR_PX)
    ball = ball.where(_inside(ball, camera.lens.width, camera.lens.height))
    resting = np.flatnonzero(time < 0.0)
    rest = None if len(resting) == 0 else (0, int(resting[-1]))
    return Tracks(
        ball=ball,
        pendulum=_pendulum(filming, scene, moment.phi, len(resting)),
        background=np.zeros((camera.lens.height, camera.lens.width), dtype=np.float32),
        rest_frames=rest,
        motion=Motion(MotionKind.STRIKE, 1.0),
    )


def _track(
    filming: Filming, fps: float, centre: FloatArray, radius: FloatArray, own: float
) -> Track:
    way = np.hypot(*np.gradient(centre, axis=0).T) * fps * filming.exposure_s
    std = edge_std(filming.noise, radius, way, own)
    bound = edge_std(filming.noise, radius, way, 0.0)
    plane = np.eye(2)
    return Track(
        frame=np.arange(len(centre)),
        time_s=np.arange(len(centre)) / fps,
        centre_px=centre,
        covariance_px2=std[:, None, None] ** 2 * plane,
        bound_px2=bound[:, None, None] ** 2 * plane,
        radius_px=radius,
        radius_std_px=std,
        quality=np.ones(len(centre)),
    )


def _inside(track: Track, width: int, height: int) -> BoolArray:
    """Rows in which the whole outline is in the picture."""
    margin = track.radius_px[:, np.newaxis] + _EDGE
    within = (track.centre_px > margin) & (track.centre_px < [width, height] - margin)
    return np.asarray(within.all(axis=1))


def _pendulum(
    filming: Filming, scene: Scene, phi: FloatArray, touching: int
) -> PendulumTrack | None:
    """The striking mass on its arc, as far as it is in the picture; None if it never is."""
    camera, body, block = scene.camera, scene.pendulum, scene.room.block
    hub = pivot(scene)
    hanging = np.array([body.face_offset - 0.5 * block[0], -body.length, 0.0])
    centre = camera.project(hub + swing_rotation(phi) @ hanging)
    scale = camera.lens.fx / (camera.position[2] - scene.room.plane)
    size = np.full(len(phi), 0.5 * math.sqrt(block[0] * block[1]) * scale)
    track = _track(filming, scene.shutter.fps, centre, size, MASS_ERROR_PX)
    track = track.where(_inside(track, camera.lens.width, camera.lens.height))
    if len(track) == 0:
        return None
    hub_px = camera.project(hub)
    offset = track.centre_px - hub_px
    arm = float(np.median(np.hypot(*offset.T)))
    std = np.sqrt(track.covariance_px2[:, 0, 0])
    return PendulumTrack(
        track=track,
        angle_rad=np.arctan2(offset[:, 0], offset[:, 1]),
        angle_std_rad=std / arm,
        pivot_px=hub_px,
        pivot_covariance_px2=0.04 * np.eye(2),
        arm_px=arm,
        face=_face(scene, hub, phi, int(track.frame[track.frame <= touching].max(initial=0))),
    )


def _face(scene: Scene, hub: FloatArray, phi: FloatArray, frame: int) -> Face:
    """The face in a frame: its middle, and its rim that stands out."""
    body, half = scene.pendulum, 0.5 * scene.room.block[2]
    turn = swing_rotation(phi[frame])
    middle, near, far = (
        scene.camera.project(hub + turn @ np.array([body.face_offset, -body.length, depth]))
        for depth in (0.0, half, -half)
    )
    if near[0] > far[0]:
        return Face(frame, near, FACE_STD_PX)
    return Face(frame, far, FACE_STD_PX, middle, FACE_STD_PX)
