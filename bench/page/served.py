"""A running `vision app`, its processor time, and a browser to use it with."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil

__all__ = ["App", "chromium", "served"]

ROOT = Path(__file__).parents[2]
WAIT_MS = 600_000


class App:
    """A running `vision app` and the window that shows it.

    Parameters
    ----------
    process : Popen
    address : str
        With its token.
    browser : Browser
    """

    def __init__(self, process: "subprocess.Popen[str]", address: str, browser: Any) -> None:
        self.process, self.home = process, address.partition("?")[0]
        self.actions = 0
        self._context = browser.new_context(viewport={"width": 1280, "height": 800})
        self.page = self._context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.page.goto(address)

    def act(self, step: Callable[[Any], object]) -> None:
        """Do one action of a user, and count it."""
        self.actions += 1
        step(self.page)

    def enter(self, name: str, text: str) -> None:
        """Type into a field; one action."""
        self.act(lambda page: page.fill(f"[data-test={name}]", text))

    def click(self, name: str) -> None:
        """Click something; one action."""
        self.act(lambda page: page.click(f"[data-test={name}]"))

    def reopen(self) -> None:
        """Close the window and open another one."""
        self.page.close()
        self.page = self._context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.page.goto(self.home)

    def wait(self, holds: str) -> None:
        """Wait until a JavaScript expression is true."""
        self.page.wait_for_function(holds, polling=50)

    def measured(self) -> None:
        """Wait until a clip is measured completely."""
        self.wait(
            "document.querySelector('[data-test^=figure-]')"
            " && !document.querySelector('[data-test=busy]')"
        )

    def cpu_s(self) -> float:
        """Processor time so far of the program and its processes, s."""
        one = psutil.Process(self.process.pid)
        total = 0.0
        for each in (one, *one.children(recursive=True)):
            spent = each.cpu_times()
            total += spent.user + spent.system
        return total

    def settle(self) -> None:
        """Wait until the program does nothing."""
        before = -1.0
        while self.cpu_s() - before > 0.05:
            before = self.cpu_s()
            time.sleep(1.0)


@contextmanager
def served(browser: Any, folder: Path, *arguments: str) -> Iterator[App]:
    """`vision app` in a folder, without results of earlier measurements."""
    process = subprocess.Popen(
        [
            *(sys.executable, "-c", "from pipelines.cli import app; app()"),
            *("app", "--no-browser", "--language", "en", *arguments),
        ],
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={
            **os.environ,
            "OMP_NUM_THREADS": "1",
            "PYTHONPATH": str(ROOT),
            "XDG_STATE_HOME": str(folder / "state"),
            "IMPACT_VISION_CACHE": str(folder / "cache"),
        },
    )
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if found := re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line):
                yield App(process, found[0], browser)
                return
        raise RuntimeError("vision app gave no address")
    finally:
        process.kill()
        process.wait(30)
        process.stdout.close()


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless browser."""
    from playwright.sync_api import sync_playwright

    path = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()
