"""What the user has said or accepted so far, step by step; never changed, only replaced.

What people type into the wizard's fields, turned into answers or a refusal that helps.

What a clip shows before any question is asked: its still scene, its rate, the ball followed.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.calibration import Known
from calib.grid import WallGrid
from calib.lens import Board, LensPrior, calibrate_lens, find_board, lens_toml, read_lens
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
    "STEPS",
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
    "look_at",
    "pitch_from",
    "point_from",
    "rate_from",
    "watch_ball",
]

FloatArray = NDArray[np.float64]

FRAMES_LOOKED_AT = 40

"""Frames whose median is the still scene: what moves hides a place in fewer than half of them."""

SQUASHED_S = 0.03

"""A struck ball is round again after this."""

LEAST_FLIGHT = 8

"""Frames of a flight at least: a parabola has six numbers, and two more show a misfit."""


@dataclass(frozen=True, eq=False)
class WizardClip:
    """A clip as the wizard starts from it.

    Attributes
    ----------
    info : ClipInfo
    picture : (H, W) uint8 array
        Median of frames over the whole clip: the scene without what moves.
    first : (H, W) uint8 array
        The first frame.
    rate : CaptureRate
        As the file or an option tells it.
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
    """What following the ball told.

    Attributes
    ----------
    rest_px : (2,) array or None
        Centre of its outline at rest, px; None if it never rests.
    landing_px : (2,) array or None
        Centre where it is lowest after its flight, px.
    flight : Track or None
        Rows in which it flies and is round, between contact and landing.
    """

    rest_px: FloatArray | None
    landing_px: FloatArray | None
    flight: Track | None

    @classmethod
    def of(cls, tracks: Tracks) -> Self:
        """Sum up tracks."""
        ball = tracks.ball
        if tracks.rest_frames is None:
            return cls(None, None, None)
        first, last = tracks.rest_frames
        still = (ball.frame >= first) & (ball.frame <= last)
        rest = np.median(ball.centre_px[still], axis=0) if still.any() else None
        after = ball.where(ball.frame > last)
        if len(after) < LEAST_FLIGHT:
            return cls(rest, None, None)
        lowest = int(np.argmax(after.centre_px[:, 1]))
        step = float(np.median(np.diff(after.time_s)))
        round_again = after.frame > last + SQUASHED_S / step
        whole = after.quality >= 0.5 * np.median(after.quality)
        flying = after.where(round_again & whole & (np.arange(len(after)) <= lowest))
        return cls(rest, after.centre_px[lowest], flying if len(flying) >= LEAST_FLIGHT else None)


def look_at(path: Path, fps: float | None = None) -> WizardClip:
    """Open a clip and take the median of its frames.

    Raises
    ------
    ClipError
        If it can't be read.
    UsageError
        If `fps` is no rate.
    """
    clip = ClipReader.open(path)
    rate = choose_capture_rate(clip.info, fps)
    stride = max(1, clip.info.frames // FRAMES_LOOKED_AT)
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


def watch_ball(
    path: Path,
    fps: float,
    *,
    ball_at: tuple[float, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> BallSeen:
    """Follow the ball through a clip.

    Raises
    ------
    NotFoundError
        If nothing round moves in it.
    """
    clip = ClipReader.open(path)
    return BallSeen.of(follow(clip, fps, ball_at=ball_at, progress=progress))


WallSource = Literal["found", "corners", "hand"]

STEPS = ("clip and rate", "lens", "wall grid", "ball and support", "distances", "check")

"""Names of the six steps, in order."""


@dataclass(frozen=True)
class BallKind:
    """A ball somebody can name.

    Attributes
    ----------
    name : str
    diameter : float
        m.
    mass : float or None
        kg.
    support_height : float or None
        Height of the support it usually lies on, m.
    """

    name: str
    diameter: float
    mass: float | None = None
    support_height: float | None = None


@dataclass(frozen=True, eq=False)
class LensChoice:
    """A lens known beforehand.

    Attributes
    ----------
    prior : LensPrior
        At the size of the clip's picture.
    text : str
        The lens file, for writing it anew.
    told : str
        Where it comes from, in words.
    """

    prior: LensPrior
    text: str
    told: str


@dataclass(frozen=True, eq=False)
class Answers:
    """All answers.

    Attributes
    ----------
    scene : WizardClip
    fps : float or None
        Capture rate the user gave or confirmed, 1/s; None leaves what the file tells.
    lens : LensChoice or None
        None: from the wall grid.
    pitch, fine_pitch : float
        Of the grid, m; `fine_pitch` None where there are no fine lines.
    grid : WallGrid or None
        None while there is none.
    grid_source : {"found", "corners", "hand"}
        Found unaided, measured between the corners, or only the corners themselves.
    corners : (4, 2) array or None
        Handles, px: lower left, lower right, upper right, upper left.
    squares : tuple of int
        Squares between the handles, across and up.
    origin_px : (2,) array or None
        Where the user set the origin of the wall's coordinates.
    ball : BallKind or None
    ball_named : bool
        Whether `ball` is a preset.
    seen : BallSeen or None
        What following told.
    rest_px, landing_px : (2,) array or None
        Clicked; they go before what following told.
    support_height : float or None
        How far the ball falls, m.
    camera_distance, ball_plane_offset : Known or None
        By tape, m.
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
        """Whether the capture rate is more than a guess."""
        return self.fps is not None or self.scene.rate.source is not RateSource.ASSUMED

    @property
    def capture_fps(self) -> float:
        """The rate to work with, 1/s."""
        return self.scene.rate.fps if self.fps is None else self.fps

    @property
    def rest(self) -> FloatArray | None:
        """Ball at rest, px: clicked, else followed."""
        if self.rest_px is not None:
            return self.rest_px
        return None if self.seen is None else self.seen.rest_px

    @property
    def landing(self) -> tuple[FloatArray, bool]:
        """Where the ball lands, px, and whether that is more than supposed."""
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
        If it is no positive rate.
    """
    if text.strip().lower() in NOTHING:
        return None
    return read_number(text, measurands.CAPTURE_RATE)


def pitch_from(text: str) -> float:
    """Side of a square of the wall grid, m.

    Raises
    ------
    UsageError
        If it is no length of 1 mm to 2 m.
    """
    return read_number(text, measurands.GRID_PITCH)


def fine_pitch_from(text: str, pitch: float) -> float | None:
    """Distance between fine lines, m; None for none.

    Raises
    ------
    UsageError
        If it is no smaller than the pitch.
    """
    if text.strip().lower() in NOTHING:
        return None
    fine = read_number(text, measurands.FINE_PITCH)
    if fine >= pitch:
        raise UsageError(
            f"fine lines {1e3 * fine:g} mm apart are no finer than the grid's {1e3 * pitch:g} mm",
            hint="Leave it empty where there are none.",
        )
    return fine


def distance_from(text: str) -> Known | None:
    """A taped length, ``4.00 m`` or ``4.00 m ± 3 mm``; None for nothing.

    Raises
    ------
    UsageError
        If it is no positive length, or its uncertainty is none.
    """
    if text.strip().lower() in NOTHING:
        return None
    taped = read_given(text, measurands.CAMERA_DISTANCE)
    return Known(taped.value, Defaults.TAPE.std if taped.std is None else taped.std)


def ball_from(text: str, presets: Sequence[BallKind]) -> BallKind | None:
    """A ball by its preset's name, or by diameter and maybe mass: ``220 mm, 0.4 kg``.

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
    """A place in a picture of that size, ``X,Y`` in px: (2,).

    Raises
    ------
    UsageError
        If it is no pair of numbers, or not in the picture.
    """
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError as problem:
        raise UsageError(f"{text!r} is no place", hint="Write X,Y in px: 105,265.") from problem
    if not (0.0 <= x <= size[0] - 1.0 and 0.0 <= y <= size[1] - 1.0):
        raise UsageError(
            f"the place {text} is outside the picture", hint=f"It has {size[0]} × {size[1]} px."
        )
    return np.array([x, y])


def lens_from_file(path: Path, size: tuple[int, int]) -> LensChoice:
    """A lens file, for pictures of that size.

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
    """The lens from pictures of a board: names and contents of picture files.

    Raises
    ------
    ClipError
        If one is no picture.
    CalibrationError
        If the lens can't be had from them, or they have another shape than the clip.
    """
    views = [find_board(_decoded(name, data), board, name) for name, data in pictures]
    found = calibrate_lens(views)
    lens = found.lens
    if abs(size[0] / size[1] - lens.width / lens.height) > 0.01 * size[0] / size[1]:
        raise UsageError(
            f"the board was filmed at {lens.width}×{lens.height} px, the clip at "
            f"{size[0]}×{size[1]}: another shape",
            hint="Film the board in the mode the clip is filmed in: other modes crop the sensor.",
        )
    told = (
        f"{len(found.used)} views of a board, held-out error {found.held_out_rms_px:.2f} px"
        + "".join(f"; {warning}" for warning in found.warnings)
    )
    return LensChoice(found.prior.resized(*size), lens_toml(found), told)


def _decoded(name: str, data: bytes) -> NDArray[np.uint8]:
    picture = decoded_image(data, cv2.IMREAD_GRAYSCALE, name)
    if picture is None:
        raise ClipError(f"{name} is no picture that can be read", hint="Give JPEG or PNG files.")
    return np.asarray(picture, dtype=np.uint8)


def board_size(text: str) -> tuple[int, int]:
    """Inner corners of a board, ``8x6``.

    Raises
    ------
    UsageError
        If it is no pair of numbers from 3 up.
    """
    match = re.fullmatch(r"\s*(\d+)\s*[x×]\s*(\d+)\s*", text)
    if match is None or min(int(n) for n in match.groups()) < 3:
        raise UsageError(
            f"{text!r} is no board size", hint="Write inner corners as columns x rows: 8x6."
        )
    return int(match[1]), int(match[2])


def board_pictures(folder: Path) -> list[tuple[str, bytes]]:
    """Names and contents of the pictures in a folder.

    Raises
    ------
    UsageError
        If there is no such folder, or no picture in it.
    """
    if not folder.is_dir():
        raise UsageError(f"there is no folder {folder}", hint="Name the folder of the pictures.")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in PICTURES)
    if not found:
        raise UsageError(
            f"there is no picture in {folder}", hint=f"Looked for {', '.join(PICTURES)}."
        )
    return [(path.name, path.read_bytes()) for path in found]
