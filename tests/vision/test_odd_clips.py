"""Clips that hold no strike, or hardly a picture: refused, or told for what they are."""

import numpy as np
import pytest

from metrology import ClipError, NotFoundError
from tests.vision.ball.painted import PaintedClip, exposed, wall, with_ball, with_box
from vision.clip.footage import Footage
from vision.following import follow
from vision.tracks import MotionKind, MotionModel


def _noise(count: int, height: int, width: int) -> PaintedClip:
    rng = np.random.default_rng(0)
    return PaintedClip([rng.integers(0, 256, (height, width)).astype(np.uint8)] * count)


@pytest.mark.parametrize(("height", "width"), [(8, 100), (20, 33_000)])
def test_sizes_that_cannot_be_worked_on_are_refused(height: int, width: int) -> None:
    with pytest.raises(ClipError, match=f"{width} × {height} px are too"):
        follow(_noise(3, height, width), 30.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(("height", "width"), [(48, 64), (30, 40), (16, 3_000)])
def test_small_pictures_of_nothing_hold_no_ball(height: int, width: int) -> None:
    with pytest.raises(NotFoundError, match="no ball found"):
        follow(_noise(12, height, width), 30.0)  # type: ignore[arg-type]


def _bar_alone(amplitude: float) -> PaintedClip:
    """A bar that swings about a pivot above the picture."""
    scene = wall(120, 240)
    angles = amplitude * np.cos(0.12 * np.arange(90))
    return PaintedClip(
        [
            exposed(with_box(scene, (120.0, -20.0), 90.0, float(angle), 8.0), 1.5, index)
            for index, angle in enumerate(angles)
        ]
    )


@pytest.mark.parametrize("amplitude", [0.4, 0.5, 0.6])
def test_a_bar_that_is_hardly_found_is_in_doubt(amplitude: float) -> None:
    motion = follow(_bar_alone(amplitude), 30.0).motion  # type: ignore[arg-type]
    assert motion.kind is MotionKind.SWING or motion.probability < 0.6


def test_a_ball_already_struck_flies() -> None:
    scene = wall(120, 240)
    pictures = []
    for index in range(36):
        place = (40.0 + 4.0 * index, 70.0 - 2.2 * index + 0.05 * index**2)
        pictures.append(exposed(with_ball(scene, place, 10.0), 1.5, index))
    tracks = follow(PaintedClip(pictures), 30.0)  # type: ignore[arg-type]
    assert tracks.motion.kind is MotionKind.FLIGHT
    assert tracks.rest_frames is None


def test_a_ball_that_fills_much_of_the_picture_is_no_moving_scene() -> None:
    scene = wall(84, 180)
    places = [(40.0 + max(0.0, 2.2 * (index - 20)), 44.0) for index in range(58)]
    pictures = [
        exposed(with_ball(scene, place, 23.0), 1.5, index) for index, place in enumerate(places)
    ]
    tracks = follow(PaintedClip(pictures), 30.0)  # type: ignore[arg-type]
    off = tracks.ball.centre_px - np.array(places)[tracks.ball.frame]
    assert tracks.shift_px is None
    assert tracks.rest_frames is not None
    assert tracks.rest_frames[0] < 10
    assert tracks.rest_frames[1] <= 20
    assert len(off) > 40
    assert np.hypot(*off.T).max() < 0.2


def test_a_clip_that_is_cut_is_measured_in_one_part_and_told() -> None:
    lying, flying = np.full((120, 240), 0.55), wall(120, 240)
    lying[20:60, 150:220], lying[70:100, 10:60] = 0.2, 0.9
    pictures = [exposed(lying, 1.5, seed) for seed in range(20)]
    places = [(40.0 + 4.0 * k, 70.0 - 2.2 * k + 0.05 * k**2) for k in range(36)]
    pictures += [
        exposed(with_ball(flying, place, 10.0), 1.5, seed) for seed, place in enumerate(places)
    ]
    tracks = follow(PaintedClip(pictures), 30.0)  # type: ignore[arg-type]
    assert any("cut between frames 19 and 20" in said for said in tracks.warnings)
    assert tracks.ball.frame[0] >= 20
    off = np.hypot(*(tracks.ball.centre_px - np.array(places)[tracks.ball.frame - 20]).T)
    assert np.median(off) < 0.3


@pytest.mark.parametrize("again", [0, 1])
def test_a_clip_that_goes_on_backwards_is_measured_until_it_turns_round(again: int) -> None:
    flying = wall(120, 240)
    places = [(40.0 + 4.0 * k, 70.0 - 2.2 * k + 0.05 * k**2) for k in range(36)]
    # the turning frame once or twice; what is stored again is not the same to the gray level
    shown = [*places, *places[::-1][again:]]
    pictures = [
        exposed(with_ball(flying, place, 10.0), 1.5, seed) for seed, place in enumerate(shown)
    ]
    tracks = follow(PaintedClip(pictures), 30.0)  # type: ignore[arg-type]
    assert any("From frame 36 on" in said and "backwards" in said for said in tracks.warnings)
    assert tracks.ball.frame[-1] < 36
    off = np.hypot(*(tracks.ball.centre_px - np.array(places)[tracks.ball.frame]).T)
    assert np.median(off) < 0.3


def test_a_bob_that_comes_back_is_no_clip_shown_backwards() -> None:
    for count in (80, 85, 90):
        scene, turn = wall(120, 240), 0.12 * np.arange(count) + 0.4
        places = [(120.0 + 70.0 * np.cos(one), 60.0 + 8.0 * np.sin(one) ** 2) for one in turn]
        pictures = [
            exposed(with_ball(scene, place, 10.0), 1.5, seed) for seed, place in enumerate(places)
        ]
        assert Footage(PaintedClip(pictures)).backwards is None  # type: ignore[arg-type]


def test_blank_and_faded_ends_of_an_edited_clip_are_left_out() -> None:
    scene = wall(120, 240)
    places = [(40.0 + 4.0 * k, 70.0 - 2.2 * k + 0.05 * k**2) for k in range(36)]
    shown = [exposed(with_ball(scene, place, 10.0), 1.5, seed) for seed, place in enumerate(places)]
    title = [np.full((120, 240), 30, np.uint8)] * 40
    fade = [(shown[-1] * (1.0 - k / 12.0)).astype(np.uint8) for k in range(1, 13)]
    tracks = follow(PaintedClip([*title, *shown, *fade]), 30.0)  # type: ignore[arg-type]
    assert any("cut between frames 39 and 40" in said for said in tracks.warnings)
    off = np.hypot(*(tracks.ball.centre_px - np.array(places)[tracks.ball.frame - 40]).T)
    assert len(off) > 30
    assert np.median(off) < 0.3


def test_a_second_ball_and_a_shadow_are_told_by_what_they_are() -> None:
    scene = wall(120, 240)
    y, x = np.mgrid[0:120, 0:240].astype(float)
    pictures = []
    for index in range(36):
        place = (40.0 + 4.0 * index, 60.0 - 2.2 * index + 0.06 * index**2)
        away = np.hypot(x - place[0] + 14.0, y - place[1] - 36.0)
        dim = 1.0 - 0.35 * np.clip((14.0 - away) / 5.0, 0.0, 1.0)
        pictures.append(exposed(with_ball(scene * dim, place, 10.0), 1.0, index))
    tracks = follow(PaintedClip(pictures), 30.0)  # type: ignore[arg-type]
    labels = [thing.model for thing in (*tracks.others, *tracks.dismissed)]
    assert MotionModel.SHADOW in labels
    assert all(thing.reasons for thing in (*tracks.others, *tracks.dismissed))
    assert tracks.ball.radius_px.mean() == pytest.approx(10.0, abs=0.3)
