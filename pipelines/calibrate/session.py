"""Calibration session: answers, results, and what each answer changed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any

from calib.grid import find_wall_grid
from metrology import CalibrationError, NotFoundError, SetupError, parse_toml, read_small_text
from pipelines.calibrate.answers import ANSWER_OPTIONS, Answers, answered, open_scene, point_from
from pipelines.calibrate.corners import grid_from_corners, starting_corners
from pipelines.calibrate.outlook import NO_GRID, Outlook, outlook
from pipelines.calibrate.saving import Written, save
from vision.clip.clip import ClipReader
from vision.following import follow

__all__ = ["Session", "session_of", "with_corners", "with_grid"]

OF_THE_GRID = frozenset({"wall_grid", "fine_grid"})
"""Answers after which the grid is searched again."""


@dataclass(frozen=True)
class OutlookChange:
    """Effect of one answer on the expected uncertainty of the landing distance, m."""

    label: str
    before: float | None
    after: float | None


class Session:
    """Answers and results; outlives every window that shows it.

    Parameters
    ----------
    answers : Answers
        Initial answers.

    Attributes
    ----------
    outlook : Outlook
        Of `answers`.
    changes : list of OutlookChange
        Oldest first.
    written : Written or None
        Files written so far.
    grid_problem, ball_problem : str
        Why no grid was found, and no ball tracked; empty otherwise.
    """

    def __init__(self, answers: Answers) -> None:
        self.answers = answers
        self.outlook = Outlook(None, problem=NO_GRID)
        self.changes: list[OutlookChange] = []
        self.written: Written | None = None
        self.grid_problem = self.ball_problem = ""
        self._lock = Lock()

    def apply(self, label: str, changed: Callable[[Answers], Answers]) -> Outlook:
        """Change the answers and update the results; safe to call from several threads.

        Raises
        ------
        ImpactVisionError
            Whatever `changed` raises; nothing changes then.
        """
        with self._lock:
            answers = changed(self.answers)
            now = outlook(answers)
            self.changes.append(OutlookChange(label, self.outlook.std, now.std))
            self.answers, self.outlook = answers, now
            return now

    def update(self, label: str, **fields: Any) -> Outlook:
        """Replace fields of the answers."""
        return self.apply(label, lambda answers: replace(answers, **fields))

    def answer(self, label: str, name: str, text: str) -> Outlook:
        """Take over the text of an option of `vision calibrate`.

        Raises
        ------
        UsageError, CalibrationError
            If it is invalid, or no grid of that pitch is found; nothing changes then.
        """

        def changed(answers: Answers) -> Answers:
            answers = answered(answers, name, text)
            if name not in OF_THE_GRID:
                return answers
            return with_grid(answers) if answers.corners is None else with_corners(answers)

        return self.apply(f"{label} {text or '–'}", changed)

    def find_grid(self) -> None:
        """Find the wall grid automatically; `grid_problem` states why there is none."""
        try:
            self.apply("wall grid found", with_grid)
            self.grid_problem = ""
        except CalibrationError as problem:
            self.grid_problem = problem.in_one_line
            self.update("no wall grid found", grid=None, corners=None)

    def follow_ball(self, ball_at: tuple[float, float] | None = None) -> None:
        """Track the ball through the clip.

        Raises
        ------
        NotFoundError
            If nothing round moves.
        """
        answers = self.answers
        clip = ClipReader.open(answers.scene.info.path)
        tracks = follow(clip, answers.rate.fps, ball_at=ball_at)
        self.update("ball tracked", tracks=tracks, rest_px=None, landing_px=None)

    def look_for_ball(self) -> None:
        """Track the ball if there is one; `ball_problem` states why there is none."""
        try:
            self.follow_ball()
            self.ball_problem = ""
        except NotFoundError as problem:
            self.ball_problem = problem.in_one_line

    def save(self) -> Written:
        """Write `setup.toml` and `lens.toml`.

        Raises
        ------
        UsageError
            If nothing is calibrated, or the files can't be written.
        """
        self.written = save(self.answers, self.outlook)
        return self.written


def session_of(
    clip: Path,
    out: Path,
    *,
    setup: Path | None = None,
    origin_at: str | None = None,
    ball_at: str | None = None,
    **options: str | None,
) -> Session:
    """Start a calibration with the options of `vision calibrate CLIP`.

    Parameters
    ----------
    clip, out : Path
        The clip, and the setup file to write.
    setup : Path, optional
        Setup file to begin with; what is not asked for is kept.
    origin_at, ball_at : str, optional
        Points, ``X,Y`` in px.
    **options : str, optional
        Texts by name, as in `ANSWER_OPTIONS`.

    Raises
    ------
    ClipError
        If the clip can't be read.
    UsageError
        If an option is invalid.
    """
    answers = Answers(open_scene(clip), folder=out.parent, out=out)
    if setup is not None:
        text = read_small_text(setup, what="the setup file", error=SetupError)
        document = parse_toml(text, str(setup))
        answers = replace(answers, document=document, folder=setup.parent, begun=setup)
    for name in ANSWER_OPTIONS:
        if (given := options.get(name)) is not None:
            answers = answered(answers, name, given)
    size = answers.scene.size
    if origin_at is not None:
        answers = replace(answers, origin_px=point_from(origin_at, size))
    if ball_at is not None:
        answers = replace(answers, rest_px=point_from(ball_at, size))
    _ = answers.setup, answers.lens
    return Session(answers)


def with_grid(answers: Answers) -> Answers:
    """Find the wall grid in the scene.

    Raises
    ------
    CalibrationError
        If none is found.
    """
    inputs = answers.inputs
    grid = find_wall_grid(
        answers.scene.picture, pitch_m=inputs.grid_pitch, fine_pitch_m=inputs.fine_pitch
    )
    if answers.origin_px is not None:
        grid = grid.with_origin(answers.origin_px, snap=True)
    return replace(answers, grid=grid, grid_source="found", corners=None)


def with_corners(answers: Answers) -> Answers:
    """Measure the grid between the handles.

    Raises
    ------
    UsageError
        If the handles are out of order.
    """
    corners = answers.corners
    if corners is None:
        corners = starting_corners(answers.grid, answers.scene.size)
    grid, source = grid_from_corners(
        answers.scene.picture,
        corners,
        answers.squares,
        pitch_m=answers.inputs.grid_pitch,
        fine_pitch_m=answers.inputs.fine_pitch,
    )
    if answers.origin_px is not None:
        grid = grid.with_origin(answers.origin_px, snap=True)
    return replace(answers, grid=grid, grid_source=source, corners=corners)
