"""What measuring costs: each figure beside decoding alone and beside an earlier commit, in one run.

Run: python -m bench.speed [--fast] [--against COMMIT] [--lens FOLDER] [--rows ROW…] [--kept FILE]

COMMIT (default a1dcaa4) is checked out beside this one and run by the same interpreter on the same
machine, both with their modules compiled to bytecode as an installer leaves them. A figure is the
median of five runs, of processor time (user and system) of the whole command with start-up, and of
the time until it is done; one run is taken of the earlier commit, of single commands, of a first
use, of campaigns and of the longest clips. --fast takes one run of everything and leaves out the
long clips. FOLDER holds pictures of a chessboard; by default it is looked for among the shared
recordings. What was timed is kept in FILE, under the commit that it belongs to: a run that was
stopped goes on where it was, and a row that fails says so and leaves the others alone.
"""

import argparse
import hashlib
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from sample_videos.render import write_clip
from sample_videos.scene import Encoding
from vision.clip.clip import ClipReader

ROOT = Path(__file__).parents[2]
CLIPS = ROOT / "sample_videos" / "clips"
EARLIER = "a1dcaa4"
RUNS = 5
LENGTHS = (300, 3000, 36_000)
CAMPAIGNS = (1, 2, 4, 8)
"""Clips."""
LONG = 20_000
"""Frames: of clips this long one run is taken."""
SEGMENT = 600
GRAIN = 0.5
"""Gray levels: what a bright, well lit picture has; coarser grain, coded, counts as motion."""
SINGLE = ("contact-time", "launch", "landing", "cor")
VISION = "from pipelines.cli import app; app()"
FOLLOW = "from vision.clip.clip import ClipReader; from vision.following import follow; "
FOLLOW += "import sys; follow(ClipReader.open(sys.argv[1]), 600.0)"
DECODE = "from vision.clip.clip import ClipReader; import sys\n"
DECODE += "for _ in ClipReader.open(sys.argv[1]).frames(): pass"
SPENT = "SPENT "
KEPT = Path(tempfile.gettempdir()) / "impact-vision-speed.json"
# a file: old commits replace a device that they are told to write to
LENS_FILE = str(Path(tempfile.gettempdir()) / "impact-vision-speed-lens.toml")
LOOKS = (("decoding", DECODE), ("following", FOLLOW))


@dataclass(frozen=True)
class Cost:
    """Of one process with those it starts: processor time, s, most memory, MB, and time passed, s.

    What the machine does beside it is in the last one.
    """

    cpu_s: float
    memory_mb: float
    passed_s: float = math.nan


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
    fresh : bool
        Whether loops are compiled anew, as at the first use after an install.
    targets : str
        What it must reach and what is aimed at, s, as cells of the table.
    once : bool
        Whether one run of it is enough.
    """

    name: str
    script: str
    arguments: tuple[str, ...]
    before: tuple[str, ...] | None = None
    earlier: bool = True
    fresh: bool = False
    targets: str = " | "
    once: bool = False


def cost(
    root: Path, script: str, arguments: Sequence[str], kept: str, *, fresh: bool = False
) -> Cost:
    """Run Python with the code under `root` and tell what it took."""
    environment = dict(os.environ, PYTHONPATH=str(root), IMPACT_VISION_CACHE=kept)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if fresh:
        environment["NUMBA_CACHE_DIR"] = kept
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    inner = (
        "import resource, runpy, sys\n"
        f"try:\n exec({script!r})\n"
        "except SystemExit as end:\n"
        " assert end.code in (0, None, 2), end.code\n"
        "finally:\n"
        " sys.stderr.write(f'PEAK {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}')"
    )
    # a script that times itself says what it spent; else it is the whole process

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
    after, passed = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begun
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if SPENT in done.stdout:
        used = float(done.stdout.rpartition(SPENT)[2])
    return Cost(used, float(done.stderr.rpartition("PEAK ")[2]) / 1024.0, passed)


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
        Row("measure, 640×360", VISION, measured("jokku_120"), targets="4 | 2"),
        Row("measure, 432×240", VISION, measured("basketball_60"), targets="3 | 1.5"),
        Row(
            "the same clip again",
            VISION,
            measured("jokku_120"),
            measured("jokku_120"),
            earlier=False,
            targets="1.2 | 0.8",
        ),
        Row(
            "cor after measure",
            VISION,
            measured("jokku_120", "cor"),
            measured("jokku_120"),
            earlier=False,
            targets="1.2 | 0.8",
        ),
        *(
            Row(f"{one} alone, 640×360", VISION, measured("jokku_120", one), once=True)
            for one in SINGLE
        ),
        Row(
            "cor after contact-time",
            VISION,
            measured("jokku_120", "cor"),
            measured("jokku_120", "contact-time"),
            earlier=False,
        ),
        Row("vision --help", VISION, ("--help",), targets="0.4 | 0.25"),
        Row("a mistyped command", VISION, ("mesure",), targets="0.4 | 0.25"),
        Row("explain, shipped campaign", VISION, explained, targets="5 | 3"),
        Row(
            "measure, first use after an install",
            VISION,
            measured("jokku_120"),
            earlier=False,
            fresh=True,
            once=True,
            targets="10 more | ",
        ),
        Row(
            "the wizard answers a change, the slowest",
            "from bench.speed.wizard import main; main()",
            (),
            earlier=False,
            targets="1 | ",
        ),
    ]
    if lens is not None:
        pictures = sorted(str(p) for p in lens.iterdir() if p.suffix.lower() in (".jpg", ".png"))
        told = ("calibrate", "lens", *pictures, "--out", LENS_FILE)
        name = f"calibrate lens, {len(pictures)} pictures"
        found.append(Row(name, VISION, told, targets="15 | 6"))
    return found


@dataclass(frozen=True)
class Timed:
    """What was timed of commands so far, kept in a file.

    Attributes
    ----------
    file : Path or None
        None keeps nothing.
    """

    file: Path | None

    def costs(self, root: Path, row: Row, runs: int) -> list[Cost]:
        """So many runs of a row with the code under `root`, each with only what went before it."""
        key = f"{commit_of(root)} {row.name} {' '.join(row.arguments[:1])}"
        every = (
            {}
            if self.file is None or not self.file.exists()
            else json.loads(self.file.read_text(encoding="utf-8"))
        )
        done = [Cost(*one) for one in every.get(key, [])][:runs]
        if len(done) == runs:
            return done
        sys.stderr.write(f"{row.name}\n")
        with tempfile.TemporaryDirectory() as prepared:
            if row.before is not None:
                cost(root, row.script, row.before, prepared)
            while len(done) < runs:
                with tempfile.TemporaryDirectory() as empty:
                    kept = empty if row.before is None else prepared
                    done.append(cost(root, row.script, row.arguments, kept, fresh=row.fresh))
                every[key] = [astuple(one) for one in done]
                if self.file is not None:
                    self.file.write_text(json.dumps(every, indent=1), encoding="utf-8")
        return done

    def median(self, root: Path, row: Row, runs: int) -> Cost:
        """Medians over the runs."""
        costs = self.costs(root, row, runs)
        columns = zip(*(astuple(one) for one in costs), strict=True)
        return Cost(*(statistics.median(column) for column in columns))


def commit_of(root: Path) -> str:
    """The commit checked out there, and a digest of what differs from it."""
    git = ["git", "-C", str(root)]
    head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, check=True)
    changed = subprocess.run([*git, "diff", "HEAD"], capture_output=True, check=True).stdout
    return head.stdout.decode().strip() + (
        f"+{hashlib.sha256(changed).hexdigest()[:8]}" if changed else ""
    )


def lengthened(clip: Path, frames: int, to: Path) -> Path:
    """The clip with its first picture before it, grainy as a camera's: still, then one strike.

    The still part is encoded once and its packets are repeated.
    """
    pictures: list[NDArray[np.uint8]] = [one.gray for one in ClipReader.open(clip).frames()]
    grain = np.random.default_rng(1).normal(0.0, GRAIN, (40, *pictures[0].shape))
    still = [np.clip(pictures[0] + one, 0, 255).astype(np.uint8) for one in grain]
    spare = max(frames - len(pictures), 0)

    def colour(grays: list[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
        for gray in grays:
            yield np.repeat(gray[:, :, np.newaxis], 3, axis=2)

    with tempfile.TemporaryDirectory() as folder:
        parts = []
        for name, count, source in (
            ("whole", min(SEGMENT, spare), still),
            ("rest", spare % SEGMENT if spare > SEGMENT else 0, still),
            ("strike", len(pictures), pictures),
        ):
            path = Path(folder) / f"{name}.mp4"
            if count:
                grays = [source[k % len(source)] for k in range(count)]
                write_clip(colour(grays), path, Encoding("h264", rate_factor=20.0))
                parts += [(path, count)] * (
                    spare // SEGMENT if name == "whole" and spare > SEGMENT else 1
                )
        joined(parts, to)
    return to


def joined(parts: Sequence[tuple[Path, int]], to: Path) -> None:
    """Clips of one encoder one after the other, packet by packet."""
    with av.open(str(to), "w") as container:
        stream, gone = None, 0
        for path, count in parts:
            with av.open(str(path)) as source:
                video = source.streams.video[0]
                stream = stream or container.add_stream_from_template(video)
                assert video.time_base is not None
                assert video.average_rate is not None
                frame = round(1 / (video.average_rate * video.time_base))
                for packet in source.demux(video):
                    if packet.dts is not None and packet.pts is not None:
                        packet.dts += gone * frame
                        packet.pts += gone * frame
                        packet.stream = stream
                        container.mux(packet)
            gone += count


def length_table(timed: Timed, lengths: Sequence[int]) -> Iterator[str]:
    """How following grows with the length of a clip, over decoding alone."""
    yield (
        "| frames | decoding, s | following, s | following over decoding |"
        " frames/s over those of decoding | most memory, MB | waited for following, s |"
    )
    yield "|---|---|---|---|---|---|---|"
    bare = timed.median(ROOT, Row("nothing", "import vision.following", ()), RUNS)
    with tempfile.TemporaryDirectory() as folder:
        for frames in lengths:
            runs = 1 if frames >= LONG else 3
            clip = Path(folder) / f"{frames}.mp4"
            rows = [Row(f"{name} {frames}", script, (str(clip),)) for name, script in LOOKS]
            lengthened(CLIPS / "jokku_120.mp4", frames, clip)
            read, follow = (timed.median(ROOT, row, runs) for row in rows)
            decoding, following = (max(one.cpu_s - bare.cpu_s, 1e-3) for one in (read, follow))
            yield (
                f"| {frames} | {decoding:.2f} | {following:.2f} | {following / decoding:.1f} |"
                f" {decoding / following:.2f} | {follow.memory_mb:.0f} |"
                f" {follow.passed_s - bare.passed_s:.2f} |"
            )


def clip_table(timed: Timed, counts: Sequence[int]) -> Iterator[str]:
    """How a campaign grows with its clips: what each one more costs, and what it lets wait."""
    yield "| clips | processor time, s | of it each clip more, s | waited, s | each clip more, s |"
    yield "|---|---|---|---|---|"
    clip = CLIPS / "jokku_120.mp4"
    one: Cost | None = None
    with tempfile.TemporaryDirectory() as folder:
        for count in counts:
            campaign = Path(folder) / f"{count}"
            campaign.mkdir()
            for number in range(count):
                # empty boxes at the end make each file another clip
                copy = clip.read_bytes() + (number + 1) * b"\0\0\0\x08free"
                (campaign / f"{number}.mp4").write_bytes(copy)
            out = str(campaign / "out")
            setup = ("--setup", str(clip.with_suffix(".toml")))
            arguments = ("campaign", str(campaign), *setup, "--out", out, "--quiet")
            cost = timed.median(ROOT, Row(f"{count} clips", VISION, arguments), 1)
            one = one or cost
            more = max(count - counts[0], 1)
            each = (cost.cpu_s - one.cpu_s) / more, (cost.passed_s - one.passed_s) / more
            told = ("–", "–") if count == counts[0] else tuple(f"{s:.2f}" for s in each)
            yield f"| {count} | {cost.cpu_s:.2f} | {told[0]} | {cost.passed_s:.2f} | {told[1]} |"


def table(
    timed: Timed, earlier: Path, commit: str, wanted: Sequence[Row], runs: tuple[int, int]
) -> Iterator[str]:
    """The commands' costs beside those of the earlier commit and of decoding the clip."""
    clip = str(CLIPS / "jokku_120.mp4")
    bare = timed.median(ROOT, Row("clip alone", "import vision.clip.clip", ()), runs[0])
    read = timed.median(ROOT, Row("decoding", DECODE, (clip,)), runs[0]).cpu_s - bare.cpu_s
    yield f"Decoding the 640×360 clip alone takes {read:.2f} s of processor time.\n"
    yield f"| command | at least | aim | now, s | {commit}, s | ratio | over decoding | waited, s |"
    yield "|---|---|---|---|---|---|---|---|"
    for row in wanted:
        beside = "– | –"
        try:
            cost = timed.median(ROOT, row, 1 if row.once else runs[0])
            now = cost.cpu_s
            if row.earlier:
                then = timed.median(earlier, row, runs[1]).cpu_s
                beside = f"{then:.2f} | {then / now:.1f}"
        except RuntimeError as problem:
            sys.stderr.write(f"{problem}\n")
            yield f"| {row.name} | {row.targets} | failed | – | – | – | – |"
            continue
        yield (
            f"| {row.name} | {row.targets} | {now:.2f} | {beside} |"
            f" {now / max(read, 1e-3):.1f} | {cost.passed_s:.2f} |"
        )


def with_earlier(commit: str, act: Callable[[Path], None]) -> None:
    """Check out a commit beside this one while something is done with it."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "earlier"
        git = ["git", "-C", str(ROOT), "worktree"]
        # of runs that were stopped
        subprocess.run([*git, "prune"], check=True)
        subprocess.run([*git, "add", "--detach", str(place), commit], check=True)
        try:
            act(place)
        finally:
            subprocess.run([*git, "remove", "--force", str(place)], check=True)


def as_installed(root: Path) -> None:
    """Compile the modules to what Python reads, as an installer does."""
    packages = [str(path.parent) for path in root.glob("*/__init__.py")]
    subprocess.run([sys.executable, "-m", "compileall", "-q", *packages], check=True)


def boards() -> Path | None:
    """Pictures of a chessboard among the shared recordings, where there are any."""
    shared = os.environ.get("IMPACT_VISION_SHARED")
    folder = None if shared is None else Path(shared) / "clips" / "gopro_chessboard"
    return folder if folder is not None and folder.is_dir() else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--against", default=EARLIER)
    parser.add_argument("--earlier-runs", type=int, default=1)
    parser.add_argument("--lens", type=Path, default=boards())
    parser.add_argument("--rows", nargs="*", help="Only rows with one of these words.")
    parser.add_argument("--lengths", nargs="*", type=int, default=LENGTHS)
    parser.add_argument("--campaigns", nargs="*", type=int, default=CAMPAIGNS)
    parser.add_argument("--kept", type=Path, default=KEPT, help="Where to keep what was timed.")
    said = parser.parse_args()
    timed = Timed(said.kept)
    runs = (1 if said.fast else RUNS, said.earlier_runs)
    wanted = [
        row
        for row in rows(said.lens)
        if not said.rows or any(word in row.name for word in said.rows)
    ]

    def act(place: Path) -> None:
        as_installed(place)
        for line in table(timed, place, said.against, wanted, runs):
            print(line, flush=True)

    as_installed(ROOT)
    # what is compiled at a first use is compiled before anything is timed
    cost(ROOT, VISION, rows(None)[0].arguments, "off")
    with_earlier(said.against, act)
    if said.campaigns and not said.rows:
        print("\nCampaigns of so many clips, 640×360, on all cores:\n")
        for line in clip_table(timed, said.campaigns[: 2 if said.fast else None]):
            print(line, flush=True)
    if not said.rows and said.lengths:
        print(
            "\nAsked of 3,000 frames: 0.35 of the frames/s of decoding; of 36,000: 2 × decoding.\n"
        )
        for line in length_table(timed, LENGTHS[:2] if said.fast else said.lengths):
            print(line, flush=True)


if __name__ == "__main__":
    main()
