"""The page in a real browser: frames, numbers, graphs, corrections, and who is refused."""

import re
import shutil
import tempfile
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bench.page.served import ROOT, running
from measuring.setup.file import load_setup
from pipelines.app.corrections import (
    FIXED_POINTS,
    ClipInputs,
    corrections_file,
    read_corrections,
)
from tests.pipelines.app.small import CLIP, FALL, falling
from tests.pipelines.calibrate.wizard_page import chromium, opened_plain, until


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@contextmanager
def served(*words: str, cwd: Path = ROOT) -> Iterator[str]:
    """Address of a running `vision app`."""
    state = str(cwd / "state") if cwd != ROOT else tempfile.gettempdir()
    with running("app", "--no-browser", *words, cwd=cwd, LANG="C", XDG_STATE_HOME=state) as program:
        yield program.address


def shown(page: Any) -> int:
    return int(page.get_attribute("[data-test=stage]", "data-shown") or -1)


def on_stage(page: Any, x: float, y: float, width: int = 120) -> tuple[float, float]:
    """Where a pixel of the clip is on the page."""
    box = page.locator("[data-test=stage]").bounding_box()
    scale = box["width"] / width
    return box["x"] + (x + 0.5) * scale, box["y"] + (y + 0.5) * scale


def dragged(page: Any, start: Any, end: Any, width: int = 120) -> None:
    """Drag what is at a pixel of the clip to another one."""
    page.mouse.move(*on_stage(page, *start, width))
    page.mouse.down()
    page.mouse.move(*on_stage(page, *end, width), steps=5)
    page.mouse.up()


def test_a_clip_from_numbers_to_a_correction(browser: Any, tmp_path: Path) -> None:
    path = falling(tmp_path / "<i>drop<i>")
    (tmp_path / "<i>drop<i>.toml").write_text("[camera]\ncapture_fps = 240\n")
    said: list[str] = []
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        page.on("console", lambda one: said.append(one.text) if one.type == "error" else None)
        page.on("pageerror", lambda one: said.append(str(one)))
        page.wait_for_selector("[data-test^=figure-]")
        assert page.inner_text("[data-test=name]") == "<i>drop<i>"
        assert "240" in page.inner_text("[data-test=repeats]") or "toml" in page.inner_text(
            "[data-test=repeats]"
        )
        # by keyboard
        stage = page.locator("[data-test=stage]")
        stage.focus()
        page.keyboard.press("End")
        until(page, lambda: shown(page) == 35)
        page.keyboard.press("ArrowLeft")
        until(page, lambda: shown(page) == 34)
        page.keyboard.press("Home")
        until(page, lambda: shown(page) == 0)
        # a click in a graph goes to its frame
        until(page, lambda: stage.get_attribute("data-graphs") == "ready")
        graph = page.locator(".va-graph").first
        graph.scroll_into_view_if_needed()
        box = graph.bounding_box()
        page.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 0.6 * box["height"])
        until(page, lambda: shown(page) > 0)
        # an outline is dragged
        stage.scroll_into_view_if_needed()
        stage.focus()
        page.keyboard.press("Home")
        for _ in range(10):
            page.keyboard.press("ArrowRight")
        until(page, lambda: shown(page) == 10)
        x, y = on_stage(page, 60.0, 31.0)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 4, y + 3, steps=3)
        page.mouse.move(x + 9, y, steps=3)
        page.mouse.up()
        file = corrections_file(path)
        until(page, lambda: file.is_file() and bool(read_corrections(file).ball))
        mark = read_corrections(file).ball[0]
        assert (mark.frame, mark.moved) == (10, True)
        assert mark.x_px > 60.5
        until(page, lambda: "--from-tracks" in page.inner_text("[data-test=repeats]"))
        page.click("[data-test=undo]")
        until(page, lambda: not read_corrections(file).ball)
        # by keyboard: the cross starts in the middle
        page.click("[data-test=point-ball]")
        until(page, lambda: "vs-pointing" in stage.get_attribute("class"))
        page.keyboard.press("ArrowUp")
        page.keyboard.press("Enter")
        until(page, lambda: bool(read_corrections(file).ball))
        mark = read_corrections(file).ball[0]
        assert (mark.x_px, mark.y_px, mark.moved) == (59.5, 98.5, False)
        page.reload()
        page.wait_for_selector("[data-test=stage]")
        for width in (390, 768):
            page.set_viewport_size({"width": width, "height": 800})
            assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.click("[data-test=language]")
        page.click(".q-menu >> text=Deutsch")
        until(page, lambda: "Ergebnisse" in page.inner_text("[data-test=numbers]"))
    assert said == []


@pytest.mark.slow
def test_a_span_dragged_in_a_graph_is_fitted(browser: Any, tmp_path: Path) -> None:
    path = falling(tmp_path / "drop")
    (tmp_path / "drop.toml").write_text("[camera]\ncapture_fps = 240\n")
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        stage = page.locator("[data-test=stage]")
        stage.wait_for()
        until(page, lambda: stage.get_attribute("data-graphs") == "ready")
        graph = page.locator("[data-test=graphs] figure", has_text="Position").locator(".va-graph")
        graph.scroll_into_view_if_needed()
        box, there = graph.bounding_box(), shown(page)
        # the lower curve of the two, as y grows downwards: the ball's y at first
        x, y = box["x"] + 0.35 * box["width"], box["y"] + 0.8 * box["height"]
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 0.5 * box["width"], y, steps=6)
        page.mouse.up()
        page.wait_for_selector("[data-test=term-curvature]")
        assert page.input_value("[data-test=fit-from]") != page.input_value("[data-test=fit-to]")
        # dragging is no click
        assert shown(page) == there
        found = re.match(r"\(?(\S+) ± (\S+?)\)?(?:·10(\S))? px/s²", curvature(page))
        assert found is not None, curvature(page)
        power = 10.0 ** "⁰¹²³⁴⁵⁶⁷⁸⁹".index(found[3] or "⁰")
        value, std = power * float(found[1]), power * float(found[2])
        assert abs(value - 2.0 * FALL * 240.0**2) < 4.0 * std
        assert std < 0.05 * value
        page.fill("[data-test=fit-to]", page.input_value("[data-test=fit-from]"))
        page.click("[data-test=fit]")
        until(page, lambda: "too few" in page.inner_text("[data-test=fit-problem]"))


@pytest.mark.slow
def test_a_reload_while_measuring_the_outline_by_keyboard_and_german(
    browser: Any, tmp_path: Path
) -> None:
    path = falling(tmp_path / "drop")
    (tmp_path / "drop.toml").write_text("[camera]\ncapture_fps = 240\n")
    file = corrections_file(path)
    with served(str(path)) as address:
        page = opened_plain(browser.new_context(color_scheme="dark"), address)
        page.wait_for_selector("[data-test=busy]")
        page.reload()
        page.wait_for_selector("[data-test^=figure-]")
        assert page.get_attribute("[data-test=dark]", "aria-checked") == "true"
        stage = page.locator("[data-test=stage]")
        stage.focus()
        for _ in range(10):
            page.keyboard.press("ArrowRight")
        until(page, lambda: shown(page) == 10)
        page.click("[data-test=point-outline]")
        until(page, lambda: "vs-pointing" in stage.get_attribute("class"))
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        until(page, lambda: file.is_file() and bool(read_corrections(file).ball))
        mark = read_corrections(file).ball[0]
        assert (mark.frame, mark.moved) == (10, True)
        assert abs(mark.x_px - 61.0) < 0.5
        page.wait_for_selector("[data-test=busy]", state="detached")
        page.click("[data-test=language]")
        page.click(".q-menu >> text=Deutsch")
        until(page, lambda: stage.get_attribute("data-graphs") == "ready")
        graph = page.locator("[data-test=graphs] figure", has_text="Geschwindigkeit")
        axis = "id => getElement(id).chart.getOption().yAxis[0]"
        found = graph.locator(".va-graph").get_attribute("id").removeprefix("c")
        assert page.evaluate(f"({axis})({found})")["name"].startswith("Geschwindigkeit / ")
        light = page.evaluate(f"({axis})({found})")["axisLabel"]["color"]
        page.click("[data-test=dark]")
        until(page, lambda: page.evaluate(f"({axis})({found})")["axisLabel"]["color"] != light)


@pytest.mark.slow
def test_several_clips_dropped_together_become_a_folder(browser: Any, tmp_path: Path) -> None:
    places = [ROOT / "docs" / "lessons" / f"{name}.mp4" for name in ("drop", "throw")]
    with served(cwd=tmp_path) as address:
        page = opened_plain(browser, address)
        page.wait_for_selector("input[type=file]", state="attached")
        page.set_input_files("input[type=file]", places)
        page.wait_for_selector("[data-test='clip-throw.mp4']")
        assert "2 waiting" in page.inner_text("[data-test=counts]")
        assert {one.name for one in (tmp_path / "clips").glob("*.mp4")} == {"drop.mp4", "throw.mp4"}
        page.click("[data-test=sheet] summary")
        sheet = page.input_value("[data-test=pasted]")
        assert sheet.splitlines()[0] == "clip\tball\tbackswing_deg\tsession"
        page.fill("[data-test=pasted]", sheet.replace("drop.mp4\t", "drop.mp4\tjokku"))
        page.click("[data-test=paste]")
        until(page, lambda: (tmp_path / "clips" / "trials.csv").is_file())


@pytest.mark.slow
def test_the_clips_of_a_chosen_folder_become_one(browser: Any, tmp_path: Path) -> None:
    chosen, home = tmp_path / "filmed", tmp_path / "home"
    home.mkdir()
    chosen.mkdir()
    (chosen / "notes.txt").write_text("none")
    for name in ("drop.mp4", "throw.mp4"):
        shutil.copyfile(ROOT / "docs" / "lessons" / name, chosen / name)
    with served(cwd=home) as address:
        page = opened_plain(browser, address)
        with page.expect_file_chooser() as asked:
            page.click("[data-test=choose-folder]")
        asked.value.set_files(chosen)
        page.wait_for_selector("[data-test='clip-throw.mp4']")
        assert "left out" in page.inner_text(".q-notification")
        assert {one.name for one in (home / "clips").iterdir()} == {"drop.mp4", "throw.mp4"}


@pytest.mark.slow
def test_a_stick_in_the_frame_sets_the_scale(browser: Any, tmp_path: Path) -> None:
    path = falling(tmp_path / "drop")
    (tmp_path / "drop.toml").write_text("[camera]\ncapture_fps = 240\n")
    file = corrections_file(path)
    # 80 px; the ball then falls with gravity
    length = 80.0 * 9.81 / (2.0 * FALL * 240.0**2)
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        page.wait_for_selector("[data-test=stage][data-shown]")
        page.fill("[data-test=stick-length]", f"{length:.5f} m ± 0.1 mm")
        page.click("[data-test=point-end0]")
        page.mouse.click(*on_stage(page, 20.0, 150.0))
        until(page, lambda: page.locator(".vs-point").count() == 1)
        # the other end by keyboard, from the middle
        page.keyboard.press("ArrowUp")
        page.keyboard.press("Enter")
        until(page, lambda: file.is_file() and read_corrections(file).stick is not None)
        held = read_corrections(file).stick
        assert held is not None
        assert (held.x1_px, held.y1_px) == (59.5, 98.5)
        page.wait_for_selector("[data-test=stage]:not(.vs-pointing)")
        dragged(page, (held.x1_px, held.y1_px), (100.0, 150.0))
        until(page, lambda: "--scale" in page.inner_text("[data-test=as_command]"))
        until(page, lambda: (there := read_corrections(file).stick) is not None and there != held)
        moved = read_corrections(file).stick
        assert moved is not None
        assert abs(moved.x1_px - moved.x0_px - 80.0) < 1.5
        page.wait_for_selector("[data-test=figure-fall_acceleration]")
        page.wait_for_selector("[data-test=busy]", state="detached")
        fall = page.inner_text("[data-test=figure-fall_acceleration]")
        value, std = map(float, re.search(r"([\d.]+)\s*± ([\d.]+) m/s²", fall).groups())
        assert abs(value - 9.81) < 3.0 * std
        page.click("[data-test=undo]")
        until(page, lambda: read_corrections(file).stick == held)
        page.click("[data-test=undo]")
        until(page, lambda: page.locator(".vs-point").count() == 0)
        page.fill("[data-test=stick-length]", "3 kg")
        for x in (20.0, 90.0):
            if x == 20.0:
                page.click("[data-test=point-end0]")
            page.mouse.click(*on_stage(page, x, 150.0))
            page.wait_for_timeout(600)
        until(page, lambda: "3 kg" in page.inner_text(".q-notification"))


@pytest.mark.slow
def test_mass_pivot_landing_and_axes_are_dragged(browser: Any, tmp_path: Path) -> None:
    path, wide = tmp_path / "strike.mp4", 208
    for suffix in (".mp4", ".toml"):
        shutil.copyfile(CLIP.with_suffix(suffix), path.with_suffix(suffix))
    file = corrections_file(path)
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        page.wait_for_selector("[data-test=busy]")
        page.wait_for_selector("[data-test=busy]", state="detached")
        page.focus("[data-test=stage]")
        page.keyboard.press("Home")
        until(page, lambda: shown(page) == 0)
        until(page, lambda: page.locator("circle.vs-mass").count() == 2)
        circle = page.locator("circle.vs-mass").first
        x, y = (float(circle.get_attribute(name)) for name in ("cx", "cy"))
        dragged(page, (x, y), (x + 3.0, y - 2.0), wide)
        until(page, lambda: file.is_file() and read_corrections(file).mass is not None)
        mass = read_corrections(file).mass
        assert mass is not None
        assert (mass.frame, mass.moved) == (0, False)
        assert (mass.x_px, mass.y_px) == pytest.approx((x + 3.0, y - 2.0), abs=0.3)

        def place_of(kind: str) -> list[float]:
            until(page, lambda: len(page.evaluate(f"visionViewer.at('{kind}')")) == 2)
            return list(page.evaluate(f"visionViewer.at('{kind}')"))

        for kind in FIXED_POINTS:
            x, y = place_of(kind)
            dragged(page, (x, y), (x + 5.0, y - 4.0), wide)
            until(page, lambda kind=kind: getattr(read_corrections(file), kind) is not None)
            there = getattr(read_corrections(file), kind)
            assert there == pytest.approx((x + 5.0, y - 4.0), abs=0.3)

        page.click("[data-test=point-axes]")
        page.wait_for_selector("[data-test=stage].vs-pointing")
        page.mouse.click(*on_stage(page, 100.0, 70.0, wide))
        until(page, lambda: read_corrections(file).axes is not None)
        page.wait_for_selector("[data-test=stage]:not(.vs-pointing)")
        dragged(page, place_of("axes"), (110.0, 60.0), wide)
        until(page, lambda: abs(read_corrections(file).axes.x_px - 110.0) < 0.3)
        until(page, lambda: abs(place_of("axes")[0] - 110.0) < 0.3)
        # 30° counter-clockwise
        dragged(page, place_of("axes_x"), (110.0 + 34.6, 60.0 - 20.0), wide)
        until(page, lambda: read_corrections(file).axes.turn_deg != 0.0)
        axes = read_corrections(file).axes
        assert axes is not None
        assert (axes.x_px, axes.y_px) == pytest.approx((110.0, 60.0), abs=0.3)
        assert axes.turn_deg == pytest.approx(30.0, abs=0.7)


@pytest.mark.slow
def test_the_cure_of_a_contradiction_is_a_button(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "throw.mp4"
    shutil.copyfile(ROOT / "docs" / "lessons" / "throw.mp4", path)
    # filmed with 240 frames per second
    corrections_file(path).write_text(
        '[inputs]\nfps = "120"\nball = "201.75 mm"\nwall_grid = "50 mm"\n'
    )
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        page.wait_for_selector("[data-test=cure-fps]")
        assert "240" in page.inner_text("[data-test=cure-fps]")
        page.click("[data-test=cure-fps]")
        page.wait_for_selector("[data-test=cure-fps]", state="detached")
        page.wait_for_selector("[data-test=figure-flight_speed]")
        assert read_corrections(corrections_file(path)).inputs.fps == "240"
        page.click("[data-test=undo]")
        page.wait_for_selector("[data-test=cure-fps]")


def curvature(page: Any) -> str:
    return str(page.inner_text("[data-test=term-curvature]"))


@pytest.mark.slow
def test_no_page_has_a_serious_fault_of_accessibility(browser: Any, tmp_path: Path) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    (tmp_path / "clips").mkdir()
    for file in (CLIP, CLIP.with_suffix(".toml")):
        shutil.copyfile(file, tmp_path / "clips" / file.name)

    def faults(page: Any, ready: str) -> list[str]:
        page.wait_for_selector(f"[data-test={ready}]")
        page.wait_for_timeout(800)
        found = axe.run(page).response["violations"]
        return [f"{ready}: {one['id']}" for one in found if one["impact"] in _SERIOUS]

    with served(cwd=tmp_path) as address:
        page = opened_plain(browser, address)
        assert faults(page, "sample-strike") == []
        page.fill("[data-test=place]", str(tmp_path / "clips" / CLIP.name))
        page.click("[data-test=open]")
        page.click("[data-test=fit]")
        assert faults(page, "fitted") == []
        page.click("[data-test=dark]")
        assert faults(page, "stage") == []
        for name, ready in (("setup", "panel"), ("export", "sheet"), ("why", "explain")):
            page.click(f"[data-test=page-{name}]")
            assert faults(page, ready) == []
        page.click("[data-test=explain]")
        assert faults(page, "sentence") == []
        page.click("[data-test=page-open]")
        page.fill("[data-test=place]", str(tmp_path / "clips"))
        page.click("[data-test=open]")
        assert faults(page, "counts") == []
        page.click("[data-test=sheet] summary")
        assert faults(page, "pasted") == []
        page.click("[data-test=measure-all]")
        assert faults(page, "mark") == []
        page.fill("[data-test^=clip-] input", "the ball was not at rest")
        page.click("[data-test=mark]")
        assert faults(page, "unmark") == []
        page.click("[data-test=dark]")
        assert faults(page, "counts") == []


_SERIOUS = ("serious", "critical")
"""Impacts of a violation that shut a reader out (axe-core)."""


def test_a_broken_clip_is_a_sentence_on_the_page(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "broken.mp4"
    path.write_bytes(b"not a video" * 100)
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        until(page, lambda: "broken.mp4" in page.inner_text("[data-test=problem]"))
        assert "Traceback" not in page.inner_text("body")


def test_a_dropped_clip_opens_and_the_browser_goes_back(browser: Any, tmp_path: Path) -> None:
    with served(cwd=tmp_path) as address:
        page = opened_plain(browser, address)
        page.wait_for_selector("[data-test=sample-strike]")
        page.fill("[data-test=place]", str(tmp_path / "<i>none.mp4"))
        page.click("[data-test=open]")
        until(page, lambda: "<i>none.mp4" in page.inner_text("[data-test=problem]"))
        page.set_input_files("input[type=file]", ROOT / "docs" / "lessons" / "drop.mp4")
        page.wait_for_selector("[data-test=stage]")
        assert (tmp_path / "drop.mp4").is_file()
        page.click("[data-test=page-export]")
        # before the server has answered
        page.go_back()
        page.wait_for_selector("[data-test=stage]")
        page.go_back()
        page.wait_for_selector("[data-test=sample-strike]")
        until(page, lambda: "drop.mp4" in page.inner_text("[data-test=recent] >> nth=0"))


def test_a_clip_is_set_up_and_measured_with_the_file(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "strike.mp4"
    shutil.copyfile(CLIP, path)
    corrections_file(path).write_text('[inputs]\nfps = "600"\nwall_grid = "50mm"\nball = "jokku"\n')
    with served(str(path)) as address:
        page = opened_plain(browser, address)
        page.wait_for_selector("[data-test=stage]")
        page.click("[data-test=page-setup]")
        page.wait_for_selector("[data-test=outlook]")
        until(page, lambda: page.input_value("[data-test=fps]") == "600")
        page.click("[data-test=measure]")
        page.wait_for_selector("[data-test=numbers]")
        page.wait_for_selector("[data-test=stage]")
        assert "--setup" in page.inner_text("[data-test=repeats]")
        assert read_corrections(corrections_file(path)).inputs == ClipInputs(setup="setup.toml")
        assert load_setup(tmp_path / "setup.toml").wall.grid == 0.05


def test_nobody_else_comes_in_and_nothing_is_loaded_from_outside(
    browser: Any, tmp_path: Path
) -> None:
    with served(str(falling(tmp_path / "clip", frames=2))) as address:
        home = address.partition("/?")[0]
        for path in ("/", "/frame/1/0", "/marks/1/0", "/app/style.css"):
            with pytest.raises(urllib.error.HTTPError) as refused:
                urllib.request.urlopen(home + path)
            assert refused.value.code == 403
            assert "default-src 'self'" in refused.value.headers["content-security-policy"]
            refused.value.close()
        asked: list[str] = []
        page = browser.new_page()
        page.on("request", lambda one: asked.append(one.url))
        page.goto(address)
        page.wait_for_selector("[data-test=stage]")
        assert [url for url in asked if not url.startswith((home, "ws://127", "data:"))] == []
        for path in ("/frame/1/9", "/frame/2/0", "/frame/..%2fetc", "/app/shell.py", "/marks/9/0"):
            assert page.request.get(home + path).status in (404, 422)
