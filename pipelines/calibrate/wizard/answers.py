"""What the user has said or accepted so far, step by step; never changed, only replaced."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.camera.lens_prior import LensPrior
from calib.evidence import Known
from calib.grid.grid import WallGrid
from pipelines.calibrate.wizard.scene import BallSeen, Scene
from vision.clip.capture_rate import RateSource

__all__ = ["STEPS", "Answers", "BallKind", "LensChoice", "WallSource"]

FloatArray = NDArray[np.float64]
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
    scene : Scene
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

    scene: Scene
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
