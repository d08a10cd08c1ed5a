"""Proposed bodies: where they are, whatever their light, and what is no body."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.vision.ball.painted import PaintedColourClip
from tests.vision.pendulum.swinging import RADIUS, Filmed, Make, filmed
from vision.clip.footage import Footage
from vision.pendulum.candidates import SwungBody, propose_bodies, swing_prior
from vision.pendulum.search import find_striker
from vision.scene import FilmedScene


def first_body(film: Filmed) -> SwungBody:
    found = propose_bodies(film.scene, film.rest, RADIUS)
    assert found
    return found[0]


@pytest.mark.parametrize("mirrored", [False, True], ids=["from the left", "from the right"])
@pytest.mark.parametrize("light", [0.1, 0.62, 1.4], ids=["dark", "pale", "paler than the wall"])
def test_a_body_is_cut_out_where_it_is_for_either_sign_of_contrast(
    light: float, mirrored: bool
) -> None:
    make = Make(light=light)
    film = filmed(make, mirrored=mirrored)
    body = first_body(film)
    off = body.swing.centre_px - film.middle[body.frame]
    # its rod, which is darker than a pale mass, pulls the middle up
    assert np.abs(off).max() < 4.0
    assert body.patch.opacity.sum() == pytest.approx(4.0 * 8.0 * 8.0, rel=0.35)


def test_the_pivot_of_a_proposed_body_is_above_it_at_the_length_of_its_arm() -> None:
    make = Make()
    film = filmed(make)
    body = first_body(film)
    arm = body.swing.pivot_px - body.swing.centre_px
    assert arm[1] < 0.0
    assert np.hypot(*arm) == pytest.approx(make.arm, rel=0.5)
    turned = np.array([film.angle[frame] for frame in sorted(body.angles)])
    rate = np.polyfit(turned, [body.angles[frame] for frame in sorted(body.angles)], 1)[0]
    # the painted angle runs from the lowest point towards +x, that of a swing from +x towards +y
    assert rate * np.hypot(*arm) / make.arm == pytest.approx(-1.0, abs=0.15)


def test_the_arm_alone_moves_no_middle() -> None:
    film = filmed(Make(rod=2.0))
    head, whole = propose_bodies(film.scene, film.rest, RADIUS)[:2]
    assert not head.with_arm
    assert whole.with_arm
    assert whole.patch.opacity.sum() > 1.1 * head.patch.opacity.sum()
    off, also = (one.swing.centre_px - film.middle[one.frame] for one in (head, whole))
    assert also == pytest.approx(off, abs=1.0)


def test_nothing_that_swings_gives_no_body_that_explains_a_strike() -> None:
    film = filmed(Make(swings=False))
    assert find_striker(film.scene, film.rest, film.ball) is None


def test_a_body_before_the_first_frames_of_a_clip_is_no_proposal() -> None:
    film = filmed(Make())
    assert propose_bodies(film.scene, replace(film.rest, last=2), RADIUS) == ()


def test_a_body_of_the_walls_light_and_another_colour_is_followed_in_colour() -> None:
    dark, bare = filmed(Make(light=0.1)), filmed(Make(swings=False))
    pictures = []
    for index in range(dark.scene.count):
        seen, wall = (one.scene.picture(index) for one in (dark, bare))
        body = np.clip((wall - seen) / 60.0, 0.0, 1.0)[..., None]
        body[
            np.hypot(*np.moveaxis(np.mgrid[: wall.shape[0], : wall.shape[1]][::-1], 0, 2).T).T < 0
        ] = 0
        # green against purple of the same lightness
        tint = np.array([-40.0, 27.5, -40.0]) * body
        pictures.append(np.clip(wall[..., None] + tint, 0, 255).astype(np.uint8))
    scene = FilmedScene(Footage(PaintedColourClip(pictures)))  # type: ignore[arg-type]
    found = propose_bodies(scene, dark.rest, RADIUS)
    assert found
    assert found[0].gray < 0.2
    striker = find_striker(scene, dark.rest, dark.ball)
    assert striker is not None
    near = np.abs(striker.mass.frame - dark.rest.last) < 15
    off = striker.mass.anchor[near] - dark.middle[striker.mass.frame[near]]
    assert np.hypot(*off.T).max() < 4.0
    assert cv2.norm(off - off.mean(axis=0)) / np.sqrt(len(off)) < 1.0


def test_the_prior_prefers_what_strikes_of_training_did() -> None:
    prior = swing_prior()
    usual = np.array([0.0, prior.pivot[0], prior.speed[0]])
    assert prior.log_odds(usual) == pytest.approx(0.0, abs=1e-9)
    slower, far_slower = (usual - np.array([0.0, 0.0, by]) for by in (0.1, 1.0))
    assert prior.log_odds(far_slower) < prior.log_odds(slower) < 0.0
