"""The page beside a campaign, in a real browser; clicks there change the ledger."""

import json
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from metrology import UsageError
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder
from pipelines.campaign.results import match_clips
from pipelines.campaign.run import RunOptions, RunPlan, find_clips, local_crew, run
from tests.pipelines.calibrate.wizard_page import chromium, opened_plain, until

ROOT = Path(__file__).parents[3]
STAND_IN = Path(__file__).with_name("stand_in.py")
_SERVE = """
import sys
from pathlib import Path
from pipelines.campaign.watch import watched
page = watched(Path(sys.argv[1]), lambda address: print(address, flush=True), browse=False)
page.closed.wait()
"""


def _document(probability: float) -> str:
    return json.dumps(
        {
            "clip": {"width": 432, "height": 240},
            "quantities": {"cor": {"value": 0.75, "std": 0.004, "unit": "1"}},
            "motion": {"kind": "strike", "probability": probability},
        }
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    names = ["sure.mp4", "doubted.mp4", "missed.mp4", "later.mp4"]
    (tmp_path / "frames").mkdir()
    for name in names[:2]:
        frame = np.full((160, 216, 3), 200, np.uint8)
        cv2.imwrite(str(tmp_path / "frames" / f"{name}.jpg"), frame)
    with Ledger(tmp_path) as ledger:
        ledger.plan([WorkOrder(n, n, "0", "0", "1") for n in names], retry_failed=False)
        ledger.begin(names[:3])
        ledger.finish(
            [
                AttemptOutcome(names[0], State.DONE, 3.0, _document(0.99)),
                AttemptOutcome(names[1], State.DONE, 3.0, _document(0.6)),
                AttemptOutcome(names[2], State.FAILED, 3.0, error="no ball <b>found</b>"),
            ]
        )
    return tmp_path


@pytest.fixture
def address(folder: Path) -> Iterator[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", _SERVE, str(folder)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    yield process.stdout.readline().strip()
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


def _entry(folder: Path, clip: str) -> Any:
    with Ledger(folder) as ledger:
        return next(one for one in ledger.entries() if one.order.clip == clip)


def test_progress_clips_marks_and_points(browser: Any, address: str, folder: Path) -> None:
    page = opened_plain(browser, address)
    until(page, lambda: "2 measured, 1 failed" in page.inner_text("[data-test=counts]"))
    cards = page.locator("[data-test^=clip-]")
    # what needs a look comes first, and what a file says is text, not markup
    assert cards.nth(0).get_attribute("data-test") in ("clip-doubted.mp4", "clip-missed.mp4")
    assert "no ball <b>found</b>" in page.inner_text("[data-test='clip-missed.mp4']")
    assert "COR 0.7500 ± 0.0040" in page.inner_text("[data-test='clip-sure.mp4']")
    assert "motion: strike (probability 60 %)" in page.inner_text("[data-test='clip-doubted.mp4']")

    sure = page.locator("[data-test='clip-sure.mp4']")
    sure.locator("input").fill("the ball was not at rest")
    sure.get_by_role("button", name="mark as bad").click()
    until(page, lambda: _entry(folder, "sure.mp4").excluded == "the ball was not at rest")
    until(page, lambda: "bad: the ball" in page.inner_text("[data-test='clip-sure.mp4']"))
    sure.get_by_role("button", name="remove mark").click()
    until(page, lambda: _entry(folder, "sure.mp4").excluded is None)

    image = page.locator("[data-test='clip-doubted.mp4'] img")
    until(page, lambda: image.bounding_box()["height"] > 50)
    room = image.bounding_box()
    image.click(position={"x": 0.25 * room["width"], "y": 0.5 * room["width"]})

    def pointed() -> bool:
        with Ledger(folder) as ledger:
            at = ledger.points().get("doubted.mp4", "0,0")
        x, y = map(float, at.split(","))
        return abs(x - 108.0) < 2.0 and abs(y - 216.0) < 2.0

    until(page, pointed)
    page.check("[value=unsure]")
    until(page, lambda: cards.count() == 2)
    page.check("[value=all]")

    with Ledger(folder) as ledger:
        ledger.begin(["later.mp4"])
    until(page, lambda: "later.mp4" in page.inner_text("[data-test=busy]"))
    with Ledger(folder) as ledger:
        ledger.finish([AttemptOutcome("later.mp4", State.FAILED, 1.0, error="no ball")])
    # it comes last and stands before what is sure
    until(page, lambda: cards.count() == 4)
    until(page, lambda: page.inner_text("[data-test=busy]") == "")
    tops = [
        page.locator(f"[data-test='clip-{name}.mp4']").bounding_box() for name in ("later", "sure")
    ]
    assert (tops[0]["y"], tops[0]["x"]) < (tops[1]["y"], tops[1]["x"])


def test_nobody_else_comes_in(address: str) -> None:
    host = address.partition("/?")[0]
    for path in ("/", "/state", "/frame/sure.mp4", "/frame/..%2fledger.sqlite"):
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(host + path)
        assert refused.value.code == 403
        refused.value.close()


def test_a_clip_whose_ball_was_shown_is_measured_again_with_the_point(tmp_path: Path) -> None:
    clips, out = tmp_path / "clips", tmp_path / "out"
    clips.mkdir()
    for name in ("a", "b"):
        (clips / f"{name}.mp4").write_bytes(name.encode())
    options = RunOptions(command=(sys.executable, str(STAND_IN)))
    plan = RunPlan(out, options, match_clips(None, find_clips([clips])), "1")
    assert run(plan, lambda: local_crew(1, options)).done == 2
    with Ledger(out) as ledger:
        ledger.point_at("a.mp4", "120.0,88.0")
        for change in (ledger.point_at, ledger.exclude):
            with pytest.raises(UsageError, match=r"no clip 'c\.mp4'"):
                change("c.mp4", "1,2")
    again = run(plan, lambda: local_crew(1, options))
    assert again.again == {"a.mp4": "setup or options"}
    assert plan.request(clips / "a.mp4", "120.0,88.0").ball_at == "120.0,88.0"
    assert run(plan, lambda: local_crew(1, options)).todo == 0
