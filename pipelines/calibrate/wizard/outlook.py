"""What the answers so far amount to: the calibrated scene, and how sure a landing will be.

A known length against the calibration.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import BallOutlines, Calibration, Evidence, FreeFall, Known
from calib.solve import solve
from metrology import (
    CalibrationError,
    Contribution,
    Defaults,
    UncertaintySource,
    UsageError,
    measurands,
    read_number,
)
from pipelines.calibrate.wizard.answers import Answers
from vision.clip.footage import nominal_rate_std

__all__ = ["LengthComparison", "Outlook", "length_between", "outlook", "verdict"]

FloatArray = NDArray[np.float64]

PLACE_STD_PX = 0.2

"""px, of a ball at landing, along x, where following did not tell: supposed."""

CLICK_STD_PX = 0.5

GRAVITY = Known(Defaults.GRAVITY.known, Defaults.GRAVITY.std)

DRAG_SHARE = 0.4

"""Of the mean drag taken as a constant over the flight: C_D's default is good to a fifth, and the
speed is squared."""

UNKNOWN_DRAG = Known(0.1, 0.1)

"""What the air takes from the fall of a ball of unknown mass, m/s²."""


@dataclass(frozen=True, eq=False)
class Outlook:
    """How things stand.

    Attributes
    ----------
    calibration : Calibration or None
        None where there is nothing to calibrate with.
    distance : float or None
        From rest to landing on the ball plane, m.
    budget : tuple of Contribution
        What each input adds to the uncertainty of `distance`, m, largest first.
    supposed : bool
        Whether the landing point is only supposed.
    problem : str
        Why there is no calibration, empty otherwise.
    warnings : tuple of str
    """

    calibration: Calibration | None
    distance: float | None = None
    budget: tuple[Contribution, ...] = ()
    supposed: bool = True
    problem: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def std(self) -> float | None:
        """Expected standard uncertainty of the landing distance, m."""
        if self.distance is None:
            return None
        return math.sqrt(sum(line.std**2 for line in self.budget))


@dataclass(frozen=True)
class Length:
    """A length between two clicks: value and standard uncertainty, m."""

    value: float
    std: float


def outlook(answers: Answers) -> Outlook:
    """Calibrate with all that was answered, and propagate to the landing distance."""
    if answers.grid is None:
        return Outlook(None, problem="There is no wall grid yet: step 3.")
    prior = None if answers.lens is None else answers.lens.prior
    try:
        found = solve(answers.grid, evidence_of(answers), lens=prior).calibration
    except CalibrationError as problem:
        return Outlook(None, problem=problem.in_one_line)
    landing, told = answers.landing
    rest = answers.rest
    start = np.zeros(2) if rest is None else found.position(rest)[0]

    def reach(c: Calibration) -> float:
        return float(c.position(landing)[0][0])

    distance = abs(reach(found) - float(start[0]))
    if not math.isfinite(distance):
        return Outlook(found, problem="The landing point looks past the wall.")
    noise = found.position(landing, _landing_noise(answers))[1]
    lines = [
        *found.budget(reach),
        Contribution(UncertaintySource.BALL_CENTRE, math.sqrt(noise[0, 0])),
    ]
    shown = [line for line in lines if line.std > 0.0]
    shown.sort(key=lambda line: -line.std)
    return Outlook(found, distance, tuple(shown), not told, warnings=found.warnings)


def evidence_of(answers: Answers) -> Evidence:
    """What is known besides the grid."""
    evidence = Evidence(
        rest_px=answers.rest,
        camera_distance=answers.camera_distance,
        ball_plane_offset=answers.ball_plane_offset,
    )
    ball = answers.ball
    if ball is None:
        return evidence
    radius = 0.5 * ball.diameter
    height = 0.0 if answers.support_height is None else answers.support_height + radius
    evidence = replace(
        evidence, ball_radius=radius, rest_height=height, outlines=_outlines(answers)
    )
    if evidence.taped or not answers.rate_known:
        return evidence
    return replace(evidence, fall=_fall(answers))


def _outlines(answers: Answers) -> BallOutlines | None:
    flight = None if answers.seen is None else answers.seen.flight
    if flight is None or answers.ball is None:
        return None
    diameter = answers.ball.diameter
    return BallOutlines.followed(
        flight.centre_px,
        flight.radius_px,
        flight.radius_std_px,
        Known(diameter, Defaults.BALL_DIAMETER.std_of(diameter)),
    )


def _fall(answers: Answers) -> FreeFall | None:
    """The flight against gravity, less what the air takes of it on the mean."""
    flight = None if answers.seen is None else answers.seen.flight
    if flight is None or answers.ball is None:
        return None
    # following ran on the rate as it was; only the product of rate and time counts
    time = flight.frame / answers.capture_fps
    drag = _drag(answers, time)
    by_rate = 2.0 * GRAVITY.value * nominal_rate_std(answers.capture_fps) / answers.capture_fps
    std = math.hypot(GRAVITY.std, drag.std, by_rate)
    across = np.sqrt(np.einsum("nii->n", flight.covariance_px2) / 2.0)
    return FreeFall(flight.centre_px, time, across, Known(GRAVITY.value - drag.value, std))


def _drag(answers: Answers, time: FloatArray) -> Known:
    ball, seen = answers.ball, answers.seen
    assert ball is not None
    assert seen is not None
    assert seen.flight is not None
    if ball.mass is None:
        return UNKNOWN_DRAG
    metres = 0.5 * ball.diameter / float(np.median(seen.flight.radius_px))
    path = seen.flight.centre_px * metres
    mean = (path[-1] - path[0]) / (time[-1] - time[0])
    area = math.pi * ball.diameter**2 / 4.0
    rate = 0.5 * Defaults.AIR_DENSITY.known * Defaults.DRAG_COEFFICIENT.known * area / ball.mass
    taken = rate * float(np.hypot(*mean)) * float(mean[1])
    return Known(taken, DRAG_SHARE * abs(taken) + 0.01)


def _landing_noise(answers: Answers) -> FloatArray:
    clicked = answers.landing_px is not None
    return (CLICK_STD_PX if clicked else PLACE_STD_PX) ** 2 * np.eye(2)


def length_between(
    calibration: Calibration, first: FloatArray, second: FloatArray, *, on_wall: bool
) -> Length:
    """A length between two places in the picture, on the wall or on the ball plane.

    Parameters
    ----------
    calibration : Calibration
    first, second : (2,) array
        Px.
    on_wall : bool
        On the wall, not on the ball plane.
    """
    px = np.stack([first, second])

    def length(c: Calibration, at: FloatArray = px) -> float:
        camera = c.grid_camera
        ends = camera.to_plane(at, 0.0 if on_wall else c.ball_plane_offset)
        return float(np.hypot(*(ends[1] - ends[0])))

    systematic = sum(line.std**2 for line in calibration.budget(length))
    clicks = 0.0
    for step in np.eye(4).reshape(4, 2, 2):
        slope = length(calibration, px + 0.5 * step) - length(calibration, px - 0.5 * step)
        clicks += (CLICK_STD_PX * slope) ** 2
    return Length(length(calibration), math.sqrt(systematic + clicks))


DISAGREES_AT = 3.0

"""Standard deviations: less than one true length in 300 is farther off."""


@dataclass(frozen=True)
class LengthComparison:
    """What a known length says.

    Attributes
    ----------
    text : str
    disagrees : bool
        Whether it contradicts the calibration.
    """

    text: str
    disagrees: bool = False


def verdict(
    calibration: Calibration, first: FloatArray, second: FloatArray, known: str, *, on_wall: bool
) -> LengthComparison:
    """Measure between two places and compare.

    Parameters
    ----------
    calibration : Calibration
    first, second : (2,) array
        Px.
    known : str
        The length as somebody wrote it, empty for none.
    on_wall : bool
        Else on the ball's plane.
    """
    length = length_between(calibration, first, second, on_wall=on_wall)
    plane = "on the wall" if on_wall else "on the ball's plane"
    if not np.isfinite(length.value):
        return LengthComparison("One end looks past the wall.", disagrees=True)
    told = f"{length.value:.4f} ± {length.std:.4f} m between the ends, {plane}."
    if not known.strip():
        return LengthComparison(told)
    try:
        true = read_number(known, measurands.DISTANCE)
    except UsageError as problem:
        return LengthComparison(f"{told} {problem.in_one_line}", disagrees=True)
    off = length.value - true
    ratio = abs(off) / length.std
    agrees = "agrees" if ratio < DISAGREES_AT else "disagrees: check the grid's pitch and the ends"
    return LengthComparison(
        f"{told} {1e3 * off:+.1f} mm off, {ratio:.1f} standard deviations: {agrees}.",
        ratio >= DISAGREES_AT,
    )
