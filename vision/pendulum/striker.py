"""Whether what was followed can have struck the ball: what two bodies do in a blow, in pixels."""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import BallFits
from vision.ball.rest import Rest
from vision.pendulum.mass import MassPoses

__all__ = ["Striking", "restitution_px", "striking"]

FloatArray = NDArray[np.float64]

_BEFORE, _GAP, _AFTER = 10, 8, 14
_FEWEST = 4
# Balls give back a tenth to all of the speed of approach; the rest is the coarseness of this look.
_LEAST, _MOST = 0.1, 1.15


class Striking(IntEnum):
    """How well a thing's motion agrees with its having struck the ball, best first."""

    AGREES = 0
    UNKNOWN = 1
    CONTRADICTS = 2


def striking(mass: MassPoses, ball: BallFits, rest: Rest) -> Striking:
    """Judge a followed thing by the restitution that its speeds and the ball's would mean."""
    restitution = restitution_px(mass, ball, rest)
    if restitution is None:
        return Striking.UNKNOWN
    agrees = _LEAST < restitution < _MOST
    return Striking.AGREES if agrees else Striking.CONTRADICTS


def restitution_px(mass: MassPoses, ball: BallFits, rest: Rest) -> float | None:
    """Coefficient of restitution from speeds in the picture, Newton's e = (v_B − v_M) / v_M0.

    Parameters
    ----------
    mass : MassPoses
        What was followed.
    ball : BallFits
        The ball.
    rest : Rest
        The ball before it is struck.

    Returns
    -------
    float or None
        None where the thing is not seen on both sides of the blow.
    """
    centre = mass.arc.centre_px
    offset = mass.anchor - centre
    angle = np.unwrap(np.arctan2(offset[:, 1], offset[:, 0]))
    lever = rest.centre_px - centre
    # what an angle from +x towards +y moves along the ball's departure, at the ball
    along = float(-lever[1] * rest.direction[0] + lever[0] * rest.direction[1])
    late = rest.last + _GAP
    coming = _slope(mass.frame, angle, rest.last - _BEFORE, rest.last)
    going = _slope(mass.frame, angle, late, late + _AFTER)
    flying = _slope(ball.frame, ball.centre @ rest.direction, late, late + _AFTER)
    if coming is None or going is None or flying is None or coming * along <= 0.0:
        return None
    return (flying - going * along) / (coming * along)


def _slope(frame: NDArray[np.int64], value: FloatArray, first: int, last: int) -> float | None:
    used = (frame >= first) & (frame <= last)
    if np.count_nonzero(used) < _FEWEST:
        return None
    return float(np.polyfit(frame[used].astype(np.float64), value[used], 1)[0])
