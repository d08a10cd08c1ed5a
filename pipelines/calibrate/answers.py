"""What is known of a clip's scene: set-up document, grid, ball, marked points."""

import math
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.board import Board, find_board
from calib.grid import WallGrid
from calib.lens import LensPrior, calibrate_lens, read_lens, write_lens
from measuring.inputs import Inputs, gather_inputs
from measuring.setup.file import (
    SIZE_AND_MASS,
    Setup,
    ball_from_option,
    setup_from_document,
)
from metrology import ClipError, Defaults, UsageError, measurands, read_given
from metrology.measurands import Given, Measurand
from physics.bodies import BALLS
from pipelines.calibrate.corners import WallSource
from vision.clip.clip import ClipReader
from vision.clip.footage import CaptureRate, choose_capture_rate
from vision.clip.picture import ClipInfo, decoded_image
from vision.tracks import Tracks

__all__ = [
    "ANSWER_OPTIONS",
    "EMPTY_ANSWERS",
    "Answers",
    "StillScene",
    "answered",
    "open_scene",
    "picture_of_board",
    "point_from",
    "text_of",
]

FloatArray = NDArray[np.float64]

Document = Mapping[str, Any]
"""Tables of a setup file."""

MAX_SCENE_FRAMES = 40
"""Number of frames in the median image of the scene (chosen: a moving object covers any point in
fewer than half of them)."""

EMPTY_ANSWERS = ("", "none", "-", "no")
"""Texts that leave an answer open."""

BOARD = Board(8, 6, 0.025)
"""The board that `vision calibrate board` writes if nothing else is asked for."""

PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True, eq=False)
class StillScene:
    """A clip without what moves in it.

    Attributes
    ----------
    picture : (H, W) uint8 array
        Median of frames over the whole clip.
    clock : (F,) array
        Mid-exposure time of every frame, in frames of the camera.
    """

    info: ClipInfo
    picture: NDArray[np.uint8]
    clock: FloatArray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.info.width, self.info.height


def open_scene(path: Path) -> StillScene:
    """Open a clip and compute the median of its frames.

    Raises
    ------
    ClipError
        If it can't be read.
    """
    clip = ClipReader.open(path)
    stride = max(1, clip.info.frames // MAX_SCENE_FRAMES)
    frames = [frame.gray for frame in clip.frames() if frame.index % stride == 0]
    levels = np.median(frames, axis=0) / (257.0 if frames[0].dtype == np.uint16 else 1.0)
    picture = np.asarray(np.round(levels), dtype=np.uint8)
    return StillScene(clip.info, picture, clip.capture_times(1.0))


@dataclass(frozen=True, eq=False)
class Answers:
    """All answers so far, immutable: each change makes a new instance.

    Attributes
    ----------
    document : mapping
        Tables of the setup file, as typed.
    folder : Path
        Where relative paths in it start.
    begun : Path or None
        Setup file to begin with.
    grid : WallGrid or None
        None until it is found.
    grid_source : {"found", "corners", "hand"}
    corners : (4, 2) array or None
        Handles, px: lower left, lower right, upper right, upper left.
    squares : tuple of int
        Squares between them, across and up.
    origin_px : (2,) array or None
        Origin of the wall coordinates chosen by the user.
    tracks : Tracks or None
        None until the ball is tracked.
    rest_px, landing_px : (2,) array or None
        Marked; they take the place of what was tracked.
    out : Path
        The setup file to write.
    """

    scene: StillScene
    document: Document = field(default_factory=dict)
    folder: Path = Path()
    begun: Path | None = None
    grid: WallGrid | None = None
    grid_source: WallSource = "found"
    corners: FloatArray | None = None
    squares: tuple[int, int] = (10, 5)
    origin_px: FloatArray | None = None
    tracks: Tracks | None = None
    rest_px: FloatArray | None = None
    landing_px: FloatArray | None = None
    out: Path = Path("setup.toml")

    @cached_property
    def setup(self) -> Setup:
        """The document, checked."""
        return setup_from_document(self.document, "the set-up", folder=self.folder)

    @cached_property
    def inputs(self) -> Inputs:
        """Setup with presets and defaults."""
        return gather_inputs(self.setup, None, None)

    @property
    def rate(self) -> CaptureRate:
        """Capture rate: stated, of the clip, or assumed."""
        camera = self.setup.camera
        return choose_capture_rate(
            self.scene.info, None, camera.capture_fps, setup_std=camera.capture_fps_std
        )

    @cached_property
    def lens(self) -> LensPrior | None:
        """Lens known beforehand, at the size of the clip's image."""
        path = self.setup.camera.lens
        if path is None:
            return None
        width, height = self.scene.size
        return read_lens(path, width=width, height=height)

    @property
    def rest(self) -> FloatArray | None:
        """Ball at rest, px: marked, otherwise tracked."""
        tracks = self.tracks
        if self.rest_px is not None or tracks is None or tracks.rest_frames is None:
            return self.rest_px
        first, last = tracks.rest_frames
        still = (tracks.ball.frame >= first) & (tracks.ball.frame <= last)
        return np.median(tracks.ball.centre_px[still], axis=0) if still.any() else None

    @property
    def landing(self) -> tuple[FloatArray, bool]:
        """Landing point, px, and whether it is observed rather than assumed."""
        if self.landing_px is not None:
            return self.landing_px, True
        tracks = self.tracks
        if tracks is not None and tracks.rest_frames is not None:
            after = tracks.ball.centre_px[tracks.ball.frame > tracks.rest_frames[1]]
            if len(after) >= MIN_LANDING_FRAMES:
                return after[np.argmax(after[:, 1])], True
        width, height = self.scene.size
        left = self.rest is not None and self.rest[0] > 0.5 * width
        return np.array([(0.1 if left else 0.9) * width, 0.85 * height]), False


MIN_LANDING_FRAMES = 8
"""Frames: a parabola has six parameters, two more show a misfit."""


def _at(table: str, key: str, what: Measurand) -> "Option":
    """Option that is one number of the document."""

    def read(answers: Answers, text: str, option: str) -> Document:
        if text:
            read_given(text, what, option)
        return _with(answers.document, table, **{key: text or None})

    return Option(read, lambda answers: str(answers.document.get(table, {}).get(key, "")))


def _with(document: Document, table: str, **values: str | float | None) -> Document:
    """The document with values of a table replaced, or removed where they are None."""
    changed = deepcopy(dict(document))
    held = {**changed.pop(table, {}), **values}
    held = {key: value for key, value in held.items() if value is not None}
    return {**changed, table: held} if held else changed


@dataclass(frozen=True)
class Option:
    """An answer that is typed.

    Attributes
    ----------
    read : callable
        Document with the answer, from the answers so far, the text and the option's name.
    shown : callable
        Its present text.
    """

    read: Callable[[Answers, str, str], Document]
    shown: Callable[[Answers], str]


def _ball(answers: Answers, text: str, option: str) -> Document:
    emptied = _with(answers.document, "ball", preset=None, diameter=None, mass=None)
    if not text:
        return emptied
    ball, both = ball_from_option(text), SIZE_AND_MASS.fullmatch(text)
    size, weight = (both["size"].strip(), both["mass"]) if both else (text.strip(), None)
    key = "preset" if size == ball.name and size in BALLS else "diameter"
    return _with(emptied, "ball", **{key: size, "mass": weight})


def _ball_text(answers: Answers) -> str:
    table = answers.document.get("ball", {})
    parts = (table.get(key) for key in ("preset", "diameter", "mass"))
    return ", ".join(str(one) for one in parts if one is not None)


def _lens(answers: Answers, text: str, option: str) -> Document:
    """A lens file, or a folder with pictures of the usual board, from which one is made."""
    path = Path(text)
    if text and path.is_dir():
        files = sorted(one for one in path.iterdir() if one.suffix.lower() in PICTURES)
        views = [find_board(picture_of_board(one), BOARD, one.name) for one in files]
        path = answers.out.parent / "board-lens.toml"
        write_lens(path, calibrate_lens(views))
    if text:
        width, height = answers.scene.size
        read_lens(path, width=width, height=height)
    return _with(answers.document, "camera", lens=str(path.absolute()) if text else None)


def picture_of_board(path: Path) -> NDArray[np.uint8]:
    """Read a picture in gray.

    Raises
    ------
    ClipError
        If it is none.
    """
    data = path.read_bytes() if path.is_file() else b""
    picture = decoded_image(data, cv2.IMREAD_GRAYSCALE, path)
    if picture is None:
        raise ClipError(f"{path} is not a readable image", hint="Pass JPEG or PNG files.")
    return np.asarray(picture, dtype=np.uint8)


def _period(answers: Answers, text: str, option: str) -> Document:
    """Inertia from the period of small swings, with mass and centre of mass."""
    if not text:
        return answers.document
    period = read_given(text, SWING_PERIOD, option)
    table = answers.document.get("pendulum", {})
    if not {"mass", "com"} <= table.keys():
        raise UsageError(
            "the inertia follows from the period only with mass and centre of mass",
            hint="Give the pendulum's mass and the distance of its centre of mass first.",
        )
    mass = read_given(table["mass"], measurands.PENDULUM_MASS)
    com = read_given(table["com"], measurands.CENTRE_OF_MASS)
    value = mass.value * Defaults.GRAVITY.known * com.value * (period.value / math.tau) ** 2
    relative = math.hypot(
        2.0 * (period.std or PERIOD_STD * period.value) / period.value,
        _relative(mass, Defaults.PENDULUM_MASS.std),
        _relative(com, Defaults.CENTRE_OF_MASS.std),
    )
    inertia = f"{value:.5g} kg m^2 ± {relative * value:.2g} kg m^2"
    return _with(answers.document, "pendulum", inertia=inertia)


def _relative(given: Given, default: float) -> float:
    return default if given.std is None else given.std / given.value


SWING_PERIOD = Measurand(
    "a pendulum's period", "s", 0.05, 60.0, "that of a swing by hand", "1.36 s"
)

PERIOD_STD = 0.005
"""Relative std of a period without one (chosen: ten swings timed by hand, ± 0.07 s)."""

ANSWER_OPTIONS: Mapping[str, Option] = {
    "fps": _at("camera", "capture_fps", measurands.CAPTURE_RATE),
    "wall_grid": _at("wall", "grid", measurands.GRID_PITCH),
    "fine_grid": _at("wall", "fine_grid", measurands.FINE_PITCH),
    "ball": Option(_ball, _ball_text),
    "support_height": _at("support", "height", measurands.SUPPORT_HEIGHT),
    "camera_distance": _at("camera", "distance_to_wall", measurands.CAMERA_DISTANCE),
    "ball_plane": _at("wall", "ball_plane_offset", measurands.BALL_PLANE_OFFSET),
    "pendulum_mass": _at("pendulum", "mass", measurands.PENDULUM_MASS),
    "pendulum_length": _at("pendulum", "length", measurands.PENDULUM_LENGTH),
    "pendulum_com": _at("pendulum", "com", measurands.CENTRE_OF_MASS),
    "pendulum_inertia": _at("pendulum", "inertia", measurands.PENDULUM_INERTIA),
    "pendulum_period": Option(_period, lambda answers: ""),
    "lens": Option(_lens, lambda answers: str(answers.document.get("camera", {}).get("lens", ""))),
}
"""Typed answers by the names of the options of `vision calibrate CLIP`."""


def answered(answers: Answers, name: str, text: str) -> Answers:
    """The answers with one more, or without it where the text is empty.

    Raises
    ------
    UsageError
        If it is invalid by itself, or with the others.
    """
    text = text.strip()
    given = "" if text.lower() in EMPTY_ANSWERS else text
    document = ANSWER_OPTIONS[name].read(answers, given, f"--{name.replace('_', '-')}")
    changed = replace(answers, document=document)
    wall = changed.setup.wall
    if wall.fine_grid is not None and wall.fine_grid >= changed.inputs.grid_pitch:
        raise UsageError(
            f"fine lines at {1e3 * wall.fine_grid:g} mm are not finer than the grid's"
            f" {1e3 * changed.inputs.grid_pitch:g} mm",
            hint="Leave the fine lines out if there are none.",
        )
    return changed


def text_of(answers: Answers, name: str) -> str:
    """The present text of an answer; empty if it is open."""
    return ANSWER_OPTIONS[name].shown(answers).replace("+-", "±")


def point_from(text: str, size: tuple[int, int]) -> FloatArray:
    """A position in an image of that size, ``X,Y`` in px: (2,).

    Raises
    ------
    UsageError
        If it is not a pair of numbers, or outside the image.
    """
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as problem:
        raise UsageError(f"{text!r} is no point", hint="Write X,Y in px: 105,265.") from problem
    if not (0.0 <= x <= size[0] - 1.0 and 0.0 <= y <= size[1] - 1.0):
        raise UsageError(
            f"the position {text} is outside the image", hint=f"It has {size[0]} × {size[1]} px."
        )
    return np.array([x, y])
