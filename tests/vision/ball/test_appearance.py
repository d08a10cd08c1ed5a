"""An object is followed by its looks where its outline is not clear, and no further."""

import numpy as np
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedColourClip, cover, exposed, wall, with_ball
from vision.ball.appearance import extended_by_appearance
from vision.ball.ball import BallFits, outlines_near, trusted_rows
from vision.clip.footage import Footage
from vision.scene import FilmedScene

FloatArray = NDArray[np.float64]
HEIGHT, WIDTH, RADIUS, RESTS, COUNT = 110, 320, 11.0, 40, 130


def _places() -> FloatArray:
    """It lies still, and then flies to the right."""
    flight = np.maximum(np.arange(COUNT) - RESTS, 0.0)
    return np.column_stack([60.3 + 2.1 * flight, 55.6 - 0.5 * flight + 0.006 * flight**2])


def _halves(light: FloatArray, centre: FloatArray) -> FloatArray:
    """A ball with one bright half before a scene."""
    x, y = float(centre[0]), float(centre[1])
    ball = with_ball(light, (x, y), RADIUS, 0.5)
    part = cover(HEIGHT, WIDTH, (x, y), RADIUS)
    bright = np.arange(WIDTH)[None, :] + 0.3 * np.arange(HEIGHT)[:, None] > x + 0.3 * y
    return np.asarray(np.where(bright, ball + 0.4 * part, ball))


def _curtain(index: int) -> FloatArray:
    """A striped cloth that sways behind the place of rest, as light as the ball."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    folds = 0.32 + 0.2 * np.sin((x - 2.3 * index) / 4.0) * np.sin((y + 0.7 * index) / 5.0)
    return np.asarray(np.where(x < 125, folds, wall(HEIGHT, WIDTH)))


def _filmed(hidden_until: int = 0) -> FilmedScene:
    pictures = []
    for index, place in enumerate(_places()):
        light = _halves(_curtain(index), place)
        if index < hidden_until:
            light[:, 30:100] = _curtain(index + 50)[:, 30:100]
        gray = exposed(light, 1.5, index)
        pictures.append(np.repeat(gray[:, :, None], 3, axis=2))
    return FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]


def _flight(scene: FilmedScene) -> BallFits:
    """Outlines where it flies before the still wall."""
    frame = np.arange(RESTS + 40, COUNT - 5)
    found = BallFits(frame, outlines_near(scene, RADIUS, frame, _places()[frame]))
    return found.at(found.fits.found)


def test_it_is_followed_back_to_its_rest_before_a_cloth_that_sways() -> None:
    scene = _filmed()
    flight = _flight(scene)
    assert len(flight) > 35
    found = trusted_rows(extended_by_appearance(scene, flight))
    assert len(found) > 0.95 * (COUNT - 5)
    assert found.frame.min() < 3
    assert len(np.unique(found.frame)) == len(found)
    off = found.centre - _places()[found.frame]
    std = np.sqrt(np.diagonal(found.fits.covariance, axis1=1, axis2=2))
    assert np.abs(off).max() < 0.15 * RADIUS
    assert np.mean(np.abs(off) < 3.0 * std) > 0.9


def test_where_it_is_hidden_it_is_not_followed() -> None:
    scene = _filmed(hidden_until=RESTS)
    found = extended_by_appearance(scene, _flight(scene))
    assert found.frame.min() >= RESTS
    off = found.centre - _places()[found.frame]
    assert np.hypot(*off.T).max() < 0.15 * RADIUS


def test_what_looks_like_all_beside_it_is_not_followed_by_its_looks() -> None:
    pictures = []
    for index in range(COUNT):
        # a plain ball before a wall of its colour; something else moves
        light = with_ball(np.full((HEIGHT, WIDTH), 0.5), (20.0 + 2.0 * index, 95.0), 8.0)
        pictures.append(np.repeat(exposed(light, 3.0, index)[:, :, None], 3, axis=2))
    scene = FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]
    flight = _flight(_filmed())
    found = extended_by_appearance(scene, flight)
    np.testing.assert_array_equal(found.frame, flight.frame)
