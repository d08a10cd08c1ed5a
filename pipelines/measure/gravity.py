"""Every flight contains g: a free fall that is off means a wrong capture rate or a wrong scale.

The estimates of the coefficient of restitution: their mean, and whether they agree.
"""

import math
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from calib.calibration import Known
from calib.solve import SeenFall
from metrology import Defaults, MeasurementError, Quantity, UncertaintySource
from metrology.least_squares import fit
from pipelines.measure.budget import DERIVED, ClipConditions, merged
from pipelines.measure.checks import LEAST_POWER
from pipelines.measure.flight_fit import (
    LONGEST_CONTACT_S,
    FlightPriors,
    fit_flight,
    flight_end,
    flight_whitening,
)
from pipelines.measure.impact import departure, find_impact
from pipelines.measure.metres import CameraMapping, radius_share, tracks_in_metres
from pipelines.report import Check, CheckKind, CheckOutcome
from vision.clip.footage import RateSource
from vision.tracks import Tracks

__all__ = [
    "ESTIMATES",
    "as_flown_through",
    "contradicts_gravity",
    "fused_cor",
    "gravity_check",
    "scale_std",
    "seen_fall",
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
"""fps: rates that cameras offer, of film, broadcast and high speed."""

_SIGMAS = 3.0
"""Standard deviations: of honest clips one in 370 fails by chance."""

RELEVANT_SHARE = 0.1

"""Of gravity: what a rate off by a twentieth, or lengths off by a tenth, make of it."""

_PLAIN_SIGMAS = 5.0
"""Standard deviations beyond which no chance is left: one in two million."""

_BEYOND_AIR = 0.1

"""Share of gravity that spin or drag could hide: the paper's balls at 5 m/s have a drag of a
twentieth of their weight, lighter ones twice that."""

_UNTOLD = 0.1
"""Relative uncertainty of the rate from a fall beyond which it tells no rate from the next common
one."""

_SLANT_ROUNDS = 2
"""Rounds, supposed: where a flight ends hangs on the slant, which the next round hardly moves."""

BEYOND_REPAIR = 0.3

"""Share by which a fall may miss gravity before rate or scale must be plainly wrong: three times
what air can do."""


def contradicts_gravity(value: float, gravity: float, std: float = math.inf) -> bool:
    """Whether a free fall (m/s²) is so far off that nothing in metres and seconds can be right."""
    off = abs(value / gravity - 1.0)
    return off > BEYOND_REPAIR or (off > _BEYOND_AIR and off * gravity > _PLAIN_SIGMAS * std)


def seen_fall(
    scene: ClipConditions, tracks: Tracks, time_s: NDArray[np.float64]
) -> SeenFall | None:
    """The free fall that a flight shows; None where there is none, or rate or scale must be wrong.

    Parameters
    ----------
    scene : ClipConditions
        With a calibration; its rate's uncertainty enters twice, as time is squared.
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
    if contradicts_gravity(value, scene.inputs.gravity):
        return None
    by_rate = 2.0 * value * scene.rate.std / scene.rate.fps
    std = math.hypot(math.sqrt(float(free.fitted.covariance[6, 6])), by_rate)
    flying = np.isin(metric.ball_time_s, free.time_s)
    return SeenFall(Known(value, std), scene.inputs.gravity, tracks.ball.centre_px[flying])


def as_flown_through(
    scene: ClipConditions, tracks: Tracks, time_s: NDArray[np.float64]
) -> ClipConditions:
    """The scene with its camera as much aslant as a flight through the plane of motion shows.

    A thing in free flight keeps its speed along the rows but for the drag, and falls as gravity has
    it: seen aslant, it slows down and shrinks on its way, or the contrary.

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
            slant = _seen_slant(scene, tracks, time_s)
        except MeasurementError:
            return scene
        scene = replace(scene, slant_rad=slant.value)
    if scene.lens is None:
        return scene
    return replace(scene, lens=replace(scene.lens, slant_std_rad=slant.std))


def _seen_slant(scene: ClipConditions, tracks: Tracks, time_s: NDArray[np.float64]) -> Known:
    """The slant fitted to a flight together with all else that may bend its path.

    Rate and scale stretch it alike, a roll turns gravity, a lens that nobody measured bends lines.
    """
    inputs, ball = scene.inputs, tracks.ball
    metric = tracks_in_metres(tracks, scene.plane_of_ball(tracks), time_s)
    left = departure(metric)
    end = flight_end(metric, inputs, left)
    used = (metric.ball_time_s > left + LONGEST_CONTACT_S) & (metric.ball_time_s < end)
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
    """Relative uncertainty of the scale where there is no calibration; infinite if there is none.

    Parameters
    ----------
    scene : ClipConditions
    tracks : Tracks
        In pixels.
    """
    if scene.metres_per_px is not None:
        return scene.metres_per_px[1] / scene.metres_per_px[0]
    diameter = scene.inputs.rig.ball_diameter
    if diameter is None:
        return np.inf
    return float(np.hypot(diameter.relative_std, radius_share(tracks.ball)))


def gravity_check(found: Quantity, scene: ClipConditions) -> tuple[Quantity, Check | None]:
    """Compare the free-fall acceleration with gravity; say what would explain a difference.

    Parameters
    ----------
    found : Quantity
        Acceleration fitted to the flight.
    scene : ClipConditions
        What rate and scale were used.

    Returns
    -------
    quantity : Quantity
        Named ``gravity_check``.
    check : Check or None
        None where gravity could not be fitted.
    """
    quantity = replace(found, name="gravity_check")
    if quantity.value is None or quantity.std is None:
        return quantity, None
    gravity = scene.inputs.gravity
    text = f"free fall gives {quantity.value:.2f} ± {quantity.std:.2f} m/s²"
    off = abs(quantity.value - gravity)
    relevant = RELEVANT_SHARE * gravity / max(quantity.std, 1e-12)
    power = float(scipy.special.ndtr(-_SIGMAS + relevant))
    if off > _SIGMAS * quantity.std:
        statement = f"{text}, not {gravity:.2f}. {_why(quantity, scene)}"
        return quantity, Check(CheckKind.GRAVITY, CheckOutcome.FAILED, statement, power)
    if scene.rate.source is RateSource.ASSUMED:
        statement = f"{text}: the fall told the capture rate, so it can't check it"
        return quantity, Check(CheckKind.GRAVITY, CheckOutcome.UNDECIDED, statement, 0.0)
    if power < LEAST_POWER:
        statement = (
            f"{text}: too unsure to tell whether rate and scale are within"
            f" {100 * RELEVANT_SHARE:.0f} % of what gravity asks for"
        )
        return quantity, Check(CheckKind.GRAVITY, CheckOutcome.UNDECIDED, statement, power)
    statement = f"{text}: rate and scale agree with gravity"
    return quantity, Check(CheckKind.GRAVITY, CheckOutcome.PASSED, statement, power)


def _why(quantity: Quantity, scene: ClipConditions) -> str:
    assert quantity.value is not None
    assert quantity.std is not None
    gravity = scene.inputs.gravity
    if quantity.value <= 0:
        return "The ball does not fall: is the picture upside down, or this not a flight?"
    ratio = gravity / quantity.value
    rate = scene.rate.fps * math.sqrt(ratio)
    doubt = 0.5 * quantity.std / quantity.value
    if doubt > _UNTOLD:
        return (
            f"Another capture rate than {scene.rate.fps:g} fps, or another scale, would explain it;"
            " the flight in view is too short to say which"
        )
    near = [other for other in _COMMON_RATES if abs(other / rate - 1) < max(3 * doubt, 0.02)]
    nearest = min(near, key=lambda other: abs(other - rate), default=None)
    named = "" if nearest is None else f" ({nearest:g} fps, with --fps {nearest:g}?)"
    return (
        f"A capture rate of {rate:.1f} fps instead of {scene.rate.fps:g} would explain it{named},"
        f" or lengths that are {1 / ratio:.3f} times too long"
    )


FloatArray = NDArray[np.float64]

ESTIMATES = ("cor_speeds", "cor_launch", "cor_range")

_COR_SIGMAS, _CHANCE = 3.0, 0.003
"""Standard deviations, and the chance that goes with them: of honest clips one in 370 fails."""

RELEVANT = 0.1

"""Difference between two estimates that would matter, of the coefficient of restitution."""

MODEL_STD = {"cor_speeds": 0.002, "cor_launch": 0.004, "cor_range": 0.004}

"""What each estimate leaves out: the rigid balance of Eqs 8-10 knows no ball that slides."""


def fused_cor(
    values: FloatArray,
    random: FloatArray,
    systematic: dict[UncertaintySource, FloatArray],
    found: dict[str, Quantity],
) -> tuple[Quantity, Check | None]:
    """Best linear unbiased mean of the estimates that exist, and their agreement.

    Parameters
    ----------
    values, random, systematic
        As in `Evaluated`.
    found : dict
        Quantities by name; one that is missing there takes no part.
    """
    names = list(DERIVED)
    estimates = [name for name in ESTIMATES if found[name].known]
    if not estimates:
        return Quantity.missing("cor", "1", str(found["cor_speeds"].reason)), None
    at = [names.index(name) for name in estimates]
    covariance = random[np.ix_(at, at)].copy()
    for column in systematic.values():
        share = np.nan_to_num(column[at])
        covariance += np.outer(share, share)
    covariance += np.diag([MODEL_STD[name] ** 2 for name in estimates])
    covariance += 1e-8 * np.eye(len(at))
    weight = np.linalg.solve(covariance, np.ones(len(at)))
    weight /= weight.sum()
    # noise that all estimates share can drive weights beyond 0..1: no estimate is trusted backwards
    weight = np.clip(weight, 0.0, None)
    weight /= weight.sum()
    noise = float(np.sqrt(weight @ random[np.ix_(at, at)] @ weight))
    model = float(np.sqrt(np.square(weight) @ [MODEL_STD[name] ** 2 for name in estimates]))
    # source by source: what all clips of a setup share does not average out over a campaign
    lines = {source: abs(weight @ np.nan_to_num(col[at])) for source, col in systematic.items()}
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


def _agreement(values: FloatArray, covariance: FloatArray, estimates: list[str]) -> Check:
    step = np.diff(np.eye(len(values)), axis=0)
    apart = step @ values
    spread = step @ covariance @ step.T
    chance = float(scipy.special.chdtrc(len(apart), apart @ np.linalg.solve(spread, apart)))
    listed = ", ".join(f"{name} {value:.3f}" for name, value in zip(estimates, values, strict=True))
    closest = float(np.sqrt(np.diag(spread).min()))
    power = float(scipy.special.ndtr(-_COR_SIGMAS + RELEVANT / closest))
    if chance < _CHANCE:
        text = (
            f"the estimates of the coefficient of restitution disagree ({listed}):"
            " check the pendulum's inertia and the ball's mass in the setup file"
        )
        return Check(CheckKind.COR_AGREEMENT, CheckOutcome.FAILED, text, power)
    if power < LEAST_POWER:
        text = f"the estimates ({listed}) are too unsure to tell a difference of {RELEVANT:g}"
        return Check(CheckKind.COR_AGREEMENT, CheckOutcome.UNDECIDED, text, power)
    return Check(CheckKind.COR_AGREEMENT, CheckOutcome.PASSED, f"they agree ({listed})", power)
