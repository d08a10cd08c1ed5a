"""Detect wrong units, swapped columns and recordings of another experiment."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from metrology import UsageError
from mismatch.candidates import UNCATALOGUED
from mismatch.fitting.fit import (
    Fit,
    SwingSeen,
    inverse_of,
    linearise,
    seen_in_halves,
    seen_swings,
    spread_laws,
)
from mismatch.fitting.hypotheses import POOR_FIT
from mismatch.fitting.prepare import Prepared, baseline_model, prepare
from mismatch.fitting.stated import StatedInputs
from mismatch.forward import NUISANCES, Forward
from mismatch.records import CampaignRecords, Trial
from physics.domain import FloatArray, Number
from physics.effects import CATALOGUE, Effect, Level, Parameter, Values
from physics.effects.measurement import DroppedFrames, TimeBase

__all__ = [
    "DriftingClock",
    "DroppedInEach",
    "drifting_clock",
    "dropped_in_each",
    "fall_in_g",
    "in_other_unit",
    "keeps_time",
    "refuse_beyond_bounds",
    "refuse_nonsense",
    "without_odd_trials",
]

FAR_OFF = 30.0

"""Factor between recorded and expected size beyond which only a unit can be wrong."""

ASIDE = 0.3

"""Share of g by which a fall may miss, or a motion across it be bent, and still be one."""

PACE = 2.0

"""Ratio of periods beyond which a setup describes another pendulum."""

MIXED = 1.15

"""Ratio of periods within one campaign beyond which its trials are of several pendulums: the zero
of a protractor and a grip that slips change a period by a few per cent."""

KEPT = 0.004

"""Scatter of small-swing rates, relative, that one pendulum can't have."""

KEEPS_TIME = 0.25

"""Share of that scatter from which it comes of the correction for amplitude alone."""

WIDER = 1.5

"""Recorded angle over the back-swing from which they are in different units."""

SUSPICIOUS = 0.05
"""Of the size of the motion: a misfit from which swapped columns are tried."""

SWAP_GAIN = 0.1
"""Ratio of chi²: swapped columns must fit ten times as well to be named."""

ANOTHER_EXPERIMENT = 0.35
"""Of the size of the motion: a third is more than any missing effect of the catalogue moves,
assumed."""


def refuse_nonsense(campaign: CampaignRecords, prepared: Prepared) -> None:
    """Refuse data whose units or columns can't be what they are said to be.

    Raises
    ------
    UsageError
        With what is wrong and what would help.
    """
    forward, fit = prepared.forward, prepared.fit
    if forward.mode == "swing":
        _refuse_swing(forward)
    if forward.mode == "impact":
        _refuse_wider_than_released(forward)
    if forward.mode == "swing" or not forward.records.ball_used.any():
        return
    _refuse_upside_down(campaign, forward.baseline.gravity)
    if forward.mode == "flight":
        _refuse_fall(forward)
        return
    records = forward.records
    predicted = forward.predict(
        [fit.model], spread_laws(forward, fit.model, fit.nuisance, fit.law_offsets)[None]
    )[0]
    s = records.ball_time.shape[1]
    both = records.ball_used[..., 0] & records.ball_used[..., 1]
    if not both.any():
        return
    x, y = records.position[..., 0][both], records.position[..., 1][both]
    px, py = predicted[:, :s][both], predicted[:, s : 2 * s][both]
    names = [trial.name for trial in campaign.trials]
    paths = (predicted[:, : 2 * s], _as_stated(forward, both)[:, : 2 * s])
    _refuse_far_off(names, records.position[..., :2], paths, both)
    straight = _distance(x - px, y - py)
    size = _spread(px, py)
    if straight > SUSPICIOUS * size and _fits_swapped(campaign, prepared):
        raise UsageError(
            "the columns x_m and y_m seem swapped: in the other order they fit the setup",
            hint="x_m runs along the wall, y_m up from the floor.",
        )
    if straight > ANOTHER_EXPERIMENT * size:
        raise UsageError(
            f"the setup contradicts the data: positions miss by {straight:.2g} m at a spread"
            f" of {size:.2g} m",
            hint="Check back-swing angles, ball names, pendulum and support in the setup.",
        )


def refuse_beyond_bounds(fit: Fit) -> None:
    """Refuse stated inputs that the baseline needs further off than any input may be.

    Raises
    ------
    UsageError
        With what would have to be off, and by how much.
    """
    for index, item in enumerate(fit.free):
        p, (value, _) = item.parameter, fit.value(index)
        stated = isinstance(fit.model.entries[item.entry][0], StatedInputs)
        if stated and not p.lower <= value <= p.upper:
            raise UsageError(
                f"the setup contradicts the data: {p.name.replace('_', ' ')} would be off by"
                f" {100.0 * value:.0f} %, stated ± {100.0 * p.width:.2g} %",
                hint="Check masses, lengths and inertia in the setup, and the units of the data.",
            )


def _refuse_swing(forward: Forward) -> None:
    """A free swing turns back before it is upright, at about the pace that the setup gives it."""
    seen = [s for s in seen_swings(forward.records) if s.half_swings > 1 and np.isfinite(s.rate)]
    if not seen:
        return
    widest = max(one.amplitude for one in seen)
    if widest > np.pi:
        raise UsageError(
            f"the pendulum swings {widest:.3g} rad to each side and comes back",
            hint="phi_rad is in radians; are these degrees?",
        )
    period = 2.0 * np.pi / float(np.median([one.rate for one in seen]))
    expected = 2.0 * np.pi / forward.setup_rate
    if forward.baseline.pendulum is not None and not 1 / PACE < period / expected < PACE:
        raise UsageError(
            f"the pendulum's small swings take {period:.3g} s, the setup's would take"
            f" {expected:.3g} s",
            hint="Check length, mass, com and inertia of [pendulum], and that t_s is in seconds;"
            " without [pendulum] the period is taken from the record.",
        )
    if forward.baseline.pendulum is not None:
        _refuse_mixed(seen, "pace" if keeps_time(forward) else "rate")


def _refuse_mixed(seen: Sequence[SwingSeen], by: Literal["pace", "rate"]) -> None:
    """One setup describes one pendulum: its records keep one pace."""
    rates = np.array([one.pace if by == "pace" else one.rate for one in seen])
    slow, fast = 2.0 * np.pi / rates.min(), 2.0 * np.pi / rates.max()
    if slow > MIXED * fast:
        raise UsageError(
            f"small swings take {fast:.3g} s in one trial and {slow:.3g} s in another: these are"
            " several pendulums, or several clocks",
            hint="Explain the trials of each pendulum by themselves, with its own [pendulum].",
        )


def keeps_time(forward: Forward) -> bool:
    """Whether wide free swings take no longer than small ones, as no pendulum's do.

    A spring's, a torsion wire's and a cycloid's do; so do small swings in degrees for radians.
    """
    pieces = [s for s in seen_in_halves(forward.records) if s.half_swings > 2]
    if forward.mode != "swing" or len(pieces) < 3:
        return False
    paces, rates = (np.log([getattr(p, name) for p in pieces]) for name in ("pace", "rate"))
    return float(rates.std()) > KEPT and float(paces.std()) < KEEPS_TIME * float(rates.std())


def _refuse_wider_than_released(forward: Forward) -> None:
    """A pendulum does not swing wider than it was drawn back."""
    records = forward.records
    widest = np.abs(np.where(records.pendulum_used, records.pendulum_angle, 0.0)).max(axis=1)
    known = np.isfinite(records.backswing) & records.pendulum_used.any(axis=1)
    shares = widest[known] / np.maximum(np.abs(records.backswing[known]), 1e-3)
    if shares.size and float(np.median(shares)) > WIDER:
        raise UsageError(
            f"the pendulum is seen at {np.median(widest[known]):.3g} rad, and was drawn back to"
            f" {np.median(np.abs(records.backswing[known])):.3g} rad only",
            hint="phi_rad is in radians and backswing_deg in degrees; is one of them the other?",
        )


def _fits_swapped(campaign: CampaignRecords, prepared: Prepared) -> bool:
    """Whether the campaign fits far better with x and y exchanged."""
    trials = tuple(replace(t, position=t.position[:, [1, 0, 2]]) for t in campaign.trials)
    other = prepare(CampaignRecords(trials), prepared.forward.baseline)
    return other.fit.chi2 / other.fit.count < SWAP_GAIN * prepared.fit.chi2 / prepared.fit.count


OTHER_UNITS = (1000.0, 100.0, 0.01, 0.001)
"""Millimetres or centimetres among metres, or the reverse."""


def _is_of_units(factor: float) -> bool:
    return any(0.5 < factor / unit < 2.0 for unit in OTHER_UNITS)


def in_other_unit(sizes: FloatArray) -> NDArray[np.bool_]:
    """Which sizes are a unit's factor above the others, in a group apart from theirs.

    Two groups are apart if what lies between them is a larger factor than either spans.

    Parameters
    ----------
    sizes : (n,) array
        Positive; NaN where missing.
    """
    order = np.sort(sizes[np.isfinite(sizes)])
    if order.size < 2:
        return np.zeros(sizes.shape, dtype=bool)
    cut = 1 + int(np.argmax(order[1:] / order[:-1]))
    low, high = order[:cut], order[cut:]
    apart = high[0] / low[-1] > max(low[-1] / low[0], high[-1] / high[0])
    found = apart and _is_of_units(float(np.median(high) / np.median(low)))
    return np.asarray(found & (sizes >= high[0]))


def _as_stated(forward: Forward, used: NDArray[np.bool_]) -> FloatArray:
    """Strikes by the setup alone at the beginning of each record: no ball flies farther in it."""
    nuisance = np.zeros((1, len(used), len(NUISANCES["impact"])))
    begin = np.min(forward.records.ball_time, axis=1, where=used, initial=np.inf)
    nuisance[..., 0] = np.where(used.any(axis=1), begin, 0.0)
    return np.asarray(forward.predict([baseline_model(forward.baseline)], nuisance)[0])


def _refuse_far_off(
    names: Sequence[str],
    position: FloatArray,
    paths: tuple[FloatArray, FloatArray],
    used: NDArray[np.bool_],
) -> None:
    """Refuse paths (trials, samples, 2) of another size than expected, twice (trials, 2 samples).

    Expected are those of the refitted baseline and, at most, those of the setup alone: a refitted
    baseline may follow a trial in another unit. A unit is wrong in all trials alike. Where only
    some are far off, a refitted baseline ran away from a setup that those trials contradict.
    """
    s = used.shape[1]
    seen = np.flatnonzero(used.any(axis=1))
    recorded = np.array([_spread(*position[i, used[i]].T) for i in seen])
    expected, farthest = (
        np.array([_spread(*path[i].reshape(2, s)[:, used[i]]) for i in seen]) for path in paths
    )
    # A trial that shows hardly any motion leaves its size open.
    ratios = np.maximum(recorded, np.median(recorded) / FAR_OFF) / np.maximum(
        expected, max(float(np.median(expected)) / FAR_OFF, 1e-9)
    )
    far = (ratios > FAR_OFF) | (ratios < 1.0 / FAR_OFF)
    farther = recorded / np.maximum(farthest, max(float(np.median(farthest)) / FAR_OFF, 1e-9))
    far |= farther > FAR_OFF
    if far.all():
        raise UsageError(
            f"the recorded positions spread {np.median(ratios):.3g} times as far as the setup"
            " expects",
            hint="Positions are in metres and times in seconds; were they written in millimetres,"
            " pixels or milliseconds?",
        )
    if far.any():
        other = far & np.array([_is_of_units(factor) for factor in farther])
        which = ", ".join(names[i] for i in seen[other if other.any() else far])
        if other.any():
            raise UsageError(
                f"positions of trial {which} spread {np.median(farther[other]):.3g} times as far"
                " as the setup allows, so units seem to differ by row",
                hint="Write all rows in metres, the unit of the head.",
            )
        raise UsageError(
            f"the setup contradicts the data: no motion of this apparatus comes near trial {which}",
            hint="Check back-swing angles, ball names, pendulum and support in the setup.",
        )


def _spread(x: FloatArray, y: FloatArray) -> float:
    return float(np.hypot(np.ptp(x), np.ptp(y)))


def _distance(dx: FloatArray, dy: FloatArray) -> float:
    return float(np.median(np.hypot(dx, dy)))


def _refuse_fall(forward: Forward) -> None:
    """Free flights fall with about g, whatever else acts; not sideways, nor a thousand times that.

    A motion that is none of a free body at all is left to the fit.
    """
    down, sideways = fall_in_g(forward, 1), fall_in_g(forward, 0)
    if abs(down) > FAR_OFF:
        raise UsageError(
            f"the balls fall with {down:.3g} g",
            hint="Positions are in metres and times in seconds; is one of them in thousandths?",
        )
    if abs(down) < ASIDE and abs(sideways - 1.0) < ASIDE:
        raise UsageError(
            f"the columns x_m and y_m seem swapped: the balls fall along x, with {sideways:.2g} g",
            hint="x_m runs along the wall, y_m up from the floor.",
        )


def _refuse_upside_down(campaign: CampaignRecords, gravity: float) -> None:
    found = []
    for trial in campaign.trials:
        rows = np.flatnonzero(np.isfinite(trial.position[:, 1]))
        # A struck ball rests first.
        rows = rows[rows.size // 3 :]
        if rows.size >= 6:
            time = trial.ball_time[rows]
            bend = np.polyfit(time - time.mean(), trial.position[rows, 1], 2)[0]
            found.append(2.0 * float(bend) / gravity)
    if found and float(np.median(np.abs(np.array(found) - 1.0))) < ASIDE:
        raise UsageError(
            f"the balls fall upward, with {np.median(found):.2g} g: y_m runs downward",
            hint="y_m is up from the floor; pictures count their rows downward.",
        )


def fall_in_g(forward: Forward, axis: int) -> float:
    """Median acceleration of the trials against an axis, in g; 0 where it was not recorded."""
    records = forward.records
    found = []
    for trial in range(records.trials):
        used = records.ball_used[trial, :, axis]
        time, place = records.ball_time[trial, used], records.position[trial, used, axis]
        if time.size >= 6:
            found.append(-2.0 * float(np.polyfit(time - time.mean(), place, 2)[0]))
    return float(np.median(found)) / forward.baseline.gravity if found else 0.0


HOLE = 6.0

"""Median steps from which a pause of the clock may be a jump."""

NEIGHBOURS = 8

"""Rows on each side from which the speed of the ball there is estimated."""

JUMPED = 0.5

"""Fraction of a pause that the ball's path must leave over before the clock has jumped."""

ROUGH = 1.2

"""Rank von Neumann ratio from which samples do not follow one another: of noise it is 2 ± 2/√n, of
a motion that is sampled ten times in its course a few hundredths."""

ENOUGH = 8

"""Samples from which it can be determined whether they follow one another."""

LONGEST, SHORTEST = 1e5, 1e-5

"""s that a record may last: a day, and the contact of the hardest bodies."""

FARTHEST = 1e6

"""m or rad: beyond the sky, and a wheel no pendulum."""

MIN_PATH = 1e-9

"""m or rad: no instrument sees less."""

CLOCK = 1e-2

"""Share of a step that the rounding of a clock may be."""

SEEN = 0.05

"""m that the ball must move in a pause for its path to determine anything."""


def without_odd_trials(campaign: CampaignRecords) -> CampaignRecords:
    """The campaign without trials that say nothing of their own, or nothing at all.

    Those are copies of others, trials whose clock jumps ahead or can't be one, in which nothing
    moves, and whose samples do not follow one another: noise alone, or rows in no order.

    Raises
    ------
    UsageError
        If no trial is left.
    """
    kept: list[Trial] = []
    odd: dict[_Odd, list[str]] = {}
    for trial in campaign.trials:
        why = _oddity(trial, kept)
        if why is None:
            kept.append(trial)
        else:
            odd.setdefault(why, []).append(trial.name)
    if not kept:
        worst = max((why for why in odd if why is not _Odd.COPY), key=lambda why: len(odd[why]))
        raise UsageError(
            worst.value.format(f"every trial ({', '.join(odd[worst][:4])})"), hint=_HINTS[worst]
        )
    notes = [*campaign.notes]
    for why, names in odd.items():
        listed = f"{', '.join(names[:6])}{', …' if len(names) > 6 else ''}"
        notes.append(f"{why.value.format(f'trial {listed}')}; left out")
    return replace(campaign, trials=tuple(kept), notes=tuple(notes)) if odd else campaign


class _Odd(Enum):
    """What is odd about trials, as a note says it of them."""

    COPY = "what {} recorded repeats other trials number by number, which is no further evidence"
    JUMP = "the clock jumps ahead in {}, while the ball does not"
    CLOCK = "the times in {} are none of a motion that anyone could film"
    FAR = "positions or angles in {} are beyond all bounds"
    STILL = "nothing moves in {}"
    ROUGH = "the samples of {} do not follow one another"


_HINTS = {
    _Odd.JUMP: "While t_s goes on, the ball does not; are the times those of the frames?",
    _Odd.CLOCK: "t_s is in seconds, and needs enough decimals that no two samples share a time.",
    _Odd.FAR: "Positions are in metres and angles in radians.",
    _Odd.STILL: "Each trial needs a moving ball or a swinging pendulum.",
    _Odd.ROUGH: "Are the rows in order and of one unit, and is it one trial under each name? Or is"
    " it noise alone?",
}


def _oddity(trial: Trial, others: list[Trial]) -> _Odd | None:
    if not _believable_clock(trial.ball_time) or not _believable_clock(trial.pendulum_time):
        return _Odd.CLOCK
    series = _series(trial)
    if any(float(np.abs(values).max()) > FARTHEST for values in series):
        return _Odd.FAR
    if series and all(float(np.ptp(values)) < MIN_PATH for values in series):
        return _Odd.STILL
    rough = [_roughness(values) for values in series if values.size >= ENOUGH]
    if rough and min(rough) > ROUGH:
        return _Odd.ROUGH
    if _clock_jumps(trial.ball_time, trial.position):
        return _Odd.JUMP
    return _Odd.COPY if any(_same(trial, other) for other in others) else None


def _series(trial: Trial) -> list[FloatArray]:
    """What was recorded, channel by channel."""
    channels = [*trial.position.T, trial.pendulum_angle]
    finite = [np.asarray(values[np.isfinite(values)]) for values in channels]
    return [values for values in finite if values.size]


def _roughness(values: FloatArray) -> float:
    """Rank von Neumann ratio (Bartels, J. Am. Stat. Assoc. 77, 40 (1982)): 2 for noise."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    # equal ones share the mean of their ranks
    ranks = (np.cumsum(count) - 0.5 * (count - 1))[place]
    spread = float(np.square(ranks - ranks.mean()).sum())
    return float(np.square(np.diff(ranks)).sum()) / spread if spread > 0.0 else 2.0


def _believable_clock(time: FloatArray) -> bool:
    if time.size < 2:
        return True
    span = float(time[-1] - time[0])
    if not SHORTEST < span < LONGEST:
        return False
    rounding = float(np.spacing(np.abs(time).max()))
    return rounding < CLOCK * float(np.median(np.diff(time)))


def _same(one: Trial, other: Trial) -> bool:
    return np.array_equal(one.position, other.position, equal_nan=True) and np.array_equal(
        one.pendulum_angle, other.pendulum_angle, equal_nan=True
    )


def _clock_jumps(time: FloatArray, position: FloatArray) -> bool:
    """Whether the ball gets on far less in a pause of the clock than its speed on both sides says.

    Under a constant force the displacement is the mean of both velocities times the time.
    """
    found = np.asarray(np.isfinite(position).any(axis=0))
    rows = np.isfinite(position[:, found]).all(axis=1)
    if not found.any():
        return False
    time, place = time[rows], position[rows][:, found]
    if time.size < 2 * NEIGHBOURS:
        return False
    steps = np.diff(time)
    for at in np.flatnonzero(steps > HOLE * np.median(steps)) + 1:
        if at < NEIGHBOURS or time.size - at < NEIGHBOURS:
            continue
        before, after = slice(at - NEIGHBOURS, at), slice(at, at + NEIGHBOURS)
        first, v1 = _line(time[before], place[before], time[at - 1])
        last, v2 = _line(time[after], place[after], time[at])
        if np.linalg.norm(v1) < 0.2 * np.linalg.norm(v2):
            continue  # struck in between
        pause = float(steps[at - 1])
        moved = 0.5 * (v1 + v2) * pause
        length = float(np.linalg.norm(moved))
        if length > SEEN and float((last - first) @ moved) < (1.0 - JUMPED) * length**2:
            return True
    return False


def _line(time: FloatArray, place: FloatArray, at: float) -> tuple[FloatArray, FloatArray]:
    """Place at a time and velocity, by a straight line through a few rows."""
    slope, level = np.polyfit(time - at, place, 1)
    return level, slope


INSTANTS = 160
"""Instants at which two clocks are compared: as many as a record has cosines that matter."""

MIN_STEP = 1e-5

"""s of gap for the derivative."""


@dataclass(frozen=True)
class DroppedInEach(DroppedFrames):
    """The same number of frames lost in every trial, each time at another instant.

    Attributes
    ----------
    instants : tuple of float
        s after contact onset, by trial.
    search_cost : float
        What finding them costs (chi-square units).
    """

    form: str = "at an instant of its own in each trial"
    instants: tuple[float, ...] = ()
    search_cost: float = 0.0

    def of_trials(self, rows: NDArray[np.int64]) -> Effect:
        """The jumps of some trials alone, in order."""
        return replace(self, instants=tuple(self.instants[int(row)] for row in rows))

    def clock(self, values: Values, time: Number) -> Number:
        """Jump once in each trial."""
        after = np.asarray(time, dtype=np.float64) - np.array(self.instants)[:, None]
        return np.asarray(time + values["gap"] * np.heaviside(after, 0.0))


@dataclass(frozen=True)
class DriftingClock(TimeBase):
    """A capture rate that drifts over the trials of a campaign.

    Attributes
    ----------
    orders : tuple of float
        Place of each trial in the campaign, from -1/2 for the first to 1/2 for the last.
    """

    statement: str = "The camera's frame rate drifts over the trials."
    parameters: tuple[Parameter, ...] = (
        *TimeBase().parameters,
        replace(
            TimeBase().parameters[0], name="drift", lower=-0.5, upper=0.5, outliers=(),
            meaning="change of the rate from the first trial to the last",
        ),
    )  # fmt: skip
    form: str = "drifts over the trials"
    levels: tuple[Level, ...] = (Level.CAMPAIGN,)
    orders: tuple[float, ...] = ()

    def of_trials(self, rows: NDArray[np.int64]) -> Effect:
        """The clock in some trials alone, in order."""
        return replace(self, orders=tuple(self.orders[int(row)] for row in rows))

    def clock(self, values: Values, time: Number) -> Number:
        """As a constant error, which changes from trial to trial."""
        rate = values["rate_error"] + values["drift"] * np.array(self.orders)[:, None]
        return time / (1.0 + rate)


def drifting_clock(forward: Forward) -> tuple[Effect, ...]:
    """The law for the trials of a campaign; none where too few of them show a drift."""
    if forward.records.trials < MIN_DRIFTING:
        return ()
    return (DriftingClock(orders=tuple(float(one) for one in forward.records.order)),)


MIN_GAP = 0.5
"""Frame intervals below which a gap is no lost frame (derived: frames are lost whole)."""

MIN_DRIFTING = 4
"""Trials from which a drift is more than two values: a line through three leaves one to spare."""


def _since(forward: Forward, fit: Fit) -> FloatArray:
    """(T, 3S + P) time of every entry after contact onset (or the first sample)."""
    records = forward.records
    if forward.mode == "impact":
        clock = fit.nuisance[:, :1]
        ball, swing = records.ball_time - clock, records.pendulum_time - clock
    else:
        ball = records.ball_time - records.ball_time[:, :1]
        swing = records.pendulum_time - records.pendulum_time[:, :1]
    return np.concatenate([np.tile(ball, 3), swing], axis=1)


def dropped_in_each(forward: Forward, fit: Fit) -> DroppedInEach | None:
    """The law with each trial's most probable instant for one common gap.

    None for swings alone, and where such gaps leave more than noise.
    """
    if forward.mode == "swing" or forward.records.trials < 2:
        return None
    common = CATALOGUE["dropped_frames"][0]
    lost = fit.model.having(common, {"gap": MIN_STEP, "instant": -1e3})
    whole = fit.model.having(common, {"gap": 0.0, "instant": -1e3})
    system = linearise(
        forward, whole.order(), fit.nuisance, fit.law_offsets, (), [lost.order()], [MIN_STEP]
    )
    slope = system.shared[..., -1]
    since = _since(forward, fit)
    used = forward.records.used
    scores, sizes, grids = [], [], []
    for trial in range(forward.records.trials):
        times = since[trial][used[trial]]
        low, high = (times.min(), times.max()) if times.size else (0.0, 1.0)
        grid = np.linspace(low, high, INSTANTS + 2)[1:-1]
        column = slope[trial][:, None] * (since[trial][:, None] > grid)
        own = system.own[trial]
        inner = own.T @ own + np.diag(system.prior)
        inner = inner + 1e-12 * np.diag(np.diag(inner))
        # A coordinate that no row of this trial shows makes the system singular.
        left = column - own @ (inverse_of(inner) @ (own.T @ column))
        scores.append(left.T @ system.residual[trial])
        sizes.append(np.einsum("mg,mg->g", left, column))
        grids.append(grid)
    score, size, grid = np.array(scores), np.array(sizes), np.array(grids)
    frame = float(np.median(np.diff(forward.records.ball_time, axis=1)))
    # Frames get lost; a record that gains some would be reported otherwise.
    gaps = np.geomspace(0.05, 40.0, 40) * frame
    # What is left over for other reasons makes steps, too: differences count in units of it.
    gains = 2.0 * gaps[:, None, None] * score - np.square(gaps)[:, None, None] * size
    gains = gains / fit.reduced_chi2
    # Averaged over the instants, as likely all of them, a trial's evidence pays for its own search.
    largest = gains.max(axis=2)
    mean = np.exp(0.5 * (gains - largest[..., None])).mean(axis=2)
    evidence = (largest + 2.0 * np.log(mean)).sum(axis=1)
    best = int(np.argmax(evidence))
    which = np.argmax(gains[best], axis=1)[:, None]
    instants = np.take_along_axis(grid, which, axis=1)[:, 0]
    # At the chosen instants a fit finds a larger gap, and gains more than it may keep.
    fitted = np.square(np.take_along_axis(score, which, axis=1).sum())
    fitted /= max(float(np.take_along_axis(size, which, axis=1).sum()), 1e-30)
    if fit.chi2 - fitted > POOR_FIT * fit.expected:
        # A step at will in each trial takes a part of any misfit; it is believed if it takes all.
        return None
    gap = replace(common.parameters[0], lower=0.0)
    rarity = UNCATALOGUED if gaps[best] < MIN_GAP * frame else 0.0
    return DroppedInEach(
        parameters=(gap,),
        instants=tuple(float(t) for t in instants),
        search_cost=float(max(fitted - fit.reduced_chi2 * evidence[best], 0.0)) + rarity,
    )
