"""Stretches of constant acceleration and courses from rest on."""

import numpy as np
import pytest

from vision.ball.courses import bends_up, lawful_course, lawful_stretch

TIME = np.arange(60.0)


def test_the_lawful_stretch_ends_at_the_bounce() -> None:
    fall = np.column_stack([2.0 * TIME[:30], 0.1 * TIME[:30] ** 2])
    after = TIME[1:25]
    rise = fall[-1] + np.column_stack([2.0 * after, -5.0 * after + 0.1 * after**2])
    stretch = lawful_stretch(np.arange(54), np.concatenate([fall, rise]), 6.0)
    assert (stretch.first, stretch.last) in {(0, 29), (0, 30), (0, 31)}
    assert stretch.evidence > 50.0


def _struck(still: int, flown: int) -> np.ndarray:
    """Lies at (90, 60), then flies on a parabola; centres scatter by 0.1 px."""
    time = np.arange(flown) + 0.6
    flight = np.column_stack([90.0 + 1.4 * time, 60.0 - 0.7 * time + 0.012 * time**2])
    rest = np.tile([90.0, 60.0], (still, 1))
    scatter = np.random.default_rng(8).normal(0.0, 0.1, (still + flown, 2))
    return np.concatenate([rest, flight]) + scatter


def test_a_course_is_the_rest_and_the_flight() -> None:
    course = lawful_course(np.arange(120), _struck(50, 70), 9.0)
    # a ball that hardly moved yet may count for either
    assert course.still == pytest.approx(50, abs=3)
    assert course.still + course.moving == 120
    assert (course.astray, course.missed, course.last) == (0, 0, 119)


def test_a_rest_told_as_another_thing_speaks_less_for_a_course() -> None:
    whole = _struck(50, 70)
    shadow = whole.copy()
    shadow[:50] += np.column_stack([np.linspace(40.0, 12.0, 50), np.full(50, 30.0)])
    shadow[::7] += 9.0
    frame = np.arange(120)
    best = lawful_course(frame, whole, 9.0).evidence(9.0)
    assert best > lawful_course(frame, shadow, 9.0).evidence(9.0) + 50.0
    assert best > lawful_course(frame[52:], whole[52:], 9.0).evidence(9.0) + 50.0


def test_a_course_ends_with_its_law_and_counts_what_is_not_seen() -> None:
    path = _struck(50, 70)
    bounced = path[-1] + np.column_stack([1.4 * TIME[1:16], -2.0 * TIME[1:16]])
    frame = np.setdiff1d(np.arange(135), [70, 71, 72])
    course = lawful_course(frame, np.concatenate([path, bounced])[frame], 9.0)
    assert course.missed == 3
    assert course.last == pytest.approx(119, abs=2)
    assert course.astray == pytest.approx(15, abs=2)


def test_one_gap_is_less_of_a_surprise_than_as_many_frames_missed_here_and_there() -> None:
    path, frame = _struck(50, 120), np.arange(170)
    hidden = np.setdiff1d(frame, np.arange(80, 120))
    blinking = np.setdiff1d(frame, np.arange(60, 140, 2))
    courses = [lawful_course(left, path[left], 9.0) for left in (hidden, blinking)]
    assert [course.missed for course in courses] == [40, 40]
    assert courses[0].evidence(9.0) > courses[1].evidence(9.0) + 30.0
    assert courses[1].hidden == 0.0
    lacking = lawful_course(blinking, path[blinking], 9.0, blinking)
    assert (lacking.hidden, lacking.absent) == (40.0, 40)
    assert courses[0].absent == 0


def test_what_lay_elsewhere_is_no_rest_of_what_flies() -> None:
    path = _struck(50, 70)
    path[:50] += [40.0, 28.0]
    course = lawful_course(np.arange(120), path, 9.0)
    assert course.still == 0
    assert course.astray == pytest.approx(50, abs=3)


def test_what_never_leaves_its_place_has_no_law() -> None:
    course = lawful_course(np.arange(60), _struck(60, 0), 9.0)
    assert course.moving == 0
    assert course.evidence(9.0) <= 0.0


def test_what_bounces_often_is_lawful_in_between() -> None:
    rng, time = np.random.default_rng(14), np.arange(400.0)
    across = np.cumsum(np.repeat(rng.normal(0.0, 3.0, 29), 14)[:400])
    path = np.column_stack([across, 200.0 + 0.3 * (time % 14.0 - 7.0) ** 2])
    path += rng.normal(0.0, 0.3, path.shape)
    stretch = lawful_stretch(np.arange(400), path, 6.0)
    assert 12 <= stretch.looks <= 16
    assert stretch.evidence > 20.0


def test_a_bob_bends_up_where_it_is_lowest_and_nothing_that_falls_or_brakes_does() -> None:
    time = np.arange(50.0)
    angle = 0.02 * (time - 25.0)
    bob = np.column_stack([100.0 + 80.0 * np.sin(angle), 20.0 + 80.0 * np.cos(angle)])
    thrown = np.column_stack([20.0 + 3.0 * time, 90.0 - 2.0 * time + 0.03 * time**2])
    braked = np.outer(4.0 * time - 0.03 * time**2, [0.8, 0.6])

    def bends(places: np.ndarray) -> bool:
        strayed = places + np.random.default_rng(5).normal(0.0, 0.3, places.shape)
        return bends_up(np.arange(len(places)), strayed, 8.0)

    assert bends(bob)
    assert not bends(thrown)
    # it comes down in the picture, and slows down: its acceleration points up
    assert not bends(braked)
