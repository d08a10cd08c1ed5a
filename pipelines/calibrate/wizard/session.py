"""One calibration in progress: the answers, what they amount to, and what each answer changed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calib.grid.grid import find_wall_grid
from metrology import CalibrationError, NotFoundError
from pipelines.calibrate.wizard.answers import Answers, BallKind
from pipelines.calibrate.wizard.corners import grid_from_corners, starting_corners
from pipelines.calibrate.wizard.files import Written, save
from pipelines.calibrate.wizard.outlook import Outlook, outlook
from pipelines.calibrate.wizard.scene import BallSeen, watch_ball

__all__ = ["Change", "Session", "with_ball", "with_corners", "with_grid"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """What one answer did to the expected uncertainty of the landing distance, m."""

    label: str
    before: float | None
    after: float | None


class Session:
    """Answers as they grow. Outlives every window that shows it.

    Parameters
    ----------
    answers : Answers
        What is known at the start.
    presets : sequence of BallKind
        Balls that can be named.
    check : callable, optional
        Called with the setup file's text and folder before it is written.

    Attributes
    ----------
    answers : Answers
    outlook : Outlook
        Of `answers`.
    changes : list of Change
        Oldest first.
    step : int
        Step that is shown, from 0.
    written : Written or None
        Files written so far.
    grid_problem : str
        Why no grid was found, empty otherwise.
    ball_problem : str
        Why no ball was followed, empty otherwise.
    lens_way, lens_path : str
        How the lens is told: "grid", "file" or "board"; and the path, as written.
    by_hand : bool
        Whether the four handles are shown.
    handles : (4, 2) array or None
        Where they are, px.
    drafts : dict of str to str
        What is written in fields that a button sends, by the field's name.
    ends : dict of str to (2,) array
        Ends of the length to verify, px.
    moving : dict of str to (2,) array
        Places set but not yet worked in, px.
    layer : {"residuals", "uncertainty", "grid"}
        What step 6 draws.
    known_length, on_wall
        The length to verify, as written, and whether it lies on the wall.
    """

    def __init__(
        self,
        answers: Answers,
        presets: Sequence[BallKind] = (),
        check: Callable[[str, Path], None] | None = None,
    ) -> None:
        self.answers = answers
        self.presets = tuple(presets)
        self.outlook = Outlook(None, problem="There is no wall grid yet: step 3.")
        self.changes: list[Change] = []
        self.step = 0
        self.written: Written | None = None
        self.grid_problem = self.ball_problem = ""
        self.lens_way, self.lens_path = "grid" if answers.lens is None else "file", ""
        self.by_hand = False
        self.handles: FloatArray | None = None
        self.drafts: dict[str, str] = {}
        self.ends: dict[str, FloatArray] = {}
        self.moving: dict[str, FloatArray] = {}
        self.layer: Literal["residuals", "uncertainty", "grid"] = "uncertainty"
        self.known_length = ""
        self.on_wall = True
        self._check = check
        self._lock = Lock()

    def apply(self, label: str, changed: Callable[[Answers], Answers]) -> Outlook:
        """Change the answers and see what it does; safe to call from several threads.

        Raises
        ------
        ImpactVisionError
            Whatever `changed` raises; nothing is changed then.
        """
        with self._lock:
            answers = changed(self.answers)
            now = outlook(answers)
            self.changes.append(Change(label, self.outlook.std, now.std))
            self.answers, self.outlook = answers, now
            return now

    def update(self, label: str, **fields: Any) -> Outlook:
        """Replace fields of the answers."""
        return self.apply(label, lambda answers: replace(answers, **fields))

    def find_grid(self) -> None:
        """Look for the wall grid unaided; `grid_problem` says why there is none."""
        try:
            self.apply("wall grid found", with_grid)
            self.grid_problem = ""
        except CalibrationError as problem:
            self.grid_problem = problem.in_one_line
            self.update("no wall grid found", grid=None)

    def follow_ball(self, ball_at: tuple[float, float] | None = None) -> BallSeen:
        """Follow the ball through the clip.

        Raises
        ------
        NotFoundError
            If nothing round moves in it.
        """
        scene = self.answers.scene
        seen = watch_ball(scene.info.path, self.answers.capture_fps, ball_at=ball_at)
        self.update("ball followed, landing seen", seen=seen, rest_px=None, landing_px=None)
        return seen

    def look_for_ball(self) -> None:
        """Follow the ball if there is one; `ball_problem` says why there is none."""
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
        self.written = save(self.answers, self.outlook, self._check)
        return self.written


def with_grid(answers: Answers) -> Answers:
    """Find the wall grid in the scene.

    Raises
    ------
    CalibrationError
        If there is none.
    """
    grid = find_wall_grid(
        answers.scene.picture, pitch_m=answers.pitch, fine_pitch_m=answers.fine_pitch
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
        pitch_m=answers.pitch,
        fine_pitch_m=answers.fine_pitch,
    )
    if answers.origin_px is not None:
        grid = grid.with_origin(answers.origin_px, snap=True)
    return replace(answers, grid=grid, grid_source=source, corners=corners)


def with_ball(answers: Answers, kind: BallKind | None, *, named: bool) -> Answers:
    """Take a ball, with the height of the support it usually lies on where none was given."""
    height = answers.support_height
    if height is None and kind is not None:
        height = kind.support_height
    return replace(answers, ball=kind, ball_named=named, support_height=height)
