"""Camera geometry: projection and inverse, spheres, the correction of Fig. 9."""

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from calib.camera import SQUARE_TO_WALL, Camera, Lens, rotation_matrix

angles = st.floats(-0.6, 0.6)
lenses = st.builds(
    lambda focal, k1, k2, p1, p2: Lens(640, 360, focal, 1.01 * focal, 310.0, 185.0, k1, k2, p1, p2),
    st.floats(500.0, 1200.0),
    st.floats(-0.25, 0.1),
    st.floats(-0.02, 0.08),
    st.floats(-0.003, 0.003),
    st.floats(-0.003, 0.003),
)
rational_lenses = st.builds(
    lambda k1, k2, k4, k5: Lens(640, 360, 500.0, 505.0, 310.0, 185.0, k1, k2, 1e-3, 0, 0, k4, k5),
    st.floats(-0.2, 0.3),
    st.floats(-0.1, 0.05),
    st.floats(0.1, 0.6),
    st.floats(-0.05, 0.1),
)
cameras = st.builds(
    lambda lens, x, y, z, yaw, pitch, roll: Camera.facing_wall(
        lens, [x, y, z], yaw=yaw, pitch=pitch, roll=roll
    ),
    st.one_of(lenses, rational_lenses),
    st.floats(-1, 2),
    st.floats(0, 1.5),
    st.floats(2, 6),
    angles,
    angles,
    angles,
)
pixels = np.stack(np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 359, 7)), axis=-1)


@settings(deadline=None, max_examples=40)
@given(cameras, st.floats(0.0, 0.8))
def test_a_pixel_sent_to_a_plane_comes_back(camera: Camera, z: float) -> None:
    xy = camera.to_plane(pixels, z)
    points = np.concatenate([xy, np.full((*xy.shape[:-1], 1), z)], axis=-1)
    met = np.isfinite(xy[..., 0])
    assert np.allclose(camera.project(points)[met], pixels[met], atol=1e-7)


@settings(deadline=None, max_examples=40)
@given(cameras)
@example(Camera.facing_wall(Lens.centred(640, 360, 700.0), [0, 0, 3], pitch=5e-7))
def test_projection_agrees_with_opencv(camera: Camera) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform([-1, 0, 0], [2, 1.2, 0.6], (50, 3))
    # OpenCV judges the lens alone: a turn handed to it as a Rodrigues vector loses digits near π.
    before_camera = (points - camera.position) @ camera.rotation.T
    theirs, _ = cv2.projectPoints(
        before_camera, np.zeros(3), np.zeros(3), camera.lens.matrix, camera.lens.coefficients
    )
    ours = camera.project(points)
    seen = np.isfinite(ours[:, 0])
    assert np.allclose(ours[seen], theirs[seen, 0], atol=1e-8)


@settings(deadline=None, max_examples=40)
@given(st.one_of(lenses, rational_lenses))
def test_undistort_inverts_distort_within_the_fold(lens: Lens) -> None:
    xy = lens.from_pixels(pixels)
    back = lens.distort(lens.undistort(xy))
    seen = np.isfinite(back[..., 0])
    assert seen.mean() > 0.5
    assert np.allclose(back[seen], xy[seen], atol=1e-9)


def test_the_fold_is_where_distortion_turns_back() -> None:
    lens = Lens.centred(640, 360, 500.0, k1=-0.25)
    inside, outside = 0.999 * lens.fold, 1.001 * lens.fold
    assert np.isfinite(lens.distort([inside, 0.0])).all()
    assert np.isnan(lens.distort([outside, 0.0])).all()
    assert np.isnan(lens.undistort([0.9, 0.0])).all()
    assert Lens.centred(640, 360, 500.0, k1=0.1).fold == float("inf")


def test_the_fold_of_a_ratio_is_its_pole_or_where_it_turns_back() -> None:
    pole = Lens(640, 360, 500.0, 500.0, 320.0, 180.0, k4=-0.25)
    assert pole.fold == pytest.approx(2.0)
    turns = Lens(640, 360, 500.0, 500.0, 320.0, 180.0, k4=1.0)
    # r / (1 + r²) is largest at 1
    assert turns.fold == pytest.approx(1.0)


def test_rays_are_unit_and_turn_with_the_camera() -> None:
    lens = Lens.centred(640, 360, 700.0)
    straight = Camera(lens, SQUARE_TO_WALL, np.array([0.0, 0.0, 3.0]))
    assert np.allclose(straight.rays([lens.cx, lens.cy]), [0, 0, -1])
    right = Camera.facing_wall(lens, [0, 0, 3], yaw=0.1)
    assert right.axis_foot == pytest.approx([3 * np.tan(0.1), 0.0])
    up = Camera.facing_wall(lens, [0, 0, 3], pitch=0.1)
    assert up.axis_foot == pytest.approx([0.0, 3 * np.tan(0.1)])
    clockwise = Camera.facing_wall(lens, [0, 0, 3], roll=0.1)
    assert clockwise.project([0.0, 1.0, 0.0])[0] < lens.cx
    assert np.allclose(np.linalg.norm(clockwise.rays(pixels), axis=-1), 1.0)


def test_a_ray_that_never_meets_the_plane_gives_nan() -> None:
    camera = Camera.facing_wall(Lens.centred(640, 360, 700.0), [0, 0, 3], yaw=np.pi)
    assert np.isnan(camera.to_plane([320.0, 180.0])).all()
    assert np.isnan(camera.project([0.0, 0.0, 0.0])).all()


@pytest.mark.parametrize(("distance", "offset"), [(4.0, 0.45), (2.0, 0.0), (3.0, 0.3)])
def test_square_to_the_wall_the_shadow_is_enlarged_by_d_over_d_minus_d(
    distance: float, offset: float
) -> None:
    camera = Camera.facing_wall(Lens.centred(640, 360, 700.0), [1.0, 0.6, distance])
    ball = np.array([1.6, 0.9])
    px = camera.project([*ball, offset])
    on_wall = camera.to_plane(px, 0.0)
    foot = camera.axis_foot
    assert on_wall - foot == pytest.approx((ball - foot) * distance / (distance - offset))
    assert camera.to_plane(px, offset) == pytest.approx(ball)


@settings(deadline=None, max_examples=25)
@given(cameras, st.floats(0.05, 0.13))
def test_sphere_outlines_are_undone(camera: Camera, radius: float) -> None:
    px = np.array([[100.0, 80.0], [320.0, 180.0], [500.0, 300.0]])
    xy = camera.to_plane(px, 0.5)
    centre = np.concatenate([xy, np.full((3, 1), 0.5)], axis=-1)
    near = np.isfinite(xy[:, 0]) & (np.linalg.norm(centre - camera.position, axis=1) < 12.0)
    centre = centre[near & (camera.position[2] > 0.5 + 4 * radius)]
    outline, _ = camera.sphere_outline(centre, radius)
    assert camera.sphere_on_plane(outline, radius, 0.5) == pytest.approx(centre[:, :2], abs=2e-6)


def test_sphere_outline_matches_the_analytic_ellipse() -> None:
    # Through a pinhole the outline is the conic of the tangent cone (Hartley & Zisserman, ch. 8)
    camera = Camera.facing_wall(Lens.centred(640, 360, 700.0), [0.0, 0.0, 3.0])
    centre, radius = np.array([0.9, 0.4, 0.5]), 0.12
    p = camera.rotation @ (centre - camera.position)
    cone = np.outer(p, p) - (p @ p - radius**2) * np.eye(3)
    ellipse_centre = -np.linalg.solve(cone[:2, :2], cone[:2, 2])
    scale = ellipse_centre @ cone[:2, :2] @ ellipse_centre - cone[2, 2]
    semi_axes = np.sqrt(scale / np.linalg.eigvalsh(cone[:2, :2]))
    outline, radius_px = camera.sphere_outline(centre, radius)
    assert outline == pytest.approx(camera.lens.to_pixels(ellipse_centre), abs=1e-6)
    assert radius_px == pytest.approx(700.0 * np.sqrt(semi_axes.prod()), abs=1e-5)
    assert np.linalg.norm(outline - camera.project(centre)) > 0.3


def test_rotation_matrix_is_a_rotation() -> None:
    assert np.allclose(rotation_matrix([0, 0, 0]), np.eye(3))
    vector = np.array([0.3, -0.5, 0.2])
    assert np.allclose(rotation_matrix(vector), cv2.Rodrigues(vector)[0])


def test_a_resized_lens_sees_the_same_place_at_the_same_fraction() -> None:
    lens = Lens(640, 360, 900.0, 905.0, 322.0, 178.0, k1=-0.2)
    half = lens.resized(320, 180)
    xy = lens.from_pixels(pixels)
    assert (half.to_pixels(xy) + 0.5) * 2 == pytest.approx(lens.to_pixels(xy) + 0.5)
