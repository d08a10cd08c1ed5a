"""Page Folder: what the ledger holds is displayed, and clicks change the ledger."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from bench.page.served import running
from metrology import ImpactVisionError, UsageError
from pipelines.app.campaign import FolderInputs, FolderSession, Wanted
from pipelines.app.pages.folder import cor_options
from pipelines.app.session import AppSession, is_images
from pipelines.app.words import says
from pipelines.campaign.ledger import AttemptOutcome, Ledger, State, WorkOrder
from pipelines.campaign.results import read_lab_book
from tests.pipelines.app.small import falling
from tests.pipelines.calibrate.wizard_page import chromium, opened_plain, until

_SERVE = """
import sys
from pathlib import Path
from pipelines.app.command import watch_campaign
page = watch_campaign(Path(sys.argv[1]), lambda address: print(address, flush=True))
page.closed.wait()
"""


def _document(probability: float) -> str:
    return json.dumps(
        {
            "clip": {"width": 432, "height": 240},
            "quantities": {
                "contact_time": {"value": 0.0141, "std": 0.0008, "unit": "s"},
                "cor": {"value": 0.75, "std": 0.004, "unit": "1"},
                "pendulum_speed_before": {"value": 2.5, "std": 0.01, "unit": "m/s"},
            },
            "motion": {"kind": "strike", "probability": probability},
        }
    )


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A campaign with a sure clip, a doubtful, a failed and a waiting one."""
    names = ["sure.mp4", "doubted.mp4", "missed.mp4", "later.mp4"]
    (tmp_path / "frames").mkdir()
    for name in names[:2]:
        frame = np.full((120, 216, 3), 200, np.uint8)
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


def test_the_state_is_that_of_the_ledger(out: Path) -> None:
    folder = FolderSession(out)
    state = folder.state()
    assert state.counts == {"waiting": 1, "running": 0, "done": 2, "failed": 1}
    cards = {one.clip: one for one in state.cards}
    assert {one.clip for one in state.cards[:2]} == {"doubted.mp4", "missed.mp4"}
    assert cards["sure.mp4"].values == (
        ("contact_time", "14.10 ± 0.80 ms"),
        ("cor", "0.7500 ± 0.0040"),
    )
    assert cards["doubted.mp4"].motion == "strike, 0.60"
    assert state.points == ((2.5, 0.75, "sure.mp4", True), (2.5, 0.75, "doubted.mp4", True))

    folder.mark("sure.mp4", "  touched ")
    assert folder.asked.is_set()
    state = folder.state()
    assert {one.clip: one.bad for one in state.cards}["sure.mp4"] == "touched"
    counted, excluded, law = cor_options(state, says("en"))["series"]
    assert [one["name"] for one in counted["data"]] == ["doubted.mp4"]
    assert [one["name"] for one in excluded["data"]] == ["sure.mp4"]
    assert law["data"] == []
    folder.mark("sure.mp4", None)
    assert {one.clip: one.bad for one in folder.state().cards}["sure.mp4"] == ""

    folder.point("doubted.mp4", 0.25, 0.5)
    with Ledger(out) as ledger:
        assert ledger.points() == {"doubted.mp4": "108.0,120.0"}
    for clip, x in (("none.mp4", 0.5), ("later.mp4", 0.5), ("sure.mp4", 1.5)):
        with pytest.raises(UsageError):
            folder.point(clip, x, 0.5)


def test_the_law_of_the_last_results_is_drawn(out: Path) -> None:
    at = [{"speed": 1.0, "value": 0.8, "std": 0.01}, {"speed": 2.0, "value": 0.7, "std": 0.02}]
    balls = {"jokku": {"cor_at": at, "precision": {"repeatability": 0.03}}, "other": {"law": None}}
    (out / "summary.json").write_text(json.dumps({"balls": balls}))
    assert FolderSession(out).state().law == ((1.0, 0.8), (2.0, 0.7))
    # weights of the means: 1 / 0.01² is 1 / 0.02² and 7 times 1 / 0.03²
    assert FolderSession(out).state().wanted == (Wanted("jokku", 2.0, 0.02, 7),)
    for damage in ("", "[]", '{"balls": 3}', '{"balls": {"a": {"cor_at": [{}]}}}'):
        (out / "summary.json").write_text(damage)
        assert FolderSession(out).state().law == ()


def test_only_pictures_of_the_ledger_are_handed_out(out: Path) -> None:
    folder = FolderSession(out)
    assert folder.picture("sure.mp4") is not None
    (out / "frames" / "stranger.jpg").write_bytes(b"1")
    (out / "other.jpg").write_bytes(b"1")
    for name in ("stranger", "../other", "missed.mp4", ""):
        assert folder.picture(name) is None
    assert FolderSession(out / "nowhere").state().cards == ()


def test_inputs_are_kept_in_the_folder_and_a_wrong_file_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text("")
    (tmp_path / "trials.csv").write_text("clip\n")
    folder = FolderSession.of(tmp_path)
    assert folder.inputs == FolderInputs("trials.csv", "lab.toml")
    assert folder.as_command() == (
        f"vision campaign {tmp_path} --trials {tmp_path}/trials.csv --setup {tmp_path}/lab.toml"
        f" --out {tmp_path}/results"
    )
    assert folder.as_python().splitlines()[2] == (
        f"c = iv.campaign('{tmp_path}', trials='{tmp_path}/trials.csv',"
        f" setup='{tmp_path}/lab.toml', out='{tmp_path}/results')"
    )
    # there is no clip: the run ends with a sentence, and the inputs are kept
    folder.begin(FolderInputs(fps="600"))
    folder.finish()
    assert "there is no clip" in folder.problem
    assert not folder.running
    with pytest.raises(UsageError, match="there is no clip"):
        exec(folder.as_python(), {})
    assert FolderSession.of(tmp_path).inputs == FolderInputs(fps="600")
    for text, said in (("[", "not valid TOML"), ("speed = '1'", "speed"), ("fps = 6", "fps")):
        (tmp_path / "vision-app.toml").write_text(text)
        assert said in FolderSession.of(tmp_path).problem


def test_a_folder_of_pictures_is_a_clip_and_one_of_nothing_is_refused(tmp_path: Path) -> None:
    assert is_images(falling(tmp_path / "pictures", frames=2))
    (tmp_path / "pictures" / "a.mp4").write_bytes(b"1")
    assert not is_images(tmp_path / "pictures")
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match="no clip"):
        AppSession().open_place(tmp_path / "empty")


@pytest.fixture
def address(out: Path) -> Iterator[str]:
    with running(str(out), script=_SERVE) as program:
        yield program.address


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


def _entry(folder: Path, clip: str) -> Any:
    with Ledger(folder) as ledger:
        return next(one for one in ledger.entries() if one.order.clip == clip)


def test_cards_marks_and_points_in_a_browser(browser: Any, address: str, out: Path) -> None:
    page = opened_plain(browser, address)
    until(page, lambda: "2 measured, 1 failed" in page.inner_text("[data-test=counts]"))
    until(page, lambda: page.locator("[data-test^=clip-]").count() == 4)
    # what a file says is text, not markup
    assert "No ball <b>found</b>" in page.inner_text("[data-test='clip-missed.mp4']")
    assert "0.7500 ± 0.0040" in page.inner_text("[data-test='clip-sure.mp4']")

    sure = page.locator("[data-test='clip-sure.mp4']")
    sure.locator("input").fill("the ball was not at rest")
    sure.locator("[data-test=mark]").click()
    until(page, lambda: _entry(out, "sure.mp4").excluded == "the ball was not at rest")
    sure.locator("[data-test=unmark]").click()
    until(page, lambda: _entry(out, "sure.mp4").excluded is None)

    image = page.locator("[data-test='clip-doubted.mp4'] img")
    until(page, lambda: image.bounding_box()["height"] > 50)
    room = image.bounding_box()
    image.click(position={"x": 0.25 * room["width"], "y": 0.5 * room["height"]})

    def pointed() -> bool:
        with Ledger(out) as ledger:
            x, y = map(float, ledger.points().get("doubted.mp4", "0,0").split(","))
        return abs(x - 108.0) < 2.0 and abs(y - 120.0) < 2.0

    until(page, pointed)
    page.click("[data-test=show] >> text=uncertain")
    until(page, lambda: page.locator("[data-test^=clip-]").count() == 2)
    page.set_viewport_size({"width": 390, "height": 800})
    # graphs follow a moment later
    until(page, lambda: page.evaluate("document.documentElement.scrollWidth") <= 390)


def test_a_pasted_sheet_becomes_the_lab_book_and_no_other_file_is_touched(tmp_path: Path) -> None:
    folder = FolderSession(tmp_path / "out", tmp_path)
    kept = tmp_path / "trials.csv"
    kept.write_text("clip,ball\nb.mp4,blue\n")
    # as a German spreadsheet copies it
    name = folder.paste("clip\tball\tbackswing_deg\r\na.mp4\tred\t62,5\r\n")
    (strike,) = read_lab_book(tmp_path / name).strikes
    assert (strike.clip, strike.ball, strike.backswing_deg) == ("a.mp4", "red", 62.5)
    assert kept.read_text() == "clip,ball\nb.mp4,blue\n"
    before = sorted(tmp_path.iterdir())
    for text in ("", "62\t0.3\n", "clip\tbackswing_deg\na.mp4\tfar\n"):
        with pytest.raises(ImpactVisionError):
            folder.paste(text)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
def test_a_cell_of_the_sheet_is_edited_and_becomes_the_lab_book(
    browser: Any, tmp_path: Path
) -> None:
    clips = tmp_path / "clips"
    clips.mkdir()
    for name in ("a.mp4", "b.mp4"):
        (clips / name).write_bytes(b"none")
    with running("app", str(clips), "--no-browser", "--language", "en", cwd=tmp_path) as program:
        page = opened_plain(browser, program.address)
        page.click("[data-test=sheet] summary")
        page.dblclick("[data-test=cells] [row-index='1'] [col-id=c1]")
        page.keyboard.type("jokku")
        page.keyboard.press("Enter")
        until(page, lambda: "b.mp4\tjokku" in page.input_value("[data-test=pasted]"))
        page.click("[data-test=paste]")
        until(page, lambda: page.input_value("[data-test=trials]") == "trials.csv")
        book = read_lab_book(clips / "trials.csv")
        assert [(one.clip, one.ball) for one in book.strikes] == [
            ("a.mp4", None),
            ("b.mp4", "jokku"),
        ]
        # what is pasted as text is shown in cells
        page.fill("[data-test=pasted]", "clip;ball;session\na.mp4;blue;2")
        until(page, lambda: page.inner_text("[data-test=cells] [col-id=c2].ag-cell") == "2")
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= 390


@pytest.mark.slow
def test_a_sheet_is_pasted_in_a_browser(browser: Any, tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    clips.mkdir()
    (clips / "a.mp4").write_bytes(b"none")
    with running("app", str(clips), "--no-browser", "--language", "en", cwd=tmp_path) as program:
        page = opened_plain(browser, program.address)
        page.click("[data-test=sheet] summary")
        page.fill("[data-test=pasted]", "62\t0.3\n")
        page.click("[data-test=paste]")
        page.wait_for_selector(".q-notification")
        assert [one.name for one in clips.glob("trials*")] == []
        page.fill("[data-test=pasted]", "clip\tball\na.mp4\tjokku\n")
        page.click("[data-test=paste]")
        until(page, lambda: page.input_value("[data-test=trials]") == "trials.csv")
        assert (clips / "trials.csv").read_text() == "clip\tball\na.mp4\tjokku\n"
        page.click("[data-test=measure-all]")
        until(page, lambda: "trials.csv'" in page.inner_text("[data-test=as_python]"))
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
