"""One row of numbers per trial: impact speed, ball speed, range, with or without a back-swing.

What a model says of the numbers in a trial table: the engine's swing, contact and flight.

What can be missing where only a few numbers per trial are known, and how large it may be.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metrology import SetupError, TooLittleDataError, UsageError
from mismatch.candidates import Candidate, start_values
from mismatch.forward import BatchTerm, Forward, Model, batch_terms
from mismatch.records.records import Baseline, Records
from mismatch.sanity import FARTHEST
from physics.domain import FloatArray, Vector
from physics.effects import CameraView, Contact, Effect, EffectId, Outcome, Parameter, Values
from physics.effects.impact import VelocityDependentCor, change_restitution
from physics.effects.measurement import OriginOffset
from physics.integrator import Trajectory, crossing, integrate

__all__ = [
    "CHANNELS",
    "LEAST_TRIALS",
    "NUISANCES",
    "Strength",
    "TableForward",
    "TrialTable",
    "strengths_of",
    "table_candidates",
    "table_forward",
]

CHANNELS = ("impact_speed", "ball_speed", "range")

"""What a trial may tell, in the order of the arrays' last axis; m/s, m/s, m."""

LEAST_STD = 1e-9
"""m or m/s: a few atoms; no ball's surface is defined better."""

LEAST_TRIALS = 4
"""Trials: a law over speed has two unknowns, and two more show whether it is one."""

ALONG_WALL = frozenset({"offset_x"})
"""Parameters of an offset of the origin that a distance along the wall shows."""


@dataclass(frozen=True)
class TrialTable:
    """A campaign of which only a few numbers per trial are left.

    Attributes
    ----------
    names : tuple of str
        Of the T trials.
    balls : tuple of str or None
        Name of each trial's ball; None where the table has no such column.
    values : (T, 3) array
        Impact speed and ball's speed after contact (m/s), and range (m, ball's centre from rest to
        where it touches the floor); NaN where missing.
    stds : (T, 3) array
        Standard uncertainties; NaN where none is stated.
    backswing : (T,) array
        rad; NaN where missing.
    notes : tuple of str
        What was set right or left out while reading.
    """

    names: tuple[str, ...]
    balls: tuple[str | None, ...]
    values: FloatArray
    stds: FloatArray
    backswing: FloatArray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = self.values[np.isfinite(self.values)]
        if np.any(values <= 0.0):
            raise UsageError(
                "speeds and ranges must be positive",
                hint="The range runs from the ball's centre at rest the way the ball flies.",
            )
        if np.any(self.stds[np.isfinite(self.stds)] <= 0.0):
            raise UsageError(
                "a standard uncertainty must be positive", hint="Leave it empty where unknown."
            )
        if np.any(self.stds < LEAST_STD):
            raise UsageError(
                "a standard uncertainty is smaller than anybody's",
                hint="They are in m/s and metres, and a nanometre at least.",
            )
        if np.any(np.abs(self.values) > FARTHEST) or np.any(self.stds > FARTHEST):
            raise UsageError(
                "speeds, ranges or their uncertainties are beyond all bounds",
                hint="They are in m/s and metres, and at most a million of them.",
            )

    @property
    def trials(self) -> int:
        """Number of rows."""
        return len(self.names)

    @property
    def present(self) -> NDArray[np.bool_]:
        """(3,) which channels the table has at all."""
        return np.asarray(np.isfinite(self.values).any(axis=0))

    def require_enough(self) -> None:
        """Refuse a table that can tell nothing.

        Raises
        ------
        UsageError
            If it has no result, or nothing that says how hard the ball was hit.
        TooLittleDataError
            If it has too few trials.
        """
        if not self.present[1:].any():
            raise UsageError(
                "the table has neither a ball speed nor a range",
                hint="Add a column ball_speed_m_s or range_m.",
            )
        started = np.isfinite(self.values[:, 0]) | np.isfinite(self.backswing)
        if not started.all():
            name = self.names[int(np.argmin(started))]
            raise UsageError(
                f"trial {name} has neither an impact speed nor a back-swing",
                hint="Fill impact_speed_m_s or backswing_deg, or leave the row out.",
            )
        useful = int(np.isfinite(self.values[:, 1:]).any(axis=1).sum())
        if useful < LEAST_TRIALS:
            raise TooLittleDataError(
                f"{useful} trials with a result are too little to tell anything",
                hint=f"At least {LEAST_TRIALS} trials at two or more impact speeds are needed.",
            )

    def chosen(self, rows: NDArray[np.bool_]) -> "TrialTable":
        """Table with the marked rows alone."""
        index = np.flatnonzero(rows)
        return replace(
            self,
            names=tuple(self.names[i] for i in index),
            balls=tuple(self.balls[i] for i in index),
            values=self.values[index],
            stds=self.stds[index],
            backswing=self.backswing[index],
        )


NUISANCES = ("speed", "backswing", "cor", "launch_angle")

"""What may differ from trial to trial: error of the impact speed (m/s), rad, 1, rad."""

FLIGHT_STEPS = 48
"""Steps of a flight, of the fourth order: its error falls with the fourth power of their number;
supposed."""

INSTANT = 1e-3
"""s, step of a difference in time: a ball moves some millimetres in it, straight ahead."""


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
        terms = batch_terms(models)
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

    def _swing(self, terms: Sequence[BatchTerm], off: FloatArray) -> FloatArray:
        """Speed at the contact, m/s, from the back-swing; NaN where none is known."""
        records, pendulum = self.forward.records, self.forward._pendulum()
        known = np.isfinite(self.table.backswing)
        if not known.any():
            return np.full(off.shape, np.nan)
        backswing = records.backswing + off
        for term in terms:
            if "start" in term.effect.hooks:
                backswing[term.rows] = term.effect.start(term.values, backswing[term.rows])
        start = np.stack([-backswing, np.zeros(off.shape)])
        rates = self.forward.swing_rates(terms)
        path = integrate(rates, start, self.forward._fall_time() * 1.35, 64)
        fall = crossing(path, np.broadcast_to(records.launch_angle, off.shape))
        speed = path.at(fall[..., None])[1, ..., 0] * pendulum.length
        return np.where(known, speed, np.nan)

    def _strike(
        self, terms: Sequence[BatchTerm], nuisance: FloatArray, speed: FloatArray
    ) -> Outcome:
        angle = np.broadcast_to(self.forward.records.launch_angle, speed.shape)
        rate = speed / self.forward._pendulum().length
        return self.forward._contact(terms, nuisance, rate, angle)

    def _landing(self, terms: Sequence[BatchTerm], outcome: Outcome) -> FloatArray:
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
                seen = term.effect.image(term.values, self._view(state, term.rows))
                x[term.rows] = np.asarray(seen[0]) + (x - state[0])[term.rows]
        return x

    def _view(self, state: FloatArray, rows: slice) -> CameraView:
        x, y, z, vx, vy, vz = (part[rows] for part in state)
        return CameraView(
            0.0, x, y, z, vx, vy, vz, 0.0, 0.0, 0.0, self._rest_y(), *self.forward.centre
        )  # fmt: skip

    def _rest_y(self) -> FloatArray:
        height = self.forward.baseline.rest_height or 0.0
        return np.asarray(height + 0.5 * self.forward.records.diameter)

    def _speed_factor(self, terms: Sequence[BatchTerm], shape: tuple[int, ...]) -> FloatArray:
        """Recorded speed over true speed: what scale and clock do to it at the ball's place."""
        factor = np.ones(shape)
        rest = np.broadcast_to(self._rest_y(), shape)
        still = np.zeros((6, *shape))
        still[1] = rest
        moved = still.copy()
        moved[0] = INSTANT
        for term in terms:
            at = term.rows
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


UNREMARKABLE = 3.0

"""Prior width over the catalogue's `scale`: a campaign is explained because something is odd."""

SPHERE_DRAG_STD = 0.15

"""Dimensionless, spread of the drag coefficients of balls below the drag crisis, supposed."""

POSITIONS_NEEDED = frozenset({"lens_distortion", "rolling_shutter", "dropped_frames"})

"""Faults that show in the course of a flight and in no single number of it."""

FORMS_LEFT_OUT = frozenset({"about a point", "three axes", "ball only"})

LEAST_TRACE = 1e-4

"""m or m/s below which a candidate at its scale leaves no trace."""


@dataclass(frozen=True)
class CorFallingFromRest(VelocityDependentCor):
    """A restitution that is right for gentle impacts and falls, or rises, with speed."""

    law: str = r"e(v) = e_0 + s\,v"
    form: str = "from rest"

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """More or less restitution, in proportion to impact speed."""
        return change_restitution(contact, outcome, values["slope"] * contact.impact_speed)


@dataclass(frozen=True)
class OriginAlongTheWall(OriginOffset):
    """An origin that is off along the wall; a range knows nothing of heights."""

    def image(self, values: Values, view: CameraView) -> Vector:
        """Displace along the wall."""
        return view.x + values["offset_x"], view.y, view.z


@dataclass(frozen=True)
class Strength:
    """One free number of a candidate.

    Attributes
    ----------
    parameter : Parameter
    start : float
        Value at which the model stays as it is.
    width : float
        Standard deviation of its Gaussian prior about `start`.
    sign : int
        1 or −1 where nature allows one side of `start` only, else 0.
    """

    parameter: Parameter
    start: float
    width: float
    sign: int


def strengths_of(candidate: Candidate, model: Model) -> tuple[Strength, ...]:
    """A candidate's free numbers with their priors."""
    start = start_values(candidate, model)
    found = []
    for p in candidate.effect.strengths:
        here = start[p.name]
        width = UNREMARKABLE * p.scale
        if candidate.id == EffectId.DRAG:
            width = SPHERE_DRAG_STD if here > 0.0 else p.scale
        sign = 1 if here <= p.lower else -1 if here >= p.upper else 0
        found.append(Strength(p, here, width, sign))
    return tuple(found)


def table_candidates(
    forward: TableForward, model: Model, effects: Iterable[Effect]
) -> tuple[Candidate, ...]:
    """Every effect that leaves a trace in this table, at every start value of its shapes."""
    found = []
    for effect in (*effects, CorFallingFromRest()):
        if effect.id in POSITIONS_NEEDED or effect.form in FORMS_LEFT_OUT:
            continue
        if effect.phase == "swing" and not np.isfinite(forward.table.backswing).any():
            continue
        if any(need not in model.ids for need in effect.requires):
            continue
        if effect.id == EffectId.ORIGIN_OFFSET:
            effect = _along_the_wall(effect)
        combinations = list(itertools.product(*(p.grid for p in effect.shapes)))
        names = [p.name for p in effect.shapes]
        for values in combinations:
            shape = tuple(zip(names, values, strict=True))
            found.append(Candidate(effect, shape, len(combinations)))
    return _with_a_trace(forward, model, found)


def _along_the_wall(effect: Effect) -> Effect:
    along = tuple(p for p in effect.parameters if p.name in ALONG_WALL)
    return OriginAlongTheWall(**{**vars(effect), "parameters": along})


def _with_a_trace(
    forward: TableForward, model: Model, candidates: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    moved = []
    for candidate in candidates:
        values = start_values(candidate, model)
        for one in strengths_of(candidate, model):
            values[one.parameter.name] = one.start + (one.sign or 1) * one.parameter.scale
        moved.append(model.having(candidate.effect, values).order())
    nothing = np.zeros((len(moved) + 1, forward.table.trials, 4))
    predicted = forward.predict([model, *moved], nothing)
    used = np.isfinite(forward.table.values)
    change = np.where(used, np.abs(predicted[1:] - predicted[0]), 0.0)
    trace = np.nanmax(change.reshape(len(moved), -1), axis=1)
    return tuple(c for c, t in zip(candidates, trace, strict=True) if t > LEAST_TRACE)
