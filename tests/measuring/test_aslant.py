"""Scales without a grid, seen by an oblique camera."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.solve import LOG_FOCAL_STD
from measuring.budget import ClipConditions, systematic_budget
from measuring.gravity import with_fitted_slant
from measuring.inputs import gather_inputs
from measuring.metres import AssumedLens, BallScale, assumed_lens
from measuring.setup.file import Setup
from metrology import Defaults, UncertaintySource
from physics.bodies import BALLS
from vision.clip.footage import CaptureRate, RateSource
from vision.tracks import Track, Tracks


def test_lengths_along_the_rows_are_as_long_as_a_camera_square_to_them_sees_them() -> None:
    aslant = math.radians(30.0)
    places = np.array([[0.0, 0.0], [1.2, 0.0], [0.4, 0.7]])
    # from far away: rows are seen shorter by the cosine of the slant, columns as long as they are
    seen = places * [math.cos(aslant), -1.0] * 200.0 + [90.0, 150.0]
    rest = seen[0]
    scale = BallScale(1.0 / 200.0, rest, rest, foreshortening=math.cos(aslant))
    assert scale.point(seen) == pytest.approx(places, abs=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_camera_aslant_to_either_side_counts_by_the_worse_one(side: float) -> None:
    inputs = gather_inputs(Setup(), "jokku", None)
    scene = ClipConditions(inputs, CaptureRate(600.0, 0.0, RateSource.OPTION), None)

    def values(moved: ClipConditions) -> NDArray[np.float64]:
        return np.array([5.0 + (3.0 if side * moved.slant_rad > 0 else 1.0) * moved.slant_rad])

    column = systematic_budget(scene, values, np.inf)[UncertaintySource.CAMERA_SLANT]
    assert column[0] == pytest.approx(3.0 * Defaults.CAMERA_SLANT.std)


def seen_by(yaw_rad: float, noise_px: float) -> Track:
    """A ball of 0.11 m on its way through a plane 3.5 m away, as a pinhole turned by `yaw` sees it.

    Of each outline the mean half axis: the bundle of rays that touch the ball, cut by the picture.
    """
    x = np.linspace(-0.2, 0.7, 40)
    place = np.column_stack([x, 0.1 + 0.3 * x - 0.2 * x * x])
    return outlined(place, yaw_rad, noise_px)


def outlined(
    place: NDArray[np.float64], yaw_rad: float, noise_px: float, radius_m: float = 0.11
) -> Track:
    """The same of a ball at places (N, 2) of that plane, m, in frames at 600 fps."""
    focal, rng, count = 560.0, np.random.default_rng(4), len(place)
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    seen = np.column_stack([place, np.zeros(count)]) @ turn.T + [0.0, 0.0, 3.5]
    away = np.linalg.norm(seen, axis=1)
    opening = np.arcsin(radius_m / away)
    off_axis = np.arccos(seen[:, 2] / away)
    long = 0.5 * focal * (np.tan(off_axis + opening) - np.tan(off_axis - opening))
    across = focal * np.tan(opening) / np.cos(off_axis)
    radius = 0.5 * (long + across) + rng.normal(0.0, noise_px, count)
    centre = focal * seen[:, :2] / seen[:, 2:] * [1.0, -1.0] + [223.5, 119.5]
    return Track(
        frame=np.arange(count),
        time_s=np.arange(count) / 600.0,
        centre_px=centre,
        covariance_px2=np.tile(np.eye(2) * 0.01, (count, 1, 1)),
        bound_px2=np.tile(np.eye(2) * 0.002, (count, 1, 1)),
        radius_px=radius,
        radius_std_px=np.full(count, max(noise_px, 0.02)),
        quality=np.ones(count),
    )


def struck(yaw_rad: float, speed: float, frames: int) -> Tracks:
    """A jokku ball that lies for 30 frames and then flies, drag and all, before such a camera."""
    fine = 20
    place, velocity = np.array([-0.45, 0.25]), speed * np.array([0.97, 0.24])
    path = [place] * 30
    for step in range(fine * frames):
        drag = 0.0235 * float(np.hypot(*velocity)) * velocity
        pull = -drag - [0.0, 9.806]
        place = place + velocity / (600.0 * fine) + 0.5 * pull / (600.0 * fine) ** 2
        velocity = velocity + pull / (600.0 * fine)
        if step % fine == 0:
            path.append(place)
    ball = outlined(np.array(path), yaw_rad, 0.05, 0.5 * BALLS["jokku"].diameter)
    noise = np.random.default_rng(8).normal(0.0, 0.05, ball.centre_px.shape)
    ball = replace(ball, centre_px=ball.centre_px + noise)
    return Tracks(ball, None, np.zeros((240, 448), np.float32), (0, 29))


def as_shown(tracks: Tracks) -> ClipConditions:
    """The camera as the flight of a jokku ball shows it, filmed at 600 fps."""
    inputs = gather_inputs(Setup(), "jokku", None)
    lens = assumed_lens(tracks.ball, (240, 448))
    rate = CaptureRate(600.0, 0.0, RateSource.OPTION)
    scene = ClipConditions(inputs, rate, None, lens=lens)
    return with_fitted_slant(scene, tracks, tracks.ball.time_s)


@pytest.mark.parametrize("yaw_deg", [-18.0, -4.0, 0.0, 18.0])
def test_a_flight_shows_how_much_aslant_its_camera_looks(yaw_deg: float) -> None:
    scene = as_shown(struck(math.radians(yaw_deg), 4.0, 150))
    assert scene.lens is not None
    # the plane recedes to the side to which the camera is not turned
    off = math.degrees(scene.slant_rad) + yaw_deg
    assert abs(off) < 2.0 * math.degrees(scene.slant_std_rad) < 3.0
    # and what is as long on either side of the picture comes out so, and what is level level
    plane = scene.plane_of_ball(struck(math.radians(yaw_deg), 4.0, 150))
    level = outlined(np.array([[-0.5, 0.4], [0.1, 0.4], [0.7, 0.4]]), math.radians(yaw_deg), 0.0)
    places, _ = plane.ball(level.centre_px, level.covariance_px2)
    left, right = np.diff(places[:, 0])
    assert left == pytest.approx(right, rel=0.012)
    assert places[:, 1] == pytest.approx(np.full(3, places[1, 1]), abs=0.005)


def test_a_flight_too_short_to_show_it_leaves_the_slant_of_a_camera_set_up_by_eye() -> None:
    scene = as_shown(struck(0.0, 4.0, 30))
    assert scene.slant_std_rad == pytest.approx(Defaults.CAMERA_SLANT.std, rel=0.15)
    assert abs(scene.slant_rad) < 0.5 * Defaults.CAMERA_SLANT.std


def scale_turned(
    ball: Track, yaw: float, per_px: float, seen_through: AssumedLens | None = None
) -> BallScale:
    """The scale of a camera turned towards +x, which sees the plane recede towards -x."""
    lens, usual = assumed_lens(ball, (240, 448)), ball.centre_px[20]
    shortened = lens.foreshortening(usual, -yaw)
    growth = math.sin(-yaw) / (shortened * lens.focal_px)
    return BallScale(per_px, usual, usual, 0.0, growth, shortened, seen_through)


@pytest.mark.parametrize("yaw_deg", [-15.0, 15.0])
def test_the_eye_of_a_camera_aslant_is_where_it_stands(yaw_deg: float) -> None:
    yaw = math.radians(yaw_deg)
    ball = seen_by(yaw, 0.0)
    lens = assumed_lens(ball, (240, 448))
    eye = scale_turned(
        ball, yaw, 0.11 / float(lens.across(ball.centre_px, ball.radius_px)[20]), lens
    ).eye()
    assert eye is not None
    x = 0.9 * 20 / 39 - 0.2
    # 3.5 m from the point that it looks at, x = 0
    there = [3.5 * math.sin(yaw) - x, -(0.1 + 0.3 * x - 0.2 * x * x), 3.5 * math.cos(yaw)]
    assert eye == pytest.approx(there, abs=0.03)


@pytest.mark.parametrize("yaw_deg", [-25.0, 25.0])
def test_a_ball_that_looks_smaller_along_its_way_leaves_the_cameras_slant_open(
    yaw_deg: float,
) -> None:
    lens = assumed_lens(seen_by(math.radians(yaw_deg), 0.05), (240, 448))
    assert 18.0 < math.degrees(lens.slant_std_rad) < 32.0


@pytest.mark.parametrize(("yaw_deg", "noise_px"), [(0.0, 0.05), (3.0, 0.05), (25.0, 4.0)])
def test_a_ball_whose_size_tells_nothing_leaves_the_slant_of_a_camera_set_up_by_eye(
    yaw_deg: float, noise_px: float
) -> None:
    lens = assumed_lens(seen_by(math.radians(yaw_deg), noise_px), (240, 448))
    assert lens.slant_std_rad == Defaults.CAMERA_SLANT.std


def test_a_camera_square_to_the_plane_stands_behind_the_middle_of_its_picture() -> None:
    ball = seen_by(0.0, 0.0)
    per_px = 3.5 / 560.0
    scale = BallScale(
        per_px, ball.centre_px[0], ball.centre_px[20], lens=assumed_lens(ball, (240, 448))
    )
    eye = scale.eye()
    assert eye is not None
    # the lens is the usual one for a picture as wide, as this one is
    assert eye == pytest.approx([0.2, -0.032, 3.5], abs=0.01)
    assert scale.slope_std(0.0) > math.tan(Defaults.CAMERA_SLANT.std)
    assert scale.slope_std(0.4) > 0.2


@pytest.mark.parametrize("yaw_deg", [-15.0, 15.0])
def test_lengths_off_the_axis_of_a_camera_aslant_are_as_long_as_they_are(yaw_deg: float) -> None:
    yaw = math.radians(yaw_deg)
    ball = seen_by(yaw, 0.0)
    scale = scale_turned(ball, yaw, 0.11 / ball.radius_px[20])
    near = slice(14, 27)
    along = np.ptp(scale.point(ball.centre_px[near])[:, 0])
    assert along == pytest.approx(0.9 * 12 / 39, rel=0.01)


LENS = AssumedLens(np.array([223.5, 119.5]), 560.0, Defaults.CAMERA_SLANT.std)


def test_a_ball_off_the_axis_is_where_it_is_and_as_large_as_it_is() -> None:
    # outlines of balls of 0.11 m, 3.5 m away: rays that touch them, cut by the picture
    place = np.column_stack([np.linspace(-1.2, -0.6, 7), np.linspace(-0.3, 0.4, 7)])
    away = np.hypot(np.hypot(*place.T), 3.5)
    opening, off_axis = np.arcsin(0.11 / away), np.arccos(3.5 / away)
    ends = np.tan(off_axis + opening), np.tan(off_axis - opening)
    outwards = place / np.hypot(*place.T)[:, np.newaxis] * [1.0, -1.0]
    outline = LENS.middle_px + 560.0 * 0.5 * (ends[0] + ends[1])[:, np.newaxis] * outwards
    long, short = 0.5 * (ends[0] - ends[1]), np.tan(opening) / np.cos(off_axis)
    radius = 560.0 * 0.5 * (long + short)
    across = LENS.across(outline, radius)
    assert across == pytest.approx(np.full(7, 560.0 * 0.11 / 3.5), rel=2e-3)
    middle = LENS.middle_px + 560.0 * place / 3.5 * [1.0, -1.0]
    assert np.abs(outline - middle).max() > 0.1
    assert LENS.centres(outline, float(across[0])) == pytest.approx(middle, abs=0.01)
    rest = LENS.centres(outline[:1], float(across[0]))[0]
    scale = BallScale(0.11 / float(across[0]), rest, rest, lens=LENS, across_px=float(across[0]))
    seen, _ = scale.ball(outline, np.zeros((7, 2, 2)))
    assert seen == pytest.approx(place - place[0], abs=1e-3)
    assert scale.across(outline, radius) == pytest.approx(0.11, rel=2e-3)
    # taken for circles about their middles, the same balls make all lengths too short
    assert float(np.median(radius)) / float(np.median(across)) > 1.01


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_lens_that_nobody_named_counts_by_the_worse_of_a_longer_and_a_shorter_one(
    side: float,
) -> None:
    inputs = gather_inputs(Setup(), "jokku", None)
    rate = CaptureRate(600.0, 0.0, RateSource.OPTION)
    scene = ClipConditions(inputs, rate, None, lens=LENS)

    def values(moved: ClipConditions) -> NDArray[np.float64]:
        assert moved.lens is not None
        longer = math.log(moved.lens.focal_px / LENS.focal_px)
        return np.array([5.0 + (3.0 if side * longer > 0 else 1.0) * longer])

    column = systematic_budget(scene, values, np.inf)[UncertaintySource.LENS_UNKNOWN]
    assert column[0] == pytest.approx(3.0 * LOG_FOCAL_STD)
    longer = replace(scene, lens=replace(LENS, focal_px=2.0 * LENS.focal_px))
    assert not longer.places_as(scene)
