"""Landing uncertainty to expect from the answers so far; a known length to verify."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, Evidence
from calib.solve import SeenFall, solve
from measuring.budget import ClipConditions
from measuring.chain import FollowedClip
from measuring.checker.clips import clip_findings
from measuring.checker.scene import Finding
from measuring.gravity import seen_fall
from measuring.metres import scene_evidence, stated_evidence
from metrology import (
    CalibrationError,
    Contribution,
    UncertaintySource,
    UsageError,
    measurands,
    read_number,
)
from pipelines.calibrate.answers import Answers

__all__ = ["LengthComparison", "Outlook", "compare_length", "length_between", "outlook"]

FloatArray = NDArray[np.float64]

PLACE_STD_PX = 0.2
"""px: standard uncertainty of a tracked or assumed landing point (assumed)."""

CLICK_STD_PX = 0.5
"""px: standard uncertainty of a clicked position (assumed)."""

NO_GRID = "There is no wall grid yet."


@dataclass(frozen=True, eq=False)
class Outlook:
    """Results from the current answers.

    Attributes
    ----------
    calibration : Calibration or None
        None without data to calibrate with.
    distance : float or None
        From rest to landing on the ball plane, m.
    budget : tuple of Contribution
        Contributions to the uncertainty of `distance`, m, largest first.
    assumed : bool
        Whether the landing point is only assumed.
    problem : str
        Why there is no calibration; empty otherwise.
    findings : tuple of Finding
        Contradictions of the answers; their sentences come first in problem or warnings.
    """

    calibration: Calibration | None
    distance: float | None = None
    budget: tuple[Contribution, ...] = ()
    assumed: bool = True
    problem: str = ""
    warnings: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def std(self) -> float | None:
        """Expected standard uncertainty of the landing distance, m."""
        if self.distance is None:
            return None
        return math.sqrt(sum(line.std**2 for line in self.budget))


@dataclass(frozen=True)
class Length:
    """A length between two clicked positions: value and standard uncertainty, m."""

    value: float
    std: float


def outlook(answers: Answers) -> Outlook:
    """Calibrate with all answers and propagate to the landing distance."""
    findings = _findings(answers)
    causes = [finding.sentence for finding in findings]
    if answers.grid is None:
        return Outlook(None, problem=NO_GRID, warnings=tuple(causes), findings=findings)
    try:
        found = _calibration(answers)
    except CalibrationError as problem:
        return Outlook(None, problem=" ".join([*causes, problem.in_one_line]), findings=findings)
    landing, seen = answers.landing
    rest = answers.rest
    start = np.zeros(2) if rest is None else found.position(rest)[0]

    def landing_x(c: Calibration) -> float:
        return float(c.position(landing)[0][0])

    distance = abs(landing_x(found) - float(start[0]))
    if not math.isfinite(distance):
        return Outlook(found, problem="The line of sight to the landing point misses the wall.")
    std_px = PLACE_STD_PX if answers.landing_px is None else CLICK_STD_PX
    noise = found.position(landing, std_px**2 * np.eye(2))[1]
    lines = [
        *found.budget(landing_x),
        Contribution(UncertaintySource.BALL_CENTRE, math.sqrt(noise[0, 0])),
    ]
    shown = sorted((line for line in lines if line.std > 0.0), key=lambda line: -line.std)
    warnings = (*causes, *found.warnings)
    return Outlook(found, distance, tuple(shown), not seen, warnings=warnings, findings=findings)


def _calibration(answers: Answers) -> Calibration:
    """Camera and planes from grid, ball and distances, as `measure` fits them.

    Raises
    ------
    CalibrationError
        If they contradict each other.
    """
    assert answers.grid is not None
    inputs, rate, tracks = answers.inputs, answers.rate, answers.tracks
    evidence: Evidence
    see_fall: Callable[[Calibration], SeenFall | None] | None = None
    if tracks is None:
        evidence = stated_evidence(inputs)
    else:
        evidence = scene_evidence(tracks, inputs)
        scene, time = ClipConditions(inputs, rate, None), answers.scene.clock / rate.fps

        def see_fall(calibration: Calibration) -> SeenFall | None:
            return seen_fall(replace(scene, calibration=calibration), tracks, time)

    if answers.rest_px is not None:
        evidence = replace(evidence, rest_px=answers.rest_px)
    fall = see_fall if rate.known else None
    return solve(answers.grid, evidence, lens=answers.lens, see_fall=fall).calibration


def _findings(answers: Answers) -> tuple[Finding, ...]:
    """Contradictions, as `measure` finds them once the ball is tracked."""
    if answers.tracks is None:
        return ()
    scene = answers.scene
    followed = FollowedClip(answers.tracks, scene.clock, answers.rate, answers.inputs)
    return clip_findings(followed, answers.grid)


def length_between(
    calibration: Calibration, first: FloatArray, second: FloatArray, *, on_wall: bool
) -> Length:
    """A length between two positions in the image, on the wall or on the ball plane.

    Parameters
    ----------
    first, second : (2,) array
        Px.
    on_wall : bool
        Whether on the wall rather than on the ball plane.
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


MAX_LENGTH_DEVIATION = 3.0
"""Standard deviations: 0.3 % of correct lengths deviate by more."""


@dataclass(frozen=True)
class LengthComparison:
    """Comparison with a known length.

    Attributes
    ----------
    disagrees : bool
        Whether it contradicts the calibration.
    """

    text: str
    disagrees: bool = False


def compare_length(
    calibration: Calibration, first: FloatArray, second: FloatArray, known: str, *, on_wall: bool
) -> LengthComparison:
    """Measure between two positions and compare with a known length.

    Parameters
    ----------
    first, second : (2,) array
        Px.
    known : str
        The length as entered; empty for none.
    on_wall : bool
        Otherwise on the ball's plane.
    """
    length = length_between(calibration, first, second, on_wall=on_wall)
    plane = "on the wall" if on_wall else "on the ball's plane"
    if not np.isfinite(length.value):
        return LengthComparison("The line of sight to one end misses the wall.", disagrees=True)
    text = f"{length.value:.4f} ± {length.std:.4f} m between the ends, {plane}."
    if not known.strip():
        return LengthComparison(text)
    try:
        true = read_number(known, measurands.DISTANCE)
    except UsageError as problem:
        return LengthComparison(f"{text} {problem.in_one_line}", disagrees=True)
    off = length.value - true
    ratio = abs(off) / length.std
    agrees = (
        "agrees"
        if ratio < MAX_LENGTH_DEVIATION
        else "disagrees: check the grid's pitch and the ends"
    )
    return LengthComparison(
        f"{text} {1e3 * off:+.1f} mm off, {ratio:.1f} standard deviations: {agrees}.",
        ratio >= MAX_LENGTH_DEVIATION,
    )
