"""Compare every measured quantity of every clip with its truth.

Run: python -m bench.measure [FOLDER...] [--only NAME...] [--summary-only] [--draw SEED]

FOLDER contains one folder per clip, with clip.mp4, setup.json and truth.json; the shipped clips
are measured too. Each clip is measured unattended with the distances a laboratory would measure
by hand; z is the error divided by the stated standard uncertainty. With --draw, every given
number is displaced by a draw from its stated uncertainty, so that the coverage of the intervals
can be compared with the nominal 95 %.
"""

import argparse
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.measure_truth import Case, as_written_down, cases
from metrology import ImpactVisionError, Quantity
from pipelines.measure.chain import measure_clip
from pipelines.measure.measurement import ClipMeasurement

FloatArray = NDArray[np.float64]
COVERAGE = 1.96
FAR = 4.0
ZERO_FRAMES = 40


@dataclass(frozen=True)
class Outcome:
    """Measurement of one clip with its errors.

    `zero` is the common error of the pendulum's angles and its stated standard deviation, °.
    """

    case: Case
    measurement: ClipMeasurement
    centre_rms_px: float
    zero: tuple[float, float]

    def error(self, name: str) -> float | None:
        """Measured minus true value; None if the quantity was not measured."""
        value = self.measurement.quantity(name).value
        return None if value is None else value - self.case.truth[name]

    def scored(self) -> Iterator[tuple[Quantity, float]]:
        """Measured quantities, gravity check included, with their true values."""
        for item in (*self.measurement.quantities, self.measurement.gravity):
            if item.value is not None and item.name in self.case.truth:
                yield item, self.case.truth[item.name]


def centre_rms(measurement: ClipMeasurement, true_px: FloatArray) -> float:
    """Root mean square error of the projection of the ball's centre, along one axis, px.

    The outline of a sphere is not centred on the projection of its centre; the estimated camera
    transforms it to the ball plane and back.
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
    """Mean error of the pendulum's angles near the strike and its stated std, °."""
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
    """Measure one clip and compare the ball's centre and the pendulum's zero with the truth."""
    measurement = measure_clip(case.path, case.options)
    rms = centre_rms(measurement, case.centre_px)
    return Outcome(case, measurement, rms, zero_error(measurement, case.phi_rad))


def table(outcome: Outcome) -> str:
    """Table of one clip: quantities, truth, error and z."""
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


def rms_error(outcomes: list[Outcome], name: str, relative: bool = False) -> float:
    """Root mean square error of a quantity, in its unit or in % of the truth."""
    errors = []
    for outcome in outcomes:
        error = outcome.error(name)
        if error is not None:
            errors.append(100 * error / outcome.case.truth[name] if relative else error)
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def frames_error(outcomes: list[Outcome]) -> float:
    """Root mean square error of contact time, in frames."""
    errors = [
        error * outcome.case.fps
        for outcome in outcomes
        if (error := outcome.error("contact_time")) is not None
    ]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def with_value(outcomes: list[Outcome], name: str) -> str:
    """Number of clips in which a quantity was measured."""
    known = sum(one.measurement.quantity(name).known for one in outcomes)
    return f"{known} of {len(outcomes)}"


def covers(item: Quantity, true: float) -> bool:
    """Whether the 95 % interval contains the true value."""
    assert item.value is not None
    assert item.std is not None
    return abs(item.value - true) <= COVERAGE * item.std


ROW = (
    "contact_time",
    "ball_speed",
    "launch_angle",
    "landing_distance",
    "cor",
    "pendulum_speed_before",
)


def row_of(outcome: Outcome) -> str:
    """Row of one clip: errors of the main quantities with z, and outliers."""
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
    inside = sum(covers(item, true) for item, true in scored)
    cells.append(f"{inside} of {len(scored)}")
    cells.append(", ".join(far_of(outcome, FAR)) or "–")
    return "| " + " | ".join(cells) + " |"


def far_of(outcome: Outcome, sigmas: float) -> list[str]:
    """Quantities whose error exceeds `sigmas` stated standard uncertainties."""
    return [
        f"{item.name} ({(item.value - true) / item.std:+.1f})"
        for item, true in outcome.scored()
        if item.value is not None and item.std and abs(item.value - true) > sigmas * item.std
    ]


def overview(outcomes: list[Outcome]) -> str:
    """A row for each clip, and RMS errors and coverage over all of them."""
    head = (
        "| clip | contact time | speed | angle | landing | COR | pendulum | in 95 % | beyond 4 |"
        "\n|---|---|---|---|---|---|---|---|---|"
    )
    frames = [
        error * one.case.fps for one in outcomes if (error := one.error("contact_time")) is not None
    ]
    far = [f"{one.case.name}: {name}" for one in outcomes for name in far_of(one, FAR)]
    hits = [covers(item, true) for one in outcomes for item, true in one.scored()]
    inside, count = sum(hits), len(hits)
    mean = float(np.mean(frames)) if frames else math.nan
    rows = [
        ("contact time, RMS", f"{frames_error(outcomes):.2f} frame", "0.4", "0.15"),
        ("contact time, mean error", f"{mean:+.2f} frame", "0.15", "0.05"),
        ("speed, RMS", f"{rms_error(outcomes, 'ball_speed', True):.2f} %", "0.5", "0.2"),
        ("angle, RMS", f"{rms_error(outcomes, 'launch_angle'):.2f}°", "0.4", "0.1"),
        ("landing, RMS", f"{rms_error(outcomes, 'landing_distance', True):.2f} %", "0.4", "0.1"),
        ("quantities beyond 4 uncertainties", str(len(far)), "0", "0"),
        ("in the 95 % interval", f"{100 * inside / max(count, 1):.0f} % of {count}", "", ""),
        ("contact time given", with_value(outcomes, "contact_time"), "", ""),
        ("speed given", with_value(outcomes, "ball_speed"), "", ""),
    ]
    off, stated = np.array([one.zero for one in outcomes if math.isfinite(one.zero[0])]).T
    ratio = float(np.sqrt(np.mean((off / stated) ** 2)))
    zero = f"{float(np.sqrt(np.mean(off**2))):.2f}°, {ratio:.1f} of the stated std"
    rows.append(("zero of the pendulum's angle, RMS", zero, "", ""))
    table_ = "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
    return "\n".join(
        [
            "### Clip by clip\n",
            "Error, and in brackets the error over the stated standard uncertainty.\n",
            head,
            *(row_of(one) for one in outcomes),
            "\n### Over all clips\n",
            "| | measured | required | goal |\n|---|---|---|---|",
            table_,
            f"\nBeyond 4: {'; '.join(far) or 'none'}.\n",
        ]
    )


def printed_overview(wanted: Iterable[Case]) -> list[Outcome]:
    """Measure the clips and print the overview; the outcomes of clips that were measured."""
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
    """Print the overview and a table for each clip."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="*")
    parser.add_argument("--only", nargs="*", help="names of clips, or fragments of names")
    parser.add_argument("--summary-only", action="store_true")
    parser.add_argument("--draw", type=int, metavar="SEED", help="displace given numbers")
    chosen = parser.parse_args()
    wanted = [
        case
        for case in cases(*chosen.folders)
        if not chosen.only or any(part in case.name for part in chosen.only)
    ]
    if not wanted:
        parser.error("no shipped clip and no clip in the folders has such a name")
    if chosen.draw is not None:
        rng = np.random.default_rng(chosen.draw)
        wanted = [as_written_down(case, rng) for case in wanted]
    outcomes = printed_overview(wanted)
    if not chosen.summary_only:
        print("\n".join(table(outcome) for outcome in outcomes))


if __name__ == "__main__":
    main()
