"""Rendered frames measured by simple methods and compared with their truth."""

import math
from dataclasses import replace
from functools import lru_cache
from itertools import islice

import numpy as np
import pytest

from metrology import UsageError
from physics.bodies import BALLS
from sample_videos import (
    BallLook,
    HermiteCurve,
    Lighting,
    LooseBall,
    Piece,
    Room,
    SampledMotion,
    Scene,
    Sensor,
    Shake,
    Shot,
    Shutter,
    SwingingScale,
    Wall,
    default_scene,
    render_frames,
    strike,
)
from sample_videos.film import Film
from sample_videos.shot import BALL_LOOKS, Physics
from sample_videos.truth import film_truth

CLEAN = Sensor(full_well=0.0, blur=0.0, vignetting=0.0, gamma=1.0)
STEADY = Lighting(lamps=(), ambient=(0.3, 0.3, 0.3), unevenness=0.0, flicker=0.0)


@lru_cache
def stroke(ball: str = "jokku", backswing: float = 90.0) -> Shot:
    scene = default_scene(ball=BALLS[ball])
    return strike(scene, Physics(math.radians(backswing), face_friction=0.08))


def bare(scene: Scene) -> Scene:
    """Only a ball, white and evenly lit, in front of a black wall and floor."""
    black = Wall(contrast=0.0, fine_contrast=0.0, colour=(0.0, 0.0, 0.0))
    room = Room(
        wall=black,
        lighting=STEADY,
        floor_colour=(0.0, 0.0, 0.0),
        show_rig=False,
        show_support=False,
    )
    look = BallLook("plain", (1.0, 1.0, 1.0), gloss=0.0, bulge=0.0)
    return replace(scene, room=room, look=look, sensor=CLEAN)


def moving(velocity: tuple[float, float], at: tuple[float, float]) -> SampledMotion:
    rate = np.array([[*velocity, 0.0]] * 2)
    place = np.array([[*at, 0.45]] * 2) + [[-1.0], [1.0]] * rate
    return SampledMotion(
        HermiteCurve((Piece(np.array([-1.0, 1.0]), place, rate),)),
        HermiteCurve.constant([0.0]),
        HermiteCurve.constant([0.0, 0.0, 0.0]),
        HermiteCurve.constant([0.0]),
        np.array([0.0, 0.0, 1.0]),
        np.eye(3),
    )


def edges(row: np.ndarray) -> tuple[float, float]:
    """Where a row of coverage rises to and falls from 1, by area."""
    middle = int((np.arange(len(row)) * row).sum() / row.sum())
    left = middle + 0.5 - row[: middle + 1].sum()
    right = middle + 0.5 + row[middle + 1 :].sum()
    return left, right


def centroid(cover: np.ndarray) -> np.ndarray:
    v, u = np.indices(cover.shape)
    return np.array([(cover * u).sum(), (cover * v).sum()]) / cover.sum()


def test_a_seed_gives_the_same_clip_and_another_seed_another() -> None:
    scene = replace(default_scene(size=(96, 54)), frames=2)
    one, two = (next(render_frames(scene, stroke())[0]) for _ in range(2))
    other = next(render_frames(replace(scene, seed=2), stroke())[0])
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("k1", [0.0, -0.2])
def test_a_ball_in_flight_is_rendered_at_its_true_position(k1: float) -> None:
    scene = default_scene(size=(216, 120))
    lens = replace(scene.camera.lens, k1=k1)
    scene = bare(replace(scene, camera=replace(scene.camera, lens=lens), frames=220))
    film = Film(scene, stroke().motion)
    truth = film_truth(film, stroke()).frames
    for frame in (10, 90, 150, 210):
        assert centroid(film.ball_coverage(frame)) == pytest.approx(
            truth.outline_px[frame], abs=0.005
        )


def test_motion_blur_is_centred_on_mid_exposure() -> None:
    scene = bare(default_scene(size=(216, 120)))
    scene = replace(
        scene,
        frames=1,
        shutter=Shutter(fps=60, exposure=1 / 60, first=0.0),
        encoding=scene.encoding,
    )
    film = Film(scene, moving((4.0, 0.0), (1.0, 0.5)))
    row = film.ball_coverage(0)[round(film_truth(film, None).frames.ball_px[0, 1])]
    ends = film.camera(0).project([[1.0 - 4 / 120, 0.5, 0.45], [1.0 + 4 / 120, 0.5, 0.45]])
    way = ends[1, 0] - ends[0, 0]
    rising = np.diff(row[: len(row) // 2 + 20])
    assert np.count_nonzero(rising > 0.02) >= way - 1
    truth = film_truth(film, None).frames.outline_px[0]
    assert centroid(film.ball_coverage(0)) == pytest.approx(truth, abs=0.01)


def test_a_rolling_shutter_sees_lower_rows_later() -> None:
    scene = bare(default_scene(size=(216, 120)))
    shutter = Shutter(fps=100, exposure=1 / 5000, readout=0.01, first=0.0)
    centres = {}
    for readout in (0.0, 0.01):
        timed = replace(shutter, readout=readout)
        film = Film(replace(scene, frames=1, shutter=timed), moving((5.0, 0.0), (1.0, 0.5)))
        truth = film_truth(film, None).frames
        picture = film.ball_coverage(0)
        assert centroid(picture) == pytest.approx(truth.outline_px[0], abs=0.02)
        rows = round(truth.outline_px[0, 1]) + np.array([-5, 5])
        centres[readout] = [np.mean(edges(picture[row])) for row in rows]
    slant = np.diff(centres[0.01]) - np.diff(centres[0.0])
    speed_px = 5.0 * scene.camera.lens.fx / (scene.camera.position[2] - 0.45)
    assert slant[0] / 10 == pytest.approx(speed_px * 0.01 / 119, rel=0.05)


def test_a_compressed_ball_ends_at_the_face() -> None:
    scene = bare(default_scene(size=(432, 240), view="impact"))
    free, push = moving((0.0, 0.0), (0.0, 0.4)), 0.02
    pressed = replace(free, compression=HermiteCurve.constant([-push, 0.0, 0.0]))
    found = []
    for motion in (free, pressed):
        film = Film(replace(scene, frames=1), motion)
        truth = film_truth(film, None).frames
        found.append(edges(film.ball_coverage(0)[round(truth.outline_px[0, 1])]))
    # the rim of the flat, seen obliquely: its near or far point in this row is the edge
    depth = math.sqrt(2 * 0.100875 * push - push**2)
    rim = [[push - 0.100875, 0.4, 0.45 + side * depth] for side in (-1, 1)]
    assert found[1][0] == pytest.approx(scene.camera.project(rim)[:, 0].min(), abs=0.1)
    assert found[1][0] > found[0][0] + 4
    assert found[1][1] == pytest.approx(found[0][1], abs=0.02)


def test_occlusion_of_ball_and_face_depends_on_the_camera() -> None:
    shot = stroke()
    for x, first in ((0.9, "pendulum"), (-0.9, "ball")):
        scene = default_scene(size=(96, 54))
        camera = replace(scene.camera, position=np.array([x, 0.6, 4.0]))
        film = Film(replace(scene, camera=camera, frames=1), shot.motion)
        actors = film._actors(0, camera)
        assert (type(actors[-1]).__name__ == "RoundActor") == (first == "pendulum")


def test_shadows_darken_the_wall_and_follow_the_ball() -> None:
    scene = replace(default_scene(size=(216, 120)), frames=200)
    with_ball = Film(scene, stroke().motion)
    without = Film(replace(scene, room=replace(scene.room, show_ball=False)), stroke().motion)
    places = []
    for frame in (90, 150):
        lost = without.light(frame).sum(axis=2) - with_ball.light(frame).sum(axis=2)
        u, v = film_truth(with_ball, None).frames.ball_px[frame]
        rows, columns = np.indices(lost.shape)
        apart = np.hypot(columns - u, rows - v) > 16
        dark = apart & (lost > 0.1 * without.light(frame).sum(axis=2))
        assert dark.sum() > 40
        places.append(columns[dark].mean())
    assert places[1] > places[0] + 10


def test_a_hand_held_camera_moves_the_image_by_its_true_shift() -> None:
    scene = replace(default_scene(size=(216, 120)), frames=60, sensor=CLEAN)
    still = Film(scene, stroke().motion)
    shaken = Film(replace(scene, shake=Shake(bump=(30, 3.0, -2.0))), stroke().motion)
    before = film_truth(still, None).frames.ball_px
    after = film_truth(shaken, None).frames.ball_px
    assert after[29] == pytest.approx(before[29], abs=1e-6)
    assert after[30] - before[30] == pytest.approx([3.0, -2.0], rel=0.12)
    one, two = still.light(40)[..., 1], shaken.light(40)[..., 1]
    moved, kept = two[8:-8, 11:-5], one[10:-6, 8:-8]
    assert np.abs(moved - kept).mean() < 0.25 * np.abs(two[8:-8, 8:-8] - one[8:-8, 8:-8]).mean()


def test_dropped_frames_are_missing_and_times_continue() -> None:
    scene = default_scene(size=(96, 54))
    scene = replace(scene, frames=6, encoding=replace(scene.encoding, dropped=(2, 3)))
    frames, truth = render_frames(scene, stroke())
    assert len(list(frames)) == 4
    assert np.diff(truth.frames.time) * 600 == pytest.approx([1, 3, 1])


def test_a_mirrored_scene_is_the_mirror_image() -> None:
    scene = replace(default_scene(size=(96, 54)), frames=1)
    plain, truth = render_frames(scene, stroke())
    turned, other = render_frames(replace(scene, mirrored=True), stroke())
    assert np.array_equal(next(plain)[:, ::-1], next(turned))
    assert other.frames.ball_px[0, 0] == pytest.approx(95 - truth.frames.ball_px[0, 0])


def test_distractors_are_visible_and_move() -> None:
    scene = replace(default_scene(size=(216, 120)), frames=300)
    room = replace(scene.room, scales=(SwingingScale(),), loose_balls=(LooseBall((1.2, 0.1, 0.3)),))
    plain = Film(scene, stroke().motion).light(10)
    film = Film(replace(scene, room=room), stroke().motion)
    extra = np.abs(film.light(10) - plain).sum(axis=2) > 0.05
    assert extra.sum() > 100
    later = np.abs(film.light(290) - film.light(10)).sum(axis=2)[:40, 120:]
    assert later.max() > 0.05


def test_flicker_and_noise_have_the_requested_size() -> None:
    scene = default_scene(size=(96, 54))
    lighting = replace(scene.room.lighting, flicker=0.2)
    quiet = replace(
        scene, frames=30, sensor=CLEAN, room=replace(scene.room, lighting=lighting, show_rig=False)
    )
    means = np.array([f[5:20, 60:].mean() for f in islice(render_frames(quiet, stroke())[0], 30)])
    swing = (means.max() - means.min()) / means.mean()
    assert swing == pytest.approx(2 * 0.2 * np.sinc(100 / 1000), rel=0.08)
    noisy = replace(quiet, sensor=replace(CLEAN, full_well=1000.0, read_noise=0.0))
    one, two = next(render_frames(noisy, stroke())[0]), next(render_frames(quiet, stroke())[0])
    level = two[5:20, 60:].mean() / 255
    noise = (one[5:20, 60:].astype(float) - two[5:20, 60:]).std() / 255
    assert noise == pytest.approx(math.sqrt(level / 1000), rel=0.1)


def test_a_spinning_ball_turns_its_panels() -> None:
    shot = stroke()
    early, late = shot.motion.at([0.1]).attitude[0], shot.motion.at([0.3]).attitude[0]
    angle = math.acos(0.5 * (np.trace(late @ early.T) - 1.0))
    assert angle == pytest.approx(abs(float(shot.contact.outcome.ball_spin)) * 0.2, rel=1e-6)
    assert set(BALL_LOOKS) <= set(BALLS)


def test_the_motion_is_continuous_through_contact_and_landing() -> None:
    shot = stroke()
    for event in (0.0, shot.contact_time, shot.landing_time):
        around = shot.motion.at([event - 1e-7, event + 1e-7])
        assert np.ptp(around.ball, axis=0) == pytest.approx([0, 0, 0], abs=3e-6)
        assert np.ptp(around.phi) < 3e-6
    assert shot.motion.at([shot.landing_time]).ball[0, 1] == pytest.approx(BALLS["jokku"].radius)


@pytest.mark.parametrize(
    "wrong",
    [
        {"frames": 0},
        {"shutter": Shutter(exposure=1.0)},
        {"shutter": Shutter(fps=-1.0)},
        {"room": Room(plane=0.01)},
    ],
)
def test_impossible_scenes_are_refused(wrong: dict) -> None:
    with pytest.raises(UsageError, match="can't be rendered"):
        replace(default_scene(), **wrong)
