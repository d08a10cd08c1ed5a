"""Fit sets of effects and compute their evidence, errors of form integrated out.

A law is right up to a form that differs between laboratories. Its error is the law times a smooth
function of its own coordinate (Legendre polynomials with Gaussian weights).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from metrology import Defaults
from mismatch.candidates import Candidate, start_values, steps_of
from mismatch.fitting.fit import (
    LOST,
    Ending,
    Fit,
    SwingStart,
    free_parameters,
    inverse_of,
    kept_free,
    seen_in_halves,
)
from mismatch.fitting.scan import (
    Scan,
    fit_with_levels,
    price,
    price_of_levels,
    scan,
    slopes_left,
    with_own_strengths,
)
from mismatch.forward import ByTrial, Forward, ForwardModel
from physics.domain import FloatArray, Number, Vector
from physics.effects import (
    CATALOGUE,
    CameraView,
    Contact,
    Coordinate,
    Effect,
    EffectId,
    FlightState,
    Form,
    Outcome,
    Parameter,
    SwingState,
    Values,
)
from physics.effects.flight import Drag
from physics.effects.swing import BearingFriction

__all__ = [
    "EXPECTED",
    "FIRST_REACH",
    "FIRST_SHARE",
    "LOOSE_LAWS",
    "MEMBER_PENALTY",
    "POOR_FIT",
    "SURELY",
    "WHOLE_ROUNDS",
    "Hypothesis",
    "as_fitted",
    "evidence_of_uneven_losses",
    "fit_hypothesis",
    "form_evidence",
    "group_tolerance",
    "is_distinct",
    "is_known",
    "least_gain",
    "left_by_forms",
    "left_by_uneven_losses",
    "null_threshold",
    "price_of_weights",
    "scan_beyond_forms",
    "second_effect_share",
]

ORDERS = (1, 2, 3)

"""Orders of the Legendre polynomials that a law's form may be off by: straight, bent once, bent
twice."""

IMPACT_ORDERS = (0, 1)

SIDEWAYS = frozenset({"z", "vz"})

"""Parts of an outcome that no face moves: a strike is planar."""

PARTS = tuple(f.name for f in fields(Outcome) if f.name not in SIDEWAYS)

WEIGHT = Parameter("weight", "1", 0.1, -1e6, 1e6, meaning="relative error of the form")


@dataclass(frozen=True)
class FormError(Effect):
    """One smooth relative error of a law that a model holds.

    Attributes
    ----------
    of : Effect
        The law.
    held : tuple of (name, value)
        Its parameters where the error is tried.
    hook : str
        Which of its hooks.
    order : int
        Of the polynomial.
    low, high : float
        Range of the coordinate.
    part : str
        Of what a contact hands over; "" otherwise.
    """

    of: Effect | None = None
    held: tuple[tuple[str, float], ...] = ()
    hook: str = "force"
    order: int = 1
    low: float = 0.0
    high: float = 1.0
    part: str = ""

    def of_trials(self, rows: NDArray[np.int64]) -> Effect:
        """The error of the law for some trials alone."""
        return replace(self, of=self.of.of_trials(rows)) if isinstance(self.of, ByTrial) else self

    @property
    def hooks(self) -> frozenset[str]:
        """The one hook."""
        return frozenset({self.hook})

    @property
    def _law(self) -> Effect:
        if self.of is None:
            raise TypeError("an error of a form needs a law that it belongs to")
        return self.of

    @property
    def _held(self) -> Mapping[str, float]:
        return dict(self.held)

    def _smooth(self, coordinate: Number) -> FloatArray:
        middle, half = 0.5 * (self.low + self.high), 0.5 * max(self.high - self.low, 1e-12)
        place = np.clip((np.asarray(coordinate, dtype=np.float64) - middle) / half, -1.2, 1.2)
        weights = np.zeros(self.order + 1)
        weights[-1] = 1.0
        return np.asarray(legendre.legval(place, weights))

    def force(self, values: Values, flight: FlightState) -> Vector:
        """The law's force times the error."""
        k = values["weight"] * self._smooth(flight.along(self._law.coordinate))
        fx, fy, fz = self._law.force(self._held, flight)
        return k * fx, k * fy, k * fz

    def torque(self, values: Values, swing: SwingState) -> Number:
        """The law's torque times the error."""
        rate = self._law.coordinate is Coordinate.RATE
        place = np.abs(swing.omega) if rate else np.asarray(swing.phi)
        return values["weight"] * self._smooth(place) * self._law.torque(self._held, swing)

    def contact(self, values: Values, contact: Contact, outcome: Outcome) -> Outcome:
        """One part of the outcome off by a share of what the law changes."""
        changed = self._law.contact(self._held, contact, outcome)
        size = _sizes(contact, outcome, changed)[self.part]
        smooth = self._smooth(contact.impact_speed)
        return replace(
            outcome, **{self.part: getattr(outcome, self.part) + values["weight"] * smooth * size}
        )

    def clock(self, values: Values, time: Number) -> Number:
        """The law's change of the clock times the error."""
        return time + values["weight"] * self._smooth(time) * (
            self._law.clock(self._held, time) - time
        )

    def image(self, values: Values, view: CameraView) -> Vector:
        """The law's displacement times the error, along its direction."""
        k = values["weight"] * self._smooth((view.x - view.centre_x) / view.half_width)
        x, y, z = self._law.image(self._held, view)
        return view.x + k * (x - view.x), view.y + k * (y - view.y), view.z + k * (z - view.z)


def _sizes(contact: Contact, before: Outcome, after: Outcome) -> dict[str, FloatArray]:
    """How large an error of each part is, when the whole change is taken for unsure.

    The pendulum's speed is off by what changes it, and by what the ball, pushed otherwise, gives
    back: a support that kicks the ball alone leaves the heavy pendulum nearly as it was.
    """
    moved = {name: np.asarray(getattr(after, name) - getattr(before, name)) for name in PARTS}
    speed = np.sqrt(
        np.square(moved["vx"]) + np.square(moved["vy"]) + np.square(moved["pendulum_speed"])
    )
    pushed = np.hypot(moved["vx"], moved["vy"])
    returned = np.hypot(moved["pendulum_speed"], contact.ball_mass / contact.inertial_mass * pushed)
    gap = np.asarray(before.contact_time)
    longer = np.abs(moved["contact_time"]) + speed / np.maximum(contact.impact_speed, 1e-6) * gap
    path = np.hypot(moved["x"], moved["y"]) + 0.5 * gap * speed
    angle = np.abs(moved["pendulum_angle"]) + 0.5 * gap * returned / contact.length
    return {
        "vx": speed, "vy": speed, "pendulum_speed": returned, "x": path, "y": path,
        "contact_time": longer, "pendulum_angle": angle,
    }  # fmt: skip


def form_errors(forward: Forward, law: Effect, values: Mapping[str, float]) -> tuple[Effect, ...]:
    """Every error that a law's form may have, for the campaign that `forward` predicts.

    None where the law is declared exact.
    """
    if law.looseness <= 0.0:
        return ()
    held = tuple((name, float(value)) for name, value in values.items())
    blank = FormError(
        "form_error", "", "", "", law.phase, (WEIGHT,), sharp=law.sharp, of=law, held=held
    )
    found: list[Effect] = []
    if "contact" in law.hooks:
        speeds = forward.nominal_speed()
        low, high = float(speeds.min()), float(speeds.max())
        found += [
            replace(blank, hook="contact", part=part, order=order, low=low, high=high)
            for part in PARTS
            for order in IMPACT_ORDERS
        ]
    spans = {
        "force": forward.flight_span(law.coordinate),
        "torque": forward.swing_span(law.coordinate),
        "clock": (0.0, float(np.median(forward.flight_time))),
        "image": (-1.0, 1.0),
    }
    for hook in sorted(law.hooks & spans.keys()):
        low, high = spans[hook]
        found += [replace(blank, hook=hook, order=n, low=low, high=high) for n in ORDERS]
    return tuple(found)


SIZES = (0.0, 0.25, 0.5, 1.0, 2.0)

"""Errors of a form in units of what is usual for the law; each as likely as the others."""


@dataclass(frozen=True)
class FormEvidence:
    """What a set of laws gains when their forms need not be quite right.

    Attributes
    ----------
    gain : float
        Twice the logarithm of the evidence over that of exact forms (chi-square units).
    absorbed : float
        Chi-square that the errors take up at their most probable size.
    size : float
        That size, in units of what is usual for the laws.
    """

    gain: float = 0.0
    absorbed: float = 0.0
    size: float = 0.0


EXACT = FormEvidence()

"""Of laws whose forms are held to be exact."""


def loose_candidates(
    forward: Forward, fit: Fit, laws: Sequence[Effect]
) -> tuple[tuple[Candidate, ...], FloatArray]:
    """Errors of the forms of laws that a fit holds, and the usual size of each, (n,)."""
    found: list[Candidate] = []
    sizes: list[float] = []
    for effect, values in fit.model.entries:
        if any(effect is one for one in laws):
            errors = form_errors(forward, effect, values)
            found += [Candidate(error) for error in errors]
            sizes += [effect.looseness] * len(errors)
    return tuple(found), np.array(sizes)


def form_evidence(forward: Forward, fit: Fit, laws: Sequence[Effect]) -> FormEvidence:
    """Evidence of a fit with the forms of `laws` loose, over that with exact forms.

    Around the fit the records are linear in the weights, and everything else that was fitted is
    marginalised; a Gaussian prior on the weights makes the integral exact.
    """
    errors, usual = loose_candidates(forward, fit, laws)
    if not errors:
        return EXACT
    scored = scan(forward, fit, errors)
    return _evidence_of_errors(scored.information, scored.score, usual)


def _evidence_of_errors(
    information: FloatArray, score: FloatArray, usual: FloatArray
) -> FormEvidence:
    """Of errors of usual sizes (n,), by the information on them and their score."""
    matrix = information * usual[:, None] * usual
    vector = score * usual
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    values, along = np.maximum(values, 0.0), np.square(vectors.T @ vector)
    gains, taken = [], []
    for size in SIZES:
        shrunk = size**2 / (1.0 + size**2 * values)
        gains.append(float(np.sum(along * shrunk - np.log1p(size**2 * values))))
        taken.append(float(np.sum(along * shrunk * (2.0 - values * shrunk))))
    top = max(gains)
    mean = top + 2.0 * float(np.log(np.mean(np.exp(0.5 * (np.array(gains) - top)))))
    best = int(np.argmax(gains))
    # Whatever the forms are off by, the exact ones stay among what is averaged.
    return FormEvidence(max(mean, -2.0 * float(np.log(len(SIZES)))), taken[best], SIZES[best])


def scan_beyond_forms(
    forward: Forward, fit: Fit, laws: Sequence[Effect], size: float, pool: Sequence[Candidate]
) -> Scan:
    """Score candidates by what they explain beyond errors of the forms of `laws`.

    Parameters
    ----------
    size : float
        Of the errors, in units of what is usual for the laws.
    """
    errors, usual = loose_candidates(forward, fit, laws)
    if not errors or size == 0.0:
        return scan(forward, fit, pool)
    both = scan(forward, fit, (*pool, *errors))
    first = both.score.size - len(errors)
    inner = both.information[first:, first:] + np.diag(1.0 / np.square(size * usual))
    cross = both.information[first:, :first]
    middle = np.linalg.solve(inner, cross)
    return replace(
        both,
        candidates=tuple(pool),
        columns=both.columns[: len(pool)],
        information=both.information[:first, :first] - cross.T @ middle,
        score=both.score[:first] - middle.T @ both.score[first:],
        start=both.start[:first],
        scattered=both.scattered[: len(pool)],
    )


def left_by_forms(forward: Forward, fit: Fit, laws: Sequence[Effect], further: Candidate) -> float:
    """What a further law gains on average from laws whose forms are off by twice what is usual.

    Laws that state no error of their form say nothing of what they leave: it may be anything.

    Returns
    -------
    float
        Chi-square units. Errors of the forms are Gaussian; they pass for the further law, in the
        direction that it is found in, as far as they do the same in units of the noise, with
        everything else projected out.
    """
    errors, usual = loose_candidates(forward, fit, laws)
    if not errors:
        return np.inf
    both = scan(forward, fit, (further, *errors))
    first = both.score.size - len(errors)
    alone = both.information[:first, :first]
    along = np.linalg.pinv(alone, rcond=1e-9, hermitian=True) @ both.score[:first]
    whole = float(along @ alone @ along)
    made = SIZES[-1] * usual * (both.information[first:, :first] @ along)
    return float(made @ made) / whole if whole > 0.0 else np.inf


USUAL_ORDERS = (0, 1, 2)

"""Orders of the Legendre polynomials by which a release's losses differ from those of a law: their
level, their drift while the swing dies away, and its bend."""


@dataclass(frozen=True)
class UnevenLosses(Effect):
    """What a release loses otherwise than a law says, as a smooth share of its own energy.

    Attributes
    ----------
    of, held
        As in `FormError`.
    order : int
        Of the polynomial.
    pace : float
        Angular frequency of small swings, rad/s.
    low, high : tuple of float
        Range of each trial's energy over the inertia, 1/s².
    """

    of: Effect = field(default_factory=BearingFriction)
    held: tuple[tuple[str, float], ...] = ()
    order: int = 0
    pace: float = 1.0
    low: tuple[float, ...] = (0.0,)
    high: tuple[float, ...] = (1.0,)

    def torque(self, values: Values, swing: SwingState) -> Number:
        """The law's torque times the share."""
        trial = np.rint((np.asarray(swing.order) + 0.5) * (len(self.low) - 1)).astype(int)
        low, high = np.array(self.low)[trial], np.array(self.high)[trial]
        energy = 0.5 * np.square(swing.omega) + self.pace**2 * (1.0 - np.cos(swing.phi))
        middle, half = 0.5 * (low + high), 0.5 * np.maximum(high - low, 1e-12)
        weights = np.zeros(self.order + 1)
        weights[-1] = 1.0
        share = legendre.legval(np.clip((energy - middle) / half, -1.2, 1.2), weights)
        return np.asarray(values["weight"] * share * self.of.torque(dict(self.held), swing))


def _uneven_losses(forward: Forward, fit: Fit, laws: Sequence[Effect]) -> tuple[Fit, list[Effect]]:
    """How a release's losses may differ from laws that go with the rate, and those held in shape.

    A fall of friction with the rate, left open, could take up what the law as it is leaves.
    """
    widest = np.array([one.amplitude for one in seen_in_halves(forward.records)])
    energy = forward.small_rate**2 * (1.0 - np.cos(np.minimum(widest, np.pi)))
    high, half = energy[::2], energy[1::2]
    blank = UnevenLosses(
        "uneven_losses", "", "", "", "swing", (WEIGHT,), pace=forward.small_rate,
        low=tuple(np.clip(2.0 * half - high, 0.0, half)), high=tuple(high),
    )  # fmt: skip
    found = [
        replace(blank, of=law, held=tuple((k, float(v)) for k, v in values.items()), order=order)
        for law, values in fit.model.entries
        if law.coordinate is Coordinate.RATE and any(law is one for one in laws)
        for order in USUAL_ORDERS
    ]
    fit = replace(fit, free=tuple(item for item in fit.free if not item.parameter.is_shape))
    return fit, list(found)


def left_by_uneven_losses(
    forward: Forward, fit: Fit, laws: Sequence[Effect], further: Candidate
) -> float:
    """What a further law gains on average from losses that differ by twice what is usual.

    As `left_by_forms`, for free swings: there the powers of the rate are laws of their own, but no
    bearing stays the same from release to release or while a swing dies away. Nothing is known of
    what laws leave that are no losses.
    """
    fit, errors = _uneven_losses(forward, fit, laws)
    if not errors:
        return np.inf
    steps = steps_of(further, start_values(further, fit.model))
    moved = [(further.effect, values, step) for _, step, values in steps]
    moved += [(error, {WEIGHT.name: UNEVEN_STEP}, UNEVEN_STEP) for error in errors]
    models = [fit.model.having(effect, values).order() for effect, values, _ in moved]
    slopes, beyond, residual = slopes_left(forward, fit, models, [step for *_, step in moved])
    mine, losses = beyond[..., : len(steps)], slopes[..., len(steps) :]
    information = np.einsum("tmn,tmk->nk", slopes[..., : len(steps)], mine)
    along = inverse_of(information) @ np.einsum("tmn,tm->n", mine, residual)
    whole = float(along @ information @ along)
    made = np.einsum("tmk,tm->tk", losses, mine @ along)
    size = SIZES[-1] * Defaults.BEARING_REPEATS.std
    return size**2 * float(np.sum(np.square(made))) / whole if whole > 0.0 else np.inf


def evidence_of_uneven_losses(forward: Forward, fit: Fit, laws: Sequence[Effect]) -> float:
    """Evidence (chi-square units) of losses that each release has a little of its own of.

    Over that of losses that are as the laws say, as `form_evidence`.
    """
    fit, errors = _uneven_losses(forward, fit, laws)
    if not errors:
        return 0.0
    models = [fit.model.having(one, {WEIGHT.name: UNEVEN_STEP}).order() for one in errors]
    steps = [UNEVEN_STEP] * len(models)
    slopes, beyond, residual = slopes_left(forward, fit, models, steps, each=True)
    information = np.einsum("tmn,tmk->nk", slopes, beyond)
    score = np.einsum("tmn,tm->n", beyond, residual)
    usual = np.full(score.size, Defaults.BEARING_REPEATS.std)
    return _evidence_of_errors(information, score, usual).gain


UNEVEN_STEP = 1e-3

"""Step of a difference by a share of the losses."""

MEMBER_PENALTY = 9.0

"""Chi-square that each further effect must pay, ln n for a few thousand rows (BIC)."""

DRAWS = 4000

"""Draws: an evidence is then good to about 2 % of itself."""

FALSE_ALARMS = 0.01

"""Share of blameless campaigns in which chance may exceed the threshold, for whole catalogues."""

CERTAIN_GAIN = 6.6

"""What the penalised gain of one effect with a sign exceeds by chance in half a per cent."""

FIRST_REACH = 40.0

"""Chi-square units behind the best answer, after the first steps, from which more bring no law
back."""

FIRST_SHARE = 0.03

"""Likewise as a fraction of the best one's gain, where misfits are large."""

BEHIND = 2.0
"""Misfit over that of the best fit so far from which a set of laws of a swing is left, if steps
that gain as much as the last one would leave it there. Chosen: sets end near the noise or far off;
laws alone are followed to their end, since each may be half of the answer."""

WHOLE_ROUNDS = 8

"""Steps from which a fit is meant to reach its end, not to be a first score."""

MAX_RELEASES = 8

"""Restarts of a fit whose shapes moved. Chosen; the taut thread of the third world needs five, and
further ones gain less than `SLACK`."""

SLACK = 1.0

"""Chi-square units by which rounding and unfinished steps may leave a fit above where it began."""

EXPECTED = 6.0

"""Chi-square units, odds of one to twenty, against an answer that does without what nature always
has: what a law in no catalogue pays for being rare."""

POOR_FIT = 1.5

"""Chi-square per entry from which what is left over is a fault of the law, not noise."""

FAR_WORSE = 4.0

"""Misfit over that of the best answer, both beyond the noise, from which an answer is out."""

LOOSE_LAWS = frozenset(
    {
        "drag_crisis", "lens_distortion", "dropped_frames", "support_friction", "support_recoil",
        "effective_mass", "camera_roll", "rolling_shutter", "oblique_impact",
        "contact_displacement",
    }
)  # fmt: skip

"""Ids whose law differs from one apparatus to the next, so that a fit leaves a part of it over."""


@dataclass(frozen=True)
class Hypothesis:
    """A set of effects, fitted.

    Attributes
    ----------
    members : tuple of Candidate
        What is said to be missing.
    fit : Fit
        The model with them in it.
    gain : float
        Objective of the refitted baseline minus that of this fit (chi-square units).
    form : FormEvidence
        What it gains once the forms of its laws need not be quite right.
    lacking : tuple of str
        What nature always has, and neither the baseline nor the answer holds.
    airless : bool
        Whether air is said to act that, by the same records, does not resist.
    """

    members: tuple[Candidate, ...]
    fit: Fit
    gain: float
    form: FormEvidence = EXACT
    lacking: tuple[str, ...] = ()
    airless: bool = False

    @property
    def ids(self) -> tuple[str, ...]:
        """Ids, in order."""
        return tuple(member.id for member in self.members)

    @property
    def penalised_gain(self) -> float:
        """Gain less what freedom, size of the set and unlikely strengths cost."""
        penalties = sum(member.complexity_penalty for member in self.members) + EXPECTED * len(
            self.lacking
        )
        further = sum(not is_known(member.effect) for member in self.members) - 1
        gain = self.gain + self.form.gain
        return (
            gain
            - penalties
            - MEMBER_PENALTY * max(further, 0)
            - self.reduced_chi2 * self.prior_penalty
        )

    @property
    def prior_penalty(self) -> float:
        """What the fitted strengths cost by their priors (chi-square units at no misfit)."""
        added = [member.effect for member in self.members]
        values = {
            id(item.parameter): (item.parameter, self.fit.value(index)[0])
            for index, item in enumerate(self.fit.free)
            if any(self.fit.model.entries[item.entry][0] is effect for effect in added)
        }
        # What has an expected value is held to it by the fit itself.
        strengths = [v for v in values.values() if not v[0].is_shape and v[0].expected is None]
        return sum(p.prior_penalty(value) for p, value in strengths)

    @property
    def reduced_chi2(self) -> float:
        """Misfit of the fit as it is reported; errors of form take nothing off it."""
        return self.fit.reduced_chi2

    @property
    def allowed(self) -> bool:
        """Whether all parameters are within what nature allows and practice knows."""
        found = self.fit.believable and self.fit.ending is not Ending.LOST and not self.airless
        return found and self.fit.model.scatters_within_reason

    @property
    def forbidden(self) -> bool:
        """Whether nature or practice forbids what was fitted, though the fit itself is sound."""
        sound = self.fit.ending is Ending.CONVERGED and self.fit.model.scatters_within_reason
        known = bool(np.isfinite(self.fit.covariance).all())
        return sound and known and (self.airless or not self.fit.believable)

    @property
    def quality(self) -> float:
        """Penalised gain by the data alone, unlikely strengths not counted against it."""
        return self.penalised_gain + self.reduced_chi2 * self.prior_penalty

    @property
    def has_unnamed(self) -> bool:
        """Whether a force in no catalogue is part of it."""
        return EffectId.UNNAMED in self.ids


def is_known(effect: Effect) -> bool:
    """Whether nature is known to give the effect its size, so that it has no freedom."""
    return bool(effect.strengths) and all(p.is_known for p in effect.strengths)


def is_distinct(best: Hypothesis, other: Hypothesis) -> bool:
    """Whether two answers differ by more than the misfit that both share.

    Where no law fits to the noise, chi-square says nothing; the difference has to be steady over
    pieces of the record (Vuong, Econometrica 57, 307 (1989)).
    """
    if best.reduced_chi2 < POOR_FIT:
        return True
    pieces = max(1, -(-24 // best.fit.residual.shape[0]))
    mine, theirs = (
        np.concatenate(
            [part.sum(axis=1) for part in np.array_split(h.fit.residual**2, pieces, axis=1)]
        )
        for h in (best, other)
    )
    kept = mine != theirs
    if int(kept.sum()) < 4:
        return False
    if other.fit.chi2 > FAR_WORSE * best.fit.chi2:
        return True
    # Where a law goes wrong ever faster one piece outweighs all others; ratios don't mind.
    ratios = np.log((theirs[kept] + 1.0) / (mine[kept] + 1.0))
    return _steadily_above(theirs[kept] - mine[kept]) or _steadily_above(ratios)


def _steadily_above(differences: FloatArray) -> bool:
    spread = float(np.std(differences, ddof=1)) * np.sqrt(differences.size)
    return bool(differences.sum() > 2.0 * spread)


def fit_hypothesis(
    forward: Forward,
    base: Fit,
    members: Sequence[Candidate],
    strengths: Sequence[FloatArray],
    start: Fit | None = None,
    rounds: int = 10,
    rival: float = np.inf,
) -> Hypothesis:
    """Fit the baseline with candidates in it.

    Parameters
    ----------
    base : Fit
        The refitted baseline, which the gain is counted from.
    members : candidates
        What to add.
    strengths : one array per member
        Start values of its strengths.
    start : Fit, optional
        Where trial-to-trial values start from; the baseline's by default.
    rounds : int
        Most Gauss–Newton steps.
    rival : float
        Objective of the best answer so far: a fit far behind it is left.
    """
    origin = base if start is None else start
    added = [member.effect for member in members]
    # A law that fits badly alone may be half of the answer; a set must come near the best one.
    least = BEHIND * rival if len(members) > 1 else np.inf
    swing = SwingStart(None if start is None else start.arcs, LOST * rival, least)
    abandon = rival + max(FIRST_REACH, FIRST_SHARE * (base.objective - rival))
    if not np.isfinite(rival):
        abandon = np.inf
    fit = _fitted_from(forward, base, members, strengths, origin, rounds, swing, abandon)
    if fit.objective > origin.objective + SLACK:
        # It holds the model that it started about, so it can't fit worse: the linear score led
        # wrong, and small strengths are the surer start.
        held = [effect for effect, _ in origin.model.entries]
        small = [
            values
            if any(member.effect is one for one in held)
            else np.array([p.neutral for p in member.effect.strengths])
            for member, values in zip(members, strengths, strict=True)
        ]
        alike = all(np.array_equal(*two) for two in zip(small, strengths, strict=True))
        # A swing from the same start ends alike; elsewhere the first may have been left early.
        if not (alike and forward.mode == "swing"):
            again = _fitted_from(forward, base, members, small, origin, rounds, swing)
            fit = min(fit, again, key=lambda one: one.objective)
    if rounds >= WHOLE_ROUNDS and fit.objective <= abandon:
        fit = _with_shapes_released(forward, base, members, fit, rounds, swing, abandon)
    # In free swings the catalogue's laws are each other's errors of form: zeroth, first and second
    # power of the rate. Loose ones would pass for any sum of them.
    form = EXACT if forward.mode == "swing" else form_evidence(forward, fit, added)
    gain = (
        base.objective
        - fit.objective
        - price_of_weights(fit, added)
        - price_of_levels(forward, fit)
    )
    return Hypothesis(
        tuple(members), fit, gain, form, _lacking(forward, fit.model),
        _airless(forward, fit, added),
    )  # fmt: skip


def _with_shapes_released(
    forward: Forward,
    base: Fit,
    members: Sequence[Candidate],
    fit: Fit,
    rounds: int,
    swing: SwingStart,
    abandon: float,
) -> Fit:
    """The fit continued until the hold on its shapes no longer matters.

    Each fit holds places, times and widths near where it starts. That hold keeps steps short; it is
    no knowledge, so a fit that moved them is started again from where it ended, unless as much gain
    in each further round would leave it above `abandon`.
    """
    for left in reversed(range(MAX_RELEASES)):
        placed, strengths = as_fitted(members, fit)
        moves = [
            (value - dict(old.shape).get(name, value)) / scales[name]
            for new, old in zip(placed, members, strict=True)
            for scales in ({p.name: p.scale for p in new.effect.shapes},)
            for name, value in new.shape
        ]
        if not moves or float(np.sum(np.square(moves))) < SLACK:
            break
        arcs = replace(swing, arcs=fit.arcs)
        again = _fitted_from(forward, base, placed, strengths, fit, rounds, arcs)
        gained = fit.objective - again.objective
        if not gained > SLACK:
            break
        fit, members = again, placed
        if fit.objective - left * gained > abandon:
            break
    return fit


def as_fitted(members: Sequence[Candidate], fit: Fit) -> tuple[list[Candidate], list[FloatArray]]:
    """Candidates with their shapes, and their strengths, where a fit left them."""
    found, strengths = [], []
    for member in members:
        held = next(v for e, v in fit.model.entries if e is member.effect)
        shape = tuple((p.name, float(held[p.name])) for p in member.effect.shapes)
        found.append(Candidate(member.effect, shape))
        strengths.append(np.array([held[p.name] for p in member.effect.strengths]))
    return found, strengths


def _fitted_from(
    forward: Forward,
    base: Fit,
    members: Sequence[Candidate],
    strengths: Sequence[FloatArray],
    origin: Fit,
    rounds: int,
    swing: SwingStart,
    abandon: float = np.inf,
) -> Fit:
    """The baseline with candidates in it, fitted from given strengths."""
    model: ForwardModel = base.model
    for member, values in zip(members, strengths, strict=True):
        start_at = start_values(member, base.model)
        for p, value in zip(member.effect.strengths, values, strict=True):
            known = value if p.expected is None or p.is_held else p.expected
            start_at[p.name] = float(np.clip(known, p.lower, p.upper))
        model = model.having(member.effect, start_at)
    added: list[Effect] = [member.effect for member in members]
    model = with_own_strengths(model.order(), added, origin.model)
    free = (*kept_free(base, model), *free_parameters(model, added))
    point = (origin.nuisance, origin.law_offsets)
    return fit_with_levels(forward, model, free, point, rounds=rounds, swing=swing, abandon=abandon)


SURELY = 3.0
"""Standard uncertainties from which a drag coefficient is below the least that bodies have."""


DRAG_STRENGTH = "drag_coefficient"
FALL_OF_DRAG = (EffectId.DRAG_CRISIS, "coefficient_drop")
"""Parameters that say how much the air resists."""


def _airless(forward: Forward, fit: Fit, added: Sequence[Effect]) -> bool:
    """Whether laws of the air are asked for although it does not resist.

    Air that lifts, carries or turns a body resists it as well. Where the setup states how much,
    that is believed; where it does not, the records decide.
    """
    if forward.mode != "flight" or not any(effect.by_air for effect in added):
        return False
    values = {e.id: v for e, v in fit.model.entries}
    free = {(fit.model.entries[f.entry][0].id, f.parameter.name): k for k, f in enumerate(fit.free)}
    fitted, fallen = free.get((EffectId.DRAG, DRAG_STRENGTH)), free.get(FALL_OF_DRAG)
    if fitted is not None:
        value, std = fit.value(fitted)
    elif EffectId.DRAG in values:
        if fallen is None:
            return False
        value, std = float(values[EffectId.DRAG][DRAG_STRENGTH]), 0.0
    else:
        scored = scan_beyond_forms(forward, fit, added, 1.0, [Candidate(Drag())])
        std = float(scored.information[0, 0] ** -0.5)
        value = float(scored.start[0] + scored.score[0] * std**2)
    if fallen is not None:
        fall, doubt = fit.value(fallen)
        value, std = value - fall, float(np.hypot(std, doubt))
    return bool(
        value + SURELY * std * np.sqrt(fit.reduced_chi2) < Defaults.MIN_DRAG_COEFFICIENT.known
    )


def _lacking(forward: Forward, model: ForwardModel) -> tuple[str, ...]:
    if forward.mode == "swing":
        return ()
    certain = (one.id for forms in CATALOGUE.values() for one in forms if one.certain)
    return tuple(one for one in certain if one not in model.ids)


def price_of_weights(fit: Fit, added: Sequence[Effect]) -> float:
    """What the evidence asks for weights that a prior holds: ln det of prior over posterior.

    What the baseline leaves open costs either the same; a shape has paid for its search.
    """
    held = [
        k
        for k, item in enumerate(fit.free)
        if item.parameter.is_held
        and not item.parameter.is_shape
        and any(fit.model.entries[item.entry][0] is e for e in added)
    ]
    if not held:
        return 0.0
    part = fit.covariance[np.ix_(held, held)]
    widths = np.array([fit.free[k].parameter.width for k in held])
    sign, size = np.linalg.slogdet(part / np.outer(widths, widths))
    return float(max(-size, 0.0)) if sign > 0 else np.inf


def null_threshold(scan: Scan, false_alarms: float = FALSE_ALARMS, seed: int = 20240229) -> float:
    """Penalised gain that chance alone exceeds in a share of blameless campaigns.

    A parametric bootstrap: without a mismatch the score of all candidates is Gaussian with the
    information as its covariance, so drawing scores stands for drawing campaigns.
    """
    size = scan.score.size
    if size == 0:
        return 12.0
    values, vectors = np.linalg.eigh(scan.information / _outer(scan.information))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    scale = np.sqrt(np.diag(scan.information))
    draws = (np.random.default_rng(seed).standard_normal((DRAWS, size)) @ root.T) * scale
    penalised = np.full(DRAWS, -np.inf)
    for index, candidate in enumerate(scan.candidates):
        which = np.array(scan.columns[index])
        block = scan.information[np.ix_(which, which)]
        held = scan.prior[which]
        inverse = np.linalg.pinv(block + np.diag(held), rcond=1e-9, hermitian=True)
        part = draws[:, which]
        gain = np.einsum("di,ij,dj->d", part, inverse, part) - price(block, held)
        one_sided = [p.lower == p.neutral for p in candidate.effect.strengths]
        if len(which) == 1 and one_sided[0] and scan.start[which[0]] == 0.0:
            gain = np.where(part[:, 0] > 0.0, gain, -np.inf)
        penalised = np.maximum(penalised, gain - candidate.complexity_penalty)
    tail = float(np.quantile(penalised, 1.0 - false_alarms))
    return max(tail, 9.0)


def least_gain(best: Hypothesis, base: Fit, threshold: float) -> float:
    """Penalised gain from which an answer is more than chance.

    What nature always has, and the model has not, was expected: no search of a catalogue has to be
    paid for before it is believed.
    """
    expected = all(m.effect.certain and m.id not in base.model.ids for m in best.members)
    return (min(threshold, CERTAIN_GAIN) if expected else threshold) * best.reduced_chi2


def _outer(matrix: FloatArray) -> FloatArray:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.asarray(scale[:, None] * scale[None, :])


def group_tolerance(best: Hypothesis) -> float:
    """By how much another answer's penalised gain may be less, and it still not be distinguished.

    Seven chi-square units are odds of thirty to one, times the misfit that is left; in strong
    cases one and a half per cent of the gain, since no law is known better than that, but no more
    than a part of what is left over.
    """
    count = best.fit.count
    odds = 7.0 * best.reduced_chi2
    left = max(best.fit.chi2 - best.fit.expected, 0.0) + np.sqrt(2.0 * count)
    return float(max(odds, min(0.015 * best.gain, 0.25 * left)))


SHIFTS = frozenset({"contact_displacement", "origin_offset"})

"""Ids that only shift where a flight starts, as an imperfect law of contact or camera also does."""


def second_effect_share(hypothesis: Hypothesis, further: Effect) -> float:
    """Share of the gain that a further effect must add before it is more than an imperfect law.

    What a loose law hands on to another phase, errors of its form say part by part; within its own
    phase they are a few polynomials of what it may do.
    """
    # A camera turned about all its axes is any turn that a camera can have.
    laws = [
        member.effect
        for member in hypothesis.members
        if member.id in LOOSE_LAWS and member.effect.form != Form.PERSPECTIVE
    ]
    if laws and further.id in SHIFTS:
        return 0.2
    loose = any(law.phase == further.phase for law in laws)
    if hypothesis.has_unnamed:
        return 0.03
    return 0.04 if loose else 0.008
