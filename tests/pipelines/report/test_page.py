"""The page holds every number, its reasons and budgets, escaped, and needs nothing from outside."""

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from metrology import Quantity, UsageError
from pipelines.report import ReportInput, quantity_label
from pipelines.report.page import report_html, write_report
from pipelines.report.plots import write_plot
from tests.pipelines.calibrate.wizard_page import chromium
from tests.pipelines.report.example import example

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


@pytest.fixture(scope="module")
def page():
    return report_html(example(PIXEL))


def text_of(page):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page.split("<body>")[1]))


def test_results_with_uncertainty_unit_and_interval(page):
    text = text_of(page)
    assert re.search(r"ball speed at release 6\.3610 0\.0097 m/s 0\.15 % 6\.3417 to 6\.3803", text)
    assert re.search(r"launch angle 12\.341 0\.078 °", text)
    assert "not measured: the ball leaves the frame at 0.31 s" in text


def test_five_results_and_the_picture_come_first_and_the_rest_is_folded(page):
    first = page.split("<body>")[1].partition("<details")[0]
    assert 1 < first.count("<b>") <= 5
    assert "± 0.0097 m/s" in first
    assert "data:image/png" in first
    assert "95 % interval" not in first
    assert page.index("<summary>All results") < page.index("95 % interval (k = 2)")


def test_a_reason_that_several_share_is_told_once_with_all_their_names():
    shared = "it needs a swing, and what is seen is a <strike>"
    names = ("swing_period", "swing_damping")
    missing = tuple(Quantity.missing(name, "s", shared) for name in names)
    alone = Quantity.missing("landing_distance", "m", "the ball leaves the frame")
    page = report_html(ReportInput("clip", (), (*missing, alone)))
    text = text_of(page)
    assert text.count("it needs a swing") == 1
    for item in missing:
        assert quantity_label(item.name) in text.split("Not measured:")[1]
    assert "not measured: the ball leaves the frame" in text
    assert "<strike>" not in page


def test_budget_is_ranked_and_its_shares_add_up(page):
    budget = re.search(r"<summary><b>ball speed at release.*?</details>", page, re.DOTALL).group(0)
    sources = re.findall(r"<tr><td>(.*?)</td>", budget)
    assert sources == ["length scale", "picture noise", "capture rate"]
    shares = [int(share) for share in re.findall(r">(\d+) %</td>", budget)]
    assert sum(shares) in (99, 100, 101)
    assert shares[0] > 80


def test_checks_and_warnings(page):
    assert page.count('<li class="passed">') == page.count('<li class="failed">') == 1
    assert page.count('<li class="open">') == 1
    assert "&lt;no&gt; distance" in page


def test_names_from_outside_are_escaped():
    evil = "<script>alert(1)</script>.mp4"
    missing = Quantity.missing("ball_speed", "m/s", evil)
    page = report_html(ReportInput(evil, (("clip", evil),), (missing,), warnings=(evil,)))
    assert "<script>alert" not in page
    assert page.count("&lt;script&gt;") >= 4


def test_defaults_are_told_where_any_were_taken(page):
    told = ("inertia: 1.579 ± 0.016 kg m² (its uncertainty is a default: <period>)",)
    with_defaults = report_html(replace(example(PIXEL), defaults=told))
    assert "Default values used" in with_defaults
    assert "is a default: &lt;period&gt;)" in with_defaults
    assert "Default values used" not in page


def test_nothing_is_fetched(page):
    assert not re.search(r"(src|href)=[\"'](?!data:)", page)
    assert "<script>alert" not in page
    assert "@import" not in page


def test_four_plots_and_the_still_are_inside(page):
    assert page.count("data:image/svg+xml;base64,") == 4
    assert "data:image/png;base64," in page
    for uri in re.findall(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)", page):
        assert b"</svg>" in base64.b64decode(uri)


def test_plots_without_data_are_left_out():
    bare = replace(example(), gap=None, path=None, speeds=())
    assert "data:image/svg" not in report_html(bare)
    with pytest.raises(UsageError, match="nothing to plot"):
        write_plot(Path("unused.png"), bare)


def test_the_same_measurement_gives_the_same_page(page):
    assert report_html(example(PIXEL)) == page


def test_files_are_written_whole(tmp_path):
    write_report(tmp_path / "report.html", example())
    assert (tmp_path / "report.html").read_text(encoding="utf-8").rstrip().endswith("</html>")
    for name, start in (("plot.png", b"\x89PNG"), ("plot.svg", b"<?xml")):
        write_plot(tmp_path / name, example())
        assert (tmp_path / name).read_bytes().startswith(start)
    with pytest.raises(UsageError, match=r"\.png or \.svg"):
        write_plot(tmp_path / "plot.gif", example())
    with pytest.raises(UsageError):
        write_report(tmp_path / "no" / "report.html", example())
    assert len(list(tmp_path.iterdir())) == 3


def test_labels_of_known_and_new_quantities():
    assert quantity_label("cor_range") == "COR from the range (Eq. 17)"
    assert quantity_label("impact_speed") == "impact speed"


def test_lone_values_without_uncertainty_print():
    page = report_html(ReportInput("a", (), (Quantity("energy_loss", 1.25, None, "J"),)))
    assert "1.25" in text_of(page)


def test_what_was_seen_is_told_and_escaped(page):
    told = (("strike, probability 0.98", "It lay still & <left>."),)
    with_seen = report_html(replace(example(PIXEL), seen=told))
    assert "<b>strike, probability 0.98</b>: It lay still &amp; &lt;left&gt;." in with_seen
    assert "Objects and motion" not in page


@pytest.mark.slow
def test_a_graph_is_read_and_enlarged_without_a_network(tmp_path):
    file = tmp_path / "report.html"
    file.write_text(report_html(example(PIXEL)), encoding="utf-8")
    with chromium() as browser:
        page = browser.new_page()
        asked: list[str] = []
        page.on("request", lambda one: asked.append(one.url))
        page.goto(file.as_uri())
        plot = page.locator(".plot").first
        drawn = json.loads(plot.get_attribute("data-plot"))
        x, y = drawn["series"][-1][1][0]
        left, bottom, right, top = drawn["box"]
        u, v = (
            (value - low) / (high - low)
            for value, (low, high) in ((x, drawn["x"]), (y, drawn["y"]))
        )
        box = plot.locator("img").bounding_box()
        at = (
            box["x"] + box["width"] * (left + u * (right - left)),
            box["y"] + box["height"] * (1 - bottom - v * (top - bottom)),
        )
        page.mouse.move(*at)
        assert f": {x}, {y}" in plot.locator("output").inner_text()
        page.mouse.dblclick(*at)
        assert plot.locator("img").bounding_box()["width"] == pytest.approx(
            3 * box["width"], rel=0.01
        )
        # the point stays under the pointer
        page.mouse.move(at[0] + 1, at[1])
        assert f": {x}, {y}" in plot.locator("output").inner_text()
        plot.focus()
        page.keyboard.press("Enter")
        assert plot.locator("img").bounding_box()["width"] == pytest.approx(box["width"])
    assert [one for one in asked if not one.startswith(("file:", "data:"))] == []
