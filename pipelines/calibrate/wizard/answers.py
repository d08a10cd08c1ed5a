"""Answers of the calibration wizard: state, input parsing, clip defaults."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.board import Board, find_board
from calib.calibration import Known
from calib.grid import WallGrid
from calib.lens import LensPrior, calibrate_lens, lens_toml, read_lens
from metrology import (
    ClipError,
    Defaults,
    UnitError,
    UsageError,
    measurands,
    read_given,
    read_number,
)
from vision.clip.clip import ClipReader
from vision.clip.footage import CaptureRate, RateSource, choose_capture_rate
from vision.clip.picture import ClipInfo, decoded_image
from vision.following import follow
from vision.tracks import Track, Tracks

__all__ = [
    "STEP_NAMES",
    "Answers",
    "BallKind",
    "BallSeen",
    "LensChoice",
    "WallSource",
    "WizardClip",
    "ball_from",
    "board_pictures",
    "board_size",
    "distance_from",
    "fine_pitch_from",
    "lens_from_board",
    "lens_from_file",
    "open_scene",
    "pitch_from",
    "point_from",
    "rate_from",
    "track_ball",
]

FloatArray = NDArray[np.float64]

SCENE_FRAMES = 40
"""Number of frames in the median image of the scene (chosen: a moving object covers any point in
fewer than half of them)."""

DEFORMED_S = 0.03
"""s: time after contact during which a struck ball may not be round (chosen)."""

MIN_FLIGHT_FRAMES = 8
"""Frames: a parabola has six parameters, two more show a misfit."""


@dataclass(frozen=True, eq=False)
class WizardClip:
    """A clip at the start of the wizard.

    Attributes
    ----------
    info : ClipInfo
    picture : (H, W) uint8 array
        Median of frames over the whole clip: the scene without moving objects.
    first : (H, W) uint8 array
        The first frame.
    rate : CaptureRate
        From the file or an option.
    """

    info: ClipInfo
    picture: NDArray[np.uint8]
    first: NDArray[np.uint8]
    rate: CaptureRate

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.info.width, self.info.height


@dataclass(frozen=True, eq=False)
class BallSeen:
    """Results of tracking the ball.

    Attributes
    ----------
    rest_px : (2,) array or None
        Centre of its outline at rest, px; None if it is never at rest.
    landing_px : (2,) array or None
        Centre at the lowest point after its flight, px.
    flight : Track or None
        Rows of free flight with a round outline, between contact and landing.
    """

    rest_px: FloatArray | None
    landing_px: FloatArray | None
    flight: Track | None

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """Summarise tracks."""
        ball = tracks.ball
        if tracks.rest_frames is None:
            return cls(None, None, None)
        first, last = tracks.rest_frames
        still = (ball.frame >= first) & (ball.frame <= last)
        rest = np.median(ball.centre_px[still], axis=0) if still.any() else None
        after = ball.where(ball.frame > last)
        if len(after) < MIN_FLIGHT_FRAMES:
            return cls(rest, None, None)
        lowest = int(np.argmax(after.centre_px[:, 1]))
        step = float(np.median(np.diff(after.time_s)))
        round_again = after.frame > last + DEFORMED_S / step
        whole = after.quality >= 0.5 * np.median(after.quality)
        flying = after.where(round_again & whole & (np.arange(len(after)) <= lowest))
        return cls(
            rest, after.centre_px[lowest], flying if len(flying) >= MIN_FLIGHT_FRAMES else None
        )


def open_scene(path: Path, fps: float | None = None) -> WizardClip:
    """Open a clip and compute the median of its frames.

    Raises
    ------
    ClipError
        If it can't be read.
    UsageError
        If `fps` is not a valid rate.
    """
    clip = ClipReader.open(path)
    rate = choose_capture_rate(clip.info, fps)
    stride = max(1, clip.info.frames // SCENE_FRAMES)
    frames = [frame.gray for frame in clip.frames() if frame.index % stride == 0]
    return WizardClip(
        clip.info,
        _eight_bit(np.median(frames, axis=0), frames[0].dtype),
        _eight_bit(frames[0], frames[0].dtype),
        rate,
    )


def _eight_bit(picture: NDArray[np.generic], stored: np.dtype[np.generic]) -> NDArray[np.uint8]:
    levels = np.asarray(picture, dtype=np.float64) / (257.0 if stored == np.uint16 else 1.0)
    return np.asarray(np.round(levels), dtype=np.uint8)


def track_ball(
    path: Path,
    fps: float,
    *,
    ball_at: tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> BallSeen:
    """Track the ball through a clip.

    Raises
    ------
    NotFoundError
        If nothing round moves.
    """
    clip = ClipReader.open(path)
    return BallSeen.of(follow(clip, fps, ball_at=ball_at, progress=progress))


WallSource = Literal["found", "corners", "hand"]

STEP_NAMES = ("clip and rate", "lens", "wall grid", "ball and support", "distances", "check")

"""Names of the six steps, in order."""


@dataclass(frozen=True)
class BallKind:
    """A ball with a name.

    Attributes
    ----------
    name : str
    diameter : float
        m.
    mass : float or None
        kg.
    support_height : float or None
        Height of its usual support, m.
    """

    name: str
    diameter: float
    mass: float | None = None
    support_height: float | None = None


@dataclass(frozen=True, eq=False)
class LensChoice:
    """A lens calibrated beforehand.

    Attributes
    ----------
    prior : LensPrior
        At the size of the clip's image.
    text : str
        Text of the lens file, written again on saving.
    description : str
        Its origin, as text.
    """

    prior: LensPrior
    text: str
    description: str


@dataclass(frozen=True, eq=False)
class Answers:
    """All answers so far, immutable: each change makes a new instance.

    Attributes
    ----------
    scene : WizardClip
    fps : float or None
        Capture rate given or confirmed by the user, 1/s; None: the file's.
    lens : LensChoice or None
        None: from the wall grid.
    pitch, fine_pitch : float
        Of the grid, m; `fine_pitch` is None without fine lines.
    grid : WallGrid or None
        None until it is found.
    grid_source : {"found", "corners", "hand"}
        Found automatically, measured between the corners, or only the corners themselves.
    corners : (4, 2) array or None
        Handles, px: lower left, lower right, upper right, upper left.
    squares : tuple of int
        Squares between the handles, across and up.
    origin_px : (2,) array or None
        Origin of the wall coordinates chosen by the user.
    ball : BallKind or None
    ball_named : bool
        Whether `ball` is a preset.
    seen : BallSeen or None
        Results of tracking.
    rest_px, landing_px : (2,) array or None
        Clicked; they override the results of tracking.
    support_height : float or None
        Height of fall of the ball, m.
    camera_distance, ball_plane_offset : Known or None
        Measured by hand, m.
    out : Path
        The setup file to write.
    """

    scene: WizardClip
    fps: float | None = None
    lens: LensChoice | None = None
    pitch: float = 0.05
    fine_pitch: float | None = 0.01
    grid: WallGrid | None = None
    grid_source: WallSource = "found"
    corners: FloatArray | None = None
    squares: tuple[int, int] = (10, 5)
    origin_px: FloatArray | None = None
    ball: BallKind | None = None
    ball_named: bool = False
    seen: BallSeen | None = None
    rest_px: FloatArray | None = None
    landing_px: FloatArray | None = None
    support_height: float | None = None
    camera_distance: Known | None = None
    ball_plane_offset: Known | None = None
    out: Path = Path("setup.toml")

    @property
    def rate_known(self) -> bool:
        """Whether the capture rate is not assumed."""
        return self.fps is not None or self.scene.rate.source is not RateSource.ASSUMED

    @property
    def capture_fps(self) -> float:
        """Capture rate in use, 1/s."""
        return self.scene.rate.fps if self.fps is None else self.fps

    @property
    def rest(self) -> FloatArray | None:
        """Ball at rest, px: clicked, otherwise tracked."""
        if self.rest_px is not None:
            return self.rest_px
        return None if self.seen is None else self.seen.rest_px

    @property
    def landing(self) -> tuple[FloatArray, bool]:
        """Landing point, px, and whether it is observed rather than assumed."""
        if self.landing_px is not None:
            return self.landing_px, True
        if self.seen is not None and self.seen.landing_px is not None:
            return self.seen.landing_px, True
        width, height = self.scene.size
        left = self.rest is not None and self.rest[0] > 0.5 * width
        return np.array([(0.1 if left else 0.9) * width, 0.85 * height]), False


PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff")

NOTHING = ("", "none", "-", "no")


def rate_from(text: str) -> float | None:
    """Capture rate in 1/s: ``600`` or ``600 fps``; None for nothing.

    Raises
    ------
    UsageError
        If it is not a positive rate.
    """
    if text.strip().lower() in NOTHING:
        return None
    return read_number(text, measurands.CAPTURE_RATE)


def pitch_from(text: str) -> float:
    """Side of a square of the wall grid, m.

    Raises
    ------
    UsageError
        If it is not a length from 1 mm to 2 m.
    """
    return read_number(text, measurands.GRID_PITCH)


def fine_pitch_from(text: str, pitch: float) -> float | None:
    """Distance between fine lines, m; None for none.

    Raises
    ------
    UsageError
        If it is not smaller than the pitch.
    """
    if text.strip().lower() in NOTHING:
        return None
    fine = read_number(text, measurands.FINE_PITCH)
    if fine >= pitch:
        raise UsageError(
            f"fine lines at {1e3 * fine:g} mm are not finer than the grid's {1e3 * pitch:g} mm",
            hint="Leave the field empty if there are no fine lines.",
        )
    return fine


def distance_from(text: str) -> Known | None:
    """A measured length, ``4.00 m`` or ``4.00 m ± 3 mm``; None for nothing.

    Raises
    ------
    UsageError
        If the length or its uncertainty is not positive.
    """
    if text.strip().lower() in NOTHING:
        return None
    taped = read_given(text, measurands.CAMERA_DISTANCE)
    return Known(taped.value, Defaults.TAPE.std if taped.std is None else taped.std)


def ball_from(text: str, presets: Sequence[BallKind]) -> BallKind | None:
    """A ball by its preset's name, or by diameter and optional mass: ``220 mm, 0.4 kg``.

    Raises
    ------
    UsageError
        If it is neither.
    """
    if text.strip().lower() in NOTHING:
        return None
    named = {kind.name: kind for kind in presets}
    if text.strip() in named:
        return named[text.strip()]
    size, _, weight = text.partition(",")
    try:
        diameter = read_number(size, measurands.BALL_DIAMETER)
    except UnitError as problem:
        raise UsageError(
            f"the ball {text!r} is neither a preset nor a diameter",
            hint=f"Presets: {', '.join(named)}; or a diameter such as '220 mm'.",
        ) from problem
    mass = read_number(weight, measurands.BALL_MASS) if weight.strip() else None
    return BallKind("ball", diameter, mass)


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


def lens_from_file(path: Path, size: tuple[int, int]) -> LensChoice:
    """A lens file, for images of that size.

    Raises
    ------
    SetupError
        As `calib.lens.read_lens`.
    """
    prior = read_lens(path, width=size[0], height=size[1])
    return LensChoice(prior, path.read_text(encoding="utf-8"), f"lens file {path.name}")


def lens_from_board(
    pictures: Sequence[tuple[str, bytes]], board: Board, size: tuple[int, int]
) -> LensChoice:
    """Calibrate the lens from images of a board, given as names and contents of files.

    Raises
    ------
    ClipError
        If a file is not an image.
    CalibrationError
        If the calibration fails, or the images have another aspect ratio than the clip.
    """
    views = [find_board(_decoded(name, data), board, name) for name, data in pictures]
    found = calibrate_lens(views)
    lens = found.lens
    if abs(size[0] / size[1] - lens.width / lens.height) > 0.01 * size[0] / size[1]:
        raise UsageError(
            f"the board was filmed at {lens.width}×{lens.height} px, the clip at "
            f"{size[0]}×{size[1]} px, another aspect ratio: the lens does not apply",
            hint="Film the board in the mode of the clip; other modes crop the sensor.",
        )
    description = (
        f"{len(found.used)} views of a board, held-out error {found.held_out_rms_px:.2f} px"
        + "".join(f"; {warning}" for warning in found.warnings)
    )
    return LensChoice(found.prior.resized(*size), lens_toml(found), description)


def _decoded(name: str, data: bytes) -> NDArray[np.uint8]:
    picture = decoded_image(data, cv2.IMREAD_GRAYSCALE, name)
    if picture is None:
        raise ClipError(f"{name} is not a readable image", hint="Pass JPEG or PNG files.")
    return np.asarray(picture, dtype=np.uint8)


def board_size(text: str) -> tuple[int, int]:
    """Inner corners of a board, ``8x6``.

    Raises
    ------
    UsageError
        If it is not a pair of numbers from 3 up.
    """
    match = re.fullmatch(r"\s*(\d+)\s*[x×]\s*(\d+)\s*", text)
    if match is None or min(int(n) for n in match.groups()) < 3:
        raise UsageError(
            f"{text!r} is not a board size", hint="Write inner corners as columns x rows: 8x6."
        )
    return int(match[1]), int(match[2])


def board_pictures(folder: Path) -> list[tuple[str, bytes]]:
    """Names and contents of the images in a folder.

    Raises
    ------
    UsageError
        If there is no such folder, or no image in it.
    """
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}", hint="Pass the folder of the images.")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    if not found:
        raise UsageError(
            f"there is no image in {folder}", hint=f"Accepted endings: {', '.join(PICTURES)}."
        )
    return [(path.name, path.read_bytes()) for path in found]
