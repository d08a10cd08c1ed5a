"""A running `vision app`, its processor time, and a browser to use it with."""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

__all__ = ["ROOT", "App", "Program", "chromium", "running", "served"]

ROOT = Path(__file__).parents[2]
WAIT_MS = 600_000
COMMAND = "from pipelines.cli import app; app()"


@dataclass(frozen=True)
class Program:
    """A running program that serves the page.

    Attributes
    ----------
    address : str
        With its token.
    """

    process: "subprocess.Popen[str]"
    address: str

    @property
    def home(self) -> str:
        """The address without its token."""
        return self.address.partition("?")[0]


class App:
    """A running `vision app` and the window that shows it."""

    def __init__(self, program: Program, browser: Any) -> None:
        self.process, self.home = program.process, program.home
        self.actions = 0
        self._context = browser.new_context(viewport={"width": 1280, "height": 800})
        self.page = self._context.new_page()
        self.page.set_default_timeout(WAIT_MS)
        self.page.goto(program.address)

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
def running(
    *words: str, script: str = COMMAND, cwd: Path = ROOT, **environment: str
) -> Iterator[Program]:
    """Start a program that announces the address of its page; kill it at the end.

    Parameters
    ----------
    *words : str
        Its arguments.
    script : str
        Python; default: the command line.
    **environment : str
        Variables to set.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", script, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=cwd,
        env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT), **environment},
    )
    assert process.stdout is not None
    said = ""
    try:
        for line in process.stdout:
            said += line
            if found := re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line):
                yield Program(process, found[0])
                return
        raise RuntimeError(f"the program gave no address: {said}")
    finally:
        process.kill()
        process.wait(30)
        process.stdout.close()


@contextmanager
def served(browser: Any, folder: Path, *words: str) -> Iterator[App]:
    """`vision app` in a folder, without results of earlier measurements."""
    command = ("app", "--no-browser", "--language", "en", *words)
    state, cache = str(folder / "state"), str(folder / "cache")
    with running(*command, cwd=folder, XDG_STATE_HOME=state, IMPACT_VISION_CACHE=cache) as program:
        yield App(program, browser)


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
