"""Explain tables with a few numbers per trial: impact speed, ball speed, range.

The swing, contact and flight of the full engine predict the numbers, and the same catalogue is
tried. Everything is linear enough for exact Bayesian evidence.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, gammaincc, log_ndtr, logsumexp

from metrology import SetupError, TooLittleDataError, UsageError
from mismatch.candidates import Candidate, start_values
from mismatch.fitting.prepare import baseline_model
from mismatch.fitting.settings import MAX_SETTINGS, MIN_SETTINGS
from mismatch.forward import BatchTerm, Forward, ForwardModel, batch_terms
from mismatch.records import Baseline, Records, Scatter, settings_of
from mismatch.repeats import IN_ANOTHER_ORDER, RepeatsTest, lack_of_fit
from mismatch.sanity import FARTHEST
from mismatch.verdict import (
    DOUBTED,
    Alternative,
    EngineVerdict,
    HeldOut,
    Location,
    NamedEffect,
    ParameterValue,
    Remainder,
    VerdictKind,
)
from physics.domain import FloatArray, Vector
from physics.effects import (
    CATALOGUE,
    CameraView,
    Contact,
    Effect,
    EffectId,
    Outcome,
    Parameter,
    Values,
)
from physics.effects.impact import VelocityDependentCor, change_restitution
from physics.effects.measurement import OriginOffset
from physics.integrator import Trajectory, crossing, integrate

__all__ = [
    "CHANNELS",
    "MIN_TRIALS",
    "NUISANCES",
    "Answer",
    "Posterior",
    "Search",
    "Strength",
    "TableExplained",
    "TableForward",
    "TrialTable",
    "explain_table",
    "search",
    "strengths_of",
    "table_candidates",
    "table_forward",
    "table_held_out",
    "unstated",
]

CHANNELS = ("impact_speed", "ball_speed", "range")

"""What a trial may contain, in the order of the arrays' last axis; m/s, m/s, m."""

MIN_STD = 1e-9
"""m or m/s: a few atoms; no ball's surface is defined better."""

MIN_TRIALS = 4
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
                hint="The range runs from the ball's centre at rest in the direction of flight.",
            )
        if np.any(self.stds[np.isfinite(self.stds)] <= 0.0):
            raise UsageError(
                "a standard uncertainty must be positive", hint="Leave it empty where unknown."
            )
        if np.any(self.stds < MIN_STD):
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
    def setting(self) -> NDArray[np.int64]:
        """(T,) setting of each trial: its ball and back-swing, or impact speed; -1 if unknown."""
        known = np.isfinite(self.backswing).any()
        return settings_of(self.backswing if known else self.values[:, 0], self.balls)

    @property
    def present(self) -> NDArray[np.bool_]:
        """(3,) which channels the table has at all."""
        return np.asarray(np.isfinite(self.values).any(axis=0))

    def require_enough(self) -> None:
        """Refuse a table from which nothing follows.

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
        if useful < MIN_TRIALS:
            raise TooLittleDataError(
                f"{useful} trials with a result are too little to determine anything",
                hint=f"At least {MIN_TRIALS} trials at two or more impact speeds are needed.",
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
assumed."""

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

    def predict(self, models: Sequence[ForwardModel], nuisance: FloatArray) -> FloatArray:
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
        time = self.forward._fall_time() * 1.35
        path = integrate(self.forward.swing_rates(terms, time / 64), start, time, 64)
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

"""Dimensionless, spread of the drag coefficients of balls below the drag crisis, assumed."""

POSITIONS_NEEDED = frozenset({"lens_distortion", "rolling_shutter", "dropped_frames"})

"""Faults that show in the course of a flight and in no single number of it."""

FORMS_LEFT_OUT = frozenset({"about a point", "three axes", "ball only"})

MIN_TRACE = 1e-4

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


def strengths_of(candidate: Candidate, model: ForwardModel) -> tuple[Strength, ...]:
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
    forward: TableForward, model: ForwardModel, effects: Iterable[Effect]
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
            found.append(Candidate(effect, shape))
    return _with_a_trace(forward, model, found)


def _along_the_wall(effect: Effect) -> Effect:
    along = tuple(p for p in effect.parameters if p.name in ALONG_WALL)
    return OriginAlongTheWall(**{**vars(effect), "parameters": along})


def _with_a_trace(
    forward: TableForward, model: ForwardModel, candidates: Sequence[Candidate]
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
    return tuple(c for c, t in zip(candidates, trace, strict=True) if t > MIN_TRACE)


NOISE_SIZES = (
    (0.001, 0.003, 0.01, 0.03),
    (0.001, 0.002, 0.004, 0.008, 0.016, 0.032),
    (0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064),
)

"""Tried where no uncertainty is stated: shares of the two speeds, and m of the range."""

INFLATIONS = (1.0, 2.0, 4.0, 8.0)

"""Factors on the noise that are averaged over, each double the last, as likely as each other."""

DOUBT = 0.1

"""Prior probability of each inflation: a stated uncertainty is tested, not believed."""


SETTING_SIZES = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)

"""What repeats of a setting share, over what differs from trial to trial. Nothing is as likely as
all other sizes together. Convention: doublings about one, over which the evidence is summed."""


@dataclass(frozen=True)
class Problem:
    """A table around one point of its models, linearised.

    Attributes
    ----------
    residual : (T, 3) array
        Recorded less predicted numbers; NaN where not recorded.
    columns : (T, 3, M) array
        Derivatives of the predictions by shared parameters.
    jacobian : (T, 3, 4) array
        Derivatives by each trial's own values.
    """

    residual: FloatArray
    columns: FloatArray
    jacobian: FloatArray


@dataclass(frozen=True)
class Gram:
    """Products of whitened columns, one set for each of G noise sizes.

    Attributes
    ----------
    information : (G, M, M) array
    score : (G, M) array
    constant : (G,) array
        Log-likelihood of the point itself, with the prior of the noise.
    chi2_at_zero : (G,) array
        Chi-square of the point.
    noise : (G, 3) array
        Sizes of unstated noise as in `NOISE_SIZES`, or factors on stated noise.
    """

    information: FloatArray
    score: FloatArray
    constant: FloatArray
    chi2_at_zero: FloatArray
    noise: FloatArray


@dataclass(frozen=True)
class Posterior:
    """Shared parameters given the data.

    Attributes
    ----------
    log_evidence : float
    mean, std : (M,) array
        Of parameters, less the values that their priors are centred on.
    chi2 : float
        Misfit at the mean, averaged over the noise.
    noise : (3,) array
        Mean size of unstated noise, or mean factor on stated noise.
    """

    log_evidence: float
    mean: FloatArray
    std: FloatArray
    chi2: float
    noise: FloatArray


def unstated(table: TrialTable) -> tuple[bool, bool, bool]:
    """Which channels have numbers without an uncertainty, of those where one is needed."""
    needed = np.isfinite(table.values)
    # Without a back-swing to compare it with, an unstated error of impact speed can't be separated
    # from errors of what follows, which are counted already.
    needed[:, 0] &= np.isfinite(table.backswing)
    lacking = np.asarray((needed & ~np.isfinite(table.stds)).any(axis=0))
    return bool(lacking[0]), bool(lacking[1]), bool(lacking[2])


def _noise_grid(table: TrialTable) -> tuple[FloatArray, FloatArray]:
    """(G, 3) sizes or factors of the noise, and (G,) their log prior probabilities."""
    axes: list[tuple[float, ...]] = []
    priors: list[tuple[float, ...]] = []
    held = (np.isfinite(table.backswing).any(), *table.present[1:])
    for channel, lacking in enumerate(unstated(table)):
        sizes = NOISE_SIZES[channel] if lacking else INFLATIONS if held[channel] else (1.0,)
        weights = [1.0 / len(sizes)] * len(sizes)
        if sizes is INFLATIONS:
            weights = [1.0 - DOUBT * (len(sizes) - 1), *[DOUBT] * (len(sizes) - 1)]
        axes.append(sizes)
        priors.append(tuple(weights))
    grid = np.array(list(itertools.product(*axes)))
    return grid, np.log(np.array(list(itertools.product(*priors)))).sum(axis=1)


def _covariances(
    table: TrialTable, scatter: Scatter, jacobian: FloatArray, used: FloatArray, grid: FloatArray
) -> FloatArray:
    """Covariance of each trial's numbers, (G, T, 3, 3)."""
    # Unstated noise is a share of the speeds, but metres of the range.
    scale = np.column_stack([np.nan_to_num(table.values[:, :2]), np.ones(table.trials)])
    scale[:, 0] *= np.isfinite(table.backswing)
    lacking = np.array(unstated(table))
    std = grid[:, None, :] * np.where(lacking, scale, np.nan_to_num(table.stds))
    own = np.empty((len(grid), table.trials, 4))
    own[..., 0] = std[..., 0]
    own[..., 1] = scatter.backswing
    own[..., 2] = scatter.cor
    own[..., 3] = scatter.launch_angle
    spread = jacobian[None] * own[:, :, None, :]
    covariance = spread @ np.swapaxes(spread, -1, -2)
    direct = np.square(std)
    # The impact speed's own error is among the trial's values already.
    direct[..., 0] = 1e-12
    covariance += direct[..., None] * np.eye(3)
    both = used[:, :, None] * used[:, None, :]
    return np.where(both > 0.0, covariance, np.eye(3))


def gram_of(problem: Problem, table: TrialTable, scatter: Scatter) -> Gram:
    """Whiten a problem under every size of noise, and of what repeats of a setting share."""
    used = np.isfinite(problem.residual).astype(np.float64)
    residual = np.nan_to_num(problem.residual)
    jacobian = np.nan_to_num(problem.jacobian) * used[..., None]
    settings = _of_settings(table, jacobian)
    columns = np.concatenate([settings, np.nan_to_num(problem.columns) * used[..., None]], axis=-1)
    grid, prior = _noise_grid(table)
    covariance = _covariances(table, scatter, jacobian, used, grid)
    root = np.linalg.cholesky(covariance)
    shape = (*covariance.shape[:2], 3, columns.shape[-1])
    white = np.linalg.solve(root, np.broadcast_to(columns, shape))
    left = np.linalg.solve(root, np.broadcast_to(residual[..., None], (*shape[:3], 1)))[..., 0]
    log_size = 2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=(1, 2))
    chi2_at_zero = np.square(left).sum(axis=(1, 2))
    count = float(used.sum())
    gram = Gram(
        np.einsum("gtcm,gtcn->gmn", white, white),
        np.einsum("gtcm,gtc->gm", white, left),
        prior - 0.5 * (chi2_at_zero + log_size + count * np.log(2.0 * np.pi)),
        chi2_at_zero,
        grid,
    )
    usual = (scatter.backswing, scatter.cor, scatter.launch_angle)
    return _over_sizes(gram, np.tile(usual, settings.shape[-1] // len(usual)))


def _of_settings(table: TrialTable, jacobian: FloatArray) -> FloatArray:
    """Derivatives (T, 3, n) by errors of back-swing, restitution and angle of each setting."""
    setting = table.setting
    repeated = np.flatnonzero(np.bincount(setting[setting >= 0], minlength=1) > 1)
    if not MIN_SETTINGS <= repeated.size <= MAX_SETTINGS:
        return np.zeros((*jacobian.shape[:2], 0))
    mine = setting[:, None] == repeated
    moved = jacobian[:, :, None, 1:] * mine[:, None, :, None]
    return np.asarray(moved.reshape(*jacobian.shape[:2], -1))


def _over_sizes(gram: Gram, usual: FloatArray) -> Gram:
    """Products with errors of settings, which come first, integrated for each of their sizes."""
    if not usual.size:
        return gram
    weights = [0.5, *[0.5 / (len(SETTING_SIZES) - 1)] * (len(SETTING_SIZES) - 1)]
    parts = [
        replace(one, constant=one.constant + math.log(weight))
        for size, weight in zip(SETTING_SIZES, weights, strict=True)
        for one in (integrated(gram, usual.size, max(size, 1e-6) * usual),)
    ]
    return Gram(*(np.concatenate(values) for values in zip(*map(_values_of, parts), strict=True)))


def _values_of(gram: Gram) -> tuple[FloatArray, ...]:
    return gram.information, gram.score, gram.constant, gram.chi2_at_zero, gram.noise


def posterior_of(
    gram: Gram, columns: NDArray[np.int64], width: FloatArray, sign: FloatArray
) -> Posterior:
    """Integrate the chosen columns over Gaussian priors of zero mean.

    Parameters
    ----------
    gram : Gram
    columns : (k,) int array
        Which parameters are free.
    width : (k,) array
        Prior standard deviations.
    sign : (k,) array
        1 or −1 for a parameter that nature keeps on one side of zero (a half Gaussian), else 0.
    """
    pick = np.ix_(np.arange(len(gram.constant)), columns, columns)
    information = gram.information[pick]
    score = gram.score[:, columns]
    precision = information + np.diag(1.0 / np.square(width))
    covariance = np.linalg.inv(precision)
    mean = np.einsum("gij,gj->gi", covariance, score)
    std = np.sqrt(np.einsum("gii->gi", covariance))
    _, size = np.linalg.slogdet(precision * width[:, None] * width[None, :])
    log_evidence = gram.constant + 0.5 * np.einsum("gi,gi->g", score, mean) - 0.5 * size
    bound = sign != 0.0
    if bound.any():
        inside = log_ndtr(sign[bound] * mean[:, bound] / std[:, bound]) + np.log(2.0)
        log_evidence = log_evidence + inside.sum(axis=1)
    total = float(logsumexp(log_evidence))
    share = np.exp(log_evidence - total)
    middle = share @ mean
    spread = np.sqrt(share @ (np.square(std) + np.square(mean - middle)))
    fitted = np.einsum("gij,gi,gj->g", information, mean, mean)
    chi2 = gram.chi2_at_zero - 2.0 * np.einsum("gi,gi->g", score, mean) + fitted
    return Posterior(
        total,
        middle,
        spread,
        float(share @ chi2),
        share @ gram.noise,
    )


def integrated(gram: Gram, count: int, width: FloatArray) -> Gram:
    """Products with the first `count` parameters integrated over their priors, for good.

    Parameters
    ----------
    width : (count,) array
        Prior standard deviations.
    """
    precision = gram.information[:, :count, :count] + np.diag(1.0 / np.square(width))
    cross = gram.information[:, :count, count:]
    pulled = np.linalg.solve(precision, gram.score[:, :count, None])[..., 0]
    held = np.linalg.solve(precision, cross)
    _, size = np.linalg.slogdet(precision * width[:, None] * width[None, :])
    gain = np.einsum("gi,gi->g", gram.score[:, :count], pulled)
    return Gram(
        gram.information[:, count:, count:] - np.einsum("gim,gin->gmn", cross, held),
        gram.score[:, count:] - np.einsum("gim,gi->gm", cross, pulled),
        gram.constant + 0.5 * gain - 0.5 * size,
        gram.chi2_at_zero - gain,
        gram.noise,
    )


def evidences(
    gram: Gram, sets: NDArray[np.int64], width: FloatArray, sign: FloatArray
) -> FloatArray:
    """Log evidence of many sets of k parameters at once.

    Parameters
    ----------
    sets : (P, k) int array
    width, sign : (M,) array
        Of every parameter, as in `posterior_of`.

    Returns
    -------
    (P,) array
    """
    if sets.shape[1] == 0:
        return np.full(len(sets), logsumexp(gram.constant))
    widths, signs = width[sets], sign[sets]
    own = np.einsum("pi,ij->pij", 1.0 / np.square(widths), np.eye(sets.shape[1]))
    precision = gram.information[:, sets[:, :, None], sets[:, None, :]] + own
    score = gram.score[:, sets]
    covariance = np.linalg.inv(precision)
    mean = np.einsum("gpij,gpj->gpi", covariance, score)
    std = np.sqrt(np.einsum("gpii->gpi", covariance))
    _, size = np.linalg.slogdet(precision * widths[:, :, None] * widths[:, None, :])
    inside = np.where(signs != 0.0, log_ndtr(signs * mean / std) + np.log(2.0), 0.0)
    gain = 0.5 * np.einsum("gpi,gpi->gp", score, mean) - 0.5 * size + inside.sum(axis=-1)
    return np.asarray(logsumexp(gram.constant[:, None] + gain, axis=0))


SIZE_PRIOR = (0.5, 0.4, 0.09, 0.01)

"""Prior probability that nothing, one, two, three things are missing, shared by sets of a size."""

SEED_PAIRS = 30

"""Pairs that are refined, the best by the linear score first; assumed."""

MAX_REFINED = 24

"""Groups that are refined at most, the best first; assumed."""

REFINED_WITHIN = 9.0

"""Log odds behind the best: a group farther behind has a share below 1e-4 of the posterior."""

TOLD_APART = 2.0

"""Log odds from which one form is distinguished from another: odds of seven to one."""

STEPS = np.array([1e-3, 1e-4, 1e-4, 1e-4])

"""Steps of differences by the nuisances, in their units: far above rounding, far below where a
landing bends."""

ROUNDS = 4

"""Rounds of Gauss-Newton: a landing is nearly straight in what is open, so that it settles in
two."""


@dataclass(frozen=True)
class Answer:
    """A set of effects with its evidence.

    Attributes
    ----------
    members : tuple of Candidate
        In the form that fits best; empty for the baseline as it is.
    posterior : Posterior
        Shared trial-to-trial values first (restitution and launch angle of each ball), then the
        members' strengths.
    log_weight : float
        Evidence times prior, all forms and shapes of these ids together.
    problem : Problem
        The table linearised about the answer.
    model : ForwardModel
        The baseline with the members in it, at their posterior means.
    """

    members: tuple[Candidate, ...]
    posterior: Posterior
    log_weight: float
    problem: Problem
    model: ForwardModel

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids, in order of the alphabet."""
        return tuple(sorted(member.id for member in self.members))


@dataclass(frozen=True)
class Search:
    """Every set of effects, weighed.

    Attributes
    ----------
    answers : tuple of Answer
        Those that matter, best first.
    probabilities : (n,) array
        Of each answer, among all sets there are.
    inclusion : mapping
        Id → probability of all sets that hold it.
    laws : int
        How many of the shared parameters are trial-to-trial values of the balls.
    """

    answers: tuple[Answer, ...]
    probabilities: FloatArray
    inclusion: Mapping[str, float]
    laws: int


@dataclass(frozen=True)
class _Point:
    """Where to linearise: a model, and shared offsets (2 B,) of restitution and launch angle."""

    model: ForwardModel
    offsets: FloatArray


def _linearised(
    forward: TableForward, point: _Point, free: Sequence[tuple[Candidate, Strength]]
) -> Problem:
    """Residuals and derivatives at a point, by finite differences in one prediction."""
    records = forward.forward.records
    count, balls = forward.table.trials, len(records.ball_names)
    base = np.zeros((count, 4))
    for ball in range(balls):
        mine = records.ball_index == ball
        base[mine, 2] += point.offsets[2 * ball]
        base[mine, 3] += point.offsets[2 * ball + 1]
    models, rows, steps = [point.model] * (1 + len(NUISANCES)), [base], []
    for place, step in enumerate(STEPS):
        moved = base.copy()
        moved[:, place] += step
        rows.append(moved)
    for candidate, one in free:
        held = next((v for e, v in point.model.entries if e is candidate.effect), None)
        values = dict(held) if held is not None else start_values(candidate, point.model)
        step = 1e-3 * one.parameter.scale * (one.sign or 1)
        if not one.parameter.lower <= values[one.parameter.name] + step <= one.parameter.upper:
            step = -step
        values[one.parameter.name] += step
        models.append(_put(point.model, candidate, values))
        rows.append(base)
        steps.append(step)
    seen = forward.predict(models, np.stack(rows))
    plain = seen[0]
    own = np.moveaxis((seen[1:5] - plain) / STEPS[:, None, None], 0, -1)
    # What was read as impact speed is the true one less its error.
    own[:, 0, 0] = -1.0
    shared = np.zeros((count, 3, 2 * balls))
    for ball in range(balls):
        mine = records.ball_index == ball
        shared[mine, :, 2 * ball : 2 * ball + 2] = own[mine, :, 2:]
    columns = [shared]
    if steps:
        columns.append(np.moveaxis((seen[5:] - plain) / np.array(steps)[:, None, None], 0, -1))
    return Problem(forward.table.values - plain, np.concatenate(columns, axis=-1), own)


def _put(model: ForwardModel, candidate: Candidate, values: dict[str, float]) -> ForwardModel:
    kept = tuple((e, v) for e, v in model.entries if e is not candidate.effect)
    return replace(model, entries=kept).having(candidate.effect, values).order()


def _widths(forward: TableForward) -> FloatArray:
    scatter = forward.forward.baseline.scatter
    balls = len(forward.forward.records.ball_names)
    return np.tile([scatter.cor_law, scatter.launch_angle_law], balls)


def refined(
    forward: TableForward, model: ForwardModel, members: Sequence[Candidate]
) -> tuple[Posterior, Problem, ForwardModel] | None:
    """Posterior of one set, linearised again and again where its mean lies.

    Returns
    -------
    tuple or None
        None where a mean leaves what nature allows.
    """
    free = [(c, one) for c in members for one in strengths_of(c, model)]
    scatter, laws = forward.forward.baseline.scatter, _widths(forward)
    width = np.concatenate([laws, [one.width for _, one in free]])
    sign = np.concatenate([np.zeros(laws.size), [float(one.sign) for _, one in free]])
    start = np.concatenate([np.zeros(laws.size), [one.start for _, one in free]])
    everything = np.arange(width.size, dtype=np.int64)
    off = np.zeros(width.size)
    for _ in range(ROUNDS):
        values, place = model, laws.size
        for candidate in members:
            own = start_values(candidate, model)
            for one in strengths_of(candidate, model):
                moved = float(start[place] + off[place])
                own[one.parameter.name] = float(
                    np.clip(moved, one.parameter.lower, one.parameter.upper)
                )
                off[place] = own[one.parameter.name] - start[place]
                place += 1
            values = _put(values, candidate, own)
        problem = _linearised(forward, _Point(values, off[: laws.size]), free)
        about = Problem(problem.residual + problem.columns @ off, problem.columns, problem.jacobian)
        posterior = posterior_of(gram_of(about, forward.table, scatter), everything, width, sign)
        settled = bool(np.all(np.abs(posterior.mean - off) < 0.01 * posterior.std))
        off = posterior.mean.copy()
        if settled:
            break
    for place, (_, one) in enumerate(free, start=laws.size):
        value = start[place] + posterior.mean[place]
        slack = posterior.std[place] if one.sign else 0.0
        if not one.parameter.lower - slack <= value <= one.parameter.upper + slack:
            return None
    return posterior, about, values


@dataclass(frozen=True)
class _Pool:
    """All candidates around the baseline, with the trial-to-trial values already integrated out."""

    candidates: tuple[Candidate, ...]
    columns: tuple[tuple[int, ...], ...]
    width: FloatArray
    sign: FloatArray
    gram: Gram
    laws: int

    def evidence(self, sets: Sequence[tuple[int, ...]]) -> dict[tuple[int, ...], float]:
        """Log evidence of sets of candidates."""
        found: dict[tuple[int, ...], float] = {}
        by_size: dict[int, list[tuple[int, ...]]] = {}
        for members in sets:
            free = sum(len(self.columns[m]) for m in members)
            by_size.setdefault(free, []).append(members)
        for size, mine in by_size.items():
            columns = [[c for m in members for c in self.columns[m]] for members in mine]
            index = np.array(columns, dtype=np.int64).reshape(len(mine), size)
            evidence = evidences(self.gram, index, self.width, self.sign)
            found |= dict(zip(mine, evidence.tolist(), strict=True))
        return found


def _pool(forward: TableForward, model: ForwardModel, candidates: Sequence[Candidate]) -> _Pool:
    laws = _widths(forward)
    free = [(c, one) for c in candidates for one in strengths_of(c, model)]
    columns, place = [], 0
    for candidate in candidates:
        count = len(strengths_of(candidate, model))
        columns.append(tuple(range(place, place + count)))
        place += count
    problem = _linearised(forward, _Point(model, np.zeros(laws.size)), free)
    gram = gram_of(problem, forward.table, forward.forward.baseline.scatter)
    return _Pool(
        tuple(candidates),
        tuple(columns),
        np.array([one.width for _, one in free]),
        np.array([float(one.sign) for _, one in free]),
        integrated(gram, laws.size, laws),
        laws.size,
    )


def _different(pool: _Pool, members: Sequence[int]) -> bool:
    return len({pool.candidates[m].id for m in members}) == len(members)


def _scanned(pool: _Pool, most: int) -> dict[tuple[int, ...], float]:
    """Log evidence of every single and pair, and of triples grown from the best pairs."""
    every = range(len(pool.candidates))
    found = pool.evidence([(), *((m,) for m in every)])
    if most < 2:
        return found
    pairs = pool.evidence([p for p in itertools.combinations(every, 2) if _different(pool, p)])
    found |= pairs
    if most < 3:
        return found
    triples = {
        tuple(sorted((*pair, more)))
        for pair in sorted(pairs, key=lambda p: -pairs[p])[:SEED_PAIRS]
        for more in every
        if _different(pool, (*pair, more))
    }
    return found | pool.evidence(sorted(triples))


def _usual(
    pool: _Pool, forms: Sequence[tuple[float, tuple[int, ...]]]
) -> tuple[float, tuple[int, ...]]:
    """The most probable form, or the usual one where the table cannot distinguish them.

    The usual form is the one that a setup file means.
    """

    def unusual(members: tuple[int, ...]) -> int:
        laws = [pool.candidates[m].effect for m in members]
        return sum(law.form != CATALOGUE[law.id][0].form for law in laws if law.id in CATALOGUE)

    top = max(forms)[0]
    alike = [one for one in forms if one[0] > top - TOLD_APART]
    return min(alike, key=lambda one: (unusual(one[1]), -one[0]))


def search(
    forward: TableForward, model: ForwardModel, candidates: Sequence[Candidate], most: int = 3
) -> Search:
    """Weigh every set of up to `most` effects.

    Parameters
    ----------
    forward : TableForward
    model : ForwardModel
        The baseline's effects.
    candidates : sequence of Candidate
        What may be missing.
    most : int
        Largest set.

    Returns
    -------
    Search
    """
    pool = _pool(forward, model, candidates)
    by_ids: dict[tuple[str, ...], list[tuple[float, tuple[int, ...]]]] = {}
    for members, evidence in _scanned(pool, most).items():
        ids = tuple(sorted(pool.candidates[m].id for m in members))
        by_ids.setdefault(ids, []).append((evidence, members))
    kinds = len({c.id for c in pool.candidates})
    weighed = []
    for ids, forms in by_ids.items():
        share = math.log(SIZE_PRIOR[len(ids)] / math.comb(kinds, len(ids)))
        variants = math.prod(sum(c.id == i for c in pool.candidates) for i in ids)
        together = float(logsumexp([evidence for evidence, _ in forms])) - math.log(variants)
        best = _usual(pool, forms)
        weighed.append((share + together, best[0], best[1]))
    weighed.sort(key=lambda item: -item[0])
    answers, ids_of, weights = [], [], []
    for rank, (weight, evidence, members) in enumerate(weighed):
        chosen = tuple(pool.candidates[m] for m in members)
        ids_of.append(tuple(c.id for c in chosen))
        weights.append(weight)
        if members and (rank >= MAX_REFINED or weight < weighed[0][0] - REFINED_WITHIN):
            continue
        again = refined(forward, model, chosen)
        if again is None:
            weights[-1] = -np.inf
            continue
        posterior, problem, moved = again
        # All forms of these ids move with the one that fits best.
        weights[-1] = weight + posterior.log_evidence - evidence
        answers.append(Answer(chosen, posterior, weights[-1], problem, moved))
    answers.sort(key=lambda answer: -answer.log_weight)
    total = float(logsumexp(weights))
    shares = np.exp(np.array(weights) - total)
    inclusion = {
        one: float(sum(p for p, ids in zip(shares, ids_of, strict=True) if one in ids))
        for one in {c.id for c in pool.candidates}
    }
    chances = np.exp(np.array([answer.log_weight for answer in answers]) - total)
    return Search(tuple(answers), chances, inclusion, pool.laws)


RESAMPLED = 2000

"""Resamples: a probability of 0.95 is then good to 0.005."""


def _predicted(
    forward: TableForward, laws: int, answer: Answer, kept_out: NDArray[np.bool_]
) -> FloatArray:
    """Errors (T, 3) of an answer that was trained without the marked trials."""
    scatter = forward.forward.baseline.scatter
    width = np.tile([scatter.cor_law, scatter.launch_angle_law], laws // 2)
    strengths = [s for c in answer.members for s in strengths_of(c, answer.model)]
    width = np.concatenate([width, [s.width for s in strengths]])
    sign = np.concatenate([np.zeros(laws), [float(s.sign) for s in strengths]])
    problem = answer.problem
    seen = np.where(kept_out[:, None], np.nan, problem.residual)
    gram = gram_of(Problem(seen, problem.columns, problem.jacobian), forward.table, scatter)
    posterior = posterior_of(gram, np.arange(width.size, dtype=np.int64), width, sign)
    return np.asarray(problem.residual - problem.columns @ posterior.mean)


def _errors(
    forward: TableForward, laws: int, answer: Answer, kept_out: NDArray[np.bool_] | None
) -> FloatArray:
    if kept_out is not None:
        return _predicted(forward, laws, answer, kept_out)[kept_out]
    count = forward.table.trials
    return np.concatenate(
        [_predicted(forward, laws, answer, np.arange(count) == k)[k : k + 1] for k in range(count)]
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def table_held_out(
    forward: TableForward,
    laws: int,
    null: Answer,
    best: Answer,
    kept_out: NDArray[np.bool_] | None = None,
) -> HeldOut | None:
    """Errors on unseen trials before and after.

    Parameters
    ----------
    laws : int
        How many shared parameters are trial-to-trial values of the balls.
    kept_out : (T,) bool array, optional
        Trials to keep out together; by default each is kept out in turn.

    Returns
    -------
    HeldOut or None
        None where too few trials would be left.
    """
    table = forward.table
    channel = 2 if table.present[2] else 1
    before = _errors(forward, laws, null, kept_out)[:, channel]
    after = _errors(forward, laws, best, kept_out)[:, channel]
    known = np.isfinite(before) & np.isfinite(after)
    if int(known.sum()) < 2 or table.trials - 1 < MIN_TRIALS - 1:
        return None
    before, after = before[known], after[known]
    picks = np.random.default_rng(3).integers(0, before.size, (RESAMPLED, before.size))
    ratio = np.sqrt(
        np.square(before)[picks].mean(axis=1)
        / np.maximum(np.square(after)[picks].mean(axis=1), 1e-24)
    )
    low, high = np.quantile(ratio, (0.025, 0.975))
    names = table.names
    if kept_out is not None:
        names = tuple(n for n, out in zip(table.names, kept_out, strict=True) if out)
    return HeldOut(
        names, _rms(before), _rms(after), (float(low), float(high)),
        "m" if channel == 2 else "m_s",
    )  # fmt: skip


BALL_SPEED = (
    "the ball's speed just after contact (a column ball_speed_m_s), which shows what happens in"
    " contact from what happens in flight"
)

MAX_ALTERNATIVES = 8
"""Rows, so that a reader sees all of them."""

ABOVE_THE_LIMIT = 2.0

"""Sigma above the speed of a swing without losses from which a trial is pointed out."""


def groups_of(best: Answer, rivals: Sequence[Answer]) -> tuple[tuple[str, ...], ...]:
    """Ids that may stand for each other, one group for each member that has alternatives."""
    groups = {one: [one] for one in best.ids}
    for rival in rivals:
        left = [one for one in best.ids if one not in rival.ids]
        new = [one for one in rival.ids if one not in best.ids]
        for mine, other in zip(left, new, strict=True):
            if other not in groups[mine]:
                groups[mine].append(other)
    return tuple(tuple(sorted(group)) for group in groups.values() if len(group) > 1)


def named_effects(
    found: Search, best: Answer | None, most: float = 0.999
) -> tuple[NamedEffect, ...]:
    """The best answer's members, surest first; a probability counts every set that holds the id.

    It is `most` at most.
    """
    if best is None:
        return ()
    named, place = [], found.laws
    for member in best.members:
        share = found.inclusion[member.id]
        values = []
        for one in strengths_of(member, best.model):
            held = next(v for e, v in best.model.entries if e is member.effect)
            std = float(best.posterior.std[place])
            p = one.parameter
            values.append(ParameterValue(p.name, float(held[p.name]), std, p.unit))
            place += 1
        named.append(
            NamedEffect(
                member.id, member.effect.statement, min(share, most), tuple(values),
                member.effect.form,
            )
        )  # fmt: skip
    return tuple(sorted(named, key=lambda one: -one.probability))


def alternatives(
    found: Search, best: Answer | None, rivals: Sequence[Answer]
) -> tuple[Alternative, ...]:
    """Other answers; distances are twice the log odds, on the scale of a BIC."""
    if best is None:
        return ()
    rows = []
    for other in found.answers:
        if other is best or not other.members:
            continue
        behind = 2.0 * (best.log_weight - other.log_weight)
        if any(other is rival for rival in rivals):
            why = "not excluded: the table cannot distinguish it"
        elif len(other.members) > len(best.members) and set(best.ids) <= set(other.ids):
            why = "the further effect explains no more than chance would"
        else:
            why = f"less likely by odds of {np.exp(min(0.5 * behind, 50.0)):.3g}"
        rows.append(Alternative(other.ids, why, behind))
    return tuple(rows[:MAX_ALTERNATIVES])


def next_measurement(
    table: TrialTable,
    best: Answer | None,
    rivals: Sequence[Answer],
    groups: Sequence[Sequence[str]],
) -> str | None:
    """What would separate the members of the groups."""
    if best is None or not groups:
        return None
    grouped = {one for group in groups for one in group}
    members = [m for a in (best, *rivals) for m in a.members if m.id in grouped]
    phases = {m.effect.phase for m in members}
    texts = []
    if not table.present[1] and "contact" in phases and len(phases) > 1:
        texts.append(BALL_SPEED)
    for member in members:
        if member.effect.separating and member.effect.separating not in texts:
            texts.append(member.effect.separating)
    return "; or ".join(texts[:3]) or None


def located(
    forward: TableForward, null: Answer, best: Answer | None, rivals: Sequence[Answer]
) -> Location:
    """Which numbers part from the model, and how that goes with impact speed."""
    table = forward.table
    residual = null.problem.residual
    channel = _parting(residual, table)
    phases = {m.effect.phase for a in (() if best is None else (best, *rivals)) for m in a.members}
    phase = phases.pop() if len(phases) == 1 else "across_trials"
    speed = table.values[:, 0]
    if not np.isfinite(speed).all():
        speed = forward.predict([null.model], np.zeros((1, table.trials, 4)))[0, :, 0]
    known = np.isfinite(residual[:, channel])
    order = np.flatnonzero(known)[np.argsort(speed[known])]
    share = 100.0 * residual[order, channel] / (table.values - residual)[order, channel]
    count = max(1, order.size // 4)
    slow, fast = float(share[:count].mean()), float(share[-count:].mean())
    gentle, hard = float(speed[order][:count].mean()), float(speed[order][-count:].mean())
    name = ("Impact speeds", "Ball speeds", "Ranges")[channel]
    statement = (
        f"{name} differ from the model's by {slow:+.1f} % at {gentle:.2f} m/s of impact and"
        f" {fast:+.1f} % at {hard:.2f} m/s."
    )
    return Location(phase, None, None, ("impact_speed", "ball_speed", "range")[channel], statement)


def _parting(residual: np.ndarray, table: TrialTable) -> int:
    """Channel with the largest relative misfit."""
    share = np.where(np.isfinite(residual), np.abs(residual) / table.values, 0.0)
    share[:, 0] *= np.isfinite(table.backswing)
    return int(np.argmax(np.sqrt(np.nanmean(np.square(share), axis=0))))


def table_notes(forward: TableForward, model: ForwardModel) -> tuple[str, ...]:
    """About the data: what is assumed, and single trials that no swing can have made."""
    table, notes = forward.table, []
    for lacking, name in zip(
        unstated(table), ("impact speeds", "ball speeds", "ranges"), strict=True
    ):
        if lacking:
            notes.append(f"the {name} come without uncertainties; how they scatter is fitted")
    if not table.present[1]:
        notes.append(
            "ranges alone show what contact and flight do together; ball speeds would part them"
        )
    speeds = table.values[:, 0][np.isfinite(table.values[:, 0])]
    if speeds.size > 1 and np.ptp(speeds) < 0.15 * float(np.median(speeds)):
        notes.append("all impact speeds are alike: nothing that goes with speed can be determined")
    notes += _above_the_limit(forward, model)
    return tuple(notes)


def _above_the_limit(forward: TableForward, model: ForwardModel) -> list[str]:
    table = forward.table
    both = np.isfinite(table.values[:, 0]) & np.isfinite(table.backswing)
    if not both.any():
        return []
    bare = ForwardModel(tuple((e, v) for e, v in model.entries if e.phase != "swing"))
    nothing = np.zeros((1, table.trials, 4))
    moved = nothing.copy()
    moved[..., 1] = forward.forward.baseline.scatter.backswing
    limit, further = forward.predict([bare, bare], np.concatenate([nothing, moved]))[..., 0]
    std = np.hypot(further - limit, np.nan_to_num(table.stds[:, 0]))
    notes = []
    for row in np.flatnonzero(both):
        excess = table.values[row, 0] - limit[row]
        if excess > ABOVE_THE_LIMIT * std[row]:
            notes.append(
                f"trial {table.names[row]} is {100.0 * excess / limit[row]:.1f} % faster at impact"
                f" than a swing without losses from {np.rad2deg(table.backswing[row]):.0f} deg:"
                " its back-swing or its speed was misread, or the contact lies elsewhere"
            )
    return notes


NULL_DOUBTED = 0.02

"""Probability of "nothing is missing" below which something is named."""

RIVAL = 20.0

"""Odds within which another answer of the same size cannot be distinguished."""

FAR_OFF = 30.0
"""Factor between table and model: a unit or a decimal point wrong, no physics."""

ANOTHER_EXPERIMENT = 0.6
"""Relative: more than any missing effect of the catalogue does to a landing, assumed."""

READING = 0.016
"""m, assumed: how well a landing is read off the floor where nobody says so."""

READING_SHARE = 0.012

"""m, and share of the range: what a landing read off a scale may scatter by."""

SPEED_SHARE = 0.03
"""Relative, assumed: noise of impact speeds from which it is not taken for white."""

STATED_FREEDOM = 2.6
"""Degrees of freedom of the t distribution that errors over their stated uncertainties follow in 99
measurements of five lifetimes (K. M. Hanson, "Lessons about likelihood functions from nuclear
physics", AIP Conf. Proc. 954 (2007) 458, arXiv:0712.0021): stated uncertainties are wrong by a
factor whose inverse square is a chi² of so many degrees over their number."""

FARTHEST_OFF = math.sqrt(STATED_FREEDOM / float(chdtri(STATED_FREEDOM, 0.95)))
"""Factor, 3.3, by which trials may scatter beyond the uncertainties stated for them: nineteen of
twenty laboratories are wrong by less."""

MIN_P_VALUE = 1e-3
"""Probability of a chi² as large: one table in a thousand has it by chance."""


@dataclass(frozen=True)
class TableExplained:
    """A verdict on a trial table, with what it rests on.

    Attributes
    ----------
    verdict : EngineVerdict
    forward : TableForward
    model : ForwardModel
        The baseline's effects.
    found : Search
    best : Answer or None
        None where nothing is named.
    """

    verdict: EngineVerdict
    forward: TableForward
    model: ForwardModel
    found: Search
    best: Answer | None

    @property
    def null(self) -> Answer:
        """The baseline with nothing added."""
        return next(a for a in self.found.answers if not a.members)

    def residual(self, answer: Answer) -> FloatArray:
        """Recorded less fitted numbers of an answer, (T, 3)."""
        return answer.problem.residual - answer.problem.columns @ answer.posterior.mean


def explain_table(
    table: TrialTable,
    baseline: Baseline,
    *,
    own: Iterable[Effect] = (),
    hold_out: Sequence[str] = (),
) -> TableExplained:
    """Find what a model of the experiment lacks, from a few numbers per trial.

    Parameters
    ----------
    table : TrialTable
        Impact speeds or back-swings, and ball speeds or ranges.
    baseline : Baseline
        What the lab believes.
    own : iterable of Effect
        A user's own, which take part like any other.
    hold_out : sequence of str
        Trials to keep out of the fit; by default each is kept out in turn.

    Returns
    -------
    TableExplained

    Raises
    ------
    UsageError
        If units can't be right, columns seem swapped, or the setup describes something else.
    TooLittleDataError
        If there are too few trials.
    """
    table.require_enough()
    forward = table_forward(table, baseline)
    model = baseline_model(baseline)
    refuse_nonsense(forward, model)
    effects = [*(e for forms in CATALOGUE.values() for e in forms), *own]
    found = search(forward, model, table_candidates(forward, model, effects))
    null = found.probabilities[[not a.members for a in found.answers]].sum()
    best = None
    if null < NULL_DOUBTED:
        # none where every effect is worse than nothing at all, and nothing is doubted, too
        best = next((a for a in found.answers if a.members), None)
    return TableExplained(
        _verdict(forward, model, found, best, hold_out), forward, model, found, best
    )


def refuse_nonsense(forward: TableForward, model: ForwardModel) -> None:
    """Refuse numbers whose units or columns can't be what they are said to be.

    Raises
    ------
    UsageError
        With what is wrong and what would help.
    """
    table = forward.table
    predicted = forward.predict([model], np.zeros((1, table.trials, 4)))[0]
    ratio = table.values / predicted
    for channel in range(3):
        mine = ratio[:, channel][np.isfinite(ratio[:, channel])]
        if not mine.size:
            continue
        middle = float(np.median(mine))
        name = CHANNELS[channel].replace("_", " ")
        if middle > FAR_OFF or middle < 1.0 / FAR_OFF:
            raise UsageError(
                f"the recorded {name} is {middle:.3g} times what the setup expects",
                hint="Lengths are in metres, speeds in metres per second.",
            )
        if abs(np.log(middle)) > np.log1p(ANOTHER_EXPERIMENT):
            raise UsageError(
                f"the setup contradicts the table: the recorded {name} is {middle:.2f} times what"
                " it expects",
                hint="Check that no columns are swapped, and ball names, pendulum and support.",
            )


def _rivals(found: Search, best: Answer) -> tuple[Answer, ...]:
    """Answers of the same size that the table cannot distinguish from the best one."""
    least = best.log_weight - np.log(RIVAL)
    return tuple(
        a
        for a in found.answers
        if a is not best and len(a.members) == len(best.members) and a.log_weight >= least
    )


def _verdict(
    forward: TableForward,
    model: ForwardModel,
    found: Search,
    best: Answer | None,
    hold_out: Sequence[str],
) -> EngineVerdict:
    null = next(a for a in found.answers if not a.members)
    rivals = () if best is None else _rivals(found, best)
    groups = () if best is None else groups_of(best, rivals)
    remainder = _remainder(forward.table, found, best or null)
    kind: VerdictKind = "no_mismatch" if remainder.white else "unexplained"
    if best is not None:
        # A name beside a large remainder rests on a model that is still incomplete.
        kind = "ambiguous" if groups or not remainder.white else "explained"
        if _contradicted(forward.table, best):
            kind = "unexplained"
    left_out = None if best is None else _held(forward.table, hold_out)
    repeats = table_repeats(forward.table, best or null)
    again = IN_ANOTHER_ORDER if repeats is not None and repeats.lacks else None
    return EngineVerdict(
        kind,
        ("gravity", *model.ids),
        _baseline_misfit(null, best or null, forward.table),
        None if kind == "no_mismatch" else located(forward, null, best, rivals),
        named_effects(found, best, DOUBTED if kind == "unexplained" else 0.999),
        alternatives(found, best, rivals),
        groups,
        next_measurement(forward.table, best, rivals, groups) or again,
        None if best is None else table_held_out(forward, found.laws, null, best, left_out),
        remainder,
        (*forward.table.notes, *table_notes(forward, model)),
    )


def _held(table: TrialTable, names: Sequence[str]) -> NDArray[np.bool_] | None:
    if not names:
        return None
    unknown = [name for name in names if name not in table.names]
    if unknown:
        raise UsageError(
            f"there is no trial {', '.join(unknown)} to hold out",
            hint=f"Trials: {', '.join(table.names[:20])}.",
        )
    held = np.array([name in names for name in table.names])
    if int((~held).sum()) < MIN_TRIALS:
        raise TooLittleDataError(
            f"{int((~held).sum())} trials are left after holding {len(names)} out",
            hint=f"At least {MIN_TRIALS} must stay.",
        )
    return held


def _count(table: TrialTable) -> int:
    used = np.isfinite(table.values)
    used[:, 0] &= np.isfinite(table.backswing)
    return int(used.sum())


def _baseline_misfit(null: Answer, best: Answer, table: TrialTable) -> float:
    """Chi-square per number of the baseline, with the noise that the best answer leaves."""
    ratio = np.where(best.posterior.noise > 0.0, null.posterior.noise / best.posterior.noise, 1.0)
    worst = float(np.max(np.square(ratio)))
    return null.posterior.chi2 * worst / max(_count(table), 1)


def _contradicted(table: TrialTable, answer: Answer) -> bool:
    """Whether what an answer leaves contradicts the uncertainties that the table states.

    No lab misses its own scatter by so much: trials are mixed up, or the sets compared do not hold
    what happened, and odds between them say nothing.
    """
    noise = answer.posterior.noise
    stated = [not one for one in unstated(table)]
    return any(stated[k] and table.present[k] and float(noise[k]) >= FARTHEST_OFF for k in (1, 2))


def table_repeats(table: TrialTable, answer: Answer) -> RepeatsTest | None:
    """Lack of fit of an answer, by trials of one ball that repeat a back-swing or impact speed."""
    residual = answer.problem.residual - answer.problem.columns @ answer.posterior.mean
    quantities = {
        name: residual[:, channel] / table.values[:, channel]
        for channel, name in enumerate(("impact speed", "ball speed", "range"))
        if table.present[channel]
    }
    return lack_of_fit(table.setting, quantities)


def _remainder(table: TrialTable, found: Search, answer: Answer) -> Remainder:
    """Whether what is left could be errors of reading."""
    subject = "What remains after the best model" if answer.members else "The baseline's residuals"
    lacking = unstated(table)
    posterior: Posterior = answer.posterior
    parts, white = [], True
    for channel, name in ((1, "ball speeds"), (2, "ranges")):
        if not table.present[channel]:
            continue
        noise = float(posterior.noise[channel])
        if not lacking[channel]:
            white = white and noise < FARTHEST_OFF
            parts.append(f"{name} scatter {noise:.1f} times as widely as stated")
        elif channel == 2:
            white = white and noise < max(
                READING, READING_SHARE * float(np.nanmedian(table.values[:, 2]))
            )
            parts.append(f"{name} scatter by {1e3 * noise:.1f} mm")
        else:
            white = white and noise < SPEED_SHARE
            parts.append(f"{name} scatter by {100.0 * noise:.1f} %")
    free = sum(len(c.effect.strengths) for c in answer.members)
    p_value = float(gammaincc(0.5 * max(_count(table) - free, 1), 0.5 * posterior.chi2))
    white = white and p_value > MIN_P_VALUE
    end = "as errors of reading do" if white else "more than errors of reading would"
    statement = f"{subject}: {' and '.join(parts)}, {end}."
    repeats = table_repeats(table, answer)
    if repeats is not None:
        white = white and not repeats.lacks
        statement += f" {repeats.in_words}."
    return Remainder(white, statement)
