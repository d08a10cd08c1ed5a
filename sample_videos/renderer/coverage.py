"""How much of a pixel a shape covers: exact for straight edges, to 1e-3 for round ones.

Everything is seen from the camera's centre. A pixel looks along (x, y, 1) in the camera's frame,
with x and y free of distortion: straight edges stay straight and a sphere is bounded by a cone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.camera.camera import Lens

__all__ = ["PixelGrid", "Window", "edge_coverage", "pixel_coverage", "quadric_coverage"]

FloatArray = NDArray[np.float64]

SMALLEST_SLOPE = 1e-3
"""Below this share of its length an edge's direction counts as along an axis, where the area of a
pixel that it cuts off is a rectangle's."""


@dataclass(frozen=True)
class Window:
    """A rectangle of pixels: rows top <= v < bottom, columns left <= u < right."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def empty(self) -> bool:
        """Whether there is no pixel in it."""
        return self.bottom <= self.top or self.right <= self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of an image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def rows(self) -> slice:
        """Index of its rows."""
        return slice(self.top, self.bottom)

    def overlaps(self, other: "Window") -> bool:
        """Whether the two have a pixel in common."""
        return (
            self.top < other.bottom
            and other.top < self.bottom
            and self.left < other.right
            and other.left < self.right
        )

    def joined(self, other: "Window") -> "Window":
        """Smallest window that holds both."""
        return Window(
            min(self.top, other.top),
            max(self.bottom, other.bottom),
            min(self.left, other.left),
            max(self.right, other.right),
        )


@dataclass(frozen=True)
class PixelGrid:
    """Where the pixels of a picture look.

    Attributes
    ----------
    xy : (2, H, W) array
        Undistorted normalised coordinates of pixel centres.
    slope : (4, H, W) array
        dx/du, dx/dv, dy/du, dy/dv, 1/px.
    """

    xy: FloatArray
    slope: FloatArray

    @classmethod
    def of_lens(cls, lens: Lens) -> "PixelGrid":
        """Grid of all pixels of a lens' picture."""
        u, v = np.meshgrid(np.arange(lens.width), np.arange(lens.height))
        px = np.stack([u, v], axis=-1).astype(np.float64)

        def look(du: float, dv: float) -> FloatArray:
            return np.moveaxis(lens.undistort(lens.from_pixels(px + np.array([du, dv]))), -1, 0)

        along_u = look(0.5, 0.0) - look(-0.5, 0.0)
        along_v = look(0.0, 0.5) - look(0.0, -0.5)
        slope = np.stack([along_u[0], along_v[0], along_u[1], along_v[1]])
        return cls(look(0.0, 0.0), slope)

    def crop(self, window: Window) -> "PixelGrid":
        """The part inside a window (a view)."""
        rows, columns = window.slices
        return PixelGrid(self.xy[:, rows, columns], self.slope[:, rows, columns])


def pixel_coverage(distance: FloatArray, along_u: FloatArray, along_v: FloatArray) -> FloatArray:
    """Area of a unit pixel inside a half-plane.

    Parameters
    ----------
    distance : array
        Of the pixel's centre from the edge, px, positive inside.
    along_u, along_v : array
        Unit normal of the edge.

    Returns
    -------
    array
        0 to 1: the integral over the trapezoid that a square's shadow along the normal is.
    """
    one, two = np.abs(along_u), np.abs(along_v)
    long, short = np.maximum(one, two), np.maximum(np.minimum(one, two), SMALLEST_SLOPE)
    outer, inner = 0.5 * (long + short), 0.5 * (long - short)
    s = np.clip(distance, -outer, outer)
    area = (s + outer) ** 2
    area -= np.maximum(s + inner, 0.0) ** 2
    area -= np.maximum(s - inner, 0.0) ** 2
    return np.asarray(np.clip(area / (2.0 * long * short), 0.0, 1.0))


def edge_coverage(normal: FloatArray, grid: PixelGrid) -> FloatArray:
    """Coverage by the half-plane on the positive side of a plane through the camera's centre.

    Parameters
    ----------
    normal : (..., 3) array
        Normal of that plane in the camera's frame; leading axes broadcast against (H, W).

    Returns
    -------
    (H, W) array
    """
    a, b, c = normal[..., 0], normal[..., 1], normal[..., 2]
    value = a * grid.xy[0] + b * grid.xy[1] + c
    along_u = a * grid.slope[0] + b * grid.slope[2]
    along_v = a * grid.slope[1] + b * grid.slope[3]
    steep = 1.0 / np.maximum(np.hypot(along_u, along_v), 1e-300)
    return pixel_coverage(value * steep, along_u * steep, along_v * steep)


def quadric_coverage(centre: FloatArray, form: FloatArray, grid: PixelGrid) -> FloatArray:
    """Coverage by the ellipsoid (p - c)ᵀ Q (p - c) <= 1.

    The cone of sight lines that touch it is (dᵀQc)² = (dᵀQd)(cᵀQc - 1).

    Parameters
    ----------
    centre : (..., 3) array
        c in the camera's frame, m; leading axes broadcast against (H, W).
    form : (3, 3) array
        Q, 1/m².

    Returns
    -------
    (H, W) array
    """
    x, y = grid.xy
    pull = centre @ form
    m = np.sum(pull * centre, axis=-1) - 1.0
    along = pull[..., 0] * x + pull[..., 1] * y + pull[..., 2]
    qx = form[0, 0] * x + form[0, 1] * y + form[0, 2]
    qy = form[1, 0] * x + form[1, 1] * y + form[1, 2]
    qz = form[2, 0] * x + form[2, 1] * y + form[2, 2]
    value = along**2 - m * (qx * x + qy * y + qz)
    slope_x = 2.0 * (along * pull[..., 0] - m * qx)
    slope_y = 2.0 * (along * pull[..., 1] - m * qy)
    along_u = slope_x * grid.slope[0] + slope_y * grid.slope[2]
    along_v = slope_x * grid.slope[1] + slope_y * grid.slope[3]
    steep = np.maximum(np.hypot(along_u, along_v), 1e-300)
    pixel_area = np.abs(grid.slope[0] * grid.slope[3] - grid.slope[1] * grid.slope[2])
    curved = (
        0.5 * (m * (form[0, 0] + form[1, 1]) - pull[..., 0] ** 2 - pull[..., 1] ** 2) * pixel_area
    )
    # For a disc of radius r the value is curved·(r² - ρ²): this is its exact root, not a first step
    root = np.sqrt(np.maximum(0.25 * steep**2 + curved * value, 0.0))
    distance = value / (0.5 * steep + root)
    radius = np.maximum(root / curved, 0.5)
    # a pixel's two ends along the edge lie farther out than its middle: by 1/(24 r) on the mean
    return pixel_coverage(distance - 1.0 / (24.0 * radius), along_u / steep, along_v / steep)
