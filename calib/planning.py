"""What a camera that does not stand there yet will tell: its noise, and its view of the grid.

Edges are located by least squares, whose bound is Cramér and Rao's: noise over contrast, and less
the longer and sharper the edge. Beside the bound stands what a follower leaves over for other
reasons (shading, pattern, shadows, compression); on recordings with a known truth, ray-traced and
real, that is about 0.05 px for a ball and 0.15 px for a pendulum's mass, whatever their size.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.camera import Camera, Lens
from calib.grid import GridMap, WallGrid
from calib.lens import LensPrior
from metrology import CalibrationError

__all__ = [
    "BOARD_LENS_STD",
    "PictureNoise",
    "board_lens",
    "edge_std",
    "lens_of_view",
    "planned_grid",
]

FloatArray = NDArray[np.float64]

BALL_ERROR_PX, MASS_ERROR_PX, CROSSING_ERROR_PX = 0.05, 0.15, 0.3
"""px that following leaves over besides noise, of ball and mass, from recordings of known truth
(see above); and of a crossing of the grid, supposed."""
HIDDEN_SHARE = 0.3
"""Share of the wall that pendulum, stand and ball hide: supposed, as in the rendered scenes."""
LEAST_CROSSINGS = 12
"""Crossings, as `calib.grid.LEAST_NODES` asks for."""
LEAST_PITCH_PX = 3.0
"""px: above the 2.5 px where lines may fold over (`calib.grid.LEAST_PERIOD`), below what the
search is sure to find."""
FULL_WELL, READ_NOISE, GAMMA, WALL_SHARE = 9000.0, 18.0, 2.2, 0.66
"""Electrons of a small sensor's pixel, and where a well exposed wall lies on its scale."""
REFERENCE_EXPOSURE_S = 1e-3
"""s: the shutter that `light` is defined by."""
BOARD_LENS_STD: FloatArray = np.array([1e-3, 0.5, 0.5, 2e-3, 2e-3])
"""Relative focal length, principal point (px), k1, k2 after twenty pictures of a board,
supposed."""


@dataclass(frozen=True)
class PictureNoise:
    """How the picture comes out.

    Attributes
    ----------
    gray_std : float
        Noise of a pixel of the wall, gray levels of 255.
    contrast : float
        Step between ball or mass and what is behind, gray levels.
    blur_px : float
        Standard deviation of the point spread, px.
    """

    gray_std: float
    contrast: float = 80.0
    blur_px: float = 0.6

    @classmethod
    def by_light(cls, light: float, exposure_s: float) -> "PictureNoise":
        """Photon and read noise of a camera that turns up its gain until the wall is bright.

        Parameters
        ----------
        light : float
            1 where the wall is well exposed at 1/1000 s without any gain; a lit gymnasium has
            about 0.1.
        exposure_s : float
            Shutter, s.
        """
        full = min(light * exposure_s / REFERENCE_EXPOSURE_S, 1.0)
        electrons = WALL_SHARE * FULL_WELL * full
        relative = np.sqrt(electrons + READ_NOISE**2) / electrons
        gray = 255.0 * WALL_SHARE ** (1.0 / GAMMA)
        return cls(float(gray * relative / GAMMA))


def edge_std(
    noise: PictureNoise, radius_px: ArrayLike, way_px: ArrayLike, own: float
) -> FloatArray:
    """Standard uncertainty of the centre of a disc along one axis, px.

    Parameters
    ----------
    noise : PictureNoise
    radius_px : (...) array
        Radius of the disc, px.
    way_px : (...) array
        How far it moves during the exposure, px: a uniform smear.
    own : float
        What the follower leaves over beside noise, px.
    """
    radius = np.asarray(radius_px, dtype=np.float64)
    spread = np.sqrt(noise.blur_px**2 + np.asarray(way_px) ** 2 / 12.0)
    bound = noise.gray_std / noise.contrast * np.sqrt(2.0 * spread / (np.sqrt(np.pi) * radius))
    return np.asarray(np.hypot(bound, own))


def lens_of_view(width: int, height: int, horizontal_rad: float) -> Lens:
    """A lens by its horizontal angle of view."""
    return Lens.centred(width, height, 0.5 * (width - 1) / np.tan(0.5 * horizontal_rad))


def board_lens(lens: Lens) -> LensPrior:
    """The lens as a calibration with a board would know it."""
    return LensPrior(lens, BOARD_LENS_STD)


def planned_grid(
    camera: Camera, pitch_m: float = 0.05, *, error_px: float | None = None
) -> WallGrid:
    """Crossings of the wall's grid as the camera will see them, the scene hiding some.

    Parameters
    ----------
    camera : Camera
        In the world.
    pitch_m : float
        Distance between lines, m.
    error_px : float, optional
        Standard uncertainty of a crossing along one axis, px.

    Raises
    ------
    CalibrationError
        If the lines will be too close, or too few be in view.
    """
    lens = camera.lens
    corners = [[0, 0], [lens.width - 1, 0], [0, lens.height - 1], [lens.width - 1, lens.height - 1]]
    reach = camera.to_plane(np.array(corners, dtype=float), 0.0)
    if not np.isfinite(reach).all():
        raise CalibrationError("the camera would look past the wall", hint="Turn it to the wall.")
    low, high = np.floor(reach.min(axis=0) / pitch_m), np.ceil(reach.max(axis=0) / pitch_m)
    columns, rows = (np.arange(a, b + 1) for a, b in zip(low, high, strict=True))
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.int64)
    px = camera.project(np.c_[pitch_m * nodes, np.zeros(len(nodes))])
    inside = ((px > 1.0) & (px < [lens.width - 2.0, lens.height - 2.0])).all(axis=1)
    apart = lens.fx * pitch_m / camera.position[2]
    if apart < LEAST_PITCH_PX:
        raise CalibrationError(
            f"the lines of the wall would be {apart:.1f} px apart",
            hint="Film with more pixels, from nearer, or with a narrower view.",
        )
    # what stands before the wall hides a block of it, low and on one side
    kept = np.flatnonzero(inside)[: int((1.0 - HIDDEN_SHARE) * inside.sum())]
    if len(kept) < LEAST_CROSSINGS:
        raise CalibrationError(
            f"only {len(kept)} crossings of the wall's grid would be in view",
            hint="Film from farther away, or with a wider view.",
        )
    std = CROSSING_ERROR_PX if error_px is None else error_px
    return WallGrid(
        size=(lens.width, lens.height),
        pitch_m=pitch_m,
        nodes=nodes[kept],
        points_px=px[kept],
        covariance_px2=np.broadcast_to(std**2 * np.eye(2), (len(kept), 2, 2)),
        residual_px=np.zeros((len(kept), 2)),
        map=_map(camera, pitch_m),
        area=np.ones((lens.height, lens.width), dtype=bool),
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
    )


def _map(camera: Camera, pitch_m: float) -> GridMap:
    """Map of the wall without the lens's distortion."""
    lens = camera.lens
    focal = np.array([lens.fx, lens.fy])
    to_camera = np.column_stack(
        [pitch_m * camera.rotation[:, :2], -camera.rotation @ camera.position]
    )
    to_grid = np.linalg.inv(to_camera)
    rows = to_grid / to_grid[2, 2]
    return GridMap(
        np.array([lens.cx, lens.cy]),
        focal,
        np.concatenate([rows[0], rows[1], rows[2, :2], np.zeros(2)]),
    )
