"""Prepare a campaign: mode, clocks, rows used, noise, and the refitted baseline."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from metrology import Defaults, TooLittleDataError
from mismatch.fitting.fit import (
    MIN_ROWS,
    PIECE_STEPS,
    Fit,
    fit_model,
    free_parameters,
    left_open,
    rows_at_rest,
    seen_swings,
)
from mismatch.fitting.reading import reading_beside_any_losses
from mismatch.forward import NUISANCES, Forward, ForwardModel, Mode, OwnStrength
from mismatch.records import (
    Baseline,
    CampaignRecords,
    Noise,
    Records,
    estimate_noise,
    lay_out,
    slow_noise,
    with_clock_jitter,
)
from physics.domain import FloatArray
from physics.effects import CATALOGUE, Effect, EffectId, Form, Level
from physics.effects.measurement import PITCH, CameraRoll, LengthScale, TimeBase

__all__ = ["Prepared", "baseline_model", "prepare", "with_slow_noise"]

GUARD_SAMPLES = 1.6
"""Rows this many samples around onset and release are left out: the model bends there."""

FREE_STATE_PACE = 3.0
"""Cosines of a record that a free initial place and velocity leave little of."""

STRAY = 5.0
"""Sigma from the line through the neighbours."""

NEIGHBOURS = 9
"""Rows that give a local velocity: a cubic has four unknowns, more than half are to spare."""

FINER = 4
"""Times the steps that a path is taken for exact with: a fourth-order error is 256 times less."""

THROWN_SHARES = (2, 4)

UNMOVED = 1e-3
"""Of the noise: what no fit sees."""

MAX_PIECES = 120
"""Pieces of a long swing; beyond so many, each is longer than a period."""


@dataclass(frozen=True)
class Prepared:
    """A campaign ready to be explained.

    Attributes
    ----------
    forward : Forward
        Predictor with records, noise and outliers settled.
    model : ForwardModel
        The baseline's effects, as stated.
    noise : Noise
        As estimated.
    fit : Fit
        The baseline refitted; of free flights and swings with what an instrument may be off by
        left open.
    """

    forward: Forward
    model: ForwardModel
    noise: Noise
    fit: Fit


def baseline_model(baseline: Baseline) -> ForwardModel:
    """The baseline's effects as a model; gravity is in the forward model itself."""
    return ForwardModel(
        tuple(
            (CATALOGUE[name][0], CATALOGUE[name][0].neutral | dict(values))
            for name, values in baseline.effects.items()
            if name != EffectId.GRAVITY
        )
    )


def instrument_faults(forward: Forward, widths: Mapping[str, float]) -> tuple[Effect, ...]:
    """Scale, clock and level of free flights, each held to none as closely as labs get them.

    A strike is held by back-swing and support, a free swing by its own zero and period; a free
    flight has nothing but gravity to check its ruler, clock and plumb line by.

    Parameters
    ----------
    widths : mapping
        Effect id → standard uncertainty where a calibration has measured it.
    """
    if forward.mode != "flight" or forward.records.trials < 2:
        # Of one throw, strengths trade against each other and against any misfit.
        return ()
    seen = np.atleast_1d(forward.records.ball_used.any(axis=(0, 1)))
    faults: list[tuple[Effect, float]] = [
        (LengthScale(), Defaults.PLANE_SCALE.std),
        (TimeBase(), Defaults.NOMINAL_RATE.std),
    ]
    if seen.all():
        roll = CameraRoll(form=Form.THREE_AXES, parameters=(*CameraRoll().parameters, PITCH))
        faults.append((roll, Defaults.LEVEL_AXES.std))
    elif seen[:2].all():
        faults.append((CameraRoll(), Defaults.LEVEL_AXES.std))
    return tuple(
        replace(
            effect,
            sharp=False,
            parameters=tuple(
                replace(p, width=widths.get(effect.id, usual), expected=0.0)
                for p in effect.parameters
            ),
        )
        for effect, usual in faults
    )


def choose_mode(records: Records, baseline: Baseline) -> Mode:
    """Impact where everything for it is known, else free flights, else free swings."""
    has_ball = bool(records.ball_used.any())
    struck = (
        baseline.pendulum is not None
        and np.isfinite(records.backswing).all()
        and np.isfinite(records.launch_angle).all()
        and all(baseline.ball(n or None).table is not None for n in records.ball_names if n)
    )
    if has_ball and struck:
        return "impact"
    if has_ball:
        return "flight"
    if not records.pendulum_used.any():
        raise TooLittleDataError(
            "there are no finite positions or angles in the data",
            hint="Fill x_m and y_m, or phi_rad, with numbers.",
        )
    if np.isfinite(records.launch_angle).any():
        # A pendulum that struck a ball does not swing freely.
        raise TooLittleDataError(
            "no position of the ball is a number, though the table has rows for it",
            hint="Without the ball's table the pendulum is taken to swing freely.",
        )
    return "swing"


def _centre(records: Records) -> tuple[float, float, float]:
    if not records.ball_used.any():
        return 0.0, 0.0, 1.0
    lows, highs = [], []
    for axis in range(2):
        used = records.ball_used[..., axis]
        values = records.position[..., axis][used] if used.any() else np.zeros(1)
        lows.append(float(values.min()))
        highs.append(float(values.max()))
    half = 0.5 * max(highs[0] - lows[0], highs[1] - lows[1], 1e-3)
    return 0.5 * (lows[0] + highs[0]), 0.5 * (lows[1] + highs[1]), half


def _span(time: FloatArray) -> FloatArray:
    span: FloatArray = np.maximum(time.max(axis=1) - time.min(axis=1), 1e-3)
    return span


def _interval(time: FloatArray) -> FloatArray:
    steps = np.diff(time, axis=1)
    return np.array([np.median(row[row > 0.0]) if np.any(row > 0.0) else 0.0 for row in steps])


def _find_clocks(forward: Forward, model: ForwardModel) -> FloatArray:
    """Label time of contact onset by trial: where the nominal prediction lies best, in L1."""
    records = forward.records
    reach = float(max(_span(records.ball_time).max(), _span(records.pendulum_time).max()))
    dense = np.linspace(-1.05 * reach, 1.05 * reach, 3001)
    grid = np.broadcast_to(dense, (records.trials, dense.size))
    table = replace(
        records, ball_time=grid, pendulum_time=grid,
        position=np.zeros((*grid.shape, 3)), pendulum_angle=np.zeros(grid.shape),
        ball_used=np.ones((*grid.shape, 3), dtype=bool),
        pendulum_used=np.ones(grid.shape, dtype=bool),
    )  # fmt: skip
    nominal = replace(forward, records=table).predict([model], np.zeros((1, records.trials, 4)))[0]
    nominal = nominal.reshape(records.trials, 4, dense.size)
    clocks = np.zeros(records.trials)
    for trial in range(records.trials):
        series = []
        for axis in range(2):
            used = records.ball_used[trial, :, axis]
            series.append(
                (records.ball_time[trial, used], records.position[trial, used, axis], axis)
            )
        used = records.pendulum_used[trial]
        series.append((records.pendulum_time[trial, used], records.pendulum_angle[trial, used], 3))
        series = [one for one in series if one[0].size]
        low = min(one[0].min() for one in series) - 0.25 * reach
        high = max(one[0].max() for one in series)
        step = (high - low) / 240
        best = 0.5 * (low + high)
        candidates = np.linspace(low, high, 241)
        for _ in range(4):
            costs = np.zeros(candidates.size)
            for t, v, axis in series:
                path = np.interp(t - candidates[:, None], dense, nominal[trial, axis])
                costs += np.abs(path - v).sum(axis=1)
            best = float(candidates[int(np.argmin(costs))])
            candidates = np.linspace(best - step, best + step, 21)
            step /= 8.0
        clocks[trial] = best
    return clocks


def _cut_contact(
    forward: Forward, clocks: FloatArray, model: ForwardModel
) -> tuple[Records, Forward]:
    """Leave out rows around the contact and after the landing; follow ball and swing far enough."""
    records, baseline = forward.records, forward.baseline
    gap = np.array(
        [
            float(baseline.ball(records.ball_names[k] or None).table(np.array([u]))[1, 0])  # type: ignore[misc]
            for k, u in zip(records.ball_index, forward.nominal_speed(), strict=True)
        ]
    )
    ball_since = records.ball_time - clocks[:, None]
    swing_since = records.pendulum_time - clocks[:, None]
    ball_guard = GUARD_SAMPLES * _interval(records.ball_time)[:, None]
    swing_guard = GUARD_SAMPLES * _interval(records.pendulum_time)[:, None]
    ball_out = (ball_since > -ball_guard) & (ball_since < gap[:, None] + ball_guard)
    swing_out = (swing_since > -swing_guard) & (swing_since < gap[:, None] + swing_guard)
    if baseline.rest_height is not None:
        # Once the ball has touched the floor the flight is over, whatever is recorded later.
        radius = 0.5 * records.diameter[:, None]
        low = records.ball_used[..., 1] & (records.position[..., 1] < radius) & (ball_since > 0.05)
        down = np.where(low, records.ball_time, np.inf).min(axis=1, keepdims=True)
        ball_out |= records.ball_time > down
    kept = replace(
        records,
        ball_used=records.ball_used & ~ball_out[..., None],
        pendulum_used=records.pendulum_used & ~swing_out,
    )
    margin = 0.05
    flight = np.where(kept.ball_used.any(axis=-1), ball_since, 0.0).max(axis=1) - gap + margin
    swing = np.where(kept.pendulum_used, swing_since, 0.0).max(axis=1) - gap + margin
    ahead = replace(
        forward,
        records=kept,
        flight_time=np.maximum(flight, 0.1),
        swing_time=np.maximum(swing, 0.05),
    )
    return kept, ahead


def _segments(forward: Forward, clocks: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    records = forward.records
    if clocks is None:
        return np.zeros(records.ball_time.shape), np.zeros(records.pendulum_time.shape)
    return (
        (records.ball_time > clocks[:, None]).astype(float),
        (records.pendulum_time > clocks[:, None]).astype(float),
    )


def _periods(records: Records, span: float) -> int:
    """Pieces that a swing of `span` is cut into: one for each period that the record shows."""
    rates = [one.rate for one in seen_swings(records) if np.isfinite(one.rate)]
    periods = span * max(rates, default=0.0) / (2.0 * np.pi)
    return int(np.clip(np.ceil(periods), 1, MAX_PIECES))


def _pace(forward: Forward) -> float:
    """Median frequency of the records' small swings over the setup's; 1 where none is seen."""
    rates = [one.rate for one in seen_swings(forward.records) if np.isfinite(one.rate)]
    return float(np.median(rates)) / forward.setup_rate if rates else 1.0


def _while_it_swings(forward: Forward) -> Records:
    """The records without what comes after rest; of a pendulum that never swings all of them.

    What friction holds beside the zero has no law of motion: it was reported as a torque there.
    """
    records = forward.records
    rate = forward.pace * forward.setup_rate
    if not np.isfinite(rate) or rate <= 0.0:
        return records
    moving = records.pendulum_used & ~rows_at_rest(records, rate)
    still = moving.sum(axis=1) < MIN_ROWS
    moving[still] = records.pendulum_used[still]
    return replace(records, pendulum_used=moving)


def _first_states(forward: Forward) -> FloatArray:
    """Rough initial states: of flights by a parabola, of swings also what their periods say."""
    records = forward.records
    if forward.mode == "swing":
        state = np.zeros((records.trials, len(NUISANCES["swing"])))
        for trial, seen in enumerate(seen_swings(records)):
            if np.isfinite(seen.rate):
                state[trial, 2] = np.log(seen.rate / forward.small_rate)
        return state
    state = np.zeros((records.trials, 6))
    for trial in range(records.trials):
        for axis in range(3):
            used = records.ball_used[trial, :, axis]
            first = records.ball_time[trial, 0]
            t, v = records.ball_time[trial, used] - first, records.position[trial, used, axis]
            if t.size:
                state[trial, axis], state[trial, 3 + axis] = _start_polynomial(t, v)
    return state


def _start_polynomial(time: FloatArray, value: FloatArray) -> tuple[float, float]:
    if time.size < 2:
        return float(value[0]) if value.size else 0.0, 0.0
    degree = min(2, time.size - 1)
    scale = max(float(time.max()), 1e-9)
    fitted = np.polynomial.polynomial.polyfit(time / scale, value, degree)
    return float(fitted[0]), float(fitted[1] / scale)


def prepare(
    campaign: CampaignRecords, baseline: Baseline, widths: Mapping[str, float] | None = None
) -> Prepared:
    """Lay the data out, find clocks and noise, and refit the baseline.

    Parameters
    ----------
    widths : mapping, optional
        As in `instrument_faults`.

    Raises
    ------
    TooLittleDataError
        If there are too few rows for any fit.
    """
    model = known = baseline_model(baseline)
    forward, start, clocks = _begun(lay_out(campaign, baseline), baseline, model)
    swinging, columns = forward.mode == "swing", start[0].shape[1]
    pace = 1.0 if forward.mode == "impact" else FREE_STATE_PACE
    noise = estimate_noise(forward.records, *_segments(forward, clocks), slow_mode=pace)
    forward = replace(forward, records=_weighed(forward.records, noise))
    forward = replace(forward, thrown_share=_thrown_share(forward, model, start[0]))
    records = forward.records
    if records.count < records.trials * columns + 3:
        raise TooLittleDataError(
            f"{records.count} usable samples in {records.trials} trials are too few for any fit",
            hint=f"At least {columns + 4} samples in each trial are needed.",
        )
    model = _with_instruments(forward, model)
    if swinging:
        # A baseline out of phase says nothing of outliers or of the instrument; the local estimate
        # has found those, the fit beside any losses these.
        reading = reading_beside_any_losses(forward, model, start[0])
        instruments = (*baseline.instruments, *reading.faults)
        read = replace(baseline, instruments=instruments)
        forward, model = replace(forward, baseline=read, uneven=reading.uneven), reading.model
    fit = fit_model(forward, model, free_parameters(model, baseline.instruments), start)
    if swinging:
        return Prepared(forward, known, noise, left_open(fit, reading.faults))
    forward, noise = _weighed_again(forward, fit, clocks, noise)
    faults = instrument_faults(forward, widths or {})
    opened = tuple(_opened(entry, forward) for entry in model.entries)
    whole = replace(model, entries=(*opened, *((one, one.neutral) for one in faults)))
    drag = [effect for effect, _ in opened if all(effect is not e for e, _ in model.entries)]
    free = free_parameters(whole, [*drag, *faults, *baseline.instruments])
    fit = fit_model(forward, whole, free, (fit.nuisance, fit.law_offsets))
    return Prepared(forward, known, noise, fit)


def _begun(
    records: Records, baseline: Baseline, model: ForwardModel
) -> tuple[Forward, tuple[FloatArray, FloatArray], FloatArray | None]:
    """The predictor, where a first fit starts, and each strike's clock."""
    mode = choose_mode(records, baseline)
    ball_span, swing_span = _span(records.ball_time), _span(records.pendulum_time)
    swinging = mode == "swing"
    steps = PIECE_STEPS * _periods(records, float(swing_span.max())) if swinging else 64
    forward = Forward(
        baseline, records, mode, ball_span * 1.3, swing_span * 1.02, steps, _centre(records)
    )
    if mode == "impact":
        clocks = _find_clocks(forward, model)
        records, forward = _cut_contact(forward, clocks, model)
        nuisance = np.zeros((records.trials, 4))
        nuisance[:, 0] = clocks
        return forward, (nuisance, np.zeros((len(records.ball_names), 2))), clocks
    forward = replace(forward, flight_time=ball_span * 1.02)
    if swinging:
        forward = replace(forward, pace=_pace(forward))
        forward = replace(forward, records=_while_it_swings(forward))
    return forward, (_first_states(forward), np.zeros((0, 2))), None


def _weighed_again(
    forward: Forward, fit: Fit, clocks: FloatArray | None, noise: Noise
) -> tuple[Forward, Noise]:
    """The records without what a fit shows to be outliers, and the noise of those that stay."""
    records = forward.records
    stray = _strays(fit.residual * np.sqrt(np.repeat(noise.inflation, _lengths(records))), records)
    noise = replace(noise, outliers=noise.outliers | stray)
    forward = replace(forward, records=_weighed(records, noise))
    noise = _estimated_again(forward, fit, _segments(forward, clocks), noise)
    left = _left_over(forward.records, fit)
    velocity = _velocities(forward.records, left)
    noise = with_clock_jitter(noise, left, velocity)
    records = _weighed(forward.records, noise)
    if noise.jitter > 0.0:
        records = replace(records, jitter=noise.jitter * velocity / records.sigma[:, None, :3])
    return replace(forward, records=records), noise


def _with_instruments(forward: Forward, model: ForwardModel) -> ForwardModel:
    """The model with what the instrument leaves open in each trial, and in all of them."""
    faults = forward.baseline.instruments
    anew = [effect for effect in faults if Level.TRIAL in effect.levels]
    own = tuple(OwnStrength(e, p.name, Level.TRIAL, p.width) for e in anew for p in e.strengths)
    entries = (*model.entries, *((one, one.neutral) for one in faults))
    return replace(model, entries=entries, own=own)


def _estimated_again(
    forward: Forward, fit: Fit, segments: tuple[FloatArray, FloatArray], noise: Noise
) -> Noise:
    """Noise as estimated for the baseline's fit.

    The fit of strikes knows much, and less is left to pass for noise than about polynomials. That
    of free flights knows no more than the record: noise is estimated anew only where it has a
    memory that no motion leaves.
    """
    left = _left_over(forward.records, fit)
    if forward.mode == "impact":
        again = estimate_noise(left, *segments, still=True)
    else:
        again = estimate_noise(
            left, *segments, slow_mode=FREE_STATE_PACE, still=True, throughout=True
        )
        if not np.any(again.inflation > 1.0):
            return noise
    return replace(again, outliers=noise.outliers | again.outliers)


def _thrown_share(forward: Forward, model: ForwardModel, nuisance: FloatArray) -> int:
    """Into how many parts the steps of throws may be cut: what moves no record is not needed.

    Judged by the baseline, and by it with the most that air brakes a body, which bends a flight
    more than laws that are expected do.
    """
    if forward.mode != "flight":
        return 1
    drag = CATALOGUE[EffectId.DRAG][0]
    braked = model.having(drag, {p.name: p.upper for p in drag.parameters}).order()
    finest = replace(forward, steps=FINER * forward.steps)
    laws = [(law, finest.predict([law], nuisance[None])) for law in (model.order(), braked)]

    def off(share: int) -> float:
        coarse = replace(forward, thrown_share=share)
        moved = [np.abs(coarse.predict([law], nuisance[None]) - exact)[0] for law, exact in laws]
        return max(float(np.max(one * forward.records.weights, initial=0.0)) for one in moved)

    return max((share for share in THROWN_SHARES if off(share) < UNMOVED), default=1)


Entry = tuple[Effect, Mapping[str, float]]


def _opened(entry: Entry, forward: Forward) -> Entry:
    """An effect of the baseline; in free flights, open about a default that nobody measured.

    Such a drag may be of any size or none: smooth balls beyond the crisis have a sixth of the
    default, rough and blunt bodies twice as much.
    """
    effect, values = entry
    if forward.mode != "flight" or effect.id not in forward.baseline.unmeasured:
        return entry
    held = tuple(
        replace(p, neutral=values[p.name], expected=values[p.name], width=0.5 * p.scale)
        for p in effect.parameters
    )
    return replace(effect, parameters=held), values


def _weighed(records: Records, noise: Noise) -> Records:
    kept = records.keeping(~_whole_rows(records, noise.outliers))
    return replace(kept, sigma=noise.effective, inflation=noise.inflation)


def with_slow_noise(prepared: Prepared, fit: Fit) -> Prepared | None:
    """The campaign under as much slow noise as an answer leaves over; None where it leaves none.

    Records of throws too short to show the memory of their noise are first held to have none. What
    an answer takes as a law has then to be more than what it leaves.
    """
    forward, noise = prepared.forward, prepared.noise
    records = forward.records
    if forward.mode != "flight" or np.any(noise.inflation > 1.0):
        return None
    noise = replace(noise, inflation=slow_noise(fit.residual, records))
    if not np.any(noise.inflation > 1.0):
        return None
    wider = np.sqrt(noise.inflation)
    records = replace(records, sigma=records.sigma * wider, inflation=noise.inflation)
    if records.jitter.size:
        records = replace(records, jitter=records.jitter / wider[:3])
    forward, base = replace(forward, records=records), prepared.fit
    start = (base.nuisance, base.law_offsets)
    return replace(
        prepared, forward=forward, noise=noise, fit=fit_model(forward, base.model, base.free, start)
    )


def _whole_rows(records: Records, outliers: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Outliers (T, M) with all coordinates of a ball that was found in a wrong place."""
    s = records.ball_time.shape[1]
    ball = outliers[:, : 3 * s].reshape(records.trials, 3, s).any(axis=1)
    return np.concatenate([np.tile(ball, 3), outliers[:, 3 * s :]], axis=1)


def _left_over(records: Records, fit: Fit) -> Records:
    """The records with the fit taken off, m and rad."""
    s = records.ball_time.shape[1]
    left = records.unweighed(fit.residual)
    ball = np.moveaxis(left[:, : 3 * s].reshape(records.trials, 3, s), 1, -1)
    return replace(records, position=ball, pendulum_angle=left[:, 3 * s :])


def _velocities(records: Records, left: Records) -> FloatArray:
    """(T, S, 3) velocities of the ball as fitted, m/s; zero where it was not seen."""
    found = np.zeros(records.position.shape)
    fitted = records.position - left.position
    for trial, axis in np.ndindex(records.trials, 3):
        rows = np.flatnonzero(records.ball_used[trial, :, axis])
        if rows.size > 1:
            time = records.ball_time[trial, rows]
            found[trial, rows, axis] = np.gradient(fitted[trial, rows, axis], time)
    return found


def _lengths(records: Records) -> list[int]:
    return [records.ball_time.shape[1]] * 3 + [records.pendulum_time.shape[1]]


def _strays(residual: FloatArray, records: Records) -> NDArray[np.bool_]:
    """Rows far from their neighbours' residuals, (T, M): what is left of outliers after a fit."""
    stray = np.zeros(residual.shape, dtype=bool)
    used = records.used
    edges = np.cumsum([0, *_lengths(records)])
    for trial in range(records.trials):
        for low, high in itertools.pairwise(edges):
            rows = low + np.flatnonzero(used[trial, low:high])
            if rows.size >= NEIGHBOURS:
                off = np.abs(_off_their_line(residual[trial, rows]))
                # Where the misfit is so bent that no line fits, it is all off alike.
                scale = max(1.0, 1.4826 * float(np.median(off)))
                stray[trial, rows] = off > STRAY * scale
    return stray


def _off_their_line(values: FloatArray) -> FloatArray:
    """How far each value is from the median line through its neighbours and itself (Theil, Sen).

    At the ends the line leans on one side only: a steep misfit there makes no outlier, and an
    outlier is no neighbour of itself.
    """
    size = values.size
    first = np.clip(np.arange(size) - NEIGHBOURS // 2, 0, size - NEIGHBOURS)
    place = np.arange(NEIGHBOURS)
    near = values[first[:, None] + place]
    i, j = np.triu_indices(NEIGHBOURS, 1)
    slope = np.median((near[:, j] - near[:, i]) / (j - i), axis=1)
    level = np.median(near - slope[:, None] * place, axis=1)
    return np.asarray(values - level - slope * (np.arange(size) - first))
