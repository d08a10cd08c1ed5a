"""A pivot from the arc that something swings on: a circle fitted to points by geometric least squares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Arc", "fit_arc"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Arc:
    """A circle through a track.

    Attributes
    ----------
    centre_px : (2,) array
        Its centre, px.
    radius_px : float
        Its radius, px.
    covariance : (3, 3) array
        Of centre x, y and radius, px².
    scatter_px : float
        Robust scatter of the points about the circle, px.
    span_rad : float
        Angle that the points cover, rad.
    """

    centre_px: FloatArray
    radius_px: float
    covariance: FloatArray
    scatter_px: float
    span_rad: float


def fit_arc(points: FloatArray, start: FloatArray | None = None) -> Arc | None:
    """Fit a circle.

    Parameters
    ----------
    points : (N, 2) array
        Points, px.
    start : (2,) array, optional
        First guess of the centre.

    Returns
    -------
    Arc or None
        None if the points lie on a line, or are fewer than five.
    """
    if len(points) < 5:
        return None
    centre = _algebraic(points) if start is None else start
    if centre is None:
        return None
    radius = float(np.median(np.hypot(*(points - centre).T)))
    parameters = np.array([*centre, radius])
    weight = np.ones(len(points))
    for _ in range(40):
        offset = points - parameters[:2]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        residual = distance - parameters[2]
        scatter = max(1.4826 * float(np.median(np.abs(residual))), 1e-4)
        weight = 1.0 / (1.0 + (residual / (3.0 * scatter)) ** 2) ** 2
        design = np.column_stack([-offset / distance[:, None], -np.ones(len(points))])
        weighted = design * weight[:, None]
        normal = weighted.T @ design
        step = -np.linalg.solve(normal + 1e-9 * np.trace(normal) * np.eye(3), weighted.T @ residual)
        length = float(np.hypot(step[0], step[1]))
        step *= min(1.0, 0.5 * parameters[2] / max(length, 1e-9))
        parameters = parameters + step
        if not np.all(np.isfinite(parameters)) or parameters[2] > 1e5:
            return None
        if length < 1e-4:
            break
    offset = points - parameters[:2]
    angle = np.unwrap(np.arctan2(offset[:, 0], offset[:, 1]))
    covariance = np.linalg.pinv(normal) * scatter**2
    return Arc(parameters[:2], float(parameters[2]), covariance, scatter, float(np.ptp(angle)))


def _algebraic(points: FloatArray) -> FloatArray | None:
    """Kåsa's linear fit, for a start."""
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    design = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
    solution, _, rank, _ = np.linalg.lstsq(design, x * x + y * y, rcond=None)
    if rank < 3:
        return None
    return np.asarray(middle + solution[:2])
