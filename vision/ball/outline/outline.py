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
    Equations,
    OutlineFits,
    Ring,
    Sums,
    Template,
    linearised,
    nothing_found,
    panelled,
    reduced,
)
from vision.scene.scene import FilmedScene, Window
from vision.workers import side_by_side

__all__ = ["FitRules", "Start", "fit_outlines", "voted_outlines"]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

BoolArray = NDArray[np.bool_]

_BATCH_PIXELS = 80_000
"""Pixels worked on at once: those of a handful of frames stay in the processor's cache."""

_SETTLED = 0.3
"""px: a step below which the ring of pixels and the panels of a ball are settled."""

# How far inside a sector is used that an edge of the ball's own crosses, px: the outline's blur.
_NARROW = 1.6

_BASIS = 3

# Independent parts that an outline is taken to have.
_CLUSTERS = 8


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
    template = Template(float(np.median(start.shape[:, 0])), rules.inner, rules.outer)
    batch = max(1, _BATCH_PIXELS // template.size)
    parts = [np.arange(first, min(first + batch, count)) for first in range(0, count, batch)]

    def run(places: IntArray) -> None:
        # Each writes rows of its own.
        _Batch(cutouts, profile, start, rules, template, places).run(fits)

    deque(side_by_side(run, parts), maxlen=0)
    return fits


class _Batch:
    """A few frames iterated together; those that have converged drop out."""

    def __init__(
        self,
        cutouts: Cutouts,
        profile: EdgeProfile,
        start: Start,
        rules: FitRules,
        template: Template,
        places: IntArray,
    ) -> None:
        self._cutouts, self._template = cutouts, template
        self._rules = rules
        self._equations = Equations(profile, float(np.median(start.shape[:, 0])))
        self._radius = start.shape[:, 0]
        self._smear = start.smear
        self._places = places
        self._parameters = np.column_stack([start.centre[places], start.shape[places]])
        self._last = np.full(len(places), 1e9)
        self._held = np.zeros(rules.free)
        if rules.free > 2:
            self._held[2] = 1.0 / rules.radius_std**2

    def _ring(self) -> Ring:
        return self._template.gathered(self._cutouts, self._places, self._parameters)

    def _keep(self, kept: BoolArray) -> None:
        self._places, self._last = self._places[kept], self._last[kept]
        self._parameters = self._parameters[kept]

    def run(self, fits: OutlineFits) -> None:
        """Iterate, and write what was found into the rows of `fits`."""
        ring = self._ring()
        done: list[tuple[IntArray, FloatArray]] = []
        for _ in range(self._rules.iterations):
            if not np.all(ring.enough):
                self._keep(ring.enough)
                ring = ring.where(ring.enough)
            if len(self._places) == 0:
                break
            length = self._advance(ring)
            short = length < self._rules.tolerance
            self._last = length
            if np.any(short):
                done.append((self._places[short], self._parameters[short]))
                self._keep(~short)
                ring = ring.where(~short)
            if np.any(ring.moved(self._parameters) | (self._last > _SETTLED)):
                ring = self._ring()
        done.append((self._places, self._parameters))
        self._places = np.concatenate([places for places, _ in done])
        self._parameters = np.concatenate([parameters for _, parameters in done])
        self._finish(fits)

    def _advance(self, ring: Ring) -> FloatArray:
        """One Gauss–Newton step; returns how far the centres went."""
        sums = self._sums(ring, 3)
        free = self._rules.free
        step, _ = self._step(sums, free)
        length = np.hypot(step[:, 0], step[:, 1])
        limit = 0.35 * self._rules.inner
        step *= np.minimum(1.0, limit / np.maximum(length, 1e-12))[:, None]
        self._parameters[:, :free] += step
        return length

    def _sums(self, ring: Ring, size: int) -> Sums:
        """The equations; once the outline is near, without what panels do further inside."""
        smear = self._smear[self._places]
        sums = linearised(self._equations, ring, self._parameters, smear, size)
        crossed = panelled(sums) & (self._last < _SETTLED)[:, None]
        if self._rules.free > 2 or not crossed.any():
            return sums
        narrow = ring.narrowed(crossed, self._parameters, _NARROW)
        return linearised(self._equations, narrow, self._parameters, smear, size)

    def _step(self, sums: Sums, free: int) -> tuple[FloatArray, FloatArray]:
        normal, score, _ = reduced(sums, self._last < _SETTLED)
        pull = score.sum(axis=1)[:, :free]
        normal = normal[:, :free, :free]
        if free > 2:
            start = self._radius[self._places]
            pull[:, 2] -= self._held[2] * (self._parameters[:, 2] - start)
        trace = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        damped = normal + 1e-6 * trace * np.eye(free) + np.diag(self._held)
        return np.linalg.solve(damped, pull[:, :, None])[:, :, 0], pull

    def _finish(self, fits: OutlineFits) -> None:
        if len(self._places) == 0:
            return
        ring = self._ring()
        self._last = np.zeros(len(self._places))
        self._keep(ring.enough)
        ring = ring.where(ring.enough)
        places, parameters = self._places, self._parameters
        if len(places) == 0:
            return
        size = 5 if self._rules.shape_pull else 3
        sums = self._sums(ring, size)
        free = self._rules.free
        whole, pulls, every = reduced(sums, np.ones(len(places), dtype=bool))
        normal, score = whole[:, :free, :free], pulls[:, :, :free]
        held, unit = np.diag(self._held), np.eye(free)
        trace = np.trace(normal, axis1=1, axis2=2)[:, None, None]
        inverse = np.linalg.inv(normal + held + 1e-9 * (trace + 1e-9) * unit)
        seen = sums.size > 0
        count = np.count_nonzero(seen, axis=1)
        share = count / np.maximum(count - free, 1)
        meat = _clustered(score) * share[:, None, None]
        total = every[:, :, :free, :free].sum(axis=1)
        trace = np.trace(total, axis1=1, axis2=2)[:, None, None]
        bound = np.linalg.inv(total + held + 1e-9 * (trace + 1e-9) * unit)
        spare = np.maximum(sums.size.sum(axis=1) - _BASIS * count, 1.0)
        rms_residual = np.sqrt(sums.square.sum(axis=1) / spare)
        strength = every[:, :, 0, 0] + every[:, :, 1, 1]
        clear = np.count_nonzero(strength > 4.0 * rms_residual[:, None] ** 2, axis=1)
        fits.found[places] = True
        fits.centre[places] = parameters[:, :2]
        fits.radius[places] = parameters[:, 2]
        fits.covariance[places] = (inverse @ meat @ inverse)[:, :2, :2]
        fits.bound[places] = bound[:, :2, :2]
        fits.rms_residual[places] = rms_residual
        fits.contrast[places] = clear / seen.shape[1]
        fits.normal[places, :size, :size] = whole
        fits.pull[places, :size] = pulls.sum(axis=1)


def _clustered(score: FloatArray) -> FloatArray:
    """Sum of the outer products of the sectors' scores (F, S, P), neighbours' cross terms with it.

    What a panel, a shadow or a highlight does to the outline it does over several sectors (Newey
    and West 1987, around the circle).
    """
    sectors = score.shape[1]
    reach = sectors // _CLUSTERS
    meat = np.einsum("nsi,nsj->nij", score, score)
    for lag in range(1, reach + 1):
        cross = np.einsum("nsi,nsj->nij", score, np.roll(score, lag, axis=1))
        meat += (1.0 - lag / (reach + 1.0)) * (cross + np.swapaxes(cross, 1, 2))
    return np.asarray(meat)


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
