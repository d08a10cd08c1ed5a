"""Estimate what repeats of a setting share beyond what the model gives it.

A protractor mark that is off, or a contact that is not quite as the law has it at one speed, moves
all repeats of a setting alike. Counted as independent they would speak for a law as often as they
were repeated. The size of each such error is the one of highest evidence (empirical Bayes).
"""

from dataclasses import dataclass, replace

import numpy as np

from mismatch.fitting.fit import AT_SETTING, Fit, fit_model, linearise, priors
from mismatch.fitting.prepare import Prepared
from mismatch.fitting.scan import grouped, marginal_by_trial, scatter_evidence
from mismatch.forward import Forward
from physics.effects import Level

__all__ = ["SharedByRepeats", "shared_by_repeats", "sizes_in_words", "with_shared_by_repeats"]

MIN_SETTINGS = 3
"""Settings with repeats from which their scatter says something."""

MIN_SHARE = 0.1
"""Share of what usually differs from trial to trial from which a size is reported."""

MAX_SETTINGS = 40
"""Settings up to which each has offsets of its own: with more, hardly any is repeated."""


@dataclass(frozen=True)
class SharedByRepeats:
    """What repeats share of back-swing (rad), COR and launch angle (rad).

    Attributes
    ----------
    spread : tuple of float
        One sigma over the settings.
    gain : float
        Twice the logarithm of the evidence over none; zero where there is none.
    """

    spread: tuple[float, ...]
    gain: float


NONE = SharedByRepeats((), 0.0)


def shared_by_repeats(forward: Forward, fit: Fit) -> SharedByRepeats:
    """Scatter of settings around a fit of strikes."""
    index, names = forward.records.groups(Level.SETTING)
    repeated = np.count_nonzero(np.bincount(index, minlength=1) > 1)
    if forward.mode != "impact" or repeated < MIN_SETTINGS or len(names) > MAX_SETTINGS:
        return NONE
    system = linearise(forward, fit.model, fit.nuisance, fit.law_offsets, ())
    prior, _ = priors(forward, fit.model)
    pull = np.where(prior < 1e15, -fit.nuisance * prior, 0.0)
    score, information = marginal_by_trial(
        system.own, prior, system.residual, system.own[..., list(AT_SETTING)], pull
    )
    score, information = grouped(forward, Level.SETTING, score, information)
    scatter, left = forward.baseline.scatter, fit.reduced_chi2
    usual = np.array([scatter.backswing, scatter.cor, scatter.launch_angle])
    spread, gain = scatter_evidence(score / left, information / left, usual)
    return SharedByRepeats(tuple(float(one) for one in spread), gain)


def with_shared_by_repeats(prepared: Prepared, shared: SharedByRepeats) -> Prepared:
    """The baseline refitted with an offset of each setting, as large as was found."""
    base = prepared.fit
    forward = replace(prepared.forward, at_setting=shared.spread)
    start = (base.nuisance, base.law_offsets)
    return replace(prepared, forward=forward, fit=fit_model(forward, base.model, base.free, start))


def sizes_in_words(forward: Forward) -> tuple[str, ...]:
    """How far settings were found to differ, in one sentence; none where they don't."""
    if not forward.at_setting:
        return ()
    back, restitution, launch = forward.at_setting
    scatter = forward.baseline.scatter
    sizes = [
        text
        for size, usual, text in (
            (back, scatter.backswing, f"back-swing ± {np.degrees(back):.2g}°"),
            (restitution, scatter.cor, f"COR ± {restitution:.2g}"),
            (launch, scatter.launch_angle, f"launch angle ± {np.degrees(launch):.2g}°"),
        )
        if size > MIN_SHARE * usual
    ]
    return (
        "repeats of a setting share errors that the model does not give: "
        + ", ".join(sizes)
        + " from setting to setting. A setting therefore counts once, however often it was"
        " repeated. More settings, or each angle set anew before each trial, say more",
    )
