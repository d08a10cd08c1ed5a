"""The whole measuring chain against truth: every quantity of every clip, and the targets.

Run: python -m bench.measure [FOLDER...] [--only NAME...] [--summary-only] [--draw SEED]

FOLDER holds one folder a clip, with clip.mp4, setup.json and truth.json; the clips shipped in
sample_videos/clips are measured too. Each clip is measured unattended with what a lab would have
taped; z is error over stated standard uncertainty. With --draw, what is taped, weighed or supposed
is off by a draw of what is stated for it, as it is in a lab: then the share of intervals that hold
is the one that they say.
"""

import argparse
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.measure_truth import LEAST_WIDTH, Case, as_written_down, cases
from metrology import ImpactVisionError, Quantity
from pipelines.measure.chain import measure_clip
from pipelines.measure.measurement import ClipMeasurement
from vision.clip.clip import ClipReader

FloatArray = NDArray[np.float64]
COVERAGE = 1.96
FAR, FURTHEST = 3.0, 4.0
SPEED_WIDTH = 640
ZERO_FRAMES = 40


@dataclass(frozen=True)
class Outcome:
    """What came of one clip; `zero` is what the pendulum's angles are off by together, and the std
    they state for it, °."""

    case: Case
    measurement: ClipMeasurement
    centre_rms_px: float
    speed_ratio: float
    zero: tuple[float, float]

    def error(self, name: str) -> float | None:
        """Measured minus true; None where there is no value."""
        value = self.measurement.quantity(name).value
        return None if value is None else value - self.case.truth[name]

    def scored(self) -> Iterator[tuple[Quantity, float]]:
        """Quantities that have a value with their truth; the self-check by gravity too."""
        for item in (*self.measurement.quantities, self.measurement.gravity):
            if item.value is not None and item.name in self.case.truth:
                yield item, self.case.truth[item.name]


def centre_rms(measurement: ClipMeasurement, true_px: FloatArray) -> float:
    """Root mean square error of the projection of the ball's centre, along one axis, px.

    The outline of a sphere lies off its centre: the chain's own camera takes it to the ball plane
    and back.
    """
    ball, calibration = measurement.tracks.ball, measurement.calibration
    if calibration is None:
        return math.nan
    spot = calibration.position(ball.centre_px)[0]
    plane = np.full(len(spot), calibration.ball_plane_offset)
    error = calibration.camera.project(np.column_stack([spot, plane])) - true_px[ball.frame]
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan


def zero_error(measurement: ClipMeasurement, true_rad: FloatArray) -> tuple[float, float]:
    """What all angles of the pendulum are off by near the strike, and the std stated, °."""
    pendulum, impact = measurement.tracks.pendulum, measurement.impact
    if pendulum is None or impact is None or measurement.tracks.rest_frames is None:
        return math.nan, math.nan
    frame, last = pendulum.track.frame, measurement.tracks.rest_frames[1]
    near = np.abs(frame - last) < ZERO_FRAMES
    if not near.any():
        return math.nan, math.nan
    off = float(np.mean(impact.tracks.swing_rad[near] - true_rad[frame[near]]))
    arm = np.mean(pendulum.track.centre_px[near], axis=0) - pendulum.pivot_px
    across = np.array([-arm[1], arm[0]]) / float(arm @ arm)
    by_pivot = math.sqrt(across @ pendulum.pivot_covariance_px2 @ across)
    return math.degrees(off), math.degrees(math.hypot(pendulum.zero_std_rad, by_pivot))


def measured(case: Case) -> Outcome:
    """Measure one clip, and decode it once more without doing anything else."""
    start = time.perf_counter()
    measurement = measure_clip(case.path, case.options)
    middle = time.perf_counter()
    for _ in ClipReader.open(case.path).frames():
        pass
    decoding = time.perf_counter() - middle
    rms = centre_rms(measurement, case.centre_px)
    zero = zero_error(measurement, case.phi_rad)
    return Outcome(case, measurement, rms, decoding / (middle - start), zero)


def table(outcome: Outcome) -> str:
    """One clip's quantities beside the truth."""
    info = outcome.measurement.info
    lines = [
        f"### {outcome.case.name}, {info.width}×{info.height}\n",
        "| quantity | unit | measured | truth | error | z |\n|---|---|---|---|---|---|",
    ]
    for item in (*outcome.measurement.quantities, outcome.measurement.gravity):
        true = outcome.case.truth.get(item.name)
        if true is None:
            continue
        if item.value is None or item.std is None:
            lines.append(f"| {item.name} | {item.unit} | – ({item.reason}) | {true:.5g} | | |")
            continue
        error = item.value - true
        z = f"{error / item.std:+.1f}" if item.std else "–"
        lines.append(
            f"| {item.name} | {item.unit} | {item.value:.5g} ± {item.std:.2g} | {true:.5g} | "
            f"{error:+.2g} | {z} |"
        )
    return "\n".join(lines) + "\n"


def rms_error(outcomes: list[Outcome], name: str, share: bool = False) -> float:
    """Root mean square error of a quantity, in its unit or in % of the truth."""
    errors = []
    for outcome in outcomes:
        error = outcome.error(name)
        if error is not None:
            errors.append(100 * error / outcome.case.truth[name] if share else error)
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def frames_error(outcomes: list[Outcome]) -> float:
    """Root mean square error of contact time, in frames."""
    errors = [
        error * outcome.case.fps
        for outcome in outcomes
        if (error := outcome.error("contact_time")) is not None
    ]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def frames_off(outcomes: list[Outcome]) -> float:
    """Largest error of the count of contact frames."""
    errors = [one.error("contact_frames") for one in outcomes]
    return max((abs(error) for error in errors if error is not None), default=math.nan)


def with_value(outcomes: list[Outcome], name: str) -> str:
    """On how many of the clips there is a value at all; a clip without one has no error."""
    if name == "centre":
        known = sum(math.isfinite(one.centre_rms_px) for one in outcomes)
    else:
        known = sum(one.measurement.quantity(name).known for one in outcomes)
    return f"{known} of {len(outcomes)}"


def holds(item: Quantity, true: float) -> bool:
    """Whether the 95 % interval holds the truth."""
    assert item.value is not None
    assert item.std is not None
    return abs(item.value - true) <= COVERAGE * item.std


def held(outcomes: list[Outcome], name: str | None = None) -> tuple[int, int]:
    """How many 95 % intervals hold the truth, of how many; of one quantity or of all."""
    hits = [
        holds(item, true)
        for outcome in outcomes
        for item, true in outcome.scored()
        if name in (None, item.name)
    ]
    return sum(hits), len(hits)


def percent_held(outcomes: list[Outcome]) -> float:
    inside, count = held(outcomes)
    return 100 * inside / count if count else math.nan


def speed_ratio(outcomes: list[Outcome]) -> float:
    """The lowest ratio among the clips of the width that the target names."""
    ratios = [item.speed_ratio for item in outcomes if item.measurement.info.width == SPEED_WIDTH]
    return min(ratios, default=math.nan)


Number = Callable[[list[Outcome]], float]


@dataclass(frozen=True)
class Target:
    """A line of the table of targets; `quantity` tells on how many clips there is a value."""

    words: str
    unit: str
    quantity: str
    number: Number
    least: float
    aim: float


TARGETS = (
    Target(
        "ball centre in flight, RMS, worst clip",
        "px",
        "centre",
        lambda all_: max((one.centre_rms_px for one in all_), default=math.nan),
        0.10,
        0.04,
    ),
    Target("contact time, RMS", "frame", "contact_time", frames_error, 0.35, 0.1),
    Target("contact frames, furthest off", "", "contact_frames", frames_off, 1, 0),
    Target(
        "ball speed at release, RMS",
        "%",
        "ball_speed",
        lambda all_: rms_error(all_, "ball_speed", True),
        0.5,
        0.15,
    ),
    Target(
        "launch angle, RMS",
        "°",
        "launch_angle",
        lambda all_: rms_error(all_, "launch_angle"),
        0.3,
        0.08,
    ),
    Target(
        "landing distance, corrected, RMS",
        "%",
        "landing_distance",
        lambda all_: rms_error(all_, "landing_distance", True),
        0.3,
        0.08,
    ),
    Target("COR, fused, RMS", "", "cor", lambda all_: rms_error(all_, "cor"), 0.015, 0.004),
)


def verdict(value: float, least: float, aim: float) -> str:
    if math.isnan(value):
        return "not measured"
    return "aim reached" if value <= aim else "reached" if value <= least else "**missed**"


def summary(outcomes: list[Outcome]) -> str:
    """The targets beside what was measured."""
    good = [item for item in outcomes if item.case.good]
    hard = [item for item in outcomes if not item.case.good]
    lines = [
        "### Targets\n",
        f"Good light, {LEAST_WIDTH}×240 and up: {', '.join(one.case.name for one in good)}. "
        f"Hard: {', '.join(one.case.name for one in hard)}; for these the demand is no failure "
        "and errors within the stated uncertainty.\n",
        "Errors are over the clips that give a value; the count of those stands in brackets.\n",
        "| | at least | aim | good light | | hard |\n|---|---|---|---|---|---|",
    ]
    for target in TARGETS:
        value, unit = target.number(good), target.unit
        cells = (
            target.words,
            f"{target.least:g} {unit}",
            f"{target.aim:g} {unit}",
            f"{value:.3g} {unit} ({with_value(good, target.quantity)})",
            verdict(value, target.least, target.aim),
            f"{target.number(hard):.3g} {unit} ({with_value(hard, target.quantity)})",
        )
        lines.append("| " + " | ".join(cells) + " |")
    lines += [contact_line(good, hard), coverage_line(good, hard), speed_line(good)]
    return "\n".join(lines) + f"\n\n{shortfalls(outcomes)}\n"


def shortfalls(outcomes: list[Outcome]) -> str:
    """Clips whose contact isn't measured, and quantities far outside what they claim."""
    mute = [
        f"{one.case.name} ({one.measurement.quantity('contact_time').reason})"
        for one in outcomes
        if not one.measurement.quantity("contact_time").known
    ]
    far = [
        f"{item.name} of {one.case.name} ({(item.value - true) / item.std:+.1f})"
        for one in outcomes
        for item, true in one.scored()
        if item.value is not None and item.std and abs(item.value - true) > FAR * item.std
    ]
    return (
        f"No contact measured: {'; '.join(mute) or 'none'}.\n\n"
        f"Further off than {FAR:g} standard uncertainties (z): {'; '.join(far) or 'none'}."
    )


def contact_line(good: list[Outcome], hard: list[Outcome]) -> str:
    inside, count = held(good, "contact_frames")
    word = "reached" if inside == count else "**missed**"
    of_hard = "{} of {}".format(*held(hard, "contact_frames"))
    return (
        f"| contact frames, interval holds the truth | all | all | {inside} of {count} | {word} "
        f"| {of_hard} |"
    )


def coverage_line(good: list[Outcome], hard: list[Outcome]) -> str:
    share = percent_held(good)
    word = "aim reached" if 93 <= share <= 97 else "reached" if 85 <= share <= 99 else "**missed**"
    return (
        f"| 95 % intervals that hold the truth | 85–99 % | 93–97 % | {share:.0f} % "
        f"({held(good)[1]}) | {word} | {percent_held(hard):.0f} % ({held(hard)[1]}) |"
    )


def speed_line(good: list[Outcome]) -> str:
    ratio = speed_ratio(good)
    word = "aim reached" if ratio >= 0.7 else "reached" if ratio >= 0.35 else "**missed**"
    return (
        f"| frames/s of measuring over decoding alone, {SPEED_WIDTH}×360, lowest | 0.35 | 0.7 "
        f"| {ratio:.2g} | {word} | |"
    )


ROW = (
    "contact_time",
    "ball_speed",
    "launch_angle",
    "landing_distance",
    "cor",
    "pendulum_speed_before",
)


def row_of(outcome: Outcome) -> str:
    """One clip in a line: errors of the main quantities with z, and what is far off."""
    cells = [outcome.case.name]
    for name in ROW:
        item = outcome.measurement.quantity(name)
        error = outcome.error(name)
        if error is None or not item.std:
            cells.append("–")
            continue
        if name == "contact_time":
            shown = f"{error * outcome.case.fps:+.2f} frame"
        elif name in ("launch_angle", "cor"):
            shown = f"{error:+.3f}" + ("°" if name == "launch_angle" else "")
        else:
            shown = f"{100 * error / outcome.case.truth[name]:+.2f} %"
        cells.append(f"{shown} ({error / item.std:+.1f})")
    scored = list(outcome.scored())
    inside = sum(holds(item, true) for item, true in scored)
    cells.append(f"{inside} of {len(scored)}")
    cells.append(", ".join(far_of(outcome, FURTHEST)) or "–")
    return "| " + " | ".join(cells) + " |"


def far_of(outcome: Outcome, sigmas: float) -> list[str]:
    """Quantities further off than so many of their stated uncertainties."""
    return [
        f"{item.name} ({(item.value - true) / item.std:+.1f})"
        for item, true in outcome.scored()
        if item.value is not None and item.std and abs(item.value - true) > sigmas * item.std
    ]


def overview(outcomes: list[Outcome]) -> str:
    """A row for each clip, and over all of them the numbers that are asked for."""
    head = (
        "| clip | contact time | speed | angle | landing | COR | pendulum | 95 % hold | beyond 4 |"
        "\n|---|---|---|---|---|---|---|---|---|"
    )
    frames = [
        error * one.case.fps for one in outcomes if (error := one.error("contact_time")) is not None
    ]
    far = [f"{one.case.name}: {name}" for one in outcomes for name in far_of(one, FURTHEST)]
    inside, count = held(outcomes)
    mean = float(np.mean(frames)) if frames else math.nan
    rows = [
        ("contact time, RMS", f"{frames_error(outcomes):.2f} frame", "0.4", "0.15"),
        ("contact time, mean error", f"{mean:+.2f} frame", "0.15", "0.05"),
        ("speed, RMS", f"{rms_error(outcomes, 'ball_speed', True):.2f} %", "0.5", "0.2"),
        ("angle, RMS", f"{rms_error(outcomes, 'launch_angle'):.2f}°", "0.4", "0.1"),
        ("landing, RMS", f"{rms_error(outcomes, 'landing_distance', True):.2f} %", "0.4", "0.1"),
        ("quantities beyond 4 uncertainties", str(len(far)), "0", "0"),
        ("95 % intervals that hold", f"{100 * inside / max(count, 1):.0f} % of {count}", "", ""),
        ("contact time given", with_value(outcomes, "contact_time"), "", ""),
        ("speed given", with_value(outcomes, "ball_speed"), "", ""),
    ]
    off, stated = np.array([one.zero for one in outcomes if math.isfinite(one.zero[0])]).T
    share = float(np.sqrt(np.mean((off / stated) ** 2)))
    words = f"{float(np.sqrt(np.mean(off**2))):.2f}°, {share:.1f} of what is stated"
    rows.append(("zero of the pendulum's angle, RMS", words, "", ""))
    table_ = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    return "\n".join(
        [
            "### Clip by clip\n",
            "Error, and in brackets over the stated uncertainty.\n",
            head,
            *(row_of(one) for one in outcomes),
            "\n### Over all clips\n",
            "| | measured | at least | aim |\n|---|---|---|---|",
            table_,
            f"\nBeyond 4: {'; '.join(far) or 'none'}.\n",
        ]
    )


def printed_overview(wanted: Iterable[Case]) -> list[Outcome]:
    """Measure each clip and print a row for each; those of which something was measured."""
    outcomes, failed = [], []
    for case in wanted:
        try:
            outcomes.append(measured(case))
        except ImpactVisionError as problem:
            failed.append(f"{case.name}: {problem.message}")
    print(overview(outcomes))
    print(f"Nothing measured: {'; '.join(failed) or 'none'}.\n")
    return outcomes


def main() -> None:
    """Print a table for each clip and the targets."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--only", nargs="*", help="Names of clips, or parts of them.")
    parser.add_argument("--summary-only", action="store_true")
    parser.add_argument("--draw", type=int, metavar="SEED", help="Tapes and scales off by a draw.")
    chosen = parser.parse_args()
    wanted = [
        case
        for case in cases(*chosen.folders)
        if not chosen.only or any(part in case.name for part in chosen.only)
    ]
    if not wanted:
        parser.error("no clip of that name among those shipped and in the folders given")
    if chosen.draw is not None:
        rng = np.random.default_rng(chosen.draw)
        wanted = [as_written_down(case, rng) for case in wanted]
    outcomes = printed_overview(wanted)
    print(summary(outcomes))
    if not chosen.summary_only:
        print("\n".join(table(outcome) for outcome in outcomes))


if __name__ == "__main__":
    main()
