"""Inputs and corrections of a clip, kept in a file next to it; undo and redo."""

import math
import shlex
from collections.abc import Collection
from dataclasses import asdict, astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tomli_w
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from measuring.chain import MeasureOptions
from measuring.measurement import Axes
from metrology import UsageError, parse_toml, read_small_text, write_text_whole
from metrology.files import shown_path
from metrology.measurands import STICK_LENGTH, read_given
from pipelines.api.quantities import measure_options
from pipelines.terminal import as_typed
from vision.finding.linking import MIN_FOUND_ROWS

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "END_STD_PX",
    "FIXED_POINTS",
    "ClipInputs",
    "Corrections",
    "History",
    "ObjectMark",
    "Stick",
    "TypedInputs",
    "as_command",
    "as_python",
    "corrected_table",
    "corrections_file",
    "cure_of",
    "mistake_in",
    "options_of",
    "read_corrections",
    "table_file",
    "write_corrections",
]

FIXED_POINTS = ("pivot", "landing")
"""Corrected points that are the same in every frame."""

MAX_MARKS = 10_000
"""Marks of one clip (chosen: more than anybody sets by hand)."""

END_STD_PX = 1.0
"""Std of an end of the stick, px (chosen: as well as an end is seen and placed by hand)."""

MIN_STICK_PX = 5.0
"""Length of a stick below which it gives no scale, px (chosen: ± 30 %)."""

_MARK_RADII = 1.5
"""Distance within which a mark is on a found object, radii of it (chosen)."""


Pixels = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A number in a file; no text and no truth value."""


@dataclass(frozen=True)
class TypedInputs:
    """Texts that a person typed; empty ones are not given."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    def given(self) -> dict[str, str]:
        """The inputs that are not empty, by name."""
        held = {one.name: str(getattr(self, one.name)).strip() for one in fields(self)}
        return {name: text for name, text in held.items() if text}


@dataclass(frozen=True)
class ClipInputs(TypedInputs):
    """Inputs of a measurement as a person types them; empty ones are not given.

    Attributes
    ----------
    fps, ball, wall_grid, scale, setup, kind : str
        Arguments of `vision measure`.
    """

    fps: str = ""
    ball: str = ""
    wall_grid: str = ""
    scale: str = ""
    setup: str = ""
    kind: str = ""


@dataclass(frozen=True)
class ObjectMark:
    """Where an object is in a frame.

    Attributes
    ----------
    frame : int
        From 0.
    moved : bool
        Whether the outline of the measured object was dragged; else another object was selected.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    frame: Annotated[int, Field(strict=True, ge=0, lt=2**31)]
    x_px: Pixels
    y_px: Pixels
    moved: Annotated[bool, BeforeValidator(lambda written: written is True)] = False


@dataclass(frozen=True)
class Stick:
    """A known length in the plane of motion, whose ends were placed in the frame.

    Attributes
    ----------
    length : str
        As typed, such as "1 m ± 2 mm".
    """

    __pydantic_config__ = ConfigDict(extra="forbid")

    x0_px: Pixels
    y0_px: Pixels
    x1_px: Pixels
    y1_px: Pixels
    length: str

    @property
    def scale(self) -> str:
        """The scale as `vision measure --scale` takes it.

        Raises
        ------
        UsageError
            If the length is invalid, or the ends are in one place.
        """
        length = read_given(self.length, STICK_LENGTH, "the stick's length")
        pixels = math.hypot(self.x1_px - self.x0_px, self.y1_px - self.y0_px)
        if pixels < MIN_STICK_PX:
            raise UsageError(
                f"the stick is {pixels:.1f} px long", hint="Place its ends further apart."
            )
        relative = math.hypot(
            math.sqrt(2.0) * END_STD_PX / pixels, (length.std or 0.0) / length.value
        )
        value = pixels / length.value
        return f"{value:.6g} px/m ± {value * relative:.2g} px/m"


@dataclass(frozen=True)
class Corrections:
    """Everything that a person entered for a clip.

    Attributes
    ----------
    ball : tuple of ObjectMark
        In the order in which they were set.
    ignored : tuple of ObjectMark
        On found objects that are not the ball.
    mass : ObjectMark or None
        On the pendulum's mass.
    stick : Stick or None
        Takes the place of a typed scale.
    pivot, landing : (x, y) or None
        Take the place of the fitted pivot and of the flight's end, px.
    axes : Axes or None
        Of positions in metres.
    """

    inputs: ClipInputs = field(default_factory=ClipInputs)
    ball: tuple[ObjectMark, ...] = ()
    mass: ObjectMark | None = None
    stick: Stick | None = None
    pivot: tuple[float, float] | None = None
    landing: tuple[float, float] | None = None
    axes: Axes | None = None
    ignored: tuple[ObjectMark, ...] = ()

    @property
    def edits_objects(self) -> bool:
        """Whether the found objects are corrected, rather than what is derived from them."""
        return bool(self.ball or self.ignored)

    def with_ball(self, mark: ObjectMark) -> "Corrections":
        """With a mark on the ball, which replaces an earlier one in the same frame."""
        kept = tuple(one for one in self.ball if one.frame != mark.frame)
        return replace(self, ball=(*kept, mark))


def cure_of(option: str, known: Collection[str]) -> tuple[str, str] | None:
    """Input and text of an option that the checker proposes; None if it is not one of `known`."""
    name, _, text = option.partition(" ")
    key = name.removeprefix("--").replace("-", "_")
    return (key, " ".join(shlex.split(text))) if text and key in known else None


class History:
    """Corrections with undo and redo."""

    def __init__(self, now: Corrections) -> None:
        self._states = [now]
        self._place = 0

    @property
    def now(self) -> Corrections:
        """The present state."""
        return self._states[self._place]

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier state."""
        return self._place > 0

    @property
    def can_redo(self) -> bool:
        """Whether a state was undone."""
        return self._place + 1 < len(self._states)

    def change(self, corrections: Corrections) -> bool:
        """Add a state; false if nothing differs."""
        if corrections == self.now:
            return False
        del self._states[self._place + 1 :]
        self._states.append(corrections)
        self._place += 1
        return True

    def undo(self) -> bool:
        """Go back; false if there is no earlier state."""
        self._place -= int(moved := self.can_undo)
        return moved

    def redo(self) -> bool:
        """Go forward again; false if nothing was undone."""
        self._place += int(moved := self.can_redo)
        return moved


def corrections_file(clip: Path) -> Path:
    """File of a clip's inputs and corrections."""
    return clip.with_name(f"{clip.name}.corrections.toml")


def table_file(clip: Path) -> Path:
    """File of a clip's corrected tracklets, for `vision measure --from-tracks`."""
    return clip.with_name(f"{clip.name}.corrected.csv")


class _PointTable(BaseModel):
    model_config = ConfigDict(extra="forbid")

    x_px: Pixels
    y_px: Pixels


class _AxesTable(_PointTable):
    turn_deg: Pixels


_Marks = Annotated[list[ObjectMark], Field(max_length=MAX_MARKS)]


class _CorrectionsFile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    inputs: ClipInputs = ClipInputs()
    ball: _Marks = []
    mass: ObjectMark | None = None
    stick: Stick | None = None
    pivot: _PointTable | None = None
    landing: _PointTable | None = None
    axes: _AxesTable | None = None
    ignored: _Marks = []


def read_corrections(path: Path) -> Corrections:
    """Read the file; without one there are no corrections.

    Raises
    ------
    UsageError
        If it can't be read or its content is invalid.
    """
    if not path.exists():
        return Corrections()
    name = shown_path(path)
    document = parse_toml(read_small_text(path, what="the corrections"), name)
    try:
        held = _CorrectionsFile.model_validate(document)
        _ = held.stick and held.stick.scale
    except (ValidationError, UsageError) as problem:
        raise UsageError(
            f"{name}: {mistake_in(problem)}",
            hint="Correct the file, or delete it to begin without corrections.",
        ) from problem
    pivot, landing = (
        None if point is None else (point.x_px, point.y_px) for point in (held.pivot, held.landing)
    )
    axes = None if held.axes is None else Axes(**held.axes.model_dump())
    ball, ignored = tuple(held.ball), tuple(held.ignored)
    return Corrections(held.inputs, ball, held.mass, held.stick, pivot, landing, axes, ignored)


_MISTAKES = {
    "extra_forbidden": "is not known",
    "unexpected_keyword_argument": "is not known",
    "missing": "is missing",
    "string_type": "is not in quotes",
    "list_type": "is no list of tables",
    "dataclass_type": "is no table",
    "model_type": "is no table",
}
"""Words for mistakes in the file by their type in pydantic; of others its own."""


def mistake_in(problem: ValidationError | UsageError) -> str:
    """The first mistake in a file with its place: ``ball number 1: frame is 1.5: …``."""
    if isinstance(problem, UsageError):
        return problem.message
    first = problem.errors()[0]
    *tables, key = first["loc"]
    where = "".join(f" number {one + 1}" if isinstance(one, int) else str(one) for one in tables)
    words = _MISTAKES.get(first["type"], f"is {first['input']!r}: {first['msg']}")
    return f"{where}{': ' if where else ''}{key} {words}"


def write_corrections(path: Path, corrections: Corrections) -> None:
    """Write the file, completely or not at all; without corrections remove it.

    Raises
    ------
    OutputError
        If it can't be written.
    """
    if corrections == Corrections():
        path.unlink(missing_ok=True)
        return

    def table(mark: ObjectMark) -> dict[str, Any]:
        moved = {"moved": True} if mark.moved else {}
        return {"frame": mark.frame, "x_px": mark.x_px, "y_px": mark.y_px, **moved}

    document: dict[str, Any] = {"inputs": corrections.inputs.given()}
    if corrections.mass is not None:
        document["mass"] = table(corrections.mass)
    if corrections.stick is not None:
        document["stick"] = asdict(corrections.stick)
    if corrections.axes is not None:
        document["axes"] = asdict(corrections.axes)
    for key in FIXED_POINTS:
        if (point := getattr(corrections, key)) is not None:
            document[key] = dict(zip(("x_px", "y_px"), point, strict=True))
    for key in ("ball", "ignored"):
        document[key] = [table(mark) for mark in getattr(corrections, key)]
    text = "# Written by vision app. Positions in px, frames count from 0.\n"
    write_text_whole(path, text + tomli_w.dumps(document))


def corrected_table(
    candidates: "pd.DataFrame | None",
    marks: tuple[ObjectMark, ...],
    ignored: tuple[ObjectMark, ...] = (),
) -> "pd.DataFrame | None":
    """Tracklets with the marks entered; None if they do not determine any.

    A mark on a found object selects it; ignored ones are left out, and in place of the measured one
    the most probable of the others is. A dragged outline replaces the position in its frame.

    Parameters
    ----------
    candidates : DataFrame or None
        Tracklets found in the clip, as `vision measure --tracklets` writes them.
    marks, ignored : tuple of ObjectMark
        On the ball, and on what is not.
    """
    if candidates is None or not (marks or ignored) or not len(candidates):
        return None
    left_out = {_tracklet_at(candidates, mark) for mark in ignored} - {None}
    table = candidates[~candidates["tracklet"].isin(left_out)].copy()
    if not len(table) or not (marks or left_out):
        return None
    if not (table["measured"] == 1).any():
        likely = table.groupby("tracklet")["probability"].first().idxmax()
        table["measured"] = (table["tracklet"] == likely).astype(int)
    pointed = [mark for mark in marks if not mark.moved]
    if pointed:
        number = _tracklet_at(table, pointed[-1])
        if number is None:
            return None
        table["measured"] = (table["tracklet"] == number).astype(int)
    if int(table["measured"].sum()) < MIN_FOUND_ROWS:
        return None
    for mark in marks:
        if mark.moved:
            table = _with_place(table, mark)
    return table.sort_values(["tracklet", "frame"], ignore_index=True)


def _tracklet_at(table: "pd.DataFrame", mark: ObjectMark) -> int | None:
    rows = table[table["frame"] == mark.frame]
    if not len(rows):
        return None
    far = np.hypot(rows["x_px"] - mark.x_px, rows["y_px"] - mark.y_px) / rows["radius_px"]
    nearest = int(np.argmin(far))
    return int(rows["tracklet"].iloc[nearest]) if far.iloc[nearest] <= _MARK_RADII else None


def _with_place(table: "pd.DataFrame", mark: ObjectMark) -> "pd.DataFrame":
    """The measured object at another position in one frame."""
    import pandas as pd

    own = table["measured"] == 1
    there = own & (table["frame"] == mark.frame)
    if there.any():
        table.loc[there, ["x_px", "y_px"]] = mark.x_px, mark.y_px
        return table
    middle = table.loc[own].select_dtypes("number").median()
    row = table.loc[own].iloc[[0]].assign(**{str(name): one for name, one in middle.items()})
    row = row.assign(frame=mark.frame, x_px=mark.x_px, y_px=mark.y_px, measured=1)
    row["tracklet"] = table.loc[own, "tracklet"].iloc[0]
    return pd.concat([table, row.astype(table.dtypes.to_dict())], ignore_index=True)


def _given(corrections: Corrections, corrected: bool) -> dict[str, str]:
    """Inputs, stick and points as options; points on the ball unless a corrected table holds them.

    Raises
    ------
    UsageError
        If the stick's length is invalid.
    """
    points = corrections.inputs.given()
    if corrections.stick is not None:
        points["scale"] = corrections.stick.scale
    if corrections.ball and not corrected:
        points["ball_at"] = _point(corrections.ball[-1])
    if corrections.mass is not None:
        points["mass_at"] = _point(corrections.mass)
    for key in FIXED_POINTS:
        if (point := getattr(corrections, key)) is not None:
            points[f"{key}_at"] = "{:g},{:g}".format(*point)
    if corrections.axes is not None:
        points["axes"] = "{:g},{:g},{:g}".format(*astuple(corrections.axes))
    return points


def _point(mark: ObjectMark) -> str:
    return f"{mark.x_px:g},{mark.y_px:g},{mark.frame}"


def options_of(clip: Path, corrections: Corrections, *, corrected: bool) -> MeasureOptions:
    """Options of the measurement; `corrected` if a corrected table holds the marks on the ball.

    A relative path of the setup starts at the clip's folder.

    Raises
    ------
    UsageError
        If an input is invalid.
    """
    given: dict[str, Any] = {**_given(corrections, corrected)}
    if "setup" in given:
        given["setup"] = clip.parent / given["setup"]
    return measure_options(**given, cache=True)


def as_command(clip: Path, corrections: Corrections, *, corrected: bool) -> str:
    """The same measurement as a command."""
    words = ["vision", "measure", str(clip)]
    given = _given(corrections, corrected)
    for name, text in given.items():
        shown = str(clip.parent / text) if name == "setup" else text
        words += [f"--{name.replace('_', '-')}", shown]
    if corrected:
        words += ["--from-tracks", str(table_file(clip))]
    return as_typed(words)


def as_python(clip: Path, corrections: Corrections, *, corrected: bool) -> str:
    """The same measurement in Python."""
    given = _given(corrections, corrected)
    if "setup" in given:
        given["setup"] = str(clip.parent / given["setup"])
    if corrected:
        given["tracklets"] = str(table_file(clip))
    arguments = "".join(f", {name}={text!r}" for name, text in given.items())
    return f"import impact_vision as iv\n\nm = iv.measure({str(clip)!r}{arguments})\nprint(m)"
