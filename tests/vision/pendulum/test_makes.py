"""Pendulums of several makes: each is followed through the strike, on its own arc."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.vision.pendulum.swinging import STRIKE, Filmed, Make, filmed
from vision.pendulum.arc import sampled
from vision.pendulum.face import Striking, find_face, restitution_px
from vision.pendulum.search import Striker, find_striker, pendulum_track
from vision.scene import Backdrop, scene_before_strike

ROUND = Make(half=(6.0, 6.0), round=True, rod=0.7, light=0.3)
LATE = Make(pivot=(26.0, 12.0), rate=0.025)
ENTERS = 17


def struck(film: Filmed) -> Striker:
    found = find_striker(film.scene, film.rest, film.ball)
    assert found is not None
    return found


def off_px(film: Filmed, found: Striker, within: int = 1000) -> float:
    """How far the track is off a fixed point of the mass so many frames about it, px, RMS."""
    near = np.abs(found.mass.frame - STRIKE) < within
    frame = found.mass.frame[near]
    gap = found.mass.anchor[near] - film.middle[frame]
    sine, cosine = np.sin(film.angle[frame]), np.cos(film.angle[frame])
    axes = np.concatenate([np.column_stack([cosine, sine]), np.column_stack([-sine, cosine])])
    flat = gap.T.ravel()
    held = axes @ np.linalg.lstsq(axes, flat, rcond=None)[0]
    return float(np.sqrt(2.0 * np.mean((flat - held) ** 2)))


@pytest.mark.parametrize(
    ("make", "mirrored"),
    [
        (Make(), False),
        (Make(), True),
        (ROUND, False),
        (Make(half=(11.0, 5.0)), False),
        (Make(light=0.62), False),
        (Make(pivot=(60.0, -40.0), arm=114.0, rate=0.016), False),
        (LATE, False),
    ],
    ids=["box", "from the right", "bob on a thin rod", "wide", "pale", "no pivot", "late"],
)
def test_each_make_is_followed_through_the_strike(make: Make, mirrored: bool) -> None:
    film = filmed(make, mirrored=mirrored)
    found = struck(film)
    assert found.mass.frame[0] < (ENTERS + 3 if make is LATE else STRIKE - 15)
    assert found.mass.frame[-1] > STRIKE + 20
    if not mirrored:
        assert off_px(film, found) < 0.3
    assert found.doubt < 0.5


def test_a_round_bob_is_known_by_a_look_that_does_not_turn_and_strikes_with_its_outline() -> None:
    film = filmed(Make(half=(8.0, 8.0), round=True, rod=0.15, light=0.35))
    found = struck(film)
    assert not found.swing.turns
    assert found.face.spherical
    ahead = found.face.edge_px - film.middle[found.face.frame]
    angle = film.angle[found.face.frame]
    lead = float(ahead @ [np.cos(angle), -np.sin(angle)])
    assert lead == pytest.approx(8.0, abs=0.25)
    # what does not turn is as far off its pivot as off its middle: both are the bob's own
    off = np.median(found.mass.anchor - film.middle[found.mass.frame], axis=0)
    assert np.hypot(*off) < 0.25


def test_the_pivot_is_where_all_turns_about() -> None:
    found = struck(filmed(Make()))
    assert found.swing.pivot_px == pytest.approx([60.0, 12.0], abs=2.5)


@pytest.mark.parametrize(
    ("light", "swept"),
    [(0.35, (0.4, 70.0, -2.0)), (0.15, (0.55, 40.0, -2.0)), (0.15, (0.55, 110.0, 4.0))],
    ids=["pale", "dark", "before it"],
)
def test_a_mass_is_followed_and_its_face_seen_though_a_shadow_sweeps_over_the_wall(
    light: float, swept: tuple[float, float, float]
) -> None:
    film = filmed(Make(light=light, swept=swept), frames=84)
    found = struck(film)
    assert found.striking is Striking.AGREES
    assert off_px(film, found, within=20) < 0.5
    face = found.face
    ahead = face.edge_px - film.middle[face.frame]
    angle = film.angle[face.frame]
    assert face.edge_std_px < 0.3
    assert float(ahead @ [np.cos(angle), -np.sin(angle)]) == pytest.approx(8.0, abs=0.7)


@pytest.mark.parametrize(
    "make",
    [Make(), Make(light=0.62), Make(half=(11.0, 5.0)), Make(rod=3.5)],
    ids=["box", "pale", "wide", "thick rod"],
)
def test_the_stated_place_of_the_mass_covers_its_error(make: Make) -> None:
    film = filmed(make)
    track = pendulum_track(struck(film), film.rest, 30.0).track
    off = track.centre_px - film.middle[track.frame]
    squares = np.einsum("ni,nij,nj->n", off, np.linalg.inv(track.covariance_px2), off)
    # chi-square of two unknowns that all frames share
    assert float(np.median(squares)) < chi2.ppf(0.9973, 2)


def test_nothing_that_swings_is_no_striker() -> None:
    film = filmed(Make(swings=False))
    assert find_striker(film.scene, film.rest, film.ball) is None


def test_a_camera_half_as_fast_sees_the_same_swing() -> None:
    film, slow = filmed(Make(), frames=64), filmed(Make(), frames=64, every=2)
    usual, other = struck(film), struck(slow)
    assert other.swing.pivot_px == pytest.approx(usual.swing.pivot_px, abs=2.5)
    assert off_px(slow, other) < 0.3
    assert [restitution_px(one.mass, clip.ball, clip.rest) for one, clip in (
        (usual, film), (other, slow)
    )] == pytest.approx([0.7, 0.7], abs=0.06)  # fmt: skip


def test_a_close_up_has_more_points_than_fit_in_a_row_of_opencv() -> None:
    picture = np.arange(12.0, dtype=np.float32).reshape(3, 4)
    x = np.full(40_000, 2.0)
    assert sampled(picture, x, np.full(40_000, 1.0)) == pytest.approx(np.full(40_000, 6.0))


@pytest.mark.parametrize("beside", [0.0, 60.0])
def test_a_face_whose_edge_does_not_stand_out_is_where_the_piece_ends(beside: float) -> None:
    film = filmed(Make())
    found = struck(film)
    radius = float(np.median(film.ball.radius))
    patch = replace(found.mass.patch, y=found.mass.patch.y - beside)
    face = find_face(film.scene, replace(found.mass, patch=patch), film.rest, radius)
    angle = film.angle[face.frame]
    ahead = face.edge_px - film.middle[face.frame]
    lead = float(ahead @ [np.cos(angle), -np.sin(angle)])
    assert face.middle_px is None
    assert abs(lead - 8.0) < 2.0 * face.edge_std_px
    # what hangs far from the ball's height may be a part of what strikes it
    assert face.edge_std_px == pytest.approx((0.5 if beside else 0.2) * radius, rel=0.1)


@pytest.mark.parametrize("beside", [0.0, 60.0])
def test_a_face_that_moves_with_what_is_followed_is_seen_on_a_mass_of_nearly_the_walls_light(
    beside: float,
) -> None:
    # from a brighter side to a darker face the profile passes the wall's own light
    film = filmed(Make(light=0.95, strip=(3.0, 0.15)))
    found = struck(filmed(Make()))
    # an arm may be followed in the place of its mass, and end above the ball
    patch = replace(found.mass.patch, y=found.mass.patch.y - beside)
    radius = float(np.median(film.ball.radius))
    before = Backdrop(film.scene, scene_before_strike(film.scene, film.rest, radius), radius)
    face = find_face(film.scene, replace(found.mass, patch=patch), film.rest, radius, before)
    assert face.middle_px is not None
    angle = film.angle[face.frame]
    axis = np.array([np.cos(angle), -np.sin(angle)])
    assert float((face.middle_px - film.middle[face.frame]) @ axis) == pytest.approx(6.5, abs=0.25)
    assert face.middle_std_px < 0.3
