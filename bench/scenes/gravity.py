"""Compare gravity measured from filmed falls with 9.81 m/s².

Run: python -m bench.scenes.gravity [--shared FOLDER]

Each clip is measured with the frame rate and size in its README. The places are unknown; gravity
is within 0.27 % of 9.81 m/s² everywhere on Earth (WGS 84: 9.780 to 9.832 m/s² at sea level).
"""

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

from pipelines.measure.chain import MeasureOptions, measure_clip

ANYWHERE = 9.81


@dataclass(frozen=True)
class Fall:
    """A clip with its frame rate and scale."""

    clip: str
    source: str
    options: MeasureOptions


FALLS = (
    Fall(
        "balltoss_480p30.mov",
        "metre stick, 398.7 px/m, at an unknown distance from the ball",
        MeasureOptions(fps=29.97, scale_m_per_px=(1 / 398.7, 0.02 / 398.7)),
    ),
    Fall(
        "freefall_phantom1000.mp4",
        "1000 fps, ball of 20.2 mm",
        MeasureOptions(fps=1000.0, ball="20.2mm"),
    ),
)


def row(folder: Path, fall: Fall) -> str:
    """One line of the table."""
    found = measure_clip(folder / fall.clip, fall.options).quantity("fall_acceleration")
    if found.value is None or found.std is None:
        return f"| {fall.clip} | {fall.source} | – ({found.reason}) | | |"
    return (
        f"| {fall.clip} | {fall.source} | {found.value:.2f} ± {found.std:.2f} "
        f"| {(found.value - ANYWHERE) / found.std:+.1f} | {100 * found.std / found.value:.1f} % |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    shared = Path(os.environ.get("IMPACT_VISION_SHARED", "../shared"))
    parser.add_argument("--shared", type=Path, default=shared)
    chosen = parser.parse_args()
    print("| clip | source of scale and rate | g, m/s² | z | relative std |\n|---|---|---|---|---|")
    for fall in FALLS:
        print(row(chosen.shared / "clips", fall), flush=True)


if __name__ == "__main__":
    main()
