"""Strength of a concealed effect as a linearised likelihood ratio.

The baseline refits each trial's back-swing, restitution, launch angle and clock, and each ball's
restitution and launch-angle offsets, all but the clock within the stated standard deviations.
"""

from dataclasses import dataclass, replace

import numpy as np

from bench.concealed.world.design import Design, frames_of, view
from bench.concealed.world.motion import Motion, move
from bench.concealed.world.recipes import Strength, apply
from bench.concealed.world.shots import Array, Shots, concatenate, take

__all__ = ["SCATTER", "Scatter", "Visibility", "visibility"]

CLOCK_STEP = 1e-5


@dataclass(frozen=True)
class Scatter:
    """Trial-to-trial standard deviations, SI, both true and stated in the setup file."""

    backswing: float = float(np.radians(0.2))
    cor: float = 0.005
    tilt: float = float(np.radians(0.2))
    cor_law: float = 0.01
    tilt_law: float = float(np.radians(0.3))


SCATTER = Scatter()


@dataclass(frozen=True)
class Visibility:
    """Information matrix (K, K) of K effects at their amplitudes, all nuisances refitted."""

    matrix: Array

    def delta_chi2(self, chosen: list[int], against: list[int] | None = None) -> float:
        """Misfit left when effects `chosen` are present and the model fits those in `against`."""
        total = np.ones(len(chosen)) @ self.matrix[np.ix_(chosen, chosen)] @ np.ones(len(chosen))
        if not against:
            return float(total)
        cross = self.matrix[np.ix_(against, chosen)].sum(axis=1)
        inner = self.matrix[np.ix_(against, against)]
        explained = cross @ np.linalg.lstsq(inner, cross, rcond=1e-10)[0]
        return float(max(total - explained, 0.0))


def _variants(design: Design, strengths: list[list[Strength]]) -> tuple[Shots, list[int], int]:
    """Shots of each distinct (ball, back-swing) under each variant; cell of each trial; cells."""
    bare = design.shots()
    key = np.array(design.ball_of_trial) * 1000.0 + design.backswing_deg
    _, first, cell = np.unique(key, return_index=True, return_inverse=True)
    cells = take(bare, first)
    still = np.zeros(len(first))
    parts = [apply(variant, cells, still)[0] for variant in strengths]
    return concatenate(parts), [int(i) for i in cell], len(first)


def _whitened(
    design: Design,
    motion: Motion,
    body: int,
    trial: int,
    strengths: list[Strength],
    landing: float,
    shift: float = 0.0,
) -> Array:
    _, camera = apply(strengths, motion.shots, np.zeros(len(motion.shots)))
    ball, pendulum = frames_of(design, trial, landing)
    place, angle = view(
        motion,
        body,
        camera,
        design.timing[trial].hiccup,
        design.fps,
        (ball + shift, pendulum + shift),
    )
    noise = design.noise
    # For slow signals, correlated noise is equivalent to white noise of this larger size.
    memory = max(2 * noise.correlation_time * design.fps - 1, 0.0)
    widened = np.sqrt(1 + noise.correlated_share * memory)
    return np.concatenate(
        [place.ravel() / (noise.position * widened), angle / (noise.angle * widened)]
    )


def visibility(design: Design, effects: list[Strength]) -> Visibility:
    """Information matrix of the effects in `effects` at their amplitudes."""
    nuisances = [("backswing", 1e-4), ("cor_extra", 1e-4), ("tilt_extra", 1e-4)]
    physical = [[effect] for effect in effects if effect.recipe.knob != "ageing"]
    shots, cell, cells = _variants(design, [[], *physical])
    base = take(shots, np.arange(cells))
    moved = [replace(base, **{name: getattr(base, name) + h}) for name, h in nuisances]
    motion = move(concatenate([shots, *moved]))

    balls = len(design.lab.balls)
    k = len(effects)
    total = np.zeros((2 * balls + k, 2 * balls + k))
    priors = 1 / np.array([SCATTER.backswing, SCATTER.cor, SCATTER.tilt, 1e3]) ** 2
    for trial in range(len(design)):
        body = cell[trial]
        landing = motion.landing_time[body]

        def seen(
            block: int,
            strengths: list[Strength],
            shift: float = 0.0,
            *,
            trial: int = trial,
            body: int = body,
            landing: float = landing,
        ) -> Array:
            return _whitened(design, motion, block * cells + body, trial, strengths, landing, shift)

        plain = seen(0, [])
        own = [(seen(1 + len(physical) + j, []) - plain) / h for j, (_, h) in enumerate(nuisances)]
        own.append((seen(0, [], CLOCK_STEP) - plain) / CLOCK_STEP)
        columns = np.zeros((len(plain), 2 * balls + k))
        ball = design.ball_of_trial[trial]
        columns[:, 2 * ball], columns[:, 2 * ball + 1] = own[1], own[2]
        block = 1
        for j, effect in enumerate(effects):
            if effect.recipe.knob == "ageing":
                columns[:, 2 * balls + j] = effect.amplitude * design.progress[trial] * own[1]
            else:
                columns[:, 2 * balls + j] = seen(block, [effect]) - plain
                block += 1
        jacobian = np.stack(own, axis=1)
        inner = jacobian.T @ jacobian + np.diag(priors)
        cross = jacobian.T @ columns
        total += columns.T @ columns - cross.T @ np.linalg.solve(inner, cross)
    shared = np.tile([1 / SCATTER.cor_law**2, 1 / SCATTER.tilt_law**2], balls)
    n = 2 * balls
    inner = total[:n, :n] + np.diag(shared)
    left = total[n:, n:] - total[n:, :n] @ np.linalg.solve(inner, total[:n, n:])
    return Visibility((left + left.T) / 2)
