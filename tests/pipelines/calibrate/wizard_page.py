"""A page Set up that runs, and a headless Chromium to look at it with."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from bench.page import served
from bench.page.served import ROOT, Program, running

CLIP = ROOT / "sample_videos" / "clips" / "basketball_60.mp4"
WAIT_MS = 120_000


def wizard(clip: Path, out: Path, *options: str) -> AbstractContextManager[Program]:
    """A running `vision calibrate`."""
    return running("calibrate", str(clip), "--no-browser", "--out", str(out), *options)


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; the test is skipped where there is none."""
    if not any(map(shutil.which, ("chromium", "chromium-browser"))):
        pytest.skip("there is no Chromium here: apt-get install chromium")
    pytest.importorskip("playwright.sync_api")
    with served.chromium() as browser:
        yield browser


def opened_plain(browser: Any, address: str) -> Any:
    """A page of any kind."""
    page = browser.new_page()
    page.set_viewport_size({"width": 1360, "height": 900})
    page.set_default_timeout(WAIT_MS)
    page.goto(address)
    return page


def opened(browser: Any, address: str) -> Any:
    page = opened_plain(browser, address)
    page.wait_for_selector("[data-test=stage][data-shown]")
    page.wait_for_selector("[data-test=outlook]")
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


def std_mm(page: Any) -> float:
    """The uncertainty shown, mm."""
    return float(page.inner_text("[data-test=std]").removeprefix("±").removesuffix("mm"))


def on_picture(page: Any, x: float, y: float) -> tuple[float, float]:
    """Where a pixel of the picture is on the page."""
    box = page.locator("[data-test=stage]").bounding_box()
    scale = box["width"] / 432
    return box["x"] + (x + 0.5) * scale, box["y"] + (y + 0.5) * scale
