"""Draw campaigns of the second world: recordings, setup files and keys."""

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.concealed.campaign import Hidden, Key, TrialTruth, read_key, write_key
from bench.concealed.second.laws import NAMED, UNNAMED, Law
from bench.concealed.second.motion import Array, Concealed, Motion, Shots, collide, move
from bench.concealed.setup_toml import BallFacts, LabFacts, Outcome, write_setup

__all__ = ["GENERATOR", "KINDS", "draw_campaign", "draw_plan", "kind_of", "perform"]

# Increased whenever the campaigns of a seed change.
GENERATOR = 2
KINDS = ("null",) * 10 + ("single",) * 16 + ("pair",) * 6 + ("outside",) * 8
LEVELS = {"weak": (3.0, 9.9), "medium": (15.0, 95.0), "strong": (150.0, 5000.0)}
SCATTER = {
    "backswing": np.radians(0.2), "cor_extra": 0.005, "tilt": np.radians(0.2),
    "cor_law": 0.01, "tilt_law": np.radians(0.3),
}  # fmt: skip
TABLE_SPEEDS = np.array([0.7, 1.0, 1.4, 1.9, 2.4, 3.0, 3.6, 4.2, 4.9])


@dataclass(frozen=True)
class Plan:
    """One campaign without concealed effects; `cell` is the index of each trial's shot."""

    shots: Shots
    cells: Shots
    cell: tuple[int, ...]
    ball: tuple[str, ...]
    facts: LabFacts
    fps: float
    position_noise: float
    angle_noise: float
    labels: Array
    swing_seconds: float
    drops: float


def _ball(rng: np.random.Generator, reduced_arm: float) -> dict[str, float]:
    diameter = float(np.round(rng.uniform(0.12, 0.26), 4))
    mass = float(np.round(rng.uniform(25.0, 60.0) * diameter**3, 4))
    reduced = 1.0 / (1.0 / mass + reduced_arm)
    seconds = rng.uniform(0.009, 0.017)
    # A Hertzian contact of 2 m/s lasts 2.94 times its depth over the speed (Hertz 1882).
    stiffness = 1.25 * reduced * 4.0 / (seconds * 2.0 / 2.94) ** 2.5
    return {
        "mass": mass, "diameter": diameter, "stiffness": float(stiffness),
        "contact_angle": float(np.radians(np.round(rng.uniform(5.0, 13.0), 1))),
        "cor_a": float(np.round(rng.uniform(0.06, 0.16), 4)),
        "cor_b": float(np.round(rng.uniform(0.55, 0.72), 4)),
    }  # fmt: skip


def _shots(lab: dict[str, float], balls: list[dict[str, float]], backswing: Array) -> Shots:
    n = len(balls)

    def of(name: str) -> Array:
        return np.array([ball[name] for ball in balls])

    def all_(value: float) -> Array:
        return np.full(n, value)

    return Shots(
        of("mass"), of("diameter"), of("contact_angle"), of("stiffness"),
        (of("cor_a"), of("cor_b")), all_(lab["length"]), all_(lab["inertia"]),
        all_(lab["mass"] * lab["com"]), lab["support"] + 0.5 * of("diameter"),
        all_(lab["density"]), all_(1.84e-5), all_(lab["drag"]), backswing,
        np.zeros(n), np.zeros(n), np.linspace(-0.5, 0.5, n),
    )  # fmt: skip


def _facts(
    lab: dict[str, float], balls: dict[str, dict[str, float]], noise: tuple[float, float]
) -> LabFacts:
    described = {}
    for name, ball in balls.items():
        bare = _shots(lab, [ball] * len(TABLE_SPEEDS), np.ones(len(TABLE_SPEEDS)))
        out = collide(bare, TABLE_SPEEDS / lab["length"], ())
        rows = zip(
            TABLE_SPEEDS, out.cor, out.contact_time, out.omega * lab["length"], out.phi,
            out.x, out.y, out.vx, out.vy, strict=True,
        )  # fmt: skip
        described[name] = BallFacts(
            ball["mass"], ball["diameter"], float(np.degrees(ball["contact_angle"])),
            f"{ball['cor_a']}*exp(-0.27*v) + {ball['cor_b']}",
            tuple(Outcome(*(float(v) for v in row)) for row in rows),
        )  # fmt: skip
    return LabFacts(
        described, lab["length"], lab["inertia"], lab["mass"], lab["com"], lab["support"],
        lab["density"], 1.84e-5, *noise, capture_fps=lab["fps"], drag_coefficient=lab["drag"],
    )  # fmt: skip


def draw_plan(rng: np.random.Generator) -> Plan:
    """One campaign of the second world, drawn."""
    length = float(np.round(rng.uniform(0.4, 0.8), 4))
    mass = float(np.round(rng.uniform(3.0, 8.0), 2))
    com = float(np.round(length * rng.uniform(0.7, 0.92), 4))
    lab = {
        "length": length, "mass": mass, "com": com,
        "inertia": float(np.round(mass * com**2 * rng.uniform(1.12, 1.4), 4)),
        "support": float(np.round(rng.uniform(0.25, 0.7), 3)),
        "density": float(np.round(rng.uniform(1.12, 1.23), 3)),
        "drag": float(np.round(rng.uniform(0.4, 0.5), 2)),
        "fps": float(rng.choice([400.0, 600.0, 800.0])),
    }  # fmt: skip
    names = ("red", "blue")[: int(rng.integers(1, 3))]
    balls = {name: _ball(rng, lab["length"] ** 2 / lab["inertia"]) for name in names}
    angles = rng.choice([35.0, 55.0, 75.0, 95.0, 115.0], int(rng.integers(3, 5)), replace=False)
    kinds = [(name, angle) for name in names for angle in sorted(angles)]
    trials = int(rng.choice([9, 12, 16]))
    chosen = [kinds[i % len(kinds)] for i in range(trials)]
    cells = _shots(lab, [balls[n] for n, _ in kinds], np.radians([a for _, a in kinds]))
    noise = float(rng.uniform(0.0006, 0.002)), float(rng.uniform(0.0006, 0.0015))
    return Plan(
        _shots(lab, [balls[n] for n, _ in chosen], np.radians([a for _, a in chosen])), cells,
        tuple(kinds.index(one) for one in chosen), tuple(n for n, _ in chosen),
        _facts(lab, balls, (float(f"{noise[0]:.2g}"), float(f"{noise[1]:.2g}"))), lab["fps"],
        *noise, rng.uniform(0.3, 1.4, trials), float(rng.uniform(0.15, 0.24)),
        float(rng.choice([0.0, 0.04])),
    )  # fmt: skip


def _seen(
    plan: Plan, motion: Motion, shot: int, concealed: Concealed, frames: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Noise-free positions (n, 2) and angles (m,) at the recording's times since first contact."""
    ball_time, swing_time = frames
    for law, a in concealed:
        if law.clock is not None:
            ball_time, swing_time = law.clock(a, ball_time), law.clock(a, swing_time)
    place, angle = motion.ball_at(ball_time, shot), motion.angle_at(swing_time, shot)
    for law, a in concealed:
        if law.image is not None:
            place = np.stack(law.image(a, place[:, 0], place[:, 1], motion.rest_y[shot]), axis=1)
            if law.id == "camera_roll":
                angle = angle + a
    return place, angle


def _frames(plan: Plan, landing: float, shift: float = 0.0) -> tuple[Array, Array]:
    step = 1.0 / plan.fps
    ball = np.arange(-6, int(landing / step)) * step + shift
    swing = np.arange(-int(plan.swing_seconds / step), int(0.13 / step)) * step + shift
    return ball, swing


def _information(plan: Plan, effects: list[tuple[Law, float]]) -> Array:
    """Information matrix of effects at their amplitudes, with all refitted parameters free."""
    cells, n = plan.cells, len(plan.cells)
    nuisances = (("backswing", 1e-4), ("cor_extra", 1e-4), ("tilt", 1e-4))
    moved = [replace(cells, **{k: getattr(cells, k) + h}) for k, h in nuisances]
    stacked = Shots(**{f.name: _stack(f.name, [cells, *moved]) for f in fields(Shots)})
    base = move(stacked)
    ageing = [law.phase == "across_trials" for law, _ in effects]
    runs = [base if old else move(cells, ((law, a),))
            for old, (law, a) in zip(ageing, effects, strict=True)]  # fmt: skip
    names = sorted(set(plan.ball))
    k, held = len(effects), 2 * len(names)
    total = np.zeros((held + k, held + k))
    prior = np.array([SCATTER["backswing"], SCATTER["cor_extra"], SCATTER["tilt"], 1e3]) ** -2.0
    weights = 1.0 / plan.position_noise, 1.0 / plan.angle_noise
    for trial, cell in enumerate(plan.cell):
        frames = _frames(plan, base.landing[cell])
        late = (frames[0] > 1.05 * base.release.contact_time[cell]) | (frames[0] < 0.0)
        frames = frames[0][late], frames[1]

        def column(motion: Motion, shot: int, hidden: Concealed, frames: Any = frames) -> Array:
            place, angle = _seen(plan, motion, shot, hidden, frames)
            return np.concatenate([place.ravel() * weights[0], angle * weights[1]])

        plain = column(base, cell, ())
        own = [(column(base, (j + 1) * n + cell, ()) - plain) / h
               for j, (_, h) in enumerate(nuisances)]  # fmt: skip
        later = frames[0] + 1e-5, frames[1] + 1e-5
        own.append((column(base, cell, (), later) - plain) / 1e-5)
        shared = np.zeros((len(plain), held + k))
        ball = names.index(plan.ball[trial])
        shared[:, 2 * ball], shared[:, 2 * ball + 1] = own[1], own[2]
        for j, (law, a) in enumerate(effects):
            if ageing[j] and law.restitution is not None:
                cor = float(base.release.cor[cell])
                change = law.restitution(a, 1.0, plan.shots.order[trial]) - 1.0
                shared[:, held + j] = change * cor * own[1]
            else:
                shared[:, held + j] = column(runs[j], cell, ((law, a),)) - plain
        jacobian = np.stack(own, axis=1)
        inner = jacobian.T @ jacobian + np.diag(prior)
        cross = jacobian.T @ shared
        total += shared.T @ shared - cross.T @ np.linalg.solve(inner, cross)
    laws = np.tile([SCATTER["cor_law"] ** -2, SCATTER["tilt_law"] ** -2], len(names))
    inner = total[:held, :held] + np.diag(laws)
    left = total[held:, held:] - total[held:, :held] @ np.linalg.solve(inner, total[:held, held:])
    return np.asarray(left)


def _stack(name: str, parts: list[Shots]) -> Any:
    if name == "gravity":
        return parts[0].gravity
    if name == "cor":
        return tuple(np.concatenate([p.cor[i] for p in parts]) for i in range(2))
    return np.concatenate([getattr(p, name) for p in parts])


def _scaled(rng: np.random.Generator, plan: Plan, law: Law, target: float) -> tuple[Law, float]:
    sign, a = int(rng.choice(law.signs)), law.unit
    for _ in range(2):
        found = float(_information(plan, [(law, sign * a)])[0, 0])
        a = float(min(a * np.sqrt(target / max(found, 1e-9)), law.limit))
    return law, sign * a


def _target(rng: np.random.Generator, level: str) -> float:
    low, high = LEVELS[level]
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _choose(rng: np.random.Generator, kind: str, plan: Plan) -> list[tuple[Law, float]]:
    if kind == "null":
        return []
    if kind == "single":
        level = str(rng.choice(["weak", "medium", "strong"], p=[0.15, 0.4, 0.45]))
        return [_scaled(rng, plan, NAMED[rng.integers(len(NAMED))], _target(rng, level))]
    if kind == "outside":
        law = UNNAMED[rng.integers(len(UNNAMED))]
        return [_scaled(rng, plan, law, _target(rng, "strong"))]
    pair: list[tuple[Law, float]] = []
    for _ in range(6):
        first, second = rng.choice(len(NAMED), 2, replace=False)
        pair = [_scaled(rng, plan, NAMED[i], _target(rng, "strong")) for i in (first, second)]
        m = _information(plan, pair)
        kept = [m[i, i] - m[0, 1] ** 2 / m[1 - i, 1 - i] for i in (0, 1)]
        if min(kept) > 100.0:
            break
    return pair


def _noisy(
    rng: np.random.Generator, clean: Array, sigma: float, drops: float
) -> tuple[Array, Array]:
    """Heavy-tailed noise, a few wrong detections, lost rows."""
    noise = rng.standard_t(6.0, clean.shape) * sigma / np.sqrt(1.5)
    wrong = rng.random(len(clean)) < 0.003
    noise[wrong] += rng.normal(0.0, 20.0 * sigma, noise[wrong].shape)
    return clean + noise, rng.random(len(clean)) >= drops


def perform(
    rng: np.random.Generator, plan: Plan, concealed: Concealed, folder: Path
) -> tuple[TrialTruth, ...]:
    """Simulate a campaign with its concealed laws; write the recording into `folder`."""
    n, shots = len(plan.shots), plan.shots
    names = sorted(set(plan.ball))
    own = np.array([names.index(name) for name in plan.ball])
    cor_law = rng.normal(0.0, SCATTER["cor_law"], len(names))[own]
    tilt_law = rng.normal(0.0, SCATTER["tilt_law"], len(names))[own]
    shots = replace(
        shots, backswing=shots.backswing + rng.normal(0.0, SCATTER["backswing"], n),
        cor_extra=cor_law + rng.normal(0.0, SCATTER["cor_extra"], n),
        tilt=tilt_law + rng.normal(0.0, SCATTER["tilt"], n),
    )  # fmt: skip
    motion = move(shots, concealed)
    balls, swings, truths = [], [], []
    for trial in range(n):
        frames = _frames(plan, motion.landing[trial], rng.uniform(-0.5, 0.5) / plan.fps)
        place, angle = _seen(plan, motion, trial, concealed, frames)
        place, kept = _noisy(rng, place, plan.position_noise, plan.drops)
        label = plan.labels[trial]
        table = pd.DataFrame({
            "trial": trial, "backswing_deg": f"{np.degrees(plan.shots.backswing[trial]):g}",
            "ball": plan.ball[trial], "t_s": np.round(frames[0] + label, 6),
            "x_m": np.round(place[:, 0], 5), "y_m": np.round(place[:, 1], 5),
        })  # fmt: skip
        balls.append(table[kept])
        angles, kept = _noisy(rng, angle[:, None], plan.angle_noise, plan.drops)
        table = pd.DataFrame({
            "trial": trial, "t_s": np.round(frames[1] + label, 6),
            "phi_rad": np.round(angles[:, 0], 5),
        })  # fmt: skip
        swings.append(table[kept])
        gap = float(motion.release.contact_time[trial])
        truths.append(TrialTruth(label, label + gap, label + float(motion.landing[trial])))
    folder.mkdir(parents=True, exist_ok=True)
    pd.concat(balls).to_csv(folder / "ball.csv", index=False, lineterminator="\n")
    pd.concat(swings).to_csv(folder / "pendulum.csv", index=False, lineterminator="\n")
    write_setup(folder / "setup.toml", plan.facts)
    return tuple(truths)


def kind_of(seed: int, number: int) -> str:
    """Kind of campaign `number` of a seed."""
    block = np.random.default_rng([seed, number // len(KINDS), 71]).permutation(KINDS)
    return str(block[number % len(KINDS)])


def draw_campaign(seed: int, number: int, folder: Path, keys: Path) -> Key:
    """Write campaign `number` of a seed to `folder` and its key to the folder `keys`."""
    key_file = keys / f"{number:04d}.json"
    if key_file.exists():
        return read_key(key_file)
    keys.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, number, 2])
    kind = kind_of(seed, number)
    plan = draw_plan(rng)
    concealed = _choose(rng, kind, plan)
    truths = perform(rng, plan, tuple(concealed), folder)
    matrix = _information(plan, concealed) if concealed else np.zeros((0, 0))
    total = float(matrix.sum())
    level = "none" if not concealed else "weak" if total < 10 else "medium"
    level = "strong" if total > 100 else level
    hidden = tuple(
        Hidden(law.name, law.id, law.phase, law.form, a, {}, law.channels, False,
               float(matrix[i, i]), ())
        for i, (law, a) in enumerate(concealed)
    )  # fmt: skip
    key = Key(number, seed, kind, level, total, None, (), hidden, truths)
    write_key(key_file, key)
    return key
