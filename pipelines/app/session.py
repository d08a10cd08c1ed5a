"""State of the page: the open clip, its corrections and its measurement."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

from metrology import ImpactVisionError, write_text_whole
from pipelines.app.campaign import FolderSession
from pipelines.app.corrections import (
    ClipInputs,
    Corrections,
    History,
    ObjectMark,
    Stick,
    as_command,
    as_python,
    corrected_table,
    corrections_file,
    options_of,
    read_corrections,
    table_file,
    write_corrections,
)
from pipelines.app.figures import Figure, figures_of
from pipelines.app.frames import FrameStore
from pipelines.app.graphs import Graph, graphs_of
from pipelines.app.marks import marks_of
from pipelines.app.openings import Recent
from pipelines.app.worker import ClipAnswer, Measurer
from pipelines.campaign.run import CLIP_SUFFIXES, find_clips
from pipelines.web import Jobs
from vision.clip.images import is_image

if TYPE_CHECKING:
    import pandas as pd

    from measuring.measurement import ClipMeasurement
    from pipelines.app.pages.why import ClipExplained
    from pipelines.calibrate.session import Session

__all__ = ["AppSession", "ClipSession"]


class ClipSession:
    """An open clip: frames, corrections and the newest measurement.

    Parameters
    ----------
    number : int
        Distinguishes the clips opened in one session, for the addresses of their frames.
    inputs : ClipInputs, optional
        Where nothing was entered for this clip.

    Attributes
    ----------
    figures, graphs : tuple
        Its numbers and graphs.
    problem : str
        Why nothing was measured; empty otherwise.
    written : tuple of Path
        Files exported so far.
    explained : ClipExplained or None
        Answer of the page Why for the present measurement.
    calibration : Session or None
        Calibration of the clip, once the page Set up was opened.
    unsaved : str
        Why the corrections could not be read or saved; empty otherwise.
    step, part : str, float
        What is being done, and its completed fraction; no step if nothing is.
    drawn, revision : int
        Increase with every change of what is drawn, and of anything.
    """

    def __init__(
        self, path: Path, number: int, measurer: Measurer, inputs: ClipInputs | None = None
    ) -> None:
        self.path, self.number = path, number
        self.frames = FrameStore(path)
        self.measured: ClipMeasurement | None = None
        self.figures: tuple[Figure, ...] = ()
        self.graphs: tuple[Graph, ...] = ()
        self.written: tuple[Path, ...] = ()
        self.calibration: Session | None = None
        self.explained: ClipExplained | None = None
        self.problem = self.unsaved = self.step = ""
        self.part = 0.0
        self.drawn = self.revision = 0
        self._measurer = measurer
        self._task = 0
        self._candidates: pd.DataFrame | None = None
        self._shown: pd.DataFrame | None = None
        self._early: pd.DataFrame | None = None
        self._lock = RLock()
        file = corrections_file(path)
        self._readable = True
        try:
            now = read_corrections(file)
        except ImpactVisionError as problem:
            now, self.unsaved, self._readable = Corrections(), problem.in_one_line, False
        if now == Corrections() and inputs is not None:
            now = Corrections(inputs)
        elif now == Corrections() and (setup := setup_beside(path)) is not None:
            now = Corrections(ClipInputs(setup=setup.name))
        self.history = History(now)

    @property
    def corrections(self) -> Corrections:
        """The present ones."""
        return self.history.now

    @property
    def busy(self) -> bool:
        """Whether it is being measured."""
        return bool(self.step)

    def begin(self) -> None:
        """Measure it with the present inputs and corrections."""
        with self._lock:
            corrections = self.corrections
            self.problem = ""
            try:
                table = self._table()
                options = options_of(self.path, corrections, corrected=table is not None)
            except ImpactVisionError as problem:
                self._task, self.step, self.problem = -1, "", problem.in_one_line
            else:
                self.step, self.part = "starting", 0.0
                self._task = self._measurer.measure(self.path, options, table)
            self.revision += 1

    def change(self, corrections: Corrections) -> None:
        """Take over other inputs or corrections, save them and measure again."""
        if self.history.change(corrections):
            self._changed()

    def undo(self) -> None:
        """Return to the state before the last change."""
        if self.history.undo():
            self._changed()

    def redo(self) -> None:
        """Repeat the change that was undone."""
        if self.history.redo():
            self._changed()

    def mark(self, kind: str, frame: int, x: float, y: float, *, moved: bool) -> None:
        """Mark ball, mass or what is ignored in a frame; `moved` if its outline was dragged."""
        mark = ObjectMark(
            int(frame), round(float(x), 2), round(float(y), 2), moved and kind == "ball"
        )
        now = self.corrections
        if kind == "ignored":
            self.change(replace(now, ignored=(*now.ignored, mark)))
        else:
            self.change(replace(now, mass=mark) if kind == "mass" else now.with_ball(mark))

    def place_stick(self, stick: Stick) -> None:
        """Take the scale from a stick in the frame, in place of a typed one.

        Raises
        ------
        UsageError
            If its length is invalid, or its ends are in one place.
        """
        _ = stick.scale
        now = self.corrections
        self.change(replace(now, stick=stick, inputs=replace(now.inputs, scale="")))

    def take(self, answer: ClipAnswer) -> None:
        """Take over what the measuring process reports."""
        measured = answer.measured
        figures = () if measured is None else figures_of(measured)
        graphs = () if measured is None else graphs_of(measured)
        with self._lock:
            if answer.number != self._task:
                return
            if answer.done or answer.step:
                self.step, self.part = answer.step, answer.part
            else:
                self._early = answer.candidates
            if answer.done or not answer.step:
                self.drawn += 1
            if answer.done:
                self._early = None
                self.problem = answer.problem
                if measured is not None or answer.candidates is not None:
                    self.measured, self.figures, self.graphs = measured, figures, graphs
                    self._shown, self.explained = answer.candidates, None
                # with corrections the answer holds the corrected objects, not those found
                if answer.candidates is not None and not self.corrections.edits_objects:
                    self._candidates = answer.candidates
            self.revision += 1

    def as_command(self) -> str:
        """The same measurement as a command."""
        return as_command(self.path, self.corrections, corrected=self._table() is not None)

    def as_python(self) -> str:
        """The same measurement in Python."""
        return as_python(self.path, self.corrections, corrected=self._table() is not None)

    def marks(self) -> dict[str, Any]:
        """Outlines, events and found objects for the viewer."""
        with self._lock:
            if self.measured is None and self._early is not None:
                return marks_of(None, self._early)
            return marks_of(self.measured, self._shown)

    def close(self) -> None:
        """Release frames."""
        self.frames.close()

    def _table(self) -> "pd.DataFrame | None":
        found = self._candidates if self._candidates is not None else self._shown
        return corrected_table(found, self.corrections.ball, self.corrections.ignored)

    def _changed(self) -> None:
        self._save()
        self.begin()

    def _save(self) -> None:
        """Write the corrections, and the table that the same command reads."""
        file = corrections_file(self.path)
        try:
            if not self._readable:
                # what a person wrote there is kept
                file.replace(file.with_name(f"{file.name}.old"))
                self._readable = True
            write_corrections(file, self.corrections)
            table = self._table()
            if table is not None:
                text = table.to_csv(index=False, lineterminator="\n", float_format="%.6g")
                write_text_whole(table_file(self.path), text)
            self.unsaved = ""
        except (ImpactVisionError, OSError) as problem:
            self.unsaved = getattr(problem, "in_one_line", str(problem))


def setup_beside(clip: Path) -> Path | None:
    """Set-up file of the same name next to a clip: ``strike.toml`` of ``strike.mp4``."""
    own = clip.with_suffix(".toml")
    return own if own.is_file() else None


def is_images(folder: Path) -> bool:
    """Whether a folder holds pictures and no clips."""
    held = [*folder.iterdir()]
    clips = any(file.suffix.lower() in CLIP_SUFFIXES for file in held)
    return not clips and any(map(is_image, held))


class AppSession:
    """State of the whole page, shared by reloads.

    Attributes
    ----------
    folder : Path
        Where dropped clips are copied to.
    jobs : Jobs
        Write files one after another.
    page : str
        "open", "clip", …
    """

    def __init__(self, language: str = "en", recent: Recent | None = None) -> None:
        self.language = language
        self.recent = recent or Recent()
        self.folder = Path.cwd()
        self.jobs = Jobs()
        self.dark: bool | None = None
        self.page = "open"
        self.clip: ClipSession | None = None
        self.folder_session: FolderSession | None = None
        self.measurer = Measurer(self._take)
        self.stop: Callable[[], None] = lambda: None
        self._opened = 0

    def open_place(self, path: Path) -> None:
        """Open a clip, or a folder of clips; a folder of pictures is a clip.

        Raises
        ------
        UsageError
            If a folder has neither.
        """
        if not path.is_dir() or is_images(path):
            self.open_clip(path)
            return
        find_clips([path])
        self.folder_session = FolderSession.of(path)
        self.recent.add(path)
        self.page = "folder"

    def open_clip(self, path: Path, inputs: ClipInputs | None = None) -> ClipSession:
        """Open a clip and measure it; another open one is closed."""
        if self.clip is not None:
            self.clip.close()
        self.recent.add(path)
        self._opened += 1
        self.clip = ClipSession(path, self._opened, self.measurer, inputs)
        self.page = "clip"
        self.clip.begin()
        return self.clip

    def set_up(self, calibration: "Session") -> None:
        """Open the clip of a calibration at the page Set up; nothing is measured yet."""
        self.clip = ClipSession(calibration.answers.scene.info.path, 1, self.measurer)
        self.clip.calibration, self.page = calibration, "setup"
        self.jobs.submit("searching for the wall grid", calibration.find_grid)
        if calibration.answers.rest_px is None:
            self.jobs.submit("tracking the ball", calibration.look_for_ball)

    def end(self) -> None:
        """Stop measuring and remove temporary files."""
        self.measurer.stop()
        if self.clip is not None:
            self.clip.close()

    def _take(self, answer: ClipAnswer) -> None:
        if self.clip is not None:
            self.clip.take(answer)
