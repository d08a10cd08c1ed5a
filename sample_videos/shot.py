"""One stroke from the physics: swing, contact, flight and bounces, as a motion to be filmed."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.camera.camera import rotation_matrix
from metrology import UsageError
from physics.bodies import GRAVITY
from physics.contact.contact import ContactHistory, simulate_contact
from physics.effects import Term
from physics.effects.flight import CoefficientCurve, Magnus
from physics.flight.air import PAPER_AIR, SUBCRITICAL_DRAG, Air
from physics.flight.flight import FlightModel, FlightPath, fly
from physics.forward import Experiment
from physics.swing import SwingModel, SwingPath, swing, swing_on
from sample_videos.motion import HermiteCurve, Piece, SampledMotion
from sample_videos.scene import Scene

__all__ = ["Physics", "Shot", "strike"]

FloatArray = NDArray[np.float64]

BOUNCES = 3
"""Bounces after landing that are followed: with a floor_cor of 0.7 the third is a tenth as high."""

FOLLOW_THROUGH = 4.0
"""s that the pendulum is followed after release: longer than any clip goes on."""


@dataclass(frozen=True)
class Physics:
    """What the stroke obeys beyond the bodies.

    Attributes
    ----------
    backswing : float
        Angle of release behind the lowest point, rad.
    gravity : float
        m/s².
    air : Air
    drag_coefficient : float or curve
    lift_coefficient : float
        Of the Magnus force on a spinning ball; 0 leaves it out.
    face_friction : float
        Coulomb coefficient between face and ball; it makes the ball spin.
    cor, contact_time : float or None
        What this contact returns (1, s); None takes the ball's laws.
    effects : tuple of Term
        What acts in flight besides gravity, drag and lift, and on the pendulum besides gravity.
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
    physics : Physics
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
    """Follow one stroke in a scene's rig.

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
        raise UsageError("this ball does not fly forward", hint="Give a larger back-swing.")
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
    for _ in range(BOUNCES):
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
