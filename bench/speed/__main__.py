"""What measuring costs: each figure beside decoding alone and beside an earlier commit, in one run.

Run: python -m bench.speed [--fast] [--against COMMIT] [--lens FOLDER] [--rows ROW…]

COMMIT (default a1dcaa4) is checked out beside this one and run by the same interpreter on the same
machine, turn by turn with the present code. A figure is the median of five runs, of processor time
(user and system) of the whole command with start-up; --fast takes one run and leaves out the long
clips. FOLDER holds pictures of a chessboard.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sample_videos.render import write_clip
from sample_videos.scene import Encoding
from vision.clip.clip import Clip

ROOT = Path(__file__).parents[2]
CLIPS = ROOT / "sample_videos" / "clips"
EARLIER = "a1dcaa4"
RUNS = 5
VISION = "from pipelines.cli import app; app()"
FOLLOW = "from vision.clip.clip import Clip; from vision.following import follow; import sys; "
FOLLOW += "follow(Clip.open(sys.argv[1]), 600.0)"
DECODE = "from vision.clip.clip import Clip; import sys\n"
DECODE += "for _ in Clip.open(sys.argv[1]).frames(): pass"


@dataclass(frozen=True)
class Cost:
    """Of one process: processor time, s, and the most memory it held, MB."""

    cpu_s: float
    memory_mb: float


@dataclass(frozen=True)
class Row:
    """A command whose cost is told.

    Attributes
    ----------
    name : str
    script : str
        Python that does it.
    arguments : tuple of str
    before : tuple of str or None
        Arguments of the same script that are run first and do not count.
    earlier : bool
        Whether the earlier commit can do it, too.
    """

    name: str
    script: str
    arguments: tuple[str, ...]
    before: tuple[str, ...] | None = None
    earlier: bool = True


def cost(root: Path, script: str, arguments: Sequence[str], kept: str) -> Cost:
    """Run Python with the code under `root` and tell what it took."""
    environment = dict(os.environ, PYTHONPATH=str(root), IMPACT_VISION_CACHE=kept)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    inner = (
        "import resource, runpy, sys\n"
        f"try:\n exec({script!r})\n"
        "except SystemExit as end:\n"
        " assert end.code in (0, None, 2), end.code\n"
        "finally:\n"
        " sys.stderr.write(f'PEAK {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}')"
    )
    done = subprocess.run(
        [sys.executable, "-c", inner, *arguments],
        env=environment,
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{arguments} failed: {done.stderr[-400:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(used, float(done.stderr.rpartition("PEAK ")[2]) / 1024.0)


def rows(lens: Path | None) -> list[Row]:
    """The commands a lab gives."""

    def measured(name: str, command: str = "measure") -> tuple[str, ...]:
        clip = CLIPS / f"{name}.mp4"
        return (command, str(clip), "--setup", str(clip.with_suffix(".toml")), "--quiet")

    campaign = ROOT / "sample_videos" / "campaign"
    explained = (
        *("explain", str(campaign / "ball.csv"), "--pendulum", str(campaign / "pendulum.csv")),
        *("--setup", str(campaign / "setup.toml"), "--quiet"),
    )
    found = [
        Row("measure, 640×360", VISION, measured("jokku_120")),
        Row("measure, 432×240", VISION, measured("basketball_60")),
        Row("the same clip again", VISION, measured("jokku_120"), measured("jokku_120")),
        Row("cor after measure", VISION, measured("jokku_120", "cor"), measured("jokku_120")),
        Row("vision --help", VISION, ("--help",)),
        Row("a mistyped command", VISION, ("mesure",)),
        Row("explain, shipped campaign", VISION, explained),
    ]
    if lens is not None:
        pictures = sorted(str(p) for p in lens.iterdir() if p.suffix.lower() in (".jpg", ".png"))
        told = ("calibrate", "lens", *pictures, "--out", os.devnull)
        found.append(Row(f"calibrate lens, {len(pictures)} pictures", VISION, told))
    return found


def median_cost(root: Path, row: Row, runs: int) -> Cost:
    """Median over runs, each with nothing kept but what the row's own first command left."""
    costs = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as kept:
            if row.before is not None:
                cost(root, row.script, row.before, kept)
            costs.append(cost(root, row.script, row.arguments, kept))
    return Cost(
        statistics.median(one.cpu_s for one in costs),
        statistics.median(one.memory_mb for one in costs),
    )


def lengthened(clip: Path, frames: int, to: Path) -> Path:
    """The clip with its first pictures, to and fro, before it: still, then one strike."""
    pictures: list[NDArray[np.uint8]] = [one.gray for one in Clip.open(clip).frames()]
    still = pictures[:20]

    def every() -> Iterator[NDArray[np.uint8]]:
        for index in range(max(frames - len(pictures), 0)):
            place = index % (2 * len(still) - 2)
            gray = still[min(place, 2 * len(still) - 2 - place)]
            yield np.repeat(gray[:, :, np.newaxis], 3, axis=2)
        for gray in pictures:
            yield np.repeat(gray[:, :, np.newaxis], 3, axis=2)

    write_clip(every(), to, Encoding("h264"))
    return to


def length_table(lengths: Sequence[int], runs: int) -> Iterator[str]:
    """How following grows with the length of a clip, over decoding alone."""
    yield "| frames | decoding, s | following, s | decoding over following | most memory, MB |"
    yield "|---|---|---|---|---|"
    bare = median_cost(ROOT, Row("", "import vision.following", ()), runs)
    with tempfile.TemporaryDirectory() as folder:
        for frames in lengths:
            clip = lengthened(CLIPS / "jokku_120.mp4", frames, Path(folder) / f"{frames}.mp4")
            decoding = median_cost(ROOT, Row("", DECODE, (str(clip),)), runs)
            following = median_cost(ROOT, Row("", FOLLOW, (str(clip),)), runs)
            read, took = (max(one.cpu_s - bare.cpu_s, 1e-3) for one in (decoding, following))
            yield (
                f"| {frames} | {read:.2f} | {took:.2f} | {read / took:.2f} |"
                f" {following.memory_mb:.0f} |"
            )


def table(earlier: Path | None, commit: str, wanted: Sequence[Row], runs: int) -> Iterator[str]:
    """The commands' costs beside those of the earlier commit and of decoding the clip."""
    clip = str(CLIPS / "jokku_120.mp4")
    bare = median_cost(ROOT, Row("", "import vision.clip.clip", ()), runs)
    read = median_cost(ROOT, Row("", DECODE, (clip,)), runs).cpu_s - bare.cpu_s
    yield f"Decoding the 640×360 clip alone takes {read:.2f} s of processor time.\n"
    yield f"| command | now, s | {commit}, s | ratio | over decoding |"
    yield "|---|---|---|---|---|"
    for row in wanted:
        now = median_cost(ROOT, row, runs).cpu_s
        then = None if earlier is None or not row.earlier else median_cost(earlier, row, runs).cpu_s
        beside = "– | –" if then is None else f"{then:.2f} | {then / now:.1f}"
        yield f"| {row.name} | {now:.2f} | {beside} | {now / max(read, 1e-3):.1f} |"


def with_earlier(commit: str, act: Callable[[Path], None]) -> None:
    """Check out a commit beside this one while something is done with it."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "earlier"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--detach", str(place), commit], check=True)
        try:
            act(place)
        finally:
            subprocess.run([*git, "remove", "--force", str(place)], check=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--against", default=EARLIER)
    parser.add_argument("--lens", type=Path)
    parser.add_argument("--rows", nargs="*", help="Only rows with one of these words.")
    said = parser.parse_args()
    runs = 1 if said.fast else RUNS
    wanted = [
        row
        for row in rows(said.lens)
        if not said.rows or any(word in row.name for word in said.rows)
    ]

    def act(place: Path) -> None:
        for line in table(place, said.against, wanted, runs):
            print(line, flush=True)

    with_earlier(said.against, act)
    if not said.rows:
        print()
        for line in length_table((300, 3000) if said.fast else (300, 3000, 30_000), runs):
            print(line, flush=True)


if __name__ == "__main__":
    main()
