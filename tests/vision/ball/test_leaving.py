"""Balls of the wall's lightness that leave slowly: painted, with their true places known."""

from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedClip, cover, exposed, wall
from vision.ball.leaving import discs_along, left_at_last
from vision.clip.footage import Footage
from vision.following import follow
from vision.scene import FilmedScene

HEIGHT, WIDTH, RADIUS, LEAVES, FRAMES = 110, 200, 10.0, 50, 104
PANELS = ((-0.45, -0.1), (0.3, -0.55), (0.15, 0.5))
"""Middles of dark panels, in radii from the ball's."""


def _way() -> NDArray[np.float64]:
    time = np.maximum(np.arange(FRAMES) - LEAVES, 0.0)
    return np.column_stack([70.0 + 0.75 * time, 60.0 - 0.2 * time + 0.004 * time**2])


def _panelled(light: NDArray[np.float64], x: float, y: float) -> NDArray[np.float64]:
    """A ball that is as light as what is behind it where it faces the lamp, with dark panels."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    across, down = (columns - x) / RADIUS, (rows - y) / RADIUS
    out = np.sqrt(np.clip(1.0 - across**2 - down**2, 0.0, 1.0))
    facing = np.clip(-0.45 * across - 0.6 * down + 0.66 * out, 0.0, 1.0)
    part, skin = cover(HEIGHT, WIDTH, (x, y), RADIUS), 0.5 + 0.27 * facing
    for right, low in PANELS:
        panel = cover(HEIGHT, WIDTH, (x + right * RADIUS, y + low * RADIUS), 0.24 * RADIUS)
        skin = skin * (1.0 - 0.8 * panel)
    return light * (1.0 - part) + skin * part


@cache
def _clip(shadow: float = 0.25) -> PaintedClip:
    """The ball and its soft shadow leave; a dark bob comes from the left and stops there."""
    pictures = []
    for index, (x, y) in enumerate(_way()):
        light = wall(HEIGHT, WIDTH, pitch=29.0)
        cast = cv2.GaussianBlur(cover(HEIGHT, WIDTH, (x + 9.0, y + 17.0), RADIUS), (0, 0), 2.5)
        light = light * (1.0 - shadow * np.asarray(cast))
        bob = cover(HEIGHT, WIDTH, (53.0 + 1.1 * min(index - LEAVES, 4.0), 60.0), 6.0)
        light = _panelled(light * (1.0 - bob) + 0.12 * bob, float(x), float(y))
        pictures.append(exposed(light, 1.0, index))
    return PaintedClip(pictures)


def _scene() -> FilmedScene:
    scene = FilmedScene(Footage(_clip()))  # type: ignore[arg-type]
    return scene.as_it_began() or scene


def test_what_left_as_one_is_the_ball_and_not_a_panel_or_the_shadow() -> None:
    path = left_at_last(_scene())[0]
    off = np.hypot(*(path.centre_px - _way()[path.frame]).T)
    assert path.radius == pytest.approx(RADIUS, rel=0.06)
    assert np.median(off) < 1.0
    assert off.max() < 0.25 * RADIUS


def test_the_whole_of_a_panel_is_found_by_the_way_it_went() -> None:
    panel = _way() + RADIUS * np.array(PANELS[0])
    path = discs_along(_scene(), np.arange(FRAMES), panel, 0.24 * RADIUS)[0]
    off = np.hypot(*(path.centre_px - _way()[path.frame]).T)
    assert path.radius == pytest.approx(RADIUS, rel=0.06)
    assert off.max() < 0.1 * RADIUS


def test_nothing_is_found_where_nothing_left() -> None:
    still = PaintedClip([exposed(wall(HEIGHT, WIDTH), 1.0, seed) for seed in range(40)])
    assert left_at_last(FilmedScene(Footage(still))) == []  # type: ignore[arg-type]


def test_a_panelled_ball_of_the_walls_lightness_is_followed_whole() -> None:
    ball = follow(_clip(), 600.0).ball  # type: ignore[arg-type]
    off = np.hypot(*(ball.centre_px - _way()[ball.frame]).T)
    assert len(ball.frame) > 0.95 * FRAMES
    assert np.median(ball.radius_px) == pytest.approx(RADIUS, rel=0.05)
    assert np.quantile(off, 0.95) < 0.04 * RADIUS
