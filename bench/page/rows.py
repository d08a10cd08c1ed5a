"""What is measured of the page, each as a function of a browser and an empty folder."""

import csv
import json
import re
import shutil
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from bench.page.clips import BALL_MM, CLIP_FPS, long_clip, short_clips
from bench.page.served import ROOT, App, served

__all__ = ["ROWS", "Row"]

Record = dict[str, Any]

Row = Callable[[Any, Path], Record]

SAMPLE = ROOT / "sample_videos" / "clips" / "basketball_60.mp4"
LESSONS = ROOT / "docs" / "lessons"
LONG_FRAMES, CAMPAIGN_CLIPS = 20_000, 40
DRAG_STEPS = 40
"""Frames stepped, and places sought; chosen: their median scatters by less than a tenth."""

_GO = """async ([frames, byKey]) => {
  const stage = document.querySelector("[data-test=stage]"), spent = [];
  stage.focus();
  for (const frame of frames) {
    const start = performance.now();
    const there = new Promise(done => {
      const look = () => Number(stage.dataset.shown) === frame ? (seen.disconnect(), done()) : 0;
      const seen = new MutationObserver(look);
      seen.observe(stage, {attributes: true});
    });
    if (byKey) stage.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowRight"}));
    else visionViewer.go(frame);
    await there;
    spent.push(performance.now() - start);
    await new Promise(done => setTimeout(done, 60));
  }
  return spent;
}"""
"""Times until the frame asked for is on the stage, ms."""


def _median_and_slow(spent: list[float]) -> Record:
    slow = sorted(spent)[int(0.95 * (len(spent) - 1))]
    return {"median_ms": statistics.median(spent), "slow_ms": slow}


def _dropped(app: App, clip: Path) -> None:
    app.page.wait_for_selector("input[type=file]", state="attached")
    app.act(lambda page: page.set_input_files("input[type=file]", clip))


def first_numbers(browser: Any, folder: Path) -> Record:
    """Drop to first numbers, then a dragged ball to new ones."""
    clip = folder / "from" / SAMPLE.name
    clip.parent.mkdir()
    shutil.copyfile(SAMPLE, clip)
    shutil.copyfile(SAMPLE.with_suffix(".toml"), folder / f"{SAMPLE.stem}.toml")
    with served(browser, folder) as app:
        app.settle()
        spent, start = app.cpu_s(), time.monotonic()
        _dropped(app, clip)
        app.measured()
        first = {"cpu_s": app.cpu_s() - spent, "wall_s": time.monotonic() - start}
        app.settle()
        return {"first": first, "correction": _correction(app)}


def _correction(app: App) -> Record:
    page = app.page
    marks = page.evaluate("fetch('/marks/1/0').then(got => got.json())")
    ball = next(one for one in marks["objects"] if one["kind"] == "ball")
    row = 3 * len(ball["frame"]) // 4
    frame, width = ball["frame"][row], page.evaluate("visionViewer.size()[0]")
    page.evaluate(_GO, [[frame], False])
    box = page.locator("[data-test=stage]").bounding_box()
    scale = box["width"] / width
    x, y = (box[side] + (ball[side][row] + 0.5) * scale for side in "xy")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 4, y + 3, steps=4)
    spent, start = app.cpu_s(), time.monotonic()
    page.mouse.up()
    app.wait(
        "document.querySelector('[data-test=repeats]').innerText.includes('--from-tracks')"
        " && !document.querySelector('[data-test=busy]')"
    )
    return {"cpu_s": app.cpu_s() - spent, "wall_s": time.monotonic() - start}


def long(browser: Any, folder: Path) -> Record:
    """Seeks and steps in a long clip while it is decoded and measured, and the page's memory."""
    clip = long_clip(folder / "long.mp4", LONG_FRAMES)
    with served(browser, folder, str(clip)) as app:
        page = app.page
        page.wait_for_selector("[data-test=stage][data-shown]")
        places = [(7919 * k + 4001) % LONG_FRAMES for k in range(DRAG_STEPS)]
        found: Record = {"seek": _median_and_slow(page.evaluate(_GO, [places, False]))}
        page.evaluate(_GO, [[200], False])
        steps = page.evaluate(_GO, [[200 + k for k in range(1, DRAG_STEPS + 1)], True])
        found["step"] = _median_and_slow(steps)
        session = browser.new_browser_cdp_session()
        known = session.send("SystemInfo.getProcessInfo")["processInfo"]
        pages = [psutil.Process(one["id"]) for one in known if one["type"] == "renderer"]
        found["page_mb"] = max(one.memory_full_info().uss for one in pages) / 1e6
        return found


def actions(browser: Any, folder: Path) -> Record:
    """Actions from `vision app` to a page to print, of a telephone's clip and a known ball."""
    clip = folder / "from" / "throw.mp4"
    clip.parent.mkdir()
    shutil.copyfile(LESSONS / "throw.mp4", clip)
    with served(browser, folder) as app:
        _dropped(app, clip)
        app.enter("ball", "201.75 mm")
        app.act(lambda page: page.press("[data-test=ball]", "Enter"))
        app.wait("document.querySelector('[data-test=as_command]').innerText.includes('--ball')")
        app.measured()
        app.click("page-export")
        with app.page.expect_popup() as opened:
            app.click("sheet")
        opened.value.wait_for_selector("img.still")
        return {"actions": app.actions}


def lessons(browser: Any, folder: Path) -> Record:
    """The five lessons in the page: kind, and whether each quantity is within 3 uncertainties."""
    known = json.loads((ROOT / "docs" / "results" / "lessons.json").read_text("utf-8"))
    return {name: _lesson(browser, folder / name, name, one) for name, one in known.items()}


def _lesson(browser: Any, folder: Path, name: str, known: Record) -> Record:
    folder.mkdir()
    place = LESSONS / f"{name}.mp4"
    if name == "strike":
        place = SAMPLE.with_name("jokku_90_small.mp4")
        shutil.copyfile(place.with_suffix(".toml"), folder / f"{place.stem}.toml")
    with served(browser, folder) as app:
        _dropped(app, place)
        if name != "strike":
            app.enter("fps", "60" if name == "swing" else "240")
            app.enter("ball", "201.75 mm")
            app.enter("wall_grid", "50 mm")
            app.click("measure")
            app.wait("document.querySelector('[data-test=as_command]').innerText.includes('grid')")
        app.measured()
        kind = app.page.inner_text("[data-test=motion]")
        app.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
        right = {key: _agrees(app, key, one["true"]) for key, one in known["quantities"].items()}
        return {"kind": kind, "kind_right": known["kind"] in kind, "quantities": right}


_SMALLER = {"ms": 1e3, "mm": 1e3, "%": 100.0}


def _agrees(app: App, name: str, true: float) -> bool:
    place = app.page.query_selector(f"[data-test=figure-{name}]")
    number = r"(-?[\d.]+(?:e-?\d+)?)"
    text = "" if place is None else place.inner_text().replace("\n", " ")
    found = re.search(rf"{number}\s*±\s*{number}\s*(\S*)", text)
    if found is None:
        return False
    value, std = float(found[1]), float(found[2])
    return abs(value - true * _SMALLER.get(found[3], 1.0)) <= 3.0 * std


def campaign(browser: Any, folder: Path) -> Record:
    """Forty clips of a folder; the window is closed twice and the program killed once."""
    names = short_clips(folder / "clips", CAMPAIGN_CLIPS)
    place = str(folder / "clips")
    with served(browser, folder, place) as app:
        app.page.fill("[data-test=fps]", str(CLIP_FPS))
        app.page.fill("[data-test=ball]", f"{BALL_MM:.2f} mm")
        app.page.click("[data-test=measure-all]")
        for done in (3, 8):
            _until_done(app, done)
            app.reopen()
        _until_done(app, 13)
        app.process.send_signal(signal.SIGKILL)
        app.process.wait(30)
    with served(browser, folder, place) as app:
        app.page.click("[data-test=measure-all]")
        _until_done(app, CAMPAIGN_CLIPS)
        app.wait("!document.querySelector('[data-test=counts]').innerText.startsWith('Measuring')")
    with (folder / "clips" / "results" / "results.csv").open(encoding="utf-8") as file:
        rows = Counter(Path(row["clip"]).name for row in csv.DictReader(file))
    return {
        "clips": len(names),
        "lost": sum(name not in rows and Path(name).stem not in rows for name in names),
        "twice": sum(count > 1 for count in rows.values()),
    }


def _until_done(app: App, count: int) -> None:
    """Wait until so many clips are measured, or can't be."""
    said = "(document.querySelector('[data-test=counts]')?.innerText || '')"
    numbers = f"[...{said}.matchAll(/(\\d+) (measured|failed)/g)]"
    app.wait(f"{numbers}.reduce((sum, one) => sum + Number(one[1]), 0) >= {count}")


def report(browser: Any, folder: Path) -> Record:
    """Size of the static report on a screen and a telephone."""
    file = folder / "report.html"
    command = [sys.executable, "-c", "from pipelines.cli import app; app()", "measure", str(SAMPLE)]
    options = ["--setup", str(SAMPLE.with_suffix(".toml")), "--report", str(file), "--quiet"]
    subprocess.run([*command, *options], cwd=ROOT, check=True, capture_output=True)
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(file.as_uri())
    height = page.evaluate("document.documentElement.scrollHeight")
    page.set_viewport_size({"width": 390, "height": 800})
    over = page.evaluate("document.documentElement.scrollWidth") - 390
    page.close()
    return {"screens": height / 800, "overflow_px": over, "megabytes": file.stat().st_size / 1e6}


def code(_browser: Any, _folder: Path) -> Record:
    """Front ends, and lines of page, report, wizard and their server."""
    pipelines = ROOT / "pipelines"
    places = [pipelines / "app", pipelines / "report", pipelines / "calibrate"]
    others = {pipelines / "calibrate" / name for name in ("command.py", "plan.py")}
    found = {one for place in places for one in place.rglob("*.*")} - others
    files = [pipelines / "web.py", *sorted(found)]
    files = [one for one in files if one.suffix in (".py", ".js", ".css", ".j2")]
    sources = [one.read_text("utf-8") for one in pipelines.rglob("*.py")]
    servers = [one for one in sources if re.search(r"^ +serve_app\(", one, re.MULTILINE)]
    lines = sum(len(one.read_text("utf-8").splitlines()) for one in files)
    return {"front_ends": len(servers), "lines": lines}


ROWS: dict[str, Row] = {
    "first_numbers": first_numbers,
    "long": long,
    "actions": actions,
    "lessons": lessons,
    "campaign": campaign,
    "report": report,
    "code": code,
}
