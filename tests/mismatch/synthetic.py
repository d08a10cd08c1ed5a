"""Small campaigns simulated with the forward model."""

import math
from dataclasses import replace
from functools import cache

import numpy as np

from mismatch.forward import Forward, ForwardModel
from mismatch.records import (
    BallModel,
    Baseline,
    CampaignRecords,
    ContactTable,
    Trial,
    lay_out,
)
from physics.bodies import JOKKU, PAPER_PENDULUM, PAPER_SUPPORT
from physics.contact import contact_outcomes
from physics.effects import CATALOGUE, Effect

SPEEDS = np.array([0.8, 1.4, 2.0, 2.8, 3.4, 4.2])
BACKSWINGS = (30.0, 60.0, 90.0, 120.0)


@cache
def jokku_baseline() -> Baseline:
    outcome = contact_outcomes(PAPER_PENDULUM, JOKKU, PAPER_SUPPORT, SPEEDS)
    names = (
        "cor", "contact_time", "pendulum_speed_after", "pendulum_angle",
        "ball_x", "ball_y", "ball_vx", "ball_vy",
    )  # fmt: skip
    rows = np.column_stack([np.asarray(getattr(outcome, name)) for name in names])
    ball = BallModel(
        "jokku", JOKKU.mass, JOKKU.diameter, JOKKU.launch_angle, ContactTable(SPEEDS, rows)
    )
    return Baseline(
        {"jokku": ball},
        PAPER_PENDULUM,
        PAPER_SUPPORT.height,
        effects={"drag": {"drag_coefficient": 0.45}},
    )


def struck_campaign(
    *added: tuple[Effect, dict[str, float]],
    seed: int = 1,
    trials: int = 8,
    noise: float = 1e-3,
    scattered: bool = True,
    at_settings: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[CampaignRecords, Baseline]:
    """Shots with trial-to-trial variation, individual clocks and the added effects.

    Repeats of a back-swing share errors of `at_settings`: angle (degrees), COR, launch angle (rad).
    """
    rng = np.random.default_rng(seed)
    baseline = jokku_baseline()
    ball_time = np.arange(138, 390) / 600.0
    swing_time = np.arange(12, 232) / 600.0
    blank = tuple(
        Trial(
            str(i), ball_time, np.zeros((ball_time.size, 3)), swing_time,
            np.zeros(swing_time.size), "jokku", math.radians(BACKSWINGS[i % 4]),
        )
        for i in range(trials)
    )  # fmt: skip
    records = lay_out(CampaignRecords(blank), baseline)
    model = ForwardModel(((CATALOGUE["drag"][0], {"drag_coefficient": 0.45}),))
    for effect, values in added:
        model = model.having(effect, effect.neutral | values)
    spans = np.full(trials, 0.5)
    forward = Forward(baseline, records, "impact", spans, spans, 96, (1.2, 0.3, 1.2))
    size = 1.0 if scattered else 0.0
    nuisance = np.zeros((trials, 4))
    nuisance[:, 0] = 0.24 + rng.uniform(-1e-3, 1e-3, trials)
    nuisance[:, 1] = size * rng.normal(0.0, math.radians(0.2), trials)
    nuisance[:, 2] = size * (rng.normal(0.0, 0.005, trials) + rng.normal(0.0, 0.01))
    nuisance[:, 3] = size * (rng.normal(0.0, 0.0035, trials) + rng.normal(0.0, 0.005))
    if any(at_settings):
        sizes = np.array([math.radians(at_settings[0]), *at_settings[1:]])
        nuisance[:, 1:] *= 0.3
        nuisance[:, 1:] += (sizes * rng.normal(size=(4, 3)))[np.arange(trials) % 4]
    seen = forward.predict([model.order()], nuisance[None])[0]
    s = ball_time.size
    made = []
    for i, trial in enumerate(blank):
        x, y = seen[i, :s], seen[i, s : 2 * s]
        flying = y > 0.5 * JOKKU.diameter
        position = np.column_stack([x, y, np.full(s, np.nan)])[flying]
        position[:, :2] += rng.normal(0.0, noise, position[:, :2].shape)
        angle = seen[i, 3 * s :] + rng.normal(0.0, noise, swing_time.size)
        made.append(
            replace(trial, ball_time=ball_time[flying], position=position, pendulum_angle=angle)
        )
    return CampaignRecords(tuple(made)), baseline


def thrown_campaign(
    seed: int = 2, drag: float = 0.0, scale: float = 1.0
) -> tuple[CampaignRecords, Baseline]:
    """Free flights of a steel ball, whose baseline is gravity alone."""
    rng = np.random.default_rng(seed)
    trials = []
    for index in range(6):
        time = np.arange(0.0, 0.6, 1.0 / 240.0)
        speed, height = 2.0 + 0.3 * index, 1.5
        x = speed * time
        y = height + 2.0 * time - 0.5 * 9.806 * time**2
        position = scale * np.column_stack([x, y, np.full(time.size, np.nan)])
        position[:, :2] += rng.normal(0.0, 5e-4, (time.size, 2))
        trials.append(Trial(str(index), time, position, np.zeros(0), np.zeros(0)))
    ball = BallModel("", 0.5, 0.05)
    effects = {"drag": {"drag_coefficient": drag}} if drag else {}
    return CampaignRecords(tuple(trials)), Baseline({"": ball}, effects=effects)
