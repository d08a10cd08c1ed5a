"""One calibration in progress: the answers, what they amount to, and what each answer changed.

`setup.toml` and `lens.toml`: the answers written down, and the wall as the camera saw it.
"""

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, Known
from calib.camera.lens_fit import FLOOR, NAMES
from calib.grid.grid import WallGrid, find_wall_grid
from calib.grid.spectrum import GridMap
from metrology import CalibrationError, NotFoundError, SetupError, UsageError, write_text_whole
from pipelines.calibrate.wizard.answers import Answers, BallKind
from pipelines.calibrate.wizard.corners import grid_from_corners, starting_corners
from pipelines.calibrate.wizard.outlook import Outlook, outlook
from pipelines.calibrate.wizard.scene import BallSeen, watch_ball

__all__ = [
    "Session",
    "lens_for",
    "read_view",
    "save",
    "setup_text",
    "with_ball",
    "with_corners",
    "with_grid",
]

FloatArray = NDArray[np.float64]

VIEW = "[view]"


@dataclass(frozen=True)
class Written:
    """Files that were written."""

    setup: Path
    lens: Path


def save(
    answers: Answers, outlook: Outlook, check: Callable[[str, Path], None] | None = None
) -> Written:
    """Write both files, each whole or not at all.

    Parameters
    ----------
    answers : Answers
    outlook : Outlook
        Of these answers.
    check : callable, optional
        Called with the setup file's text and its folder; raises if it would not be read.

    Raises
    ------
    UsageError
        If nothing is calibrated yet, or a file can't be written.
    """
    if answers.grid is None or outlook.calibration is None:
        raise UsageError(
            f"nothing is calibrated yet: {outlook.problem}", hint="Find the wall grid first."
        )
    text = setup_text(answers, outlook)
    if check is not None:
        check(text, answers.out.parent)
    lens = lens_for(answers.out)
    write_text_whole(lens, _lens_text(answers, outlook.calibration) + _view_text(answers.grid))
    write_text_whole(answers.out, text)
    return Written(answers.out, lens)


def lens_for(setup: Path) -> Path:
    """The lens file that goes with a setup file."""
    return setup.parent / "lens.toml"


def setup_text(answers: Answers, outlook: Outlook) -> str:
    """Text of the setup file."""
    lines = [f"# Written by `vision calibrate {_comment(answers.scene.info.path.name)}`."]
    if outlook.std is not None and outlook.distance is not None:
        where = "a supposed landing" if outlook.supposed else "landing"
        lines.append(
            f"# Expected: {where} {outlook.distance:.3f} m from rest, "
            f"± {1e3 * outlook.std:.1f} mm from the calibration."
        )
    lines += ["[camera]"]
    if answers.rate_known:
        lines.append(f"capture_fps = {answers.capture_fps!r}")
    else:
        lines.append("# capture_fps = 600   # not known; every time and speed scales with it")
    if answers.camera_distance is not None:
        lines.append(f'distance_to_wall = "{_taped(answers.camera_distance)}"')
    if answers.lens is not None:
        lines.append('lens = "lens.toml"')
    else:
        lines += [
            "# The grid of each clip tells the lens anew. For clips that show less of it:",
            '# lens = "lens.toml"',
        ]
    lines += ["", "[wall]", f'grid = "{_millimetres(answers.pitch)}"']
    if answers.fine_pitch is not None:
        lines.append(f'fine_grid = "{_millimetres(answers.fine_pitch)}"')
    if answers.ball_plane_offset is not None:
        lines.append(f'ball_plane_offset = "{_taped(answers.ball_plane_offset)}"')
    if answers.ball is not None:
        lines += ["", "[ball]"]
        if answers.ball_named:
            lines.append(f'preset = "{answers.ball.name}"')
        else:
            lines.append(f'diameter = "{_millimetres(answers.ball.diameter)}"')
            if answers.ball.mass is not None:
                lines.append(f'mass = "{answers.ball.mass:g} kg"')
    if answers.support_height is not None:
        lines += ["", "[support]", f'height = "{answers.support_height:.10g} m"']
    return "\n".join(lines) + "\n"


def _comment(text: str) -> str:
    """Fit for a comment: on one line."""
    return "".join(character if character.isprintable() else "?" for character in text)


def _millimetres(length: float) -> str:
    return f"{1e3 * length:.10g} mm"


def _taped(known: Known) -> str:
    return f"{known.value:.10g} m ± {1e3 * known.std:.6g} mm"


def _lens_text(answers: Answers, calibration: Calibration) -> str:
    if answers.lens is not None:
        return answers.lens.text.split(VIEW, 1)[0].rstrip() + "\n"
    lens = calibration.grid_camera.lens
    covariance = calibration.covariance[6:11, 6:11]
    std = np.maximum(np.sqrt(np.diag(covariance)), FLOOR)
    related = covariance / np.outer(std, std)
    np.fill_diagonal(related, 1.0)
    own = {"fx": lens.fx * std[0], "fy": lens.fy * std[0]}
    own |= dict(zip(("cx", "cy", "k1", "k2"), std[1:].tolist(), strict=True))
    lines = ["[lens]", f"width = {lens.width}", f"height = {lens.height}"]
    lines += [f"{name} = {float(getattr(lens, name))!r}" for name in NAMES]
    lines += ["", "[std]", *(f"{name} = {float(value)!r}" for name, value in own.items())]
    lines += [
        "",
        "[prior]",
        "# in log focal length, principal point x and y (px), k1 and k2",
        f"std = {std.tolist()!r}",
        f"correlation = {np.round(related, 9).tolist()!r}",
        "",
        "[quality]",
        'model = "from the straight lines of the wall grid"',
    ]
    return "\n".join(lines) + "\n"


def _view_text(grid: WallGrid) -> str:
    """The wall as the camera saw it, to tell later whether the camera moved."""
    variance = float(np.median(np.trace(grid.covariance_px2, axis1=1, axis2=2)))
    return "\n".join(
        [
            "",
            VIEW,
            "# where the wall's grid was in the picture, for `vision calibrate --check`",
            f"size = {list(grid.size)!r}",
            f"pitch_m = {grid.pitch_m!r}",
            f"centre = {grid.map.centre.tolist()!r}",
            f"scale = {grid.map.scale.tolist()!r}",
            f"parameters = {grid.map.parameters.tolist()!r}",
            f"variance_px2 = {variance / len(grid.nodes)!r}",
            "",
        ]
    )


def read_view(lens: Path) -> WallGrid:
    """The wall as it was seen when a lens file was written; its map only, no crossings.

    Raises
    ------
    SetupError
        If the file is missing or holds no view.
    """
    try:
        view = tomllib.loads(lens.read_text(encoding="utf-8"))["view"]
        arrays = (np.array(view[key], float) for key in ("centre", "scale", "parameters"))
        grid_map = GridMap(*arrays)
        size = (int(view["size"][0]), int(view["size"][1]))
        pitch, variance = float(view["pitch_m"]), float(view["variance_px2"])
    except (OSError, UnicodeDecodeError, ValueError, KeyError, TypeError, IndexError) as problem:
        raise SetupError(
            f"{lens} does not hold how the camera saw the wall",
            hint="`vision calibrate CLIP` writes it beside the setup file; or compare two clips: "
            "`vision calibrate check NEW_CLIP --against OLD_CLIP`.",
        ) from problem
    return WallGrid(
        size=size,
        pitch_m=pitch,
        nodes=np.zeros((1, 2), dtype=np.int64),
        points_px=np.zeros((1, 2)),
        covariance_px2=0.5 * variance * np.eye(2)[np.newaxis],
        residual_px=np.zeros((1, 2)),
        map=grid_map,
        area=np.zeros(size[::-1], dtype=bool),
        dark=True,
        fine_ratio=None,
        origin_m=np.zeros(2),
    )


@dataclass(frozen=True)
class OutlookChange:
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
    changes : list of OutlookChange
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
        self.changes: list[OutlookChange] = []
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
            self.changes.append(OutlookChange(label, self.outlook.std, now.std))
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
