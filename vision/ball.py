"""The ball, frame by frame: from a rough path to a fitted outline in each frame that shows it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.circles import find_circles
from vision.cutout import TYPICAL_GAMMA, ring_pixels, ring_widths
from vision.edge_profile import EdgeProfile
from vision.linking import Path
from vision.outline import OutlineFit, OutlineShape, fit_outline
from vision.scene import Scene

__all__ = ["SMALL_RADIUS", "BallFits", "follow_ball"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST_CONTRAST = 0.35
# Balls smaller than this are too few pixels for the outline model; the circle of their edges is
# used.
SMALL_RADIUS = 6.0
_VOTED_STD = 0.15


@dataclass(frozen=True)
class BallFits:
    """Outline fits of one ball in time order.

    Attributes
    ----------
    frame : (N,) int array
        Frame indices.
    fits : tuple of OutlineFit
        One per frame, in scene coordinates.
    """

    frame: IntArray
    fits: tuple[OutlineFit, ...]

    @property
    def centre(self) -> FloatArray:
        """Centres (N, 2), px."""
        return np.array([fit.centre for fit in self.fits]).reshape(-1, 2)

    @property
    def radius(self) -> FloatArray:
        """Radii (N,), px."""
        return np.array([fit.shape.radius for fit in self.fits])


def follow_ball(scene: Scene, path: Path) -> BallFits:
    """Fit the ball along a path, between its looks, and beyond both ends for as long as it is seen.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    path : Path
        Where the ball was in some frames.

    Returns
    -------
    BallFits
        With radius free; for later refinement.
    """
    radius = path.radius
    profile = EdgeProfile(radius, max(0.6, 0.12 * radius), 0.0)
    sharp = EdgeProfile(radius, 0.6, 0.0)
    first, last = int(path.frame[0]), int(path.frame[-1])
    inside = np.arange(first, last + 1)
    guess = np.column_stack(
        [np.interp(inside, path.frame, path.centre_px[:, axis]) for axis in (0, 1)]
    )
    found: dict[int, OutlineFit] = {}
    for (index, picture), start in zip(scene.pictures(inside), guess, strict=True):
        fit = _search(scene, index, picture, start, radius, (profile, sharp))
        if fit is None and np.any(np.abs(path.frame - index) <= 1):
            # A ball too smeared for the outline model is still where its circle was found.
            fit = _voted_fit(scene, index, picture, start, radius)
        if fit is not None:
            found[index] = fit
    found = _plausible(found, radius)
    for direction in (-1, 1):
        _extend(scene, found, radius, (profile, sharp), direction)
    order = sorted(found)
    return BallFits(np.array(order, dtype=np.int64), tuple(found[index] for index in order))


def _search(
    scene: Scene,
    index: int,
    picture: NDArray[np.float32],
    start: FloatArray,
    radius: float,
    profiles: tuple[EdgeProfile, EdgeProfile],
) -> OutlineFit | None:
    """Fit coarse, then fine; where the start was too far off, vote for the circle nearby first."""
    if radius < SMALL_RADIUS:
        return _voted_fit(scene, index, picture, start, radius)
    for attempt in range(2):
        if attempt == 1:
            voted = _voted_fit(scene, index, picture, start, radius)
            if voted is None:
                return None
            start = voted.centre
        fit: OutlineFit | None = None
        centre, size = start, radius
        for profile, wide in zip(profiles, (1.6, 1.0), strict=True):
            inner, outer = ring_widths(radius)
            reach = radius + wide * outer + 4.0
            pixels = ring_pixels(scene, index, picture, centre, reach, TYPICAL_GAMMA)
            if pixels is None:
                fit = None
                break
            fit = fit_outline(
                pixels,
                profile,
                centre,
                OutlineShape(size, np.zeros(2)),
                smear=np.zeros(2),
                free=3,
                radius_std=0.1 * radius,
                iterations=6,
                tolerance=0.05,
                inner=wide * inner,
                outer=wide * outer,
            )
            if fit is None:
                break
            centre, size = (
                fit.centre,
                float(np.clip(fit.shape.radius, 0.85 * radius, 1.15 * radius)),
            )
        if fit is not None and _believable(fit, radius, start):
            return fit
    return None


def _believable(fit: OutlineFit, radius: float, start: FloatArray) -> bool:
    swollen = abs(np.log(max(fit.shape.radius, 0.1) / radius))
    moved = float(np.hypot(*(fit.centre - start)))
    return fit.contrast >= _LEAST_CONTRAST and swollen < 0.2 and moved < 0.8 * radius


def _voted_fit(
    scene: Scene, index: int, picture: NDArray[np.float32], start: FloatArray, radius: float
) -> OutlineFit | None:
    """The circle of edges nearest the start: all that a ball of a few pixels allows."""
    reach = int(np.ceil(2.5 * radius + 6))
    height, width = picture.shape
    left, top = max(0, int(start[0]) - reach), max(0, int(start[1]) - reach)
    right, bottom = min(width, int(start[0]) + reach + 1), min(height, int(start[1]) + reach + 1)
    if right - left < 16 or bottom - top < 16:
        return None
    window = (slice(top, bottom), slice(left, right))
    circles = find_circles(
        np.ascontiguousarray(picture[window]),
        scene.expected(index, window),
        np.ascontiguousarray(scene.background.noise[window]),
        radii=(0.75 * radius, 1.3 * radius),
        most=4,
        least_coverage=0.5,
    )
    if len(circles) == 0:
        return None
    centres = circles.centre_px + np.array([left, top])
    gap = np.hypot(*(centres - start).T)
    clear = circles.coverage * np.log1p(circles.sharpness) / (1.0 + (gap / radius) ** 2)
    best = int(np.argmax(clear))
    std = max(_VOTED_STD, 0.03 * radius) * max(1.0, 30.0 / float(circles.sharpness[best]))
    return OutlineFit(
        centres[best],
        OutlineShape(float(circles.radius_px[best]), np.zeros(2)),
        np.diag([std**2, std**2, std**2]),
        np.diag([std**2, std**2, std**2]) / 9.0,
        1.0,
        float(circles.coverage[best]),
        True,
        np.zeros((5, 5)),
        np.zeros(5),
    )


def _plausible(found: dict[int, OutlineFit], radius: float) -> dict[int, OutlineFit]:
    """Drop fits that leap off the path of their neighbours and back."""
    order = np.array(sorted(found))
    if len(order) < 5:
        return found
    centre = np.array([found[int(index)].centre for index in order])
    kept = {}
    for place, index in enumerate(order):
        near = [j for j in range(max(0, place - 3), min(len(order), place + 4)) if j != place]
        expected = np.median(centre[near], axis=0)
        span = np.abs(centre[near] - expected).max(axis=0)
        if np.all(np.abs(centre[place] - expected) <= 2.0 * span + 0.5 * radius + 1.0):
            kept[int(index)] = found[int(index)]
    return kept


def _extend(
    scene: Scene,
    found: dict[int, OutlineFit],
    radius: float,
    profiles: tuple[EdgeProfile, EdgeProfile],
    direction: int,
) -> None:
    """Go on from one end, each frame predicted from the last few, until the ball is lost."""
    if len(found) < 2:
        return
    missed = 0
    frame = (max(found) if direction > 0 else min(found)) + direction
    while 0 <= frame < scene.count and missed < 4:
        known = sorted(found)[-4:] if direction > 0 else sorted(found)[:4]
        times = np.array(known, dtype=np.float64)
        centres = np.array([found[index].centre for index in known])
        slope = (centres[-1] - centres[0]) / (times[-1] - times[0])
        near = centres[-1] if direction > 0 else centres[0]
        near_time = times[-1] if direction > 0 else times[0]
        start = near + slope * (frame - near_time)
        height, width = scene.shape
        if not (0 <= start[0] < width and 0 <= start[1] < height):
            break
        picture = scene.picture(frame)
        fit = _search(scene, frame, picture, start, radius, profiles)
        if fit is None or np.hypot(*(fit.centre - start)) > 0.4 * radius + 0.3 * np.hypot(*slope):
            missed += 1
        else:
            found[frame] = fit
            missed = 0
        frame += direction
