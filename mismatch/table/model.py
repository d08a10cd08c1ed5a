"""What a model says of the numbers in a trial table: the engine's swing, contact and flight."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from metrology import SetupError
from mismatch.model.baseline import Baseline
from mismatch.model.forward import Forward
from mismatch.model.model import Model, Term, lane_terms
from mismatch.records.records import Records
from mismatch.table.table import TrialTable
from physics.arrays import FloatArray
from physics.effects import Outcome, View
from physics.integrator import Trajectory, crossing, integrate

__all__ = ["NUISANCES", "TableForward", "table_forward"]

NUISANCES = ("speed", "backswing", "cor", "launch_angle")
"""What may differ from trial to trial: error of the impact speed (m/s), rad, 1, rad."""

FLIGHT_STEPS = 48
INSTANT = 1e-3


@dataclass(frozen=True)
class TableForward:
    """Predictor for one table.

    Attributes
    ----------
    table : TrialTable
        What was recorded.
    forward : Forward
        The engine's predictor, which swings, strikes and flies.
    """

    table: TrialTable
    forward: Forward

    def predict(self, models: Sequence[Model], nuisance: FloatArray) -> FloatArray:
        """Numbers of every trial as the models have them.

        Parameters
        ----------
        models : K models
        nuisance : (K, T, 4) array
            Trial-to-trial values, in the order of `NUISANCES`.

        Returns
        -------
        (K, T, 3) array
            Impact speed from the back-swing (NaN without one), ball speed and range, as recorded.
        """
        terms = lane_terms(models)
        shape = nuisance.shape[:2]
        with np.errstate(over="ignore", invalid="ignore"):
            factor = self._speed_factor(terms, shape)
            swung = self._swing(terms, nuisance[..., 1])
            measured = (self.table.values[:, 0] + nuisance[..., 0]) / factor
            speed = np.where(np.isfinite(self.table.values[:, 0]), measured, swung)
            outcome = self._strike(terms, nuisance, np.maximum(speed, 0.05))
            ball_speed = np.hypot(np.asarray(outcome.vx), np.asarray(outcome.vy)) * factor
            reach = self._landing(terms, outcome)
        return np.stack([swung * factor, ball_speed, reach], axis=-1)

    def _swing(self, terms: Sequence[Term], off: FloatArray) -> FloatArray:
        """Speed at the contact, m/s, from the back-swing; NaN where none is known."""
        records, pendulum = self.forward.records, self.forward._pendulum()
        known = np.isfinite(self.table.backswing)
        if not known.any():
            return np.full(off.shape, np.nan)
        backswing = records.backswing + off
        for term in terms:
            if "start" in term.effect.hooks:
                backswing[term.lanes] = term.effect.start(term.values, backswing[term.lanes])
        start = np.stack([-backswing, np.zeros(off.shape)])
        rates = self.forward.swing_rates(terms)
        path = integrate(rates, start, self.forward._fall_time() * 1.35, 64)
        fall = crossing(path, np.broadcast_to(records.launch_angle, off.shape))
        speed = path.at(fall[..., None])[1, ..., 0] * pendulum.length
        return np.where(known, speed, np.nan)

    def _strike(self, terms: Sequence[Term], nuisance: FloatArray, speed: FloatArray) -> Outcome:
        angle = np.broadcast_to(self.forward.records.launch_angle, speed.shape)
        rate = speed / self.forward._pendulum().length
        return self.forward._contact(terms, nuisance, rate, angle)

    def _landing(self, terms: Sequence[Term], outcome: Outcome) -> FloatArray:
        """Recorded x where the ball's lowest point reaches the floor, m."""
        vy, y = np.asarray(outcome.vy), np.asarray(outcome.y)
        drop = np.maximum(y - 0.5 * self.forward.records.diameter, 1e-6)
        gravity = self.forward.baseline.gravity
        longest = (vy + np.sqrt(np.square(vy) + 2.0 * gravity * drop)) / gravity
        reach = np.nanmax(np.where(np.isfinite(longest), longest, 0.0))
        flight_time = np.full(self.table.trials, 1.6 * float(reach) + 0.02)
        flight = Forward(
            self.forward.baseline, self.forward.records, "impact", flight_time,
            flight_time, FLIGHT_STEPS, self.forward.centre,
        )._fly(terms, outcome)  # fmt: skip
        path = flight.states
        height = -path[:, 1:2], -flight.rates[:, 1:2]
        down = Trajectory(
            np.asarray(flight.step),
            np.concatenate([height[0], height[1]], axis=1),
            np.concatenate([height[1], np.zeros_like(height[1])], axis=1),
        )
        when = crossing(down, np.broadcast_to(-0.5 * self.forward.records.diameter, vy.shape))
        state = flight.at(when[..., None])[..., 0]
        x: FloatArray = np.array(state[0])
        for term in terms:
            if "image" in term.effect.hooks:
                seen = term.effect.image(term.values, self._view(state, term.lanes))
                x[term.lanes] = np.asarray(seen[0]) + (x - state[0])[term.lanes]
        return x

    def _view(self, state: FloatArray, lanes: slice) -> View:
        x, y, z, vx, vy, vz = (part[lanes] for part in state)
        return View(
            0.0, x, y, z, vx, vy, vz, 0.0, 0.0, 0.0, self._rest_y(), *self.forward.centre
        )  # fmt: skip

    def _rest_y(self) -> FloatArray:
        height = self.forward.baseline.rest_height or 0.0
        return np.asarray(height + 0.5 * self.forward.records.diameter)

    def _speed_factor(self, terms: Sequence[Term], shape: tuple[int, ...]) -> FloatArray:
        """Recorded speed over true speed: what scale and clock do to it at the ball's place."""
        factor = np.ones(shape)
        rest = np.broadcast_to(self._rest_y(), shape)
        still = np.zeros((6, *shape))
        still[1] = rest
        moved = still.copy()
        moved[0] = INSTANT
        for term in terms:
            at = term.lanes
            if "image" in term.effect.hooks:
                here = term.effect.image(term.values, self._view(still, at))
                there = term.effect.image(term.values, self._view(moved, at))
                factor[at] *= np.asarray(there[0] - here[0]) / INSTANT
            if "clock" in term.effect.hooks:
                ticks = np.broadcast_to(np.asarray(INSTANT), factor[at].shape)
                factor[at] *= np.asarray(term.effect.clock(term.values, ticks)) / INSTANT
        return factor


def table_forward(table: TrialTable, baseline: Baseline) -> TableForward:
    """Predictor of a table's numbers.

    Raises
    ------
    SetupError
        If the setup lacks the pendulum, the support, or a contact for a ball.
    """
    if baseline.pendulum is None or baseline.rest_height is None:
        missing = "pendulum" if baseline.pendulum is None else "support"
        raise SetupError(
            f"the setup has no [{missing}], without which an impact speed gives no range",
            hint=f"Add [{missing}] to the setup file.",
        )
    bodies = [baseline.ball(name) for name in table.balls]
    for body in bodies:
        if body.table is None or body.launch_angle is None:
            raise SetupError(
                f"the setup does not say how the ball {body.name!r} is struck",
                hint="Give it a launch_angle and a cor, or a contact_outcome table.",
            )
    names = tuple(dict.fromkeys(body.name for body in bodies))
    count = table.trials
    nothing = np.zeros((count, 1))
    records = Records(
        nothing,
        np.zeros((count, 1, 3)),
        np.zeros((count, 1, 3), dtype=bool),
        nothing,
        nothing,
        np.zeros((count, 1), dtype=bool),
        np.ones((count, 4)),
        np.where(np.isfinite(table.backswing), table.backswing, 1.0),
        np.array([body.mass for body in bodies]),
        np.array([body.diameter for body in bodies]),
        np.array([float(body.launch_angle or 0.0) for body in bodies]),
        np.array([names.index(body.name) for body in bodies], dtype=np.int64),
        names,
    )
    reach = float(np.nanmax(table.values[:, 2])) if table.present[2] else 1.0
    forward = Forward(
        baseline, records, "impact", np.ones(count), np.ones(count), FLIGHT_STEPS,
        (0.5 * reach, 0.3, 0.5 * reach),
    )  # fmt: skip
    return TableForward(table, forward)
