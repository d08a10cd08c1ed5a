"""Description of a scene: room, light, camera, sensor and encoding."""

from dataclasses import dataclass
from typing import Literal

from calib.camera import Camera
from metrology import UsageError
from physics.bodies import JOKKU, PAPER_PENDULUM, PAPER_SUPPORT, Ball, Pendulum, Support

__all__ = [
    "BallLook",
    "Encoding",
    "Lamp",
    "Lighting",
    "LooseBall",
    "Room",
    "Scene",
    "Sensor",
    "Shake",
    "Shutter",
    "SwingingScale",
    "Wall",
]

Colour = tuple[float, float, float]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Wall:
    """The gridded wall z = 0. Lengths in m; contrast is the fraction of light a line absorbs.

    Attributes
    ----------
    pitch, line_width, contrast
        Of the squares.
    fine_pitch, fine_width, fine_contrast
        Of the gradations; contrast 0 leaves them out.
    origin : (2,) tuple
        A crossing of the squares' lines, x and y.
    colour
        Reflectance, red green blue.
    """

    pitch: float = 0.05
    line_width: float = 0.002
    contrast: float = 0.72
    fine_pitch: float = 0.01
    fine_width: float = 0.0009
    fine_contrast: float = 0.42
    origin: tuple[float, float] = (0.0, 0.0)
    colour: Colour = (0.85, 0.85, 0.83)


@dataclass(frozen=True)
class Lamp:
    """A spherical lamp: position (m), radius (m), brightness at the ball."""

    position: Vector
    radius: float = 0.12
    power: float = 0.5
    colour: Colour = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Lighting:
    """All light: lamps, the light from everywhere, and the mains' flicker (relative depth)."""

    lamps: tuple[Lamp, ...] = (
        Lamp((-1.0, 2.9, 4.0), 0.09, 0.62, (1.0, 0.98, 0.94)),
        Lamp((3.1, 2.4, 3.9), 0.14, 0.2, (0.97, 0.98, 1.0)),
    )
    ambient: Colour = (0.24, 0.245, 0.25)
    unevenness: float = 0.05
    flicker: float = 0.03
    flicker_hz: float = 100.0


@dataclass(frozen=True)
class BallLook:
    """How the ball is painted.

    Attributes
    ----------
    pattern
        "jokku": dark patches on white; "basketball": seams on leather; "plain".
    base, mark
        Reflectance of ground and marks, red green blue.
    bulge : float
        Sideways widening of a compressed ball over its relative compression.
    """

    pattern: Literal["jokku", "basketball", "plain"] = "jokku"
    base: Colour = (0.86, 0.86, 0.84)
    mark: Colour = (0.05, 0.06, 0.22)
    gloss: float = 0.12
    bulge: float = 0.3


@dataclass(frozen=True)
class SwingingScale:
    """A hanging, swinging body that is not the pendulum: a spring scale on its cord."""

    hook: Vector = (1.6, 1.5, 0.25)
    length: float = 0.55
    amplitude: float = 0.25
    frequency: float = 0.65
    phase: float = 0.4
    size: Vector = (0.07, 0.16, 0.04)
    colour: Colour = (0.55, 0.16, 0.12)


@dataclass(frozen=True)
class LooseBall:
    """A second ball that is not struck: at rest, or rolling with `velocity` (m/s)."""

    centre: Vector
    radius: float = 0.1
    velocity: Vector = (0.0, 0.0, 0.0)
    look: BallLook = BallLook("plain", (0.75, 0.7, 0.2))


@dataclass(frozen=True)
class Room:
    """Bodies in the picture; m.

    Attributes
    ----------
    bar_width : float
        Of the pendulum's arm: a bar, a rod or a cord.
    block : (3,) tuple
        Depth, height and thickness of the striking mass.
    bob_radius : float
        Of a sphere that strikes in its place; 0 is none.
    block_colour : (3,) tuple
        Reflectance of either, red green blue.
    """

    wall: Wall = Wall()
    lighting: Lighting = Lighting()
    floor_colour: Colour = (0.3, 0.26, 0.225)
    plane: float = 0.45
    show_rig: bool = True
    show_support: bool = True
    show_ball: bool = True
    bar_width: float = 0.022
    block: Vector = (0.09, 0.085, 0.085)
    bob_radius: float = 0.0
    block_colour: Colour = (0.19, 0.19, 0.195)
    scales: tuple[SwingingScale, ...] = ()
    loose_balls: tuple[LooseBall, ...] = ()


@dataclass(frozen=True)
class Shutter:
    """Exposure timing.

    Attributes
    ----------
    fps : float
        True capture rate, 1/s.
    exposure : float
        s.
    readout : float
        Rolling shutter: how much later the last row is exposed than the first, s; 0 is global.
    first : float
        Mid-exposure (at the middle row) of frame 0, s; t = 0 is the first touch.
    """

    fps: float = 600.0
    exposure: float = 1.0 / 1000.0
    readout: float = 0.0
    first: float = -0.0838


@dataclass(frozen=True)
class Sensor:
    """From light to numbers.

    Attributes
    ----------
    gain : float
        Multiplies the light: 1 puts a well lit wall near two thirds of full scale.
    full_well : float
        Electrons at full scale; 0 turns shot noise off.
    read_noise : float
        Electrons.
    blur : float
        Standard deviation of the optics' point spread, px.
    vignetting : float
        Fraction of light lost in the corners.
    gamma : float
        Encoding exponent; 1 writes linear light.
    """

    gain: float = 1.0
    full_well: float = 9000.0
    read_noise: float = 18.0
    blur: float = 0.45
    vignetting: float = 0.12
    gamma: float = 2.2


@dataclass(frozen=True)
class Shake:
    """Camera shake; px at the middle of the picture.

    Attributes
    ----------
    amplitude : float
        Standard deviation of a slow tremor.
    frequency : float
        About how fast it trembles, 1/s.
    drift : (2,) tuple
        Steady drift right and down, px/s.
    bump : (3,) tuple
        From this frame on the view is moved right and down by so much.
    """

    amplitude: float = 0.0
    frequency: float = 8.0
    drift: tuple[float, float] = (0.0, 0.0)
    bump: tuple[int, float, float] | None = None

    @property
    def still(self) -> bool:
        """Whether the camera stands on a tripod."""
        return self.amplitude == 0.0 and self.drift == (0.0, 0.0) and self.bump is None


@dataclass(frozen=True)
class Encoding:
    """How the clip is written.

    Attributes
    ----------
    codec
        "h264", "mjpeg", lossless "ffv1", or "png" for a folder of pictures.
    bitrate : float
        bit/s of played time.
    rate_factor : float or None
        H.264 at constant quality (x264's CRF) instead of at a bitrate.
    container_fps : float
        Frame rate stated in the file.
    dropped : tuple of int
        Captured frames that never reach the file.
    """

    codec: Literal["h264", "mjpeg", "ffv1", "png"] = "h264"
    bitrate: float = 1.2e6
    rate_factor: float | None = None
    container_fps: float = 30.0
    dropped: tuple[int, ...] = ()


@dataclass(frozen=True)
class Scene:
    """Complete description of a clip.

    Attributes
    ----------
    camera : Camera
        Where the camera is when it does not shake.
    frames : int
        How many are captured.
    seed : int
        The same scene with the same seed is the same clip, bit for bit before encoding.
    mirrored : bool
        Written as seen in a mirror: the ball is struck to the left.
    launch_angle : float or None
        Angle of the pendulum at first touch, rad; None takes the ball's own.
    """

    camera: Camera
    ball: Ball = JOKKU
    pendulum: Pendulum = PAPER_PENDULUM
    support: Support = PAPER_SUPPORT
    look: BallLook = BallLook()
    room: Room = Room()
    shutter: Shutter = Shutter()
    sensor: Sensor = Sensor()
    shake: Shake = Shake()
    encoding: Encoding = Encoding()
    frames: int = 300
    seed: int = 1
    mirrored: bool = False
    launch_angle: float | None = None

    def __post_init__(self) -> None:
        checks = (
            (self.frames >= 1, f"a clip needs one frame or more, not {self.frames}"),
            (self.shutter.fps > 0, f"a capture rate of {self.shutter.fps} fps"),
            (
                0 < self.shutter.exposure <= 1.0 / self.shutter.fps,
                f"a shutter of {self.shutter.exposure:g} s does not fit into a frame",
            ),
            (
                0 <= self.shutter.readout <= 1.0 / self.shutter.fps,
                f"a readout of {self.shutter.readout:g} s does not fit into a frame",
            ),
            (self.encoding.bitrate > 0, f"a bitrate of {self.encoding.bitrate:g} bit/s"),
            (self.encoding.container_fps > 0, f"{self.encoding.container_fps:g} fps in the file"),
            (self.room.plane > self.ball.radius, "the ball would be inside the wall"),
            (self.camera.position[2] > self.room.plane, "the camera is behind the ball's plane"),
        )
        for possible, message in checks:
            if not possible:
                raise UsageError(f"this scene can't be rendered: {message}")

    @property
    def contact_angle(self) -> float:
        """Angle of the pendulum at first touch, rad."""
        return self.ball.launch_angle if self.launch_angle is None else self.launch_angle

    def frame_time(self, frame: int) -> float:
        """Mid-exposure of a captured frame at the middle row, s."""
        return self.shutter.first + frame / self.shutter.fps
