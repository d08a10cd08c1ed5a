"""Time the commands a user runs, relative to decoding and to an earlier commit.

Run: python -m bench.speed [--runs N] [--against COMMIT] [--rows WORD…]

Each figure is the median processor time (user + system) of whole processes, start-up included.
With --against, the commit is checked out and timed by the same interpreter. Processor times on a
busy machine are comparable only within one run. The second table splits one measurement by stage.
"""

import argparse
import cProfile
import os
import pstats
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.setup.file import load_setup

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_videos"
VISION = "from pipelines.cli import app; app()"
DECODE = "from vision.clip.clip import ClipReader; import sys; "
DECODE += "sum(1 for _ in ClipReader.open(sys.argv[1]).frames())"


def _measured(name: str) -> tuple[str, ...]:
    clip = SAMPLES / "clips" / f"{name}.mp4"
    return "measure", str(clip), "--setup", str(clip.with_suffix(".toml")), "--quiet"


ROWS: dict[str, tuple[str, tuple[str, ...]]] = {
    "decode, 640×360": (DECODE, (str(SAMPLES / "clips" / "jokku_120.mp4"),)),
    "measure, 640×360": (VISION, _measured("jokku_120")),
    "measure, 432×240": (VISION, _measured("basketball_60")),
    "explain, shipped campaign": (
        VISION,
        (
            *("explain", str(SAMPLES / "campaign" / "ball.csv"), "--quiet"),
            *("--pendulum", str(SAMPLES / "campaign" / "pendulum.csv")),
            *("--setup", str(SAMPLES / "campaign" / "setup.toml")),
        ),
    ),
    "import impact_vision": ("import impact_vision", ()),
    "vision --help": (VISION, ("--help",)),
}
STAGES = {
    "following": "follow",
    "— background": "estimate_background",
    "— outlines of the ball": "follow_ball",
    "— striker": "find_striker",
    "wall grid": "find_wall_grid",
    "calibration": "calibrate",
    "swing, flight, contact": "find_impact",
    "uncertainty of the inputs": "systematic_budget",
}
"""Rows of the table of stages: label, function whose cumulative time is reported."""


def cpu_seconds(root: Path, script: str, arguments: tuple[str, ...]) -> float:
    """Processor time of one process that runs the code under `root`, s."""
    environment = {**os.environ, "PYTHONPATH": str(root), "IMPACT_VISION_CACHE": "off"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-c", script, *arguments],
        env=environment,
        cwd=root,
        capture_output=True,
        check=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def command_table(earlier: Path | None, words: list[str], runs: int) -> None:
    """Print a row for each command: now, earlier, ratio."""
    print("| command | now, s | earlier, s | earlier / now |\n|---|---|---|---|")
    for name, (script, arguments) in ROWS.items():
        if words and not any(word in name for word in words):
            continue
        now = statistics.median(cpu_seconds(ROOT, script, arguments) for _ in range(runs))
        beside = "– | –"
        if earlier is not None:
            then = statistics.median(cpu_seconds(earlier, script, arguments) for _ in range(runs))
            beside = f"{then:.2f} | {then / now:.1f}"
        print(f"| {name} | {now:.2f} | {beside} |", flush=True)


def stage_table() -> None:
    """Print the fraction of a measurement spent in each stage, with warm caches."""
    clip = SAMPLES / "clips" / "jokku_120.mp4"
    options = MeasureOptions(setup=load_setup(clip.with_suffix(".toml")))
    measure_clip(clip, options)
    profile = cProfile.Profile(time.process_time)
    profile.runcall(measure_clip, clip, options)
    spent: dict[str, float] = {}
    for (_, _, name), row in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        spent[name] = max(spent.get(name, 0.0), row[3])
    print("\n| stage | fraction of measuring |\n|---|---|")
    for stage, function in STAGES.items():
        print(f"| {stage} | {100.0 * spent.get(function, 0.0) / spent['measure_clip']:.0f} % |")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.speed", description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--against", metavar="COMMIT", help="commit timed for comparison")
    parser.add_argument("--rows", nargs="*", default=[], help="only rows that contain a word")
    options = parser.parse_args()
    if options.against is None:
        command_table(None, options.rows, options.runs)
    else:
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "earlier"
            git = ["git", "-C", str(ROOT), "worktree"]
            subprocess.run([*git, "add", "--detach", str(place), options.against], check=True)
            try:
                command_table(place, options.rows, options.runs)
            finally:
                subprocess.run([*git, "remove", "--force", str(place)], check=True)
    if not options.rows:
        stage_table()


if __name__ == "__main__":
    main()
