"""Estimate reading errors of an encoder and the repeatability of a bearing.

Losses with the zeroth, first and second power of the rate together follow whatever brakes a
pendulum. Reading errors and differences between releases are estimated with these losses free,
before any law is chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from metrology import Defaults
from mismatch.candidates import candidates_for
from mismatch.fitting.fit import (
    Ending,
    Fit,
    SwingStart,
    fit_model,
    free_parameters,
    linearise_arcs,
)
from mismatch.fitting.hypotheses import POOR_FIT
from mismatch.fitting.scan import scatter_evidence, score_of_own
from mismatch.forward import NUISANCES, Forward, ForwardModel
from mismatch.records import SIGNIFICANT, Records
from physics.domain import FloatArray
from physics.effects import Effect, Level
from physics.effects.measurement import PivotElsewhere, ReadingLag
from physics.effects.swing import BearingFriction, PendulumDrag, ViscousDamping

__all__ = ["NOTEWORTHY", "Reading", "reading_beside_any_losses", "resolution"]

ANY_LOSSES = (BearingFriction(), ViscousDamping(), PendulumDrag())
"""Zeroth, first and second power of the rate."""

NOTEWORTHY = 2.0
"""Widths off from which a fault of the instrument is no longer what careful labs have."""

SHOWN = 3.0
"""Standard uncertainties, misfit counted, from which a fault of the instrument shows."""

UNLIKELY = 0.05
"""Chance of a scatter as large from few releases, below which it is held to be more than usual."""

ROUNDED = 0.1
"""Share of a step by which the digits of a file may move one reading from the next; assumed."""


@dataclass(frozen=True)
class Reading:
    """What free swings show of their instrument and their bearing.

    Attributes
    ----------
    faults : tuple of Effect
        What the instrument is left open to be off by, each held to none by its width.
    model : ForwardModel
        With those faults as they were found.
    uneven : float
        As in `Forward`.
    """

    faults: tuple[Effect, ...]
    model: ForwardModel
    uneven: float


def resolution(records: Records) -> float:
    """Step in which the angles of a campaign were read, rad; 0 where they show none."""
    apart = np.diff(np.unique(records.pendulum_angle[records.pendulum_used]))
    if not apart.size:
        return 0.0
    # Digits part what was one reading; a step is what is larger than that.
    step = float(np.median(apart))
    steps = apart / step
    whole = np.abs(steps - np.round(steps)) < ROUNDED
    return step if bool(np.all(whole)) else 0.0


def _held(effect: Effect, width: float) -> Effect:
    held = tuple(replace(p, width=width, expected=0.0) for p in effect.parameters)
    return replace(effect, parameters=held, levels=(Level.CAMPAIGN,))


def _faults(forward: Forward) -> tuple[Effect, ...]:
    """What may be wrong with angles that nothing else is known of; a step's half, where one shows.

    Records that state the uncertainty of their axis are believed.
    """
    known = {type(effect) for effect in forward.baseline.instruments}
    found: list[Effect] = []
    if PivotElsewhere not in known:
        found.append(_held(PivotElsewhere(), Defaults.READING_AXIS.std * forward.arm))
    half, records = 0.5 * resolution(forward.records), forward.records
    doubt = float(np.median(records.sigma[:, 3])) / np.sqrt(max(records.count, 1))
    if half > SHOWN * doubt and ReadingLag not in known:
        found.append(_held(ReadingLag(), half))
    return tuple(found)


def _with_any_losses(
    forward: Forward, model: ForwardModel, start: FloatArray
) -> tuple[Fit, list[Effect]]:
    pool = candidates_for(forward, model, ANY_LOSSES, unnamed=False)
    laws = [one.effect for one in pool if one.effect.level is Level.CAMPAIGN]
    held = {effect.id: values for effect, values in model.entries}
    for law in laws:
        model = model.having(law, law.neutral | dict(held.get(law.id, {})))
    free = free_parameters(model, laws)
    return fit_model(forward, model, free, (start, np.zeros((0, 0)))), laws


def _beside(forward: Forward, fit: Fit, laws: Sequence[Effect], faults: Sequence[Effect]) -> Fit:
    model = fit.model
    for fault in faults:
        model = model.having(fault, fault.neutral)
    free = free_parameters(model, [*laws, *faults])
    start = (fit.nuisance, fit.law_offsets)
    return fit_model(forward, model, free, start, swing=SwingStart(arcs=fit.arcs))


def _usual(fit: Fit, fault: Effect) -> bool:
    """Whether a fault shows, and is no larger than instruments have it."""
    found = [
        (abs(value), SHOWN * std * np.sqrt(fit.reduced_chi2), item.parameter.width)
        for index, item in enumerate(fit.free)
        for value, std in (fit.value(index),)
        if fit.model.entries[item.entry][0] is fault
    ]
    shown = any(size > doubt for size, doubt, _ in found)
    return shown and all(size - doubt < NOTEWORTHY * width for size, doubt, width in found)


def _uneven(forward: Forward, fit: Fit) -> float:
    """The most probable scatter of the releases' losses over what all lose; 0 if none is likelier.

    More than bearings have is another thing: a session's wear, or a law of its own.
    """
    if forward.records.trials < 2 or fit.arcs is None:
        return 0.0
    system = linearise_arcs(
        forward, fit.model, fit.arcs, fit.nuisance, fit.law_offsets, fit.free
    ).system
    mine = [NUISANCES["swing"].index("losses")]
    score, information = score_of_own(forward, fit.model, fit.nuisance, system, mine)
    # As if all had lost alike, and losses were known to a few per cent at best.
    score = score + (information @ fit.nuisance[:, mine, None])[..., 0]
    usual, left = Defaults.BEARING_REPEATS.std, fit.reduced_chi2
    spread, gain = scatter_evidence(score / left, information / left, np.array([usual]))
    # A scatter is known as well as its number of releases allows.
    degrees = forward.records.trials - 1
    size = float(spread[0])
    least = size * np.sqrt(degrees / chdtri(degrees, UNLIKELY))
    return size if gain > SIGNIFICANT and least < NOTEWORTHY * usual else 0.0


def reading_beside_any_losses(forward: Forward, model: ForwardModel, start: FloatArray) -> Reading:
    """What a campaign of free swings shows of its instrument and of its bearing.

    Parameters
    ----------
    model : ForwardModel
        The baseline.
    start : (T, q) array
        The trials' own values, to start from.
    """
    # Powers of the rate would make up for releases that lose unevenly: each has its own level.
    forward = replace(forward, uneven=Defaults.BEARING_REPEATS.std)
    fit, laws = _with_any_losses(forward, model, start)
    faults = _faults(forward)
    if fit.ending is Ending.LOST:
        return Reading((), model, 0.0)
    read = _beside(forward, fit, laws, faults)
    if read.ending is Ending.LOST or read.reduced_chi2 >= POOR_FIT:
        # Something else acts as well, and would be taken for either.
        return Reading((), model, 0.0)
    kept = tuple(fault for fault in faults if _usual(read, fault))
    if len(kept) < len(faults):
        read = _beside(forward, fit, laws, kept)
    if read.ending is not Ending.CONVERGED:
        return Reading((), model, 0.0)
    for effect, values in read.model.entries:
        if any(effect is fault for fault in kept):
            model = model.having(effect, values)
    return Reading(kept, model, _uneven(forward, read))
