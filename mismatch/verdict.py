"""Verdict of the engine, its acceptance tests, and its proof on data kept aside.

The proof fits each model to some trials and predicts the others, and fits it to the first 60 % of
each track and predicts the rest.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Literal, TypeAlias

import numpy as np

from mismatch.candidates import Candidate
from mismatch.fitting.fit import Ending, Fit, Free, fit_model
from mismatch.fitting.hypotheses import POOR_FIT, Hypothesis, is_known
from mismatch.fitting.prepare import Prepared
from mismatch.fitting.scan import heterogeneity, own_values
from mismatch.fitting.stated import USUAL_INPUTS
from mismatch.forward import Forward
from mismatch.records import Records
from mismatch.sanity import fall_in_g, keeps_time
from physics.bodies import GRAVITY
from physics.domain import FloatArray
from physics.effects import MEASUREMENT_IDS, Coordinate, Effect, EffectId, Level, SwingState

__all__ = [
    "DOUBTED",
    "Alternative",
    "Doubt",
    "EngineVerdict",
    "HeldOut",
    "Location",
    "NamedEffect",
    "ParameterValue",
    "Passed",
    "Prediction",
    "Remainder",
    "StrengthsOfEach",
    "VerdictKind",
    "hold_out",
    "pass_gate",
    "predict",
]

MAX_LISTED = 6

"""Balls or trials whose strengths a sentence lists."""

VerdictKind: TypeAlias = Literal["no_mismatch", "explained", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class ParameterValue:
    """A fitted number with its standard uncertainty.

    `determined` is false for a place, time or width that the records leave open.
    """

    name: str
    value: float
    std: float
    unit: str
    determined: bool = True

    @property
    def in_words(self) -> str:
        """Name, value and uncertainty."""
        if not self.determined:
            return f"{self.name} not determined"
        unit = self.unit if self.unit != "1" else ""
        return f"{self.name} = {self.value:.4g} ± {self.std:.2g} {unit}".rstrip()

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {"value": self.value, "std": self.std, "unit": self.unit}


@dataclass(frozen=True)
class StrengthsOfEach:
    """Strengths that differ from ball to ball, session to session or trial to trial.

    Attributes
    ----------
    level : str
        "ball", "session" or "trial".
    scatter : mapping
        Parameter → one sigma about the campaign's value.
    values : mapping
        Ball, session or trial → its strengths.
    """

    level: str
    scatter: Mapping[str, float]
    values: Mapping[str, tuple[ParameterValue, ...]]

    @property
    def in_words(self) -> str:
        """By how much strengths differ, and each of them where they are few."""
        scatter = ", ".join(f"{name} by {size:.3g}" for name, size in self.scatter.items())
        text = f"It differs from {self.level} to {self.level} ({scatter})"
        if len(self.values) > MAX_LISTED:
            return text + "."
        own = (
            f"{name}: " + ", ".join(f"{p.value:.3g} ± {p.std:.1g}" for p in parameters)
            for name, parameters in self.values.items()
        )
        return f"{text}: {'; '.join(own)}."

    def to_json(self) -> dict[str, Any]:
        """Level, scatter, and value and std of every parameter for each."""
        return {
            "level": self.level,
            "scatter": dict(self.scatter),
            "values": {
                name: {p.name: p.to_json() for p in own} for name, own in self.values.items()
            },
        }


@dataclass(frozen=True)
class NamedEffect:
    """Something that was left out, in words and numbers.

    Where strengths differ from ball to ball, session to session or trial to trial, `parameters` are
    their means and `each` holds the rest.
    """

    id: str
    statement: str
    probability: float
    parameters: tuple[ParameterValue, ...]
    form: str = ""
    each: StrengthsOfEach | None = None

    @property
    def in_words(self) -> str:
        """Name and probability."""
        size = f"{100.0 * self.probability:.0f} %"
        return f"{_in_words(self.id)} (probability {'over 99 %' if size == '100 %' else size})"

    @property
    def probability_in_words(self) -> str:
        """With two digits; no name is certain."""
        return "over 0.99" if self.probability >= 0.995 else f"{self.probability:.2f}"

    def to_json(self) -> dict[str, Any]:
        """As in the contract, with `each` where strengths differ."""
        out: dict[str, Any] = {
            "id": self.id,
            "statement": self.statement,
            "probability": round(self.probability, 4),
            "parameters": {p.name: p.to_json() for p in self.parameters},
        }
        if self.each is not None:
            out["each"] = self.each.to_json()
        return out


@dataclass(frozen=True)
class Location:
    """Where simulation and recording disagree; times in s after first touch or first sample."""

    phase: str
    t_start_s: float | None
    t_end_s: float | None
    channel: str
    statement: str

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return dict(vars(self))


@dataclass(frozen=True)
class Alternative:
    """Another answer, and why it was not taken."""

    ids: tuple[str, ...]
    why_not: str
    delta_bic: float

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return {
            "ids": list(self.ids),
            "why_not": self.why_not,
            "delta_bic": round(self.delta_bic, 1),
        }


@dataclass(frozen=True)
class HeldOut:
    """Prediction of trials kept out of the fit, before and after (m, or rad for swings).

    Attributes
    ----------
    gain : float or None
        Chi-square units by which they fit better, with what each trial's own scatter has to take
        up: a law of the contact moves no path that the scatter of launches may not move as well.
        None where more than noise is left over, in which chi-square gives no odds.
    extrapolation_before, extrapolation_after : float or None
        Error of the last two fifths of each track, fitted on the rest.
    extrapolation_95 : tuple of float or None
        Interval of their ratio, drawn over the trials; None of one trial.
    claimed : float
        Share of the error that the answer takes away where it was fitted.
    """

    trials: tuple[str, ...]
    rmse_before: float
    rmse_after: float
    ratio_95: tuple[float, float]
    unit: str = "m"
    extrapolation_before: float | None = None
    extrapolation_after: float | None = None
    gain: float | None = None
    extrapolation_95: tuple[float, float] | None = None
    claimed: float = 0.0

    @property
    def predicts_better(self) -> bool:
        """Whether their error is less, by some of what the answer takes away where it was fitted.

        A thousandth of an error that is halved in the fit is what a wrong law leaves, too.
        """
        less = 1.0 - 1.0 / max(self.ratio_95[0], 1e-12)
        return less > MIN_PREDICTED * self.claimed

    @property
    def proves(self) -> bool:
        """Whether the answer predicts them better: in their error, or by odds of twenty to one.

        Chi-square has the error in it, beside what each trial's own scatter took of it.
        """
        return self.predicts_better or (self.gain is not None and self.gain > PROVED)

    @property
    def worse(self) -> bool:
        """Whether the answer predicts them worse: in their error, and not better by chi-square.

        A law of the contact takes from each trial's own scatter what its error of metres had.
        """
        better = self.gain is not None and self.gain > NO_GAIN
        return self.ratio_95[1] < 1.0 and not better

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        out: dict[str, Any] = {
            f"rmse_before_{self.unit}": self.rmse_before,
            f"rmse_after_{self.unit}": self.rmse_after,
            "ratio_95": list(self.ratio_95),
            "trials": list(self.trials),
        }
        if self.gain is not None:
            out["chi2_gain"] = self.gain
        if self.extrapolation_before is not None:
            out["extrapolation"] = {
                f"rmse_before_{self.unit}": self.extrapolation_before,
                f"rmse_after_{self.unit}": self.extrapolation_after,
            }
            if self.extrapolation_95 is not None:
                out["extrapolation"]["ratio_95"] = list(self.extrapolation_95)
        return out

    def _small(self, size: float) -> str:
        """An error in mm or mrad."""
        return f"{1e3 * size:.3g} m{self.unit}"

    @property
    def in_words(self) -> str:
        """The proof in one or two sentences."""
        text = (
            f"Trials kept out of the fit: error {self._small(self.rmse_after)} instead of"
            f" {self._small(self.rmse_before)} (error ratio before/after:"
            f" {self.ratio_95[0]:.3g} to {self.ratio_95[1]:.3g}, 95 %)"
        )
        if self.predicts_better:
            text += "."
        elif self.proves:
            text += (
                "; what trials may differ by takes up the error, but they then differ less:"
                f" chi-square falls by {self.gain:.3g}."
            )
        else:
            text += ": no proof of a better prediction."
        if self.extrapolation_before is not None and self.extrapolation_after is not None:
            text += (
                " Fitted on the first 60 % of each track, the rest is predicted to"
                f" {self._small(self.extrapolation_after)} instead of"
                f" {self._small(self.extrapolation_before)}"
            )
            if self.extrapolation_95 is not None:
                text += " (error ratio {:.3g} to {:.3g})".format(*self.extrapolation_95)
            text += "."
        return text


@dataclass(frozen=True)
class Remainder:
    """What is left after the best model."""

    white: bool
    statement: str

    def to_json(self) -> dict[str, Any]:
        """As in the contract."""
        return dict(vars(self))


@dataclass(frozen=True)
class EngineVerdict:
    """The engine's answer.

    Attributes
    ----------
    verdict : VerdictKind
        In one word.
    baseline_effects : tuple of str, and
    baseline_chi2_per_dof : float
        The model that was tested, and how well it fits with the estimated noise.
    location : Location or None
        None where there is no mismatch.
    effects : tuple of NamedEffect
        What was left out, strongest first.
    alternatives : tuple of Alternative
        Other answers, nearest first.
    indistinguishable : tuple of tuple of str
        Groups of ids that the data cannot distinguish.
    next_measurement : str or None
        What would separate them.
    held_out : HeldOut or None
        None where too few trials were there to keep any aside.
    remainder : Remainder
        What stays unexplained.
    notes : tuple of str
        About the data: rows left out, noise against its claim, correlation.
    doubts : tuple of Doubt
        Why no more is believed.
    """

    verdict: VerdictKind
    baseline_effects: tuple[str, ...]
    baseline_chi2_per_dof: float
    location: Location | None
    effects: tuple[NamedEffect, ...]
    alternatives: tuple[Alternative, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    next_measurement: str | None
    held_out: HeldOut | None
    remainder: Remainder
    notes: tuple[str, ...] = ()
    doubts: tuple["Doubt", ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Exactly the contract's JSON, plus ``notes``."""
        return {
            "verdict": self.verdict,
            "baseline": {
                "effects": list(self.baseline_effects),
                "chi2_per_dof": self.baseline_chi2_per_dof,
            },
            "location": None if self.location is None else self.location.to_json(),
            "effects": [effect.to_json() for effect in self.effects],
            "alternatives": [other.to_json() for other in self.alternatives],
            "indistinguishable": [list(group) for group in self.indistinguishable],
            "next_measurement": self.next_measurement,
            "held_out": None if self.held_out is None else self.held_out.to_json(),
            "remainder": self.remainder.to_json(),
            "notes": list(self.notes),
        }

    @property
    def headline(self) -> str:
        """What was found, in one sentence that nothing below it contradicts."""
        if Doubt.NOISE in self.doubts and not self.effects:
            return "Nothing can be said: the noise of the recording is as large as what it shows."
        if not self.effects:
            rest = "" if self.remainder.white else _PATTERN
            return f"{_HEADLINES[self.verdict]}{'' if self.verdict == 'unexplained' else rest}."
        rest = "" if self.remainder.white else _PATTERN
        sure = [effect for effect in self.effects if effect.probability >= 0.5]
        doubted = _listed([e.in_words for e in self.effects if e.probability < 0.5])
        if not sure or (self.verdict == "ambiguous" and not self.indistinguishable):
            names = _listed([effect.in_words for effect in self.effects])
            return f"Simulation and recording disagree. Best, but in doubt: {names}{rest}."
        named = {effect.id for effect in sure}
        groups = [group for group in self.indistinguishable if group[0] in named]
        others = dict.fromkeys(_in_words(one) for group in groups for one in group[1:])
        beside = f"; not excluded instead: {_listed([*others], 'or')}" if others else ""
        beside += f"; in doubt: {doubted}" if doubted else ""
        names = _listed([effect.in_words for effect in sure])
        return f"{_subject(sure)}: {names}{beside}{rest}."

    @property
    def proof_of(self) -> str:
        """What the proof on held-out trials is about where it is of no name."""
        return "" if self.effects else "What fits best, and is not named, was tried. "

    @property
    def not_excluded(self) -> tuple[str, ...]:
        """What may stand in place of each name, in words."""
        return tuple(
            f"Not excluded in place of {group[0]}: {', '.join(_in_words(one) for one in group[1:])}"
            for group in self.indistinguishable
        )

    def text(self) -> str:
        """The story in plain words."""
        lines = [self.headline]
        if self.location is not None:
            lines.append(self.location.statement)
        for effect in self.effects:
            numbers = ", ".join(p.in_words for p in effect.parameters)
            lines.append(
                f"{effect.id} (probability {effect.probability_in_words}): {effect.statement}"
                f" {numbers}"
            )
            if effect.each is not None:
                lines.append(effect.each.in_words)
        lines.extend(f"{said}." for said in self.not_excluded)
        if self.next_measurement:
            lines.append(f"What would settle it: {self.next_measurement}.")
        if self.held_out is not None:
            lines.append(f"{self.proof_of}{self.held_out.in_words}")
        lines.append(self.remainder.statement)
        lines.extend(f"Note: {note}" for note in self.notes)
        return "\n".join(lines)


_PATTERN = "; the residuals still show a pattern"

_WORDS: Mapping[str, str] = {
    EffectId.UNNAMED: "a force that is in no catalogue",
    EffectId.MAGNUS: "Magnus lift",
    EffectId.TIME_BASE: "wrong frame rate",
    USUAL_INPUTS: "usual errors of the stated inputs and instruments",
    EffectId.LENGTH_SCALE: "wrong length scale",
    "velocity_dependent_cor": "restitution that depends on speed",
}
"""Names in a headline; other ids are read without their underscores."""


def _in_words(identity: str) -> str:
    return _WORDS.get(identity, identity.replace("_", " "))


def _listed(words: Sequence[str], last: str = "and") -> str:
    *first, end = words or [""]
    return f"{', '.join(first)} {last} {end}" if first else end


def _subject(effects: Sequence[NamedEffect]) -> str:
    """Start of the headline: where the missing effects belong, and how many there are."""
    if all(effect.id in MEASUREMENT_IDS for effect in effects):
        return "The recording has an error that the model does not include"
    if len(effects) == 1:
        return "An effect is missing from the model"
    return f"{len(effects)} effects are missing from the model"


MIN_PREDICTED = 0.1

"""Share of what an answer takes away where it was fitted that it must take away elsewhere, lest the
fit be a description; assumed: laws that hold take as much."""

PROVED = 6.0

"""Chi-square units by which held-out trials must fit better: odds of twenty to one."""


NO_GAIN = 1.0

"""Chi-square units below which held-out trials say nothing for an answer: of three such names in
the foreign simulator's campaigns one was right."""

_HEADLINES: dict[str, str] = {
    "no_mismatch": "Nothing is missing: simulation and recording agree within the noise",
    "unexplained": "Simulation and recording disagree, and no known effect explains it",
    "ambiguous": "Simulation and recording disagree, and no effect is probable enough to be named",
    "explained": "Simulation and recording disagree, and no effect is probable enough to be named",
}

DOUBTED = 0.45

"""Probability that a name has at most where a rule in `FORBIDS` speaks against it. Convention:
below one half, so that it is no answer."""

CARRIED = 0.3

"""Share of g below which a body that is said to be free does not fall."""

SWALLOWED = 0.1

"""Noise over the spread of the motion from which "nothing is missing" would say nothing."""

PULLED = 0.5

"""Share of a strength by which trials may differ in it."""

SEEN = 2.5

"""Standard uncertainties from zero, with place and length free, from which a strength is known:
one in a hundred is so by chance."""

HALF = 0.5

"""Share of a torque's square from which it goes mostly with the sine of the angle."""

UNLIKELY_SCATTER = 1e-3

"""Chance below which trials differ in a strength by more than noise and stated scatter."""

FAR_OFF_NOISE = 10.0

"""Misfit, three sigma a row, from which values of each trial's own describe but don't explain."""


class Doubt(Enum):
    """What speaks against an answer that fits best."""

    WORSE_HELD_OUT = "on trials kept out of the fit it does no better than the model without it"
    CARRIED = "the body does not fall as a free one does: something carries or holds it"
    LEFT_OVER = "it leaves most of the mismatch unexplained"
    UNSTEADY = "its strength differs from trial to trial by more than chance and half of itself"
    UNDETERMINED = "its strength and its place or length stand in for each other: neither is known"
    PENDULUMS_WEIGHT = (
        "its torque takes the course of the pendulum's own weight: another inertia, mass or centre"
        " of mass would say the same; check pendulum in the setup"
    )
    EACH_ITS_OWN = "each trial has values of its own, which take up a part of any misfit"
    UNPROVED = "no trial is kept out of the fit to prove it on"
    SHAPE_OF_ONE = (
        "its shape was fitted to one trial, and a shape describes any record: another trial would"
        " show whether it is a law"
    )
    KEEPS_TIME = (
        "wide swings take no longer than small ones: so it is with a spring, a torsion wire or a"
        " cycloid, and with angles that are in degrees where phi_rad says radians"
    )
    UNKNOWN_CALIBRATION = "it is no larger than what a calibration that nobody knows may leave open"
    OUTDONE = (
        "an answer that nature forbids fits the records better: what the setup states of the air,"
        " the mass, the size or the scale may be wrong"
    )
    AT_BOUND = "a parameter ended at the edge of what is allowed"
    UNCONVERGED = "its fit did not converge"
    ONE_RECORD = "one trial shows nothing twice: any smooth remainder could pass for a law"
    UNLIKELY = "it is less likely than all other answers together"
    OUTWEIGHED = "a smooth force without a name explains more of what it leaves than it explains"
    NOISE = "the noise that is needed is as large as the motion itself, so nothing can be said"


FORBIDS = frozenset(
    {
        Doubt.KEEPS_TIME, Doubt.OUTDONE, Doubt.PENDULUMS_WEIGHT, Doubt.SHAPE_OF_ONE,
        Doubt.ONE_RECORD, Doubt.UNKNOWN_CALIBRATION,
    }
)  # fmt: skip
"""Doubts with which no name is an answer, whatever its evidence: another explanation is at hand
that the records cannot exclude."""


@dataclass(frozen=True)
class Passed:
    """What the gate lets through.

    Attributes
    ----------
    kind : VerdictKind
    doubts : tuple of Doubt
        What speaks against the answer.
    """

    kind: VerdictKind
    doubts: tuple[Doubt, ...] = ()

    @property
    def names(self) -> bool:
        """Whether anything may be named at all."""
        nothing = {Doubt.WORSE_HELD_OUT, Doubt.CARRIED, Doubt.NOISE, Doubt.OUTWEIGHED}
        return not nothing.intersection(self.doubts)

    @property
    def against(self) -> tuple[Doubt, ...]:
        """Doubts that speak against the answer, rather than too little for it."""
        return tuple(doubt for doubt in self.doubts if doubt is not Doubt.UNPROVED)

    @property
    def most(self) -> float:
        """Largest probability that a name may have."""
        return DOUBTED if FORBIDS.intersection(self.doubts) else 0.999

    @property
    def is_weighed(self) -> bool:
        """Whether evidence alone decides how probable each name is."""
        return self.names and not FORBIDS.intersection(self.doubts)

    def beside(self, gain: float, structure: float) -> "Passed":
        """What passes beside what the answer leaves: nothing, if that is the larger part.

        Parameters
        ----------
        gain, structure : float
            Evidence of the answer over the baseline, and of the best smooth force or torque without
            a name over the answer, in the same units.
        """
        if structure <= gain:
            return self
        return replace(self, kind="unexplained", doubts=(*self.doubts, Doubt.OUTWEIGHED))


def pass_gate(
    prepared: Prepared,
    best: Hypothesis | None,
    kind: VerdictKind,
    kept: HeldOut | None,
    *,
    outdone: bool = False,
) -> Passed:
    """Hold an answer against its own remainder, its proof on held-out trials, and each trial.

    Parameters
    ----------
    prepared : Prepared
    best : Hypothesis or None
    kind : VerdictKind
        What the search would say.
    kept : HeldOut or None
        The proof, if there was one.
    outdone : bool
        Whether an answer that nature forbids fits better.
    """
    forward = prepared.forward
    if best is None:
        if kind == "no_mismatch" and _noise_swallows(forward):
            return Passed("unexplained", doubts=(Doubt.NOISE,))
        if prepared.fit.reduced_chi2 >= POOR_FIT and _carried(forward):
            return Passed("unexplained", doubts=(Doubt.CARRIED,))
        return Passed(kind)
    doubts = _doubts(forward, best, kept)
    if outdone:
        doubts.append(Doubt.OUTDONE)
    if best.has_unnamed and best.reduced_chi2 >= POOR_FIT * POOR_FIT:
        # A fitted shape that still leaves structure is a description, not a law.
        kind, doubts = "unexplained", [*doubts, Doubt.LEFT_OVER]
    through = Passed(kind, tuple(doubts))
    return through if through.names else replace(through, kind="unexplained")


def _doubts(forward: Forward, best: Hypothesis, kept: HeldOut | None) -> list[Doubt]:
    """What speaks against an answer, and what there is too little of for it."""
    poor = best.reduced_chi2 >= POOR_FIT
    single = forward.records.trials == 1
    unproved = poor and kept is not None and not kept.proves
    far = best.reduced_chi2 >= FAR_OFF_NOISE and bool(best.fit.model.own)
    holds = {
        Doubt.UNPROVED: kept is None,
        Doubt.SHAPE_OF_ONE: single and best.has_unnamed,
        Doubt.ONE_RECORD: single and not best.has_unnamed and forward.mode != "swing",
        Doubt.AT_BOUND: any(_at_bound(best, member) for member in best.members),
        Doubt.UNCONVERGED: best.fit.ending is not Ending.CONVERGED,
        Doubt.KEEPS_TIME: keeps_time(forward),
        Doubt.NOISE: _noise_swallows(forward),
        Doubt.CARRIED: poor and _carried(forward),
        Doubt.WORSE_HELD_OUT: unproved or (kept is not None and kept.worse),
        Doubt.EACH_ITS_OWN: far or _own_like_noise(forward, best),
        Doubt.UNSTEADY: _unsteady(forward, best),
        Doubt.UNDETERMINED: _undetermined(best),
        Doubt.PENDULUMS_WEIGHT: not poor and _like_its_weight(forward, best),
    }
    return [doubt for doubt, held in holds.items() if held]


AT_BOUND = 1e-3
"""Distance from a bound, in scales of the parameter, within which it is at the bound: the step of
its finite difference."""


def _at_bound(best: Hypothesis, member: Candidate) -> bool:
    """Whether a fitted parameter of a law ended at an edge of what is allowed."""
    for index, item in enumerate(best.fit.free):
        if best.fit.model.entries[item.entry][0] is not member.effect or item.parameter.is_held:
            continue
        p = item.parameter
        value, _ = best.fit.value(index)
        edge = AT_BOUND * p.scale
        if value <= p.lower + edge or value >= p.upper - edge:
            return True
    return False


def _carried(forward: Forward) -> bool:
    vertical = forward.records.ball_used[..., 1].any()
    return forward.mode == "flight" and bool(vertical) and abs(fall_in_g(forward, 1)) < CARRIED


def _noise_swallows(forward: Forward) -> bool:
    """Whether the noise of a record is comparable with what it shows."""
    records = forward.records
    sizes: list[float] = []
    for trial in range(records.trials):
        used = records.pendulum_used[trial]
        if forward.mode == "swing" and used.any():
            spread = float(np.std(records.pendulum_angle[trial, used]))
            sizes.append(records.sigma[trial, 3] / max(spread, 1e-12))
        seen = records.ball_used[trial]
        if forward.mode != "swing" and seen.any():
            directions = [
                (
                    float(np.std(records.position[trial, seen[:, k], k])),
                    _noise_of(records, trial, k),
                )
                for k in range(3)
                if seen[:, k].any()
            ]
            widest, sigma = max(directions)
            sizes.append(sigma / max(widest, 1e-12))
    return not sizes or float(np.median(sizes)) > SWALLOWED


def _noise_of(records: Records, trial: int, axis: int) -> float:
    """Noise of a ball's place along an axis, m, what a clock that jitters has of it included."""
    sigma = float(records.sigma[trial, axis])
    if not records.jitter.size:
        return sigma
    off = records.jitter[trial, records.ball_used[trial, :, axis], axis]
    return sigma * math.sqrt(1.0 + float(np.mean(np.square(off))))


def _unsteady(forward: Forward, best: Hypothesis) -> bool:
    """Whether trials differ in an effect's strength beyond their stds and by half of it.

    A law written a little otherwise differs by some per cent along its coordinate; what differs by
    half of itself is another thing in each trial. An effect is judged by its surest strength.
    """
    scatter = heterogeneity(forward, best.fit)
    for member in best.members:
        if member.effect.level is not Level.CAMPAIGN or is_known(member.effect):
            continue
        sizes = {}
        for index, item in enumerate(best.fit.free):
            mine = best.fit.model.entries[item.entry][0] is member.effect
            if mine and not item.parameter.is_shape and not item.parameter.is_held:
                value, std = best.fit.value(index)
                size = abs(value - item.parameter.neutral)
                sizes[index] = (size / max(std, 1e-300), size)
        if not sizes:
            continue
        surest = max(sizes, key=lambda index: sizes[index][0])
        seen = scatter[surest]
        if seen.chance < UNLIKELY_SCATTER and seen.spread > PULLED * sizes[surest][1]:
            return True
    return False


def _undetermined(best: Hypothesis) -> bool:
    """Whether a law has shapes that leave its strength open.

    Squeezed against the contact, a torque at one angle says whatever a law of contact says; frames
    lost at an undetermined instant say whatever bends the end of a fall.
    """
    return any(
        member.effect.shapes
        and member.effect.level is Level.CAMPAIGN
        and _most_seen(best.fit, member.effect) < SEEN
        for member in best.members
    )


def _own_like_noise(forward: Forward, best: Hypothesis) -> bool:
    """Whether a law's strengths of each trial are no larger than slow noise makes them.

    Noise with a memory bends each trial's path in its own direction, too. Strengths are judged by
    their spread: spins of opposite signs have no mean, and each may be far from none. An instant
    chosen in each trial is noise as long as choosing it gains more than what is left of it.
    """
    records = forward.records
    if any(getattr(m.effect, "search_cost", 0.0) > best.penalised_gain for m in best.members):
        return True
    return (records.remembers or not records.tell_memory) and any(
        member.effect.level is Level.TRIAL and _spread_seen(forward, best.fit, member.effect) < SEEN
        for member in best.members
    )


def _spread_seen(forward: Forward, fit: Fit, effect: Effect) -> float:
    """Standard deviations by which per-trial strengths together exceed their uncertainties.

    The sum of their squares over their variances has the mean n and the variance 2 n where all are
    none; the surest strength counts.
    """
    own = own_values(forward, fit, effect)
    if own is None:
        return _most_seen(fit, effect)
    squares = np.square(own.value / own.std)
    known = np.isfinite(squares)
    count = known.sum(axis=0)
    excess = np.where(known, squares, 0.0).sum(axis=0) - count
    return float(np.max(excess / np.sqrt(np.maximum(2.0 * count, 1.0)), initial=0.0))


def _most_seen(fit: Fit, effect: Effect) -> float:
    """Standard uncertainties, misfit counted, by which an effect's surest strength is off zero.

    Infinite where it has no strength that was fitted.
    """
    misfit = math.sqrt(fit.reduced_chi2)
    sizes = [
        abs(value - item.parameter.neutral) / max(std * misfit, 1e-300)
        for k, item in enumerate(fit.free)
        for value, std in (fit.value(k),)
        if fit.model.entries[item.entry][0] is effect and not item.parameter.is_shape
    ]
    return max(sizes, default=math.inf)


def _like_its_weight(forward: Forward, best: Hypothesis) -> bool:
    """Whether most of a torque in no catalogue goes with the sine of the angle, as weight does.

    A strike's swing keeps the pace that the setup's inertia, mass and centre of mass give it; of a
    free swing the pace is fitted, so that what is left over is none of theirs.
    """
    records, body = forward.records, forward.baseline.pendulum
    if forward.mode != "impact" or body is None:
        return False
    angle = records.pendulum_angle[records.pendulum_used]
    still = SwingState(
        angle, np.zeros_like(angle), body.inertia, body.mass, body.com, body.length, GRAVITY
    )
    sine = np.sin(angle)
    for member in best.members:
        over_angle = (
            member.effect.coordinate is Coordinate.ANGLE and "torque" in member.effect.hooks
        )
        if member.id != EffectId.UNNAMED or not over_angle:
            continue
        values = next(v for e, v in best.fit.model.entries if e is member.effect)
        torque = np.asarray(member.effect.torque(values, still), dtype=np.float64)
        both = float(torque @ sine) ** 2
        if both > HALF * float(torque @ torque) * float(sine @ sine):
            return True
    return False


DRAWS = 1000

"""Resamples: a probability of 0.95 is then good to 0.007."""

FEW = 4

"""Trials up to which each is kept out in turn: one alone may be the one that determines nothing."""

BLOCKS = 8

"""Pieces of each held-out trial that are drawn anew: one trial alone gives an interval, too."""


def choose_held_out(forward: Forward) -> np.ndarray:
    """(folds, T) masks of what is kept out: every third trial, or each in turn where few are."""
    trials = forward.records.trials
    if trials <= FEW:
        return np.eye(trials, dtype=bool)
    return np.asarray(np.arange(trials) % 3 == 2)[None]


def _trained(forward: Forward, model_fit: Fit, held: np.ndarray) -> Fit:
    """The model fitted to the trials that are not held out."""
    train = replace(forward, records=forward.records.chosen(~held))
    start = (model_fit.nuisance, model_fit.law_offsets)
    return fit_model(train, model_fit.model, model_fit.free, start, rounds=5)


def _folds_that_predict(
    forward: Forward, best: Hypothesis, folds: np.ndarray, *, chosen: bool
) -> tuple[np.ndarray, list[Fit]]:
    """Folds whose other trials determine all that is named, and the answer trained on those.

    Where the trials that are left leave a strength open that all of them determine, they predict
    nothing: a crisis that two trials went through was predicted fifty times too large. Then each
    trial is kept out in turn, and those without which nothing is determined stay in. Folds that a
    user has `chosen` stay as they are.
    """

    def determine(trained: Fit) -> bool:
        return all(
            _most_seen(trained, member.effect) >= SEEN
            for member in best.members
            if _most_seen(best.fit, member.effect) >= SEEN
        )

    trained = [_trained(forward, best.fit, mask) for mask in folds]
    if chosen or all(determine(one) for one in trained):
        return folds, trained
    each = np.eye(forward.records.trials, dtype=bool)
    alone = [_trained(forward, best.fit, mask) for mask in each]
    kept = [index for index, one in enumerate(alone) if determine(one)]
    return (each[kept], [alone[index] for index in kept]) if kept else (folds, trained)


def _errors(
    forward: Forward, model_fit: Fit, trained: Fit, held: np.ndarray
) -> tuple[FloatArray, FloatArray, float]:
    """Squared error sums and counts (held-out trials × blocks), after training on the others.

    And what the held-out trials cost in all: their misfit, and how far each had to be moved from
    what repeats, which takes up errors of metres that a law would else show.
    """
    test = replace(forward, records=forward.records.chosen(held))
    # Trained parameters and law offsets stay; only what belongs to the trial is refitted.
    start = (model_fit.nuisance, trained.law_offsets)
    fitted = fit_model(test, trained.model, (), start, rounds=4, settled=True)
    weights = test.records.weights
    errors = test.records.unweighed(fitted.residual)
    s3 = 3 * forward.records.ball_time.shape[1]
    part = slice(0, s3) if forward.mode != "swing" else slice(s3, None)
    squares, used = errors[held][:, part] ** 2, weights[held][:, part] > 0.0
    axes = 3 if forward.mode != "swing" else 1
    sums = _in_blocks(squares, axes), _in_blocks(used.astype(np.float64), axes)
    return *sums, fitted.objective


Errors: TypeAlias = tuple[FloatArray, FloatArray, float]


def _together(folds: Sequence[Errors]) -> Errors:
    """Errors, counts and costs of all folds."""
    errors, counts, costs = zip(*folds, strict=True)
    return np.concatenate(errors), np.concatenate(counts), float(sum(costs))


def _in_blocks(rows: FloatArray, axes: int) -> FloatArray:
    """Sums over blocks of rows of a record (T, axes × S), all axes of a row together."""
    together = rows.reshape(len(rows), axes, -1).sum(axis=1)
    parts = np.array_split(together, min(BLOCKS, together.shape[1]), axis=1)
    return np.concatenate([part.sum(axis=1) for part in parts])


def _extrapolation(
    forward: Forward, model_fit: Fit, free: Sequence[Free], share: float = 0.6
) -> tuple[FloatArray, FloatArray] | None:
    """Squared error sums and counts, (T,), of the last part of every track, fitted on the first."""
    records = forward.records
    s3 = 3 * records.ball_time.shape[1]
    ball = forward.mode != "swing"
    time = records.ball_time if ball else records.pendulum_time
    seen = records.ball_used.any(axis=-1) if ball else records.pendulum_used
    start = np.where(seen, time, np.inf).min(axis=1, keepdims=True)
    if forward.mode == "impact":
        start = np.maximum(start, model_fit.nuisance[:, :1])
    end = np.where(seen, time, -np.inf).max(axis=1, keepdims=True)
    early = time <= start + share * (end - start)
    kept = np.ones(records.used.shape, dtype=bool)
    part = slice(0, s3) if ball else slice(s3, None)
    kept[:, part] = np.tile(early, 3) if ball else early
    late = records.used[:, part] & ~kept[:, part]
    if not late.any() or records.keeping(kept).count < 3 * records.trials:
        return None
    first = replace(forward, records=records.keeping(kept))
    trained = fit_model(
        first, model_fit.model, free, (model_fit.nuisance, model_fit.law_offsets), rounds=5
    )
    whole = fit_model(forward, trained.model, (), (trained.nuisance, trained.law_offsets), rounds=0)
    errors = np.where(late, records.unweighed(whole.residual)[:, part], 0.0)
    return np.square(errors).sum(axis=1), late.sum(axis=1).astype(np.float64)


def _ratio_95(before: FloatArray, after: FloatArray) -> tuple[float, float]:
    """Interval of the ratio of two root mean squares, drawn over the sums that make them up."""
    picks = np.random.default_rng(11).integers(0, before.size, (DRAWS, before.size))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.sqrt(before[picks].sum(axis=1) / np.maximum(after[picks].sum(axis=1), 1e-300))
    low, high = np.quantile(ratio, [0.025, 0.975])
    return float(low), float(high)


@dataclass(frozen=True)
class Prediction:
    """Errors of data that a model was not fitted to.

    Attributes
    ----------
    errors, counts : (held-out trials × blocks,) arrays
        Squared error sums and numbers of readings in held-out trials.
    cost : float or None
        Chi-square and penalties of held-out trials; None where there are none.
    late, late_counts : (T,) arrays
        The same for the last 40 % of each track, fitted on the first 60 %; empty where tracks are
        too short.
    """

    errors: FloatArray
    counts: FloatArray
    cost: float | None
    late: FloatArray
    late_counts: FloatArray

    @property
    def late_rmse(self) -> float | None:
        """Root mean square error of the last 40 % of all tracks."""
        total = float(self.late_counts.sum())
        return math.sqrt(float(self.late.sum()) / total) if total else None


def predict(
    forward: Forward,
    base: Fit,
    sets: Sequence[Hypothesis],
    held: np.ndarray | None = None,
    known: dict[tuple[int, bytes], Prediction] | None = None,
) -> tuple[np.ndarray, dict[int, Prediction]]:
    """Predictions of the baseline and of fitted sets, by the id of their fits.

    Parameters
    ----------
    sets : sequence of Hypothesis
        The answer first; which trials are held out depends on it.
    held : (T,) bool array, optional
        Trials that a user chose to hold out.
    known : dict, optional
        Predictions by the id of the fit and the folds; those of further fits are added.

    Returns
    -------
    folds : (folds, T) bool array
        Trials held out; no rows where there are too few.
    predictions : dict
    """
    folds = choose_held_out(forward) if held is None else held[None]
    folds = folds[folds.any(axis=1) & ~folds.all(axis=1)]
    best = sets[0]
    trained: list[Fit] = []
    if folds.size:
        folds, trained = _folds_that_predict(forward, best, folds, chosen=held is not None)
    known = {} if known is None else known
    fits = (base, *(h.fit for h in sets))
    for fit in fits:
        if (id(fit), folds.tobytes()) in known:
            continue
        errors, counts, cost = np.zeros(0), np.zeros(0), None
        if folds.size:
            learnt = trained if fit is best.fit else [_trained(forward, fit, m) for m in folds]
            parts = [_errors(forward, fit, *one) for one in zip(learnt, folds, strict=True)]
            errors, counts, cost = _together(parts)
        late = _extrapolation(forward, fit, fit.free) or (np.zeros(0), np.zeros(0))
        known[id(fit), folds.tobytes()] = Prediction(errors, counts, cost, *late)
    return folds, {id(fit): known[id(fit), folds.tobytes()] for fit in fits}


def hold_out(
    forward: Forward,
    base: Fit,
    best: Hypothesis,
    held: np.ndarray | None = None,
    *,
    known: tuple[np.ndarray, Mapping[int, Prediction]] | None = None,
) -> HeldOut | None:
    """Held-out error of baseline and best model, with a bootstrap interval of their ratio.

    Parameters
    ----------
    known : (folds, predictions), optional
        As `predict` returns them, where they are at hand.

    Returns
    -------
    HeldOut or None
        None with fewer than two trials, or none kept aside.
    """
    folds, predictions = known or predict(forward, base, [best], held)
    if not folds.size:
        return None
    plain, mended = predictions[id(base)], predictions[id(best.fit)]
    total = max(float(plain.counts.sum()), 1.0)
    seen = plain.late_counts > 0.0
    several = seen.sum() > 1 and mended.late.size
    cost = 0.0 if plain.cost is None or mended.cost is None else plain.cost - mended.cost
    return HeldOut(
        tuple(str(index) for index in np.flatnonzero(folds.any(axis=0))),
        float(np.sqrt(plain.errors.sum() / total)),
        float(np.sqrt(mended.errors.sum() / total)),
        _ratio_95(plain.errors, mended.errors),
        "rad" if forward.mode == "swing" else "m",
        gain=cost / best.reduced_chi2 if best.reduced_chi2 < POOR_FIT else None,
        claimed=max(0.0, 1.0 - math.sqrt(best.fit.chi2 / max(base.chi2, 1e-300))),
        extrapolation_before=plain.late_rmse if mended.late.size else None,
        extrapolation_after=mended.late_rmse if plain.late.size else None,
        # An error that grows along a track is the whole trial's.
        extrapolation_95=_ratio_95(plain.late[seen], mended.late[seen]) if several else None,
    )
