"""Read corrected tables of detections and tracklets back."""

from pathlib import Path

from pipelines.interop.sheets import read_table
from pipelines.interop.tables import header_of
from vision.stages import GivenObjects, given_objects

__all__ = ["is_corrected", "read_corrected"]

_DETECTION_COLUMNS = {"sharpness", "evenness", "light"}
"""Columns that no other program's table has."""


def is_corrected(path: Path) -> bool:
    """Whether a file is a table of `vision measure --detections` or `--tracklets`."""
    return path.is_file() and len(_DETECTION_COLUMNS & {*header_of(path)}) > 1


def read_corrected(path: Path) -> GivenObjects:
    """Objects of a corrected table.

    Parameters
    ----------
    path : Path
        CSV with any separator and decimals, or XLSX.

    Raises
    ------
    UsageError
        If it can't be read, or `vision.stages.given_objects` refuses its content.
    """
    return given_objects(read_table(path, "a table of objects"))
