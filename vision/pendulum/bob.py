"""The striking face of a spherical bob: its outline as a circle, and where that meets the ball.

Two spheres touch on the line between their centres: how far the bob leads its middle along the
motion follows from both radii and from how far the ball lies above or below it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vision.ball.outline.cutout import TYPICAL_GAMMA
from vision.ball.rest import Rest
from vision.pendulum.imaged_swing import ImagedSwing
from vision.pendulum.mass import MassPoses
from vision.scene.scene import Scene
from vision.tracks import Face

__all__ = ["find_bob_face"]

FloatArray = NDArray[np.float64]
FloatImage = NDArray[np.float32]

_FRAMES = 10
_BESIDE_BALL_PX = 2.5
_ROUNDS = 3
_ANGLES = 72
_STEP_PX = 0.25
# Of the bob's radius: where its outline is looked for, and where it is as light as at the rim.
_REACH, _LIMB = (0.5, 1.6), (0.6, 0.85)
# A rim point counts where the bob stands out from the wall by this share of the light.
_LEAST_CONTRAST = 0.06
_FEWEST = 12
_DARKEST = 0.02
# px: an unknown transfer curve and the limb's shading move the edge at half light by so much.
_LEAST_STD_PX = 0.2
# A square's rim strays from a circle by 0.12 of its radius.
_ROUND_SHARE = 0.06
# Half the arc about the arm's direction in which a rod hides the rim, rad.
_ROD = 0.5


def find_bob_face(
    scene: Scene,
    mass: MassPoses,
    swing: ImagedSwing,
    rest: Rest,
    radius: float,
    before: FloatImage,
) -> Face | None:
    """Find where a round bob will touch the ball.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    mass : MassPoses
        The bob as it was followed.
    swing : ImagedSwing
        Its arc.
    rest : Rest
        The ball before it is struck.
    radius : float
        Its radius, px.
    before : (H, W) float32 array
        The scene before the strike.

    Returns
    -------
    Face or None
        Its edge is the point of the bob foremost along the motion that the ball meets; None where
        no outline stands out.
    """
    coming = np.flatnonzero(mass.frame <= rest.last)
    if len(coming) == 0:
        return None
    size = float(np.sqrt(mass.patch.opacity.sum() / np.pi))
    gap = np.hypot(*(mass.anchor[coming] - rest.centre_px).T) - radius - size - _BESIDE_BALL_PX
    clear = coming[gap > 0.3 * size][-_FRAMES:]
    if len(clear) < 3:
        return None
    arm = mass.anchor[clear[-1]] - swing.pivot_px
    rod = float(np.arctan2(-arm[1], -arm[0]))
    centre, circle, std, left = np.zeros(2), size, np.inf, np.inf
    for _ in range(_ROUNDS):
        rim = _rim(scene, mass, clear, before, centre, circle, rod)
        if len(rim) < _FEWEST:
            return None
        centre, circle, std, left = _circle(rim, circle)
    if left > _ROUND_SHARE * circle:
        return None
    frame = int(clear[-1])
    at = mass.anchor[frame] + centre
    down = (at - swing.pivot_px) / np.hypot(*(at - swing.pivot_px))
    forward = np.array([down[1], -down[0]])
    forward = forward if forward @ rest.direction > 0 else -forward
    # when they touch, the ball's centre lies so far beyond the bob's along the arm
    away = float(np.hypot(*(rest.centre_px - swing.pivot_px)))
    reach, touching = float(np.hypot(*(at - swing.pivot_px))), radius + circle
    beyond = (away**2 - reach**2 - touching**2) / (2.0 * reach)
    ahead = float(np.sqrt(max(touching**2 - min(abs(beyond), circle) ** 2, 0.0))) - radius
    edge_std = max(std, _LEAST_STD_PX)
    return Face(int(mass.frame[frame]), at + ahead * forward, edge_std, spherical=True)


def _rim(
    scene: Scene,
    mass: MassPoses,
    rows: NDArray[np.int64],
    before: FloatImage,
    centre: FloatArray,
    radius: float,
    rod: float,
) -> FloatArray:
    """Points (n, 2) of the rim about the anchor, px, where light is half that of bob and wall."""
    turn = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False)
    free = np.abs(np.angle(np.exp(1j * (turn - rod)))) > _ROD
    turn = turn[free]
    away = np.arange(_REACH[0] * radius, _REACH[1] * radius, _STEP_PX)
    ray = np.column_stack([np.cos(turn), np.sin(turn)])
    spot = centre + away[None, :, None] * ray[:, None]
    total = np.zeros(spot.shape[:2])
    for row in rows:
        index = int(mass.frame[row])
        at = (spot + mass.anchor[row]).astype(np.float32)
        seen = _light(_at(scene.picture(index), at) / scene.views[index].gain)
        total += seen / _light(_at(before, at)) / len(rows)
    limb = (away > _LIMB[0] * radius) & (away < _LIMB[1] * radius)
    inside = np.median(total[:, limb], axis=1)
    outside = np.median(total[:, away > (_REACH[1] - 0.3) * radius], axis=1)
    points = []
    for ray_at, profile, dark, bright in zip(ray, total, inside, outside, strict=True):
        if abs(bright - dark) < _LEAST_CONTRAST or abs(bright - 1.0) > 0.5 * abs(dark - 1.0):
            continue
        half = (profile - dark) / (bright - dark) - 0.5
        cross = np.flatnonzero((half[:-1] < 0.0) & (half[1:] >= 0.0))
        if len(cross) == 1:
            place = int(cross[0])
            part = -half[place] / (half[place + 1] - half[place])
            points.append(centre + (away[place] + part * _STEP_PX) * ray_at)
    return np.array(points)


def _at(picture: FloatImage, at: NDArray[np.float32]) -> FloatArray:
    border = cv2.BORDER_REPLICATE
    seen = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_CUBIC, borderMode=border)
    return np.asarray(seen, dtype=np.float64)


def _light(gray: FloatArray) -> FloatArray:
    """Light of a gray level, kept off zero, for it is divided by."""
    return np.asarray(np.maximum(gray / 255.0, _DARKEST) ** TYPICAL_GAMMA)


def _circle(rim: FloatArray, radius: float) -> tuple[FloatArray, float, float, float]:
    """Centre, radius, how well its foremost point is known, and scatter of the rim, px."""

    def misfit(state: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(*(rim - state[:2]).T) - state[2])

    start = [*np.median(rim, axis=0), radius]
    found = least_squares(misfit, start, loss="soft_l1", f_scale=0.1)
    left = 1.4826 * float(np.median(np.abs(misfit(found.x))))
    slopes = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(slopes.T @ slopes) * left**2
    # neighbouring rays share their errors
    std = float(np.sqrt(3.0 * (covariance[0, 0] + covariance[2, 2])))
    return np.asarray(found.x[:2]), float(found.x[2]), std, left
