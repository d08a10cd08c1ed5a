"""One shape for a whole clip, learnt from the outlines that are the ball's."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.shared_data import shared_folder
from tests.vision.ball.painted import (
    PIVOT_PX,
    PaintedClip,
    cover,
    exposed,
    struck_ball,
    wall,
    with_ball,
)
from vision.ball.ball import BallFits, _of_one_size, follow_ball
from vision.ball.edges import Hides
from vision.ball.outline import nothing_found
from vision.ball.path import BallPath
from vision.ball.refine import _between, _evenly, _lowest, _Refiner, _unrest, refine_ball
from vision.clip.clip import ClipReader
from vision.clip.footage import Footage
from vision.following import follow
from vision.scene import FilmedScene

FRAMES = 20


def _rough(radius: np.ndarray, contrast: np.ndarray) -> SimpleNamespace:
    centre = np.column_stack([np.arange(FRAMES) * 3.0, np.full(FRAMES, 50.0)])
    return SimpleNamespace(
        frame=np.arange(FRAMES),
        centre=centre,
        radius=radius,
        fits=SimpleNamespace(contrast=contrast),
    )


def test_outlines_of_another_size_teach_nothing() -> None:
    radius = np.full(FRAMES, 12.0)
    radius[[4, 5, 16]] = 16.0, 8.0, 13.5
    refiner = _Refiner(None, _rough(radius, np.ones(FRAMES)), 12.0, None)  # type: ignore[arg-type]
    assert set(refiner.clear) == set(range(FRAMES)) - {4, 5, 16}


def test_outlines_that_are_half_hidden_teach_nothing() -> None:
    contrast = np.ones(FRAMES)
    contrast[7:10] = 0.6
    rough = _rough(np.full(FRAMES, 12.0), contrast)
    refiner = _Refiner(None, rough, 12.0, None)  # type: ignore[arg-type]
    assert set(refiner.clear) == set(range(FRAMES)) - {7, 8, 9}


def test_where_hardly_any_is_clear_all_are_taken() -> None:
    radius = np.linspace(5.0, 30.0, FRAMES)
    refiner = _Refiner(None, _rough(radius, np.ones(FRAMES)), 12.0, None)  # type: ignore[arg-type]
    assert len(refiner.clear) >= 3


def test_the_bottom_of_a_parabola_is_found_between_what_was_tried() -> None:
    values = np.array([0.3, 0.5, 0.7, 0.9])
    assert _lowest(values, (values - 0.63) ** 2) == pytest.approx(0.63)
    assert _lowest(values, values) == 0.3
    # which of two values that fit alike is the lower is left to rounding
    misfit = (values - 0.5 * (values[0] + values[1])) ** 2
    nudge = 1e-12 * np.eye(len(values))
    assert _lowest(values, misfit + nudge[0]) == pytest.approx(_lowest(values, misfit + nudge[1]))


def test_motion_of_second_order_is_no_unrest() -> None:
    time = np.arange(FRAMES, dtype=float)
    smooth = np.column_stack([2.0 * time, 50.0 + 0.3 * time**2])
    fits = SimpleNamespace(frame=np.arange(FRAMES), centre=smooth)
    assert _unrest(fits) == pytest.approx(0.0, abs=1e-9)  # type: ignore[arg-type]
    noisy = smooth + np.random.default_rng(3).normal(0.0, 0.1, smooth.shape)
    # third differences of white noise scatter by the root of 1 + 9 + 9 + 1
    fits = SimpleNamespace(frame=np.arange(FRAMES), centre=noisy)
    assert _unrest(fits) == pytest.approx(1.15 * 0.1 * np.sqrt(20.0), rel=0.35)  # type: ignore[arg-type]


def test_frames_are_taken_evenly() -> None:
    taken = _evenly(np.arange(100), 5)
    assert len(taken) == 5
    assert taken[0] == 0
    assert taken[-1] == 99


def test_two_fits_meet_midway_and_their_distance_is_stated() -> None:
    one, other = nothing_found(3), nothing_found(2)
    other.centre[:] = [[0.2, 0.0], [0.0, -0.4]]
    both = _between(BallFits(np.array([4, 5, 6]), one), BallFits(np.array([5, 6]), other))
    assert both.centre == pytest.approx(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, -0.2]]))
    std = np.sqrt(np.diagonal(both.fits.covariance, axis1=1, axis2=2))
    assert std == pytest.approx(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.2]]))


def _seamed(
    light: NDArray[np.float64], centre: tuple[float, float], radius: float
) -> NDArray[np.float64]:
    """Put a ball with dark seams before a scene."""
    y, x = np.mgrid[0 : light.shape[0], 0 : light.shape[1]].astype(float)
    x, y = (x - centre[0]) / radius, (y - centre[1]) / radius
    rings = [np.hypot(x - 1.1, y + 0.9) - 1.0, np.hypot(x + 1.1, y - 0.9) - 1.0]
    seam = np.abs(np.array([0.8 * x + 0.6 * y - 0.1, 0.6 * x - 0.8 * y, *rings])).min(axis=0)
    part = cover(*light.shape, centre, radius)
    ball = with_ball(light, centre, radius, 0.75)
    return np.asarray(ball * (1.0 - 0.88 * part * (seam < 0.025)))


def test_seams_and_lines_do_not_draw_the_outline_of_a_ball_that_fills_the_picture() -> None:
    radius, count = 140.0, 10
    scene = wall(448, 700, 31.0)
    time = np.arange(count)
    places = np.column_stack([1.3 * radius + 17.0 * time, 1.6 * radius - 4.0 * time])
    pictures = [exposed(scene, 1.0, seed) for seed in range(8)]
    for seed, (x, y) in enumerate(places, 20):
        pictures.append(exposed(_seamed(scene, (float(x), float(y)), radius), 1.0, seed))
    filmed = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    # circles of edges are looked for in small pictures, and are off by some px of a large one
    off = np.random.default_rng(140).normal(0.0, 0.04 * radius, places.shape)
    plain = np.ones(count)
    path = BallPath(8 + time, places + off, 1.02 * radius * plain)
    found = follow_ball(filmed, path)
    away = np.hypot(*(found.centre - places[found.frame - 8]).T)
    assert len(found) == count
    assert away.max() < 0.15
    assert np.abs(found.radius - radius).max() < 0.15


def _spotted(
    light: NDArray[np.float64], centre: tuple[float, float], radius: float, turn: float
) -> NDArray[np.float64]:
    """Put a white ball with dark round panels, turned by an angle, before a scene."""
    y, x = np.mgrid[0 : light.shape[0], 0 : light.shape[1]].astype(float)
    x, y = (x - centre[0]) / radius, (y - centre[1]) / radius
    z = np.sqrt(np.clip(1.0 - x * x - y * y, 0.0, 1.0))
    dark = np.zeros(light.shape, dtype=bool)
    for tilt in (-0.8, 0.1, 0.8):
        for round_ in turn + 0.5 * np.pi * np.arange(4):
            along = x * np.cos(round_) + y * np.sin(round_)
            dark |= along * np.cos(tilt) + z * np.sin(tilt) > 0.93
    part = cover(*light.shape, centre, radius)
    return np.asarray(with_ball(light, centre, radius, 1.0) * (1.0 - 0.85 * part * dark))


def test_a_size_taken_from_panels_inside_a_faint_rim_is_not_kept() -> None:
    radius, count = 18.0, 36
    scene, time = wall(90, 420), np.arange(count)
    places = np.column_stack([40.0 + 9.2 * time, 40.0 + 0.02 * time**2])
    pictures = [exposed(scene, 6.0, seed) for seed in range(12)]
    for index, (x, y) in enumerate(places):
        seen = _spotted(scene, (float(x), float(y)), radius, 0.05 * index)
        pictures.append(exposed(seen, 6.0, 100 + index))
    filmed = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    # its lower rim is where it is, and more of its upper one is taken for a panel's from frame to
    # frame
    share = 0.97 - 0.06 * time / count
    fits = nothing_found(count)
    fits.found[:], fits.radius[:], fits.contrast[:] = True, share * radius, 0.9
    fits.centre[:] = places + np.random.default_rng(1).normal(0.0, 0.1, places.shape)
    fits.centre[:, 1] += (1.0 - share) * radius
    fits.covariance[:] = 0.01 * np.eye(2)
    found = refine_ball(filmed, BallFits(12 + time, fits))
    assert len(found) == count
    assert np.abs(found.radius - radius).max() < 0.2
    assert np.hypot(*(found.centre - places).T).max() < 0.25


def test_along_a_path_where_nothing_is_nothing_is_found() -> None:
    pictures = [exposed(wall(90, 200), 6.0, seed) for seed in range(24)]
    filmed = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    frame, plain = np.arange(8, 15), np.ones(7)
    places = np.column_stack([30.0 + 12.0 * np.arange(7), 45.0 * plain])
    path = BallPath(frame, places, 11.0 * plain)
    assert len(follow_ball(filmed, path)) == 0


def test_an_outline_beside_the_place_looked_at_is_not_the_balls() -> None:
    radius, count = 20.0, 30
    places = np.column_stack([40.0 + 9.0 * np.arange(count), np.full(count, 60.0)])
    pictures = [exposed(wall(120, 400), 1.0, seed) for seed in range(12)]
    for index, (x, y) in enumerate(places):
        seen = with_ball(wall(120, 400), (float(x), float(y)), radius)
        pictures.append(exposed(seen, 1.0, 20 + index))
    filmed = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    frame = 12 + np.arange(count)
    size = np.full(count, radius)
    assert len(follow_ball(filmed, BallPath(frame, places, size))) == count
    # another ball, half a radius above it and alike, hides it from some frame on
    looked = places + np.outer(np.arange(count) >= 20, [0.0, 0.5 * radius])
    found = follow_ball(filmed, BallPath(frame, looked, size))
    assert np.array_equal(found.frame, frame[:20])


def test_frames_missed_beside_the_mass_are_fitted_once_the_mass_is_known() -> None:
    clip, centres, angles = struck_ball(80)
    frame = np.setdiff1d(np.arange(80), [36, 37, 38])
    fits = nothing_found(len(frame))
    rough = centres[frame] + np.random.default_rng(4).normal(0.0, 0.1, (len(frame), 2))
    fits.found[:], fits.centre[:], fits.radius[:] = True, rough, 11.0
    fits.contrast[:], fits.covariance[:] = 0.9, 0.01 * np.eye(2)
    scene = FilmedScene(Footage(clip))  # type: ignore[arg-type]

    def hides(index: int) -> Hides:
        """The mass and a little around it, in the axes of its arm."""
        sine, cosine = np.sin(angles[index]), np.cos(angles[index])
        middle = np.array(PIVOT_PX) + 62.0 * np.array([sine, cosine])

        def inside(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
            u, v = x - middle[0], y - middle[1]
            wide, tall = u * cosine - v * sine, u * sine + v * cosine
            return np.asarray((np.abs(wide) < 9.0) & (np.abs(tall) < 9.0))

        return inside

    assert not np.isin([36, 37, 38], refine_ball(scene, BallFits(frame, fits)).frame).any()
    found = refine_ball(scene, BallFits(frame, fits), hides)
    assert np.isin([36, 37, 38], found.frame).all()
    assert np.hypot(*(found.centre - centres[found.frame]).T).max() < 0.15


def test_centres_of_outlines_seen_in_part_are_as_unsure_as_they_are_off() -> None:
    folder = shared_folder("rendered") / "jokku_120"
    truth = json.loads((folder / "truth.json").read_text())
    ball = follow(ClipReader.open(folder / "clip.mp4"), truth["fps_true"]).ball
    touched = (ball.frame > truth["contact"]["frame_on"] - 1) & (
        ball.frame < truth["contact"]["frame_off"] + 1
    )
    # a ball that is squashed has no centre of a circle
    part = (ball.quality < 0.8) & ~touched
    assert np.count_nonzero(part) > 15
    frames = truth["frames"]
    place = np.column_stack([frames["u_px"], frames["v_px"]])[ball.frame]
    # a sphere's outline lies further out than its centre
    camera, radius = truth["camera"], np.array(frames["r_px"])[ball.frame, np.newaxis]
    place += (place - [camera["u0"], camera["v0"]]) * (radius / camera["F_px"]) ** 2
    variance = np.diagonal(ball.covariance_px2, axis1=1, axis2=2)
    chi2 = ((ball.centre_px - place) ** 2 / variance).sum(axis=1)[part]
    # 95 % of a chi-square of two
    assert np.mean(chi2 < 5.99) > 0.85


@pytest.mark.parametrize("shrinks", [0.0, 0.12])
def test_outlines_of_another_size_are_kept_only_where_the_ball_has_it(shrinks: float) -> None:
    """Circles inside the rim in the first frames; a ball that really is smaller there keeps it."""
    radius, count, first = 60.0, 24, 8
    scene, time = wall(200, 420, 31.0), np.arange(count)
    places = np.column_stack([80.0 + 10.0 * time, 100.0 - 1.0 * time])
    size = radius * np.where(time < first, 1.0 - shrinks, 1.0)
    pictures = [exposed(scene, 1.0, seed) for seed in range(8)]
    for index, ((x, y), true) in enumerate(zip(places, size, strict=True)):
        seen = _seamed(scene, (float(x), float(y)), true)
        pictures.append(exposed(seen, 1.0, index))
    filmed = FilmedScene(Footage(PaintedClip(pictures)))  # type: ignore[arg-type]
    dim, wrong = time < first, (time < first) & (shrinks == 0.0)
    fits = nothing_found(count)
    fits.found[:], fits.contrast[:] = True, np.where(dim, 0.45, 0.9)
    fits.rms_residual[:] = np.where(dim, 9.0, 3.0)
    fits.radius[:] = np.where(wrong, 0.9, 1.0) * size
    fits.centre[:] = places + np.where(wrong[:, None], [3.0, -5.0], [0.0, 0.0])
    fits.covariance[:] = 0.01 * np.eye(2)
    found = _of_one_size(filmed, BallFits(8 + time, fits))
    assert np.abs(found.radius - size).max() < 0.3
    assert np.hypot(*(found.centre - places).T).max() < 0.3
