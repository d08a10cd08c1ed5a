"""Laboratories of the concealed campaigns: pendulum, balls, air, known facts."""

from dataclasses import dataclass, fields

import numpy as np

from bench.concealed.setup_toml import BallFacts, LabFacts, Outcome
from bench.concealed.world.shots import Array, Shots
from bench.concealed.world.stages import collide

__all__ = ["Ball", "Lab", "blank_shots", "draw_lab", "lab_facts"]

OUTCOME_SPEEDS = (0.7, 1.0, 1.5, 2.0, 2.6, 3.2, 3.7, 4.2, 4.8)


@dataclass(frozen=True)
class Ball:
    """A ball with its restitution law a*exp(b*v + c) + d and its contact force law."""

    name: str
    mass: float
    diameter: float
    contact_angle_deg: float
    law: tuple[float, float, float, float]
    contact_time: float
    force_exponent: float

    @property
    def law_text(self) -> str:
        """The law as text."""
        a, b, c, d = self.law
        return f"{a:.4f}*exp({b:.4f}*v {'+' if c >= 0 else '-'} {abs(c):.4f}) + {d:.4f}"


@dataclass(frozen=True)
class Lab:
    """One laboratory (SI)."""

    balls: tuple[Ball, ...]
    length: float
    inertia: float
    pendulum_mass: float
    com: float
    face_offset: float
    support_height: float
    density: float
    viscosity: float
    drag_coefficient: float | None
    gravity: float = 9.806


JOKKU = Ball("jokku", 0.353, 0.20175, 8.5, (0.1305, -0.2685, -0.1953, 0.6746), 0.0150, 1.3)
BASKETBALL = Ball(
    "basketball", 0.605, 0.2459, 11.8, (0.2235, -0.2221, -0.7226, 0.8327), 0.0165, 1.3
)


def _stiffness(ball: Ball, lab: Lab) -> float:
    """Stiffness at which an undamped contact at 2 m/s lasts as long as the ball's contact time."""
    n = ball.force_exponent
    reduced = 1 / (1 / ball.mass + lab.length**2 / lab.inertia)
    # Contact time = 2*I*d/v with the largest compression d from the energy balance.
    fraction = np.linspace(0, np.pi / 2, 2001)[:-1]
    sine = np.sin(fraction)
    period = 2 * np.trapezoid(np.cos(fraction) / np.sqrt(1 - sine ** (n + 1)), fraction)
    deepest = ball.contact_time * 2.0 / period
    return float((n + 1) * reduced * 2.0**2 / (2 * deepest ** (n + 1)))


def blank_shots(lab: Lab, balls: list[Ball], backswing: Array) -> Shots:
    """Shots of the baseline, one per ball and back-swing (rad)."""
    n = len(balls)
    given = {
        "mass": [b.mass for b in balls],
        "radius": [b.diameter / 2 for b in balls],
        "contact_angle": [np.radians(b.contact_angle_deg) for b in balls],
        "stiffness": [_stiffness(b, lab) for b in balls],
        "force_exponent": [b.force_exponent for b in balls],
        "length": lab.length,
        "inertia": lab.inertia,
        "pendulum_mass": lab.pendulum_mass,
        "com": lab.com,
        "face_offset": lab.face_offset,
        "support_height": lab.support_height,
        "gravity": lab.gravity,
        "density": lab.density,
        "cor_a": [b.law[0] for b in balls],
        "cor_b": [b.law[1] for b in balls],
        "cor_c": [b.law[2] for b in balls],
        "cor_d": [b.law[3] for b in balls],
        "backswing": backswing,
        "drag_coefficient": lab.drag_coefficient or 0.0,
        "crisis_speed": 4.0,
        "power": 1.0,
        "magnet_width": 0.1,
        "ground_height": 0.1,
        "notch_width": 0.05,
    }
    return Shots(
        **{
            f.name: np.broadcast_to(np.asarray(given.get(f.name, 0.0), float), (n,)).copy()
            for f in fields(Shots)
        }
    )


def _other_ball(rng: np.random.Generator, name: str) -> Ball:
    diameter = rng.uniform(0.12, 0.25)
    slope = rng.uniform(0.05, 0.25)
    return Ball(
        name=name,
        mass=float(np.round(rng.uniform(22, 60) * diameter**3 * 1.2, 4)),
        diameter=float(np.round(diameter, 4)),
        contact_angle_deg=float(np.round(rng.uniform(5, 14), 1)),
        law=(
            round(slope, 4),
            -round(rng.uniform(0.15, 0.4), 4),
            -round(rng.uniform(0.0, 0.5), 4),
            round(rng.uniform(0.5, 0.8), 4),
        ),
        contact_time=float(rng.uniform(0.008, 0.018)),
        force_exponent=float(rng.uniform(1.15, 1.6)),
    )


def draw_lab(rng: np.random.Generator, air_in_baseline: bool) -> Lab:
    """The laboratory of Ryu et al. in half of the draws, a similar one in the others."""
    drag = float(np.round(rng.uniform(0.4, 0.5), 2)) if air_in_baseline else None
    if rng.random() < 0.5:
        pool, length, inertia, mass, com, support = (
            (JOKKU, BASKETBALL), 0.5541, 1.579, 6.0, 0.4553, 0.312,
        )  # fmt: skip
    else:
        pool = (_other_ball(rng, "first"), _other_ball(rng, "second"))
        length = float(np.round(rng.uniform(0.45, 0.75), 4))
        mass = float(np.round(rng.uniform(3.0, 8.0), 2))
        com = float(np.round(length * rng.uniform(0.75, 0.9), 4))
        inertia = float(np.round(mass * com**2 * rng.uniform(1.15, 1.35), 4))
        support = float(np.round(rng.uniform(0.2, 0.6), 3))
    picked = [pool, pool[:1], pool[1:]][rng.integers(3)]
    return Lab(
        balls=picked,
        length=length,
        inertia=inertia,
        pendulum_mass=mass,
        com=com,
        face_offset=float(rng.uniform(0.03, 0.06)),
        support_height=support,
        density=float(np.round(rng.uniform(1.14, 1.22), 3)),
        viscosity=1.852e-5,
        drag_coefficient=drag,
    )


def _outcomes(lab: Lab, ball: Ball) -> tuple[Outcome, ...]:
    speeds = np.array(OUTCOME_SPEEDS)
    shots = blank_shots(lab, [ball] * len(speeds), np.ones(len(speeds)))
    contact = collide(shots, speeds / lab.length)
    return tuple(
        Outcome(
            impact_speed=float(contact.impact_speed[i]),
            cor=float(contact.cor[i]),
            contact_time=float(contact.release_time[i]),
            pendulum_speed_after=float(contact.release[i, 1] * lab.length),
            pendulum_angle=float(contact.release[i, 0]),
            ball_x=float(contact.release[i, 2]),
            ball_y=float(contact.release[i, 3]),
            ball_vx=float(contact.release[i, 4]),
            ball_vy=float(contact.release[i, 5]),
        )
        for i in range(len(speeds))
    )


def lab_facts(lab: Lab, position_noise: float, angle_noise: float, fps: float) -> LabFacts:
    """Facts for the setup file, with the contact predicted by the baseline."""
    return LabFacts(
        balls={
            ball.name: BallFacts(
                ball.mass,
                ball.diameter,
                ball.contact_angle_deg,
                ball.law_text,
                _outcomes(lab, ball),
            )
            for ball in lab.balls
        },
        pendulum_length=lab.length,
        pendulum_inertia=lab.inertia,
        pendulum_mass=lab.pendulum_mass,
        pendulum_com=lab.com,
        support_height=lab.support_height,
        air_density=lab.density,
        air_viscosity=lab.viscosity,
        position_noise=position_noise,
        angle_noise=angle_noise,
        capture_fps=fps,
        drag_coefficient=lab.drag_coefficient,
    )
