"""Analytic pixel coverage compared with known areas and centroids."""

import numpy as np
import pytest

from calib.camera import Camera, Lens
from sample_videos.bodies import (
    PixelGrid,
    Window,
    box,
    outline,
    outline_coverage,
    pixel_coverage,
    quadric_coverage,
    shade_behind,
)
from sample_videos.stage import into_camera


def camera(k1: float = 0.0) -> Camera:
    lens = Lens.centred(160, 120, 260.0, k1=k1)
    return Camera.facing_wall(lens, [0.3, 0.5, 3.0], yaw=0.05, pitch=-0.03, roll=0.04)


def moments(cover: np.ndarray) -> tuple[float, np.ndarray]:
    v, u = np.indices(cover.shape)
    area = cover.sum()
    return float(area), np.array([(cover * u).sum(), (cover * v).sum()]) / area


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, 1.4, 2.2, -0.9])
def test_the_coverage_of_a_pixel_by_an_edge_equals_a_million_samples(angle: float) -> None:
    rng = np.random.default_rng(3)
    spots = rng.uniform(-0.5, 0.5, (200_000, 2))
    normal = np.array([np.cos(angle), np.sin(angle)])
    for distance in (-0.6, -0.35, 0.0, 0.2, 0.45, 0.8):
        sampled = np.mean(spots @ normal + distance > 0)
        ours = pixel_coverage(np.array(distance), np.array(normal[0]), np.array(normal[1]))
        assert float(ours) == pytest.approx(sampled, abs=4e-3)


@pytest.mark.parametrize("k1", [0.0, -0.2])
@pytest.mark.parametrize("centre", [(0.3, 0.5, 0.45), (-0.21, 0.63, 0.45), (0.9, 0.2, 0.3)])
def test_the_outline_of_a_sphere_agrees_with_geometry(k1: float, centre: tuple) -> None:
    cam = camera(k1)
    grid = PixelGrid.of_lens(cam.lens)
    seen = into_camera(np.array(centre), cam)[np.newaxis, np.newaxis]
    area, middle = moments(quadric_coverage(seen, np.eye(3) / 0.1**2, grid))
    outline_px, radius_px = cam.sphere_outline(np.array(centre), 0.1)
    assert middle == pytest.approx(outline_px, abs=0.002)
    assert np.sqrt(area / np.pi) == pytest.approx(float(radius_px), abs=0.004)


def test_a_small_sphere_moved_in_tenths_of_a_pixel_is_never_off_by_a_hundredth() -> None:
    cam = camera()
    grid = PixelGrid.of_lens(cam.lens)
    for step in np.linspace(0.0, 1.0, 11):
        centre = np.array([0.2 + step * 2.7 / 260.0, 0.5, 0.3])
        seen = into_camera(centre, cam)[np.newaxis, np.newaxis]
        _, middle = moments(quadric_coverage(seen, np.eye(3) / 0.05**2, grid))
        assert middle == pytest.approx(cam.sphere_outline(centre, 0.05)[0], abs=0.005)


def test_a_box_covers_the_polygon_of_its_corners() -> None:
    cam = camera()
    grid = PixelGrid.of_lens(cam.lens)
    solid = box([0.2, 0.5, 0.4], [0.3, 0.12, 0.1], (0.5, 0.5, 0.5))
    edges = outline(solid.vertices, solid, cam.position)
    corners = cam.project(solid.vertices[[a for a, _ in edges]])
    x, y = corners.T
    cross = x * np.roll(y, -1) - y * np.roll(x, -1)
    area = 0.5 * cross.sum()
    middle = (corners + np.roll(corners, -1, axis=0)).T @ cross / (6.0 * area)
    found, at = moments(outline_coverage(into_camera(solid.vertices, cam), edges, grid))
    assert found == pytest.approx(abs(area), rel=2e-3)
    assert at == pytest.approx(middle, abs=0.01)


def test_a_bar_thinner_than_a_pixel_keeps_its_area() -> None:
    cam = camera()
    grid = PixelGrid.of_lens(cam.lens)
    solid = box([0.3, 0.5, 0.0], [0.4, 0.004, 0.001], (0.5, 0.5, 0.5))
    edges = outline(solid.vertices, solid, cam.position)
    found, _ = moments(outline_coverage(into_camera(solid.vertices, cam), edges, grid))
    assert found == pytest.approx(0.4 * 0.004 * (260 / 3.0) ** 2, rel=0.05)


def test_a_shadow_is_dark_inside_light_outside_and_half_dark_on_its_edge() -> None:
    solid = box([0.0, 1.0, 1.0], [0.4, 0.4, 0.001], (0.5, 0.5, 0.5))
    lamp = np.array([0.0, 1.0, 3.0])
    # the edge at x = 0.2, 2 m from the lamp, falls on the wall at 0.2 * 3 / 2
    points = np.array([[0.0, 0.3, 0.6], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]])
    shade = shade_behind(points, solid.vertices, solid, lamp, 0.1)
    assert shade == pytest.approx([1.0, 0.5, 0.0], abs=0.01)
    nearer = shade_behind(np.array([[0.0], [1.0], [2.0]]), solid.vertices, solid, lamp, 0.1)
    assert nearer == pytest.approx([0.0])


def test_windows_join_and_overlap() -> None:
    one, two, far = Window(0, 4, 0, 4), Window(3, 6, 3, 9), Window(8, 9, 0, 1)
    assert one.overlaps(two)
    assert not one.overlaps(far)
    assert one.joined(far) == Window(0, 9, 0, 4)
    assert Window(3, 3, 0, 4).empty
