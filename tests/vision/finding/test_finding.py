"""Objects painted with known places are detected, linked and selected."""

from dataclasses import replace

import numpy as np
import pytest

import vision
from metrology import NotFoundError
from tests.vision.ball.painted import (
    PaintedClip,
    PaintedColourClip,
    cover,
    exposed,
    wall,
    with_ball,
)
from vision.clip.footage import Footage
from vision.finding.detection import Detections, detect, searched_frames
from vision.finding.linking import (
    Tracklet,
    _going_on,
    _LinkMarks,
    _promised,
    link,
    link_parameters,
)
from vision.finding.selection import FEATURES, select, tracklet_features
from vision.scene import FilmedScene

HEIGHT, WIDTH = 140, 260


def _scene(clip: PaintedClip | PaintedColourClip) -> FilmedScene:
    return FilmedScene(Footage(clip))  # type: ignore[arg-type]


def _way(count: int, rest: int = 0) -> np.ndarray:
    time = np.maximum(np.arange(count) - rest, 0.0)
    return np.column_stack([40.0 + 3.0 * time, 80.0 - 2.5 * time + 0.05 * time**2])


def _flight(radius: float, count: int = 50, rest: int = 0) -> tuple[PaintedClip, np.ndarray]:
    places = _way(count, rest)
    pictures = [
        exposed(with_ball(wall(HEIGHT, WIDTH), (float(x), float(y)), radius, 0.5), 1.5, index)
        for index, (x, y) in enumerate(places)
    ]
    return PaintedClip(pictures), places


def _nearest(seen: Detections, places: np.ndarray) -> np.ndarray:
    """Distance of the nearest detection in each frame."""
    off = np.hypot(*(seen.centre_px - places[seen.frame]).T)
    return np.array([off[seen.frame == frame].min(initial=np.inf) for frame in range(len(places))])


@pytest.mark.parametrize("radius", [4.0, 9.0, 25.0])
def test_a_ball_of_any_size_is_detected_in_nearly_every_frame(radius: float) -> None:
    clip, places = _flight(radius)
    seen = detect(_scene(clip))
    whole = np.all((places > radius) & (places < np.array([WIDTH, HEIGHT]) - radius), axis=1)
    near = _nearest(seen, places)[whole] < 0.25 * radius + 0.5
    assert near.mean() > 0.95


def test_a_large_striped_ball_of_little_contrast_is_detected_in_noise() -> None:
    rng, size = np.random.default_rng(5), (180, 320)
    places = np.column_stack([60.0 + 3.0 * np.arange(60.0), np.full(60, 90.0)])
    down, along = np.mgrid[: size[0], : size[1]].astype(float)
    behind = np.where(((along // 12 + down // 12) % 2)[..., None] > 0, [118.0] * 3, [106.0] * 3)
    pictures = []
    for x, y in places:
        share = cover(*size, (float(x), float(y)), 27.0)[..., None]
        stripe = np.sin(0.5 * (along - x + 0.6 * (down - y)))[..., None] > 0.0
        ball = np.where(stripe, [70.0, 125.0, 135.0], [140.0, 140.0, 140.0])
        picture = (1.0 - share) * behind + share * ball + rng.normal(0.0, 6.0, (*size, 3))
        pictures.append(np.rint(np.clip(picture, 0, 255)).astype(np.uint8))
    near = _nearest(detect(_scene(PaintedColourClip(pictures))), places) < 3.0
    assert near.mean() > 0.9


def test_a_ball_at_rest_for_most_of_the_clip_is_detected_there_too() -> None:
    clip, places = _flight(9.0, count=80, rest=55)
    near = _nearest(detect(_scene(clip)), places) < 2.0
    assert near[:55].mean() > 0.95


def test_in_a_tall_picture_nothing_larger_than_its_width_is_detected() -> None:
    fall = np.column_stack([np.full(50, 30.0), 20.0 + 0.16 * np.arange(50.0) ** 2])
    pictures = [
        exposed(with_ball(wall(440, 60), (float(x), float(y)), 8.0, 0.5), 1.5, index)
        for index, (x, y) in enumerate(fall)
    ]
    seen = detect(_scene(PaintedClip(pictures)))
    assert (_nearest(seen, fall) < 2.0).mean() > 0.95
    assert seen.radius_px.max() < 30.0


def test_nothing_is_detected_in_noise() -> None:
    pictures = [exposed(wall(HEIGHT, WIDTH), 2.0, index) for index in range(30)]
    assert len(detect(_scene(PaintedClip(pictures)))) < 3


def test_a_ball_of_the_walls_lightness_is_detected_by_its_colour() -> None:
    places, pictures, rng = _way(50), [], np.random.default_rng(3)
    for x, y in places:
        share = cover(HEIGHT, WIDTH, (float(x), float(y)), 9.0)[..., None]
        # red and gray of nearly the same luma
        picture = (1.0 - share) * np.array([120.0, 120.0, 120.0]) + share * np.array([60, 110, 190])
        picture += rng.normal(0.0, 1.5, picture.shape)
        pictures.append(np.rint(picture).astype(np.uint8))
    near = _nearest(detect(_scene(PaintedColourClip(pictures))), places) < 2.0
    assert near.mean() > 0.9


def _detections(frame: list[int], places: np.ndarray, radius: float) -> Detections:
    count = len(frame)
    plain = np.ones(count)
    colour = np.full((count, 3), 90.0)
    return Detections(
        np.array(frame), places, radius * plain, plain, 20 * plain, colour, colour, 9 * plain, plain
    )


def _mixed(parts: list[Detections]) -> Detections:
    names = Detections.__annotations__
    every = Detections(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    return every.at(np.argsort(every.frame, kind="stable"))


def test_a_struck_ball_with_missed_frames_is_one_tracklet_among_strays() -> None:
    rng = np.random.default_rng(1)
    places = _way(60, rest=25)
    kept = np.setdiff1d(np.arange(60), [10, 11, 40])
    strays = [
        _detections([k] * 4, rng.uniform([0, 0], [WIDTH, HEIGHT], (4, 2)), 7.0) for k in range(60)
    ]
    ball = _detections(kept.tolist(), places[kept] + rng.normal(0, 0.2, (len(kept), 2)), 9.0)
    found = link(_mixed([ball, *strays]), np.arange(60), (HEIGHT, WIDTH))
    best = found[0]
    assert len(best) >= 55
    assert np.hypot(*(best.centre_px - places[best.frame]).T).max() < 2.0


@pytest.mark.parametrize("speed", [8.0, 24.0])
def test_a_ball_that_passes_what_lies_still_is_one_tracklet(speed: float) -> None:
    """What lies still is hidden from the frame on in which the ball has come to it."""
    rng = np.random.default_rng(3)
    time = np.arange(18.0)
    passing = np.column_stack([30.0 + speed * time, 60.0 + 0.1 * (time - 4.0) ** 2])
    ball = _detections(list(range(12, 30)), passing + rng.normal(0, 0.2, (18, 2)), 9.0)
    place = passing[7] + np.array([0.0, 8.0])
    still = _detections(list(range(20)), place + rng.normal(0, 0.2, (20, 2)), 9.0)
    found = link(_mixed([ball, still]), np.arange(30), (480, 640))
    moving = [one for one in found if np.ptp(one.centre_px[:, 0]) > 100.0]
    assert [len(one) for one in moving] == [18]
    assert np.hypot(*(moving[0].centre_px - passing[moving[0].frame - 12]).T).max() < 2.0


@pytest.mark.parametrize("side", [40, 400])
def test_no_tail_is_worth_more_than_it_promises(side: int) -> None:
    rng = np.random.default_rng(side)
    frames = np.arange(12)
    way = 0.5 * side + np.outer(frames, [0.4, -0.3])
    parts = [
        replace(
            _detections(frames.tolist(), way + rng.normal(0.0, 0.03, way.shape), 5.0),
            radius_px=rng.uniform(4.9, 5.1, 12),
        )
        for _ in range(6)
    ]
    seen = _mixed(parts)
    marks = _LinkMarks.of(seen, frames, (side, side), link_parameters())
    rows = [rng.permutation(np.flatnonzero(seen.frame == frame)) for frame in frames]
    for head, tail in rng.permutation(6)[:4].reshape(2, 2):
        one, other = (np.array([row[place] for row in rows]) for place in (head, tail))
        for stop in range(1, 11):
            worth = _going_on(one, stop, other, stop, marks)
            assert worth <= _promised(int(one[stop - 1]), int(other[stop]), marks) + 1e-9


def test_strays_alone_make_no_tracklet_worth_much() -> None:
    rng = np.random.default_rng(2)
    strays = [
        _detections([k] * 5, rng.uniform([0, 0], [WIDTH, HEIGHT], (5, 2)), 7.0) for k in range(60)
    ]
    found = link(_mixed(strays), np.arange(60), (HEIGHT, WIDTH))
    ball = link(_detections(list(range(60)), _way(60), 7.0), np.arange(60), (HEIGHT, WIDTH))
    assert max((one.log_odds for one in found), default=0.0) < 0.3 * ball[0].log_odds


def test_the_ball_is_selected_before_its_shadow() -> None:
    places, pictures = _way(60, rest=20), []
    for index, (x, y) in enumerate(places.tolist()):
        shade = cover(HEIGHT, WIDTH, (x + 14.0, y + 20.0), 10.0)
        light = wall(HEIGHT, WIDTH) * (1.0 - 0.35 * shade)
        pictures.append(exposed(with_ball(light, (x, y), 9.0, 0.5), 1.5, index))
    scene = _scene(PaintedClip(pictures))
    frames = searched_frames(scene)
    found = link(detect(scene), frames, scene.shape)
    chosen = select(found, len(frames), scene.shape)
    best: Tracklet = found[int(chosen.order[0])]
    assert np.median(np.hypot(*(best.centre_px - places[best.frame]).T)) < 1.5
    assert chosen.probability.sum() + chosen.none == pytest.approx(1.0)


def test_what_dims_the_scene_evenly_is_selected_less_than_its_twin() -> None:
    frames = list(range(60))
    ball = _detections(frames, _way(60), 9.0)
    shade = replace(
        _detections(frames, _way(60) + 45.0, 9.0), light=np.full(60, 0.6), evenness=np.ones(60)
    )
    found = [Tracklet(ball, 500.0), Tracklet(shade, 500.0)]
    chosen = select(found, 60, (HEIGHT, WIDTH))
    assert chosen.probability[0] > 3.0 * chosen.probability[1]


@pytest.mark.parametrize("same", [True, False])
def test_a_chain_goes_on_where_its_looks_do(same: bool) -> None:
    time = np.arange(30.0)
    early = _detections(list(range(30)), np.column_stack([60.0 + 2.0 * time, 90.0 + 0 * time]), 9.0)
    away = np.column_stack([122.0 + 0 * time, 90.0 - 4.0 * time])
    onward = _detections(list(range(30, 60)), away, 9.0 if same else 12.0)
    if not same:
        onward = replace(onward, colour=np.full((30, 3), 230.0))
    found = link(early.then(onward), np.arange(60), (HEIGHT, WIDTH))
    assert (len(found) == 1) is same


def test_of_two_alike_bodies_that_collide_the_one_at_rest_is_selected() -> None:
    rest, time = np.array([120.0, 60.0]), np.arange(60)
    # it rolls on more slowly after it struck the other, which leaves
    came = np.minimum(2.0 * time, 98.0 - 0.3 * 49.0 + 0.3 * time)
    striker = np.column_stack([3.0 + came, np.full(60, 60.0)])
    target = rest + np.column_stack([1.7 * np.maximum(time - 49.0, 0.0), np.zeros(60)])
    parts = [_detections(list(range(60)), places, 9.0) for places in (striker, target)]
    found = link(_mixed(parts), np.arange(60), (HEIGHT, WIDTH))
    chosen = found[int(select(found, 60, (HEIGHT, WIDTH)).order[0])]
    assert np.hypot(*(chosen.centre_px[0] - rest)) < 1.0
    alone = [one for one in found if one is not chosen]
    met = FEATURES.index("met")
    both = tracklet_features([chosen, *alone], 60, (HEIGHT, WIDTH))
    assert both[0, met] == 1.0
    assert not both[1:, met].any()
    assert tracklet_features([chosen], 60, (HEIGHT, WIDTH))[0, met] == 0.0


def test_a_table_that_was_corrected_by_hand_is_refined() -> None:
    clip, places = _flight(9.0)
    tracklets = vision.link(vision.detect(clip))
    order = vision.interpret(tracklets)
    assert order["probability"].sum() + order.attrs["none"] == pytest.approx(1.0)
    chosen = int(order["tracklet"][0])
    # a row that is moved by a radius is drawn back to the outline
    wrong = tracklets["tracklet"].eq(chosen) & tracklets["frame"].eq(20)
    tracklets.loc[wrong, "x_px"] += 4.0
    fitted = vision.refine(clip, tracklets, chosen)
    off = fitted[["x_px", "y_px"]].to_numpy() - places[fitted["frame"]]
    assert len(fitted) > 30
    assert np.median(np.hypot(*off.T)) < 0.1
    assert np.hypot(*off[fitted["frame"] == 20].T).max() < 0.5


def test_an_unknown_tracklet_and_an_empty_table_are_refused() -> None:
    clip, _ = _flight(9.0)
    tracklets = vision.link(vision.detect(clip))
    with pytest.raises(NotFoundError, match="no tracklet 99"):
        vision.refine(clip, tracklets, 99)
    with pytest.raises(NotFoundError, match="empty"):
        vision.link(tracklets.iloc[:0])
