"""Simulate a strike as a motion to render, and default scenes to render it in."""

import math
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from calib.camera import Camera, Lens, rotation_matrix
from metrology import DomainError, UsageError
from physics.air import PAPER_AIR, SUBCRITICAL_DRAG, Air
from physics.bodies import BALLS, GRAVITY, PAPER_PENDULUM, PAPER_SUPPORT, Ball, Pendulum, Support
from physics.contact import ContactHistory, simulate_contact
from physics.effects import Term
from physics.effects.flight import CoefficientCurve, Magnus
from physics.flight import FlightModel, FlightPath, fly
from physics.forward import Experiment
from physics.swing import SwingModel, SwingPath, swing, swing_on
from sample_videos.scene import BallLook, Encoding, Room, Scene, Sensor, Shutter

__all__ = [
    "BALL_LOOKS",
    "HermiteCurve",
    "Physics",
    "Piece",
    "SampledMotion",
    "SceneMotion",
    "SceneState",
    "Shot",
    "View",
    "default_scene",
    "look_of",
    "staged",
    "strike",
]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SceneState:
    """State of the moving things at N instants, world frame, SI.

    Attributes
    ----------
    ball : (N, 3) array
        Centre of the ball, m.
    attitude : (N, 3, 3) array
        Rotation from the ball's own frame, in which its panels are painted, to the world.
    compression : (N, 3) array
        Points from the ball's centre to the face that presses it, m; its length is the depth by
        which the ball is flattened there. Zero where nothing presses.
    phi : (N,) array
        Angle of the pendulum, rad, 0 at the lowest point, positive forward.
    """

    ball: FloatArray
    attitude: FloatArray
    compression: FloatArray
    phi: FloatArray


class SceneMotion(Protocol):
    """Anything that gives the positions of ball and pendulum."""

    def at(self, times: ArrayLike) -> SceneState:
        """State at `times` (N,), s; t = 0 is the first touch of face and ball."""
        ...


@dataclass(frozen=True)
class Piece:
    """Samples of a smooth piece of a curve: instants (M,) s, values (M, K), rates (M, K)."""

    time: FloatArray
    value: FloatArray
    rate: FloatArray

    def __post_init__(self) -> None:
        if len(self.time) < 2 or np.any(np.diff(self.time) <= 0.0):
            raise DomainError("a piece of a motion needs two or more instants in increasing order")


class HermiteCurve:
    """A piecewise smooth curve: cubic Hermite within each piece, kinks where pieces meet.

    Before the first and after the last sample it goes on straight.

    Parameters
    ----------
    pieces : sequence of Piece
        In time order, each starting where the one before ends.
    """

    def __init__(self, pieces: tuple[Piece, ...]) -> None:
        self._starts = np.array([piece.time[0] for piece in pieces[1:]])
        self._splines = [CubicHermiteSpline(p.time, p.value, p.rate) for p in pieces]
        self._first, self._last = pieces[0], pieces[-1]

    @classmethod
    def constant(cls, value: ArrayLike) -> "HermiteCurve":
        """A curve that stays at `value` (K,)."""
        row = np.asarray(value, dtype=np.float64)
        level = np.stack([row, row])
        return cls((Piece(np.array([0.0, 1.0]), level, np.zeros_like(level)),))

    def at(self, times: ArrayLike) -> FloatArray:
        """Values at `times` (N,), (N, K)."""
        t = np.asarray(times, dtype=np.float64)
        start, end = self._first.time[0], self._last.time[-1]
        inside = np.clip(t, start, end)
        index = np.searchsorted(self._starts, inside, side="right")
        found = np.empty((len(t), self._first.value.shape[1]))
        for i in np.unique(index):
            here = index == i
            found[here] = self._splines[i](inside[here])
        early, late = np.minimum(t - start, 0.0), np.maximum(t - end, 0.0)
        found += early[:, np.newaxis] * self._first.rate[0]
        found += late[:, np.newaxis] * self._last.rate[-1]
        return found


@dataclass(frozen=True)
class SampledMotion:
    """A motion given by curves.

    Attributes
    ----------
    ball : HermiteCurve
        Centre, (N, 3) m.
    pendulum : HermiteCurve
        Angle, (N, 1) rad.
    compression : HermiteCurve
        As in `SceneState`, (N, 3) m.
    turn : HermiteCurve
        Angle by which the ball has turned about `spin_axis`, (N, 1) rad.
    spin_axis : (3,) array
        Unit vector in the world.
    attitude : (3, 3) array
        Rotation from the ball's own frame to the world at turn 0.
    """

    ball: HermiteCurve
    pendulum: HermiteCurve
    compression: HermiteCurve
    turn: HermiteCurve
    spin_axis: FloatArray
    attitude: FloatArray

    def at(self, times: ArrayLike) -> SceneState:
        """State at `times` (N,), s."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        angle = self.turn.at(t)[:, 0]
        unique, inverse = np.unique(angle, return_inverse=True)
        turned = np.stack([rotation_matrix(self.spin_axis * a) @ self.attitude for a in unique])
        return SceneState(
            ball=self.ball.at(t),
            attitude=turned[inverse],
            compression=self.compression.at(t),
            phi=self.pendulum.at(t)[:, 0],
        )


SIMULATED_BOUNCES = 3

"""Simulated bounces after landing (chosen): with a floor_cor of 0.7 the third is a tenth as
high."""

FOLLOW_THROUGH = 4.0

"""Simulated time of the pendulum after release, s (chosen: longer than any clip)."""


@dataclass(frozen=True)
class Physics:
    """Physics of the strike besides the bodies.

    Attributes
    ----------
    backswing : float
        Angle of release behind the lowest point, rad.
    gravity : float
        m/s².
    lift_coefficient : float
        Of the Magnus force on a spinning ball; 0 leaves it out.
    face_friction : float
        Coulomb coefficient between face and ball; it makes the ball spin.
    cor, contact_time : float or None
        Result of this contact (1, s); None uses the ball's laws.
    effects : tuple of Term
        Further effects in flight and on the pendulum.
    floor_cor : float
        Coefficient of restitution of ball and floor, after landing.
    """

    backswing: float
    gravity: float = GRAVITY
    air: Air = PAPER_AIR
    drag_coefficient: float | CoefficientCurve = SUBCRITICAL_DRAG
    lift_coefficient: float = 0.0
    face_friction: float = 0.0
    cor: float | None = None
    contact_time: float | None = None
    effects: tuple[Term, ...] = ()
    floor_cor: float = 0.7


@dataclass(frozen=True)
class Shot:
    """A stroke: what happened, and the motion to film.

    Attributes
    ----------
    swing, contact, flight
        Histories from the physics, each from its own time 0.
    motion : SampledMotion
        t = 0 at first touch.
    """

    swing: SwingPath
    contact: ContactHistory
    flight: FlightPath
    motion: SampledMotion
    physics: Physics

    @property
    def contact_time(self) -> float:
        """S."""
        return float(self.contact.time[-1])

    @property
    def landing_time(self) -> float:
        """From first touch, s."""
        return self.contact_time + self.flight.landing_time


def strike(scene: Scene, physics: Physics) -> Shot:
    """Simulate one strike in a scene.

    Raises
    ------
    DomainError
        If the pendulum does not reach the ball, or the ball is not released.
    UsageError
        If the ball does not fly off.
    """
    ball = replace(scene.ball, launch_angle=scene.contact_angle)
    down = swing(
        scene.pendulum,
        physics.backswing,
        scene.contact_angle,
        terms=physics.effects,
        gravity=physics.gravity,
        samples=801,
    )
    contact = simulate_contact(
        scene.pendulum,
        ball,
        scene.support,
        down.speed_at_contact,
        gravity=physics.gravity,
        cor=physics.cor,
        contact_time=physics.contact_time,
        friction=physics.face_friction,
        samples=401,
    )
    out = contact.outcome
    if out.ball_vx <= 0.0:
        raise UsageError("this ball does not fly forward", hint="Increase the back-swing.")
    flight = fly(
        _in_the_air(scene, physics, float(out.ball_spin)),
        (float(out.ball_x), float(out.ball_y), scene.room.plane),
        (float(out.ball_vx), float(out.ball_vy), 0.0),
        floor=ball.radius,
        samples=401,
    )
    return Shot(down, contact, flight, _motion(scene, physics, down, contact, flight), physics)


def _in_the_air(scene: Scene, physics: Physics, spin: float) -> FlightModel:
    """Gravity, drag, the lift on the ball's own spin (rad/s), and further effects."""
    model = replace(
        Experiment(scene.ball, air=physics.air, drag_coefficient=physics.drag_coefficient).flight,
        gravity=physics.gravity,
    )
    if physics.lift_coefficient:
        lift = Term(Magnus(), {"spin": physics.lift_coefficient * spin})
        model = model.with_terms(lift)
    return model.with_terms(*physics.effects)


def _motion(
    scene: Scene, physics: Physics, down: SwingPath, contact: ContactHistory, flight: FlightPath
) -> SampledMotion:
    start = down.time[-1]
    swinging = Piece(down.time - start, _column(down.phi), _column(down.omega))
    pressed = Piece(contact.time, _column(contact.phi), _column(contact.omega))
    pendulum = HermiteCurve((swinging, pressed, _follow_through(scene, physics, contact)))
    turning = np.concatenate(
        [
            [0.0],
            np.cumsum(
                0.5 * (contact.ball_spin[1:] + contact.ball_spin[:-1]) * np.diff(contact.time)
            ),
        ]
    )
    last = float(contact.ball_spin[-1])
    turn = HermiteCurve(
        (
            Piece(np.array([-9.0, 0.0]), np.zeros((2, 1)), np.zeros((2, 1))),
            Piece(contact.time, _column(turning), _column(contact.ball_spin)),
            Piece(
                contact.time[-1] + np.array([0.0, 9.0]),
                turning[-1] + last * np.array([[0.0], [9.0]]),
                np.full((2, 1), last),
            ),
        )
    )
    look = np.random.default_rng([scene.seed, 11]).normal(0.0, 0.9, 3)
    return SampledMotion(
        ball=_ball_curve(scene, physics, contact, flight),
        pendulum=pendulum,
        compression=_compression_curve(contact),
        turn=turn,
        spin_axis=np.array([0.0, 0.0, 1.0]),
        attitude=rotation_matrix(look),
    )


def _column(values: FloatArray) -> FloatArray:
    return np.asarray(values, dtype=np.float64)[:, np.newaxis]


def _compression_curve(contact: ContactHistory) -> HermiteCurve:
    towards = -np.stack([np.cos(contact.phi), np.sin(contact.phi), np.zeros_like(contact.phi)], 1)
    value = np.maximum(contact.compression, 0.0)[:, np.newaxis] * towards
    value[[0, -1]] = 0.0
    rate = np.gradient(value, contact.time, axis=0)
    none = np.zeros((2, 3))
    return HermiteCurve(
        (
            Piece(np.array([-9.0, 0.0]), none, none),
            Piece(contact.time, value, rate),
            Piece(contact.time[-1] + np.array([0.0, 9.0]), none, none),
        )
    )


def _ball_curve(
    scene: Scene, physics: Physics, contact: ContactHistory, flight: FlightPath
) -> HermiteCurve:
    plane = np.full_like(contact.ball_x, scene.room.plane)
    rest = np.array([0.0, scene.support.height + scene.ball.radius, scene.room.plane])
    zero = np.zeros_like(plane)
    pieces = [
        Piece(np.array([-9.0, 0.0]), np.stack([rest, rest]), np.zeros((2, 3))),
        Piece(
            contact.time,
            np.stack([contact.ball_x, contact.ball_y, plane], 1),
            np.stack([contact.ball_vx, contact.ball_vy, zero], 1),
        ),
    ]
    leg, begin = flight, float(contact.time[-1])
    pieces.append(Piece(begin + leg.time, leg.position, leg.velocity))
    for _ in range(SIMULATED_BOUNCES):
        begin += leg.landing_time
        off = leg.landing_velocity * [0.85, -physics.floor_cor, 0.85]
        if off[1] < 0.05:
            break
        leg = fly(
            _in_the_air(scene, physics, float(contact.outcome.ball_spin)),
            tuple(leg.landing_position + np.array([0.0, 1e-9, 0.0])),
            tuple(off),
            floor=scene.ball.radius,
            samples=101,
        )
        pieces.append(Piece(begin + leg.time, leg.position, leg.velocity))
    roll = np.array([leg.landing_velocity[0], 0.0, leg.landing_velocity[2]])
    end = leg.landing_position
    begin += leg.landing_time
    pieces.append(
        Piece(begin + np.array([0.0, 1.0]), np.stack([end, end + roll]), np.stack([roll, roll]))
    )
    return HermiteCurve(tuple(pieces))


def _follow_through(scene: Scene, physics: Physics, contact: ContactHistory) -> Piece:
    """The pendulum after release."""
    model = SwingModel.of(scene.pendulum, physics.effects, physics.gravity)
    time = np.linspace(0.0, FOLLOW_THROUGH, 1601)
    phi, omega = swing_on(model, float(contact.phi[-1]), float(contact.omega[-1]), time)
    return Piece(contact.time[-1] + time, _column(phi), _column(omega))


View = Literal["landing", "impact", "oblique"]

BALL_LOOKS = {
    "jokku": BallLook(),
    "basketball": BallLook("basketball", (0.68, 0.24, 0.055), (0.03, 0.025, 0.025), gloss=0.06),
}

SIDE_M = 0.28

"""Visible width behind the ball at rest, m (chosen)."""


def look_of(ball: Ball) -> BallLook:
    """How a ball is painted: its own way if it is one of the paper's, with dark patches if not."""
    return BALL_LOOKS.get(ball.name, BALL_LOOKS["jokku"])


def default_scene(
    *,
    ball: Ball = BALLS["jokku"],
    size: tuple[int, int] = (432, 240),
    reach: float = 2.62,
    view: View = "landing",
    distance: float | None = None,
    foot: tuple[float, float] | None = None,
    plane: float = 0.45,
    pendulum: Pendulum = PAPER_PENDULUM,
    support: Support = PAPER_SUPPORT,
    seed: int = 1,
) -> Scene:
    """Scene with a camera on a tripod and good light.

    Parameters
    ----------
    size : (2,) tuple of int
        Width and height, px.
    reach : float
        Where the ball will land, m; the view "landing" holds it.
    view
        "landing" holds rest, pendulum and landing; "impact" is close to the stroke; "oblique" holds
        all, from aside, turned and rolled, through a strong lens.
    distance : float, optional
        Camera to wall, m.
    foot : (2,) tuple, optional
        Where the axis of a camera square to the wall meets it, x and y, m.
    seed : int
        Small offsets of grid, camera and clock are drawn from it, as no lab has round numbers.
    """
    width, height = size
    if width < 32 or height < 32:
        raise UsageError(f"a picture of {width} x {height} px is too small for this scene")
    rng = np.random.default_rng([seed, 21])
    camera = _tripod(size, view, reach, plane, distance, foot, rng)
    gx, gy = rng.uniform(0.0, 0.05, 2)
    room = Room(plane=plane)
    room = replace(room, wall=replace(room.wall, origin=(float(gx), float(gy))))
    shutter = Shutter(first=-(50.0 + float(rng.uniform())) / 600.0)
    return Scene(
        camera,
        ball=ball,
        pendulum=pendulum,
        support=support,
        look=look_of(ball),
        room=room,
        shutter=shutter,
        sensor=Sensor(),
        encoding=Encoding(bitrate=9.0 * width * height),
        seed=seed,
    )


def _tripod(
    size: tuple[int, int],
    view: View,
    reach: float,
    plane: float,
    distance: float | None,
    foot: tuple[float, float] | None,
    rng: np.random.Generator,
) -> Camera:
    """Camera that holds what a view wants, a little off what somebody aimed at."""
    width, height = size
    right = 0.75 if view == "impact" else reach + 0.30
    if view == "impact":
        left, away = -0.65, 3.4
    else:
        left, away = -(SIDE_M + 0.3), 4.6
    far = away if distance is None else distance
    sight = far - plane
    across = right - left
    focal = (width - 1) * sight / across
    middle = 0.5 * (left + right)
    # the floor beneath the ball must be in the picture, whatever its shape
    tall = across * height / width
    low = -0.10 if view != "impact" else -0.02
    turn = rng.normal(0.0, 0.002, 3)
    lens = Lens.centred(width, height, focal, k1=-0.015)
    position = [middle + rng.normal(0, 0.01), low + 0.5 * tall, far]
    if foot is not None:
        position[:2] = foot
        widest = 2.0 * max(right - foot[0], foot[0] - left)
        lens = Lens.centred(width, height, (width - 1) * sight / widest, k1=-0.015)
        turn *= 0.0
    yaw, pitch, roll = turn
    if view == "oblique":
        lens = replace(lens, k1=-0.21, k2=0.05, fx=0.86 * lens.fx, fy=0.86 * lens.fy)
        position[0] += 0.2
        yaw, pitch, roll = yaw - 0.045, pitch - 0.03, roll - 0.012
    return Camera.facing_wall(lens, position, yaw=yaw, pitch=pitch, roll=roll)


def staged(
    backswing_deg: float, scene: Scene, *, physics: Physics | None = None, after: int = 14
) -> tuple[Scene, Shot]:
    """Scene with as many frames as reach `after` frames beyond landing, and its stroke.

    Parameters
    ----------
    backswing_deg : float
        Angle of release behind the lowest point, deg.
    physics : Physics, optional
        Default: drag, a little face friction and lift. Its back-swing is replaced.
    """
    laws = Physics(0.0, face_friction=0.08, lift_coefficient=0.25) if physics is None else physics
    shot = strike(scene, replace(laws, backswing=math.radians(backswing_deg)))
    span = shot.landing_time - scene.shutter.first
    return replace(scene, frames=math.ceil(span * scene.shutter.fps) + after), shot
