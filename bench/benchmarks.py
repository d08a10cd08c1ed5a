"""Run the benchmark scripts and write docs/benchmarks.md from what they print.

Run: python -m bench.benchmarks [--shared FOLDER] [--only NAME…] [--minutes M]

FOLDER (default ../shared) holds rendered/ and clips/. With --only, the other sections stay as they
are. A script that fails or outlasts its minutes keeps its earlier section, and is named.
"""

import argparse
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from metrology import write_text_whole

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "benchmarks.md"
HEAD = """# Benchmarks

Each section is what its script printed; the command stands above it, and `python -m
bench.benchmarks` runs them all and writes this page. The ray-traced clips come from a renderer and
a simulator that share nothing with this project; they are not part of the repository. Times and
rates are of the whole process on two cores that did other work besides, so only ratios within one
run are to be compared. Targets stand beside what was measured; those missed say so.
"""


@dataclass(frozen=True)
class Section:
    """A part of the page and the script that prints it; `{shared}` stands for the folder."""

    name: str
    title: str
    words: str
    arguments: tuple[str, ...]

    def command(self, shared: str) -> list[str]:
        return [part.replace("{shared}", shared) for part in self.arguments]


RENDERED = tuple(
    f"{{shared}}/rendered/{name}"
    for name in ("basketball_120_dim", "basketball_60_wide", "jokku_120", "jokku_90_small")
)
SECTIONS = (
    Section(
        "measure",
        "From a clip to numbers",
        "Clips measured unattended, with the distances a lab would tape (± 5 mm). ± is one "
        "standard uncertainty, z the error over it. The ball's centre is the projection of the "
        "sphere's centre through the estimated camera, error per axis. `energy_loss` is that of "
        "the pendulum, ½ I (ω₀² − ω₁²).",
        ("bench.measure", "{shared}/scenes", "{shared}/rendered"),
    ),
    Section(
        "following",
        "Following what nobody here filmed",
        "Share of frames near the truth, RMS, and how often two stated uncertainties hold it; real "
        "clips: frames within max(1 px, 1.5 × the truth's own uncertainty).",
        ("bench.scenes", "--following"),
    ),
    Section(
        "altered",
        "As another camera might have filmed it",
        "The smallest clip that ships, 208×116, altered in every way: each quantity beside that of "
        "the clip as it is, over both stated uncertainties together, and beside the truth.",
        ("bench.altered", "--only", "jokku_90_small"),
    ),
    Section(
        "tracking",
        "Following ball and pendulum",
        "Error of the ball's outline in flight and of the pendulum's mass near the contact; beside "
        "it the median Cramér–Rao bound. χ is error over stated uncertainty, 1 when honest. At "
        "least 0.10 px, aim 0.04 px at 432×240 and up in good light (`basketball_60_wide`, "
        "`jokku_120`). Real clips, marked by somebody else: `projectile` and `balltoss` within "
        "1 px; `pendulum_bag_wall` followed through all its swings, without a target in px.",
        ("bench.tracking", "--rendered", *RENDERED, "--clips", "{shared}/clips"),
    ),
    Section(
        "trackers",
        "Ball trackers side by side",
        "The same frames in the same run. The libraries are helped with the background, the true "
        "radius and the choice among candidates; ours is not, and follows the pendulum as well.",
        ("bench.trackers_side_by_side", *RENDERED),
    ),
    Section(
        "calibration",
        "Calibration",
        "Grid, lens and ball plane against their targets.",
        ("bench.calibration", "--shared", "{shared}"),
    ),
    Section(
        "calibration-scatter",
        "Calibration: predicted against actual scatter",
        "Positions on the ball plane at three places of a flight, over calibrations in which all "
        "that is uncertain is drawn anew. Ratio: at least within 0.85 to 1.15, aim 0.95 to 1.05.",
        ("bench.calibration_scatter",),
    ),
    Section(
        "planning",
        "Planning a recording",
        "What `vision calibrate plan` foresees against the errors of clips rendered and measured "
        "like that. z is the error over the predicted ±, 1 on the whole if the plan is true.",
        ("bench.planning",),
    ),
    Section(
        "campaign",
        "A campaign",
        "Laws drawn with strikes, sessions and shared inputs that scatter; a campaign killed at "
        "random moments; a scheduler whose workers only wait.",
        ("bench.campaign",),
    ),
    Section(
        "speed",
        "Speed",
        "Processor time of whole commands with start-up, medians of five, beside an earlier commit "
        "in the same run; at least 4 s (eight times less than before) for `measure` at 640×360, "
        "3 s at 432×240, 1.2 s for a clip measured before, 0.4 s for `--help`; following at 0.35 "
        "of the frame rate of decoding.",
        ("bench.speed", "--lens", "{shared}/clips/gopro_chessboard"),
    ),
    Section("physics", "Speed of the physics", "Whole process.", ("bench.physics_speed",)),
    Section("rendering", "Speed of rendering", "Target: 20 s at 432×240.", ("bench.render_speed",)),
)


def version() -> str:
    """The commit that is measured, and whether files differ from it."""
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude=*"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.strip() or "an unknown version"


def printed(arguments: list[str], minutes: float) -> str | None:
    """What a script prints; None if it fails or takes too long."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", *arguments],
            cwd=ROOT,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            text=True,
            timeout=60 * minutes,
            check=True,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as problem:
        print(f"{arguments[0]}: {problem}", file=sys.stderr)
        return None
    return done.stdout.strip()


def section_text(section: Section, shared: str, minutes: float) -> str | None:
    command = section.command(shared)
    output = printed(command, minutes)
    if output is None:
        return None
    body = output if "|---" in output else f"```\n{output}\n```"
    run = "python -m " + " ".join(command)
    head = f"## {section.title}\n\n{section.words}\n\n```sh\n{run}\n```"
    return f"{head}\n\nMeasured at {version()}.\n\n{body}\n"


def earlier() -> dict[str, str]:
    """Sections of the page as it stands, by title."""
    if not PAGE.exists():
        return {}
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return {part.splitlines()[0]: f"## {part.strip()}\n" for part in parts}


def main() -> None:
    """Run the scripts one after the other, rewriting the page after each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shared", default="../shared")
    parser.add_argument("--only", nargs="*", choices=[section.name for section in SECTIONS])
    parser.add_argument("--minutes", type=float, default=20.0)
    chosen = parser.parse_args()
    texts = earlier()
    for section in SECTIONS:
        if chosen.only is not None and section.name not in chosen.only:
            continue
        text = section_text(section, chosen.shared, chosen.minutes)
        if text is None:
            continue
        texts[section.title] = text
        ordered = [texts[one.title] for one in SECTIONS if one.title in texts]
        write_text_whole(PAGE, "\n".join([HEAD, *ordered]))


if __name__ == "__main__":
    main()
