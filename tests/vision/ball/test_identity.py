from dataclasses import replace

import numpy as np
import pytest

from vision.ball.ball import expected_places, off_flight
from vision.ball.choice import (
    BallPath,
    Choice,
    Way,
    approach,
    cast_by,
    choose_ball,
    untangled,
)


def _path(frame: np.ndarray, x: np.ndarray, radius: float = 8.0) -> BallPath:
    count = len(frame)
    centre = np.column_stack([x, np.full(count, 50.0)])
    full = np.ones(count)
    return BallPath(frame, centre, radius * full, full, 60.0 * full, full, 90.0 * full)


def test_a_head_on_collision_leaves_each_puck_its_own_path() -> None:
    # The striker stops dead at frame 40, touching; the chain went over to the target there.
    before, after = np.arange(0, 40, 4), np.arange(40, 80, 4)
    mixed = _path(
        np.concatenate([before, after]),
        np.concatenate([100.0 + 3.0 * before, 236.0 + 3.0 * (after - 39)]),
    )
    lying = _path(before, np.full(len(before), 236.0))
    paths = sorted(untangled([mixed, lying]), key=lambda path: len(path.frame))
    assert [len(path.frame) for path in paths] == [10, 20]
    striker, target = paths
    assert striker.centre_px[-1, 0] < 220.0
    assert np.all(target.centre_px[:10, 0] == 236.0)
    assert target.centre_px[-1, 0] > 340.0


def test_paths_that_go_on_as_they_did_are_left_alone() -> None:
    frame = np.arange(0, 40, 2)
    one, other = _path(frame, 3.0 * frame), _path(frame[:10], 120.0 - 3.0 * frame[:10])
    ends = {path.centre_px[-1, 0] for path in untangled([one, other])}
    assert ends == {one.centre_px[-1, 0], other.centre_px[-1, 0]}


def test_what_was_seen_before_the_ball_came_is_not_beside_it() -> None:
    earlier, ball, later = (_path(np.arange(k, k + 20), np.arange(20.0)) for k in (0, 20, 40))
    with_it = _path(np.arange(30, 50), np.arange(20.0))
    assert Choice(ball, (earlier, with_it, later), struck=False).beside == (with_it,)


def _way(frame: np.ndarray, scale: float, start: tuple[float, float]) -> Way:
    """It lies still up to frame 40, and flies."""
    flown = np.maximum(frame - 40.0, 0.0)
    place = scale * np.column_stack([2.0 * flown, 0.01 * flown**2 - 0.5 * flown])
    return Way(frame, np.array(start) + place, 8.0)


def test_a_shadow_that_is_found_in_other_looks_than_the_ball_goes_as_it_does() -> None:
    ball, shadow = np.arange(0, 90, 4), np.arange(2, 90, 4)
    cast = _way(shadow, 1.1, (60.0, 80.0))
    assert cast_by(cast, _way(ball, 1.0, (50.0, 50.0)))
    assert not cast_by(cast, Way(ball, _way(ball, 1.0, (50.0, 50.0)).centre_px[:, ::-1], 8.0))


def test_where_a_ball_is_while_it_is_lost_for_long_is_not_known() -> None:
    # a line from before the loss to after it is where it never was
    seen = np.concatenate([np.arange(0, 10), np.arange(50, 90)])
    shadow = np.arange(0, 90)
    assert cast_by(_way(shadow, 1.1, (60.0, 80.0)), _way(seen, 1.0, (50.0, 50.0)))


def _path_at(frame: np.ndarray, centre: np.ndarray, radius: float) -> BallPath:
    full = np.ones(len(frame))
    return BallPath(frame, centre, radius * full, full, 60.0 * full, full, 90.0 * full)


def _swung(frame: np.ndarray) -> np.ndarray:
    turned = (frame - 30.0) / 30.0
    return np.column_stack([390.5 - 17.0 * turned, 180.1 - 0.6 * turned - 2.0 * turned**2])


def test_what_was_followed_as_it_moved_all_along_was_not_reached_at_rest() -> None:
    # A bob that comes slowly seems to lie still over its first looks, and its shadow to reach it;
    # its last look is at something else. The ball is first seen as it leaves.
    frame = np.array([0, 3, *range(8, 63, 3), 64])
    place = _swung(frame)
    place[-1] += [-8.0, 12.0]
    bob = _path_at(frame, place, 6.6)
    late = np.array([0, 3, 8, 11, 14, 17, 21, 23, 99])
    below = np.column_stack([400.0 - 0.5 * late, 203.5 - 0.05 * late])
    gone = np.arange(73, 118, 2)
    left = np.column_stack([355.0 - 0.95 * (gone - 60), 176.0 - 0.1 * (gone - 60)])
    paths = [bob, _path_at(late, below, 9.9), _path_at(gone, left, 12.6)]
    every = np.arange(63)
    seen = Way(every, _swung(every), 6.6)
    first = choose_ball(paths, None)
    assert first is not None
    assert first.ball.radius == pytest.approx(6.6)
    assert first.reached
    told = choose_ball(paths, None, None, (seen,))
    assert told is not None
    assert told.ball.radius == pytest.approx(12.6)


def _flight(count: int = 40, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    frame = np.arange(count)
    speed = np.where(frame < 20, 3.0, -2.0)
    centre = np.column_stack([np.cumsum(speed), 0.05 * frame**2.0])
    return frame, centre + np.random.default_rng(seed).normal(0.0, 0.05, centre.shape)


def test_a_frame_off_its_neighbours_is_told_and_a_bounce_is_not() -> None:
    frame, centre = _flight()
    centre[9] += [3.0, -2.0]
    variance = np.full(len(frame), 0.05**2)
    expected = expected_places(frame, centre, np.full(len(frame), 10.0), variance)
    assert np.flatnonzero(expected.off).tolist() == [9]
    assert np.hypot(*(expected.centre[9] + [3.0, -2.0] - centre[9])) < 0.5


def test_what_states_too_little_shows_in_the_excess() -> None:
    frame, centre = _flight()
    honest = expected_places(frame, centre, np.full(40, 10.0), np.full(40, 0.05**2))
    proud = expected_places(frame, centre, np.full(40, 10.0), np.full(40, 0.01**2))
    assert 0.2 < np.nanmedian(honest.excess) < 1.5
    assert np.nanmedian(proud.excess) > 2.0 * np.nanmedian(honest.excess)


def test_a_frame_of_another_size_does_not_belong() -> None:
    frame, centre = _flight()
    radius = np.full(40, 10.0)
    radius[25] = 13.0
    expected = expected_places(frame, centre, radius, np.full(40, 0.05**2))
    assert np.flatnonzero(expected.off).tolist() == [25]


def test_a_run_of_frames_drawn_off_a_flight_is_told() -> None:
    frame = np.arange(100)
    centre = np.column_stack([3.0 * frame, 0.01 * frame**2.0 - 0.5 * frame])
    centre += np.random.default_rng(2).normal(0.0, 0.05, centre.shape)
    centre[90:98, 1] += 2.0
    place, off = off_flight(frame, centre, np.full(100, 15.0))
    assert np.flatnonzero(off).tolist() == list(range(90, 98))
    assert np.abs(place[90:98, 1] + 2.0 - centre[90:98, 1]).max() < 0.5


def test_a_motion_that_ends_in_rest_is_no_flight() -> None:
    frame = np.arange(400)
    centre = np.column_stack([np.minimum(2.8 * frame, 84.0), np.full(400, 50.0)])
    centre += np.random.default_rng(3).normal(0.0, 0.2, centre.shape)
    assert not off_flight(frame, centre, np.full(400, 8.5))[1].any()


def test_pieces_between_which_a_thing_was_hidden_are_one_path() -> None:
    frame = np.arange(60)
    lying = _path(frame[:24], np.full(24, 80.0))
    flying = _path(frame[30:], 80.0 + 4.0 * (frame[30:] - 26))
    elsewhere = _path(frame[30:], 200.0 + 4.0 * (frame[30:] - 26))
    assert [len(path.frame) for path in untangled([flying, lying])] == [54]
    assert len(untangled([elsewhere, lying])) == 2


def _flown(frame: np.ndarray, seed: int) -> BallPath:
    """A ball on its parabola, seen to a twentieth of its radius."""
    path = _path(frame, 100.0 + 2.3 * frame, 19.0)
    path.centre_px[:, 1] = 260.0 - 1.1 * frame + 0.007 * frame**2
    path.centre_px[:] += np.random.default_rng(seed).normal(0.0, 0.9, path.centre_px.shape)
    return path


@pytest.mark.parametrize("seed", range(4))
def test_a_flight_goes_on_behind_a_post_and_its_shadow_s_does_not(seed: int) -> None:
    before, after = np.arange(0, 40, 2), np.arange(95, 150, 4)
    ball, beyond = _flown(before, seed), _flown(after, seed + 10)
    # as it comes out from behind the post, circles are drawn through the half that is seen
    beyond.centre_px[:2, 0] += [9.0, 5.0]
    beyond.coverage[:2] = 0.5
    shadow = _flown(before, seed + 20)
    shadow.centre_px[:] += np.column_stack([34.0 + 0.25 * before, 40.0 - 0.1 * before])
    paths = untangled([shadow, beyond, ball])
    joined = next(path for path in paths if path.frame[-1] == after[-1])
    assert joined.frame.tolist() == [*before, *after]
    assert joined.centre_px[0] == pytest.approx(ball.centre_px[0])


@pytest.mark.parametrize("seed", range(4))
def test_what_appears_elsewhere_after_a_gap_is_another_thing(seed: int) -> None:
    before, after = np.arange(0, 40, 2), np.arange(95, 150, 4)
    ball, other = _flown(before, seed), _flown(after, seed + 10)
    other.centre_px[:] += [60.0, -80.0]
    assert len(untangled([ball, other])) == 2


def test_a_dark_thing_does_not_go_on_as_a_bright_one() -> None:
    frame = np.arange(40)
    path = _path(frame, 3.0 * frame)
    other = replace(path, level=np.where(frame < 20, 60.0, 190.0))
    assert [len(piece.frame) for piece in untangled([path])] == [40]
    assert [len(piece.frame) for piece in untangled([other])] == [20, 20]


def _swing_and_struck(first: int) -> tuple[BallPath, BallPath]:
    """A clear bob on an arc through the whole clip, and a paler ball that leaves as it arrives."""
    frame = np.arange(0, 120, 2)
    turn = np.sin(frame / 45.0)
    bob = _path(frame, 100.0 + 60.0 * turn, 6.0)
    bob.centre_px[:, 1] = 100.0 - 12.0 * turn**2
    meets = 36
    time = np.maximum(frame - meets, 0.0)
    ball = _path(frame, 158.0 + 1.2 * time, 10.0)
    ball.centre_px[:, 1] = 97.0 - 0.9 * time + 0.012 * time**2
    pale = replace(ball, sharpness=20.0 * np.ones(60), coverage=0.85 * np.ones(60))
    return bob, pale.where(frame >= first)


@pytest.mark.parametrize("first", [0, 40])
def test_what_lay_still_until_it_was_reached_is_the_ball_however_clear_its_striker(
    first: int,
) -> None:
    # From frame 40 on it is seen only in motion: before, it passed for the static scene.
    bob, ball = _swing_and_struck(first)
    choice = choose_ball([bob, ball], None)
    assert choice is not None
    assert choice.ball.radius == 10.0
    assert "reached it" in choice.reasons[0]


def test_what_nothing_reached_is_judged_by_what_speaks_for_it() -> None:
    bob, ball = _swing_and_struck(0)
    far = replace(ball, centre_px=ball.centre_px + np.array([0.0, 90.0]))
    choice = choose_ball([bob, far], None)
    assert choice is not None
    assert choice.ball.radius == 6.0


def test_a_part_of_what_strikes_has_not_lain_still_because_it_creeps_at_first() -> None:
    # The ball leaves so slowly that one law is as near to its rest as circles of edges scatter.
    frame = np.arange(0, 118, 3)
    ball = _path(frame, 53.0 + 0.62 * np.maximum(frame - 56, 0), 11.4)
    along = np.arange(5, 46, 3)
    part = _path(along, 22.9 + 0.5 * (along - 5) - 0.003 * (along - 5) ** 2.0, 3.2)
    rest_of_it = _path(frame[:26], 10.0 + 0.5 * frame[:26], 3.1)
    faint = [replace(one, coverage=0.75 * one.coverage) for one in (part, rest_of_it)]
    choice = choose_ball([ball, *faint], None)
    assert choice is not None
    assert choice.ball.radius == pytest.approx(11.4)


def test_what_is_seen_to_lie_still_is_as_good_as_what_may_have_lain() -> None:
    # What struck the ball was lost before, and is found again where the ball's shadow passes.
    frame = np.arange(0, 118, 2)
    ball = _path(frame, 75.0 + 0.9 * np.maximum(frame - 52, 0), 12.0)
    late = np.arange(84, 116, 2)
    striker = _path(late, 77.0 + 0.3 * (late - 84) + 0.002 * (late - 84) ** 2.0, 7.4)
    dark = np.arange(70, 110, 2)
    shadow = _path(dark, 50.0 + 1.8 * (dark - 70), 11.0)
    shadow.centre_px[:, 1] += 14.0
    choice = choose_ball([ball, striker, shadow], None)
    assert choice is not None
    assert choice.ball.radius == pytest.approx(12.0)
    assert not choice.reached


def test_a_panel_seen_at_rest_is_no_ball_beside_the_one_it_is_on() -> None:
    bob, ball = _swing_and_struck(40)
    frame = np.arange(0, 120, 2)
    time = np.maximum(frame - 36, 0.0)
    panel = _path(frame, 164.5 + 1.2 * time, 2.5)
    panel.centre_px[:, 1] = 97.0 - 0.9 * time + 0.012 * time**2
    choice = choose_ball([bob, ball, panel], None)
    assert choice is not None
    assert choice.ball.radius == 10.0


def test_a_shadow_that_lay_still_does_not_go_on_as_the_ball_beside_it() -> None:
    frame = np.arange(0, 80, 2)
    time = np.maximum(frame - 40, 0)
    mixed = _path(frame, 60.0 + 1.3 * time)
    mixed.centre_px[frame > 40, 1] = 30.0 - 0.2 * time[frame > 40]
    pieces = sorted(untangled([mixed]), key=lambda path: int(path.frame[0]))
    assert [int(piece.frame[0]) for piece in pieces] == [0, 42]


def test_a_ball_that_is_struck_while_it_is_hidden_stays_one() -> None:
    frame = np.concatenate([np.arange(0, 40, 2), np.arange(52, 80, 2)])
    paths = untangled([_path(frame, 60.0 + 1.9 * np.maximum(frame - 41, 0))])
    assert [len(path.frame) for path in paths] == [len(frame)]


def test_a_glint_that_comes_to_light_within_a_falling_ball_was_not_struck_by_it() -> None:
    def fall(frame: np.ndarray, radius: float) -> BallPath:
        path = _path(frame, np.full(len(frame), 160.0), radius)
        centre = np.column_stack([np.full(len(frame), 160.0), 40.0 + 0.016 * frame**2.0])
        return replace(
            path, centre_px=centre + np.random.default_rng(1).normal(0, 0.1, centre.shape)
        )

    ball, glint = fall(np.arange(0, 130), 37.0), fall(np.arange(134, 190), 2.5)
    choice = choose_ball([ball, glint], None)
    assert choice is not None
    assert choice.ball.radius == pytest.approx(37.0)
    assert not choice.reached


def _flight_and_shadow(larger: float, turn_rad: float) -> tuple[BallPath, BallPath]:
    """A ball seen from late in its flight on, and something that only dims the wall behind it.

    The ball's way on a wall, from a lamp, is `larger`; `turn_rad` turns it into another's.
    """
    frame = np.arange(0, 60, 2)
    way = np.column_stack([2.0 * frame, 0.01 * frame**2.0 - 0.4 * frame])
    noise = np.random.default_rng(5).normal(0.0, 0.1, (2, *way.shape))
    ball = _path(frame, np.zeros(len(frame)), 9.0)
    ball = replace(ball, centre_px=way + np.array([20.0, 40.0]) + noise[0])
    cosine, sine = larger * np.cos(turn_rad), larger * np.sin(turn_rad)
    cast = way @ np.array([[cosine, sine], [-sine, cosine]]) + np.array([35.0, 70.0])
    shadow = replace(
        ball,
        centre_px=cast + noise[1],
        sharpness=50.0 * np.ones(len(frame)),
        level=70.0 * np.ones(len(frame)),
    )
    pale = replace(ball, coverage=0.6 * np.ones(len(frame)), level=150.0 * np.ones(len(frame)))
    return pale, shadow


@pytest.mark.parametrize("larger", [1.0, 1.3])
def test_a_ball_s_shadow_is_not_the_ball_however_whole_its_outline(larger: float) -> None:
    ball, shadow = _flight_and_shadow(larger, 0.0)
    wall = np.full((200, 400), 110.0, dtype=np.float32)
    choice = choose_ball([ball, shadow], None, wall)
    assert choice is not None
    assert choice.ball.level[0] == ball.level[0]
    # neither what goes another way nor what is as dark as paint is a shadow
    for paint, turned in ((150.0, 0.6), (20.0, 0.0)):
        ball, other = _flight_and_shadow(larger, turned)
        other = replace(other, level=paint / 150.0 * 70.0 * np.ones(len(other.frame)))
        choice = choose_ball([ball, other], None, wall)
        assert choice is not None
        assert choice.ball.level[0] == other.level[0]


def test_what_goes_less_than_two_radii_by_a_law_may_be_the_ball() -> None:
    frame = np.arange(0, 40, 2)
    ball = _path(frame, 50.0 + 0.4 * frame, 10.0)
    glint = replace(ball, radius_px=2.5 * np.ones(len(frame)))
    noise = np.random.default_rng(6).normal(0.0, 0.1, ball.centre_px.shape)
    ball = replace(ball, centre_px=ball.centre_px + noise)
    choice = choose_ball([ball, glint], None)
    assert choice is not None
    assert choice.ball.radius == pytest.approx(10.0)


def _flies(frame: np.ndarray, left: int, start: tuple[float, float], larger: float) -> np.ndarray:
    """Rest until a frame and a flight from there, (N, 2); of a shadow the way on the wall."""
    gone = np.maximum(frame - left, 0.0)
    way = larger * np.column_stack([0.9 * gone, 0.0015 * gone**2 - 0.15 * gone])
    return np.array(start) + way


def _lying(
    first: int, last: int, start: tuple[float, float], larger: float = 1.0, level: float = 90.0
) -> BallPath:
    """What lies still and leaves by a law from frame 52 on, seen in some of the frames."""
    frame = np.arange(first, last, 2)
    made = _path(frame, frame, 12.0)
    noise = np.random.default_rng(first).normal(0.0, 0.2, (len(frame), 2))
    centre = _flies(frame, 52, start, larger) + noise
    return replace(made, centre_px=centre, level=np.full(len(frame), level))


def _fainter(path: BallPath, by: float) -> BallPath:
    return replace(path, coverage=by * path.coverage)


def test_a_ball_does_not_strike_its_own_shadow() -> None:
    # What lies still, too, and leaves with it lies close enough to be touched.
    ball, shadow = _fainter(_lying(0, 118, (75.0, 50.0)), 0.8), _lying(0, 118, (95.0, 74.0), 1.2)
    choice = choose_ball([ball, shadow], None)
    assert choice is not None
    assert choice.ball.centre_px[0, 1] == pytest.approx(50.0, abs=1.0)


def test_what_comes_up_as_the_shadow_of_what_lay_still_is_not_the_ball() -> None:
    # The shadow of what strikes, which is not seen itself, arrives where the ball's comes up.
    ball, shadow = _fainter(_lying(0, 102, (75.0, 50.0)), 0.66), _lying(70, 118, (60.0, 98.0), 1.3)
    frame = np.arange(0, 66, 2)
    striker = _fainter(_path(frame, 20.0 + 1.0 * frame, 11.0), 0.5)
    striker.centre_px[:, 1] = 105.0
    choice = choose_ball([ball, shadow, striker], None)
    assert choice is not None
    assert choice.ball.centre_px[0, 1] == pytest.approx(50.0, abs=1.0)


@pytest.mark.parametrize(("first", "last", "share"), [(0, 50, 0.66), (40, 38, 0.7)])
def test_of_two_that_lay_still_the_one_that_something_reached_is_the_ball(
    first: int, last: int, share: float
) -> None:
    # What reached it may be seen until it touches, or only until the ball is seen.
    ball, other = _fainter(_lying(first, 118, (75.0, 50.0)), share), _lying(0, 118, (75.0, 150.0))
    frame = np.arange(0, last, 2)
    striker = _fainter(_path(frame, 58.0 - 0.9 * (last - frame), 5.0), 0.5)
    choice = choose_ball([ball, other, striker], None)
    assert choice is not None
    assert choice.ball.centre_px[0, 1] == pytest.approx(50.0, abs=1.0)


def test_a_shadow_that_something_seems_to_reach_yields_to_the_ball_that_was_reached() -> None:
    ball, shadow = _fainter(_lying(0, 118, (75.0, 50.0)), 0.66), _lying(54, 118, (75.0, 110.0), 1.3)
    frame = np.arange(0, 50, 2)
    striker = _fainter(_path(frame, 13.0 + 0.9 * frame, 5.0), 0.5)
    its_shadow = replace(striker, centre_px=striker.centre_px + np.array([0.0, 60.0]))
    choice = choose_ball([ball, shadow, striker, its_shadow], None)
    assert choice is not None
    assert choice.ball.centre_px[0, 1] == pytest.approx(50.0, abs=1.0)


def test_what_is_lighter_than_the_wall_is_no_shadow_of_what_lay_still() -> None:
    wall = np.full((200, 400), 110.0, dtype=np.float32)
    ball = _fainter(_lying(48, 118, (75.0, 50.0), level=150.0), 0.7)
    shadow = _lying(0, 118, (75.0, 90.0), 1.3, level=75.0)
    frame = np.arange(0, 50, 2)
    striker = _fainter(_path(frame, 13.0 + 0.9 * frame, 5.0), 0.5)
    choice = choose_ball([ball, shadow, striker], None, wall)
    assert choice is not None
    assert choice.ball.level[0] == 150.0


def test_a_puck_that_is_smeared_on_its_way_struck_the_other_one_all_the_same() -> None:
    frame = np.arange(0, 120, 3)
    came = np.minimum(30.0 + 1.2 * frame, 30.0 + 1.2 * 90.0)
    striker = replace(_path(frame, came, 9.9), sharpness=np.full(len(frame), 4.0))
    left = np.maximum(frame - 90.0, 0.0)
    lying = _path(frame, 157.0 + 1.2 * left, 8.0)
    choice = choose_ball([striker, lying], None)
    assert choice is not None
    assert choice.ball.radius == pytest.approx(8.0)
    assert choice.struck
    length, sagitta = approach(choice.ball, choice.others[0])
    assert length > 90.0
    assert sagitta < 0.1
