"""Predict swing, contact and flight of all trials for many models at once.

Arrays are shaped (rows, trials, ...): a row is one set of parameters. Predictions are stacked per
trial as in `Records`: x, y, z of all ball rows, then the pendulum's angles. A model holds effects
with a column of parameter values per row.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mismatch.records import COLUMNS, Baseline, Records
from physics.domain import FloatArray
from physics.effects import (
    CameraView,
    Contact,
    Coordinate,
    Effect,
    EffectId,
    Level,
    Outcome,
    SwingState,
)
from physics.effects import Term as ActingEffect
from physics.effects.impact import add_normal_speeds, change_restitution, turn_launch
from physics.flight import FlightModel
from physics.integrator import Rates, Trajectory, crossing, integrate
from physics.swing import SwingModel

__all__ = [
    "NUISANCES",
    "OUTSIDE",
    "BatchTerm",
    "ByTrial",
    "Forward",
    "ForwardModel",
    "Mode",
    "OwnStrength",
    "batch_terms",
]

BUILT_ON = frozenset({EffectId.DRAG, EffectId.MAGNUS})
"""Effects that others alter: they come first in a model."""


@dataclass(frozen=True)
class OwnStrength:
    """A strength that each ball, session or trial has a value of its own of.

    Attributes
    ----------
    effect : Effect
        Whose strength.
    name : str
        Of the parameter.
    level : Level
        What shares a value.
    spread : float
        One sigma of the values about the campaign's, in the parameter's unit.
    """

    effect: Effect
    name: str
    level: Level
    spread: float


@runtime_checkable
class ByTrial(Protocol):
    """An effect that holds a value for each trial."""

    def of_trials(self, rows: NDArray[np.int64]) -> Effect:
        """The effect for some trials alone, in order."""
        ...


@dataclass(frozen=True)
class ForwardModel:
    """Effects and the values of their parameters; gravity, swing and contact are always there.

    Attributes
    ----------
    entries : tuple of (Effect, mapping)
        What the model holds.
    own : tuple of OwnStrength
        Strengths that differ from ball to ball or trial to trial; by how much stands in the columns
        of the trial-to-trial values that follow those of the mode, in this order.
    """

    entries: tuple[tuple[Effect, Mapping[str, float]], ...] = ()
    own: tuple[OwnStrength, ...] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids of the effects, in order."""
        return tuple(effect.id for effect, _ in self.entries)

    def value(self, effect_id: str, name: str, default: float) -> float:
        """Value of one parameter, or the default where the model lacks the effect."""
        for effect, values in self.entries:
            if effect.id == effect_id:
                return float(values[name])
        return default

    def having(self, effect: Effect, values: Mapping[str, float]) -> "ForwardModel":
        """Model with the effect in it; one with the same id is replaced, unless it is unnamed."""
        kept = tuple(
            entry
            for entry in self.entries
            if entry[0].id != effect.id or effect.id == EffectId.UNNAMED
        )
        entries = (*kept, (effect, dict(values)))
        held = [one for one, _ in entries]
        own = tuple(s for s in self.own if any(s.effect is one for one in held))
        return replace(self, entries=entries, own=own)

    def of_trials(self, rows: NDArray[np.int64], cut: dict[int, Effect]) -> "ForwardModel":
        """Model for some trials alone; `cut` keeps one object for each effect (by its id)."""
        if not any(isinstance(effect, ByTrial) for effect, _ in self.entries):
            return self
        for effect, _ in self.entries:
            if isinstance(effect, ByTrial):
                cut.setdefault(id(effect), effect.of_trials(rows))
        entries = tuple((cut.get(id(effect), effect), values) for effect, values in self.entries)
        return replace(self, entries=entries)

    @property
    def scatters_within_reason(self) -> bool:
        """Whether own strengths, typically, stay within half of what nature allows at most."""
        for one in self.own:
            p = next(p for p in one.effect.strengths if p.name == one.name)
            mean = next(values for held, values in self.entries if held is one.effect)[one.name]
            if np.hypot(mean, one.spread) > 0.5 * max(abs(p.lower), abs(p.upper)):
                return False
        return True

    def order(self) -> "ForwardModel":
        """The same model with drag and spin first, since others build on them."""
        first = [e for e in self.entries if e[0].id in BUILT_ON]
        rest = [e for e in self.entries if e[0].id not in BUILT_ON]
        return replace(self, entries=(*first, *rest))


@dataclass(frozen=True)
class BatchTerm:
    """An effect at work in some rows.

    Attributes
    ----------
    effect : Effect
        What acts.
    rows : slice
        In which rows.
    values : mapping
        Parameter → (k, 1) array over those rows, (k, T) where each trial has a value of its own.
    """

    effect: Effect
    rows: slice
    values: Mapping[str, FloatArray]


def batch_terms(
    models: Sequence[ForwardModel], own: FloatArray | None = None
) -> tuple[BatchTerm, ...]:
    """Terms for one model per row, runs of rows with the same effect gathered.

    `own` (rows, T, n) is what each model's own strengths are off the campaign's in each trial.

    An effect takes part in a row only if that row's model holds it, so a row pays for its own
    effects alone. Effects are distinguished as objects: two of one class and form may differ in any
    field of their own (the hats of a smooth force, laws that a user wrote).
    """
    runs: dict[tuple[int, int], list[list[tuple[int, Mapping[str, float]]]]] = {}
    effects: dict[tuple[int, int], Effect] = {}
    for row, model in enumerate(models):
        seen: dict[int, int] = {}
        for effect, values in model.entries:
            copy = seen.get(id(effect), 0)
            seen[id(effect)] = copy + 1
            key = (id(effect), copy)
            effects[key] = effect
            here = runs.setdefault(key, [])
            if here and here[-1][-1][0] == row - 1:
                here[-1].append((row, values))
            else:
                here.append([(row, values)])
    return tuple(
        BatchTerm(
            effects[key],
            slice(run[0][0], run[-1][0] + 1),
            {name: _column(models, effects[key], name, run, own) for name in run[0][1]},
        )
        for key, parts in runs.items()
        for run in parts
    )


def _column(
    models: Sequence[ForwardModel],
    effect: Effect,
    name: str,
    run: Sequence[tuple[int, Mapping[str, float]]],
    own: FloatArray | None,
) -> FloatArray:
    """Values of a parameter in a run of rows: (k, 1), or (k, T) where trials differ."""
    column = np.array([values[name] for _, values in run])[:, None]
    if own is None or not own.shape[-1]:
        return column
    off = np.zeros((len(run), own.shape[1]))
    for at, (row, _) in enumerate(run):
        for place, one in enumerate(models[row].own):
            if one.effect is effect and one.name == name:
                off[at] = own[row, :, place]
    return column + off if off.any() else column


Mode: TypeAlias = Literal["impact", "flight", "swing"]

LaneIndex: TypeAlias = NDArray[np.int64]

NUISANCES: dict[Mode, tuple[str, ...]] = {
    "impact": ("clock", "backswing", "cor", "launch_angle"),
    "flight": ("x", "y", "z", "vx", "vy", "vz"),
    "swing": ("phi", "omega", "natural_frequency", "zero", "losses"),
}

"""What may differ from trial to trial, in the order of the nuisance arrays' last axis."""

STRUCK_SHARE = 4
"""Into how many parts the steps of a struck ball's flight may be cut where every law is smooth:
laws ten times as strong as any expected move no record by 1e-4 of its noise then."""

OUTSIDE = 1e6
"""m or rad: a model that leaves every laboratory is cut off here, so that its misfit stays a
number."""


NOWHERE = (np.zeros((1, 1, 1)), np.zeros((1, 1, 1)))
"""Where no ball lies."""


@dataclass(frozen=True)
class Forward:
    """Predictor for one campaign.

    Attributes
    ----------
    baseline : Baseline
        Bodies, air, priors.
    records : Records
        Where samples are wanted.
    mode : Mode
        "impact" starts from the back-swing, "flight" and "swing" from a free initial state.
    flight_time, swing_time : (T,) array
        How long ball and pendulum are followed after the contact (or the first sample), s.
    steps : int
        Steps of the flight.
    centre : (3,) tuple of float
        Middle of the balls' paths (x, y) and half their width, m.
    pace : float
        Natural frequency about which the records of a free swing lie, over the setup's. A clock
        that is off and a rig of another inertia change a free swing's period alike, so that the
        period speaks for neither; 1 where back-swing and contact tie the two.
    thrown_share : int
        Into how many parts the steps of a throw may be cut where every law is smooth.
    uneven : float
        One sigma of what a free swing loses over what all do, less one: a bearing does not repeat
        to a per cent. 0 where the records show none.
    at_setting : (3,) tuple of float, or empty
        One sigma of what repeats of a setting share of back-swing, COR and launch angle; empty
        where they share none.
    """

    baseline: Baseline
    records: Records
    mode: Mode
    flight_time: FloatArray
    swing_time: FloatArray
    steps: int
    centre: tuple[float, float, float]
    pace: float = 1.0
    thrown_share: int = 1
    uneven: float = 0.0
    at_setting: tuple[float, ...] = ()

    def of_trials(self, rows: NDArray[np.int64]) -> "Forward":
        """Predictor of some trials alone, in order."""
        return replace(
            self,
            records=self.records.of_trials(rows),
            flight_time=self.flight_time[rows],
            swing_time=self.swing_time[rows],
        )

    def predict(self, models: Sequence[ForwardModel], nuisance: FloatArray) -> FloatArray:
        """Stacked records as the models have them.

        Parameters
        ----------
        models : K models
        nuisance : (K, T, q) array
            Trial-to-trial values, in the order of `NUISANCES`, then those of the models' own
            strengths.

        Returns
        -------
        (K, T, 3S + P) array
        """
        terms = batch_terms(models, nuisance[..., len(NUISANCES[self.mode]) :])
        paths = {"impact": self._struck, "flight": self._thrown, "swing": self._released}
        # A step too far may run off to infinity; the fit sees it as a bad step and halves it.
        with np.errstate(over="ignore", invalid="ignore"):
            ball, velocity, phi, omega, times = paths[self.mode](terms, nuisance)
            return self._seen(terms, ball, velocity, phi, omega, times)

    def _struck(
        self, terms: Sequence[BatchTerm], nuisance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
        records, shape = self.records, nuisance.shape[:2]
        first, lane = _distinct(terms, STRIKE_HOOKS, nuisance[..., :4])
        # Laws of flight and of images leave the strike as it is: it is followed once for all.
        strike = self._strike(_of_lanes(terms, first), nuisance[first])
        outcome = _lanes(strike.outcome, lane, len(first))
        ball_since, phi, omega = strike.ball_since[lane], strike.phi[lane], strike.omega[lane]
        gap = np.asarray(outcome.contact_time)
        ball_state = self._read_flight(terms, outcome, ball_since - gap[..., None], lane)
        rest_y = self._rest_y(shape)
        resting = np.stack([np.zeros(shape), rest_y, np.zeros(shape)])[..., None]
        flown = ball_since >= gap[..., None]
        # Between onset and release the ball is shown on a straight line; those rows are not fitted.
        share = np.clip(ball_since / gap[..., None], 0.0, 1.0)
        released = np.stack(
            [np.asarray(v) + np.zeros(shape) for v in (outcome.x, outcome.y, outcome.z)]
        )
        ball = np.where(flown, ball_state[:3], resting + share * (released[..., None] - resting))
        velocity = np.where(flown, ball_state[3:], 0.0)
        clock = nuisance[..., 0][..., None]
        times = (records.ball_time - clock, records.pendulum_time - clock)
        return ball, velocity, phi, omega, times

    def _strike(self, terms: Sequence[BatchTerm], nuisance: FloatArray) -> "_StrikeLanes":
        """Swings and contacts, and the ball's times since first touch."""
        records, shape = self.records, nuisance.shape[:2]
        backswing = records.backswing + nuisance[..., 1]
        for term in terms:
            if "start" in term.effect.hooks:
                backswing[term.rows] = term.effect.start(term.values, backswing[term.rows])
        onset_angle = np.broadcast_to(records.launch_angle, shape)
        start = np.stack([-backswing, np.zeros(shape)])
        path = self._swing_along(terms, start, self._fall_time() * 1.35, 64)
        fall = crossing(path, onset_angle)
        rate = path.at(fall[..., None])[1, ..., 0]
        outcome = self._contact(terms, nuisance, rate, onset_angle)
        gap = np.asarray(outcome.contact_time)
        clock = nuisance[..., 0][..., None]
        ball_since = self.true_time(terms, records.ball_time - clock)
        swing_since = self.true_time(terms, records.pendulum_time - clock)
        before = path.at(np.maximum(fall[..., None] + swing_since, 0.0))
        later = self._swing_on(terms, outcome).at(swing_since - gap[..., None])
        phi, omega = np.where(swing_since > 0.5 * gap[..., None], later, before)
        return _StrikeLanes(outcome, ball_since, phi, omega)

    def _read_flight(
        self, terms: Sequence[BatchTerm], outcome: Outcome, since: FloatArray, same: LaneIndex
    ) -> FloatArray:
        """States (c, K, T, S) of struck balls; lanes that start and fly alike are followed once."""
        first, lane = _distinct(terms, FLIGHT_HOOKS, same[:, None].astype(np.float64))
        flight = self._fly(_of_lanes(terms, first), _lanes(outcome, first, len(since)))
        return flight.at(since[first], _read_components(terms))[:, lane]

    def _thrown(
        self, terms: Sequence[BatchTerm], nuisance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
        records, shape = self.records, nuisance.shape[:2]
        first, lane = _distinct(terms, FLIGHT_HOOKS | {"clock"}, nuisance[..., :6])
        few, starts = _of_lanes(terms, first), nuisance[first]
        state = np.moveaxis(starts[..., :6], -1, 0)
        path = self._integrate_flight(few, state, np.zeros(starts.shape[:2]))
        label = records.ball_time - records.ball_time[:, :1]
        since = self.true_time(few, np.broadcast_to(label, (len(first), *label.shape)))
        sample = path.at(since, _read_components(terms))[:, lane]
        blank = np.zeros((*shape, records.pendulum_time.shape[1]))
        return sample[:3], sample[3:], blank, blank, (label, blank)

    def _released(
        self, terms: Sequence[BatchTerm], nuisance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
        records, shape = self.records, nuisance.shape[:2]
        start = np.moveaxis(nuisance[..., :2], -1, 0)
        rates = self.swing_rates(
            terms, self.swing_time / self.steps, np.exp(2.0 * nuisance[..., 2]),
            losses=1.0 + nuisance[..., 4],
        )  # fmt: skip
        path = integrate(rates, start, self.swing_time, self.steps)
        label = records.pendulum_time - records.pendulum_time[:, :1]
        since = self.true_time(terms, np.broadcast_to(label, (*shape, label.shape[1])))
        sample = path.at(since)
        blank = np.zeros((3, *shape, records.ball_time.shape[1]))
        seen = sample[0] + nuisance[..., 3:4]
        return blank, blank, seen, sample[1], (blank[0], label)

    def _fall_time(self) -> FloatArray:
        """Time from the nominal back-swing to the contact without losses, (T,), s."""
        pendulum = self._pendulum()
        stiffness = pendulum.mass * self.baseline.gravity * pendulum.com / pendulum.inertia
        fraction = (np.arange(400) + 0.5) / 400
        lowest, top = self.records.launch_angle, np.abs(self.records.backswing)
        # A substitution takes the square-root singularity at the turning point away.
        phi = -top[:, None] + (lowest + top)[:, None] * fraction**2
        energy = 2.0 * stiffness * (np.cos(phi) - np.cos(top)[:, None])
        slow = (lowest + top)[:, None] * 2.0 * fraction / np.sqrt(np.maximum(energy, 1e-12))
        return np.asarray(slow.mean(axis=1), dtype=np.float64)

    @property
    def displaced(self) -> FloatArray:
        """Mass of the air that each trial's body displaces as a solid ball, over its own, (T,)."""
        volume = np.pi / 6.0 * np.power(self.records.diameter, 3)
        return np.asarray(self.baseline.air_density * volume / self.records.mass)

    @property
    def setup_rate(self) -> float:
        """Angular frequency of small swings by the setup, rad/s."""
        body = self._pendulum()
        return float(np.sqrt(body.mass * self.baseline.gravity * body.com / body.inertia))

    @property
    def small_rate(self) -> float:
        """Angular frequency of small swings about which the records' own lie, rad/s."""
        return self.setup_rate * self.pace

    @property
    def arm(self) -> float:
        """Length of the pendulum, m."""
        return self._pendulum().length

    def _pendulum(self) -> "PendulumBody":
        body = self.baseline.pendulum
        if body is None:
            return PendulumBody(1.0, 1.0, 1.0, 1.0)
        return PendulumBody(body.length, body.inertia, body.mass, body.com)

    def _rest_y(self, shape: tuple[int, ...]) -> FloatArray:
        height = self.baseline.rest_height or 0.0
        return np.broadcast_to(height + 0.5 * self.records.diameter, shape)

    def swing_rates(
        self,
        terms: Sequence[BatchTerm],
        step: FloatArray,
        stiffer: FloatArray | float = 1.0,
        order: FloatArray | None = None,
        losses: FloatArray | float = 1.0,
    ) -> Rates:
        """Rates of angle and angular velocity, for as many swings as `order` has entries.

        They are followed in steps of `step` seconds.
        """
        body, true = self._pendulum(), _true_inputs(terms)
        inertia, mass = true.get("inertia", 1.0), true.get("pendulum_mass", 1.0)
        com = true.get("com", 1.0)
        if self.mode == "swing":
            # A free swing keeps its own pace, whatever the setup states of the pendulum.
            stiffer = stiffer * inertia / (mass * com)
        model = SwingModel(
            body.length * true.get("length", 1.0),
            body.inertia * inertia,
            body.mass * mass,
            body.com * com,
            self.baseline.gravity,
            _acting(terms),
            stiffer * self.pace**2,
            self.records.order if order is None else order,
            step,
            losses,
        )
        return model.rates

    def _contact(
        self,
        terms: Sequence[BatchTerm],
        nuisance: FloatArray,
        rate: FloatArray,
        angle: FloatArray,
    ) -> Outcome:
        records, body = self.records, self._pendulum()
        speed = rate * body.length
        rows = np.zeros((len(COLUMNS), *speed.shape))
        for index, name in enumerate(records.ball_names):
            mine = records.ball_index == index
            table = self.baseline.ball(name or None).table
            if table is not None and mine.any():
                rows[:, :, mine] = table(speed[:, mine])
        cor, gap, pendulum_speed, pendulum_angle, x, y, vx, vy = rows
        outcome = Outcome(
            gap, pendulum_speed, pendulum_angle, x, y, np.zeros_like(x), vx, vy, np.zeros_like(x)
        )
        contact = Contact(
            rate, angle, body.length, body.inertia, records.mass, records.diameter, cor,
            self.baseline.gravity, records.order,
        )  # fmt: skip
        outcome = change_restitution(contact, outcome, nuisance[..., 2])
        outcome = turn_launch(outcome, nuisance[..., 3])
        for term in terms:
            at = term.rows
            if "torque" in term.effect.hooks:
                # While they touch, a torque on the pendulum brakes ball and pendulum together.
                swing = SwingState(
                    angle[at], rate[at], body.inertia, body.mass, body.com, body.length,
                    self.baseline.gravity, records.order,
                )  # fmt: skip
                both = body.inertia / body.length + records.mass * body.length
                slowed = term.effect.torque(term.values, swing) * gap[at] / both
                part = add_normal_speeds(_cut(contact, at), _cut(outcome, at), slowed, slowed)
                outcome = _paste(outcome, part, at)
            if "contact" in term.effect.hooks:
                part = term.effect.contact(term.values, _cut(contact, at), _cut(outcome, at))
                outcome = _paste(outcome, part, at)
        return outcome

    def true_time(self, terms: Sequence[BatchTerm], label: FloatArray) -> FloatArray:
        """Time that really passed for what the clock says, s."""
        time = np.array(label)
        for term in terms:
            if "clock" in term.effect.hooks:
                values = {name: value[..., None] for name, value in term.values.items()}
                time[term.rows] = term.effect.clock(values, time[term.rows])
        return time

    def _fly(self, terms: Sequence[BatchTerm], outcome: Outcome) -> Trajectory:
        shape = np.shape(outcome.vx)
        parts = (outcome.x, outcome.y, outcome.z, outcome.vx, outcome.vy, outcome.vz)
        state = np.stack([np.broadcast_to(part, shape) for part in parts])
        return self._integrate_flight(terms, state, np.asarray(outcome.contact_time))

    def _integrate_flight(
        self, terms: Sequence[BatchTerm], state: FloatArray, since: FloatArray
    ) -> Trajectory:
        base, records, true = self.baseline, self.records, _true_inputs(terms)
        model = FlightModel(
            records.mass * true.get("ball_mass", 1.0),
            records.diameter * true.get("diameter", 1.0),
            base.air_density * true.get("air_density", 1.0),
            base.air_viscosity,
            base.gravity,
            _acting(terms),
            self.nominal_speed(),
            records.order,
        )
        forces = [t for t in terms if "force" in t.effect.hooks]
        share = STRUCK_SHARE if self.mode == "impact" else self.thrown_share
        return integrate(
            model.rates, state, self.flight_time, self._steps(forces, self.steps, share)
        )

    def _steps(self, terms: Sequence[BatchTerm], most: int, share: int = 2) -> int:
        """A part of the steps where every law is smooth on the scale of the whole path."""
        smooth = self.mode != "swing" and not any(t.effect.sharp for t in terms)
        return most // share if smooth else most

    def _swing_on(self, terms: Sequence[BatchTerm], outcome: Outcome) -> Trajectory:
        body = self._pendulum()
        shape = np.shape(outcome.vx)
        start = np.stack(
            [
                np.broadcast_to(outcome.pendulum_angle, shape),
                np.broadcast_to(outcome.pendulum_speed, shape) / body.length,
            ]
        )
        return self._swing_along(terms, start, self.swing_time, 32)

    def _swing_along(
        self, terms: Sequence[BatchTerm], start: FloatArray, time: FloatArray, most: int
    ) -> Trajectory:
        """A strike's swing over some time, s, in a part of `most` steps where laws are smooth."""
        steps = self._steps(terms, most)
        return integrate(self.swing_rates(terms, time / steps), start, time, steps)

    def flight_span(self, coordinate: Coordinate) -> tuple[float, float]:
        """What the balls go through of a coordinate, roughly."""
        records = self.records
        used = records.ball_used
        if coordinate is Coordinate.TIME or not used.any():
            return 0.0, float(np.median(self.flight_time))
        if coordinate in (Coordinate.PLACE, Coordinate.HEIGHT):
            axis = 0 if coordinate is Coordinate.PLACE else 1
            values = records.position[..., axis][used[..., axis]]
            return (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
        both = used[:, 1:] & used[:, :-1]
        rows = both.any(axis=-1)
        step = np.where(both, np.diff(records.position, axis=1), 0.0)
        if coordinate is Coordinate.DIRECTION:
            slopes = np.arctan2(step[..., 1], np.hypot(step[..., 0], step[..., 2]))[rows]
            low, high = np.quantile(slopes, [0.05, 0.95]) if slopes.size else (0.0, 1.0)
            return float(low), float(high)
        size = np.sqrt(np.square(step).sum(axis=-1))[rows]
        speed = size / np.diff(records.ball_time, axis=1)[rows]
        low, high = np.quantile(speed, [0.1, 0.9]) if speed.size else (0.0, 1.0)
        return float(low), float(high)

    def swing_span(self, coordinate: Coordinate) -> tuple[float, float]:
        """What the pendulum goes through of an angle (rad) or of the size of its rate (rad/s)."""
        angle = self.records.pendulum_angle[self.records.pendulum_used]
        if not angle.size:
            return 0.0, 1.0
        if coordinate is not Coordinate.RATE:
            return float(angle.min()), float(angle.max())
        body = self._pendulum()
        stiffness = body.mass * self.baseline.gravity * body.com / body.inertia
        reach = float(np.abs(angle).max())
        if self.mode == "impact":
            reach = float(np.nanmax(np.abs(self.records.backswing)))
        return 0.0, float(np.sqrt(2.0 * stiffness * (1.0 - np.cos(min(reach, np.pi)))))

    def nominal_speed(self) -> FloatArray:
        """Impact speed of each trial without losses, (T,), m/s."""
        body, records = self._pendulum(), self.records
        drop = np.cos(records.launch_angle) - np.cos(records.backswing)
        stiffness = 2.0 * body.mass * self.baseline.gravity * body.com / body.inertia
        return np.nan_to_num(np.sqrt(np.maximum(stiffness * drop, 0.0)) * body.length)

    def _seen(
        self,
        terms: Sequence[BatchTerm],
        ball: FloatArray,
        velocity: FloatArray,
        phi: FloatArray,
        omega: FloatArray,
        times: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        ball = np.array(ball)
        rest = ball[0, ..., :1], ball[1, ..., :1]
        if self.mode == "swing":
            rest = NOWHERE
        if self.mode == "impact":
            rest = np.zeros((1, 1, 1)), self._rest_y(phi.shape[:2])[..., None]
        for term in terms:
            at = term.rows
            if "image" in term.effect.hooks:
                values = {name: value[..., None] for name, value in term.values.items()}
                here = (_rows(rest[0], at), _rows(rest[1], at))
                time = times[0][at] if times[0].ndim == 3 else times[0]
                x, y, z = ball[:, at]
                vx, vy, vz = velocity[:, at]
                view = CameraView(time, x, y, z, vx, vy, vz, 0.0, 0.0, *here, *self.centre)
                for axis, seen in enumerate(term.effect.image(values, view)):
                    ball[axis, at] = seen
        phi = self.angles_seen(terms, phi, omega, times[1], rest)
        stacked = np.concatenate([ball[0], ball[1], ball[2], phi], axis=-1)
        return np.where(np.isfinite(stacked), np.clip(stacked, -OUTSIDE, OUTSIDE), OUTSIDE)

    def angles_seen(
        self,
        terms: Sequence[BatchTerm],
        phi: FloatArray,
        omega: FloatArray,
        time: FloatArray,
        rest: tuple[FloatArray, FloatArray] = NOWHERE,
    ) -> FloatArray:
        """Angles as the instrument reads them, (K, T, P), rad.

        Parameters
        ----------
        phi, omega : (K, T, P) array
            Where the pendulum is and how fast, rad and rad/s.
        time : (T, P) or (K, T, P) array
            On the recording's clock, s.
        rest : pair of arrays
            Ball's centre at rest, m; of swings without a ball none.
        """
        seen = np.array(phi)
        for term in terms:
            if "angle" not in term.effect.hooks:
                continue
            at = term.rows
            values = {name: value[..., None] for name, value in term.values.items()}
            view = CameraView(
                time[at] if time.ndim == 3 else time, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
                seen[at], omega[at], _rows(rest[0], at), _rows(rest[1], at), *self.centre, self.arm,
            )  # fmt: skip
            seen[at] = term.effect.angle(values, view)
        return seen


def _rows(place: FloatArray, at: slice) -> FloatArray:
    """A place in the models of a term; one that is the same in all models stands once."""
    return place[at] if place.shape[0] > 1 else place


State = TypeVar("State", Contact, Outcome)


@dataclass(frozen=True)
class PendulumBody:
    """The four numbers of a pendulum that its swing needs, SI."""

    length: float
    inertia: float
    mass: float
    com: float


STRIKE_HOOKS = frozenset({"start", "torque", "contact", "clock", "inputs"})
"""Hooks of laws on which a strike depends, from its back-swing to the ball's release."""

FLIGHT_HOOKS = frozenset({"force", "inputs"})
"""Hooks of laws on which a flight depends, given its start."""


@dataclass(frozen=True)
class _StrikeLanes:
    """Outcomes of contacts, ball times since first touch (K, T, S) and the swing (K, T, P)."""

    outcome: Outcome
    ball_since: FloatArray
    phi: FloatArray
    omega: FloatArray


def _distinct(
    terms: Sequence[BatchTerm], hooks: Set[str], own: FloatArray
) -> tuple[LaneIndex, LaneIndex]:
    """First lane of each kind, in order, and of each lane the place of its kind among those.

    Lanes are of a kind if their own values (K, ...) and all laws with one of the hooks agree.
    """
    keys: list[list[object]] = [[values.tobytes()] for values in own]
    for term in terms:
        if hooks & term.effect.hooks:
            for row in range(term.rows.start, term.rows.stop):
                place = row - term.rows.start
                mine = tuple(value[place].tobytes() for value in term.values.values())
                keys[row].append((id(term.effect), mine))
    kinds: dict[tuple[object, ...], int] = {}
    first = list[int]()
    lane = np.empty(len(keys), dtype=np.int64)
    for row, key in enumerate(keys):
        kind = tuple(key)
        if kind not in kinds:
            kinds[kind] = len(first)
            first.append(row)
        lane[row] = kinds[kind]
    return np.array(first, dtype=np.int64), lane


def _of_lanes(terms: Sequence[BatchTerm], lanes: LaneIndex) -> tuple[BatchTerm, ...]:
    """The terms of some lanes, in order, renumbered."""
    found = []
    for term in terms:
        start, stop = np.searchsorted(lanes, [term.rows.start, term.rows.stop])
        if stop > start:
            picked = lanes[start:stop] - term.rows.start
            values = {name: value[picked] for name, value in term.values.items()}
            found.append(BatchTerm(term.effect, slice(int(start), int(stop)), values))
    return tuple(found)


def _lanes(outcome: Outcome, lanes: LaneIndex, count: int) -> Outcome:
    """The outcomes of some of `count` lanes."""
    return type(outcome)(
        **{
            name: np.asarray(value)[lanes] if np.ndim(value) > 1 and len(value) == count else value
            for name, value in vars(outcome).items()
        }
    )


def _read_components(terms: Sequence[BatchTerm]) -> int:
    """Components of a ball's state that are read: velocities only where images depend on them."""
    return 6 if any("image" in term.effect.hooks for term in terms) else 3


def _true_inputs(terms: Sequence[BatchTerm]) -> dict[str, FloatArray]:
    """True over stated value of each input that is open, (rows, 1)."""
    rows = max((term.rows.stop for term in terms), default=0)
    found: dict[str, FloatArray] = {}
    for term in terms:
        if "inputs" in term.effect.hooks:
            for name, factor in term.effect.inputs(term.values).items():
                found.setdefault(name, np.ones((rows, 1)))[term.rows] *= factor
    return found


def _acting(terms: Sequence[BatchTerm]) -> tuple[ActingEffect, ...]:
    """The terms as the equations of motion take them."""
    return tuple(ActingEffect(t.effect, t.values, t.rows) for t in terms)


def _cut(state: State, rows: slice) -> State:
    return type(state)(
        **{
            name: value[rows] if np.ndim(value) == 2 else value
            for name, value in vars(state).items()
        }
    )


def _paste(outcome: Outcome, part: Outcome, rows: slice) -> Outcome:
    whole = {}
    for name, value in vars(outcome).items():
        array = np.array(value)
        array[rows] = getattr(part, name)
        whole[name] = array
    return Outcome(**whole)
