"""Data that no physics explains: wrong units, swapped columns, another experiment."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from metrology import UsageError
from mismatch.fitting.local_states import SwingSeen, seen_in_halves, seen_swings
from mismatch.fitting.normal_equations import spread_laws
from mismatch.fitting.prepare import Prepared, prepare
from mismatch.model.forward import OUTSIDE, Forward
from mismatch.records.campaign import Campaign
from physics.arrays import FloatArray

__all__ = ["fall_in_g", "refuse_nonsense"]

FAR_OFF = 30.0
"""Factor between recorded and expected size beyond which only a unit can be wrong."""

RUNAWAY = 1e4
"""As `FAR_OFF`, but beyond any unit: the refitted baseline has run off."""

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
SWAP_GAIN = 0.1
ANOTHER_EXPERIMENT = 0.35


def refuse_nonsense(campaign: Campaign, prepared: Prepared) -> None:
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
        [fit.model], spread_laws(forward, fit.nuisance, fit.law_offsets)[None]
    )[0]
    s = records.ball_time.shape[1]
    both = records.ball_used[..., 0] & records.ball_used[..., 1]
    if not both.any():
        return
    x, y = records.position[..., 0][both], records.position[..., 1][both]
    px, py = predicted[:, :s][both], predicted[:, s : 2 * s][both]
    runaway = _spread(px, py) > RUNAWAY * max(_spread(x, y), 1e-3)
    if runaway and float(np.abs(predicted).max()) >= OUTSIDE:
        raise UsageError(
            "the setup contradicts the data: no motion of this apparatus comes near them",
            hint="Check back-swing angles, ball names, pendulum and support in the setup.",
        )
    ratio = _spread(x, y) / max(_spread(px, py), 1e-9)
    if ratio > FAR_OFF or ratio < 1.0 / FAR_OFF:
        raise UsageError(
            f"the recorded positions spread {ratio:.3g} times as far as the setup expects",
            hint="Positions are in metres and times in seconds; were they written in millimetres,"
            " pixels or milliseconds?",
        )
    straight = _misfit(x - px, y - py)
    size = _spread(px, py)
    if straight > SUSPICIOUS * size and _fits_swapped(campaign, prepared):
        raise UsageError(
            "the columns x_m and y_m look swapped: the other way round they fit the setup",
            hint="x_m runs along the wall, y_m up from the floor.",
        )
    if straight > ANOTHER_EXPERIMENT * size:
        raise UsageError(
            f"the setup contradicts the data: positions miss by {straight:.2g} m at a spread"
            f" of {size:.2g} m",
            hint="Check back-swing angles, ball names, pendulum and support in the setup.",
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
    _refuse_degrees(forward)
    period = 2.0 * np.pi / float(np.median([one.rate for one in seen]))
    expected = 2.0 * np.pi / forward.small_rate
    if forward.baseline.pendulum is not None and not 1 / PACE < period / expected < PACE:
        raise UsageError(
            f"the pendulum's small swings take {period:.3g} s, the setup's would take"
            f" {expected:.3g} s",
            hint="Check length, mass, com and inertia of [pendulum], and that t_s is in seconds;"
            " without [pendulum] the period is taken from the record.",
        )
    if forward.baseline.pendulum is not None:
        _refuse_mixed(seen)


def _refuse_mixed(seen: Sequence[SwingSeen]) -> None:
    """One setup describes one pendulum: its records keep one pace."""
    rates = np.array([one.rate for one in seen])
    slow, fast = 2.0 * np.pi / rates.min(), 2.0 * np.pi / rates.max()
    if slow > MIXED * fast:
        raise UsageError(
            f"small swings take {fast:.3g} s in one trial and {slow:.3g} s in another: these are"
            " several pendulums, or several clocks",
            hint="Explain the trials of each pendulum by themselves, with its own [pendulum].",
        )


def _refuse_degrees(forward: Forward) -> None:
    """Wide swings take longer than small ones; if they keep time, they are smaller than written."""
    pieces = [s for s in seen_in_halves(forward.records) if s.half_swings > 2]
    if len(pieces) < 3:
        return
    paces, rates = (np.log([getattr(p, name) for p in pieces]) for name in ("pace", "rate"))
    if float(rates.std()) > KEPT and float(paces.std()) < KEEPS_TIME * float(rates.std()):
        widest = max(p.amplitude for p in pieces)
        raise UsageError(
            f"swings of up to {widest:.3g} rad take no longer than small ones, as no pendulum's do",
            hint="phi_rad is in radians; are these degrees?",
        )


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


def _fits_swapped(campaign: Campaign, prepared: Prepared) -> bool:
    """Whether the campaign fits far better with x and y exchanged."""
    trials = tuple(replace(t, position=t.position[:, [1, 0, 2]]) for t in campaign.trials)
    other = prepare(Campaign(trials), prepared.forward.baseline)
    return other.fit.chi2 / other.fit.count < SWAP_GAIN * prepared.fit.chi2 / prepared.fit.count


def _spread(x: FloatArray, y: FloatArray) -> float:
    return float(np.hypot(np.ptp(x), np.ptp(y)))


def _misfit(dx: FloatArray, dy: FloatArray) -> float:
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
            f"the columns x_m and y_m look swapped: the balls fall along x, with {sideways:.2g} g",
            hint="x_m runs along the wall, y_m up from the floor.",
        )


def _refuse_upside_down(campaign: Campaign, gravity: float) -> None:
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
