"""Files of the page Export: each is what the command line writes, or can be read again."""

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import openpyxl
import pandas as pd
import pytest

from measuring.chain import measure_clip
from metrology import UsageError
from pipelines.api.quantities import measure_options
from pipelines.app.exports import EXPORTS, sheet_html, written
from pipelines.app.words import on_page, says
from pipelines.report.inputs import quantity_label
from tests.pipelines.app.small import strike
from vision.clip.clip import ClipReader

BY_KEY = {one.key: one for one in EXPORTS}


def test_the_tables_hold_the_numbers(tmp_path: Path) -> None:
    measured = strike()
    clip = tmp_path / "=strike.mp4"
    speed = measured.quantity("ball_speed").value
    csv = pd.read_csv(written(BY_KEY["csv"], clip, measured, ""))
    assert csv["ball_speed_m_s"][0] == pytest.approx(speed)
    document = json.loads(written(BY_KEY["json"], clip, measured, "").read_text())
    assert document["quantities"]["ball_speed"]["value"] == speed
    tracks = pd.read_csv(written(BY_KEY["tracks"], clip, measured, ""))
    assert {"ball", "pendulum"} <= set(tracks["object"])
    book = openpyxl.load_workbook(written(BY_KEY["workbook"], clip, measured, ""))
    header, row = book["results"].iter_rows(values_only=True)
    assert len(header) <= 13
    assert dict(zip(header, row, strict=True))["ball_speed_m_s"] == pytest.approx(speed)
    assert len(list(book["all columns"].columns)) > 30


def test_the_video_the_projects_and_the_report_are_written(tmp_path: Path) -> None:
    measured, clip = strike(), tmp_path / "strike.mp4"
    made = ClipReader.open(written(BY_KEY["overlay"], clip, measured, ""))
    assert made.info.frames == measured.info.frames
    for key in ("tracker", "kinovea", "report"):
        assert written(BY_KEY[key], clip, measured, "").stat().st_size > 1000


def test_the_notebook_repeats_the_measurement(tmp_path: Path) -> None:
    python = "import impact_vision as iv\n\nm = iv.measure('a.mp4')\nprint(m)"
    path = written(BY_KEY["notebook"], tmp_path / "a.mp4", strike(), python)
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert notebook.cells[0].source == python


def test_what_can_not_be_written_is_a_sentence(tmp_path: Path) -> None:
    for export in EXPORTS:
        with pytest.raises(UsageError) as refused:
            written(export, tmp_path / "nowhere" / "a.mp4", strike(), "")
        assert refused.value.hint
    assert list(tmp_path.iterdir()) == []


def test_the_sheet_has_the_main_numbers_and_requests_nothing() -> None:
    text = sheet_html(strike(), "vision measure '<b>.mp4'", quantity_label)
    assert "contact time" in text
    assert "<b>.mp4" not in text
    assert text.count("<img") == 3
    assert not re.search(r"(src|href)=\"(?!data:)", text)


def test_a_throw_has_graphs_and_the_page_names_its_fields(tmp_path: Path) -> None:
    path = strike().info.path.parents[2] / "docs" / "lessons" / "throw.mp4"
    options = measure_options(ball="0.2 m", cache=True)
    measured = measure_clip(path, options)
    plain = sheet_html(measured, "vision measure throw.mp4", quantity_label)
    assert "--fps" in plain
    shown = sheet_html(measured, "", quantity_label, partial(on_page, say=says("en")))
    assert "Capture rate" in shown
    assert not re.search(r"--(fps|ball|wall-grid|scale|ball-at)\b", shown)
    with_scale = measure_clip(path, replace(options, fps=240.0))
    shown = sheet_html(with_scale, "", quantity_label)
    assert "Path of the ball" in shown
    assert "Speeds" in shown
