"""A wizard that runs, and a headless Chromium to look at it with."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[3]
CLIP = ROOT / "sample_videos" / "clips" / "basketball_60.mp4"
WAIT_MS = 120_000


@dataclass
class Wizard:
    """A running `vision calibrate`.

    Attributes
    ----------
    process : Popen
    address : str
        With its token.
    """

    process: subprocess.Popen[str]
    address: str

    @property
    def home(self) -> str:
        return self.address.partition("?")[0]


@contextmanager
def wizard(clip: Path, out: Path, *options: str) -> Iterator[Wizard]:
    command = "from pipelines.cli import app; app()"
    arguments = ["calibrate", str(clip), "--no-browser", "--out", str(out), *options]
    process = subprocess.Popen(
        [sys.executable, "-c", command, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert process.stdout is not None
    try:
        said = ""
        for line in process.stdout:
            said += line
            if found := re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line):
                yield Wizard(process, found[0])
                return
        raise AssertionError(said)
    finally:
        process.kill()
        process.wait(30)
        process.stdout.close()


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; the test is skipped where there is none."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("there is no Chromium here: apt-get install chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


def opened_plain(browser: Any, address: str) -> Any:
    """A page of any kind."""
    page = browser.new_page()
    page.set_viewport_size({"width": 1360, "height": 900})
    page.set_default_timeout(WAIT_MS)
    page.goto(address)
    return page


def opened(browser: Any, address: str) -> Any:
    page = opened_plain(browser, address)
    page.wait_for_selector("[data-test=panel]")
    return page


def until(page: Any, holds: Callable[[], bool]) -> None:
    """Wait until something holds; a value that is not there yet is waited for, too."""
    for _ in range(WAIT_MS // 100):
        try:
            if holds():
                return
        except (ValueError, IndexError):
            pass
        page.wait_for_timeout(100)
    assert holds()


def says(page: Any, name: str, *parts: str) -> None:
    """Wait until an element says all of it."""
    until(page, lambda: all(part in page.inner_text(name) for part in parts))


def settled(page: Any) -> None:
    """Wait until nothing is being worked out."""
    page.wait_for_timeout(600)
    page.wait_for_selector("[data-test=busy]", state="detached")
    page.wait_for_timeout(400)


def fill(page: Any, name: str, text: str) -> None:
    box = page.locator(f"[data-test={name}]")
    box.fill(text)
    box.press("Enter")
    settled(page)


def value(page: Any, name: str) -> float:
    """Number in a field."""
    return float(page.locator(f"[data-test={name}]").input_value())


def std_mm(page: Any) -> float:
    """The uncertainty shown, mm."""
    return float(page.inner_text("[data-test=std]").removeprefix("±").removesuffix("mm"))


def on_picture(page: Any, x: float, y: float) -> tuple[float, float]:
    """Where a pixel of the picture is on the page."""
    box = page.locator("[data-test=picture]").bounding_box()
    scale = box["width"] / 432
    return box["x"] + (x + 0.5) * scale, box["y"] + (y + 0.5) * scale
