"""Whether a fitted scene can be: a ball between wall and camera."""

from dataclasses import replace

import numpy as np

from calib.calibration import Calibration
from metrology import CalibrationError

__all__ = ["plausible"]

# A ball nearer to the camera than to the wall is not what a measurement against a wall looks like
FAR_OUT = 0.5


def plausible(calibration: Calibration) -> Calibration:
    """The calibration, with a warning where the ball is suspiciously far from the wall.

    Apparent size puts the ball at a distance from the camera that does not depend on the grid; a
    wrong pitch moves the wall away from behind it.

    Raises
    ------
    CalibrationError
        If the ball plane is behind the wall or behind the camera.
    """
    depth, distance = calibration.ball_plane_offset, calibration.camera_distance
    std = float(np.sqrt(calibration.covariance[11, 11]))
    if not -2.0 * std < depth < distance:
        raise CalibrationError(
            f"the ball plane would be {depth:.2f} ± {std:.2f} m in front of the wall and the "
            f"camera {distance:.2f} m: no such scene",
            hint="Likeliest wrong: the pitch of the grid, or the diameter of the ball.",
        )
    if depth - 2.0 * std < FAR_OUT * distance:
        return calibration
    told = (
        f"the ball plane comes out {depth:.2f} m in front of the wall, {distance - depth:.2f} m "
        "from the camera: check the pitch of the grid and the diameter of the ball"
    )
    return replace(calibration, warnings=(*calibration.warnings, told))
