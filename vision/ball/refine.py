"""The ball's outlines fitted again, all of one shape, with the optics learnt from the clip."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.ball.ball import LEAST_CONTRAST, SMALL_RADIUS, BallFits, trusted_rows
from vision.ball.edges import (
    Cutouts,
    CutPlaces,
    EdgeProfile,
    Hides,
    cut_out,
    piece_bytes,
    ring_widths,
)
from vision.ball.outline import (
    FitRules,
    OutlineFits,
    Start,
    fit_outlines,
    nothing_found,
)
from vision.scene import FilmedScene

__all__ = ["MODEL_STD_PX", "Optics", "refine_ball"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SPREADS = (0.25, 0.45, 0.7, 1.0, 1.5)
"""px, standard deviations of the point spread that are tried: each about half as much again."""
_DUTIES = (0.1, 0.35, 0.6, 0.85)
"""Share of the time between frames that the shutter is open, from a flash to nearly all of it."""
_SMEARED = 0.7
"""px that a ball goes from frame to frame: of less the shutter smears next to nothing."""
_TRIAL_FRAMES = 27
"""Frames on which blur and shutter are tried. Derived: with nine a few other frames turned a spread
of 0.4 px into 1.1 and the radius by 3 %; from fifteen on both stay."""
_SHAPE_FRAMES = 40
"""Frames that tell the ball's shape: more hardly average its errors, since neighbours look
alike."""
_SHAPE_STEPS, _SHAPE_SETTLED_PX = 24, 0.02
"""Steps of the shape at most, supposed, and a step of any outline, px, that is the last: a third of
what the model itself leaves. Where the rim is faint each step goes but a third of the way."""
_FEWEST_SHARP = 5
"""Frames: optics and shape of one ball are not told by fewer."""
_BEGIN_ROUNDS = 6
"""Rounds of reweighting, supposed: outliers are out after a few."""
_KEPT_BYTES = 50_000_000
"""Bytes of pieces that are kept for the next fit, supposed: some hundred frames of a ball of 100 px
across; cutting them out takes as long as fitting half of them."""
# Scatter of a radius that is fitted free, in radii.
_FREE_RADIUS = 0.02
_TOLERANCE = 5e-3
"""px: a step that matters to no measurement, a tenth of the best outline's uncertainty."""
# How far inside pixels are used, in radii: once the outline is found, less of a ball's panels and
# shading is better.
_INNER = 0.15
_LEAST_INNER_PX = 2.2
"""px inside the rim that is used: beyond two standard deviations of a point spread of one pixel."""
_WINDOWS = (13, 7)
"""Frames over which motion is smooth, the longer where there are enough: errors of neighbours are
alike, as the ball looks alike."""
_BOUNDED = 0.9247
"""Mean square of a normal variable, bounded at nine times its median (derived)."""

_FEWEST_WINDOWS = 8
"""Windows that tell a scatter: to a third (derived)."""

# A shape that fewer of the frames bear out is not the ball's (one that comes nearer, say).
_LEAST_KEPT = 0.8
# What shading, transfer curve and texture do to an outline for many frames alike, and no scatter
# shows, px: seen on ray-traced scenes and on our own renders, balls of 9 to 35 px in radius.
MODEL_STD_PX = 0.07

_HIDDEN = 0.28
"""Part of the rim that is not clearly seen at which that is twice as large; it grows by the cube of
it. Errors of a centre along an axis, medians over clips, where all of the rim, 75 %, 65 % and 55 %
are seen: 0.07, 0.12, 0.22 and 0.46 px over 15 clips of another renderer, 0.11, 0.31, 0.47 and 0.57
px over 118 rooms at random."""


@dataclass(frozen=True)
class Optics:
    """What the camera does to an edge.

    Attributes
    ----------
    spread : float
        Standard deviation of the point spread, px.
    duty : float
        Exposure time over frame interval.
    """

    spread: float
    duty: float


def refine_ball(
    scene: FilmedScene, rough: BallFits, hides: Callable[[int], Hides | None] | None = None
) -> BallFits:
    """Fit again with one shape for the whole clip, and point spread and smear known.

    Parameters
    ----------
    scene : FilmedScene
        Footage with its static scene.
    rough : BallFits
        Fits with free radius.
    hides : callable, optional
        Gives for a frame what may stand before the ball.

    Returns
    -------
    BallFits
        With the centre free and the shape common to all frames. Balls of a few pixels stay as they
        are.
    """
    if rough.unrefined:
        # Only sharp outlines can be fitted more finely.
        sharp = ~np.isin(rough.frame, list(rough.unrefined))
        if np.count_nonzero(sharp) < _FEWEST_SHARP:
            return trusted_rows(rough)
        finer = refine_ball(scene, replace(rough.at(sharp), unrefined=frozenset()), hides)
        other = finer.at(~np.isin(finer.frame, list(rough.unrefined)))
        return trusted_rows(other.together(rough.at(~sharp)))
    typical = float(np.median(rough.radius))
    if typical < SMALL_RADIUS or len(rough.frame) < _FEWEST_SHARP:
        return trusted_rows(_calibrated(rough))
    whole = _with_missed(rough, hides)
    refiner = _Refiner(scene, whole, typical, hides)
    refiner.learn_optics()
    shape = _CommonShape(typical, scene.shape)
    shape.begin(whole.at(refiner.clear))
    for _ in range(_SHAPE_STEPS):
        shaped = refiner.fit(_evenly(refiner.clear, _SHAPE_FRAMES), 2, shape)
        if len(shaped.frame) < 3:
            return trusted_rows(_calibrated(rough))
        if shape.improve(shaped.fits) < _SHAPE_SETTLED_PX:
            break
    every = np.arange(len(whole.frame))
    refined = shape.improved_by(refiner.fit(every, 2, shape))
    refined = _between(refined, refiner.fit(every, 2, shape, panels=False))
    seen = refined.fits.contrast >= LEAST_CONTRAST
    refined = refined.at(seen | np.isin(refined.frame, rough.frame))
    # Where the model does not hold (a sharpened picture, a puck with a rim), the plain fits may
    # scatter less; the clip itself says so.
    holds = len(refined) >= _LEAST_KEPT * len(rough) and _unrest(refined) <= 1.1 * _unrest(rough)
    smoother = refined if holds else rough
    return trusted_rows(_calibrated(smoother))


def _with_missed(rough: BallFits, hides: Callable[[int], Hides | None] | None) -> BallFits:
    """Rows to begin from, too, where a body beside the ball was taken for a part of it."""
    if hides is None:
        return rough
    between = np.setdiff1d(np.arange(rough.frame[0], rough.frame[-1] + 1), rough.frame)
    missed = np.array([index for index in between.tolist() if hides(index) is not None], dtype=int)
    if len(missed) == 0:
        return rough
    fits = nothing_found(len(missed))
    for axis in (0, 1):
        fits.centre[:, axis] = np.interp(missed, rough.frame, rough.centre[:, axis])
    fits.radius[:] = np.interp(missed, rough.frame, rough.radius)
    return rough.together(BallFits(missed, fits))


def _between(one: BallFits, other: BallFits) -> BallFits:
    """Centres midway between two fits, their distance a part of what they state.

    Whether what fits badly is a panel of the ball's or the codec's work no fit tells: neither
    outline is known to be the right one.
    """
    _, own, theirs = np.intersect1d(one.frame, other.frame, return_indices=True)
    away = other.centre[theirs] - one.centre[own]
    centre, covariance = one.centre.copy(), one.fits.covariance.copy()
    centre[own] += 0.5 * away
    covariance[own] += 0.25 * away[:, :, None] * away[:, None, :]
    return replace(one, fits=replace(one.fits, centre=centre, covariance=covariance))


def _unrest(fits: BallFits) -> float:
    """Typical third difference of successive positions, px: nought for smooth motion."""
    if len(fits.frame) < 8:
        return np.inf
    run = fits.frame[3:] - fits.frame[:-3] == 3
    third = np.abs(np.diff(fits.centre, 3, axis=0))[run]
    return float(np.quantile(third, 0.75)) if len(third) else np.inf


class _Refiner:
    def __init__(
        self,
        scene: FilmedScene,
        rough: BallFits,
        radius: float,
        hides: Callable[[int], Hides | None] | None,
    ) -> None:
        self._scene = scene
        self._rough = rough
        self._radius = radius
        self._hides = hides
        self._velocity = np.column_stack(
            [np.gradient(rough.centre[:, axis], rough.frame.astype(np.float64)) for axis in (0, 1)]
        )
        self.optics = Optics(0.6, 0.5)
        contrast = rough.fits.contrast
        near = np.abs(rough.radius / radius - 1.0) < 0.1
        self.clear = np.nonzero((contrast >= np.median(contrast) - 0.05) & near)[0]
        if len(self.clear) < 3:
            self.clear = np.arange(len(rough.frame))
        self._kept: tuple[IntArray, list[tuple[slice, Cutouts]]] | None = None

    def learn_optics(self) -> None:
        """Take the optics under which a few outlines fit best, one property after another."""
        speed = np.hypot(*self._velocity[self.clear].T)
        quick = self.clear[speed >= np.median(speed)]
        trial = _evenly(quick, _TRIAL_FRAMES)
        self._learn("spread", _SPREADS, trial)
        if np.median(speed) > _SMEARED:
            self._learn("duty", _DUTIES, trial)
            # what another smear leaves of the blur
            self._learn("spread", _SPREADS, trial)

    def _learn(self, name: str, values: tuple[float, ...], trial: IntArray) -> None:
        before = self.optics
        rms_residuals = []
        for value in values:
            self.optics = replace(before, **{name: value})
            fits = self.fit(trial, 3, None).fits
            rms_residuals.append(float(np.median(fits.rms_residual)) if len(fits) else np.inf)
        self.optics = replace(before, **{name: _lowest(np.array(values), np.array(rms_residuals))})

    def _pieces(self, places: IntArray) -> Iterable[tuple[slice, Cutouts]]:
        """Cut-outs of these places; those asked for last are kept if they are not too large."""
        if self._kept is not None and np.array_equal(self._kept[0], places):
            return self._kept[1]
        reach = self._radius + ring_widths(self._radius)[1] + min(4.0, 0.4 * self._radius) + 1.0
        rough = self._rough
        wanted = CutPlaces(rough.frame[places], rough.centre[places], reach, self._hides)
        pieces = cut_out(self._scene, wanted)
        if len(places) * piece_bytes(reach) > _KEPT_BYTES:
            return pieces
        self._kept = (places, list(pieces))
        return self._kept[1]

    def fit(
        self, places: IntArray, free: int, shape: "_CommonShape | None", *, panels: bool = True
    ) -> BallFits:
        """Fit the outlines at these places of the rough track."""
        optics, radius = self.optics, self._radius
        centre, smear = self._rough.centre[places], self._velocity[places] * optics.duty
        longest = min(float(np.hypot(*smear.T).max(initial=0.0)), 2.0 * radius)
        profile = EdgeProfile(radius, optics.spread, longest)
        inner, outer = ring_widths(radius)
        inner = max(_LEAST_INNER_PX, min(inner, _INNER * radius))
        rules = FitRules(
            free, 0.1 * radius, inner, outer, tolerance=_TOLERANCE, shape_pull=shape is not None,
            panels=panels,
        )  # fmt: skip
        known = np.tile([radius, 0.0, 0.0], (len(places), 1)) if shape is None else shape.at(centre)
        start = Start(centre, known, smear)
        fits = nothing_found(len(places))
        for part, pieces in self._pieces(places):
            rows = np.arange(part.start, part.stop)
            fits.put(rows, fit_outlines(pieces, profile, start.at(part), rules))
        near = np.hypot(*(fits.centre - centre).T) < 0.4 * radius
        kept = fits.found & near
        return BallFits(self._rough.frame[places[kept]], fits.at(kept))


def _evenly(places: IntArray, count: int) -> IntArray:
    chosen = np.unique(np.linspace(0, len(places) - 1, min(count, len(places))).astype(int))
    return np.asarray(places[chosen])


def _lowest(values: FloatArray, rms_residuals: FloatArray) -> float:
    """Where a parabola through the lowest misfit and its neighbours has its bottom.

    At either end through the last three, so that of two values that fit alike either tells the
    same.
    """
    best = int(np.argmin(rms_residuals))
    first = min(max(best - 1, 0), len(values) - 3)
    three = slice(first, first + 3)
    if not np.all(np.isfinite(rms_residuals[three])):
        return float(values[best])
    bend, slope, _ = np.polyfit(values[three], rms_residuals[three], 2)
    if bend <= 0:
        return float(values[best])
    return float(np.clip(-0.5 * slope / bend, values[first], values[first + 2]))


class _CommonShape:
    """One shape for the whole clip: how a sphere's outline widens away from the picture's centre.

    A sphere of constant depth appears as an ellipse whose tangential axis is constant while the
    radial one grows as 1/cos of the angle off the axis; a lens' distortion adds terms of the same
    form. So

        r = r₀ + κᵣ ρ² + gₓ x + g_y y,   a + i b = κₑ ρ² exp(2iψ),

    with ρ, ψ the polar coordinates about the picture's centre and g for a camera that looks
    askance: five numbers for all frames.
    """

    def __init__(self, radius: float, shape: tuple[int, int]) -> None:
        self._centre = np.array([0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)])
        self._scale = 0.5 * float(np.hypot(*shape))
        self.values = np.array([radius, 0.0, 0.0, 0.0, 0.0])

    def _design(self, centre: FloatArray) -> FloatArray:
        x, y = ((centre - self._centre) / self._scale).T
        design = np.zeros((len(centre), 3, 5))
        design[:, 0] = np.column_stack([np.ones_like(x), x * x + y * y, x, y, np.zeros_like(x)])
        design[:, 1, 4] = x * x - y * y
        design[:, 2, 4] = 2 * x * y
        return design

    def at(self, centre: FloatArray) -> FloatArray:
        """Shape (N, 3) of the outline where the ball is: radius, ellipse a and b, px."""
        return np.asarray(self._design(centre) @ self.values)

    def improved_by(self, found: BallFits) -> BallFits:
        """Learn once more from all outlines, and move their centres as the new shape asks for."""
        fits = found.fits
        before = self.at(fits.centre)
        self.improve(fits)
        grown = self.at(fits.centre) - before
        asked = np.einsum("nij,nj->ni", fits.normal[:, :2, 2:], grown)
        middle = fits.normal[:, :2, :2] + 1e-9 * np.eye(2)
        moved = np.linalg.solve(middle, asked[:, :, None])[:, :, 0]
        better = replace(fits, centre=fits.centre - moved, radius=fits.radius + grown[:, 0])
        return BallFits(found.frame, better)

    def begin(self, rough: BallFits) -> None:
        """Take a first shape from the radii that were fitted free, those far off left aside."""
        radius = self.values[0]
        design = self._design(rough.centre)[:, 0]
        held = np.diag((self._widths(radius) / (_FREE_RADIUS * radius)) ** -2.0)
        weight = np.ones(len(rough))
        for _ in range(_BEGIN_ROUNDS):
            weighted = design * weight[:, None]
            change = np.linalg.solve(
                weighted.T @ design + held + 1e-9 * np.eye(5), weighted.T @ (rough.radius - radius)
            )
            left = np.abs(rough.radius - radius - design @ change)
            usual = max(float(np.median(left)), 1e-3 * radius)
            weight = 1.0 / (1.0 + (left / (2.0 * usual)) ** 2) ** 2
        self.values = self.values + change

    @staticmethod
    def _widths(radius: float) -> FloatArray:
        # A sphere 45 degrees off the axis at the picture's corner is the most that is expected.
        return np.array([np.inf, 0.25, 0.3, 0.3, 0.25]) * radius

    def improve(self, fits: OutlineFits) -> float:
        """One Gauss–Newton step on the outlines of many frames, their centres eliminated.

        Returns by how much it moves the outline that it moves most, px.
        """
        radius = self.values[0]
        held = np.diag(self._widths(radius) ** -2.0)
        middle = np.linalg.inv(fits.normal[:, :2, :2] + 1e-9 * np.eye(2))
        cross = fits.normal[:, 2:, :2] @ middle
        information = fits.normal[:, 2:, 2:] - cross @ fits.normal[:, :2, 2:]
        pull = fits.pull[:, 2:] - np.einsum("nij,nj->ni", cross, fits.pull[:, :2])
        # How far off each frame's own radius is: those that are far off count less.
        size = pull[:, 0] / np.maximum(information[:, 0, 0], 1e-9)
        usual = max(float(np.median(np.abs(size))), 1e-6)
        weight = 1.0 / (1.0 + (size / (3.0 * usual)) ** 2)
        design = self._design(fits.centre)
        normal = held + np.einsum("n,nki,nkl,nlj->ij", weight, design, information, design)
        total = np.einsum("n,nki,nk->i", weight, design, pull) - held @ self.values
        step = np.linalg.solve(normal + 1e-9 * np.eye(5), total)
        self.values = self.values + step
        return float(np.linalg.norm(design @ step, axis=1).max())


def _calibrated(fits: BallFits) -> BallFits:
    """Let all covariances account for the scatter about smooth motion, and for the model's own."""
    scatter = [found for window in _WINDOWS if (found := _scatter(fits, window)) is not None]
    if not scatter:
        return fits
    variance = np.diagonal(fits.fits.covariance, axis1=1, axis2=2)
    # What neighbours share, as the ball's pattern and its light, their scatter does not tell.
    unstated = np.maximum(scatter[0] - np.median(variance, axis=0), 0.0)
    hidden = 1.0 - np.clip(fits.fits.contrast, 0.0, 1.0)
    model = MODEL_STD_PX * (1.0 + (hidden / _HIDDEN) ** 3)
    added = (model**2)[:, None, None] * np.eye(2) + np.diag(unstated)
    return replace(fits, fits=replace(fits.fits, covariance=fits.fits.covariance + added))


def _scatter(fits: BallFits, window: int) -> FloatArray | None:
    """Variance of x and of y about smooth motion, (2,), px²; None for too few frames.

    From the residuals of cubics through `window` frames at their middle one. Where motion changes
    at once, as in a contact, they are no error: the mean is that of squares bounded at nine times
    their median.
    """
    run = fits.frame[window - 1 :] - fits.frame[: 1 - window] == window - 1
    if np.count_nonzero(run) < _FEWEST_WINDOWS:
        return None
    cubic = np.vander(np.linspace(-1.0, 1.0, window), 4)
    weight = (np.eye(window) - cubic @ np.linalg.pinv(cubic))[window // 2]
    each = np.lib.stride_tricks.sliding_window_view(fits.centre, window, axis=0)[run]
    square = (each @ weight) ** 2 / (weight @ weight)
    usual = np.median(square, axis=0)
    return np.asarray(np.minimum(square, 9.0 * usual).mean(axis=0) / _BOUNDED)
