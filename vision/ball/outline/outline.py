"""Sub-pixel outlines of a ball: an edge model fitted to the pixels against the known background.

In a ring of pixels about the outline, each a mixture of background and ball,

    I = k·(1 − G₀(ρ))·B + A·G₀(ρ) + C·G₁(ρ),

B is the known background (so that grid lines behind the ball pull nothing), G₀ the covered part of
the pixel and G₁ the same times the sphere's shading (`edge_profile`). k (a shadow behind the ball),
A and C (whatever colour and shading the ball has there) are free in each sector of the outline, so
that neither panels nor light bias it; they are eliminated (variable projection, Golub
and Pereyra 1973) and only the outline's few parameters are iterated. Sectors that the model does
not describe lose weight. Many frames are fitted at once.

The circle of edges nearest a guess: all that a ball of a few pixels allows.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ball.circles import find_circles
from vision.ball.outline.edges import Cutouts, EdgeProfile
from vision.ball.outline.equations import (
    SLACK_PX,
    OutlineFits,
    fitted_outlines,
    nothing_found,
)
from vision.scene.scene import FilmedScene, Window
from vision.workers import side_by_side

__all__ = ["FitRules", "Start", "fit_outlines", "voted_outlines"]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

BoolArray = NDArray[np.bool_]

_BATCH = 16
"""Frames that one core fits before it takes the next, supposed."""

_SECTOR_PX, _SECTORS = 4.0, (6, 40)
"""px of outline, and how many at least and at most: a sector of less than four pixels of outline
has too few pixels for its light."""

_SHADOW_PRIOR = 0.3
"""Prior width of a sector's shadow factor, about 1."""

_SHADING_PRIOR = 255.0
"""Gray levels, prior width of the light of a sector: full scale, that is none."""

_SMALL_RADIUS = 10.0
"""px: smaller balls show less of their light within a sector, and its priors narrow with them."""


@dataclass(frozen=True)
class FitRules:
    """How to fit.

    Attributes
    ----------
    free : int
        2: centre only; 3: and radius.
    radius_std : float
        How far from the starting radius a free one may be, one sigma, px.
    inner, outer : float
        How far the ring reaches inside and outside the outline, px.
    iterations : int
        Steps at most.
    tolerance : float
        A step shorter than this is the last, px.
    shape_pull : bool
        Whether radius and ellipse are wanted in the normal equations that are handed back.
    """

    free: int = 2
    radius_std: float = np.inf
    inner: float = 6.0
    outer: float = 4.0
    iterations: int = 8
    tolerance: float = 1e-2
    shape_pull: bool = False


@dataclass(frozen=True)
class Start:
    """Where the fits begin.

    Attributes
    ----------
    centre : (F, 2) array
        Centres, px.
    shape : (F, 3) array
        Radius and ellipse a, b: the outline is r + a cos 2θ + b sin 2θ, px; what is not free is
        held there.
    smear : (F, 2) array
        Motion during the exposure, px.
    """

    centre: FloatArray
    shape: FloatArray
    smear: FloatArray

    def at(self, places: IntArray | slice) -> "Start":
        """Some of them."""
        return Start(self.centre[places], self.shape[places], self.smear[places])


def fit_outlines(
    cutouts: Cutouts, profile: EdgeProfile, start: Start, rules: FitRules
) -> OutlineFits:
    """Fit a ball's outline in several frames.

    Parameters
    ----------
    cutouts : Cutouts
        The pixels around, one piece per frame.
    profile : EdgeProfile
        Edge profiles for about this radius.
    start : Start
        Where to begin, one row per frame.
    rules : FitRules
        How to fit.

    Returns
    -------
    OutlineFits
        Of all frames; `found` is false where too little of the outline is in view.
    """
    count = len(start.centre)
    fits = nothing_found(count)
    if count == 0:
        return fits
    usual = float(np.median(start.shape[:, 0]))
    ring = _Ring(usual, rules.inner, rules.outer)
    outline = np.column_stack([start.centre, start.shape])
    held = np.zeros(rules.free)
    if rules.free > 2:
        held[2] = 1.0 / rules.radius_std**2

    def run(first: int) -> None:
        # Each writes rows of its own.
        fitted_outlines(
            cutouts.gray,
            cutouts.background,
            cutouts.inverse_noise,
            cutouts.corner,
            ring.places,
            ring.bounds,
            np.array([rules.inner, rules.outer]),
            ring.reach,
            profile.tables,
            profile.steps,
            _priors(usual),
            held,
            start.smear,
            5 if rules.shape_pull else 3,
            rules.iterations,
            rules.tolerance,
            first,
            min(first + _BATCH, count),
            outline,
            fits.found,
            fits.covariance,
            fits.bound,
            fits.rms_residual,
            fits.contrast,
            fits.normal,
            fits.pull,
        )

    deque(side_by_side(run, range(0, count, _BATCH)), maxlen=0)
    fits.centre[:], fits.radius[:] = outline[:, :2], outline[:, 2]
    return fits


class _Ring:
    """Which pixels about a whole pixel make up the ring, the same for all frames.

    Parameters
    ----------
    radius : float
        Radius of the outline, px.
    inner, outer : float
        How far the ring reaches inside and outside, px.

    Attributes
    ----------
    places : (2, n) int array
        x, y, sorted by sectors of about four pixels of outline, px.
    bounds : (S + 1,) int array
        Where each sector's begin.
    reach : int
        Of the outermost, px.
    """

    def __init__(self, radius: float, inner: float, outer: float) -> None:
        self.reach = int(np.ceil(radius + outer + SLACK_PX))
        axis = np.arange(-self.reach, self.reach + 1)
        y, x = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
        rho = np.hypot(x, y)
        near = (rho > max(radius - inner - SLACK_PX, 0.5)) & (rho < radius + outer + SLACK_PX)
        x, y = x[near], y[near]
        count = int(np.clip(round(2 * np.pi * radius / _SECTOR_PX), *_SECTORS))
        sector = np.floor((np.arctan2(y, x) / (2 * np.pi) + 0.5) * count).astype(np.int64) % count
        order = np.argsort(sector, kind="stable")
        self.places = np.stack([x[order], y[order]])
        self.bounds = np.searchsorted(sector[order], np.arange(count + 1))


def _priors(radius: float) -> FloatArray:
    """Information on a sector's k, A and C: a small ball has too few pixels to free them."""
    small = min(1.0, radius / _SMALL_RADIUS)
    width = np.array([_SHADOW_PRIOR * small, _SHADING_PRIOR, _SHADING_PRIOR * small])
    return np.asarray(width**-2.0)


FloatImage = NDArray[np.float32]

_VOTED_STD = 0.15
"""px, of a circle by votes, supposed: half of what rounding to pixels leaves, 1/√12."""

# How much a circle's radius scatters (natural logarithm).
_SWELLING = 0.15
"""Log radius: how much a circle's radius scatters by votes, supposed."""

_SMALLEST_WINDOW = 16
"""px: in a smaller window no ring of the smallest ball has its background."""


def voted_outlines(
    scene: FilmedScene, frame: IntArray, guess: FloatArray, radius: float
) -> OutlineFits:
    """Find the circle of edges nearest each guess.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    frame : (F,) int array
        Frame indices, increasing.
    guess : (F, 2) array
        Where it may be, px.
    radius : float
        Its radius, px.

    Returns
    -------
    OutlineFits
    """
    fits = nothing_found(len(frame))
    windows = [_window(start, radius, scene.shape) for start in guess]
    for place, (index, gray) in enumerate(scene.windows(frame, windows)):
        if min(gray.shape) >= _SMALLEST_WINDOW:
            picture = gray.astype(np.float32)
            _vote(scene, index, picture, windows[place], guess[place], radius, fits, place)
    return fits


def _window(start: FloatArray, radius: float, shape: tuple[int, int]) -> Window:
    reach = int(np.ceil(2.5 * radius + 6))
    x, y = int(start[0]), int(start[1])
    return (
        slice(max(0, y - reach), max(0, min(shape[0], y + reach + 1))),
        slice(max(0, x - reach), max(0, min(shape[1], x + reach + 1))),
    )


def _vote(
    scene: FilmedScene,
    index: int,
    picture: FloatImage,
    window: Window,
    start: FloatArray,
    radius: float,
    fits: OutlineFits,
    place: int,
) -> None:
    circles = find_circles(
        picture,
        scene.expected(index, window),
        np.ascontiguousarray(scene.background.noise[window]),
        radii=(0.75 * radius, 1.3 * radius),
        most=8,
        least_coverage=0.5,
    )
    if len(circles) == 0:
        return
    centres = circles.centre_px + np.array([window[1].start, window[0].start])
    gap = np.hypot(*(centres - start).T)
    swollen = np.log(circles.radius_px / radius) / _SWELLING
    clear = circles.coverage * np.log1p(circles.sharpness)
    clear /= (1.0 + (gap / radius) ** 2) * (1.0 + swollen**2)
    best = int(np.argmax(clear))
    std = max(_VOTED_STD, 0.03 * radius) * max(1.0, 30.0 / float(circles.sharpness[best]))
    # A circle of another size is not the outline: its centre may be off by as much.
    std = float(np.hypot(std, circles.radius_px[best] - radius))
    fits.found[place] = True
    fits.centre[place] = centres[best]
    fits.radius[place] = circles.radius_px[best]
    fits.covariance[place] = std**2 * np.eye(2)
    fits.bound[place] = std**2 / 9.0 * np.eye(2)
    fits.rms_residual[place] = 1.0
    fits.contrast[place] = circles.coverage[best]
