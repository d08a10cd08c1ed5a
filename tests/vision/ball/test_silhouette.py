"""Things that gray does not show: painted in colour, with their true places known."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedClip, PaintedColourClip, cover, wall
from vision.ball.choice import BallPath
from vision.ball.silhouette import follow_silhouette, moving_colours
from vision.clip.footage import Footage
from vision.following import follow
from vision.scene import FilmedScene

HEIGHT, WIDTH, RADIUS = 160, 220, 17.0
BROWN, RED, PALE = (0.42, 0.55, 0.68), (0.25, 0.30, 1.0), (0.72, 0.82, 0.9)
Colour = tuple[float, float, float]


def _picture(
    layers: list[tuple[NDArray[np.float64], Colour]], dimmed: NDArray[np.float64], seed: int
) -> NDArray[np.uint8]:
    """Layers of (cover, colour) before a brown wall, some of it in the shade."""
    light = wall(HEIGHT, WIDTH)[:, :, None] * np.array(BROWN) * (1.0 - 0.4 * dimmed[:, :, None])
    for part, colour in layers:
        light = light * (1.0 - part[:, :, None]) + part[:, :, None] * np.array(colour) * 0.6
    noise = np.random.default_rng(seed).normal(0.0, 1.2, light.shape)
    return np.clip(255.0 * light + noise, 0, 255).astype(np.uint8)


def _thrown() -> NDArray[np.float64]:
    time = np.arange(26.0)
    return np.column_stack([25.0 + 6.5 * time, 118.0 - 8.0 * time + 0.30 * time**2])


def _knotted(place: NDArray[np.float64], turn: float, seed: int) -> NDArray[np.uint8]:
    """A red ball as light as the wall, in a bag with a pale knot, and the shadow of both."""
    x, y = place
    knot = np.zeros((HEIGHT, WIDTH))
    tip = (x + 1.7 * RADIUS * np.sin(turn), y - 1.7 * RADIUS * np.cos(turn))
    ends = [(round(x), round(y)), (round(tip[0]), round(tip[1]))]
    cv2.line(knot, ends[0], ends[1], 1.0, 9)
    shade = cover(HEIGHT, WIDTH, (x + 14.0, y + 9.0), RADIUS)
    shade = np.asarray(cv2.GaussianBlur(shade, (0, 0), 2.0))
    ball = cover(HEIGHT, WIDTH, (x, y), RADIUS)
    return _picture([(knot, PALE), (ball, RED)], shade, seed)


def test_a_ball_as_light_as_the_wall_is_followed_by_its_colour_and_not_by_knot_and_shadow() -> None:
    places, empty = _thrown(), np.zeros((HEIGHT, WIDTH))
    pictures = [_picture([], empty, seed) for seed in range(8)]
    pictures += [_knotted(place, 0.1 * k, 20 + k) for k, place in enumerate(places)]
    tracks = follow(PaintedColourClip(pictures), 30.0)  # type: ignore[arg-type]
    ball = tracks.ball
    known = (ball.frame >= 8) & (ball.frame < 8 + len(places))
    off = ball.centre_px[known] - places[ball.frame[known] - 8]
    std = np.sqrt(0.5 * np.trace(ball.covariance_px2[known], axis1=1, axis2=2))
    assert known.sum() >= 0.9 * len(places)
    assert np.hypot(*off.T).max() < 1.5
    assert np.mean(np.hypot(*off.T) < 2.5 * std) > 0.9
    assert any("colour" in warning for warning in tracks.warnings)


def test_a_hand_that_holds_the_ball_is_no_part_of_it() -> None:
    # Hand and ball are one patch of about one colour until it lets go.
    fallen = np.maximum(np.arange(26.0) - 10.0, 0.0)
    places = np.column_stack([np.full(26, 90.0) + 2.0 * fallen, 40.0 + 0.45 * fallen**2])
    empty = np.zeros((HEIGHT, WIDTH))
    pictures = [_picture([], empty, seed) for seed in range(12)]
    for k, place in enumerate(places):
        ball = cover(HEIGHT, WIDTH, (place[0], place[1]), RADIUS)
        back = 3.0 * max(k - 10, 0)
        hand = cover(HEIGHT, WIDTH, (82.0 - 4.0 * back + 0.8 * min(k, 10), 34.0), 1.6 * RADIUS)
        pictures.append(_picture([(hand, RED), (ball, RED)], empty, 30 + k))
    scene = FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]
    blueness, redness = moving_colours(scene)[0]
    tinted = scene.tinted(float(blueness), float(redness))
    frame = np.arange(26, 36, 2)
    full = np.ones(len(frame))
    path = BallPath(frame, places[frame - 12], RADIUS * full, full, 60.0 * full, full, 90.0 * full)
    found = follow_silhouette(tinted, path)
    off = np.hypot(*(found.centre - places[found.frame - 12]).T)
    assert found.frame[0] >= 22
    assert np.median(off) < 0.5
    assert np.abs(np.log(found.radius / RADIUS)).max() < 0.25


def test_a_circle_is_laid_through_the_arc_that_a_bar_leaves_in_view() -> None:
    time = np.arange(26.0)
    places = np.column_stack([25.0 + 6.5 * time, np.full(26, 80.0)])
    empty, bar = np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH))
    bar[88:120] = 1.0
    dark = (0.5, 0.45, 0.3)
    pictures = [_picture([(bar, dark)], empty, seed) for seed in range(8)]
    for k, place in enumerate(places):
        ball = cover(HEIGHT, WIDTH, (place[0], place[1]), RADIUS)
        pictures.append(_picture([(ball, RED), (bar, dark)], empty, 30 + k))
    scene = FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]
    blueness, redness = moving_colours(scene)[0]
    looks, plain = np.arange(10, 34, 3), np.ones(8)
    path = BallPath(looks, places[looks - 8], RADIUS * plain, plain, plain, plain, plain)
    found = follow_silhouette(scene.tinted(blueness, redness), path)
    known = (found.frame >= 8) & (found.frame < 34)
    off = found.centre[known] - places[found.frame[known] - 8]
    assert known.sum() >= 20
    # the middle of what is seen lies 4 px higher
    assert np.abs(np.median(off, axis=0)).max() < 1.0


@pytest.mark.parametrize("bar", [None, 111.0])
def test_an_outline_is_halfway_where_the_ball_is_paler(bar: float | None) -> None:
    radius, time = 20.0, np.arange(20.0)
    places = np.column_stack([30.0 + 11.0 * time, np.full(20, 100.0)])
    y = np.mgrid[0:160, 0:290][0].astype(float)
    wall_ = np.where(y[:, :, None] < 105.0, np.array(BROWN) * 0.5, np.array([0.6, 0.62, 0.63]))

    def painted(place: NDArray[np.float64] | None, seed: int) -> NDArray[np.uint8]:
        light = wall_.copy()
        if place is not None:
            pale = 0.5 * np.clip((place[1] - y) / radius, 0.0, 1.0)[:, :, None]
            part = cover(160, 290, (place[0], place[1]), radius)[:, :, None]
            ball = np.array([0.2, 0.5, 0.95]) * (1.0 - pale) + np.array(PALE) * pale
            light = light * (1.0 - part) + part * ball
        if bar is not None:
            light[y > bar] = 0.5, 0.2, 0.2
        light = 255.0 * cv2.GaussianBlur(light, (0, 0), 0.7)
        noise = np.random.default_rng(seed).normal(0.0, 1.5, light.shape)
        return np.clip(light + noise, 0, 255).astype(np.uint8)

    pictures = [painted(None, seed) for seed in range(8)]
    pictures += [painted(place, 30 + k) for k, place in enumerate(places)]
    scene = FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]
    blueness, redness = moving_colours(scene)[0]
    plain = np.ones(20)
    path = BallPath(8 + time.astype(int), places, radius * plain, plain, plain, plain, plain)
    found = follow_silhouette(scene.tinted(blueness, redness), path)
    known = (found.frame >= 8) & (found.frame < 28)
    off = found.centre[known] - places[found.frame[known] - 8]
    assert known.sum() >= 18
    # half of the change in the ball's middle is seen 0.5 px lower, and 0.9 px above the bar
    assert np.abs(np.mean(off, axis=0)).max() < 0.3


def _off(pictures: list[NDArray[np.uint8]], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far off the ball is followed, px, in frames from the eighth on in which it is."""
    ball = follow(PaintedColourClip(pictures), 30.0).ball  # type: ignore[arg-type]
    known = (ball.frame >= 8) & (ball.frame < 8 + len(places))
    return np.asarray(np.hypot(*(ball.centre_px[known] - places[ball.frame[known] - 8]).T))


def _casting(colour: Colour | None) -> tuple[list[NDArray[np.uint8]], NDArray[np.float64]]:
    """A ball as light as the wall before it, or none, and a sharp shadow beside it."""
    places, empty = _thrown(), np.zeros((HEIGHT, WIDTH))
    pictures = [_picture([], empty, seed) for seed in range(8)]
    for k, (x, y) in enumerate(places):
        shade = cover(HEIGHT, WIDTH, (1.08 * x + 24.0, y + 22.0), 1.1 * RADIUS)
        layers = [] if colour is None else [(cover(HEIGHT, WIDTH, (x, y), RADIUS), colour)]
        pictures.append(_picture(layers, shade, 20 + k))
    return pictures, places


def test_of_a_ball_that_only_colour_shows_the_shadow_is_not_taken_for_it() -> None:
    pictures, places = _casting((0.30, 0.62, 1.07))
    off = _off(pictures, places)
    assert len(off) >= 0.8 * len(places)
    assert np.median(off) < 1.5


def test_a_shadow_of_what_nothing_shows_is_said_to_look_like_one() -> None:
    pictures, _ = _casting(None)
    tracks = follow(PaintedColourClip(pictures), 30.0)  # type: ignore[arg-type]
    assert any("as a shadow does" in warning for warning in tracks.warnings)
    assert tracks.maybe_shadow
    knotted = [_picture([], np.zeros((HEIGHT, WIDTH)), seed) for seed in range(8)]
    knotted += [_knotted(place, 0.1 * k, 20 + k) for k, place in enumerate(_thrown())]
    tracks = follow(PaintedColourClip(knotted), 30.0)  # type: ignore[arg-type]
    assert not any("as a shadow does" in warning for warning in tracks.warnings)
    assert not tracks.maybe_shadow


def test_what_hardly_moves_in_gray_is_not_taken_for_a_ball_that_flies_in_colour() -> None:
    places, empty = _thrown(), np.zeros((HEIGHT, WIDTH))
    pictures = [_picture([], empty, seed) for seed in range(8)]
    for k, (x, y) in enumerate(places):
        ball = cover(HEIGHT, WIDTH, (x, y), RADIUS)
        creeping = cover(HEIGHT, WIDTH, (30.0 + 0.7 * k, 140.0), 8.0)
        layers = [(ball, (0.30, 0.62, 1.07)), (creeping, (0.2, 0.2, 0.2))]
        pictures.append(_picture(layers, empty, 20 + k))
    off = _off(pictures, places)
    assert len(off) >= 0.8 * len(places)
    assert np.median(off) < 1.5


def test_a_coloured_panel_is_not_the_ball_that_carries_it() -> None:
    time = np.arange(26.0)
    places = np.column_stack([45.0 + 5.0 * time, np.full(26, 80.0)])
    empty, pale = np.zeros((HEIGHT, WIDTH)), (0.80, 0.80, 0.80)
    pictures = [_picture([], empty, seed) for seed in range(8)]
    for k, (x, y) in enumerate(places):
        ball = cover(HEIGHT, WIDTH, (x, y), 40.0)
        panel = cover(HEIGHT, WIDTH, (x - 8.0, y - 5.0), 15.0)
        pictures.append(_picture([(ball, pale), (panel, RED)], empty, 30 + k))
    scene = FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]
    tinted = scene.tinted(0.0, 1.0)
    looks, plain = np.arange(10, 34, 3), np.ones(8)

    def followed(radius: float) -> int:
        path = BallPath(looks, places[looks - 8], radius * plain, plain, plain, plain, plain)
        return len(follow_silhouette(tinted, path))

    # whoever looks for the panel finds it
    assert followed(15.0) >= 20
    assert followed(40.0) == 0


def test_gray_clips_have_no_colour_to_look_in() -> None:
    pictures = [np.full((HEIGHT, WIDTH), 90, np.uint8) for _ in range(12)]
    for k, picture in enumerate(pictures):
        cv2.circle(picture, (20 + 14 * k, 80), 15, 200, -1)
    scene = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    assert moving_colours(scene) == []


@pytest.mark.parametrize("light", [0.3, 1.0])
def test_a_shadow_has_no_colour(light: float) -> None:
    gray = np.full((64, 64, 3), 200.0 * light).astype(np.uint8)
    pictures = [gray.copy() for _ in range(8)]
    pictures[4][20:40, 20:40] //= 2
    footage = Footage(PaintedColourClip(pictures)).tinted(0.6, 0.8)  # type: ignore[arg-type]
    for _, picture in footage.frames(np.arange(footage.count)):
        assert np.abs(picture.astype(float) - 128.0).max() <= 1.0
