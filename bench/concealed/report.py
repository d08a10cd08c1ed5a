"""Write the proof page: every row with its counts, every miss by name."""

import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.concealed.score import MIMICKED, Judgement
from bench.concealed.statistics import Proportion, brier_score, calibration_error
from bench.concealed.world.conventions import true_parameter

__all__ = ["WHOLE_PROOF", "Asked", "Scored", "proof_text"]


WHOLE_PROOF = 400
SURE = 0.9
"""Stated probability above which a name counts as certain."""

PARTIAL = (
    f"**Incomplete: fewer than {WHOLE_PROOF} campaigns were scored, so the intervals are wide.**"
)


COUNTED = (
    "Scoring: an answer is *right* if every concealed effect is named or in a declared group, and"
    " nothing else is named; on a null any named id, or one in a group of a verdict other than"
    " no_mismatch, is wrong. A force in no catalogue must be reported as `unnamed` (or unexplained)"
    " in the right phase and direction. The *start of a local effect* is the answer's `t_start_s`,"
    " compared with the key's start after first contact, as a fraction of the median flight. An"
    " effect bound to a position (a magnet) starts at a different time in each trial: times"
    " between the earliest and the latest start have no error. A magnet or a notch starts where"
    " ball or pendulum comes within two widths of it. Only strong effects are scored for their"
    " start.",
    "",
)


@dataclass(frozen=True)
class Scored:
    """A judgement and its campaign folder."""

    judgement: Judgement
    folder: Path

    @property
    def name(self) -> str:
        """Name of the campaign in lists of misses."""
        return str(self.judgement.key.number)


@dataclass(frozen=True)
class Asked:
    """Requested number of campaigns, seed, engine version and world."""

    campaigns: int
    seed: int
    engine: str = ""
    world: str = "own"


Test = Callable[[Judgement], bool]


def _share(scored: Iterable[Scored], test: Test) -> Proportion:
    outcomes = [test(s.judgement) for s in scored]
    return Proportion(sum(outcomes), len(outcomes))


def _of(scored: Sequence[Scored], kind: str, level: str | None = None) -> list[Scored]:
    return [
        s
        for s in scored
        if s.judgement.key.kind == kind and (level is None or s.judgement.key.level == level)
    ]


def _distinct(scored: Sequence[Scored]) -> list[Scored]:
    """Forces in no catalogue that no two catalogue effects can mimic."""
    return [
        s
        for s in _of(scored, "outside")
        if (s.judgement.key.nearest_catalogue_chi2 or np.inf) > MIMICKED
    ]


def _mimicked(scored: Sequence[Scored]) -> list[Scored]:
    kept = {id(s) for s in _distinct(scored)}
    return [s for s in _of(scored, "outside") if id(s) not in kept]


def _said_rightly(judgement: Judgement) -> bool:
    return judgement.unnamed_said and judgement.direction_right and judgement.place_right


def _coverage(scored: Sequence[Scored]) -> tuple[Proportion, list[str]]:
    """Fraction of the 95 % intervals of rightly named effects that contain the truth."""
    inside, outside = 0, []
    for s in scored:
        key, answer = s.judgement.key, s.judgement.answer
        if not s.judgement.right or key.kind not in ("single", "pair"):
            continue
        setup = tomllib.loads((s.folder / "setup.toml").read_text(encoding="utf-8"))
        for hidden in key.effects:
            truth = true_parameter(hidden, setup)
            named = next((n for n in answer.named if n.id == hidden.id), None)
            if truth is None or named is None or truth[0] not in named.parameters:
                continue
            value, std = named.parameters[truth[0]]
            if std is None:
                continue
            if abs(value - truth[1]) <= 1.96 * std:
                inside += 1
            else:
                outside.append(
                    f"{s.name} {hidden.name}: {value:.4g} ± {std:.2g}, true {truth[1]:.4g}"
                )
    return Proportion(inside, inside + len(outside)), outside


def _stated(scored: Sequence[Scored], *, by_group: bool = False) -> tuple[list[float], list[bool]]:
    """Stated probabilities, and whether the name, or one of its group, was concealed."""
    stated, right = [], []
    for s in scored:
        truth = {hidden.id for hidden in s.judgement.key.effects}
        for named in s.judgement.answer.named:
            if named.probability is not None:
                groups = s.judgement.answer.groups if by_group else ()
                grouped = any(named.id in group and group & truth for group in groups)
                stated.append(float(named.probability))
                right.append(named.id in truth or grouped)
    return stated, right


def _falls_short(judgement: Judgement) -> bool:
    """Whether anything is named that was not concealed, and nothing that was."""
    return bool(judgement.answer.ids) and not judgement.covered


Row = tuple[str, str, str, str]
Question = tuple[str, str, str, Callable[[Sequence[Scored]], Sequence[Scored]], Test]

QUESTIONS: tuple[Question, ...] = (
    ("nulls with named physics", "≤ 2 %", "≤ 0.5 %",
     lambda all_: _of(all_, "null"), lambda j: j.physics_named),
    ("nulls with a name", "", "", lambda all_: _of(all_, "null"), lambda j: j.named),
    ("nulls and careful laboratories: a name of 0.5 or more that is no error of theirs",
     "2 %", "0.5 %", lambda all_: [*_of(all_, "null"), *_of(all_, "careful")],
     lambda j: _falsely_named(j)),
    ("single weak effect: right id or its declared group", "", "",
     lambda all_: _of(all_, "single", "weak"), lambda j: j.right),
    ("single weak effect: a wrong id and no right one", "", "",
     lambda all_: _of(all_, "single", "weak"), _falls_short),
    ("single medium effect: right id or its declared group", "90 %", "97 %",
     lambda all_: _of(all_, "single", "medium"), lambda j: j.right),
    ("single strong effect", "97 %", "99.5 %",
     lambda all_: _of(all_, "single", "strong"), lambda j: j.right),
    ("single strong effect, whatever else is named", "", "",
     lambda all_: _of(all_, "single", "strong"), lambda j: j.covered),
    ("pairs, both strong", "85 %", "95 %", lambda all_: _of(all_, "pair"), lambda j: j.right),
    ("force in no catalogue: unnamed, right direction and place", "80 %", "95 %",
     lambda all_: _distinct(all_), _said_rightly),
    ("– reported as unnamed", "", "", lambda all_: _distinct(all_), lambda j: j.unnamed_said),
    ("– right place (phase, time)", "", "", lambda all_: _distinct(all_), lambda j: j.place_right),
    ("– right direction", "", "", lambda all_: _distinct(all_), lambda j: j.direction_right),
    ("force that two catalogue effects can mimic: unnamed or grouped with it", "", "",
     lambda all_: _mimicked(all_), lambda j: j.unnamed_said),
    ("exact twins reported as a group, with a separating measurement", "100 %", "–",
     lambda all_: _of(all_, "twins"), lambda j: j.grouped),
    ("start of a local effect within 5 % of the flight", "85 %", "95 %",
     lambda all_: [s for s in all_ if s.judgement.start_error is not None and _strong(s)],
     lambda j: j.start_error is not None and j.start_error <= 0.05),
    ("answers with contradictions", "0", "0", lambda all_: all_,
     lambda j: bool(j.answer.contradictions)),
)  # fmt: skip
"""What is asked, what is required and the goal, of which campaigns, and what counts."""


def _main_rows(scored: Sequence[Scored], coverage: Proportion) -> list[Row]:
    rows = [
        (asked, required, goal, str(_share(chosen(scored), test)))
        for asked, required, goal, chosen, test in QUESTIONS
    ]
    error, _ = calibration_error(*_stated(scored))
    declared = _stated(scored, by_group=True)
    sure = [right for stated, right in zip(*declared, strict=True) if stated >= SURE]
    return [
        *rows,
        ("95 % intervals of fitted parameters that contain the truth", "88–99 %", "93–97 %",
         str(coverage)),
        (f"a name with stated probability ≥ {SURE} that is wrong", "≤ 3 %", "≤ 1 %",
         str(Proportion(sum(not right for right in sure), len(sure)))),
        ("Brier score of stated probabilities, a declared group being right", "", "",
         f"{brier_score(*declared):.3f} ({len(declared[0])} names)"),
        ("calibration error of stated probabilities", "0.08", "0.03", f"{error:.3f}"),
        ("processor time for a campaign, one process", "30 s", "8 s", _timing(scored)),
    ]  # fmt: skip


def _timing(scored: Sequence[Scored]) -> str:
    seconds = [s.judgement.answer.seconds for s in scored]
    long = [s.judgement.answer.seconds for s in scored if len(s.judgement.key.trials) >= 24]
    said = f"median {np.median(seconds):.1f} s, slowest {max(seconds):.1f} s" if seconds else "–"
    return said + (f"; 24 trials: median {np.median(long):.1f} s" if long else "")


def _falsely_named(judgement: Judgement) -> bool:
    """Whether something that was not concealed is more probable than not."""
    truth = {hidden.id for hidden in judgement.key.effects}
    return any(
        (named.probability or 0.0) >= 0.5 and named.id not in truth
        for named in judgement.answer.named
    )


def _strong(scored: Scored) -> bool:
    return scored.judgement.key.level == "strong"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return [*lines, ""]


def _answer_words(judgement: Judgement) -> str:
    answer = judgement.answer
    if answer.failure:
        return f"failed: {answer.failure[:90]}"
    names = ", ".join(sorted(answer.ids)) or answer.verdict
    groups = "; ".join("{" + ", ".join(sorted(group)) + "}" for group in answer.groups)
    return f"{names} {groups}".strip()


def _confusion(scored: Sequence[Scored]) -> list[str]:
    """For each concealed effect: how often right, and the other answers."""
    rows = []
    singles = [s for s in scored if s.judgement.key.kind in ("single", "outside")]
    for name in sorted({s.judgement.key.effects[0].name for s in singles}):
        mine = [s for s in singles if s.judgement.key.effects[0].name == name]
        visible = [s for s in mine if s.judgement.key.level != "weak"]
        wrong = Counter(_answer_words(s.judgement) for s in visible if not _good(s.judgement))
        said = "; ".join(f"{words} ×{count}" for words, count in wrong.most_common(4))
        identity = mine[0].judgement.key.effects[0].id
        rows.append((name, identity, str(_share(visible, _good)), said))
    return _table(("concealed", "id", "medium and strong: right", "other answers"), rows)


def _good(judgement: Judgement) -> bool:
    if judgement.key.kind == "null":
        return not judgement.named
    if judgement.key.kind == "careful":
        return not _falsely_named(judgement)
    if judgement.key.kind == "twins":
        return judgement.grouped
    if judgement.key.kind == "outside":
        return _said_rightly(judgement)
    if judgement.key.level == "weak":
        return judgement.right or not judgement.named
    return judgement.right


def _misses(scored: Sequence[Scored]) -> list[str]:
    rows = []
    for s in scored:
        key = s.judgement.key
        if _good(s.judgement):
            continue
        truth = " + ".join(f"{h.name} ({h.amplitude:.3g})" for h in key.effects) or "nothing"
        rows.append(
            (s.name, key.kind, key.level, f"{key.delta_chi2:.0f}", truth,
             f"{_answer_words(s.judgement)} [{s.judgement.answer.phase} "
             f"{s.judgement.answer.channel}]",
             "–" if (lack := _lacks(s.judgement)) is None else f"{lack:.1f}")
        )  # fmt: skip
    if not rows:
        return ["None.", ""]
    return _table(("campaign", "kind", "level", "Δχ²", "concealed", "reported", "lacks"), rows)


def _lacks(judgement: Judgement) -> float | None:
    """Evidence that the best other answer with a concealed effect lacks, chi-square units."""
    truth = {hidden.id for hidden in judgement.key.effects}
    found = [lack for ids, lack in judgement.answer.alternatives if ids & truth]
    return min(found, default=None)


def _undecided(scored: Sequence[Scored]) -> str:
    """Odds against the truth where a medium effect is not named, in the median."""
    silent = [s.judgement for s in _of(scored, "single", "medium") if not s.judgement.named]
    lacks = [lack for one in silent if (lack := _lacks(one)) is not None]
    if not lacks:
        return ""
    return (
        f"Of {len(silent)} medium effects nothing is named. In {len(lacks)} of them the truth was"
        " tried: it lacks"
        f" {np.median(lacks):.1f} units of evidence in the median, {max(lacks):.1f} at most (odds"
        f" of e^{0.5 * np.median(lacks):.1f} and e^{0.5 * max(lacks):.1f}), against chance in one"
        " campaign of a hundred or usual errors of the inputs."
    )


def _reliability(bins: Sequence[tuple[float, float, int]]) -> list[str]:
    return _table(
        ("stated (mean)", "right", "names"),
        [(f"{stated:.2f}", f"{right:.2f}", str(count)) for stated, right, count in bins],
    )


def proof_text(own: Sequence[Scored], asked: Asked) -> str:
    """The page in Markdown."""
    counts = Counter(s.judgement.key.kind for s in own)
    # laws of other forms have no parameter to compare
    coverage, outside = _coverage(own if asked.world == "own" else ())
    _, bins = calibration_error(*_stated(own))
    sizes = [s.judgement.group_size for s in own if s.judgement.group_size]
    lines = [
        "# Campaigns with concealed physics",
        "",
        f"Written by `python -m bench.concealed --campaigns {asked.campaigns} --seed {asked.seed}`"
        f" with engine {asked.engine or '(unknown)'}; {len(own)} campaigns were scored: "
        + ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
        + ". The generator has its own force laws, contact and solver and shares no code with the "
        "engine. The engine receives only the tables and the setup file; keys are read after all "
        "answers. Weak, medium and strong: Δχ² of truth against the refitted baseline below 10, up "
        "to 100, above. Fractions have counts and 95 % Wilson intervals.",
        "",
        *([PARTIAL, ""] if len(own) < WHOLE_PROOF else []),
        *COUNTED,
        *_table(("", "required", "goal", "measured"), _main_rows(own, coverage)),
        f"Declared groups contain {np.median(sizes):.0f} ids in the median, at most {max(sizes)}."
        if sizes
        else "No group was declared.",
        "",
        "## By concealed effect",
        "",
        *_confusion(own),
        "## Stated probability and frequency of right answers",
        "",
        *_reliability(bins),
        "## Misses",
        "",
        "*Lacks*: evidence (χ² units) that the truth falls short of what was reported.",
        "",
        *_misses(own),
        *([said, ""] if (said := _undecided(own)) else []),
        "## Intervals that do not contain the truth",
        "",
        *([f"- {line}" for line in outside] or ["None."]),
        "",
    ]
    return "\n".join(lines)
