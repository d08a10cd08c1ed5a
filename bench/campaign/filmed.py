"""A campaign as a lab would run it: 40 rendered clips of two balls, killed twice on the way.

``python -m bench.campaign.filmed FOLDER [--jobs N]`` renders what FOLDER does not hold yet, runs
``vision campaign --explain`` on it as a user would, ends it twice with signal 9, goes on, and holds
the laws that come out against the laws that the clips were rendered with. ``--scaling`` measures 20
of the clips with one process and with two; ``--report`` builds the report of 160 clips from the
outcomes of the 40.
"""

import argparse
import csv
import functools
import json
import math
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit

from pipelines.campaign.conduct import Edition, publish
from pipelines.campaign.ledger import AttemptOutcome, Ledger
from pipelines.campaign.report import ReportFacts
from pipelines.campaign.results import match_clips, read_lab_book
from pipelines.render import RenderOptions, planned_scene
from pipelines.setup.file import load_setup
from sample_videos import render_clip

BACKSWINGS_DEG = (30.0, 42.0, 54.0, 66.0, 78.0, 92.0, 106.0, 120.0)
REPEATS = {"jokku": (3, 2, 3, 2, 3, 2, 3, 2), "basketball": (2, 3, 2, 3, 2, 3, 2, 3)}
"""Strikes at each back-swing: 20 of each ball."""
SIZE = (256, 144)
"""px: small, so that forty clips are rendered in minutes; the grid of 50 mm is found in each."""
SCATTER_COR = 0.004
SETUP = """# what the lab wrote down
[camera]
capture_fps = 600
shutter = "0.001 s"

[wall]
grid = "50 mm"
fine_grid = "10 mm"
ball_plane_offset = "0.450 m ± 0.005 m"

[balls.jokku]
preset = "jokku"

[balls.basketball]
preset = "basketball"

[pendulum]
length = "0.5541 m"
inertia = "1.579 kg m^2"
mass = "6.0 kg"
com = "0.4553 m"
effective_mass = "5.1667 kg"

[support]
height = "0.3120 m"
"""


@dataclass(frozen=True)
class Laboratory:
    """Clips, lab book and setup of a rendered campaign, and the laws behind it."""

    folder: Path

    @property
    def clips(self) -> Path:
        return self.folder / "clips"

    @property
    def book(self) -> Path:
        return self.folder / "trials.csv"

    @property
    def setup(self) -> Path:
        return self.folder / "lab.toml"

    def truth(self, name: str) -> dict:
        return json.loads((self.clips / f"{name}.truth.json").read_text())


@dataclass(frozen=True)
class Strike:
    """One clip to render: where its pendulum starts, and how far this strike is off the law."""

    name: str
    ball: str
    backswing_deg: float
    offset: float
    seed: int


def film(lab: Laboratory, jobs: int, seed: int = 5) -> None:
    """Render what is not there yet, and write what a lab would write down."""
    lab.clips.mkdir(parents=True, exist_ok=True)
    lab.setup.write_text(SETUP, encoding="utf-8")
    rng = np.random.default_rng(seed)
    rows, strikes = [], []
    for ball, repeats in REPEATS.items():
        for written, count in zip(BACKSWINGS_DEG, repeats, strict=True):
            for repeat in range(count):
                number, name = len(rows), f"{ball}_{written:03.0f}_{repeat + 1}"
                swing = written + rng.normal(0.0, 0.3)
                strikes.append(Strike(name, ball, swing, rng.normal(0.0, SCATTER_COR), number))
                rows.append(
                    {
                        "clip": name,
                        "ball": ball,
                        "backswing_deg": written,
                        "session": "AB"[repeat % 2],
                        "operator": "BM"[number % 2],
                    }
                )
    missing = [one for one in strikes if not (lab.clips / f"{one.name}.truth.json").exists()]
    with ProcessPoolExecutor(jobs) as pool:
        for name in pool.map(functools.partial(_rendered, lab), missing):
            print(name, file=sys.stderr, flush=True)
    for row in rows:
        tape = _value(lab.truth(str(row["clip"]))["quantities"].get("landing_distance"))
        row["landing_tape_m"] = "" if tape is None else f"{tape + rng.normal(0.0, 0.01):.3f}"
    with lab.book.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]])
        writer.writeheader()
        writer.writerows(rows)


def _rendered(lab: Laboratory, strike: Strike) -> str:
    setup = load_setup(lab.setup)
    law = _scattered(setup.balls[strike.ball].cor, strike.offset)
    options = RenderOptions(
        backswing=math.radians(strike.backswing_deg),
        ball=strike.ball,
        size=SIZE,
        seed=1000 + strike.seed,
    )
    scene, shot = planned_scene(setup.having({f"balls.{strike.ball}.cor": law}), options)
    render_clip(scene, shot, lab.clips / f"{strike.name}.mp4")
    return strike.name


def _scattered(law, offset: float) -> str:
    from physics.restitution import law_as_text

    return f"{law_as_text(law)} + {offset:.6f}".replace("+ -", "- ")


def _value(item) -> float | None:
    value = item.get("value") if isinstance(item, dict) else item
    return None if value is None else float(value)


def command(clips: list[Path], lab: Laboratory, out: Path, jobs: int, *more: str) -> list[str]:
    run = "from pipelines.cli import app; app()"
    given = ["campaign", *map(str, clips), "--trials", str(lab.book), "--setup", str(lab.setup)]
    return [sys.executable, "-c", run, *given, "--out", str(out), "-j", str(jobs), *more]


def _done(out: Path) -> int:
    try:
        with sqlite3.connect(f"file:{out / 'ledger.sqlite'}?mode=ro", uri=True) as held:
            return int(held.execute("select count(*) from clips where state='done'").fetchone()[0])
    except sqlite3.Error:
        return 0


def run_killed(lab: Laboratory, out: Path, jobs: int, kill_at: tuple[int, ...]) -> float:
    """Run to the end, ended by signal 9 once so many clips are done; wall time of all runs, s."""
    began = time.monotonic()
    asked = command([lab.clips], lab, out, jobs, "--paper", "--explain")
    for least in kill_at:
        started = subprocess.Popen(asked, stderr=subprocess.DEVNULL)
        while _done(out) < least and started.poll() is None:
            time.sleep(0.3)
        started.send_signal(signal.SIGKILL)
        started.wait()
        print(f"killed with {_done(out)} clips done", file=sys.stderr, flush=True)
    ended = subprocess.run(asked, check=False)
    print(f"exit code {ended.returncode}", file=sys.stderr, flush=True)
    return time.monotonic() - began


def scaling(lab: Laboratory, clips: int = 20) -> list[str]:
    """Wall time of one process over that of two, on clips that neither has seen."""
    chosen = sorted(lab.clips.glob("*.mp4"))[::2][:clips]
    took = {}
    for jobs in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            began = time.monotonic()
            subprocess.run(
                command(chosen, lab, Path(folder), jobs, "--quiet"),
                stderr=subprocess.DEVNULL,
                env={**os.environ, "IMPACT_VISION_CACHE": "off"},
                check=False,
            )
            done, took[jobs] = _done(Path(folder)), time.monotonic() - began
        print(f"{jobs} processes: {done} clips in {took[jobs]:.0f} s", file=sys.stderr, flush=True)
    return [
        f"| two cores against one, {len(chosen)} clips:"
        f" {took[1]:.0f} s and {took[2]:.0f} s | 1.7 × |"
        f" {took[1] / took[2]:.2f} × |"
    ]


_COPIES = 4
"""40 clips measured stand for 160."""


def report_of_many(lab: Laboratory, out: Path, copies: int = _COPIES) -> list[str]:
    """The report of a campaign `copies` times as large: its outcomes again, moved within their std.

    The page is opened in a browser, which must draw all its pictures and ask nobody for anything.
    """
    rng = np.random.default_rng(160)
    rows = list(csv.DictReader(lab.book.open(encoding="utf-8")))
    with tempfile.TemporaryDirectory() as folder:
        many = Path(folder) / "campaign"
        (many / "frames").mkdir(parents=True)
        book = Path(folder) / "trials.csv"
        with book.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, [*rows[0]])
            writer.writeheader()
            writer.writerows(
                {**row, "clip": f"{row['clip']}_{copy}"} for copy in range(copies) for row in rows
            )
        names = []
        with Ledger(out) as measured, Ledger(many) as ledger:
            for entry in measured.entries():
                for copy in range(copies):
                    name = f"{Path(entry.order.clip).stem}_{copy}.mp4"
                    names.append(name)
                    ledger.plan([replace(entry.order, clip=name)], retry_failed=False)
                    text = None if entry.document is None else _moved(entry.document, rng)
                    done = AttemptOutcome(
                        name, entry.state, entry.seconds or 0.0, text, entry.error
                    )
                    ledger.finish([done])
                    picture = out / "frames" / f"{entry.order.clip}.jpg"
                    if picture.exists():
                        os.link(picture, many / "frames" / f"{name}.jpg")
            found = read_lab_book(book)
            matched = match_clips(found, [Path(name) for name in names])
            strikes = {clip.name: strike for clip, strike in matched.strikes.items()}
            facts = ReportFacts("Campaign of 160", "1", lab.setup.name)
            setup = load_setup(lab.setup)
            publish(Edition(many, found, strikes, setup, None, facts, against_paper=True), ledger)
        page = many / "report.html"
        said = _in_browser(page)
        size = page.stat().st_size / 1e6
    return [f"| report of {len(names)} clips: size; in a browser | 20 MB | {size:.1f} MB; {said} |"]


def _moved(document, rng) -> str:
    """A clip's document whose values lie elsewhere within a third of their uncertainties."""
    moved = json.loads(json.dumps(document))
    for item in moved["quantities"].values():
        if item.get("value") is not None:
            item["value"] += 0.3 * item["std"] * rng.standard_normal()
    return json.dumps(moved)


def _in_browser(page: Path) -> str:
    """What a browser makes of the page: headings, pictures drawn, requests to others, errors."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return "not opened: playwright is not installed"
    asked, errors = [], []
    with sync_playwright() as play:
        found = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1200, "height": 900})
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("pageerror", lambda error: errors.append(str(error)))
        began = time.monotonic()
        tab.goto(page.as_uri())
        took = time.monotonic() - began
        drawn = tab.evaluate("[...document.images].filter(i => i.naturalWidth > 0).length")
        pictures = tab.evaluate("document.images.length")
        picture = os.environ.get("CAMPAIGN_PICTURE")
        if picture:
            tab.screenshot(path=picture, full_page=True)
        browser.close()
    others = sum(not url.startswith(("file:", "data:")) for url in asked)
    return (
        f"{took:.1f} s, {drawn} of {pictures} pictures drawn, {others} requests elsewhere,"
        f" {len(errors)} errors"
    )


def true_law(lab: Laboratory, ball: str):
    """The law that the clips show, from their truth: least squares through all strikes.

    The renderer's contact has friction and a slant, so that the restitution along the normal
    (Eq. 2) is not the number of the setup's law.
    """
    points = []
    for path in sorted(lab.clips.glob(f"{ball}_*.truth.json")):
        found = json.loads(path.read_text())["quantities"]
        points.append((_value(found["pendulum_speed_before"]), _value(found["cor_speeds"])))
    speed, cor = np.array(points).T

    def curve(v, a, b, d):
        return a * np.exp(-b * v) + d

    best = curve_fit(curve, speed, cor, p0=(0.1, 0.3, float(cor.min())), maxfev=20000)[0]
    return lambda v: float(curve(v, *best))


def judged(lab: Laboratory, out: Path) -> list[str]:
    """Rows of the table: what was measured, and the laws against those behind the clips."""
    summary = json.loads((out / "summary.json").read_text())
    with sqlite3.connect(out / "ledger.sqlite") as held:
        clips, attempts = held.execute("select count(*), sum(attempts) from clips").fetchone()
    rows = [
        f"| 40 rendered clips, killed on the way: rows, done, attempts | 40, 40, | {clips},"
        f" {summary['clips']['done']}, {attempts} |"
    ]
    inside, speeds, worst = 0, 0, 0.0
    for ball, found in summary["balls"].items():
        law = true_law(lab, ball)
        for at in found["cor_at"]:
            true = law(at["speed"])
            low, high = at["interval_95"]
            inside, speeds = inside + (low <= true <= high), speeds + 1
            worst = max(worst, abs(at["value"] - true))
        middle = found["cor_at"][len(found["cor_at"]) // 2]
        rows.append(
            f"| {ball}: law {found['law']}, e({middle['speed']:.2f} m/s) | "
            f"{law(middle['speed']):.4f} | {middle['value']:.4f}"
            f" ± {middle['std']:.4f} |"
        )
    rows.append(
        f"| law within its 95 % band, at nine speeds of each ball | all | {inside}/{speeds},"
        f" at most {worst:.4f} off |"
    )
    told = out / "explain.json"
    if told.exists():
        answer = json.loads(told.read_text())
        named = ", ".join(
            f"{one['id']} {one['probability']:.2f}" for one in answer.get("effects", [])
        )
        rows.append(
            f"| --explain | | {answer['verdict'] or answer['reason']}: {named or 'nothing'} |"
        )
    return rows + report_of_many(lab, out)


def main() -> None:
    """Render, run, kill, judge, print."""
    parser = argparse.ArgumentParser(prog="python -m bench.campaign.filmed", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only-film", action="store_true")
    parser.add_argument("--only-judge", action="store_true", help="what was run before")
    parser.add_argument("--report", action="store_true", help="of 160 clips, from the 40 measured")
    parser.add_argument("--scaling", action="store_true", help="two processes against one")
    given = parser.parse_args()
    lab = Laboratory(given.folder)
    if given.only_judge or given.report or given.scaling:
        if given.only_judge:
            print("\n".join(judged(lab, given.folder / "campaign")))
        if given.report:
            print("\n".join(report_of_many(lab, given.folder / "campaign")))
        if given.scaling:
            print("\n".join(scaling(lab)))
        return
    film(lab, given.jobs)
    if given.only_film:
        return
    out = given.folder / "campaign"
    took = run_killed(lab, out, given.jobs, (9, 23))
    print("| | wanted | measured |\n|---|---|---|")
    for row in judged(lab, out):
        print(row)
    print(f"| wall time with {given.jobs} processes, killed twice | | {took:.0f} s |")


if __name__ == "__main__":
    main()
