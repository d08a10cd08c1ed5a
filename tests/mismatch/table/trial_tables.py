"""Trial tables of known truth, simulated without the engine."""

from functools import cache

import numpy as np

from measuring.setup.file import read_setup
from mismatch.records import Baseline
from mismatch.trial_table import TrialTable
from physics.bodies import PAPER_PENDULUM, PAPER_SUPPORT, Ball
from physics.contact import contact_outcomes
from physics.domain import FloatArray
from physics.flight import land_many
from physics.forward import Experiment, ball_state
from physics.swing import frictionless_speed
from pipelines.explain.campaign import baseline_for_balls

SETUP = """
[pendulum]
length = "0.5541 m"
inertia = "1.579 kg m^2"
mass = "6.0 kg"
com = "0.4553 m"
[support]
height = "0.3120 m"
[balls.jokku]
preset = "jokku"
cor = "0.75"
[balls.basketball]
preset = "basketball"
cor = "0.90"
[model]
effects = ["gravity", "drag"]
[model.drag]
drag_coefficient = 0.47
"""

BALLS = ("jokku", "basketball")
RANGE_STD, SPEED_SHARE = 0.004, 0.002


@cache
def lab() -> Baseline:
    """The baseline: constant restitution, drag."""
    return baseline_for_balls(read_setup(SETUP), BALLS, struck=True)


def simulated_table(
    seed: int,
    concealed: str = "",
    amplitude: float | None = None,
    *,
    speeds: bool = True,
    backswing: bool = False,
    stated: bool = True,
    angles: tuple[float, ...] = (30.0, 60.0, 90.0, 120.0),
    repeats: int = 2,
) -> TrialTable:
    """A table with concealed effects."""
    rng = np.random.default_rng(seed)
    sizes = {
        "velocity_dependent_cor": -0.02,
        "drag": 0.4,
        "origin_offset": 0.025,
        "length_scale": 0.02,
        "pendulum_drag": 0.015,
    }
    size = sizes.get(concealed, 0.0) if amplitude is None else amplitude
    setup = read_setup(SETUP)
    parts, names = [], []
    for name in BALLS:
        ball = setup.balls[name].body()
        angle = np.deg2rad(np.repeat(angles, repeats))
        n = angle.size
        start = angle + np.deg2rad(rng.normal(0.0, 0.2, n))
        speed = np.array(
            [frictionless_speed(PAPER_PENDULUM, one, ball.launch_angle, 9.806) for one in start]
        )
        if concealed == "pendulum_drag":
            speed = speed * (1.0 - size * speed)
        cor = float(ball.cor(np.array(1.0))) + rng.normal(0.0, 0.005) + rng.normal(0.0, 0.005, n)
        if concealed == "velocity_dependent_cor":
            cor = cor + size * (speed - 2.5)
        reach, ball_speed = _flown(ball, speed, cor, np.deg2rad(rng.normal(0.0, 0.2, n)),
                                   0.47 + (size if concealed == "drag" else 0.0))  # fmt: skip
        if concealed == "origin_offset":
            reach = reach + size
        if concealed == "length_scale":
            speed, ball_speed, reach = (v * (1.0 + size) for v in (speed, ball_speed, reach))
        parts.append(np.column_stack([angle, speed, ball_speed, reach]))
        names += [name] * n
    angle, speed, ball_speed, reach = np.concatenate(parts).T
    count = len(names)
    noisy = np.column_stack(
        [
            speed * (1.0 + rng.normal(0.0, SPEED_SHARE, count)),
            ball_speed * (1.0 + rng.normal(0.0, SPEED_SHARE, count)),
            reach + rng.normal(0.0, RANGE_STD, count),
        ]
    )
    stds = np.column_stack(
        [SPEED_SHARE * speed, SPEED_SHARE * ball_speed, np.full(count, RANGE_STD)]
    )
    if not speeds:
        noisy[:, 1] = np.nan
    if not stated:
        stds[:] = np.nan
    return TrialTable(
        tuple(str(k + 1) for k in range(count)),
        tuple(names),
        noisy,
        np.where(np.isfinite(noisy), stds, np.nan),
        angle if backswing else np.full(count, np.nan),
    )


def _flown(
    ball: Ball, speed: FloatArray, cor: FloatArray, turned: FloatArray, drag: float
) -> tuple[FloatArray, FloatArray]:
    """Range and ball speed after integrated contacts, each launch rotated slightly."""
    outcome = contact_outcomes(PAPER_PENDULUM, ball, PAPER_SUPPORT, speed, cor=cor)
    x, y = np.asarray(outcome.ball_x), np.asarray(outcome.ball_y)
    vx, vy = np.asarray(outcome.ball_vx), np.asarray(outcome.ball_vy)
    cosine, sine = np.cos(turned), np.sin(turned)
    state = ball_state(x, y + sine * x, cosine * vx - sine * vy, sine * vx + cosine * vy)
    model = Experiment(ball, drag_coefficient=drag).flight
    _, there = land_many(model, state, floor=ball.radius, step=0.01)
    return there[0], np.hypot(vx, vy)
