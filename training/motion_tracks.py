"""Tracks with a known kind of motion: drawn at random, and from truth files of recordings."""

import csv
import json
import math
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d

from vision.motions.models import Observations

FloatArray = NDArray[np.float64]

SHARED = Path(os.environ.get("IMPACT_VISION_SHARED", Path(__file__).parents[2] / "shared"))

ACCEPTED = {
    "drop": ("drop", "bounce"),
    "flight": ("flight", "bounce"),
    "bounce": ("bounce", "flight", "drop"),
    "roll": ("roll", "slide"),
}
"""Kinds that count as right, by the grading of the shared labs; others only themselves."""


@dataclass(frozen=True)
class Labelled:
    """A track, or a pair, with its kind."""

    name: str
    kind: str
    ball: Observations
    striker: Observations | None = None
    period: float = math.nan

    def right(self, kind: str) -> bool:
        """Whether a kind counts as right."""
        return kind in ACCEPTED.get(self.kind, (self.kind,))


# ------------------------------------------------------------------ what a detector makes of it
def smooth(rng: np.random.Generator, count: int, scale: float, size: float) -> FloatArray:
    """A smooth random path (count, 2) of a standard deviation, px, over a time scale, frames."""
    pad = int(4 * scale) + 2
    noise = rng.normal(size=(count + 2 * pad, 2))
    path = gaussian_filter1d(noise, scale, axis=0)[pad : pad + count]
    return np.asarray(size * path / max(float(path.std()), 1e-9))


def seen_through(rng: np.random.Generator, path: FloatArray, width: float) -> FloatArray:
    """Roll, perspective and distortion of a camera that is not set up perfectly."""
    centre = path.mean(axis=0) + rng.normal(0, 0.1 * width, 2)
    off = (path - centre) / width
    roll = rng.normal(0, math.radians(2.0)) * (1 if rng.random() < 0.8 else 4)
    turn = np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
    off = off @ turn.T
    off = off / (1.0 + off @ rng.normal(0, 0.04, 2))[:, None]
    off = off * (1.0 + rng.normal(0, 0.03) * (off**2).sum(axis=1))[:, None]
    return np.asarray(centre + off * width)


def receding(rng: np.random.Generator, path: FloatArray) -> FloatArray:
    """Going away from the camera or coming nearer at a constant rate."""
    time = np.linspace(0.0, 1.0, len(path))
    size = 1.0 / (1.0 + rng.uniform(-0.35, 0.7) * time)
    centre = path.mean(axis=0) + rng.normal(0, 0.5, 2) * np.ptp(path, axis=0)
    return np.asarray(centre + (path - centre) * size[:, None])


def detected(
    rng: np.random.Generator, path: FloatArray, radius: float, frame: FloatArray | None = None
) -> Observations:
    """Noise white and correlated, outliers, misses, gaps."""
    count = len(path)
    frame = np.arange(count, dtype=np.float64) if frame is None else frame
    white = math.exp(rng.uniform(math.log(0.03), math.log(2.0)))
    slow = white * rng.uniform(0.0, 1.5) if rng.random() < 0.5 else 0.0
    place = path + rng.normal(0, white, path.shape)
    if slow > 0.0:
        place = place + smooth(rng, count, rng.uniform(0.7, 5.0), slow)
    if rng.random() < 0.3:
        wrong = rng.random(count) < rng.uniform(0.0, 0.05)
        place[wrong] += rng.normal(0, 3 * radius, (int(wrong.sum()), 2))
    step = np.gradient(path, axis=0)
    quick = np.hypot(*step.T) > rng.uniform(0.3, 1.5) * radius
    if rng.random() < 0.4:
        # smeared by the exposure, it is placed somewhere along its streak
        along = rng.normal(0, rng.uniform(0.02, 0.15), (count, 1)) * step
        place = place + np.where(quick[:, None], along, 0.0)
    keep = rng.random(count) > rng.choice([0.0, 0.02, 0.1, 0.3])
    if rng.random() < 0.2:
        keep &= ~quick | (rng.random(count) > rng.uniform(0.1, 0.7))
    if rng.random() < 0.2 and count > 30:
        start = rng.integers(count)
        keep[start : start + int(rng.uniform(2, 0.15 * count))] = False
    if keep.sum() < 8:
        keep[:] = True
    stated = math.hypot(white, slow) * math.exp(rng.normal(0, 0.4))
    return Observations.of(frame[keep], place[keep], stated, radius * math.exp(rng.normal(0, 0.1)))


def strayed(rng: np.random.Generator, ball: Observations, width: float) -> Observations:
    """A track that begins or ends on something else: at rest elsewhere, or wandering."""
    many = min(int(rng.uniform(3, 0.3 * len(ball) + 4)), len(ball) - 8)
    if many < 3:
        return ball
    early = rng.random() < 0.5
    rows = slice(0, many) if early else slice(len(ball) - many, len(ball))
    place = ball.place.copy()
    near = place[many] if early else place[-many - 1]
    away = near + rng.normal(0, 0.1 * width, 2)
    size = rng.choice([0.0, 0.005, 0.02]) * width
    place[rows] = away + smooth(rng, many, 5.0, size) + rng.normal(0, 0.5, (many, 2))
    return Observations.of(ball.frame, place, float(np.median(ball.std)), ball.radius)


# ------------------------------------------------------------------ motions, in px and frames
def falling(
    start: FloatArray,
    speed: FloatArray,
    gravity: float,
    floor: float,
    restitution: float,
    count: int,
    drag: float = 0.0,
    max_bounces: int = 5,
) -> tuple[FloatArray, list[float]]:
    """Positions of a fall with bounces on a floor, and when it bounces."""
    out = np.empty((count, 2))
    x, v, steps, hits = start.copy(), speed.copy(), 8, list[float]()
    stopped = False
    for frame in range(count):
        out[frame] = x
        for step in range(steps):
            if stopped:
                v[0] *= 1.0 - 0.01 / steps
                x = x + np.array([v[0] / steps, 0.0])
                continue
            pull = np.array([0.0, gravity]) - drag * np.hypot(*v) * v
            x = x + v / steps + 0.5 * pull / steps**2
            v = v + pull / steps
            if x[1] > floor and v[1] > 0.0:
                x[1] = 2 * floor - x[1]
                v = v * [0.85, -restitution]
                hits.append(frame + step / steps)
                if abs(v[1]) < 3 * gravity or len(hits) >= max_bounces:
                    stopped = True
                    x[1] = floor
    return out, hits


def hand_to(
    rng: np.random.Generator, point: FloatArray, speed: FloatArray, count: int, size: float
) -> FloatArray:
    """A hand's way that ends at a point with a velocity."""
    path = smooth(rng, count, max(count / 5.0, 2.0), size * rng.uniform(0.1, 1.0))
    time = np.arange(-count, 0, dtype=np.float64)
    last, rate = path[-1], path[-1] - path[-2] if count > 1 else np.zeros(2)
    fade = np.exp(time / max(count / 6.0, 1.5))[:, None]
    path = path - last - fade * (rate - speed) * time[:, None]
    return np.asarray(point + path + speed * 1.0 - speed * 1.0)


def draw_fall(rng: np.random.Generator, width: float, kind: str) -> tuple[str, FloatArray, float]:
    """A drop, a throw, or a body that already bounces."""
    radius = width * math.exp(rng.uniform(math.log(0.008), math.log(0.07)))
    frames = int(math.exp(rng.uniform(math.log(10), math.log(250))))
    height = width * rng.uniform(0.2, 0.7)
    gravity = 2 * height / frames**2
    rest = 0 if rng.random() < 0.2 else int(rng.uniform(3, 0.8 * frames + 10))
    restitution = rng.uniform(0.4, 0.9)
    x0 = np.array([0.5 * width, 0.1 * width])
    bounces = rng.random() < 0.6
    count = int(frames * (rng.uniform(1.2, 3.5) if bounces else rng.uniform(0.5, 0.98)))
    count = max(count, 10)
    drag = rng.uniform(0, 0.1) / height if rng.random() < 0.5 else 0.0
    fall = math.sqrt(2 * gravity * height)
    if kind == "drop":
        v = np.array([rng.normal(0, 0.02), 0.0]) * fall
        path, _ = falling(x0, v, gravity, x0[1] + height, restitution, count, drag)
        if rng.random() < 0.35 and rest > 6:
            before = hand_to(rng, x0, np.zeros(2), rest, width * 0.15)
            if rng.random() < 0.5:
                before[-max(rest // 3, 1) :] = x0
        else:
            before = (
                np.tile(x0, (rest, 1)) + smooth(rng, rest, 8.0, rng.choice([0.0, 0.5]))
                if rest
                else np.empty((0, 2))
            )
        path = np.concatenate([before, path])
    else:
        v = fall * np.array([rng.choice([-1, 1]) * rng.uniform(0.15, 1.5), -rng.uniform(-0.3, 1.0)])
        if rng.random() < 0.3:
            v[0] *= rng.uniform(0.0, 0.3)
            v[1] = rng.choice([-1, -1, 1]) * fall * rng.uniform(0.3, 1.0)
        path, hits = falling(x0, v, gravity, x0[1] + height, restitution, int(count * 1.3), drag)
        if rng.random() < 0.4 and len(hits) < 2:
            many = int(rng.uniform(3, 0.6 * frames + 4))
            time = np.arange(-many, 0)[:, None]
            path = np.concatenate([hand_to(rng, x0 + 0 * time[0], v, many, width * 0.1), path])
        elif len(hits) >= 2:
            kind = "bounce"
    if rng.random() < 0.15:
        many = int(rng.uniform(5, 40))
        speed = path[-1] - path[-2]
        path = np.concatenate([path, path[-1] + caught(rng, speed, many, width)])
    return kind, path, radius


def caught(rng: np.random.Generator, speed: FloatArray, count: int, width: float) -> FloatArray:
    """What a hand that catches does with it."""
    fade = rng.uniform(1.0, 5.0)
    time = np.arange(1, count + 1)[:, None]
    path = smooth(rng, count, 6.0, 0.02 * width)
    return np.asarray(speed * fade * (1 - np.exp(-time / fade)) + path - path[0])


def pendulum(
    amplitude: float, period: float, damping: float, phase: float, count: int
) -> FloatArray:
    """Angles of a damped pendulum; period in frames for small swings."""
    omega = 2 * math.pi / period
    start = phase * period * (1 + amplitude**2 / 16)
    found = solve_ivp(
        lambda t, q: [q[1], -(omega**2) * math.sin(q[0]) - 2 * damping * q[1]],
        (0, start + count),
        [amplitude, 0.0],
        t_eval=start + np.arange(count),
        rtol=1e-8,
        atol=1e-9,
    )
    return np.asarray(found.y[0])


def walled_pendulum(
    amplitude: float, period: float, wall: float, restitution: float, count: int
) -> FloatArray:
    """Angles of a pendulum let go at an amplitude that bounces off a wall at an angle below it."""
    steps = 20
    square = (2 * math.pi / period / steps) ** 2
    angle, rate, out = -amplitude, 0.0, np.empty(count)
    for frame in range(count):
        out[frame] = angle
        for _ in range(steps):
            rate -= square * math.sin(angle)
            angle += rate
            if angle > wall and rate > 0.0:
                angle, rate = 2 * wall - angle, -restitution * rate
    return out


def mean_period(angle: FloatArray) -> float:
    """Frames between passages through the lowest point, in the mean over the whole track."""
    at = np.flatnonzero(np.diff(np.sign(angle)) != 0)
    if len(at) < 3:
        return math.nan
    zero = at - angle[at] / (angle[at + 1] - angle[at])
    return float(2 * (zero[-1] - zero[0]) / (len(zero) - 1))


def draw_swing(
    rng: np.random.Generator, width: float, least: float = 0.6
) -> tuple[FloatArray, float, float]:
    """A swing of any size: path, radius, period."""
    amplitude = math.radians(math.exp(rng.uniform(math.log(4), math.log(120))))
    # a bob that only passes is seen for less than half a swing
    low, high = (0.08, 0.8) if rng.random() < 0.25 else (least, 40.0)
    periods = math.exp(rng.uniform(math.log(low), math.log(high)))
    per_period = rng.uniform(8, 120)
    count = int(np.clip(periods * per_period, 20, 1200))
    period = count / periods
    damping = rng.uniform(0, 1.5) / count
    held = rng.random() < 0.2
    phase = 0.0 if held else rng.random()
    if rng.random() < 0.1:
        wall = amplitude * rng.uniform(-0.2, 0.8)
        angle = walled_pendulum(amplitude, period, wall, rng.uniform(0.3, 0.95), count)
    else:
        angle = pendulum(amplitude, period, damping, phase, count)
    arm = width * rng.uniform(0.15, 1.0) * min(1.0, 0.45 / max(math.sin(min(amplitude, 1.57)), 0.1))
    radius = arm * rng.uniform(0.03, 0.3)
    squeeze = 1.0 if rng.random() < 0.7 else rng.uniform(0.6, 1.0)
    path = arm * np.column_stack([squeeze * np.sin(angle), np.cos(angle)]) + 0.5 * width
    if held:
        path = np.concatenate([np.tile(path[:1], (int(rng.uniform(5, 0.5 * period + 6)), 1)), path])
    return path, radius, mean_period(angle)


def draw_roll(rng: np.random.Generator, width: float) -> tuple[FloatArray, float]:
    """A roll or slide: on a slope, from rest or not, turning round, braked, ending in a fall."""
    count = int(math.exp(rng.uniform(math.log(25), math.log(500))))
    length = width * rng.uniform(0.2, 0.9)
    tilt = math.radians(abs(rng.normal(0, 12))) if rng.random() < 0.75 else rng.uniform(0, math.pi)
    form = rng.choice(["rest", "even", "turn", "braked", "faster"])
    # what rolls evenly after a rest was pushed by something that is not seen
    rest = int(rng.uniform(0, 0.4 * count)) if form == "rest" or rng.random() < 0.3 else 0
    time = np.clip(np.arange(count) - rest, 0, None).astype(float) / max(count - rest, 1)
    s = {
        "rest": time**2,
        "even": time,
        "turn": 4 * rng.uniform(0.5, 1.0) * time * (1.0 - rng.uniform(0.6, 1.2) * time),
        "braked": time * (2 - time) if rng.random() < 0.5 else time - 0.3 * time**2,
        "faster": 0.5 * time + 0.5 * time**2,
    }[str(form)]
    if rng.random() < 0.5:
        # an uneven floor, fingers that push on
        uneven = smooth(rng, len(s), len(s) / rng.uniform(3, 25), rng.uniform(0.02, 0.3))[:, 0]
        s = np.concatenate([[0.0], np.cumsum(np.diff(s) * np.clip(1.0 + uneven[1:], 0.0, None))])
    if rng.random() < 0.1:
        # it comes back from a wall
        wall = rng.uniform(0.3, 0.9) * s.max()
        s = np.where(s > wall, wall - rng.uniform(0.3, 0.9) * (s - wall), s)
    unit = np.array([rng.choice([-1, 1]) * math.cos(tilt), math.sin(tilt)])
    path = np.outer(s * length, unit)
    if rng.random() < 0.3:
        # it curves
        bend = rng.normal(0, 0.05) * length * (2.0 * s / max(float(np.ptp(s)), 1e-9) - 1.0) ** 2
        path = path + np.outer(bend, [-unit[1], unit[0]])
    if rng.random() < 0.15 and form in ("rest", "faster", "even"):
        many = int(rng.uniform(0.03, 0.25) * count) + 4
        speed = path[-1] - path[-2]
        t = np.arange(1, many + 1)[:, None]
        pull = 0.25 * width / many**2 * rng.uniform(0.3, 2.0)
        path = np.concatenate([path, path[-1] + speed * t + 0.5 * np.array([0, pull]) * t**2])
    elif rng.random() < 0.25:
        # it comes to rest where something stops it
        path = np.concatenate([path, np.tile(path[-1], (int(rng.uniform(5, 0.5 * count)), 1))])
    return path, width * rng.uniform(0.01, 0.08)


def draw_strike(
    rng: np.random.Generator, width: float
) -> tuple[FloatArray, FloatArray, float, float]:
    """A pendulum that strikes a ball at rest: both paths and radii."""
    radius = width * rng.uniform(0.012, 0.09)
    size = radius * rng.uniform(0.4, 1.4)
    arm = width * rng.uniform(0.2, 0.7)
    flight = int(math.exp(rng.uniform(math.log(20), math.log(250))))
    rest = int(rng.uniform(8, 180))
    gravity = 2 * width * rng.uniform(0.1, 0.35) / flight**2
    period = 2 * math.pi * math.sqrt(arm / gravity)
    swing_by, at = math.radians(rng.uniform(25, 120)), math.radians(rng.uniform(0, 14))
    speed = arm * math.sqrt(2 * gravity / arm * (math.cos(at) - math.cos(swing_by)))
    count = rest + flight
    omega2 = gravity / arm

    def back(_: float, q: FloatArray) -> list[float]:
        return [q[1], -omega2 * math.sin(q[0])]

    past = solve_ivp(
        back, (0, -rest), [at, speed / arm], t_eval=-np.arange(0, rest + 1), rtol=1e-7
    ).y[0][::-1]
    mass = rng.uniform(5, 20)
    e = rng.uniform(0.4, 0.9)
    after_speed = speed * (mass - e) / (mass + 1)
    gained = speed * mass * (1 + e) / (mass + 1)
    later = solve_ivp(
        back, (0, flight), [at, after_speed / arm], t_eval=np.arange(1, flight + 1), rtol=1e-7
    ).y[0]
    angle = np.concatenate([past[-rest - 1 :], later])[:count]
    pivot = np.array([0.35 * width, 0.1 * width])
    striker = pivot + arm * np.column_stack([np.sin(angle), np.cos(angle)])
    normal = np.array([math.cos(at), -math.sin(at)])
    ball_at = pivot + arm * np.array([math.sin(at), math.cos(at)]) + (radius + size) * normal
    launch = math.radians(rng.uniform(-5, 25))
    floor = ball_at[1] + rng.uniform(0.05, 0.6) * width
    fly, _ = falling(
        ball_at,
        gained * np.array([math.cos(launch), -math.sin(launch)]),
        gravity,
        floor,
        rng.uniform(0.4, 0.8),
        flight,
    )
    ball = np.concatenate([np.tile(ball_at, (rest + 1, 1)), fly[1:]])[:count]
    contact = rng.uniform(0.5, 8.0)
    if contact > 1.0:
        ball[: min(count, rest + 40)] = gaussian_filter1d(
            ball, contact / 3.0, axis=0, mode="nearest"
        )[: min(count, rest + 40)]
    off = rng.normal(0, 0.2 * size, 2)
    inside = ball[:, 0] < width * rng.uniform(0.9, 1.6)
    last = max(int(np.argmin(inside)) if not inside.all() else count, rest + 8)
    if rng.random() < 0.5:
        flip = np.array([-1.0, 1.0])
        ball, striker = ball * flip + [width, 0], striker * flip + [width, 0]
    del period
    return ball[:last], striker + off, radius, size


def draw_collision(rng: np.random.Generator, width: float) -> tuple[FloatArray, FloatArray, float]:
    """Two like bodies, one at rest, that meet once: target, striker, radius."""
    radius = width * rng.uniform(0.012, 0.06)
    before, after = int(rng.uniform(10, 150)), int(rng.uniform(10, 150))
    speed = 0.4 * width / max(before, after) * rng.uniform(0.3, 1.0)
    heading = (
        rng.choice([0.0, math.pi]) + rng.normal(0, 0.1)
        if rng.random() < 0.5
        else rng.uniform(0, 2 * math.pi)
    )
    unit = np.array([math.cos(heading), math.sin(heading)])
    off = rng.uniform(-0.6, 0.6) if rng.random() < 0.5 else 0.0
    normal = np.array([math.cos(heading + off), math.sin(heading + off)])
    e, ratio = rng.uniform(0.4, 0.98), rng.uniform(0.4, 2.5)
    along = speed * math.cos(off)
    gained = along * (1 + e) / (1 + ratio)
    lost = ratio * gained
    target_at = np.array([0.5 * width, 0.5 * width])
    meets = target_at - 2 * radius * normal
    brake = rng.uniform(0, 0.5) * speed / max(before, after)

    def way(start: FloatArray, velocity: FloatArray, time: FloatArray) -> FloatArray:
        rate = max(float(np.hypot(*velocity)), 1e-9)
        stop = rate / brake if brake > 0 else np.inf
        t = np.clip(time, -np.inf, stop)
        return np.asarray(start + np.outer(t - 0.5 * brake / rate * t**2, velocity))

    fraction = rng.random()
    past, later = np.arange(-before, 0) + fraction, np.arange(0, after) + fraction
    striker = np.concatenate(
        [way(meets, speed * unit, past), way(meets, speed * unit - lost * normal, later)]
    )
    target = np.concatenate(
        [np.tile(target_at, (before, 1)), way(target_at, gained * normal, later)]
    )
    return target, striker, radius


def draw_none(rng: np.random.Generator, width: float) -> tuple[FloatArray, float]:
    """At rest, drifting, jumping between places, or trembling."""
    count = int(math.exp(rng.uniform(math.log(15), math.log(400))))
    path = np.zeros((count, 2))
    form = rng.choice(["rest", "drift", "jump", "tremble"])
    if form == "drift":
        path = smooth(rng, count, count / 4, rng.uniform(0.3, 2.5))
    if form == "jump":
        for row in rng.integers(0, count, rng.integers(1, 4)):
            path[row:] += rng.normal(0, 0.02 * width, 2)
    if form == "tremble":
        path = smooth(rng, count, rng.uniform(0.4, 2.0), rng.uniform(0.5, 3.0))
    return path, width * rng.uniform(0.01, 0.08)


def draw_carried(rng: np.random.Generator, width: float) -> tuple[FloatArray, float]:
    """A hand's way: smooth, of no law, with pauses."""
    count = int(math.exp(rng.uniform(math.log(25), math.log(500))))
    scale = count / rng.uniform(3, 25)
    path = smooth(rng, count, max(scale, 3.0), width * rng.uniform(0.03, 0.25))
    if rng.random() < 0.4:
        clock = np.cumsum(np.clip(smooth(rng, count, max(scale, 3.0), 1.0)[:, 0] + 0.7, 0, None))
        clock = clock / max(clock[-1], 1e-9) * (count - 1)
        path = np.column_stack(
            [np.interp(clock, np.arange(count), path[:, axis]) for axis in (0, 1)]
        )
    return path, width * rng.uniform(0.01, 0.08)


def draw_circle(rng: np.random.Generator, width: float) -> tuple[FloatArray, float]:
    """A turn, at constant rate or slowed by friction, seen at an angle; at times from a rest."""
    turns = math.exp(rng.uniform(math.log(0.4), math.log(25)))
    count = int(np.clip(turns * rng.uniform(8, 80), 25, 1200))
    share = np.arange(count) / count
    rate = np.ones(count)
    if rng.random() < 0.6:
        rate = np.maximum(np.exp(-rng.uniform(0, 3) * share) - rng.uniform(0, 0.6) * share, 0.0)
    turned = np.cumsum(rate) / rate.sum()
    if rng.random() < 0.3:
        turned = np.concatenate([np.zeros(int(rng.uniform(3, 40))), turned])
    angle = rng.uniform(0, 2 * math.pi) + rng.choice([-1, 1]) * 2 * math.pi * turns * turned
    arm, ratio, lean = (
        width * rng.uniform(0.04, 0.35),
        rng.uniform(0.35, 1.0),
        rng.uniform(0, math.pi),
    )
    x, y = arm * np.cos(angle), ratio * arm * np.sin(angle)
    path = np.column_stack(
        [x * math.cos(lean) - y * math.sin(lean), x * math.sin(lean) + y * math.cos(lean)]
    )
    return path, arm * rng.uniform(0.05, 0.4)


KINDS = ("strike", "flight", "drop", "swing", "collision", "roll", "circle", "carried", "none")
_SHARE = np.array([0.2, 0.16, 0.14, 0.14, 0.1, 0.1, 0.05, 0.06, 0.05])


@dataclass(frozen=True)
class _Drawn:
    """Paths of a drawn motion, before a camera sees them; `size` is the striker's radius, px."""

    kind: str
    path: FloatArray
    radius: float
    striker: FloatArray | None = None
    size: float = 1.0
    period: float = math.nan


def _draw_motion(rng: np.random.Generator, width: float, kind: str) -> _Drawn:
    """Paths of one kind of motion; a fall decides itself whether it is a bounce."""
    if kind in ("drop", "flight"):
        return _Drawn(*draw_fall(rng, width, kind))
    if kind == "swing":
        path, radius, period = draw_swing(rng, width)
        return _Drawn(kind, path, radius, period=period)
    if kind == "strike":
        path, striker, radius, size = draw_strike(rng, width)
        return _Drawn(kind, path, radius, striker, size)
    if kind == "collision":
        path, striker, radius = draw_collision(rng, width)
        return _Drawn(kind, path, radius, striker, radius)
    drawing = {"roll": draw_roll, "circle": draw_circle, "carried": draw_carried}
    return _Drawn(kind, *drawing.get(kind, draw_none)(rng, width))


def _with_company(rng: np.random.Generator, drawn: _Drawn, width: float) -> _Drawn:
    """The same motion beside something that is taken for its striker, or without its striker."""
    path = drawn.path
    if drawn.kind == "roll" and rng.random() < 0.25:
        # the other end of the same body, which goes on as it came
        ahead = path[-1] - path[0]
        ahead = ahead / max(float(np.hypot(*ahead)), 1e-9)
        if rng.random() < 0.5:
            # this end is seen at rest until the other one passes
            place = path[0] + rng.uniform(0.2, 0.6) * (path[-1] - path[0])
            passed = (path - place) @ ahead > 0.0
            seen = np.where(passed[:, None], path, place)
            return replace(drawn, path=seen, striker=path.copy(), size=drawn.radius)
        striker = path - rng.uniform(1.0, 8.0) * drawn.radius * ahead
        return replace(drawn, striker=striker, size=drawn.radius)
    if drawn.kind not in ("strike", "collision") and rng.random() < 0.25:
        # something else that moves is taken for what struck it
        other = [draw_roll, draw_carried, draw_none][rng.integers(3)](rng, width)
        spot = path[rng.integers(len(path))] + rng.normal(0, 0.3 * width, 2)
        many = min(len(other[0]), len(path))
        striker = other[0][:many] - other[0][many // 2] + spot
        return replace(drawn, striker=striker, size=other[1])
    if drawn.kind in ("strike", "collision") and rng.random() < 0.35:
        # what hit it was not seen: a body that rolls
        kind = "roll" if drawn.kind == "collision" else drawn.kind
        return replace(drawn, kind=kind, striker=None)
    return drawn


def _filmed(
    rng: np.random.Generator, side: np.random.Generator, paths: list[FloatArray], width: float
) -> list[FloatArray]:
    """Paths of bodies as a camera shows them, not always upright, not always on a tripod."""
    shown = seen_through(rng, np.concatenate(paths), width)
    if side.random() < 0.08:
        # a camera on its side
        shown = shown[:, ::-1] * side.choice([[1.0, -1.0], [-1.0, 1.0]])
    sway = np.zeros_like(shown[: max(map(len, paths))])
    if rng.random() < 0.15:
        # what the registration of a hand-held camera leaves
        sway = smooth(rng, len(sway), rng.uniform(10, 80), 10 ** rng.uniform(-0.5, 0.4))
    cuts = np.cumsum([len(path) for path in paths])[:-1]
    return [part + sway[: len(part)] for part in np.split(shown, cuts)]


def draw(seed: int, kind: str | None = None) -> Labelled:
    """A track drawn at random."""
    rng = np.random.default_rng([20, seed])
    width = float(rng.choice([320, 432, 640, 960, 1280]))
    kind = str(rng.choice(KINDS, p=_SHARE)) if kind is None else kind
    drawn = _with_company(rng, _draw_motion(rng, width, kind), width)
    path, striker = drawn.path, drawn.striker
    if striker is None and rng.random() < 0.15:
        path = receding(rng, path)
    paths = [path] if striker is None else [path, striker]
    shown = _filmed(rng, np.random.default_rng([21, seed]), paths, width)
    ball = detected(rng, shown[0], drawn.radius)
    if rng.random() < 0.2:
        ball = strayed(rng, ball, width)
    other = None if striker is None else detected(rng, shown[1], drawn.size)
    return Labelled(f"drawn {seed}", drawn.kind, ball, other, drawn.period)


# ------------------------------------------------------------------ simulations of the shared labs
def lab_track(seed: int, degraded: bool = True) -> Labelled:
    """The truth of one shared lab's simulation, seen by a camera of ours; nothing is rendered."""
    sys.path.insert(0, str(SHARED / "labs"))
    import make_lab

    rng = np.random.default_rng([30, seed])
    kind = str(
        rng.choice(
            ["strike", "swing", "drop", "flight", "roll", "collision"],
            p=[0.4, 0.12, 0.12, 0.12, 0.12, 0.12],
        )
    )
    lab = make_lab.KINDS[kind](rng)
    fps, t0, t1 = float(lab["fps"]), lab["t0"], lab["t1"]
    time = np.arange(t0, t1, 1.0 / fps)[:900]
    x0, x1, y0, y1 = lab["view"]
    width = float(rng.choice([432, 480, 640, 854]))
    scale = width / max(x1 - x0, 1.4 * (y1 - y0))
    mirror = -1.0 if rng.random() < 0.4 else 1.0
    shown = {}
    for body in lab["bodies"]:
        place = np.asarray(body["pos"](time)).T
        shown[body["name"]] = (
            np.column_stack(
                [mirror * scale * (place[:, 0] - 0.5 * (x0 + x1)), -scale * (place[:, 1] - y1)]
            )
            + np.array([0.5 * width, 20.0]),
            scale * body["R"],
        )
    names = {
        "strike": ("ball", "mass"),
        "swing": ("mass", None),
        "collision": ("target", "striker"),
    }.get(kind, ("ball", None))
    tracks = []
    for name in names:
        if name is None:
            tracks.append(None)
            continue
        path, radius = shown[name]
        inside = (
            (path[:, 0] > 0)
            & (path[:, 0] < width)
            & (path[:, 1] > -20)
            & (path[:, 1] < 0.8 * width)
        )
        if inside.sum() < 10:
            tracks.append(None)
            continue
        both = seen_through(np.random.default_rng([31, seed]), path, width)
        frame = np.arange(len(time), dtype=np.float64)
        tracks.append(
            detected(rng, both[inside], radius, frame[inside])
            if degraded
            else Observations.of(frame[inside], both[inside], 0.3, radius)
        )
    if tracks[0] is None:
        tracks[0] = detected(rng, shown[names[0]][0], shown[names[0]][1])
    return Labelled(f"lab {seed}", kind, tracks[0], tracks[1])


def followed_labs(folder: Path) -> Iterator[Labelled]:
    """Tracks of shared labs as they are measured: FOLDER/LAB.csv of `vision measure --tracks`."""
    for file in sorted(folder.glob("*.csv")):
        truth = SHARED / "labs" / file.stem / "truth.json"
        if not truth.exists():
            continue
        table = pd.read_csv(file).dropna(subset=["x_px", "y_px"])
        bodies = {
            str(name): Observations.of(
                rows["frame"].to_numpy(),
                rows[["x_px", "y_px"]].to_numpy(),
                rows["x_px_std"].to_numpy(),
                float(rows["radius_px"].median()),
            )
            for name, rows in table.groupby("object")
        }
        kind = json.loads(truth.read_text())["kind"]
        other = bodies.get("ball_2") if kind == "collision" else bodies.get("pendulum")
        if "ball" in bodies:
            yield Labelled(f"followed {file.stem}", kind, bodies["ball"], other)


# ------------------------------------------------------------------ truth files
CLIP_KINDS = {
    "balltoss_480p30": ("flight",),
    "basketball_bounce_wood": ("bounce",),
    "basketball_roll_pan": ("roll", "none"),
    "freefall_phantom1000": ("drop",),
    "golf_putt_pan": ("roll",),
    "green_ball_throw_shadow": ("flight",),
    "orange_ball_bounce": ("drop",),
    "pendulum_bag_wall_360p30": ("swing",),
    "pendulum_ornament_352p30": ("swing",),
    "projectile_A_canon240": ("flight",),
    "projectile_B_canon240": ("flight",),
    "puck_collision_A_canon240": ("collision",),
    "puck_collision_B_canon240": ("collision",),
    "red_ball_drop_120fps.display": ("drop",),
    "rolling_cylinder_canon240": ("roll",),
    "sliding_slope_canon240": ("roll",),
    "tennis_toss_1080p30": ("flight",),
    "yellow_ball_roll_occluded": ("roll",),
}


def clip_tracks(noise: float = 0.0, seed: int = 0) -> Iterator[Labelled]:
    """Truth of the shared real clips; further noise as a fraction of the stated one."""
    for name, kinds in CLIP_KINDS.items():
        file = SHARED / "clips" / "truth" / f"{name}.csv"
        if not file.exists():
            continue
        bodies: dict[str, list[list[float]]] = {}
        for row in csv.DictReader(file.read_text(encoding="utf-8").splitlines()):
            values = [
                float(row[key]) for key in ("frame", "x_px", "y_px", "radius_px", "uncertainty_px")
            ]
            bodies.setdefault(row.get("object", "ball"), []).append(values)
        rng = np.random.default_rng([40, seed])
        tracks = {}
        for who, rows in bodies.items():
            table = np.array(sorted(rows))
            place = table[:, 1:3] + noise * rng.normal(size=(len(table), 2)) * table[:, 4:5]
            tracks[who] = Observations.of(
                table[:, 0], place, table[:, 4], float(np.median(table[:, 3]))
            )
        ball = tracks.get("target", tracks.get("ball", next(iter(tracks.values()))))
        striker = tracks.get("striker")
        yield Labelled(name, kinds[0], ball, striker)
