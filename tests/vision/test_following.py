import csv
import re
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pandas as pd
import pytest

from bench.altered import WAYS, altered
from bench.cases import SHIPPED, shipped
from metrology import NotFoundError
from tests.shared_data import shared_folder
from tests.vision.ball.painted import (
    PIVOT_PX,
    PaintedClip,
    PaintedColourClip,
    bar,
    cover,
    exposed,
    struck_ball,
    wall,
    with_ball,
    with_box,
)
from vision.clip.clip import ClipReader
from vision.following import follow
from vision.tracks import MotionKind, Track, Tracks


@pytest.fixture(scope="module")
def struck() -> tuple[Tracks, np.ndarray, np.ndarray]:
    clip, centres, angles = struck_ball()
    return follow(clip, 600.0), centres, angles  # type: ignore[arg-type]


def test_the_struck_ball_is_followed_to_a_tenth_of_a_pixel(
    struck: tuple[Tracks, np.ndarray, np.ndarray],
) -> None:
    tracks, centres, _ = struck
    flight = tracks.ball.frame > 42
    error = tracks.ball.centre_px[flight] - centres[tracks.ball.frame[flight]]
    assert flight.sum() > 25
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_kinds_and_another_object_are_all_there_is(
    struck: tuple[Tracks, np.ndarray, np.ndarray],
) -> None:
    tracks, _, _ = struck
    assert tracks.found is not None
    shares = [part for _, part in tracks.motion.alternatives]
    assert sum(shares) + tracks.motion.probability == pytest.approx(tracks.found.probability)
    assert max(shares) <= tracks.motion.probability


def test_a_ball_is_one_before_and_after_frames_that_were_dropped() -> None:
    clip, truth, _ = struck_ball(100)
    lost = set(range(57, 74))
    left = np.setdiff1d(np.arange(100), sorted(lost))
    tracks = follow(clip.without(lost), 30.0)  # type: ignore[arg-type]
    ball = tracks.ball
    # the clip's own frames, none of them between two of it
    assert ball.frame[-1] >= 78
    assert np.all(np.isin(np.arange(46, 76), ball.frame))
    assert np.hypot(*(ball.centre_px - truth[left[ball.frame]]).T).max() < 0.4
    assert ball.time_s == pytest.approx(left[ball.frame] / 30.0)
    assert tracks.motion.kind is MotionKind.STRIKE
    assert tracks.rest_frames is not None
    assert tracks.rest_frames[1] == pytest.approx(40, abs=2)


def test_the_ball_is_found_at_rest_too(struck: tuple[Tracks, np.ndarray, np.ndarray]) -> None:
    tracks, centres, _ = struck
    assert tracks.rest_frames is not None
    assert tracks.rest_frames[0] <= 2
    assert 36 <= tracks.rest_frames[1] <= 41
    early = tracks.ball.frame < 30
    assert np.abs(tracks.ball.centre_px[early].mean(axis=0) - centres[0]).max() < 0.15


def test_the_pendulum_swings_about_its_pivot(struck: tuple[Tracks, np.ndarray, np.ndarray]) -> None:
    tracks, _, angles = struck
    pendulum = tracks.pendulum
    assert pendulum is not None
    assert pendulum.pivot_px == pytest.approx([60.0, 12.0], abs=2.5)
    near = np.abs(pendulum.track.frame - 40) < 20
    gap = pendulum.angle_rad[near] - angles[pendulum.track.frame[near]]
    assert np.std(gap) < 0.004


def test_what_was_struck_is_measured_though_a_larger_ball_rolls_past() -> None:
    clip, centres, _ = struck_ball()
    pictures = []
    for index, picture in enumerate(clip.pictures):
        part = cover(120, 240, (230.0 - 2.0 * index, 20.0), 18.0)
        pictures.append((picture * (1.0 - part)).astype(np.uint8))
    tracks = follow(PaintedClip(pictures), 600.0)  # type: ignore[arg-type]
    flight = tracks.ball.frame > 45
    away = np.hypot(*(tracks.ball.centre_px - centres[tracks.ball.frame]).T)
    assert np.median(away[flight]) < 0.3
    assert tracks.motion.kind is MotionKind.STRIKE


def test_of_two_balls_that_collide_the_one_at_rest_is_measured_though_less_clear() -> None:
    scene, pictures, places, hit = wall(90, 260), [], [], 80
    for index in range(92):
        came = 20.0 + 2.2 * min(index, hit) + 0.3 * max(index - hit, 0)
        rest = 20.0 + 2.2 * hit + 22.0 + 1.9 * max(index - hit, 0)
        light = with_ball(with_ball(scene, (came, 50.0), 11.0, 0.02), (rest, 50.0), 11.0, 0.45)
        pictures.append(exposed(light, 1.5, index))
        places.append(rest)
    tracks = follow(PaintedClip(pictures), 600.0)  # type: ignore[arg-type]
    off = tracks.ball.centre_px[:, 0] - np.array(places)[tracks.ball.frame]
    assert np.median(np.abs(off)) < 0.2
    assert tracks.motion.kind is MotionKind.COLLISION
    assert tracks.motion.probability > 0.8


def test_flicker_is_no_obstacle() -> None:
    clip, centres, _ = struck_ball(70, noise=3.0, flicker=0.15)
    ball = follow(clip, 600.0).ball  # type: ignore[arg-type]
    flight = ball.frame > 42
    error = ball.centre_px[flight] - centres[ball.frame[flight]]
    assert np.sqrt(np.mean(error**2)) < 0.15


def test_an_empty_scene_says_that_nothing_moves() -> None:
    still = PaintedClip([exposed(wall(80, 120), 1.5, seed) for seed in range(20)])
    with pytest.raises(NotFoundError, match="no ball found") as refused:
        follow(still, 600.0)  # type: ignore[arg-type]
    assert refused.value.hint is not None
    assert "--ball-at" in refused.value.hint


def test_pointing_beside_everything_is_refused() -> None:
    clip, _, _ = struck_ball(60)
    with pytest.raises(NotFoundError, match="nothing round passes"):
        follow(clip, 600.0, ball_at=(230.0, 5.0))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def two_balls() -> PaintedClip:
    scene = wall(100, 200)
    pictures = []
    for index in range(40):
        light = with_ball(scene, (20.0 + 4 * index, 30.0), 10.0)
        pictures.append(exposed(with_ball(light, (185.0 - 3 * index, 72.0), 9.0), 1.5, index))
    return PaintedClip(pictures)


def test_pointing_chooses_the_other_ball(two_balls: PaintedClip) -> None:
    ball = follow(two_balls, 600.0, ball_at=(125.0, 72.0, 20)).ball  # type: ignore[arg-type]
    assert abs(np.median(ball.centre_px[:, 1]) - 72.0) < 1.0


def test_of_two_like_balls_the_warning_points_at_the_other(two_balls: PaintedClip) -> None:
    tracks = follow(two_balls, 600.0)  # type: ignore[arg-type]
    said = re.search(r"--ball-at (\d+),(\d+),(\d+)", " ".join(tracks.warnings))
    assert said is not None
    x, y, frame = (int(group) for group in said.groups())
    other = 72.0 if np.median(tracks.ball.centre_px[:, 1]) < 50.0 else 30.0
    assert abs(y - other) < 2.0
    assert abs(x - (20.0 + 4 * frame if other == 30.0 else 185.0 - 3 * frame)) < 2.0
    row = np.searchsorted(tracks.others[0].track.frame, frame)
    assert abs(tracks.others[0].track.centre_px[row, 1] - other) < 1.0


def _truth(name: str, thing: str | None = None) -> np.ndarray:
    with (shared_folder("clips") / "truth" / f"{name}.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if thing is None or row["object"] == thing]
    return np.array([[float(row[key]) for key in ("frame", "x_px", "y_px")] for row in rows])


def _rms(track: Track, truth: np.ndarray) -> float:
    known = np.isin(truth[:, 0], track.frame)
    assert known.mean() > 0.9
    places = np.searchsorted(track.frame, truth[known, 0].astype(int))
    gap = track.centre_px[places] - truth[known, 1:]
    return float(np.sqrt(np.mean(np.sum(gap**2, axis=1))))


@pytest.mark.parametrize(
    ("file", "fps"),
    [
        ("projectile_A_canon240.mp4", 240.0),
        pytest.param("projectile_B_canon240.mp4", 240.0, marks=pytest.mark.slow),
        pytest.param("balltoss_480p30.mov", 29.97, marks=pytest.mark.slow),
    ],
)
def test_real_balls_are_followed_without_a_click(file: str, fps: float) -> None:
    tracks = follow(ClipReader.open(shared_folder("clips") / file), fps)
    assert _rms(tracks.ball, _truth(file.split(".")[0])) < 1.0


@pytest.mark.slow
def test_both_real_pucks_are_followed_and_the_struck_one_is_told() -> None:
    name = "puck_collision_A_canon240"
    tracks = follow(ClipReader.open(shared_folder("clips") / f"{name}.mp4"), 240.0)
    assert _rms(tracks.ball, _truth(name, "target")) < 1.0
    assert _rms(tracks.others[0].track, _truth(name, "striker")) < 1.0
    assert any("struck" in warning for warning in tracks.warnings)


@pytest.mark.slow
def test_still_frames_before_and_after_change_nothing() -> None:
    clip, _, _ = struck_ball(70)
    first, last = clip.pictures[0].astype(float), clip.pictures[-1].astype(float)
    rng = np.random.default_rng(3)

    def copies(picture: np.ndarray, count: int) -> list[np.ndarray]:
        noise = rng.normal(0.0, 1.0, (count, *picture.shape))
        return [np.clip(np.rint(picture + part), 0, 255).astype(np.uint8) for part in noise]

    padded = PaintedClip([*copies(first, 300), *clip.pictures, *copies(last, 150)])
    bare, found = follow(clip, 600.0), follow(padded, 30.0)  # type: ignore[arg-type]
    assert found.rest_frames is not None
    assert bare.rest_frames is not None
    assert found.rest_frames[1] - 300 == pytest.approx(bare.rest_frames[1], abs=1)
    assert found.pendulum is not None
    _, own, theirs = np.intersect1d(found.ball.frame - 300, bare.ball.frame, return_indices=True)
    assert len(own) > 0.95 * len(bare.ball)
    gap = found.ball.centre_px[own] - bare.ball.centre_px[theirs]
    assert np.sqrt(np.mean(gap**2)) < 0.12


@pytest.mark.slow
def test_a_falling_ball_is_followed_to_the_floor_though_the_last_looks_were_at_its_lamp() -> None:
    """The last circles linked are of the lamp's glint: the ball goes on 13 px below them."""
    folder = shared_folder("clips")
    truth = np.genfromtxt(folder / "truth" / "freefall_phantom1000.csv", delimiter=",", names=True)
    ball = follow(ClipReader.open(folder / "freefall_phantom1000.mp4"), 1000.0).ball
    seen = np.isin(truth["frame"], ball.frame)
    assert seen.sum() >= 0.9 * len(truth)
    rows = np.searchsorted(ball.frame, truth["frame"][seen])
    off = np.hypot(
        ball.centre_px[rows, 0] - truth["x_px"][seen], ball.centre_px[rows, 1] - truth["y_px"][seen]
    )
    assert np.mean(off < 1.5) >= 0.9


def test_a_ball_that_lies_still_for_most_of_a_clip_is_followed_from_the_first_frame() -> None:
    # It is part of the static scene for its 40 frames of rest, and partly still when it has left.
    clip, centres, _ = struck_ball(64)
    tracks = follow(clip, 30.0)  # type: ignore[arg-type]
    assert tracks.ball.frame[0] == 0
    assert len(tracks.ball.frame) == 64
    assert tracks.rest_frames == (0, 40)
    assert np.hypot(*(tracks.ball.centre_px - centres).T).max() < 0.1


def _pale_ball(seed: int) -> tuple[PaintedClip, np.ndarray]:
    """A ball of the wall's lightness, which lies for nearly half of the clip and leaves slowly."""
    scene, radius, rest = wall(120, 240), 13.0, np.array([81.0, 74.0])
    pictures, centres = [], []
    for index in range(100):
        time = (index - 45.0) / 3.0
        angle = (0.03 if time < 0 else 0.022) * time
        flown = max(time, 0.0)
        centre = rest + np.array([2.3 * flown, -0.9 * flown + 0.015 * flown**2])
        x, y = centre.tolist()
        shadow = cv2.GaussianBlur(cover(120, 240, (x + 9.0, y + 13.0), radius), (0, 0), 2.0)
        light = with_box(scene * (1.0 - 0.35 * shadow), (60.0, 12.0), 62.0, angle, 8.0, 0.0, 8.0)
        light = with_ball(light, (x, y), radius, 0.75)
        pictures.append(exposed(light, 1.0, index + 1000 * seed))
        centres.append(centre)
    return PaintedClip(pictures), np.array(centres)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_ball_that_lay_for_about_as_long_as_it_is_gone_is_told_from_a_patchwork_of_both(
    seed: int,
) -> None:
    clip, centres = _pale_ball(seed)
    ball = follow(clip, 600.0).ball  # type: ignore[arg-type]
    gone = ball.frame >= 45
    off = np.hypot(*(ball.centre_px - centres[ball.frame]).T)[gone]
    assert len(off) >= 40
    assert np.mean(off < 3.0) >= 0.9


def _hard_to_see(half: float, radius: float) -> tuple[PaintedColourClip, np.ndarray]:
    """A mass of the wall's lightness, which only its colour shows, strikes; centres of the mass."""
    scene, arm, middles = wall(120, 240), 62.0, []
    pivot, pictures = np.array(PIVOT_PX), []
    rest = pivot + np.array([half + radius, arm])
    # blue, green, red: by the weights of gray they cancel
    colour = np.array([0.0, 25.5, -50.0])
    for index in range(80):
        time = index - 40.0
        angle = (0.03 if time < 0 else 0.022) * time
        flown = max(time, 0.0)
        x, y = (rest + np.array([2.3 * flown, -0.9 * flown + 0.015 * flown**2])).tolist()
        gray = exposed(with_ball(scene, (x, y), radius), 1.0, index).astype(float)
        mass = bar(scene.shape, (pivot[0], pivot[1]), arm, angle, half, (-half, half))
        ball = cover(120, 240, (x, y), radius)
        picture = gray[..., None] + (mass * (1.0 - ball))[..., None] * colour
        pictures.append(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
        middles.append(pivot + arm * np.array([np.sin(angle), np.cos(angle)]))
    return PaintedColourClip(pictures), np.array(middles)


def test_a_mass_of_the_walls_lightness_is_followed_by_its_colour() -> None:
    clip, middles = _hard_to_see(8.0, 11.0)
    pendulum = follow(clip, 600.0).pendulum  # type: ignore[arg-type]
    assert pendulum is not None
    frame = pendulum.track.frame
    assert np.count_nonzero(frame < 40) > 20
    off = pendulum.track.centre_px - middles[frame]
    assert np.hypot(*(off - off.mean(axis=0)).T).max() < 1.0


def test_a_mass_that_is_small_beside_the_ball_is_followed() -> None:
    scene, half, radius, arm = wall(160, 280), 3.0, 24.0, 62.0
    pivot = np.array([70.0, 20.0])
    rest = pivot + np.array([half + radius, arm])
    pictures, angles = [], []
    for index in range(80):
        time = index - 40.0
        angles.append((0.03 if time < 0 else 0.022) * time)
        flown = max(time, 0.0)
        x, y = (rest + np.array([2.3 * flown, -0.9 * flown + 0.015 * flown**2])).tolist()
        light = with_box(scene, (pivot[0], pivot[1]), arm, angles[-1], half)
        pictures.append(exposed(with_ball(light, (x, y), radius), 1.0, index))
    pendulum = follow(PaintedClip(pictures), 600.0).pendulum  # type: ignore[arg-type]
    assert pendulum is not None
    assert pendulum.pivot_px == pytest.approx(pivot, abs=6.0)
    turned = pendulum.angle_rad - np.array(angles)[pendulum.track.frame]
    assert np.abs(turned - np.median(turned)).max() < 0.05


@pytest.mark.slow
def test_a_ball_seen_in_two_parts_in_gray_is_followed_by_its_colour() -> None:
    name = "orange_ball_bounce"
    tracks = follow(ClipReader.open(shared_folder("clips") / f"{name}.mp4"), 30.0)
    # marked by eye, to 1.5 px; in gray six of them were lost or 7 to 14 px off
    assert _rms(tracks.ball, _truth(name)) < 3.0
    assert tracks.motion is not None
    assert tracks.motion.kind is MotionKind.FLIGHT


def test_a_mass_that_hangs_for_long_where_most_frames_show_it_is_followed() -> None:
    # It moves by less than its width: most frames show a patchwork of it, the first show it whole.
    scene, half, radius, arm, rate = wall(140, 260), 14.0, 13.0, 62.0, 0.0045
    pivot, pictures, angles = np.array([70.0, 12.0]), [], []
    rest = pivot + np.array([half + radius, arm])
    for index in range(100):
        time = index - 60.0
        angles.append((rate if time < 0 else 0.6 * rate) * time)
        flown, speed = max(time, 0.0), rate * arm
        way = [1.6 * speed * flown, -0.3 * speed * flown + 0.004 * flown**2]
        x, y = (rest + np.array(way)).tolist()
        light = with_box(scene, (pivot[0], pivot[1]), arm, angles[-1], half)
        pictures.append(exposed(with_ball(light, (x, y), radius), 1.0, index))
    pendulum = follow(PaintedClip(pictures), 600.0).pendulum  # type: ignore[arg-type]
    assert pendulum is not None
    frame = pendulum.track.frame
    assert np.count_nonzero(frame < 60) > 50
    turned = pendulum.angle_rad - np.array(angles)[frame]
    assert np.abs(turned - np.median(turned)).max() < 0.05


@pytest.mark.parametrize(("bob", "dark"), [(5.0, 0.35), (7.0, 0.6)])
def test_the_pivot_of_a_bob_that_is_followed_with_its_shadow_is_as_unsure_as_its_middle(
    bob: float, dark: float
) -> None:
    # Both keep their looks and their distance, so that one round thing seems to swing.
    scene, radius, arm, pivot = wall(150, 260), 15.0, 68.0, np.array([60.0, 12.0])
    rest, pictures = pivot + np.array([bob + radius, arm - 3.0]), []
    for index in range(100):
        time = index - 50.0
        flown, angle = max(time, 0.0), (0.011 if time < 0 else 0.008) * time
        middle = pivot + arm * np.array([np.sin(angle), np.cos(angle)])
        x, y = (middle + np.array([4.6, 5.7])).tolist()
        light = scene * (1.0 - dark * cover(150, 260, (x, y), bob))
        x, y = middle.tolist()
        covered = cover(150, 260, (x, y), bob)
        x, y = (rest + np.array([1.3 * flown, -0.35 * flown + 0.004 * flown**2])).tolist()
        light = with_ball(light * (1.0 - covered) + 0.3 * covered, (x, y), radius)
        pictures.append(exposed(light, 1.5, index))
    pendulum = follow(PaintedClip(pictures), 600.0).pendulum  # type: ignore[arg-type]
    assert pendulum is not None
    off = pendulum.pivot_px - pivot
    assert np.hypot(*off) > 3.0
    assert np.all(np.abs(off) < 1.5 * np.sqrt(np.diag(pendulum.pivot_covariance_px2)))


def test_a_small_ball_in_a_padded_picture_is_followed_and_not_its_clearer_shadow(
    tmp_path: Path,
) -> None:
    small = shipped(SHIPPED / "jokku_90_small.truth.json")
    padded = next(way for way in WAYS if way.name == "padded")
    whole = follow(ClipReader.open(small.path), 600.0).ball
    ball = follow(ClipReader.open(altered(small, padded, tmp_path).path), 600.0).ball
    _, here, there = np.intersect1d(ball.frame, whole.frame, return_indices=True)
    assert len(here) > 0.95 * len(whole)
    # the bars are cut off when the clip is opened
    off = ball.centre_px[here] - whole.centre_px[there]
    assert np.median(np.hypot(*off.T)) < 0.3


@pytest.mark.slow
def test_where_nothing_of_a_hand_moves_as_one_body_the_pucks_are_followed() -> None:
    name = "puck_collision_C_canon240"
    ball = follow(ClipReader.open(shared_folder("clips") / f"{name}.mp4"), 240.0).ball
    marks = pd.read_csv(shared_folder("clips") / "truth" / f"{name}.csv")
    off = [
        np.hypot(*(ball.centre_px[ball.frame == row.frame] - [row.x_px, row.y_px]).T)
        for row in marks.itertuples()
    ]
    near = np.array([one.min() for one in off if len(one)])
    # of two marked pucks one is the measured one
    assert np.sum(near < 2.0) >= 0.4 * len(near)


def test_a_puck_that_came_straight_is_no_pendulum_though_a_hand_bends_its_way(
    tmp_path: Path,
) -> None:
    clip = ClipReader.open(shared_folder("clips") / "puck_collision_B_canon240.mp4")
    path = tmp_path / "dimmed.mp4"
    with av.open(str(path), "w") as container:
        # one thread: what the encoder leaves is the same each time
        options = {"crf": "16", "threads": "1"}
        stream = container.add_stream("libx264", rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for index, image in clip.colour_frames(0, None):
            dim = (255.0 * 0.6 * (image / 255.0) ** 1.4).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(dim, format="bgr24").reformat(format="yuv420p")
            frame.pts, frame.time_base = index, Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    tracks = follow(ClipReader.open(path), 240.0)
    assert tracks.pendulum is None
    # of eight copies, dimmed by 59 to 61 %, three are a roll: what hit it rolls
    assert tracks.motion.kind in (MotionKind.COLLISION, MotionKind.ROLL)
