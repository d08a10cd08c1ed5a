"""Run the benchmark scripts and write docs/benchmarks.md from what they print.

Run: python -m bench.benchmarks [--shared FOLDER] [--only NAME…] [--minutes M]

With --only, the other sections stay as they are. A script that fails or exceeds its minutes keeps
its earlier section and is reported on stderr.
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

Each section is the output of the command above it; `python -m bench.benchmarks` runs all of them
and writes this page. The ray-traced clips come from a renderer and a simulator that share no code
with this project; they are not part of the repository.
"""


@dataclass(frozen=True)
class Section:
    """One section of the page; `{shared}` in the arguments is the folder of shared data."""

    title: str
    text: str
    arguments: tuple[str, ...]


SECTIONS = {
    "measure": Section(
        "From a clip to numbers",
        "Clips measured unattended, with the distances a laboratory would measure by hand"
        " (± 5 mm). ± is one standard uncertainty, z the error divided by it. The ball's centre is"
        " the projection of the sphere's centre through the estimated camera, error per axis."
        " `energy_loss` is that of the pendulum, ½ I (ω₀² − ω₁²).",
        ("bench.measure", "{shared}/scenes", "{shared}/rendered"),
    ),
    "following": Section(
        "Following on scenes and real clips",
        "Fraction of frames near the truth, RMS error, and how often two stated uncertainties"
        " cover it; real clips: frames within max(1 px, 1.5 × the truth's own uncertainty).",
        ("bench.scenes",),
    ),
    "altered": Section(
        "Altered copies of a clip",
        "The smallest shipped clip, 208×116, altered in every way: each quantity compared with"
        " that of the unaltered clip, in combined standard uncertainties, and with the truth.",
        ("bench.altered", "--only", "jokku_90_small"),
    ),
    "calibration-scatter": Section(
        "Calibration: predicted and actual standard deviation",
        "Positions on the ball plane at three points of a flight, over calibrations in which every"
        " uncertain input is drawn anew. Ratio: required 0.85 to 1.15, goal 0.95 to 1.05.",
        ("bench.calibration_scatter",),
    ),
    "planning": Section(
        "Planning a recording",
        "Uncertainties predicted by `vision calibrate plan` and errors of clips rendered and"
        " measured under the same conditions. z is the error over the predicted uncertainty.",
        ("bench.planning",),
    ),
    "speed": Section("Speed", "Processor time of whole commands.", ("bench.speed",)),
}


def section_text(section: Section, shared: str, minutes: float) -> str | None:
    """Heading, command and output of a script; None if it fails or takes too long."""
    command = [part.replace("{shared}", shared) for part in section.arguments]
    try:
        done = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=ROOT,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            text=True,
            timeout=60 * minutes,
            check=True,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as problem:
        print(f"{command[0]}: {problem}", file=sys.stderr)
        return None
    version = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude=*"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    ).stdout.strip()  # fmt: skip
    run = "python -m " + " ".join(command)
    head = f"## {section.title}\n\n{section.text}\n\n```sh\n{run}\n```"
    return f"{head}\n\nMeasured at {version or 'an unknown version'}.\n\n{done.stdout.strip()}\n"


def main() -> None:
    """Run the scripts one after the other and rewrite the page after each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--shared", default="../shared")
    parser.add_argument("--only", nargs="*", choices=[*SECTIONS], default=[*SECTIONS])
    parser.add_argument("--minutes", type=float, default=20.0)
    options = parser.parse_args()
    text = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
    texts = {part.splitlines()[0]: f"## {part.strip()}\n" for part in text.split("\n## ")[1:]}
    for name in options.only:
        new = section_text(SECTIONS[name], options.shared, options.minutes)
        if new is not None:
            texts[SECTIONS[name].title] = new
            kept = [texts[one.title] for one in SECTIONS.values() if one.title in texts]
            write_text_whole(PAGE, "\n".join([HEAD, *kept]))


if __name__ == "__main__":
    main()
