"""Compare a campaign with a baseline model and report what is missing."""

import logging
import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import permutations

import numpy as np

from metrology import Defaults, TooLittleDataError, UsageError
from mismatch.acceptance import (
    NameEvidence,
    calibrated_probability,
    evidence_for_names,
    other_kind,
    other_sizes,
    sets_to_predict,
)
from mismatch.candidates import (
    Candidate,
    candidates_for,
    refuse_unusable,
    start_values,
    steps_of,
    within_patience,
)
from mismatch.fitting.fit import Fit, fit_model, kept_free, spread_laws
from mismatch.fitting.hypotheses import (
    LOOSE_LAWS,
    POOR_FIT,
    SURELY,
    Hypothesis,
    group_tolerance,
)
from mismatch.fitting.prepare import Prepared, prepare, with_slow_noise
from mismatch.fitting.reading import NOTEWORTHY
from mismatch.fitting.scan import own_values, robust_spread, scan
from mismatch.fitting.settings import (
    shared_by_repeats,
    sizes_in_words,
    with_shared_by_repeats,
)
from mismatch.fitting.stated import USUAL_INPUTS
from mismatch.fitting.wandering import wandering_errors
from mismatch.forward import OUTSIDE, Forward
from mismatch.records import SIGNIFICANT, Baseline, CampaignRecords
from mismatch.repeats import IN_ANOTHER_ORDER, repeats_of
from mismatch.sanity import (
    DroppedInEach,
    refuse_beyond_bounds,
    refuse_nonsense,
    without_odd_trials,
)
from mismatch.search.inputs import beside_usual_inputs
from mismatch.search.locate import (
    locate,
    noise_notes,
    remainder_of,
    where_it_is_largest,
)
from mismatch.search.naming import Naming, name_effects
from mismatch.search.unnamed import SmoothCurve
from mismatch.verdict import (
    Alternative,
    Doubt,
    EngineVerdict,
    HeldOut,
    NamedEffect,
    ParameterValue,
    Passed,
    Prediction,
    StrengthsOfEach,
    VerdictKind,
    hold_out,
    pass_gate,
    predict,
)
from physics.domain import FloatArray
from physics.effects import CATALOGUE, MEASUREMENT_IDS, Effect, EffectId, Level, Parameter

__all__ = ["ExplainedCampaign", "Options", "explain", "explain_in_full"]

_log = logging.getLogger(__name__)
"""One line for each stage, since a search may take minutes."""

HINT = 3.0
"""Misfit of a strike from which the setup is to be checked first; a warning, no probability."""

MAX_ALTERNATIVES = 8
"""Rows of the table of what else was tried, the best force without a name among them."""

MAX_SHAPE_STD = 3.0
"""Standard uncertainty of a place, time or width, in scales of it, above which a text calls it not
determined: the scale is about what the records span. Chosen; insensitive between two and ten."""

MIN_ROWS = 12
"""Samples: fewer can't distinguish an effect from noise, whose size they must determine too."""


@dataclass(frozen=True)
class Options:
    """How to explain.

    Attributes
    ----------
    hold_out : tuple of str
        Trials to keep out of the fit that is shown on data kept aside; the engine's own choice if
        empty.
    effects : tuple of Effect
        A user's own, which take part like any other.
    most_effects : int
        Largest set that is named.
    widths : mapping
        Effect id → standard uncertainty of its first strength where a calibration has measured it
        (length_scale, time_base: relative; camera_roll: rad), instead of what labs usually reach.
    """

    hold_out: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()
    most_effects: int = 3
    widths: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ExplainedCampaign:
    """A verdict with what it rests on, for plots and reports.

    `evidence` is that of each name of the answer; `considered` has the names of less probable
    answers, too, but none of an answer that a rule withholds or caps, whatever its evidence.
    """

    verdict: EngineVerdict
    prepared: Prepared
    naming: Naming
    trials: tuple[str, ...] = ()
    evidence: tuple[NameEvidence, ...] = ()
    considered: tuple[NameEvidence, ...] = ()


def explain(
    campaign: CampaignRecords, setup_model: Baseline, *, options: Options | None = None
) -> EngineVerdict:
    """Find where a campaign and a baseline differ, and name what was left out.

    Parameters
    ----------
    campaign : CampaignRecords
        What was recorded.
    setup_model : Baseline
        What the lab believes.
    options : Options, optional
        Held-out trials, a user's own effects.

    Returns
    -------
    EngineVerdict

    Raises
    ------
    TooLittleDataError
        If there are too few samples to fit even the baseline.
    """
    return explain_in_full(campaign, setup_model, options=options).verdict


def explain_in_full(
    campaign: CampaignRecords, setup_model: Baseline, *, options: Options | None = None
) -> ExplainedCampaign:
    """As `explain`, with the fits behind the verdict."""
    chosen = options or Options()
    _require_trials(campaign, chosen.hold_out)
    _require_enough(campaign)
    campaign = without_odd_trials(campaign)
    rows = sum(trial.samples for trial in campaign.trials)
    _log.info("Fit the baseline: %d rows, trials: %d", rows, len(campaign.trials))
    prepared = prepare(campaign, setup_model, chosen.widths)
    refuse_nonsense(campaign, prepared)
    refuse_beyond_bounds(prepared.fit)
    catalogue = [effect for forms in CATALOGUE.values() for effect in forms]
    effects = [
        _of_width(effect, chosen.widths.get(effect.id)) for effect in (*catalogue, *chosen.effects)
    ]
    for effect in chosen.effects:
        _refuse_failing(prepared, effect)
    prepared, naming = _searched(prepared, effects, chosen.most_effects, chosen.widths.keys())
    held = _held_mask(campaign, chosen.hold_out)
    _log.info("Test what was found on data kept aside")
    answers = _tested_answers(prepared, naming, held)
    tested = _preferred(answers)
    weighed = (answer for answer in answers if answer.passed.is_weighed)
    considered = tuple(one for answer in weighed for one in answer.evidence)
    naming = tested.naming
    verdict = _verdict(campaign, prepared, tested)
    forms = _form_notes(naming.best) if verdict.effects else ()
    notes = (*_open_notes(prepared, naming.best), *forms, *_aside_notes(naming))
    verdict = replace(verdict, notes=(*verdict.notes, *notes))
    names = tuple(trial.name for trial in campaign.trials)
    return ExplainedCampaign(verdict, prepared, naming, names, tested.evidence, considered)


INSTRUMENTS = frozenset({EffectId.LENGTH_SCALE, EffectId.TIME_BASE, EffectId.CAMERA_ROLL})
"""Ids of what is left open in free flights."""


def _searched(
    prepared: Prepared, effects: Sequence[Effect], most: int, measured: Set[str]
) -> tuple[Prepared, Naming]:
    """What the search finds, and the baseline that it starts from.

    Where usual errors of stated inputs and instruments have more evidence than names, they are left
    open and the search starts anew.
    """
    prepared, found = _searched_as_stated(prepared, effects, most)
    if found.best is None:
        return _with_fault_of_instrument(prepared, found, effects, most, measured)
    inputs = beside_usual_inputs(prepared, found)
    if inputs.opened is None:
        return prepared, found.and_tried(inputs.sets)
    _log.info("Search again with usual errors of the inputs")
    opened, beside = _searched_as_stated(inputs.opened, effects, most)
    return opened, replace(beside, set_aside=(found.best.ids, inputs.lead))


def _with_fault_of_instrument(
    prepared: Prepared, found: Naming, effects: Sequence[Effect], most: int, measured: Set[str]
) -> tuple[Prepared, Naming]:
    """Where nothing is found, a fault of instruments that are held to be right.

    One fault is called by its name, however small it is, unless a calibration has `measured` the
    instrument. Several at once are what a careful laboratory has, as long as none is noteworthy.
    """
    base = prepared.fit
    off = _instruments_off(base)
    held = INSTRUMENTS.intersection(identity for identity, *_ in _left_open(base, base))
    held = held if off else held.difference(measured)
    if not held:
        return prepared, found
    faults = [effect for effect in effects if effect.id in held]
    right = replace(prepared, fit=_with_held(prepared, held))
    usual = right.fit.objective - base.objective
    if usual < found.threshold:
        return prepared, found
    blamed = name_effects(right.forward, right.fit, faults, most=most, unnamed=False)
    best = blamed.best
    if best is None:
        return prepared, found
    alone = len(best.members) == 1 and best.gain > usual - group_tolerance(best)
    return (right, blamed) if off or alone else (prepared, found)


def _searched_as_stated(
    prepared: Prepared, effects: Sequence[Effect], most: int
) -> tuple[Prepared, Naming]:
    """As `_searched`, with the inputs as the baseline has them.

    Beside open instruments a fault of theirs explains nothing that they don't take up. One that is
    only assumed to be right, and surely is not, is tested against whatever else says as much.
    """
    found = name_effects(prepared.forward, prepared.fit, effects, most=most)
    slow = None if found.best is None else with_slow_noise(prepared, _beside(prepared, found.best))
    if slow is not None:
        return _searched_as_stated(slow, effects, most)
    settings = _among_settings_that_differ(prepared, found)
    if settings is not None:
        return _searched_as_stated(settings, effects, most)
    wandering = _among_wandering_errors(prepared, found)
    if wandering is not None:
        anew = name_effects(wandering.forward, wandering.fit, effects, most=most)
        if anew.best is None:
            return prepared, replace(found, best=None)
        prepared, found = wandering, anew
    named = INSTRUMENTS.intersection(() if found.best is None else found.best.ids)
    if named:
        # What is to be proved is held against a baseline that has it not.
        return replace(prepared, fit=_with_held(prepared, INSTRUMENTS)), found
    assumed = prepared.forward.baseline.assumed
    if found.best is None and _surely_off(prepared.fit, assumed):
        held = replace(prepared, fit=_with_held(prepared, assumed))
        anew = name_effects(held.forward, held.fit, effects, most=most)
        return (prepared, found) if anew.best is None else (held, anew)
    return prepared, found


def _beside(prepared: Prepared, best: Hypothesis) -> Fit:
    """The fit whose remainder gives the noise: the answer's, or the baseline's.

    A curve, or a law with a value in each trial, takes slow noise up itself.
    """
    takes_up = any(
        member.effect.level is Level.TRIAL or any(p.is_held for p in member.effect.strengths)
        for member in best.members
    )
    return prepared.fit if takes_up else best.fit


def _among_wandering_errors(prepared: Prepared, found: Naming) -> Prepared | None:
    """The baseline among errors that wander over whole records, where these are likelier than laws.

    They are held, with the best of what bends all trials alike, against the best law of any kind
    among white noise.
    """
    forward, base = prepared.forward, prepared.fit
    allowed = [h for h in found.tried if h.allowed]
    alike = [h for h in allowed if not any(_of_each_trial(m.effect) for m in h.members)]
    first = max(alike, key=lambda h: h.penalised_gain, default=None)
    white = max((h.penalised_gain for h in allowed), default=0.0)
    gained, noise = 0.0, wandering_errors(forward, base.residual)
    if first is not None:
        # Among what wanders some law always bends as most flights do: chance has to be beaten.
        beside = wandering_errors(forward, first.fit.residual)
        if first.penalised_gain + beside.gain > noise.gain + found.threshold:
            gained, noise = first.penalised_gain, beside
    if noise.gain < SIGNIFICANT or gained + noise.gain < white:
        return None
    records = replace(forward.records, slow=noise.excess)
    wandering = replace(forward, records=records)
    start = (base.nuisance, base.law_offsets)
    fit = fit_model(wandering, base.model, base.free, start)
    return replace(prepared, forward=wandering, fit=fit)


def _among_settings_that_differ(prepared: Prepared, found: Naming) -> Prepared | None:
    """The baseline with an offset of each setting, where repeats share more than the model gives.

    What settings differ by next to the answer is compared with what they differ by without it. An
    answer after which they differ no more only has to be the likelier of the two; one beside which
    they still differ is a further law, and has to beat chance.
    """
    forward, base = prepared.forward, prepared.fit
    if forward.at_setting:
        return None
    shared, best = shared_by_repeats(forward, base), found.best
    if best is not None:
        beside = shared_by_repeats(forward, best.fit)
        chance = found.threshold if beside.gain > SIGNIFICANT else 0.0
        if best.penalised_gain + beside.gain > shared.gain + chance:
            shared = beside
    return with_shared_by_repeats(prepared, shared) if shared.gain > SIGNIFICANT else None


def _of_each_trial(effect: Effect) -> bool:
    """Whether each trial has a value of its own, by which it may follow its own errors."""
    return effect.level is Level.TRIAL or isinstance(effect, DroppedInEach)


def _surely_off(base: Fit, assumed: frozenset[str]) -> bool:
    """Whether the records say that something is off which nothing has measured."""
    return any(
        identity in assumed and abs(value) > SURELY * std
        for identity, _, value, std in _left_open(base, base)
    )


def _with_held(prepared: Prepared, instruments: Set[str]) -> Fit:
    """The baseline refitted with some instruments held to be right, in all trials and in each."""
    fit = prepared.fit
    kept = {id(fit.model.entries[item.entry][0]) for item in fit.free}
    entries = tuple(
        entry
        for entry in fit.model.entries
        if entry[0].id not in instruments or id(entry[0]) not in kept
    )
    held = [effect for effect, _ in entries]
    stays = [any(one.effect is effect for effect in held) for one in fit.model.own]
    own = tuple(one for one, kept in zip(fit.model.own, stays, strict=True) if kept)
    columns = fit.nuisance.shape[1] - len(stays)
    nuisance = fit.nuisance[:, [True] * columns + stays]
    model = replace(fit.model, entries=entries, own=own)
    start = (nuisance, fit.law_offsets)
    return fit_model(prepared.forward, model, kept_free(fit, model), start)


def _left_open(base: Fit, fit: Fit) -> list[tuple[EffectId | str, Parameter, float, float]]:
    """What the baseline leaves open: (id, parameter, value, standard uncertainty) in a fit."""
    kept = {id(base.model.entries[item.entry][0]) for item in base.free}
    found = []
    for index, item in enumerate(fit.free):
        effect = fit.model.entries[item.entry][0]
        if id(effect) in kept:
            found.append((effect.id, item.parameter, *fit.value(index)))
    return found


def _instruments_off(base: Fit) -> bool:
    return any(
        identity in INSTRUMENTS and abs(value) > NOTEWORTHY * p.width
        for identity, p, value, _ in _left_open(base, base)
    )


def _open_notes(prepared: Prepared, best: Hypothesis | None) -> tuple[str, ...]:
    """What ruler, clock and axes were found off by, where that is more than usual; and a drag.

    Of inputs that were opened because they have evidence, every error that shows.
    """
    fit = prepared.fit if best is None else best.fit
    least = Defaults.MIN_DRAG_COEFFICIENT.known
    found = []
    for identity, p, value, std in _left_open(prepared.fit, fit):
        unit = "" if p.unit == "1" else f" {p.unit}"
        number = f"{p.name} = {value:.2g} ± {std:.1g}{unit}"
        if identity == EffectId.DRAG:
            note = f"the setup gives no drag coefficient, so it was fitted as well: {number}"
            if value + SURELY * std < least:
                note += (
                    f"; bodies have {least:g} or more, so mass, diameter or air may be another's"
                )
            found.append(note)
        elif identity == USUAL_INPUTS:
            if abs(value) > NOTEWORTHY * std:
                found.append(
                    f"{p.name.replace('_', ' ')} of the setup or the instrument: off by"
                    f" {value:.2g} ± {std:.1g}{unit}, in careful laboratories by"
                    f" {p.width:.1g}{unit}. Measure it again"
                )
        elif abs(value) > NOTEWORTHY * p.width:
            found.append(
                f"{identity} was left open: {number}, more than the {p.width:.1g}{unit} of a"
                " careful lab"
            )
    return tuple(found)


def _form_notes(best: Hypothesis | None) -> tuple[str, ...]:
    """How far the forms of the named laws are uncertain, and what that explains of the misfit."""
    if best is None or best.form.size == 0.0 or best.reduced_chi2 < POOR_FIT:
        return ()
    sizes = ", ".join(
        f"{member.id} by {100.0 * best.form.size * member.effect.looseness:.0f} %"
        for member in best.members
        if member.effect.looseness > 0.0
    )
    explained = min(best.form.absorbed / (best.fit.chi2 - best.fit.expected), 1.0)
    return (
        f"forms of the laws are uncertain ({sizes}): this explains {100.0 * explained:.0f} % of the"
        " misfit that remains",
    )


def _aside_notes(naming: Naming) -> tuple[str, ...]:
    """What would have been named if the inputs were exact."""
    if naming.set_aside is None:
        return ()
    ids, lead = naming.set_aside
    names = " and ".join(ids).replace("_", " ")
    return (
        f"usual errors of the stated inputs and instruments explain as much as {names}"
        f" ({lead:.1f} units of evidence ahead), so these errors are left open in every fit",
    )


def _refuse_failing(prepared: Prepared, effect: Effect) -> None:
    """Try a user's effect by itself, so that its own error is reported as its own."""
    refuse_unusable(effect)

    def predict_once() -> FloatArray:
        pool = candidates_for(prepared.forward, prepared.model, [effect], unnamed=False)
        scan(prepared.forward, prepared.fit, pool)
        return _with_small_steps(prepared, pool)

    try:
        seen = within_patience(effect, predict_once)
    except UsageError:
        raise
    except Exception as problem:  # anything may be wrong in a file that a user wrote
        raise UsageError(
            f"the effect {effect.id!r} fails: {type(problem).__name__}: {problem}",
            hint="Its hooks are given arrays that broadcast over trials and parameter sets.",
        ) from problem
    if float(np.abs(seen).max(initial=0.0)) >= OUTSIDE:
        raise UsageError(
            f"the effect {effect.id!r} gives values that are no numbers (NaN or infinite)",
            hint="Its hooks must give finite numbers for every state and every allowed strength.",
        )


def _with_small_steps(prepared: Prepared, pool: Sequence[Candidate]) -> FloatArray:
    """What the records would be with a little of each strength; `OUTSIDE` for what is no number."""
    forward, fit = prepared.forward, prepared.fit
    models = [
        fit.model.having(candidate.effect, moved).order()
        for candidate in pool
        for _, _, moved in steps_of(candidate, start_values(candidate, fit.model))
    ]
    if not models:
        return np.zeros(0)
    nuisance = spread_laws(forward, fit.model, fit.nuisance, fit.law_offsets)
    seen = forward.predict(models, np.broadcast_to(nuisance, (len(models), *nuisance.shape)))
    return np.asarray(seen[:, forward.records.used])


def _of_width(effect: Effect, width: float | None) -> Effect:
    if width is None or not effect.parameters:
        return effect
    first, *others = effect.parameters
    return replace(effect, parameters=(replace(first, width=width), *others))


def _require_enough(campaign: CampaignRecords) -> None:
    rows = sum(trial.samples for trial in campaign.trials)
    if rows < MIN_ROWS:
        raise TooLittleDataError(
            f"{rows} samples in {len(campaign.trials)} trials are too little to determine anything",
            hint=f"At least {MIN_ROWS} samples are needed, better two trials of thirty each.",
        )


def _require_trials(campaign: CampaignRecords, held_out: Sequence[str]) -> None:
    known = {trial.name for trial in campaign.trials}
    unknown = [name for name in held_out if name not in known]
    if unknown:
        raise TooLittleDataError(
            f"there is no trial {', '.join(unknown)} to hold out",
            hint=f"Trials: {', '.join(sorted(known)[:20])}.",
        )
    if known <= set(held_out):
        raise TooLittleDataError(
            "with every trial held out none is left to fit",
            hint="Hold out a few; the others teach the model.",
        )


def _held_mask(campaign: CampaignRecords, names: Sequence[str]) -> np.ndarray | None:
    return np.array([trial.name in names for trial in campaign.trials]) if names else None


@dataclass(frozen=True)
class _Tested:
    """An answer with its proof, its doubts and the probability of each of its names."""

    naming: Naming
    groups: tuple[tuple[str, ...], ...]
    kept: HeldOut | None
    passed: Passed
    evidence: tuple[NameEvidence, ...] = ()
    probabilities: tuple[float, ...] = ()

    @property
    def probability(self) -> float:
        """Of the least probable name; zero where nothing may be named."""
        return min(self.probabilities, default=0.0) if self.passed.names else 0.0

    @property
    def is_enough(self) -> bool:
        """Whether it is more probable than not and leaves no more than noise.

        What leaves more does not take its place: the data refute it, or its form.
        """
        best = self.naming.best
        return best is not None and best.reduced_chi2 < POOR_FIT and self.probability >= 0.5

    @property
    def is_settled(self) -> bool:
        """Whether it is more probable than not, each further name with a proof by prediction.

        A second name may only mend the form of the first.
        """
        proved = all(one.predicted_95[0] > 0.0 for one in self.evidence if one.fellows)
        return proved and self.probability >= 0.5


def _tested(
    prepared: Prepared,
    naming: Naming,
    held: np.ndarray | None,
    known: dict[tuple[int, bytes], Prediction],
) -> _Tested:
    """Test an answer on its remainder, on data kept aside, and against all other sets."""
    forward, base, best = prepared.forward, prepared.fit, naming.best
    groups = _groups(best, naming.rivals())
    if best is None:
        remainder = remainder_of(prepared, best)
        found = not remainder.white and (
            locate(forward, base, best) is not None or base.reduced_chi2 > POOR_FIT
        )
        kind: VerdictKind = "unexplained" if found else "no_mismatch"
        return _Tested(naming, (), None, pass_gate(prepared, best, kind, None))
    if forward.mode == "flight" and naming.suspects():
        first = min(best.ids, key=lambda one: one in MEASUREMENT_IDS)
        blamed = (first, *naming.suspects())
        if not any(set(blamed) <= set(group) for group in groups):
            groups = (*groups, blamed)
    folds, predictions = predict(forward, base, sets_to_predict(naming), held, known)
    kept = hold_out(forward, base, best, held, known=(folds, predictions))
    kind = "ambiguous" if groups else "explained"
    passed = pass_gate(prepared, best, kind, kept, outdone=naming.outdone)
    evidence = evidence_for_names(forward, base, naming, predictions, bool(passed.against))
    probabilities = tuple(min(calibrated_probability(one), passed.most) for one in evidence)
    through = passed.beside(evidence[0].gain, evidence[0].structure)
    return _Tested(naming, groups, kept, through, evidence, probabilities)


def _tested_answers(
    prepared: Prepared, naming: Naming, held: np.ndarray | None
) -> tuple[_Tested, ...]:
    """The answer of the search and, where that is not settled, its best alternatives.

    Names compete with forces without a name, and with fewer or more names: what is in no catalogue
    is an answer as well, and so is one law that averages two, or two that one averages.
    """
    known: dict[tuple[int, bytes], Prediction] = {}
    first = _tested(prepared, naming, held, known)
    if naming.best is None or first.is_settled:
        return (first,)
    others = (other_kind(naming, naming.best), *other_sizes(naming, naming.best))
    found = {id(one): one for one in others if one is not None}
    more = (replace(naming, best=one) for one in found.values())
    return first, *(_tested(prepared, one, held, known) for one in more)


def _preferred(answers: Sequence[_Tested]) -> _Tested:
    """The most probable answer that is enough, or of all where none is."""
    return max(answers, key=lambda one: (one.is_enough, one.probability))


def _verdict(campaign: CampaignRecords, prepared: Prepared, tested: _Tested) -> EngineVerdict:
    naming, groups, passed = tested.naming, tested.groups, tested.passed
    forward, base, best = prepared.forward, prepared.fit, naming.best
    kept = tested.kept
    if kept is not None:
        kept = replace(kept, trials=tuple(campaign.trials[int(i)].name for i in kept.trials))
    first = None if best is None else best.members[_strongest_first(best)[0]].effect
    location = locate(forward, base, best, first)
    remainder = remainder_of(prepared, best)
    names = [trial.name for trial in campaign.trials]
    effects = _named(forward, naming, tested, names)
    if passed.doubts:
        reasons = "; ".join(doubt.value for doubt in passed.doubts)
        remainder = replace(
            remainder,
            statement=f"{remainder.statement} {_WHY[passed.kind]}: {reasons}.",
        )
    if not passed.names:
        groups = ()
    kind = passed.kind
    if kind == "explained" and passed.against:
        kind = "ambiguous"
    if kind == "explained" and any(effect.probability < 0.5 for effect in effects):
        # Less likely than not is no finding.
        kind = "ambiguous"
        statement = f"{remainder.statement} {_WHY[kind]}: {Doubt.UNLIKELY.value}."
        remainder = replace(remainder, statement=statement)
    floating = _floating_notes(forward)
    repeats = repeats_of(forward, base if best is None else best.fit)
    lacks = repeats is not None and repeats.lacks
    if kind == "no_mismatch" and lacks:
        kind, remainder = "unexplained", replace(remainder, white=False)
    if kind == "unexplained" and (location is None or not passed.names):
        # a ruler or clock that nobody believes in takes up what it can, in whichever direction
        off = _instruments_off(base)
        right = _with_held(prepared, INSTRUMENTS) if off else base
        location = where_it_is_largest(forward, right)
    return EngineVerdict(
        kind,
        ("gravity", *prepared.model.ids),
        base.chi2 / base.expected,
        location if kind != "no_mismatch" else None,
        effects,
        _alternatives(naming, passed),
        groups,
        _next_measurement(naming, groups, kind, passed.doubts, floats=bool(floating))
        or (IN_ANOTHER_ORDER if lacks else None),
        kept,
        remainder,
        (
            *campaign.notes,
            *noise_notes(campaign, prepared),
            *sizes_in_words(forward),
            *floating,
            *_setup_notes(forward, best, passed),
            *(_start_notes(naming) if effects else ()),
            *(() if repeats is None else (repeats.in_words,)),
        ),
        passed.doubts,
    )


_WHY: Mapping[VerdictKind, str] = {
    "unexplained": "Nothing is named",
    "ambiguous": "What is named is in doubt",
    "explained": "What is named is in doubt",
    "no_mismatch": "This is in doubt",
}


def _groups(best: Hypothesis | None, rivals: Sequence[Hypothesis]) -> tuple[tuple[str, ...], ...]:
    """Ids that may stand for each other, one group for each member that has alternatives."""
    if best is None:
        return ()
    phases = {member.id: member.effect.phase for one in (best, *rivals) for member in one.members}
    groups: list[list[str]] = [[one] for one in best.ids]

    def apart(pairs: Sequence[tuple[str, str]]) -> tuple[int, int]:
        other_kind = sum(phases[mine] != phases[other] for mine, other in pairs)
        return other_kind, sum(other not in groups[best.ids.index(mine)] for mine, other in pairs)

    # A candidate that differs in one name shows whose place it takes; of two, each its kind's.
    for rival in sorted(rivals, key=lambda one: len(set(best.ids) - set(one.ids))):
        left = [one for one in best.ids if one not in rival.ids]
        theirs = [one for one in rival.ids if one not in best.ids]
        # One law may stand for two, and two for one.
        size = max(len(left), len(theirs))
        pairings = [list(zip(_filled(left, size), _filled(order, size), strict=True))
                for order in permutations(theirs)]  # fmt: skip
        for mine, other in min(pairings, key=apart):
            group = groups[best.ids.index(mine)]
            if other not in group:
                group.append(other)
    return tuple(tuple(group) for group in groups if len(group) > 1)


def _filled(names: Sequence[str], size: int) -> tuple[str, ...]:
    """Names in order, the last one repeated."""
    return tuple(names[min(k, len(names) - 1)] for k in range(size))


def _floating_notes(forward: Forward) -> tuple[str, ...]:
    """Stated bodies that are lighter than the air they displace."""
    if forward.mode == "swing":
        return ()
    lighter = forward.displaced >= 1.0
    names = dict.fromkeys(
        forward.records.ball_names[int(k)] or "the body"
        for k in forward.records.ball_index[lighter]
    )
    if not names:
        return ()
    times = float(forward.displaced.max())
    return (
        f"{', '.join(names)}: as a ball of the stated diameter it displaces {times:.2g} times its"
        " own mass of air, so it would rise. Mass or diameter is wrong, or the body is hollow or"
        " flat; buoyancy is not tried. Check [ball] in the setup.",
    )


def _setup_notes(forward: Forward, best: Hypothesis | None, passed: Passed) -> tuple[str, ...]:
    if Doubt.PENDULUMS_WEIGHT in passed.doubts:
        return (Doubt.PENDULUMS_WEIGHT.value,)
    if best is None or forward.mode != "impact" or best.reduced_chi2 < HINT:
        return ()
    return (
        "nothing comes near the noise: check pendulum, support and balls in the setup before"
        " believing a name",
    )


def _start_notes(naming: Naming) -> tuple[str, ...]:
    """Whether the answer's fit was reached from one start alone."""
    if naming.best is None or naming.agreed > 1:
        return ()
    return (
        "the fit of what is named was reached from one start alone, others ended worse: it may not"
        " be the best there is",
    )


def _law_error(identity: str) -> float:
    """Relative uncertainty of a strength because the law differs from apparatus to apparatus."""
    return 0.02 if identity in LOOSE_LAWS else 0.0


def _strengths_of_each(
    forward: Forward, fit: Fit, effect: Effect, trials: Sequence[str]
) -> StrengthsOfEach | None:
    own = own_values(forward, fit, effect)
    if own is None:
        return None
    units = {p.name: p.unit for p in effect.parameters}
    names = trials if effect.level is Level.TRIAL else forward.records.groups(effect.level)[1]
    return StrengthsOfEach(
        effect.level.value,
        {name: float(size) for name, size in zip(own.names, own.spread, strict=True)},
        {
            name: tuple(
                ParameterValue(p, float(own.value[row, k]), float(own.std[row, k]), units[p])
                for k, p in enumerate(own.names)
            )
            for row, name in enumerate(names)
        },
    )


def _named(
    forward: Forward, naming: Naming, tested: _Tested, trials: Sequence[str]
) -> tuple[NamedEffect, ...]:
    best = naming.best
    if best is None or not tested.passed.names:
        return ()
    named = []
    spreads = robust_spread(forward, best.fit)
    for member, probability in zip(best.members, tested.probabilities, strict=True):
        parameters = []
        for index, item in enumerate(best.fit.free):
            if best.fit.model.entries[item.entry][0] is member.effect:
                value, std = best.fit.value(index)
                p = item.parameter
                std = float(np.hypot(max(std, spreads[index]), _law_error(member.id) * value))
                known = not p.is_shape or std <= MAX_SHAPE_STD * p.scale
                parameters.append(ParameterValue(p.name, value, std, p.unit, known))
        statement = member.effect.statement
        if member.id == EffectId.UNNAMED:
            statement = _law_in_words(member.effect, parameters)
        each = _strengths_of_each(forward, best.fit, member.effect, trials)
        named.append(
            NamedEffect(
                member.id, statement, probability, tuple(parameters), member.effect.form, each
            )
        )
    return tuple(named[i] for i in _strongest_first(best))


def _strongest_first(best: Hypothesis) -> list[int]:
    """Places of the members, that of the surest strength first."""
    return sorted(range(len(best.members)), key=lambda i: -_own_gain(best, i))


def _own_gain(best: Hypothesis, index: int) -> float:
    """How many sigma the strongest strength of a member is from neutral."""
    effect = best.members[index].effect
    sizes = [0.0]
    for k, item in enumerate(best.fit.free):
        if best.fit.model.entries[item.entry][0] is effect and not item.parameter.is_shape:
            value, std = best.fit.value(k)
            sizes.append(abs(value - item.parameter.neutral) / max(std, 1e-300))
    return max(sizes)


_PLAIN = (
    (r"\\t?frac\{([^{}]*)\}\{([^{}]*)\}", r"\1/\2"),
    (r"\\tfrac(\d)(\d)", r"\1/\2"),
    (r"e\^\{((?:[^{}])*)\}", r"exp(\1)"),
    (r"\\mathrm\{([^{}]*)\}", r"\1"),
    (r"\\(?:mathbf|quad|,|;| )", " "),
    (r"\\lambda", "λ"),
    (r"\\varphi", "φ"),
    (r"\\tau", "τ"),
    (r"[{}\\]", ""),
    (r"\s+", " "),
)


def _plain(law: str) -> str:
    """A formula without the marks that typeset it."""
    for pattern, instead in _PLAIN:
        law = re.sub(pattern, instead, law)
    return law.strip()


def _law_in_words(effect: Effect, parameters: Sequence[ParameterValue]) -> str:
    if isinstance(effect, SmoothCurve):
        curve = effect.in_words({p.name: p.value for p in parameters})
        where = effect.form.replace("_", " ")
        return f"No known effect fits. {effect.statement} Direction: {where}. The curve: {curve}."
    numbers = ", ".join(
        f"{p.name} = {p.value:.4g} {p.unit if p.unit != '1' else ''}".rstrip()
        if p.determined
        else p.in_words
        for p in parameters
    )
    where = effect.form.replace("_", " ")
    law = f"{_plain(effect.law)}, {numbers}"
    return f"No known effect fits. {effect.statement} Direction: {where}. Law: {law}."


def _alternatives(naming: Naming, passed: Passed) -> tuple[Alternative, ...]:
    best = naming.best
    if best is None:
        return _too_weak(naming)
    rows, rivals = [], naming.rivals()
    if not passed.names:
        rows.append(Alternative(best.ids, "; ".join(d.value for d in passed.doubts), 0.0))
    seen = {tuple(sorted(best.ids))}
    for h in naming.tried:
        key = tuple(sorted(h.ids))
        if key in seen:
            continue
        seen.add(key)
        behind = best.penalised_gain - h.penalised_gain
        if not h.allowed:
            why = "its parameters leave what nature allows"
        elif h in rivals:
            why = "not excluded: the data cannot distinguish it"
        elif len(h.members) > len(best.members) and behind < 60.0:
            why = "the further effect explains no more than chance or an imperfect law would"
        elif best.gain > h.gain:
            why = f"fits worse by {best.gain - h.gain:.1f} in chi-square"
        else:
            why = "fits alike, but with more freedom, or with sizes that are rarely met"
        rows.append(Alternative(h.ids, why, behind))
    listed = rows[:MAX_ALTERNATIVES]
    nameless = [one for one in rows if EffectId.UNNAMED in one.ids][:1]
    if not best.has_unnamed and nameless and nameless[0] not in listed:
        listed[-1] = nameless[0]
    return tuple(listed)


def _too_weak(naming: Naming) -> tuple[Alternative, ...]:
    """What came nearest to being named, and the evidence that it lacks."""
    rows = []
    if naming.set_aside is not None:
        why = "usual errors of the stated inputs and instruments explain as much"
        ids, lead = naming.set_aside
        rows.append(Alternative(ids, why, lead))
    why = "explains no more than chance does in one campaign of a hundred"
    rows += [
        Alternative(ids, why, naming.threshold - evidence)
        for ids, evidence in naming.nearest().items()
        if evidence < naming.threshold
    ]
    return tuple(rows[:MAX_ALTERNATIVES])


REMEDIES: Mapping[Doubt, str] = {
    Doubt.ONE_RECORD: "at least two more trials under the same conditions",
    Doubt.SHAPE_OF_ONE: "at least two more trials under the same conditions",
    Doubt.UNPROVED: "at least two more trials under the same conditions",
    Doubt.UNSTEADY: "several trials at one setting, to see whether the strength differs between"
    " repeats or between settings",
    Doubt.UNDETERMINED: "trials that pass the same place at another speed or height",
    Doubt.KEEPS_TIME: "one angle with a protractor, to see whether phi_rad is in radians",
    Doubt.UNKNOWN_CALIBRATION: "a ruler in the plane of motion and a clock in view",
    Doubt.OUTDONE: "mass and diameter of the body, density of the air, and a ruler in the plane",
    Doubt.PENDULUMS_WEIGHT: "the period of small swings, which determines the inertia",
    Doubt.NOISE: "a record with less noise: a camera nearer, more light, a shorter exposure",
}
"""Doubt → what to measure against it."""


def _next_measurement(
    naming: Naming,
    groups: tuple[tuple[str, ...], ...],
    kind: VerdictKind,
    doubts: Sequence[Doubt],
    *,
    floats: bool,
) -> str | None:
    """What would separate the answers, or remove the doubts; None where nothing is in doubt."""
    best = naming.best
    texts = list[str]()
    if best is not None and groups:
        grouped = {one for group in groups for one in group}
        texts = _separating((best, *naming.rivals()), grouped)
    elif kind in ("ambiguous", "unexplained"):
        texts = [REMEDIES[doubt] for doubt in doubts if doubt in REMEDIES]
        if best is not None:
            others = (other_kind(naming, best), *other_sizes(naming, best))
            texts += _separating((best, *(one for one in others if one is not None)), None)
    if floats and kind != "no_mismatch":
        texts.insert(0, "the body on a balance, and its diameter")
    return "; or ".join(list(dict.fromkeys(texts))[:3]) or None


def _separating(sets: Sequence[Hypothesis], among: Set[str] | None) -> list[str]:
    """What separates laws from others, of those `among` some ids, or of all."""
    members = [member for h in sets for member in h.members]
    texts = [m.effect.separating for m in members if among is None or m.id in among]
    return [text for text in dict.fromkeys(texts) if text]
