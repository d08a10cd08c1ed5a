"""Whether a fitted scene can be: a ball between wall and camera."""

import math
from dataclasses import replace

from calib.calibration import Calibration
from metrology import CalibrationError, Contribution

__all__ = ["ContradictionError", "plausible"]

# A ball nearer to the camera than to the wall is not what a measurement against a wall looks like
FAR_OUT = 0.5
SURE = 2.0


class ContradictionError(CalibrationError):
    """Grid pitch, ball diameter and taped distances can't all be right."""


def plausible(calibration: Calibration) -> Calibration:
    """The calibration, with a warning where the ball is suspiciously far from the wall.

    Apparent size puts the ball at a distance from the camera that does not depend on the grid; a
    wrong pitch moves the wall away from behind it.

    Raises
    ------
    ContradictionError
        If the ball plane is behind the wall or behind the camera.
    """
    depth, distance = calibration.ball_plane_offset, calibration.camera_distance
    # size against grid tells depth over distance far better than either of them
    share = depth / distance
    share_std = _total(calibration.budget(lambda c: c.ball_plane_offset / c.camera_distance))
    if not -SURE * share_std < share < 1.0:
        std = _total(calibration.budget(lambda c: c.ball_plane_offset))
        raise ContradictionError(
            f"the ball plane would be {depth:.2f} ± {std:.2f} m in front of the wall and the "
            f"camera {distance:.2f} m: no such scene",
            hint="Likeliest wrong: the pitch of the grid, or the diameter of the ball.",
        )
    if share - SURE * share_std < FAR_OUT:
        return calibration
    told = (
        f"the ball plane comes out {depth:.2f} m in front of the wall, {distance - depth:.2f} m "
        "from the camera: check the pitch of the grid and the diameter of the ball"
    )
    return replace(calibration, warnings=(*calibration.warnings, told))


def _total(budget: tuple[Contribution, ...]) -> float:
    return math.sqrt(sum(line.std**2 for line in budget))
