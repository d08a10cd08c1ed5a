"""The ball, frame by frame: from a rough path to sub-pixel outlines of one shape."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.circles import find_circles
from vision.edge_profile import EdgeProfile
from vision.linking import Path
from vision.outline import OutlineFit, OutlineShape, RingPixels, fit_outline
from vision.scene import Scene

__all__ = ["BallFits", "Occluder", "follow_ball", "refine_ball"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Edges mix light before the camera's transfer curve is applied (ITU-R BT.709 and sRGB are both near this).
_GAMMA = 2.2
_SPREADS = (0.35, 0.6, 0.9, 1.3, 1.8)
_LEAST_CONTRAST = 0.35
# Balls smaller than this are too few pixels for the outline model; the circle of their edges is used.
SMALL_RADIUS = 6.0
_VOTED_STD = 0.15


class Occluder:
    """Where another thing may stand before the ball: nothing, unless a subclass knows better."""

    def hides(self, frame: int, x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
        """Whether pixels (x, y) of a frame show something else than ball or background."""
        return np.zeros(x.shape, dtype=bool)


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


def ring_widths(radius: float) -> tuple[float, float]:
    """How far inside and outside the outline pixels are used, px."""
    return float(np.clip(0.2 * radius, 2.2, 6.0)), float(np.clip(0.2 * radius, 2.5, 4.0))


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
            pixels = _pixels(scene, index, picture, centre, radius + wide * outer + 4.0, None)
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
    std = _VOTED_STD * max(1.0, 30.0 / float(circles.sharpness[best]))
    return OutlineFit(
        centres[best],
        OutlineShape(float(circles.radius_px[best]), np.zeros(2)),
        np.diag([std**2, std**2, std**2]),
        np.diag([std**2, std**2, std**2]) / 9.0,
        1.0,
        float(circles.coverage[best]),
        True,
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
        if np.all(np.abs(centre[place] - expected) <= span + 0.5 * radius + 1.0):
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
        if direction > 0:
            known = sorted(found)[-4:]
        else:
            known = sorted(found)[:4]
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


def _pixels(
    scene: Scene,
    index: int,
    picture: NDArray[np.float32],
    centre: FloatArray,
    reach: float,
    occluder: Occluder | None,
) -> RingPixels | None:
    """Cut the pixels around out of frame and background, in linear light."""
    height, width = picture.shape
    left, top = max(0, int(centre[0] - reach)), max(0, int(centre[1] - reach))
    right, bottom = min(width, int(centre[0] + reach) + 2), min(height, int(centre[1] + reach) + 2)
    if right - left < 5 or bottom - top < 5:
        return None
    window = (slice(top, bottom), slice(left, right))
    gray = picture[window].astype(np.float64).ravel()
    background = scene.expected(index, window).astype(np.float64).ravel()
    noise = scene.background.noise[window].astype(np.float64).ravel()
    rows, columns = np.mgrid[top:bottom, left:right]
    x, y = columns.ravel().astype(np.float64), rows.ravel().astype(np.float64)
    hidden = occluder.hides(index, x, y) if occluder is not None else np.zeros(x.shape, dtype=bool)
    usable = ~hidden & (gray < 254.5)
    slope = _GAMMA * np.clip(gray / 255.0, 0.05, 1.0) ** (_GAMMA - 1.0)
    return RingPixels(x, y, _linear(gray), _linear(background), noise * slope, usable)


def _linear(gray: FloatArray) -> FloatArray:
    return np.asarray(255.0 * np.clip(gray / 255.0, 0.0, 1.0) ** _GAMMA)


def refine_ball(
    scene: Scene,
    rough: BallFits,
    duty: float,
    occluder: Occluder | None = None,
) -> BallFits:
    """Fit again with one shape for the whole clip, the exposure's smear, and what hides the ball known.

    Parameters
    ----------
    scene : Scene
        Footage with its static scene.
    rough : BallFits
        Fits with free radius.
    duty : float
        Exposure time over frame interval.
    occluder : Occluder, optional
        What may stand before the ball.

    Returns
    -------
    BallFits
        With the centre free and the shape common to all frames.
    """
    velocity = _velocity(rough)
    typical = float(np.median(rough.radius))
    if typical < SMALL_RADIUS:
        return rough
    most_smear = min(duty * float(np.max(np.hypot(velocity[:, 0], velocity[:, 1]))), 2 * typical)
    spread = _best_spread(scene, rough, velocity * duty, typical, most_smear)
    profile = EdgeProfile(typical, spread, most_smear)
    free = 5 if typical > 12.0 else 3
    shaped = _fit_all(scene, rough, velocity * duty, profile, free, None, occluder)
    if not shaped.fits:
        return rough
    common = _common_shape(shaped)
    shapes = np.column_stack(
        [np.interp(rough.frame, shaped.frame, common[:, column]) for column in range(3)]
    )
    return _fit_all(scene, rough, velocity * duty, profile, 2, shapes, occluder)


def _velocity(fits: BallFits) -> FloatArray:
    if len(fits.frame) < 3:
        return np.zeros((len(fits.frame), 2))
    return np.column_stack(
        [np.gradient(fits.centre[:, axis], fits.frame.astype(np.float64)) for axis in (0, 1)]
    )


def _best_spread(
    scene: Scene, rough: BallFits, smear: FloatArray, radius: float, most_smear: float
) -> float:
    """Choose the point spread whose edges fit best."""
    chosen = np.unique(np.linspace(0, len(rough.frame) - 1, 9).astype(int))
    part = BallFits(rough.frame[chosen], tuple(rough.fits[i] for i in chosen))
    misfits = []
    for spread in _SPREADS:
        profile = EdgeProfile(radius, spread, most_smear)
        fits = _fit_all(scene, part, smear[chosen], profile, 3, None, None)
        misfits.append(np.median([fit.misfit for fit in fits.fits]) if fits.fits else np.inf)
    return _SPREADS[int(np.argmin(misfits))]


def _fit_all(
    scene: Scene,
    rough: BallFits,
    smear: FloatArray,
    profile: EdgeProfile,
    free: int,
    shapes: FloatArray | None,
    occluder: Occluder | None,
) -> BallFits:
    radius = float(np.median(rough.radius))
    inner, outer = ring_widths(radius)
    frames, fits = [], []
    for place, (index, picture) in enumerate(scene.pictures(rough.frame)):
        start = rough.fits[place].centre
        pixels = _pixels(scene, index, picture, start, radius + outer + 4.0, occluder)
        if pixels is None:
            continue
        shape = (
            OutlineShape(radius, np.zeros(2))
            if shapes is None
            else OutlineShape(float(shapes[place, 0]), shapes[place, 1:])
        )
        fit = fit_outline(
            pixels,
            profile,
            start,
            shape,
            smear=smear[place],
            free=free,
            radius_std=0.1 * radius,
            inner=inner,
            outer=outer,
        )
        if fit is not None and np.hypot(*(fit.centre - start)) < 0.5 * radius:
            frames.append(index)
            fits.append(fit)
    return BallFits(np.array(frames, dtype=np.int64), tuple(fits))


def _common_shape(fits: BallFits) -> FloatArray:
    """Shape along the track: a plane over the picture for radius and ellipse, robustly fitted."""
    values = np.array([[fit.shape.radius, *fit.shape.ellipse] for fit in fits.fits])
    centre = fits.centre
    middle = centre.mean(axis=0)
    span = max(float(np.ptp(centre, axis=0).max()), 1.0)
    place = (centre - middle) / span
    design = np.column_stack([np.ones(len(place)), place])
    if span < 4.0 * float(np.median(values[:, 0])):
        design = design[:, :1]
    return np.column_stack([_robust_plane(design, values[:, i]) for i in range(3)])


def _robust_plane(design: FloatArray, value: FloatArray) -> FloatArray:
    weight = np.ones(len(value))
    ridge = 1e-6 * np.eye(design.shape[1]) * len(value)
    fitted = np.full(len(value), np.median(value))
    for _ in range(8):
        weighted = design * weight[:, None]
        fitted = design @ np.linalg.solve(weighted.T @ design + ridge, weighted.T @ value)
        gap = np.abs(value - fitted)
        scale = max(1.4826 * float(np.median(gap)), 1e-6)
        weight = 1.0 / (1.0 + (gap / (2.0 * scale)) ** 2)
    return np.asarray(fitted)
