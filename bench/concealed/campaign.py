"""Write a campaign's files and its key."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bench.concealed.setup_toml import write_setup
from bench.concealed.world.design import Design, frames_of, view
from bench.concealed.world.labs import lab_facts
from bench.concealed.world.motion import Motion, move
from bench.concealed.world.noise import disturb, kept_rows
from bench.concealed.world.recipes import Strength, apply
from bench.concealed.world.shots import Shots
from bench.concealed.world.strength import SCATTER
from metrology import write_text_whole

__all__ = ["Hidden", "Key", "TrialTruth", "perform", "read_key", "write_key"]


@dataclass(frozen=True)
class Hidden:
    """One concealed effect; `delta_chi2` is its own contribution to the baseline's misfit.

    `alike` are catalogue ids that mimic it with a chi-square increase below 6.
    """

    name: str
    id: str
    phase: str
    knob: str
    amplitude: float
    constants: dict[str, float]
    channels: tuple[str, ...]
    local: bool
    delta_chi2: float
    alike: tuple[str, ...]


@dataclass(frozen=True)
class TrialTruth:
    """Events of one trial on its own clock, s; start and end of a local effect."""

    touch: float
    release: float
    landing: float
    local_start: float | None = None
    local_end: float | None = None


@dataclass(frozen=True)
class Key:
    """The concealed truth, read after the verdict."""

    number: int
    seed: int
    kind: str
    level: str
    delta_chi2: float
    nearest_catalogue_chi2: float | None
    twins: tuple[str, ...]
    effects: tuple[Hidden, ...]
    trials: tuple[TrialTruth, ...]


def write_key(path: Path, key: Key) -> None:
    """Write a key as JSON."""
    write_text_whole(path, json.dumps(asdict(key), indent=1))


def read_key(path: Path) -> Key:
    """Read a key back."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    effects = tuple(
        Hidden(
            **{
                **hidden,
                "channels": tuple(hidden["channels"]),
                "alike": tuple(hidden["alike"]),
            }
        )
        for hidden in raw.pop("effects")
    )
    trials = tuple(TrialTruth(**trial) for trial in raw.pop("trials"))
    raw["twins"] = tuple(raw["twins"])
    return Key(**raw, effects=effects, trials=trials)


def _scattered(rng: np.random.Generator, design: Design) -> Shots:
    """The trials with their true back-swing, restitution and launch angle."""
    shots = design.shots()
    n, balls = len(design), len(design.lab.balls)
    ball = np.array(design.ball_of_trial)
    cor_law = rng.normal(0, SCATTER.cor_law, balls)
    tilt_law = rng.normal(0, SCATTER.tilt_law, balls)
    values = {
        "backswing": shots.backswing + rng.normal(0, SCATTER.backswing, n),
        "cor_extra": cor_law[ball] + rng.normal(0, SCATTER.cor, n),
        "tilt_extra": tilt_law[ball] + rng.normal(0, SCATTER.tilt, n),
    }
    return Shots(**{**vars(shots), **values})


def _local_window(
    strengths: list[Strength], motion: Motion, body: int
) -> tuple[float, float] | None:
    """Interval in which a local effect acts in one shot, s after first contact."""
    for strength in strengths:
        constants = strength.constants
        if strength.recipe.name == "gust":
            start = motion.release_time[body] + constants["gust_start"]
            return float(start), float(start + constants["gust_length"])
        if strength.recipe.name == "magnet":
            times = np.linspace(motion.release_time[body], motion.landing_time[body], 800)
            place = motion.ball(times, body)
            near = np.hypot(
                place[:, 0] - constants["magnet_x"], place[:, 1] - constants["magnet_y"]
            )
            inside = times[near < 2 * constants["magnet_width"]]
            return (float(inside[0]), float(inside[-1])) if len(inside) else None
        if strength.recipe.name == "notch":
            times = np.linspace(-0.6, 0, 1200)
            angle = motion.pendulum(times, body)
            near = np.abs(angle - constants["notch_angle"]) < 2 * constants["notch_width"]
            inside = times[near]
            return (float(inside[0]), float(inside[-1])) if len(inside) else None
    return None


def perform(
    rng: np.random.Generator, design: Design, strengths: list[Strength], folder: Path
) -> tuple[TrialTruth, ...]:
    """Simulate a campaign with `strengths` concealed; write the recording into `folder`."""
    shots, camera = apply(strengths, _scattered(rng, design), design.progress)
    motion = move(shots)
    noise, fps = design.noise, design.fps
    ball_tables, pendulum_tables, truths = [], [], []
    for trial in range(len(design)):
        timing = design.timing[trial]
        frames = frames_of(design, trial, motion.landing_time[trial])
        place, angle = view(motion, trial, camera, timing.hiccup, fps, frames)
        place = disturb(rng, place, noise.position, noise, fps)
        angle = disturb(rng, angle[:, None], noise.angle, noise, fps)[:, 0]
        ball = pd.DataFrame(
            {
                "trial": trial,
                "backswing_deg": f"{design.backswing_deg[trial]:g}",
                "ball": design.lab.balls[design.ball_of_trial[trial]].name,
                "t_s": np.round(frames[0] + timing.touch_label, 6),
                "x_m": np.round(place[:, 0], 5),
                "y_m": np.round(place[:, 1], 5),
            }
        )
        pendulum = pd.DataFrame(
            {
                "trial": trial,
                "t_s": np.round(frames[1] + timing.touch_label, 6),
                "phi_rad": np.round(angle, 5),
            }
        )
        ball_tables.append(ball[kept_rows(rng, len(ball), noise)])
        pendulum_tables.append(pendulum[kept_rows(rng, len(pendulum), noise)])
        window = _local_window(strengths, motion, trial)
        start, end = window if window else (None, None)
        truths.append(
            TrialTruth(
                touch=timing.touch_label,
                release=timing.touch_label + float(motion.release_time[trial]),
                landing=timing.touch_label + float(motion.landing_time[trial]),
                local_start=None if start is None else timing.touch_label + start,
                local_end=None if end is None else timing.touch_label + end,
            )
        )
    folder.mkdir(parents=True, exist_ok=True)
    pd.concat(ball_tables).to_csv(folder / "ball.csv", index=False, lineterminator="\n")
    pd.concat(pendulum_tables).to_csv(folder / "pendulum.csv", index=False, lineterminator="\n")
    facts = lab_facts(
        design.lab,
        float(f"{noise.position * noise.claim_factor:.2g}"),
        float(f"{noise.angle * noise.claim_factor:.2g}"),
        fps,
    )
    write_setup(folder / "setup.toml", facts)
    return tuple(truths)
