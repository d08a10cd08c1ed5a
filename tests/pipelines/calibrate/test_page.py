"""Page Set up as a new user meets it: in a real browser, every answer."""

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
from measuring.chain import MeasureOptions, measure_clip
from measuring.setup.file import load_setup
from tests.calib.synthetic import rendered
from tests.pipelines.calibrate.wizard_page import (
    CLIP,
    WAIT_MS,
    chromium,
    fill,
    on_picture,
    opened,
    says,
    settled,
    std_mm,
    until,
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


def point_at(page: Any, kind: str, x: float, y: float) -> None:
    """Choose a point and click its place."""
    page.locator("[data-test=stage]").scroll_into_view_if_needed()
    page.click(f"[data-test=point-{kind}]")
    page.wait_for_selector("[data-test=stage].vs-pointing")
    page.mouse.click(*on_picture(page, x, y))


def fill_in(page: Any) -> None:
    settled(page)
    guessed = std_mm(page)
    says(page, "[data-test=card-rate]", "is assumed")
    fill(page, "fps", "600 fps")
    says(page, "[data-test=card-rate]", "600 fps: free fall")
    fill(page, "lens", "/nowhere/lens.toml")
    says(page, "[role=alert]", "an't read the lens file")
    says(page, "[data-test=card-wall]", "Found automatically", "50 mm are assumed")
    fill(page, "wall_grid", "50 mm")
    point_at(page, "origin", 200.0, 100.0)
    says(page, "[data-test=changes]", "origin")
    fill(page, "ball", "basketball")
    says(page, "[data-test=changes]", "basketball")
    sized = std_mm(page)
    assert sized < 0.5 * guessed
    fill(page, "camera_distance", "4.602 m")
    fill(page, "ball_plane", "0.451 m")
    says(page, "[data-test=changes]", "Camera to wall 4.602 m", "Ball's plane to wall 0.451 m")
    assert std_mm(page) < sized


def test_every_answer_is_in_the_setup_that_is_written(browser: Any, tmp_path: Path) -> None:
    out = tmp_path / "setup.toml"
    with wizard(CLIP, out) as running:
        page = opened(browser, running.address)
        fill_in(page)
        for key, text in (("mass", "2.5 kg"), ("com", "0.42 m"), ("period", "1.36 s")):
            fill(page, f"pendulum_{key}", text)
        until(page, lambda: page.input_value("[data-test=pendulum_inertia]").startswith("0.48"))
        for layer, drawn in (("uncertainty map", "rect"), ("grid lines", "path")):
            page.click("[data-test=layer]")
            page.click(f".q-menu >> text={layer}")
            until(page, lambda d=drawn: page.locator(f"[data-test=under] {d}").count() > 0)
        page.click("[data-test=length] summary")
        point_at(page, "end0", 120.0, 60.0)
        # the other end by keyboard, from the middle of the frame
        page.wait_for_selector("[data-test=point-end0][aria-pressed=true]")
        page.wait_for_timeout(300)
        page.keyboard.press("Enter")
        page.fill("[data-test=known-length]", "5 m")
        page.press("[data-test=known-length]", "Enter")
        says(page, "[data-test=compared]", "disagrees")
        page.click("[data-test=save]")
        says(page, "[data-test=saved]", "Written")
        page.click("[data-test=quit]")
        assert running.process.wait(60) == 0
    setup = load_setup(out)
    assert setup.camera.capture_fps == 600.0
    assert setup.camera.distance_to_wall == (4.602, 0.005)
    assert setup.wall.grid == 0.05
    assert setup.wall.ball_plane_offset == (0.451, 0.005)
    assert setup.ball is not None
    assert setup.ball.name == "basketball"
    assert setup.pendulum is not None
    assert abs(setup.pendulum.inertia - 0.4826) < 1e-3
    assert (tmp_path / "lens.toml").read_text(encoding="utf-8").startswith("[lens]")


@pytest.mark.slow
def test_measure_uses_what_the_page_saved(browser: Any, tmp_path: Path) -> None:
    out = tmp_path / "setup.toml"
    with wizard(CLIP, out) as running:
        page = opened(browser, running.address)
        fill_in(page)
        expected = std_mm(page)
        page.click("[data-test=save]")
        says(page, "[data-test=saved]", "Written")
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
        tab_to(page, "[data-test=ball]")
        page.keyboard.type("jokku")
        press(page, "Enter")
        says(page, "[data-test=changes]", "jokku")
        page.focus("body")
        tab_to(page, "[data-test=point-rest]")
        press(page, "Enter")
        page.wait_for_selector("[data-test=stage].vs-pointing")
        press(page, "Shift+ArrowLeft", 3)
        press(page, "ArrowDown", 2)
        press(page, "Enter")
        says(page, "[data-test=changes]", "Ball at rest")
        tab_to(page, "[data-test=save]")
        press(page, "Enter")
        says(page, "[data-test=saved]", "Written")
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
        page.click("[data-test=by-hand]")
        page.wait_for_selector(".vs-text >> text=4")
        x, y = (page.evaluate(f"visionViewer.at('corner0')[{k}]") for k in (0, 1))
        page.locator("[data-test=stage]").scroll_into_view_if_needed()
        page.mouse.move(*on_picture(page, x, y))
        page.mouse.down()
        page.mouse.move(*on_picture(page, x + 8.0, y + 5.0), steps=4)
        page.mouse.up()
        until(page, lambda: abs(page.evaluate("visionViewer.at('corner0')[0]") - x - 8.0) < 1.5)
        page.locator("[data-test=across]").fill("0")
        page.click("[data-test=measure-corners]")
        says(page, "[role=alert]", "No square is between")
        page.reload()
        page.wait_for_selector("[data-test=stage][data-shown]")
        page.click("[data-test=by-hand]")
        until(page, lambda: abs(page.evaluate("visionViewer.at('corner0')[0]") - x - 8.0) < 1.5)
        folder.rmdir()
        page.click("[data-test=save]")
        says(page, "[role=alert]", "an't write")


@pytest.mark.slow
def test_reloading_loses_nothing_and_a_second_tab_is_refused(
    browser: Any, still_clip: Path, tmp_path: Path
) -> None:
    with wizard(still_clip, tmp_path / "setup.toml") as running:
        context = browser.new_context()
        page = opened(context, running.address)
        settled(page)
        fill(page, "fps", "480")
        # however late the server hears that the old page has gone
        page.route("**/leaving", lambda route: route.abort())
        page.reload()
        page.wait_for_selector("[data-test=camera_distance]")
        says(page, "[data-test=changes]", "Capture rate 480")
        page.unroute("**/leaving")
        page.reload()
        page.wait_for_selector("[data-test=camera_distance]")
        second = context.new_page()
        second.set_default_timeout(WAIT_MS)
        refused = second.goto(running.home)
        assert refused.status == 409
        says(second, "body", "another window")
        stranger = browser.new_context().new_page()
        assert stranger.goto(running.address).status == 403
        fill(page, "camera_distance", "2 m")
        says(page, "[data-test=changes]", "Camera to wall 2 m")
        # a refused window opens by itself, whatever part of the page its address names
        second.goto(f"{running.home}#setup")
        says(second, "body", "another window")
        page.close()
        says(second, "[data-test=changes]", "Camera to wall 2 m")
        context.close()
        assert running.process.wait(60) == 0


def test_no_token_and_a_foreign_host_are_refused(still_clip: Path, tmp_path: Path) -> None:
    with wizard(still_clip, tmp_path / "setup.toml") as running:
        host = running.home.split("/")[2]
        for path, headers in (
            ("/", {"Host": host}),
            ("/frame/1/0", {"Host": host}),
            ("/" + running.address.rpartition("/")[2], {"Host": "evil.example"}),
            ("/_nicegui_ws/socket.io/?EIO=4&transport=polling", {"Host": host}),
        ):
            asked = http.client.HTTPConnection(host, timeout=20)
            asked.request("GET", path, headers=headers)
            assert asked.getresponse().status == 403
            asked.close()
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(60) == 130
