"""Files of a measurement for the page Export, by the writers of the command line."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from measuring.inputs import main_quantities
from measuring.measurement import QUANTITY_UNITS, ClipMeasurement
from metrology import write_text_whole, written_whole
from pipelines.measure.files import (
    WantedFiles,
    column_of,
    measurement_as_row,
    report_input,
    without_formulas,
)
from pipelines.report.inputs import ReportInput
from pipelines.report.page import report_html, write_report
from vision.clip.clip import ClipReader

__all__ = ["EXPORTS", "Export", "sheet_html", "written"]


Word = Callable[[str], str]
Writer = Callable[[Path, ClipMeasurement, str, Word], None]


@dataclass(frozen=True)
class Export:
    """A kind of file.

    Attributes
    ----------
    ending : str
        Added to the clip's name.
    write : callable
        Takes the file's path, the measurement, the Python text that repeats it, and the function
        that words messages as the page does.
    """

    key: str
    ending: str
    write: "Writer"

    def path_for(self, clip: Path) -> Path:
        """File next to the clip."""
        return clip.with_name(f"{clip.name}{self.ending}")


def _by(option: str) -> Writer:
    """Writer of an option of `vision measure`."""

    def write(path: Path, measured: ClipMeasurement, python: str, word: Word) -> None:
        value: Any = str(path) if option == "json" else path
        wanted = WantedFiles(**{option: value})
        wanted.write(measured, measured.info.path, tuple(QUANTITY_UNITS))

    return write


def _write_workbook(path: Path, measured: ClipMeasurement, python: str, word: Word) -> None:
    """Clip and main quantities, at most thirteen columns; all columns on a second sheet."""
    import pandas as pd

    row = without_formulas(measurement_as_row(measured))
    main = main_quantities(measured.motion.measured_as)
    columns = [column_of(measured.quantity(name)) for name in main if name in QUANTITY_UNITS]
    kept = ["clip", *(f"{name}{part}" for name in columns for part in ("", "_std"))]
    table = pd.DataFrame([row])
    with (
        written_whole(path) as temporary,
        pd.ExcelWriter(temporary, engine="openpyxl") as book,
    ):
        table[kept].to_excel(book, index=False, sheet_name="results")
        table.to_excel(book, index=False, sheet_name="all columns")


def _write_report(path: Path, measured: ClipMeasurement, python: str, word: Word) -> None:
    write_report(path, _shown(measured, word))


def _write_notebook(path: Path, measured: ClipMeasurement, python: str, word: Word) -> None:
    """A notebook that repeats the measurement and plots it."""

    def cell(number: int, text: str) -> dict[str, Any]:
        lines = text.splitlines(keepends=True)
        about: dict[str, Any] = {"id": f"cell-{number}", "metadata": {}, "source": lines}
        return {"cell_type": "code", "execution_count": None, "outputs": [], **about}

    cells = [cell(k, text) for k, text in enumerate((python, "m.plot()", "m.tracks.head()"))]
    document = {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    write_text_whole(path, json.dumps(document, indent=1) + "\n")


EXPORTS = (
    Export("report", ".report.html", _write_report),
    Export("workbook", ".xlsx", _write_workbook),
    Export("csv", ".results.csv", _by("csv")),
    Export("json", ".json", _by("json")),
    Export("tracks", ".tracks.csv", _by("tracks")),
    Export("tracker", ".trk", _by("tracks")),
    Export("kinovea", ".kva", _by("tracks")),
    Export("overlay", ".overlay.mp4", _by("overlay")),
    Export("notebook", ".ipynb", _write_notebook),
)
"""Kinds of files, in the order of the page."""


def written(
    export: Export, clip: Path, measured: ClipMeasurement, python: str, word: Word = str
) -> Path:
    """Write one file next to the clip; return its path.

    `python` repeats the measurement, `word` words its messages as the page does.

    Raises
    ------
    UsageError
        If it can't be written.
    """
    path = export.path_for(clip)
    export.write(path, measured, python, word)
    return path


def _shown(measured: ClipMeasurement, word: Word) -> ReportInput:
    clip = ClipReader.open(measured.info.path, every=measured.info.every, least_frames=1)
    return report_input(measured, clip).worded(word)


def sheet_html(
    measured: ClipMeasurement, command: str, label: Callable[[str], str], word: Word = str
) -> str:
    """One A4 page: main numbers, the frame at contact, graphs, messages.

    Parameters
    ----------
    command : str
        That repeats it.
    label : callable
        Label of a quantity.
    word : callable
        Words messages as the page does.
    """
    return report_html(_shown(measured, word), command=command, label=label)
