"""Tracks read and written by what the file is."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from metrology import UsageError, write_text_whole, written_whole
from pipelines.interop.columns import ask_columns, keep_columns
from pipelines.interop.external import PENDULUM, ExternalTracks, as_track_table
from pipelines.interop.kinovea import kinovea_annotations, read_kva
from pipelines.interop.tables import (
    HDF5_SUFFIXES,
    TABLE_SUFFIXES,
    header_of,
    is_of_a_program,
    read_table_of_tracks,
)
from pipelines.interop.tracker import read_trk, tracker_project
from pipelines.measure.metres import centre_of_arc
from pipelines.setup.file import load_setup
from pipelines.terminal import screen

__all__ = [
    "PROJECT_SUFFIXES",
    "made_elsewhere",
    "read_tracks",
    "settled_columns",
    "track_table",
    "write_tracks",
]

PROJECT_SUFFIXES = (".trk", ".trz", ".kva")
"""Files of other programs that are no tables."""


def made_elsewhere(path: Path, columns: Mapping[str, str]) -> bool:
    """Whether a file is another program's, or a table whose columns somebody named.

    Parameters
    ----------
    path : Path
    columns : mapping of str to str
        As `columns.parse_columns`.
    """
    suffix = path.suffix.lower()
    if suffix in PROJECT_SUFFIXES or suffix in HDF5_SUFFIXES:
        return True
    if suffix not in TABLE_SUFFIXES or not path.is_file():
        return False
    return bool({"t", "frame", "x", "y"} & columns.keys()) or is_of_a_program(path)


def settled_columns(path: Path, said: Mapping[str, str], setup: Path | None) -> dict[str, str]:
    """What the columns are; what nobody said is asked on a terminal, once.

    Parameters
    ----------
    path : Path
        A table of tracks, or a file that needs no asking.
    said : mapping of str to str
    setup : Path or None
        Gets the answers as its table ``[columns]``, where it has none.
    """
    if not path.is_file():
        return dict(said)
    answers = ask_columns(header_of(path), said, path.name)
    if answers != dict(said) and setup is not None:
        if load_setup(setup).columns:
            return answers
        keep_columns(setup, answers)
        screen(errors=True).print(f"kept in the table [columns] of {setup}", soft_wrap=True)
    return answers


def track_table(path: Path, columns: Mapping[str, str]) -> pd.DataFrame:
    """Another program's tracks as the rows that `vision measure --tracks` writes.

    The pendulum's rows get the angle about the centre of the arc that they lie on, 0 straight down.

    Raises
    ------
    UsageError
        As `read_tracks`.
    """
    table = as_track_table(read_tracks(path, columns).chosen(columns))
    swing = table["object"] == PENDULUM
    if swing.any():
        arm = table.loc[swing, ["x_px", "y_px"]].to_numpy(float)
        arm = arm - centre_of_arc(arm)
        table.loc[swing, "phi_rad"] = np.arctan2(arm[:, 0], arm[:, 1])
    return table


def read_tracks(path: Path, columns: Mapping[str, str] | None = None) -> ExternalTracks:
    """Read tracks of Tracker, Kinovea, trackpy, DeepLabCut, SLEAP, or any table.

    Parameters
    ----------
    path : Path
    columns : mapping of str to str, optional
        Which column is which, and which track is the ball (`columns.parse_columns`).

    Raises
    ------
    UsageError
        If it can't be read, is of no kind that is known, or does not tell what is what.
    """
    said = columns or {}
    suffix = path.suffix.lower()
    if not path.exists():
        raise UsageError(f"there is no file {path}")
    if suffix in (".trk", ".trz"):
        return read_trk(path)
    if suffix == ".kva":
        return read_kva(path)
    if suffix in TABLE_SUFFIXES:
        return read_table_of_tracks(path, said)
    known = ", ".join((*PROJECT_SUFFIXES, *TABLE_SUFFIXES))
    raise UsageError(f"{path}: its name does not say what it is", hint=f"Known are {known}.")


def write_tracks(path: Path, external: ExternalTracks) -> None:
    """Write tracks as Tracker (.trk), Kinovea (.kva), CSV or XLSX; whole or not at all.

    Raises
    ------
    UsageError
        If the name does not say which.
    """
    suffix = path.suffix.lower()
    if suffix == ".trk":
        write_text_whole(path, tracker_project(external))
    elif suffix == ".kva":
        write_text_whole(path, kinovea_annotations(external))
    elif suffix == ".csv":
        text = as_track_table(external).to_csv(
            index=False, lineterminator="\n", float_format="%.8g"
        )
        write_text_whole(path, text)
    elif suffix == ".xlsx":
        with written_whole(path) as temporary:
            as_track_table(external).to_excel(temporary, index=False)
    else:
        raise UsageError(
            f"{path}: its name does not say what kind of file it is",
            hint="Name a file that ends in .trk, .kva, .csv or .xlsx.",
        )
