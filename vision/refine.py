"""The ball's outlines fitted again, all of one shape, with the optics learnt from the clip."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vision.ball import SMALL_RADIUS, BallFits
from vision.cutout import TYPICAL_GAMMA, Hides, ring_pixels, ring_widths
from vision.edge_profile import EdgeProfile
from vision.outline import OutlineFit, OutlineShape, fit_outline
from vision.scene import Scene

__all__ = ["Optics", "refine_ball"]

FloatArray = NDArray[np.float64]

_SPREADS = (0.25, 0.45, 0.7, 1.0, 1.5)
_DUTIES = (0.1, 0.35, 0.6, 0.85)
_TRIAL_FRAMES = 9
_SHAPE_FRAMES = 40
_SHAPE_STEPS = 3
# Frames between the positions compared: errors of neighbours are alike, as the ball looks alike.
_LAG = 4


@dataclass(frozen=True)
class Optics:
    """What the camera does to an edge.

    Attributes
    ----------
    spread : float
        Standard deviation of the point spread, px.
    gamma : float
        Exponent of the transfer curve from gray level to light.
    duty : float
        Exposure time over frame interval.
    """

    spread: float
    gamma: float
    duty: float


def refine_ball(
    scene: Scene, rough: BallFits, hides: Callable[[int], Hides | None] | None = None
) -> BallFits:
    """Fit again with one shape for the whole clip, and point spread and smear known.

    Parameters
    ----------
    scene : Scene
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
    typical = float(np.median(rough.radius))
    if typical < SMALL_RADIUS or len(rough.frame) < 5:
        return _calibrated(rough)
    refiner = _Refiner(scene, rough, typical, hides)
    refiner.learn_optics()
    shape = _CommonShape(typical, scene.shape)
    for _ in range(_SHAPE_STEPS):
        shaped = refiner.fit(_evenly(refiner.clear, _SHAPE_FRAMES), 2, shape)
        if len(shaped.frame) < 3:
            return _calibrated(rough)
        shape.improve(shaped)
    refined = refiner.fit(np.arange(len(rough.frame)), 2, shape)
    # Where the model does not hold (a sharpened picture, a puck with a rim), the plain fits may
    # scatter less; the clip itself says so.
    return _calibrated(refined if _unrest(refined) <= 1.1 * _unrest(rough) else rough)


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
        scene: Scene,
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
        self.optics = Optics(0.6, TYPICAL_GAMMA, 0.5)
        contrast = np.array([fit.contrast for fit in rough.fits])
        near = np.abs(rough.radius / radius - 1.0) < 0.1
        self.clear = np.nonzero((contrast >= np.median(contrast) - 0.05) & near)[0]
        if len(self.clear) < 3:
            self.clear = np.arange(len(rough.frame))

    def learn_optics(self) -> None:
        """Take the optics under which a few outlines fit best, one property after another."""
        speed = np.hypot(*self._velocity[self.clear].T)
        quick = self.clear[speed >= np.median(speed)]
        trial = _evenly(quick, _TRIAL_FRAMES)
        for name, values in (
            ("spread", _SPREADS),
            ("duty", _DUTIES if np.median(speed) > 0.7 else ()),
            ("spread", _SPREADS),
        ):
            if values:
                self._learn(name, values, trial)

    def _learn(self, name: str, values: tuple[float, ...], trial: NDArray[np.int64]) -> None:
        before = self.optics
        misfits = []
        for value in values:
            self.optics = replace(before, **{name: value})
            fits = self.fit(trial, 3, None).fits
            misfits.append(float(np.median([fit.misfit for fit in fits])) if fits else np.inf)
        self.optics = replace(before, **{name: _lowest(np.array(values), np.array(misfits))})

    def fit(self, places: NDArray[np.int64], free: int, shape: "_CommonShape | None") -> BallFits:
        """Fit the outlines at these places of the rough track."""
        optics, radius = self.optics, self._radius
        smear = self._velocity * optics.duty
        longest = min(float(np.hypot(*smear[places].T).max(initial=0.0)), 2.0 * radius)
        profile = EdgeProfile(radius, optics.spread, longest)
        inner, outer = ring_widths(radius)
        frames, fits = [], []
        pictures = self._scene.pictures(self._rough.frame[places])
        for place, (index, picture) in zip(places, pictures, strict=True):
            start = self._rough.fits[place].centre
            hidden = None if self._hides is None else self._hides(index)
            reach = radius + outer + 2.0
            pixels = ring_pixels(self._scene, index, picture, start, reach, optics.gamma, hidden)
            if pixels is None:
                continue
            known = OutlineShape(radius, np.zeros(2)) if shape is None else shape.at(start)
            fit = fit_outline(
                pixels,
                profile,
                start,
                known,
                smear=smear[place],
                free=free,
                radius_std=0.1 * radius,
                inner=inner,
                outer=outer,
            )
            if fit is not None and np.hypot(*(fit.centre - start)) < 0.4 * radius:
                frames.append(index)
                fits.append(fit)
        return BallFits(np.array(frames, dtype=np.int64), tuple(fits))


def _evenly(places: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    chosen = np.unique(np.linspace(0, len(places) - 1, min(count, len(places))).astype(int))
    return np.asarray(places[chosen])


def _lowest(values: FloatArray, misfits: FloatArray) -> float:
    """Where a parabola through the lowest misfit and its neighbours has its bottom."""
    best = int(np.argmin(misfits))
    if best in (0, len(values) - 1) or not np.all(np.isfinite(misfits[best - 1 : best + 2])):
        return float(values[best])
    bend, slope, _ = np.polyfit(values[best - 1 : best + 2], misfits[best - 1 : best + 2], 2)
    if bend <= 0:
        return float(values[best])
    return float(np.clip(-0.5 * slope / bend, values[best - 1], values[best + 1]))


class _CommonShape:
    """One shape for the whole clip: how a sphere's outline widens away from the picture's centre.

    A sphere of constant depth appears as an ellipse whose tangential axis is constant while the
    radial one
    grows as 1/cos of the angle off the axis; a lens' distortion adds terms of the same form. So

        r = r₀ + κᵣ ρ² + gₓ x + g_y y,   a + i b = κₑ ρ² exp(2iψ),

    with ρ, ψ the polar coordinates about the picture's centre and g for a camera that looks
    askance: five numbers for all frames.
    """

    def __init__(self, radius: float, shape: tuple[int, int]) -> None:
        self._centre = np.array([0.5 * (shape[1] - 1), 0.5 * (shape[0] - 1)])
        self._scale = 0.5 * float(np.hypot(*shape))
        self.values = np.array([radius, 0.0, 0.0, 0.0, 0.0])

    def _design(self, centre: FloatArray) -> FloatArray:
        x, y = (centre - self._centre) / self._scale
        return np.array(
            [
                [1.0, x * x + y * y, x, y, 0.0],
                [0.0, 0.0, 0.0, 0.0, x * x - y * y],
                [0.0, 0.0, 0.0, 0.0, 2 * x * y],
            ]
        )

    def at(self, centre: FloatArray) -> OutlineShape:
        """Shape of the outline where the ball is."""
        shape = self._design(centre) @ self.values
        return OutlineShape(float(shape[0]), shape[1:])

    def improve(self, fits: BallFits) -> None:
        """One Gauss–Newton step on the outlines of many frames, their centres eliminated."""
        radius = self.values[0]
        # A sphere 45 degrees off the axis at the picture's corner is the most that is expected.
        widths = np.array([np.inf, 0.25, 0.1, 0.1, 0.25]) * radius
        normal = np.diag(widths**-2.0)
        pull = -normal @ self.values
        steps = [self._single(fit) for fit in fits.fits]
        sizes = np.array([step[2] for step in steps])
        usual = max(float(np.median(np.abs(sizes))), 1e-6)
        for information, gradient, size in steps:
            weight = 1.0 / (1.0 + (size / (3.0 * usual)) ** 2)
            normal += weight * information
            pull += weight * gradient
        self.values = self.values + np.linalg.solve(normal + 1e-9 * np.eye(len(pull)), pull)

    def _single(self, fit: OutlineFit) -> tuple[FloatArray, FloatArray, float]:
        """Information and pull of one frame on the common numbers, and how far off it is."""
        cross = fit.normal[2:, :2] @ np.linalg.inv(fit.normal[:2, :2] + 1e-9 * np.eye(2))
        information = fit.normal[2:, 2:] - cross @ fit.normal[:2, 2:]
        gradient = fit.pull[2:] - cross @ fit.pull[:2]
        design = self._design(fit.centre)
        size = float(gradient[0] / max(information[0, 0], 1e-9))
        return design.T @ information @ design, design.T @ gradient, size


def _calibrated(fits: BallFits) -> BallFits:
    """Scale all covariances so that they account for the scatter about smooth motion.

    Third differences of evenly spaced positions vanish for motion under a constant force; for
    independent errors of variance σ² their variance is 20 σ².
    """
    lag = _LAG if len(fits.frame) > 40 else 1
    if len(fits.frame) < 12:
        return fits
    run = fits.frame[3 * lag :] - fits.frame[: -3 * lag] == 3 * lag
    if np.count_nonzero(run) < 8:
        return fits
    x, variance = fits.centre, np.array([np.diag(fit.covariance)[:2] for fit in fits.fits])
    parts = [slice(k * lag, len(x) - (3 - k) * lag) for k in range(4)]
    third = (x[parts[3]] - 3 * x[parts[2]] + 3 * x[parts[1]] - x[parts[0]])[run]
    expected = (
        variance[parts[3]] + 9 * variance[parts[2]] + 9 * variance[parts[1]] + variance[parts[0]]
    )[run]
    # 0.455 is the median of a squared unit normal.
    ratio = float(np.median(third**2 / np.maximum(expected, 1e-12))) / 0.455
    factor = float(np.clip(ratio, 0.05, 20.0))
    return BallFits(fits.frame, tuple(_scaled(fit, factor) for fit in fits.fits))


def _scaled(fit: OutlineFit, factor: float) -> OutlineFit:
    return replace(fit, covariance=fit.covariance * factor)
