"""Tracks of other programs in one form; safe reading of XML and ZIP files."""

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from enum import StrEnum
from pathlib import Path
from typing import Self
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import pandas as pd
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray

from metrology import UsageError
from metrology.files import starts_as_text

__all__ = [
    "BALL_NAME",
    "FOREIGN",
    "PENDULUM_OBJECT",
    "ExternalTrack",
    "ExternalTracks",
    "PlaneOfMotion",
    "Program",
    "as_track_table",
    "is_text",
    "numbers",
    "read_bytes",
    "read_member",
    "root_of",
    "text_of",
]

FloatArray = NDArray[np.float64]

IntArray = NDArray[np.int64]

BALL_NAME, PENDULUM_OBJECT = "ball", "pendulum"

"""Object names of the track table of `vision measure`."""


_CALLED = {
    BALL_NAME: frozenset({"ball", "kugel", "balle", "ballon", "pelota", "balón", "bola", "palla"}),
    PENDULUM_OBJECT: frozenset(
        {"pendulum", "mass", "hammer", "bob", "pendel", "masse", "pendule", "marteau", "péndulo"}
    ),
}
"""Names of tracks that need no `--columns`."""


class Program(StrEnum):
    """The program that wrote the file."""

    TRACKER = "Tracker"
    KINOVEA = "Kinovea"
    TRACKPY = "trackpy"
    DEEPLABCUT = "DeepLabCut"
    SLEAP = "SLEAP"
    IMPACT_VISION = "impact-vision"
    TABLE = "a table"


@dataclass(frozen=True, eq=False)
class PlaneOfMotion:
    """Scale and axes of the other program, in the plane of motion.

    Attributes
    ----------
    px_per_m : float
    relative_std : float
        Relative standard uncertainty of the scale, if the file gives one.
    origin_px : (2,) array
        Position of x = y = 0; pixel centres are integers.
    turn_rad : float
        Angle of the x axis above the image rows, counterclockwise, rad.
    """

    px_per_m: float
    relative_std: float
    origin_px: FloatArray
    turn_rad: float = 0.0

    def metres(self, px: FloatArray) -> FloatArray:
        """Convert points (N, 2) of the image to metres, y 90° counterclockwise from x."""
        x, y = (np.asarray(px, dtype=float) - self.origin_px).T
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.column_stack([x * cosine - y * sine, -x * sine - y * cosine]) / self.px_per_m

    def pixels(self, metres: FloatArray) -> FloatArray:
        """Inverse of `metres`."""
        x, y = (np.asarray(metres, dtype=float) * self.px_per_m).T
        cosine, sine = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turned = np.column_stack([x * cosine - y * sine, -x * sine - y * cosine])
        return np.asarray(turned + self.origin_px)


@dataclass(frozen=True, eq=False)
class ExternalTrack:
    """One object, one row per marked frame, in time order.

    Attributes
    ----------
    name : str
        Its name in the other program.
    frame : (N,) int array
        Index of the frame in its clip, from 0.
    px : (N, 2) array
        Pixel centres are integers, y points down. For a table in metres: at the scale of its
        `PlaneOfMotion`.
    time_s : (N,) array or None
        Times of the other program, s.
    std_px : (N, 2) array or None
        Standard uncertainty stated by the other program, px.
    radius_px : (N,) array or None
        Radius, if measured, px.
    """

    name: str
    frame: IntArray
    px: FloatArray
    time_s: FloatArray | None = None
    std_px: FloatArray | None = None
    radius_px: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def has_size(self) -> bool:
        """Whether its size was measured in every frame."""
        return self.radius_px is not None and bool(np.isfinite(self.radius_px).all())


@dataclass(frozen=True, eq=False)
class ExternalTracks:
    """Contents of a file of tracks.

    Attributes
    ----------
    path : Path
    program : Program
    tracks : tuple of ExternalTrack
    size : (2,) tuple of int or None
        Width and height of the frames, px.
    fps : float or None
        Frames per second of real time, as stated or implied by the times.
    plane : PlaneOfMotion or None
        None if the file contains only pixels.
    clip : str or None
        Name of the clip.
    notes : tuple of str
        Assumptions made on reading, in whole sentences.
    """

    path: Path
    program: Program
    tracks: tuple[ExternalTrack, ...]
    size: tuple[int, int] | None = None
    fps: float | None = None
    plane: PlaneOfMotion | None = None
    clip: str | None = None
    notes: tuple[str, ...] = ()

    def chosen(self, columns: Mapping[str, str]) -> Self:
        """Put the ball first and the pendulum, if any, second, with these names.

        Parameters
        ----------
        columns : mapping of str to str
            ``{"ball": "masa A", "pendulum": "bob"}``, needed if the names are not obvious.

        Raises
        ------
        UsageError
            If a name is not in the file, or the ball's track is ambiguous.
        """
        given = {one.name: one for one in self.tracks}
        ball, pendulum = (self._called(kind, columns) for kind in (BALL_NAME, PENDULUM_OBJECT))
        others = [name for name in given if name not in (ball, pendulum)]
        if ball is None and len(others) == 1:
            ball = others.pop()
        if ball is None and (pendulum is None or others):
            names = ", ".join(repr(name) for name in given) or "none"
            runs = all(name.startswith("run ") for name in given)
            raise UsageError(
                f"{self.path.name} holds several runs, of which one is measured: {names}"
                if runs
                else f"{self.path.name} does not state which track is the ball: {names}",
                hint=f'Pass --columns "ball={next(iter(given), "NAME")}", or set ball = "…" in the'
                " table [columns] of the setup file.",
            )
        named = [] if ball is None else [replace(given[ball], name=BALL_NAME)]
        named += [] if pendulum is None else [replace(given[pendulum], name=PENDULUM_OBJECT)]
        return replace(self, tracks=(*named, *(given[name] for name in others if name != ball)))

    def _called(self, kind: str, columns: Mapping[str, str]) -> str | None:
        names = [one.name for one in self.tracks]
        if kind in columns:
            if columns[kind] not in names:
                folded = {name.strip().casefold(): name for name in names}
                wanted = columns[kind].strip().casefold()
                if wanted in folded:
                    return folded[wanted]
                alike = get_close_matches(wanted, folded, n=1)
                meant = f"Did you mean {folded[alike[0]]!r}? " if alike else ""
                raise UsageError(
                    f"{self.path.name} has no track {columns[kind]!r}",
                    hint=f"{meant}It has: {', '.join(repr(name) for name in names)}.",
                )
            return columns[kind]
        called = [name for name in names if name.strip().casefold() in _CALLED[kind]]
        # "rig mass" of a subject called rig; Tracker's "mass A" is any body
        last = [name for name in names if name.casefold().rpartition(" ")[2] in _CALLED[kind]]
        return next((one[0] for one in (called, last) if len(one) == 1), None)


def as_track_table(external: ExternalTracks) -> pd.DataFrame:
    """Rows as written by `vision measure --tracks`; empty cells where the file has no value.

    Parameters
    ----------
    external : ExternalTracks
    """
    parts = []
    for track in external.tracks:
        time = track.time_s
        if time is None:
            rate = external.fps
            time = np.full(len(track), np.nan) if rate is None else track.frame / rate
        metres = np.full((len(track), 2), np.nan)
        if external.plane is not None:
            metres = external.plane.metres(track.px)
        parts.append(
            pd.DataFrame(
                {
                    "frame": track.frame,
                    "t_s": time,
                    "object": track.name,
                    "x_px": track.px[:, 0],
                    "y_px": track.px[:, 1],
                    "x_m": metres[:, 0],
                    "y_m": metres[:, 1],
                    "radius_px": np.nan if track.radius_px is None else track.radius_px,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


MAX_TRACK_FILE_BYTES = 256 * 2**20
"""256 MiB (chosen: a million marks in Tracker's XML need less than 200)."""


FOREIGN = {
    ".xls": ("a spreadsheet of Excel 97 to 2003", "Save it as .xlsx or .csv."),
    ".ods": ("a spreadsheet of LibreOffice", "Save it as .xlsx or .csv."),
    ".numbers": ("a spreadsheet of Numbers", "Export it as Excel or CSV."),
    ".cmbl": ("a file of Logger Pro", "In Logger Pro choose File > Export As > CSV."),
    ".cap": ("a file of PASCO Capstone", "In Capstone choose File > Export Data."),
    ".slp": ("a project of SLEAP", "Export it: sleap-convert --format analysis."),
    ".xml": ("an XML file", "From TrackMate export the spots as CSV."),
    ".json": ("a JSON file", "Write a table: a header t,x,y and one row per mark, as CSV."),
    ".parquet": ("a Parquet table", "Write it as CSV: pandas.read_parquet(FILE).to_csv('a.csv')."),
    ".c3d": ("a file of motion capture", "Export the markers as CSV, TSV or TRC."),
    ".npy": ("an array of NumPy", "Write it with numpy.savetxt: columns t, x, y."),
    ".npz": ("arrays of NumPy", "Write them with numpy.savetxt: columns t, x, y."),
    ".mat": ("a file of MATLAB", "Write it with writematrix as CSV: columns t, x, y."),
    ".gz": ("a compressed file", "Unpack it and pass the file inside."),
    ".zip": ("an archive", "Unpack it and pass the file inside."),
    ".pkl": ("a pickle, which may run code", "Write the table as CSV: frame.to_csv('t.csv')."),
}
"""Files of positions that are not read, by their ending: what they are, and what to do."""

_SNIFFED_BYTES = 4096


def is_text(path: Path) -> bool:
    """Whether a file is text other than XML or JSON, whatever its name: perhaps a table."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(_SNIFFED_BYTES)
    return starts_as_text(head) and not head.lstrip().startswith((b"<", b"{", b"["))


def read_bytes(path: Path, what: str) -> bytes:
    """Contents of a file.

    Raises
    ------
    UsageError
        If it can't be read, or is too large to be `what`.
    """
    try:
        if path.exists() and not path.is_file():
            raise UsageError(
                f"can't read {path}: it is not a regular file",
                hint="Pass a file rather than a pipe or device.",
            )
        if path.stat().st_size > MAX_TRACK_FILE_BYTES:
            raise UsageError(
                f"{path} is too large to be {what} ({MAX_TRACK_FILE_BYTES >> 20} MiB at most)",
                hint="Check that it is a file of tracks; export only the tracks.",
            )
        return path.read_bytes()
    except OSError as problem:
        raise UsageError(
            f"can't read {path}: {problem.strerror}",
            hint="Check the path and your read permission.",
        ) from problem


def root_of(data: bytes, path: Path, what: str) -> Element:
    """Root of an XML document; entities and external references are refused.

    Raises
    ------
    UsageError
        If it is damaged, or declares entities.
    """
    try:
        root: Element = fromstring(data, forbid_dtd=True)
    except DefusedXmlException as problem:
        raise UsageError(
            f"{path} declares XML entities, which no {what} does; it was not read",
            hint="Save it again with the program that made it.",
        ) from problem
    except (ParseError, LookupError, ValueError) as problem:
        raise UsageError(
            f"{path} is not a {what}: {problem}",
            hint="It may be cut off. Save it again with the program that made it.",
        ) from problem
    return root


def read_member(path: Path, suffix: str, what: str) -> bytes:
    """The only file in a ZIP whose name ends in `suffix`.

    Raises
    ------
    UsageError
        If the archive is damaged, has no such file, or one that unpacks to too many bytes.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            inside = [one for one in archive.infolist() if one.filename.lower().endswith(suffix)]
            if not inside:
                raise UsageError(f"{path} contains no {suffix} file", hint=f"It is not a {what}.")
            if len(inside) > 1:
                names = ", ".join(one.filename for one in inside[:4])
                raise UsageError(
                    f"{path} contains several {suffix} files: {names}",
                    hint="Unpack it and pass one of them.",
                )
            # read one byte more than allowed: the size in the directory may be wrong
            with archive.open(inside[0]) as file:
                data = file.read(MAX_TRACK_FILE_BYTES + 1)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, EOFError, RuntimeError, OSError) as problem:
        raise UsageError(
            f"{path} is not a complete {what}: {problem}",
            hint="It may be cut off. Save it again with the program that made it.",
        ) from problem
    except NotImplementedError as problem:
        raise UsageError(
            f"{path} uses a compression that can't be read: {problem}",
            hint="Unpack it and pass the file inside.",
        ) from problem
    if len(data) > MAX_TRACK_FILE_BYTES:
        raise UsageError(
            f"{inside[0].filename} in {path} is too large ({MAX_TRACK_FILE_BYTES >> 20} MiB)",
            hint="Check that it is a file of tracks. Save it again with the program that made it.",
        )
    return data


def text_of(parent: Element, name: str) -> str | None:
    """Text of the first child `name`; None if missing."""
    child = parent.find(name)
    return None if child is None or child.text is None else child.text.strip()


def numbers(text: str | None, count: int) -> tuple[float, ...] | None:
    """Numbers of ``"x;y;t"``; None unless there are `count`."""
    if text is None:
        return None
    try:
        values = tuple(float(part) for part in text.split(";"))
    except ValueError:
        return None
    return values[:count] if len(values) >= count else None
