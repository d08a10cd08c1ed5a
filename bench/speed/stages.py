"""Where the time of measuring one clip goes, stage by stage, in a process that is warm.

Run: python -m bench.speed.stages [CLIP]

Processor time of the whole process, so that work shared out to threads counts where it is waited
for; what the profiler itself costs inflates what is made of many small calls.
"""

import cProfile
import pstats
import sys
import time
from pathlib import Path

from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.setup.file import load_setup

CLIP = Path(__file__).parents[2] / "sample_videos" / "clips" / "jokku_120.mp4"
STAGES = {
    "following": "follow",
    "— of it the scene without what moves": "estimate_background",
    "— of it circles and their paths": "paths",
    "— of it the ball's outlines": "follow_ball",
    "— of it the striker": "find_striker",
    "wall grid": "find_wall_grid",
    "calibration": "calibrate",
    "swing, flight, contact": "find_impact",
    "noise of the tracks": "random_covariance",
    "uncertainty of the inputs": "systematic_budget",
}


def main() -> None:
    clip = Path(sys.argv[1]) if len(sys.argv) > 1 else CLIP
    options = MeasureOptions(setup=load_setup(clip.with_suffix(".toml")))
    begun = time.process_time()
    measure_clip(clip, options)
    first = time.process_time() - begun
    begun = time.process_time()
    measure_clip(clip, options)
    warm = time.process_time() - begun
    profile = cProfile.Profile(time.process_time)
    profile.runcall(measure_clip, clip, options)
    told = pstats.Stats(profile)
    spent: dict[str, float] = {}
    for (_, _, name), (_, _, _, within, _) in told.stats.items():  # type: ignore[attr-defined]
        spent[name] = max(spent.get(name, 0.0), within)
    whole = spent["measure_clip"]
    print(f"{clip.stem}: {first:.1f} s with loading, {warm:.1f} s warm\n")
    print("| stage | share of measuring |\n|---|---|")
    for stage, name in STAGES.items():
        print(f"| {stage} | {100.0 * spent.get(name, 0.0) / whole:.0f} % |")


if __name__ == "__main__":
    main()
