"""Motion kinds against truth, on tracks kept out of the fit: python -m bench.motion_kinds OUT.

Drawn tracks of seeds from 100000, simulations of the shared labs 1000 to 1999, and the truth of the
shared clips, labs, scenes and renders. Prints tables and writes a reliability plot.
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from training.motion_tracks import Labelled, clip_tracks, draw, lab_track, truth_tracks
from vision.motions.kinds import Interpretation, interpret

FIRST_KEPT_OUT = 100_000


def judged(tracks: Iterable[Labelled]) -> list[tuple[Labelled, Interpretation]]:
    return [(one, interpret(one.ball, one.striker)) for one in tracks]


def accepted_probability(one: Labelled, found: Interpretation) -> float:
    return sum(share for kind, share in found.probabilities.items() if one.right(kind.value))


def summary(name: str, results: list[tuple[Labelled, Interpretation]]) -> None:
    right = [one.right(found.kind.value) for one, found in results]
    sure = [
        (good, found.probability >= 0.9) for good, (_, found) in zip(right, results, strict=True)
    ]
    stated = sum(is_sure for _, is_sure in sure)
    wrong = sum(is_sure and not good for good, is_sure in sure)
    loss = -np.mean([np.log(max(accepted_probability(*pair), 1e-6)) for pair in results])
    print(
        f"{name}: right {sum(right)} of {len(right)}; stated >= 0.90: {stated},"
        f" of these wrong {wrong}; log loss {loss:.3f}"
    )
    for good, (one, found) in zip(right, results, strict=True):
        if not good and (found.probability >= 0.9 or len(results) < 60):
            others = ", ".join(
                f"{kind.value} {share:.2f}"
                for kind, share in sorted(found.probabilities.items(), key=lambda item: -item[1])[
                    :3
                ]
            )
            print(
                f"  {one.name}: {one.kind}{' with striker' if one.striker else ''},"
                f" {len(one.ball)} rows: {others}"
            )


def confusion(results: list[tuple[Labelled, Interpretation]]) -> None:
    counts = Counter((one.kind, found.kind.value) for one, found in results)
    for kind in sorted({one.kind for one, _ in results}):
        line = {said: many for (true, said), many in counts.items() if true == kind}
        print(
            f"  {kind:10s} "
            + ", ".join(
                f"{said} {many}" for said, many in sorted(line.items(), key=lambda item: -item[1])
            )
        )


def reliability(results: list[tuple[Labelled, Interpretation]], file: Path) -> None:
    stated = np.array([found.probability for _, found in results])
    right = np.array([one.right(found.kind.value) for one, found in results])
    edges = np.array([0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0])
    figure, axis = plt.subplots(figsize=(4.2, 4.0))
    axis.plot([0, 1], [0, 1], color="0.7")
    print("stated          tracks  mean stated  right")
    for low, high in pairwise(edges):
        inside = (stated > low) & (stated <= high)
        many, good = int(inside.sum()), int(right[inside].sum())
        if not many:
            continue
        share = good / many
        print(f"{low:.2f} to {high:.2f}  {many:8d}  {stated[inside].mean():11.3f}  {share:5.3f}")
        # Wilson interval, one standard deviation
        centre, half = (
            (good + 0.5) / (many + 1),
            np.sqrt(many * share * (1 - share) + 0.25) / (many + 1),
        )
        axis.errorbar(stated[inside].mean(), centre, half, fmt="o", color="C0")
    axis.set(
        xlabel="stated probability", ylabel="fraction right", xlim=(0.2, 1.01), ylim=(0.2, 1.01)
    )
    figure.tight_layout()
    figure.savefig(file)


def swings(first: int, many: int) -> None:
    """Swings of 2 to 40 periods: recognised, and the period within two standard deviations."""
    known = within = 0
    total, off = 0, []
    for seed in range(first, first + 40 * many):
        one = draw(seed, "swing")
        if not np.isfinite(one.period) or np.ptp(one.ball.frame) / one.period < 2.0:
            continue
        total += 1
        found = interpret(one.ball)
        known += found.kind.value == "swing"
        swing = next((each for each in found.segments if np.isfinite(each.period_std)), None)
        if found.kind.value == "swing" and swing is not None:
            off.append((swing.period - one.period) / swing.period_std)
            within += abs(off[-1]) < 2.0
        else:
            print(
                f"  {one.name}: {found.kind.value} {found.probability:.2f}, "
                f"{np.ptp(one.ball.frame) / one.period:.1f} periods, {len(one.ball)} rows"
            )
        if total >= many:
            break
    print(
        f"swings of 2 to 40 periods: {known} of {total} recognised;"
        f" period within 2 std {within} of {len(off)}; median |z| {np.median(np.abs(off)):.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--drawn", type=int, default=500)
    parser.add_argument("--labs", type=int, default=200)
    parser.add_argument("--swings", type=int, default=100)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    began = time.process_time()
    clips = judged(clip_tracks())
    summary("shared clips", clips)
    summary("shared labs, scenes, renders", judged(truth_tracks()))
    labs = judged(lab_track(seed) for seed in range(1000, 1000 + arguments.labs))
    summary("simulated labs 1000 upwards", labs)
    confusion(labs)
    drawn = judged(draw(FIRST_KEPT_OUT + seed) for seed in range(arguments.drawn))
    summary("drawn, kept out", drawn)
    confusion(drawn)
    reliability([*labs, *drawn, *clips], arguments.out / "motion_kinds_reliability.svg")
    if arguments.swings:
        swings(2 * FIRST_KEPT_OUT, arguments.swings)
    print(f"CPU {time.process_time() - began:.0f} s")


if __name__ == "__main__":
    main()
