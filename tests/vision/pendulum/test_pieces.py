"""Which piece of what moved is the mass, and which frames of its way are its own."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.vision.ball.painted import PaintedClip
from tests.vision.pendulum.swinging import RADIUS, Filmed, Make, filmed
from vision.clip.footage import Footage
from vision.pendulum import search
from vision.pendulum.arc import Arc, ImagedSwing, Patch, Pose
from vision.pendulum.face import MassCandidate, MassPoses, Striking, find_mass
from vision.pendulum.pendulum import Follower, Swinging, follow_piece, most_explained
from vision.pendulum.search import Striker, another_body, find_striker, settles, steadiest
from vision.scene import Backdrop, FilmedScene, scene_before_strike
from vision.tracks import Face

FloatArray = NDArray[np.float64]
PIVOT, ARM = np.array([60.0, -20.0]), 80.0
NO_COVARIANCE = np.diag([1e-2, 1e-2, 1e-4])


def swing(start: float = -0.35) -> ImagedSwing:
    middle = PIVOT + ARM * np.array([np.sin(start), np.cos(start)])
    return ImagedSwing(PIVOT, 0.0, 1.0, middle, turns=True)


def on_the_arc(count: int, rate: float) -> list[Pose]:
    here = swing()
    return [Pose(here.middle(rate * k), rate * k, NO_COVARIANCE, 1.0, 1.0) for k in range(count)]


def followed(
    scatter_px: float, gain: float, striking: Striking = Striking.AGREES, misfit: float = 1.0
) -> Swinging:
    poses = tuple(replace(pose, rms_residual=misfit) for pose in on_the_arc(40, 0.01))
    patch = Patch(np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))
    mass = MassPoses(np.arange(40), poses, patch, Arc(PIVOT, ARM, np.eye(3), 0.1, 1.0), 0)
    return Swinging(mass, swing(), striking, gain, scatter_px)


def test_of_nested_pieces_the_one_that_swings_evenly_is_taken() -> None:
    mass, with_shadow = followed(0.06, 4e4), followed(0.13, 1e5)
    assert steadiest([with_shadow, mass]) is mass


def test_of_pieces_that_swing_alike_the_one_that_explains_more_is_taken() -> None:
    with_bar, mass = followed(0.16, 1e4), followed(0.12, 7e3)
    assert steadiest([with_bar, mass]) is with_bar


def test_what_explains_next_to_nothing_is_not_taken_however_evenly_it_moves() -> None:
    mass, speck = followed(0.06, 4e4), followed(0.01, 1e3)
    assert steadiest([mass, speck]) is mass


def test_what_contradicts_the_strike_is_not_taken_however_evenly_it_moves() -> None:
    mass, shadow = followed(0.06, 4e4), followed(0.01, 9e4, Striking.CONTRADICTS)
    assert steadiest([shadow, mass]) is mass


def test_what_leaves_much_of_the_pictures_is_not_taken_however_evenly_it_moves() -> None:
    mass, part = followed(0.12, 6e4, misfit=2.5), followed(0.04, 2.3e4, misfit=6.2)
    assert steadiest([mass, part]) is mass


def at(offset: FloatArray, pivot: FloatArray) -> Swinging:
    """A square piece that lies so far from where another does, and turns about that pivot."""
    rows, columns = np.mgrid[-6:7, -6:7].astype(float)
    patch = Patch(columns.ravel(), rows.ravel(), np.zeros(169), np.ones(169))
    one = followed(0.1, 1e4)
    poses = tuple(replace(pose, anchor=pose.anchor + offset) for pose in one.mass.poses)
    swung = replace(one.swing, pivot_px=pivot)
    return replace(one, mass=replace(one.mass, patch=patch, poses=poses), swing=swung)


def test_a_body_with_its_shadow_is_no_second_thing_however_its_arc_scatters() -> None:
    mass = at(np.zeros(2), PIVOT)
    assert not another_body(at(np.array([3.0, 1.0]), PIVOT + np.array([0.0, 40.0])), mass)
    assert another_body(at(np.array([40.0, 0.0]), PIVOT + np.array([0.0, 40.0])), mass)


@pytest.mark.parametrize(("radius", "swings"), [(ARM, True), (5e4, False)])
def test_what_goes_straight_did_not_swing_into_the_ball(radius: float, swings: bool) -> None:
    one = followed(0.1, 1e4)
    mass = replace(one.mass, arc=Arc(PIVOT, radius, np.eye(3), 0.1, 40.0 / radius))
    face = Face(0, np.zeros(2), 0.1)
    assert Striker(mass, one.swing, face, (), 0.0, Striking.AGREES).surely_struck is swings


@pytest.mark.parametrize("around", [0, 150])
def test_a_mass_is_cut_out_where_it_is_however_much_wall_is_filmed(around: int) -> None:
    film = filmed(Make(), frames=54)
    wide = [
        np.pad(film.scene.picture(index).round().astype(np.uint8), around, mode="edge")
        for index in range(film.scene.count)
    ]
    scene = FilmedScene(Footage(PaintedClip(wide)))  # type: ignore[arg-type]
    rest = replace(film.rest, centre_px=film.rest.centre_px + around)
    before = Backdrop(scene, scene_before_strike(scene, rest, RADIUS), RADIUS)
    found = find_mass(scene, rest, RADIUS, before)
    assert found
    for piece in found:
        off = piece.anchor - film.middle[piece.frame] - around
        # its rod pulls the middle of a piece up
        assert np.abs(off) == pytest.approx(0.0, abs=4.0)
        solid = piece.patch.opacity > 0.5
        shown = scene.picture(piece.frame)[
            np.rint(piece.patch.y + piece.anchor[1]).astype(int),
            np.rint(piece.patch.x + piece.anchor[0]).astype(int),
        ]
        assert shown[solid].mean() == pytest.approx(piece.patch.look[solid].mean(), rel=0.02)


def followed_alone(film: Filmed) -> tuple[Follower, list[tuple[MassCandidate, Swinging]]]:
    """Every piece of what moved, followed whatever the others were."""
    before = Backdrop(film.scene, scene_before_strike(film.scene, film.rest, RADIUS), RADIUS)
    follower = Follower(film.scene, film.rest, film.ball, before)
    pieces = find_mass(film.scene, film.rest, RADIUS, before)
    found = [(piece, follow_piece(follower, piece)) for piece in pieces]
    return follower, [(piece, one) for piece, one in found if one is not None]


WIDE, ROUND = Make(half=(11.0, 5.0)), Make(half=(6.0, 6.0), round=True, rod=0.7, light=0.3)


@pytest.mark.parametrize("make", [WIDE, ROUND], ids=["wide", "round"])
def test_no_part_of_a_body_explains_more_than_all_that_differs_where_it_lies(make: Make) -> None:
    follower, found = followed_alone(filmed(make))
    (_, whole), *parts = found
    assert parts
    for piece, one in parts:
        bound = most_explained(follower, piece, whole)
        # gray levels between pixels come from two interpolations
        assert one.gain < 1.02 * bound
        assert bound < 1.5 * one.gain


def test_a_part_is_bound_by_nothing_where_the_body_was_lost() -> None:
    follower, found = followed_alone(filmed(WIDE))
    (_, whole), (piece, _), *_ = found
    kept = whole.mass.frame != follower.compared[3]
    poses = tuple(pose for pose, keep in zip(whole.mass.poses, kept, strict=True) if keep)
    lost = replace(whole, mass=replace(whole.mass, frame=whole.mass.frame[kept], poses=poses))
    assert np.isinf(most_explained(follower, piece, lost))


def test_a_body_settles_only_what_lies_on_it_and_can_add_less() -> None:
    follower, found = followed_alone(filmed(WIDE))
    (_, whole), (part, _), *_ = found
    most = most_explained(follower, part, whole)
    assert settles(replace(whole, gain=1.01 * most), part, follower)
    assert not settles(replace(whole, gain=0.99 * most), part, follower)
    beside = replace(part, anchor=part.anchor - [30.0, 0.0])
    assert not settles(whole, beside, follower)
    unsure = replace(whole, striking=Striking.UNKNOWN)
    assert not settles(unsure, part, follower)


@pytest.mark.parametrize(
    ("make", "fewer"), [(WIDE, True), (replace(WIDE, half=(8.0, 8.0)), False)], ids=["even", "not"]
)
def test_parts_of_what_swings_evenly_are_not_followed_and_the_same_body_is_taken(
    make: Make, fewer: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    film = filmed(make)
    _, found = followed_alone(film)
    best = steadiest([one for _, one in found])
    tried: list[MassCandidate] = []

    def counted(follower: Follower, piece: MassCandidate) -> Swinging | None:
        tried.append(piece)
        return follow_piece(follower, piece)

    monkeypatch.setattr(search, "follow_piece", counted)
    striker = find_striker(film.scene, film.rest, film.ball)
    assert striker is not None
    assert (len(tried) < len(found)) is fewer
    assert striker.mass.patch.x == pytest.approx(best.mass.patch.x)
    assert striker.doubt == 0.0


def test_no_mass_is_looked_for_behind_a_ball_at_the_edge_of_the_picture() -> None:
    film = filmed(Make(), frames=54)
    edge = replace(film.rest, centre_px=np.array([-2.0 * RADIUS, 50.0]))
    before = Backdrop(film.scene, film.scene.background.image, RADIUS)
    assert find_mass(film.scene, edge, RADIUS, before) == ()
