import numpy as np
import pytest

from tests.vision.ball.painted import exposed, wall, with_ball
from vision.pendulum.arc import fit_arc
from vision.scene import (
    Aligner,
    brightness,
    densest,
    estimate_background,
    sorted_stack,
    warp_to_scene,
)
from vision.tracks import find_rest


def _film(places: list[tuple[float, float]], flicker: float = 0.0) -> list[np.ndarray]:
    scene = wall(80, 160)
    return [
        exposed(with_ball(scene, place, 9.0), 1.5, i, 1.0 + flicker * (i % 2)).astype(np.float32)
        for i, place in enumerate(places)
    ]


def test_a_ball_that_rests_for_most_of_the_clip_is_not_background() -> None:
    places = [(40.0, 40.0)] * 34 + [(55.0 + 12 * i, 40.0) for i in range(8)] + [(300.0, 40.0)] * 6
    background = estimate_background(_film(places))
    bare = exposed(wall(80, 160), 0.0, 0).astype(float)
    assert np.abs(background.image - bare)[32:49, 32:49].mean() < 2.0


def test_the_scene_as_a_clip_begins_has_what_lay_there_whole_whatever_was_seen_later() -> None:
    places = [(40.0, 40.0)] * 22 + [(43.0 + 1.5 * i, 40.0) for i in range(26)]
    films = _film(places)
    begun = estimate_background(films).at_first.image
    assert np.abs(begun - films[0])[26:54, 26:54].mean() < 2.0


def test_flicker_does_not_blur_the_background() -> None:
    background = estimate_background(_film([(20.0 + 5 * i, 40.0) for i in range(28)], 0.2))
    bare = exposed(wall(80, 160), 0.0, 0).astype(np.float32)
    gain = brightness(background.image, bare, 1.0)
    assert np.median(np.abs(background.image / gain - bare)) < 1.5


def test_noise_is_estimated_from_the_clip() -> None:
    background = estimate_background(_film([(20.0 + 5 * i, 40.0) for i in range(28)]))
    assert float(np.median(background.noise)) == pytest.approx(1.7, abs=0.5)


def test_a_moved_camera_is_registered_to_a_few_hundredths_of_a_pixel() -> None:
    big = exposed(wall(140, 220), 0.0, 0).astype(np.float32)
    rng = np.random.default_rng(1)
    scene = np.ascontiguousarray(big[20:120, 20:200])
    moved = big[17:117, 25:205] + rng.normal(0, 1.5, (100, 180))
    view = Aligner(scene, 1.5).view(np.asarray(moved, dtype=np.float32))
    assert view.shift_px == pytest.approx([-5.0, 3.0], abs=0.05)
    back = warp_to_scene(np.asarray(moved, dtype=np.float32), view)
    assert np.abs(back - scene)[10:-10, 10:-10].mean() < 3.0


def test_brightness_ignores_what_stands_in_front() -> None:
    scene = exposed(wall(80, 160), 0.0, 0).astype(np.float32)
    frame = scene * np.float32(1.1)
    frame[:, :50] = 10
    assert brightness(frame, scene, 1.0) == pytest.approx(1.1, abs=0.005)


def test_rest_ends_when_the_ball_leaves() -> None:
    frame = np.arange(60)
    centre = np.column_stack(
        [np.where(frame < 30, 50.0, 50.0 + 2.0 * (frame - 29)), np.full(60, 20.0)]
    )
    centre += np.random.default_rng(0).normal(0, 0.02, centre.shape)
    rest = find_rest(frame, centre, 10.0)
    assert rest is not None
    assert abs(rest.last - 29) <= 1
    assert rest.direction == pytest.approx([1.0, 0.0], abs=0.02)


def test_copies_of_one_picture_before_the_action_do_not_end_the_rest() -> None:
    # the copies' fits agree exactly, and are off together by what was in that picture
    frame = np.arange(160)
    x = np.where(frame < 120, 50.0, 50.0 + 1.2 * (frame - 119))
    centre = np.column_stack([x, np.full(160, 20.0)])
    centre += np.random.default_rng(0).normal(0, 0.02, centre.shape)
    centre[:80] = [48.9, 20.1]
    rest = find_rest(frame, centre, 20.0)
    assert rest is not None
    assert abs(rest.last - 119) <= 1
    assert rest.centre_px == pytest.approx([50.0, 20.0], abs=0.05)


def test_no_rest_in_a_throw() -> None:
    frame = np.arange(40)
    assert find_rest(frame, np.column_stack([3.0 * frame, 0.1 * frame**2]), 10.0) is None


def test_turns_help_to_the_pivot_of_a_short_arc() -> None:
    angle = np.linspace(-0.15, 0.15, 40)
    points = np.column_stack([100 + 80 * np.sin(angle), 20 + 80 * np.cos(angle)])
    points += np.random.default_rng(2).normal(0, 0.08, points.shape)
    turns = -angle + np.random.default_rng(3).normal(0, 0.002, 40)
    arc, by_points = fit_arc(points, turns), fit_arc(points)
    assert arc is not None
    assert by_points is not None
    assert arc.centre_px == pytest.approx([100.0, 20.0], abs=4.0)
    assert abs(arc.radius_px - 80.0) < abs(by_points.radius_px - 80.0)


def test_turns_that_drift_do_not_bend_the_arc() -> None:
    angle = np.linspace(-0.3, 0.3, 60)
    points = np.column_stack([100 + 80 * np.sin(angle), 20 + 80 * np.cos(angle)])
    points += np.random.default_rng(2).normal(0, 0.05, points.shape)
    arc = fit_arc(points, -0.6 * angle)
    assert arc is not None
    assert arc.radius_px == pytest.approx(80.0, abs=3.0)


def test_points_on_a_line_have_no_pivot_to_speak_of() -> None:
    arc = fit_arc(np.column_stack([np.arange(4.0), np.arange(4.0)]))
    assert arc is None


def test_the_level_about_which_most_crowd_is_taken_though_others_are_seen_more_often() -> None:
    rng = np.random.default_rng(0)
    still = rng.normal(12_000, 30, (16, 8, 8))
    passing = rng.uniform(2_000, 30_000, (24, 8, 8))
    levels = np.concatenate([passing, still]).astype(np.uint16)
    found = densest(sorted_stack(list(levels)), 0.35)
    assert found == pytest.approx(np.full((8, 8), 12_000.0), abs=60)


@pytest.mark.parametrize("count", [1, 2, 5, 13, 45])
def test_pictures_are_sorted_pixel_by_pixel(count: int) -> None:
    levels = np.random.default_rng(count).integers(0, 9_999, (count, 6, 7)).astype(np.uint16)
    assert np.array_equal(np.stack(sorted_stack(list(levels))), np.sort(levels, axis=0))


def test_a_swinging_thing_of_one_colour_leaves_no_ghost() -> None:
    pictures = []
    for index in range(45):
        scene = wall(80, 160)
        left = int(60 + 40 * np.sin(0.29 * index))
        scene[30:50, left : left + 24] = 0.1
        pictures.append(exposed(scene, 1.5, index).astype(np.float32))
    background = estimate_background(pictures)
    bare = exposed(wall(80, 160), 0.0, 0).astype(float)
    assert np.mean(np.abs(background.image - bare)[30:50] > 10.0) < 0.03


def test_what_rests_while_something_passes_before_it_has_not_left() -> None:
    frame = np.arange(60)
    x = np.where(frame < 40, 50.0, 50.0 + 2.0 * (frame - 39))
    x[15:20] += 3.0
    rest = find_rest(frame, np.column_stack([x, np.full(60, 20.0)]), 10.0)
    assert rest is not None
    assert rest.last == 39


def test_a_ball_lies_where_it_dwells_though_the_first_fits_are_off() -> None:
    """As where something dark passes behind the ball while a clip begins."""
    rng, frame = np.random.default_rng(8), np.arange(80)
    x = 50.0 + 3.0 * np.clip(1.0 - frame / 9.0, 0.0, 1.0) + rng.normal(0.0, 0.1, 80)
    x[55:] += 2.0 * np.arange(1, 26)
    rest = find_rest(frame, np.column_stack([x, np.full(80, 20.0)]), 18.0)
    assert rest is not None
    assert 50 <= rest.last <= 55
    assert rest.centre_px == pytest.approx([50.0, 20.0], abs=0.2)


@pytest.mark.parametrize("settled", [34, 40])
def test_a_shadow_that_lay_beneath_the_ball_is_not_its_place(settled: int) -> None:
    """Outlines are first of its shadow, hop onto the ball while it lies still, and fly with it."""
    frame = np.arange(90)
    way = 0.9 * np.maximum(frame - 60, 0)
    y = np.clip(98.0 - 5.0 * (frame - settled + 3), 84.0, 98.0)
    centre = np.column_stack([170.0 - way, y - 0.2 * way])
    centre += np.random.default_rng(4).normal(0.0, 0.05, centre.shape)
    rest = find_rest(frame, centre, 7.5)
    assert rest is not None
    assert settled - 2 <= rest.first <= settled + 3
    assert rest.centre_px == pytest.approx([170.0, 84.0], abs=0.1)
    assert rest.direction[0] < -0.9


def test_a_slow_ball_that_leaves_has_not_hopped() -> None:
    frame = np.arange(200)
    x = 50.0 + 0.15 * np.maximum(frame - 99, 0)
    rest = find_rest(frame, np.column_stack([x, np.full(200, 20.0)]), 10.0)
    assert rest is not None
    assert rest.first == 0
    assert 97 <= rest.last <= 102


@pytest.mark.parametrize("lasts", [1.0, 5.0, 12.0])
@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_a_rest_ends_where_the_push_begins(lasts: float, noise: float) -> None:
    rng, frame, late = np.random.default_rng(8), np.arange(90), []
    for _ in range(20):
        begins = rng.uniform(40.0, 44.0)
        since = np.maximum(frame - begins, 0.0)
        # contact force of half a sine
        phase = np.minimum(since / lasts, 1.0) * np.pi
        way = 0.5 * lasts * (phase - np.sin(phase)) / np.pi + np.maximum(since - lasts, 0.0)
        centre = np.column_stack([50.0 + 2.4 * way, 20.0 - 0.5 * way])
        rest = find_rest(frame, centre + rng.normal(0.0, noise, centre.shape), 9.0)
        assert rest is not None
        late.append(rest.last - begins)
    # no force to speak of acts in the first part of the contact
    assert -1.5 < np.mean(late) < 0.5 + 0.2 * lasts + 3.0 * noise
    assert np.std(late) < 0.5 + 0.05 * lasts + 2.0 * noise
