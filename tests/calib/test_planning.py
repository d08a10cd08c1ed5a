"""Planned images: noise from light, edge noise, and visibility of the grid."""

import numpy as np
import pytest

from calib.calibration import Evidence, Known
from calib.camera import Camera, Lens
from calib.solve import PictureNoise, board_lens, calibrate, edge_std, lens_of_view, planned_grid
from metrology import CalibrationError


def camera(width: int = 640, distance: float = 3.5) -> Camera:
    lens = Lens.centred(width, width * 9 // 16, 1.2 * width)
    return Camera.facing_wall(lens, [1.0, 0.6, distance], yaw=0.02)


def test_less_light_and_a_shorter_shutter_give_more_noise() -> None:
    good = PictureNoise.by_light(1.0, 1e-3).gray_std
    assert good == pytest.approx(1.3, rel=0.2)
    assert PictureNoise.by_light(0.25, 1e-3).gray_std == pytest.approx(2.0 * good, rel=0.15)
    assert PictureNoise.by_light(1.0, 0.25e-3) == PictureNoise.by_light(0.25, 1e-3)
    # a full well is full: more light than that shows nothing new
    assert PictureNoise.by_light(40.0, 1e-3).gray_std == good


def test_an_edge_is_located_as_well_as_its_noise_allows() -> None:
    """The bound against the scatter of a least-squares fit to rendered discs."""
    noise = PictureNoise(4.0)
    radius, rng, found = 12.0, np.random.default_rng(5), []
    y, x = np.mgrid[-20:21, -20:21].astype(float)

    def disc(shift: float) -> np.ndarray:
        from_edge = np.hypot(x - shift, y) - radius
        return noise.contrast / (1.0 + np.exp(1.702 * from_edge / noise.blur_px))

    still = disc(0.0)
    slope = (disc(0.05) - disc(-0.05)) / 0.1
    for _ in range(400):
        picture = still + rng.normal(0.0, noise.gray_std, still.shape)
        found.append(float((slope * (picture - still)).sum() / (slope**2).sum()))
    assert edge_std(noise, radius, 0.0, 0.0) == pytest.approx(np.std(found), rel=0.15)
    assert edge_std(noise, radius, 4.0, 0.0) > edge_std(noise, radius, 0.0, 0.0)
    assert edge_std(noise, radius, 0.0, 0.05) > 0.05


def test_a_planned_grid_gives_the_camera_back() -> None:
    there = camera()
    grid = planned_grid(there)
    found = calibrate(grid, Evidence(camera_distance=Known(3.5, 0.005)))
    assert found.camera_distance == pytest.approx(3.5, abs=1e-3)
    wall = grid.map(grid.points_px)
    assert wall == pytest.approx(grid.nodes, abs=0.01)


def test_more_pixels_and_a_known_lens_reduce_the_uncertainty() -> None:
    def open_distance(grid_camera: Camera, *, known: bool = False) -> float:
        prior = board_lens(grid_camera.lens) if known else None
        return float(np.sqrt(calibrate(planned_grid(grid_camera), lens=prior).covariance[5, 5]))

    plain = open_distance(camera())
    assert open_distance(camera(1280)) < plain
    assert open_distance(camera(), known=True) < 0.1 * plain


def test_a_lens_given_by_its_field_of_view() -> None:
    lens = lens_of_view(640, 360, np.radians(60.0))
    left, right = lens.undistort(lens.from_pixels([[0.0, 179.5], [639.0, 179.5]]))[:, 0]
    assert np.degrees(np.arctan(right) - np.arctan(left)) == pytest.approx(60.0)


def test_a_view_without_a_grid_is_refused() -> None:
    with pytest.raises(CalibrationError, match="px apart"):
        planned_grid(camera(128, 4.5))
    with pytest.raises(CalibrationError, match="crossings"):
        planned_grid(camera(640, 0.15))
    away = Camera.facing_wall(Lens.centred(640, 360, 700.0), [0, 0, 3], yaw=np.pi / 2)
    with pytest.raises(CalibrationError, match="past the wall"):
        planned_grid(away)
