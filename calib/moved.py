"""Has the camera moved since it was calibrated? The same wall, looked at again."""

from dataclasses import dataclass

import numpy as np

from calib.grid.grid import WallGrid
from metrology import CalibrationError

__all__ = ["Movement", "camera_movement"]


@dataclass(frozen=True)
class Movement:
    """How the wall's crossings have moved in the picture between two recordings.

    Attributes
    ----------
    px : float
        Root mean square movement, px.
    std : float
        What noise alone would make of it, px.
    moved : bool
        Whether the movement stands out of the noise and is larger than a tenth of a px.
    """

    px: float
    std: float
    moved: bool

    def __str__(self) -> str:
        if not self.moved:
            return f"the camera has not moved ({self.px:.2f} px)"
        return f"the camera moved by {self.px:.1f} px"


def camera_movement(old: WallGrid, new: WallGrid) -> Movement:
    """Compare two pictures of the same wall by the same camera.

    The grid repeats, so that a movement by more than half a pitch is seen short by whole pitches.

    Raises
    ------
    CalibrationError
        If the pictures differ in size.
    """
    if old.size != new.size:
        raise CalibrationError(
            f"the old picture has {old.size[0]}×{old.size[1]} px, the new one "
            f"{new.size[0]}×{new.size[1]}",
            hint="Film in the mode the calibration was made in.",
        )
    columns, rows = (np.linspace(0.1, 0.9, 9) * (length - 1) for length in old.size)
    px = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    wall = new.map(px) - old.map(px)
    wall -= np.round(np.median(wall, axis=0))
    step = np.linalg.solve(new.map.jacobian(px), wall[..., np.newaxis])[..., 0]
    length = float(np.sqrt((step**2).sum(axis=-1).mean()))
    # A map has ten parameters, fitted to two coordinates of each crossing
    noise = 0.0
    for grid in (old, new):
        variance = float(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2)))
        noise += variance * 5.0 / len(grid.nodes)
    std = float(np.sqrt(noise))
    return Movement(length, std, length > max(4.0 * std, 0.1))
