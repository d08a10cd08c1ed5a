"""Free fall as a check of rate and scale; mean and agreement of the COR estimates."""

import math
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from calib.calibration import Known
from calib.solve import SeenFall
from measuring.budget import DERIVED, ClipConditions, merged
from measuring.checks import MIN_CHECK_POWER, Check, CheckKind, CheckOutcome
from measuring.flight_fit import (
    MAX_CONTACT_S,
    FlightPriors,
    fit_flight,
    flight_end,
    flight_whitening,
)
from measuring.impact import departure, find_impact
from measuring.metres import CameraMapping, radius_relative_std, tracks_in_metres
from metrology import Defaults, MeasurementError, Quantity, UncertaintySource
from metrology.least_squares import fit
from vision.clip.footage import RateSource
from vision.tracks import Tracks

__all__ = [
    "ESTIMATES",
    "contradicts_gravity",
    "cor_weights",
    "fused_cor",
    "gravity_check",
    "scale_std",
    "seen_fall",
    "with_fitted_slant",
]

_COMMON_RATES = (
    24,
    25,
    29.97,
    30,
    50,
    60,
    100,
    119.88,
    120,
    200,
    240,
    300,
    480,
    500,
    600,
    960,
    1000,
)
"""fps, frame rates of common cameras (film, broadcast and high speed)."""

_SIGMAS = 3.0
"""Standard deviations (convention: exceeded by 1 correct clip in 370)."""

RELEVANT_GRAVITY_FRACTION = 0.1
"""Of gravity: smallest relevant deviation (chosen: a rate off by 5 %, or lengths by 10 %)."""

_CERTAIN_SIGMAS = 5.0
"""Standard deviations that exclude chance (convention: 1 in two million)."""

_MAX_AIR_EFFECT = 0.1
"""Of gravity: maximum effect of spin or drag (chosen: the paper's balls at 5 m/s have a drag of 5 %
of their weight, lighter ones twice that)."""

_MAX_RATE_STD = 0.1
"""Relative std of a rate from gravity above which common rates are not distinguished (chosen)."""

_SLANT_ROUNDS = 2
"""Iterations (assumed to converge: the next hardly changes the end of the flight)."""

MAX_GRAVITY_ERROR = 0.3
"""Relative deviation from gravity above which rate or scale is certainly wrong (chosen: three times
the effect of air)."""


def contradicts_gravity(value: float, gravity: float, std: float = math.inf) -> bool:
    """Whether a free fall (m/s²) is so far off that no value in metres and seconds can be right."""
    off = abs(value / gravity - 1.0)
    return off > MAX_GRAVITY_ERROR or (
        off > _MAX_AIR_EFFECT and off * gravity > _CERTAIN_SIGMAS * std
    )


def seen_fall(
    scene: ClipConditions, tracks: Tracks, time_s: NDArray[np.float64]
) -> SeenFall | None:
    """Free fall of a flight; None if there is none, or rate or scale must be wrong.

    Parameters
    ----------
    scene : ClipConditions
        With a calibration; the std of its rate enters twice, since time is squared.
    tracks : Tracks
        In pixels.
    time_s : (F,) array
        Mid-exposure time of every frame of the clip, s.
    """
    assert scene.calibration is not None
    try:
        metric = tracks_in_metres(tracks, CameraMapping(scene.calibration), time_s)
        free = find_impact(metric, scene.inputs).free_flight
    except MeasurementError:
        return None
    value = float(free.fitted.values[6])
    if not free.fitted.determined[6] or contradicts_gravity(value, scene.inputs.gravity):
        return None
    by_rate = 2.0 * value * scene.rate.std / scene.rate.fps
    std = math.hypot(math.sqrt(float(free.fitted.covariance[6, 6])), by_rate)
    flying = np.isin(metric.ball_time_s, free.time_s)
    return SeenFall(Known(value, std), scene.inputs.gravity, tracks.ball.centre_px[flying])


def with_fitted_slant(
    scene: ClipConditions, tracks: Tracks, time_s: NDArray[np.float64]
) -> ClipConditions:
    """The scene with the slant of the camera fitted to the flight.

    In free flight an object keeps its speed along the rows except for drag, and falls with gravity;
    with a slant it slows down and shrinks along its path, or the reverse.

    Parameters
    ----------
    scene : ClipConditions
        Without a calibration.
    tracks : Tracks
        In pixels.
    time_s : (F,) array
        Mid-exposure time of every frame of the clip, s.
    """
    for _ in range(_SLANT_ROUNDS):
        try:
            slant = _fit_slant(scene, tracks, time_s)
        except MeasurementError:
            return scene
        scene = replace(scene, slant_rad=slant.value)
    if scene.lens is None:
        return scene
    return replace(scene, lens=replace(scene.lens, slant_std_rad=slant.std))


def _fit_slant(scene: ClipConditions, tracks: Tracks, time_s: NDArray[np.float64]) -> Known:
    """Slant fitted to a flight together with other effects that bend its path.

    Rate and scale stretch it equally, a roll rotates gravity, an unknown lens bends lines.
    """
    inputs, ball = scene.inputs, tracks.ball
    metric = tracks_in_metres(tracks, scene.plane_of_ball(tracks), time_s)
    left = departure(metric)
    end = flight_end(metric, inputs, left)
    used = (metric.ball_time_s > left + MAX_CONTACT_S) & (metric.ball_time_s < end)
    flight = fit_flight(
        metric.ball_time_s[used],
        metric.ball_m[used],
        metric.ball_cov_m2[used],
        left,
        FlightPriors(inputs.gravity, np.inf, *inputs.drag_per_metre, 0.0, inputs.lift_std),
    )
    used = np.isin(metric.ball_time_s, flight.time_s)
    middle = 0.5 * (np.array(tracks.background.shape)[::-1] - 1.0)
    off_axis = ball.centre_px[used] - middle
    bent = ((off_axis / middle[0]) ** 2).sum(axis=1, keepdims=True) * off_axis
    std = np.sqrt(np.diagonal(metric.ball_cov_m2[used], axis1=1, axis2=2))
    std = np.maximum(std, 0.3 * np.median(std, axis=0))
    whiten = flight_whitening(flight.time_s)

    def residuals(values: FloatArray) -> FloatArray:
        slant, roll, stretched, distorted = values[7:]
        moved = replace(
            scene, slant_rad=slant, roll_rad=roll, scale=scene.scale * math.exp(stretched)
        )
        seen = ball.centre_px[used] - distorted * bent
        place, _ = moved.plane_of_ball(tracks).ball(seen, ball.covariance_px2[used])
        flown = flight.states(flight.time_s, values[:7])[:, :2]
        return whiten((place * [metric.direction, 1.0] - flown) / std).ravel()

    lens = scene.lens
    open_by = Defaults.CAMERA_SLANT.std if lens is None else lens.slant_std_rad
    stretched = math.hypot(scale_std(scene, tracks), 2.0 * scene.rate.std / scene.rate.fps)
    centre = np.array([*flight.fitted.values[:4], inputs.drag_per_metre[0], 0.0, inputs.gravity])
    spread = [np.inf] * 4 + [inputs.drag_per_metre[1], inputs.lift_std, inputs.rig.gravity.std]
    others = [Defaults.CAMERA_ROLL.std, stretched, Defaults.LENS_DISTORTION.std]
    prior, spread = np.append(centre, np.zeros(4)), [*spread, open_by, *others]
    start = prior + np.append(np.zeros(7), [scene.slant_rad, 0.0, 0.0, 0.0])
    fitted = fit(residuals, start, prior, spread, channels=2)
    return Known(float(fitted.values[7]), math.sqrt(float(fitted.covariance[7, 7])))


def scale_std(scene: ClipConditions, tracks: Tracks) -> float:
    """Relative std of the scale without a calibration; infinite without any scale.

    Parameters
    ----------
    tracks : Tracks
        In pixels.
    """
    if scene.metres_per_px is not None:
        return scene.metres_per_px[1] / scene.metres_per_px[0]
    diameter = scene.inputs.rig.ball_diameter
    if diameter is None:
        return np.inf
    return float(np.hypot(diameter.relative_std, radius_relative_std(tracks.ball)))


def gravity_check(found: Quantity, scene: ClipConditions) -> tuple[Quantity, Check | None]:
    """Compare the free-fall acceleration with gravity, and state what explains a difference.

    Parameters
    ----------
    found : Quantity
        Acceleration fitted to the flight.
    scene : ClipConditions
        Rate and scale used.

    Returns
    -------
    quantity : Quantity
        Named ``gravity_check``.
    check : Check or None
        None if gravity could not be fitted.
    """
    quantity = replace(found, name="gravity_check")
    if quantity.value is None or quantity.std is None:
        return quantity, None
    gravity = scene.inputs.gravity
    text = f"free fall gives {quantity.value:.2f} ± {quantity.std:.2f} m/s²"
    off = abs(quantity.value - gravity)
    relevant = RELEVANT_GRAVITY_FRACTION * gravity / max(quantity.std, 1e-12)
    power = float(scipy.special.ndtr(-_SIGMAS + relevant))
    if off > _SIGMAS * _std_at(gravity, quantity):
        statement = f"{text}, not {gravity:.2f}. {_why(quantity, scene)}"
        return quantity, Check(CheckKind.GRAVITY, CheckOutcome.FAILED, statement, power)
    if scene.rate.source is RateSource.ASSUMED:
        statement = f"{text}; the capture rate was estimated from it, so it can't check the rate"
        return quantity, Check(CheckKind.GRAVITY, CheckOutcome.UNDECIDED, statement, 0.0)
    if power < MIN_CHECK_POWER:
        statement = (
            f"{text}: too uncertain to detect an error of"
            f" {100 * RELEVANT_GRAVITY_FRACTION:.0f} % of gravity in rate and scale"
        )
        return quantity, Check(CheckKind.GRAVITY, CheckOutcome.UNDECIDED, statement, power)
    statement = f"{text}: rate and scale agree with gravity"
    return quantity, Check(CheckKind.GRAVITY, CheckOutcome.PASSED, statement, power)


def _std_at(gravity: float, found: Quantity) -> float:
    """Std that a fall with gravity would have.

    What a set-up's clips have in common, mostly scale and rate, errs in proportion to the value;
    the track's noise does not.
    """
    assert found.value is not None
    grown = max(gravity / found.value, 1.0) if found.value > 0.0 else 1.0
    return math.hypot(
        *(line.std * (grown if line.source.shared_by_setup else 1.0) for line in found.budget)
    )


def _why(quantity: Quantity, scene: ClipConditions) -> str:
    assert quantity.value is not None
    assert quantity.std is not None
    gravity = scene.inputs.gravity
    if quantity.value <= 0:
        return "The ball does not fall: the picture may be upside down, or this is no flight."
    ratio = gravity / quantity.value
    rate = scene.rate.fps * math.sqrt(ratio)
    rate_std = 0.5 * quantity.std / quantity.value
    if rate_std > _MAX_RATE_STD:
        return (
            f"A capture rate other than {scene.rate.fps:g} fps, or another scale, would explain it;"
            " the flight in view is too short to distinguish them"
        )
    near = [
        other
        for other in _COMMON_RATES
        if abs(other / rate - 1) < max(3 * rate_std, 0.02) and other != scene.rate.fps
    ]
    nearest = min(near, key=lambda other: abs(other - rate), default=None)
    named = "" if nearest is None else f" ({nearest:g} fps, with --fps {nearest:g}?)"
    return (
        f"A capture rate of {rate:.1f} fps instead of {scene.rate.fps:g} would explain it{named},"
        f" or lengths of {1 / ratio:.3f} times the true ones: check {_lengths(scene)}"
    )


def _lengths(scene: ClipConditions) -> str:
    """What the scale follows from."""
    if scene.metres_per_px is not None:
        return "the scale (--scale)"
    if scene.calibration is None:
        return "the ball's diameter (--ball)"
    if scene.inputs.setup.camera.distance_to_wall is None:
        return "the grid's pitch (--wall-grid)"
    return (
        "the grid's pitch (--wall-grid) and both distances (distance_to_wall in [camera] of the"
        " set-up file, ball_plane_offset in [wall])"
    )


FloatArray = NDArray[np.float64]

ESTIMATES = ("cor_speeds", "cor_launch", "cor_range")

_COR_SIGMAS, _COR_CHANCE = 3.0, 0.003
"""Standard deviations, and their probability (convention: exceeded by 1 correct clip in 370)."""

RELEVANT_COR_DIFFERENCE = 0.1
"""Smallest relevant difference between two COR estimates (chosen)."""

MODEL_STD = {"cor_speeds": 0.002, "cor_launch": 0.004, "cor_range": 0.004}
"""Std of each estimate's model error (chosen: the rigid balance of Eqs 8-10 ignores sliding)."""


def fused_cor(
    values: FloatArray,
    random: FloatArray,
    systematic: dict[UncertaintySource, FloatArray],
    found: dict[str, Quantity],
) -> tuple[Quantity, Check | None]:
    """Best linear unbiased mean of the available COR estimates, and their agreement.

    Parameters
    ----------
    values, random, systematic
        As in `Evaluated`.
    found : dict
        Quantities by name; missing ones are not used.
    """
    names = list(DERIVED)
    estimates = [name for name in ESTIMATES if found[name].known]
    if not estimates:
        return Quantity.missing("cor", "1", str(found["cor_speeds"].reason)), None
    at = [names.index(name) for name in estimates]
    covariance = _estimates_covariance(random, systematic, estimates)
    weight = cor_weights(random, systematic, found)[at]
    noise = float(np.sqrt(weight @ random[np.ix_(at, at)] @ weight))
    model = float(np.sqrt(np.square(weight) @ [MODEL_STD[name] ** 2 for name in estimates]))
    # kept by source: contributions common to a setup do not average out over a campaign
    lines = {
        source: abs(float(weight @ np.nan_to_num(col[at]))) for source, col in systematic.items()
    }
    lines[UncertaintySource.COR_MEAN] = model
    fused = Quantity.measured(
        "cor",
        float(weight @ values[at]),
        "1",
        merged({source: np.array([std]) for source, std in lines.items()}, 0, noise),
    )
    if len(at) < 2:
        return fused, None
    return fused, _agreement(values[at], covariance, estimates)


def cor_weights(
    random: FloatArray,
    systematic: dict[UncertaintySource, FloatArray],
    found: dict[str, Quantity],
) -> FloatArray:
    """Weight of each derived value in the mean of the COR estimates; zeros without any."""
    names = list(DERIVED)
    estimates = [name for name in ESTIMATES if found[name].known]
    weights = np.zeros(len(names))
    if not estimates:
        return weights
    covariance = _estimates_covariance(random, systematic, estimates)
    weight = np.linalg.solve(covariance, np.ones(len(estimates)))
    weight /= weight.sum()
    # common noise can drive weights outside 0..1; negative weights are not used
    weight = np.clip(weight, 0.0, None)
    weights[[names.index(name) for name in estimates]] = weight / weight.sum()
    return weights


def _estimates_covariance(
    random: FloatArray, systematic: dict[UncertaintySource, FloatArray], estimates: list[str]
) -> FloatArray:
    at = [list(DERIVED).index(name) for name in estimates]
    covariance = random[np.ix_(at, at)].copy()
    for column in systematic.values():
        term = np.nan_to_num(column[at])
        covariance += np.outer(term, term)
    covariance += np.diag([MODEL_STD[name] ** 2 for name in estimates])
    return np.asarray(covariance + 1e-8 * np.eye(len(at)))


def _agreement(values: FloatArray, covariance: FloatArray, estimates: list[str]) -> Check:
    step = np.diff(np.eye(len(values)), axis=0)
    apart = step @ values
    spread = step @ covariance @ step.T
    chance = float(scipy.special.chdtrc(len(apart), apart @ np.linalg.solve(spread, apart)))
    listed = ", ".join(f"{name} {value:.3f}" for name, value in zip(estimates, values, strict=True))
    closest = float(np.sqrt(np.diag(spread).min()))
    power = float(scipy.special.ndtr(-_COR_SIGMAS + RELEVANT_COR_DIFFERENCE / closest))
    if chance < _COR_CHANCE:
        text = (
            f"the estimates of the coefficient of restitution disagree ({listed}):"
            " check the pendulum's inertia and the ball's mass in the setup file"
        )
        return Check(CheckKind.COR_AGREEMENT, CheckOutcome.FAILED, text, power)
    if power < MIN_CHECK_POWER:
        text = (
            f"the estimates ({listed}) are too uncertain to detect a difference of"
            f" {RELEVANT_COR_DIFFERENCE:g}"
        )
        return Check(CheckKind.COR_AGREEMENT, CheckOutcome.UNDECIDED, text, power)
    return Check(CheckKind.COR_AGREEMENT, CheckOutcome.PASSED, f"they agree ({listed})", power)
