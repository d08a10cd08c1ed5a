"""The wizard as a new user meets it: a real browser, every step, and who is refused."""

import http.client
import json
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.camera import Camera, Lens
from pipelines.measure.chain import MeasureOptions, measure_clip
from pipelines.setup.file import load_setup
from pipelines.web import HOLD, RELEASE, SCRIPT
from tests.calib.synthetic import rendered
from tests.pipelines.calibrate.wizard_page import (
    CLIP,
    chromium,
    fill,
    on_picture,
    opened,
    says,
    settled,
    std_mm,
    until,
    value,
    wizard,
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def still_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall without motion: quick to calibrate, and the ball must be entered."""
    folder = tmp_path_factory.mktemp("still") / "clip"
    folder.mkdir()
    camera = Camera.facing_wall(Lens.centred(432, 244, 520.0), [0.9, 0.5, 2.0], yaw=0.1)
    for index in range(3):
        picture = rendered(camera, seed=index, samples=2)
        cv2.imwrite(str(folder / f"frame{index:03d}.png"), picture.astype(np.uint8))
    return folder


def chosen(page: Any, key: str) -> None:
    """Choose a place: one click is enough, however slow the machine."""
    page.click(f"[data-test=place-{key}]")
    page.wait_for_selector(f"[data-test=place-{key}][aria-pressed=true]")


def go_on(page: Any, heading: str) -> None:
    page.click("[data-test=next]")
    says(page, "[data-test=panel]", heading)


def click_through(page: Any) -> None:
    settled(page)
    guessed = std_mm(page)
    says(page, "[data-test=panel]", "assumed")
    fill(page, "fps", "600 fps")
    go_on(page, "2. Lens")
    page.click("text=Lens file")
    fill(page, "lens-file", "/nowhere/lens.toml")
    says(page, "[role=alert]", "an't read the lens file")
    page.click("text=From the wall grid")
    go_on(page, "3. Wall grid")
    says(page, "[data-test=panel]", "Found automatically")
    chosen(page, "origin")
    page.mouse.click(*on_picture(page, 200.0, 100.0))
    until(page, lambda: abs(value(page, "origin-x") - 200.0) < 1.0)
    says(page, "[data-test=changes]", "origin set")
    settled(page)
    go_on(page, "4. Ball and support")
    page.click("[data-test=ball]")
    page.click(".q-menu >> text=basketball")
    says(page, "[data-test=changes]", "ball basketball")
    sized = std_mm(page)
    assert sized < 0.5 * guessed
    settled(page)
    go_on(page, "5. Distances")
    fill(page, "camera_distance", "4.602 m")
    says(page, "[data-test=changes]", "camera to wall 4.602 m")
    settled(page)
    fill(page, "ball_plane_offset", "0.451 m")
    says(page, "[data-test=changes]", "camera to wall 4.602 m", "ball's plane to wall 0.451 m")
    assert std_mm(page) < sized
    go_on(page, "6. Check")


def test_every_step_clicked_through_saves_a_setup_that_is_read(
    browser: Any, tmp_path: Path
) -> None:
    out = tmp_path / "setup.toml"
    with wizard(CLIP, out) as running:
        page = opened(browser, running.address)
        click_through(page)
        for layer in ("Residual arrows", "Grid lines", "Uncertainty map"):
            page.click(f"text={layer}")
            until(page, lambda: page.locator("[data-test=picture] svg >> *").count() > 3)
        for key, x in (("end0", 120.0), ("end1", 320.0)):
            chosen(page, key)
            page.mouse.click(*on_picture(page, x, 60.0))
            until(page, lambda key=key, x=x: abs(value(page, f"{key}-x") - x) < 1)
        page.wait_for_selector("[data-test=length]")
        fill(page, "known-length", "5 m")
        says(page, "[data-test=length]", "disagrees")
        page.click("[data-test=save]")
        page.wait_for_selector("[data-test=saved]")
        page.click("[data-test=quit]")
        assert running.process.wait(60) == 0
    setup = load_setup(out)
    assert setup.camera.capture_fps == 600.0
    assert setup.camera.distance_to_wall == (4.602, 0.005)
    assert setup.wall.grid == 0.05
    assert setup.wall.ball_plane_offset == (0.451, 0.005)
    assert setup.ball is not None
    assert setup.ball.name == "basketball"
    assert (tmp_path / "lens.toml").read_text(encoding="utf-8").startswith("[lens]")


@pytest.mark.slow
def test_measure_uses_what_the_wizard_saved(browser: Any, tmp_path: Path) -> None:
    out = tmp_path / "setup.toml"
    with wizard(CLIP, out) as running:
        page = opened(browser, running.address)
        click_through(page)
        expected = std_mm(page)
        page.click("[data-test=save]")
        page.wait_for_selector("[data-test=saved]")
    measured = measure_clip(CLIP, MeasureOptions(setup=load_setup(out)))
    landing = {q.name: q for q in measured.quantities}["landing_distance"]
    assert landing.value is not None
    assert landing.std is not None
    truth = json.loads(CLIP.with_suffix(".truth.json").read_text("utf-8"))["quantities"]
    assert abs(landing.value - truth["landing_distance"]["value"]) < 4.0 * landing.std
    assert 0.3 * expected < 1e3 * landing.std < 3.0 * expected
    assert not any("assumed" in told and "RATE" in told for told in measured.warnings)


def press(page: Any, keys: str, times: int = 1) -> None:
    for _ in range(times):
        page.keyboard.press(keys)


def tab_to(page: Any, selector: str) -> None:
    """Press Tab until the focus is on or in an element."""
    wanted = f"document.activeElement.closest({selector!r}) !== null"
    for _ in range(60):
        if page.evaluate(wanted):
            return
        press(page, "Tab")
    raise AssertionError(f"Tab never reaches {selector}")


@pytest.mark.slow
def test_the_keyboard_alone_is_enough(browser: Any, still_clip: Path, tmp_path: Path) -> None:
    out = tmp_path / "setup.toml"
    with wizard(still_clip, out) as running:
        page = opened(browser, running.address)
        settled(page)
        tab_to(page, "[data-test=fps]")
        page.keyboard.type("600")
        press(page, "Enter")
        settled(page)
        tab_to(page, "[data-test=step-4]")
        press(page, "Enter")
        page.wait_for_selector("[data-test=ball]")
        tab_to(page, "[data-test=ball]")
        press(page, "ArrowDown")
        page.wait_for_selector(".q-menu")
        press(page, "ArrowDown")
        press(page, "Enter")
        settled(page)
        tab_to(page, "[data-test=place-rest]")
        press(page, "Enter")
        tab_to(page, "[data-test=picture]")
        press(page, "Shift+ArrowLeft", 3)
        press(page, "ArrowDown", 2)
        until(page, lambda: value(page, "rest-x") == 185.5 and value(page, "rest-y") == 123.5)
        settled(page)
        tab_to(page, "[data-test=step-6]")
        press(page, "Enter")
        page.wait_for_selector("[data-test=save]:not([disabled])")
        settled(page)
        tab_to(page, "[data-test=save]")
        press(page, "Enter")
        page.wait_for_selector("[data-test=saved]")
    assert load_setup(out).ball is not None


@pytest.mark.slow
def test_what_goes_wrong_is_said_on_the_page_and_corners_stay_where_they_are_dragged(
    browser: Any, still_clip: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    with wizard(still_clip, folder / "setup.toml") as running:
        page = opened(browser, running.address)
        settled(page)
        page.click("[data-test=step-3]")
        page.click("[data-test=by-hand]")
        page.wait_for_selector("[data-test=place-corner0]")
        x, y = value(page, "corner0-x"), value(page, "corner0-y")
        page.mouse.move(*on_picture(page, x, y))
        page.mouse.down()
        page.mouse.move(*on_picture(page, x + 8.0, y + 5.0), steps=4)
        page.mouse.up()
        until(page, lambda: abs(value(page, "corner0-x") - x - 8.0) < 1.5)
        for key, text in (("across", "0"), ("up", "4")):
            page.locator(f"[data-test={key}]").fill(text)
        page.click("[data-test=measure-corners]")
        says(page, "[role=alert]", "No square is between")
        page.reload()
        page.wait_for_selector("[data-test=place-corner0]")
        until(page, lambda: abs(value(page, "corner0-x") - x - 8.0) < 1.5)
        folder.rmdir()
        page.click("[data-test=step-6]")
        page.click("[data-test=save]")
        says(page, "[role=alert]", "an't write")


def test_a_click_while_a_step_is_drawn_anew_is_not_lost(browser: Any) -> None:
    page = browser.new_page()
    page.set_content(f"<head>{SCRIPT}</head><div><button data-test=choose>Choose</button></div>")
    page.evaluate("""() => {
        window.chosen = 0;
        window.oldOne = document.querySelector("[data-test=choose]");
        window.oldOne.addEventListener("click", () => { window.chosen += 1; });
    }""")
    page.click("[data-test=choose]")
    page.wait_for_function("!window.wizard.pressed")
    assert page.evaluate(HOLD) is True
    page.click("[data-test=choose]")
    assert page.evaluate("window.chosen") == 1
    page.evaluate("""() => {
        const twin = window.oldOne.cloneNode(true);
        twin.addEventListener("click", () => { window.chosen += 10; });
        window.oldOne.replaceWith(twin);
    }""")
    page.evaluate(RELEASE)
    page.wait_for_function("window.chosen === 11")
    page.mouse.down()
    assert page.evaluate(HOLD) is False


@pytest.mark.slow
def test_reloading_loses_nothing_and_a_second_tab_is_refused(
    browser: Any, still_clip: Path, tmp_path: Path
) -> None:
    with wizard(still_clip, tmp_path / "setup.toml") as running:
        context = browser.new_context()
        page = opened(context, running.address)
        settled(page)
        fill(page, "fps", "480")
        page.click("[data-test=step-5]")
        # however late the server hears that the old page has gone
        page.route("**/leaving", lambda route: route.abort())
        page.reload()
        page.wait_for_selector("[data-test=camera_distance]")
        says(page, "[data-test=changes]", "capture rate 480")
        page.unroute("**/leaving")
        page.reload()
        page.wait_for_selector("[data-test=camera_distance]")
        second = context.new_page()
        refused = second.goto(running.home)
        assert refused.status == 409
        says(second, "body", "another window")
        stranger = browser.new_context().new_page()
        assert stranger.goto(running.address).status == 403
        fill(page, "camera_distance", "2 m")
        says(page, "[data-test=changes]", "camera to wall 2 m")
        # a refused window opens by itself, whatever part of the page its address names
        second.goto(f"{running.home}#setup")
        says(second, "body", "another window")
        page.close()
        says(second, "[data-test=changes]", "camera to wall 2 m")
        context.close()
        assert running.process.wait(60) == 0


def test_no_token_and_a_foreign_host_are_refused(still_clip: Path, tmp_path: Path) -> None:
    with wizard(still_clip, tmp_path / "setup.toml") as running:
        host = running.home.split("/")[2]
        for path, headers in (
            ("/", {"Host": host}),
            ("/scene.png", {"Host": host}),
            ("/" + running.address.rpartition("/")[2], {"Host": "evil.example"}),
            ("/_nicegui_ws/socket.io/?EIO=4&transport=polling", {"Host": host}),
        ):
            asked = http.client.HTTPConnection(host, timeout=20)
            asked.request("GET", path, headers=headers)
            assert asked.getresponse().status == 403
            asked.close()
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(60) == 130
