"""Mechanics and perspective of the path-traced rooms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.rooms.traced import BALLS, Eye, Rig, strike_of

RIG = Rig(
    make="block",
    ball_mass=BALLS["jokku"][0],
    radius=BALLS["jokku"][1] / 2.0,
    height=0.4,
    plane=0.4,
    length=0.55,
    half=np.array([0.03, 0.04, 0.04]),
    arm_radius=0.01,
    effective_mass=5.0,
    backswing=math.radians(70.0),
    touch=math.radians(-2.5),
    stiffness=60e3,
    loss=0.0,
    friction=0.0,
)


def test_without_loss_momentum_and_energy_are_conserved() -> None:
    strike = strike_of(RIG)
    assert strike.cor == pytest.approx(1.0, abs=0.02)
    given = RIG.effective_mass * (strike.before - strike.after)
    assert given == pytest.approx(RIG.ball_mass * np.hypot(*strike.speed), rel=0.02)
    kept = RIG.effective_mass * (strike.before**2 - strike.after**2)
    assert kept == pytest.approx(RIG.ball_mass * strike.speed @ strike.speed, rel=0.03)


def test_a_loss_lowers_the_coefficient_of_restitution() -> None:
    lossy = [strike_of(replace(RIG, loss=loss)).cor for loss in (0.03, 0.1)]
    assert 0.5 < lossy[1] < lossy[0] < 0.97


def test_the_impact_speed_follows_from_the_backswing() -> None:
    strike = strike_of(RIG)
    centre = 0.83 * RIG.length
    drop = centre * (math.cos(RIG.touch) - math.cos(RIG.backswing))
    rate = strike.before / RIG.length
    assert 0.5 * (rate * centre) ** 2 == pytest.approx(9.81 * drop, rel=1e-9)
    early = np.interp(-0.05, strike.time, strike.phi)
    assert early == pytest.approx(RIG.touch - 0.05 * rate, abs=0.02)


def test_the_outline_is_that_of_rays_tangent_to_the_sphere() -> None:
    aside = math.radians(20.0)
    forward = np.array([math.sin(aside), 0.0, -math.cos(aside)])
    right = np.array([math.cos(aside), 0.0, math.sin(aside)])
    eye = Eye(
        np.array([-0.9, 0.5, 2.4]), np.array([right, [0.0, -1.0, 0.0], forward]), 500.0, (432, 240)
    )
    ball, radius = np.array([0.3, 0.6, 0.4]), 0.11
    away = ball - eye.place
    distance = float(np.linalg.norm(away))
    middle = ball - away * (radius / distance) ** 2
    across = np.linalg.svd(away[None, :])[2][1:]
    turn = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    rim_radius = radius * math.sqrt(1.0 - (radius / distance) ** 2)
    rim = middle + rim_radius * (
        np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1]
    )
    seen = eye.pixels(rim)
    x, y = seen.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * cross.sum()
    centroid = ((seen + np.roll(seen, -1, axis=0)) * cross[:, None]).sum(axis=0) / (6.0 * area)
    centre, mean_radius = eye.outline(ball, radius)
    assert centre == pytest.approx(centroid, abs=0.01)
    assert mean_radius == pytest.approx(math.sqrt(abs(area) / math.pi), rel=1e-4)
