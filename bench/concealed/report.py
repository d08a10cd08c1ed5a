"""Write the proof page: every row with its counts, every miss by name."""

import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.concealed.calibration import calibration_section
from bench.concealed.score import MIMICKED, Judgement
from bench.concealed.second.careful import INSTRUMENTS
from bench.concealed.second.laws import NAMED, UNNAMED
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
        key = self.judgement.key
        where = f"{self.folder.parent.name} " if key.seed == 0 else ""
        return f"{where}{key.number}"


@dataclass(frozen=True)
class Asked:
    """Requested number of campaigns, seed and engine version."""

    campaigns: int
    seed: int
    engine: str = ""


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
        if not s.judgement.right or key.kind not in ("single", "pair") or key.seed == 0:
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


def _stated(scored: Sequence[Scored]) -> tuple[list[float], list[bool]]:
    """Stated probabilities of named effects, and whether each was concealed."""
    stated, right = [], []
    for s in scored:
        truth = {hidden.id for hidden in s.judgement.key.effects}
        for named in s.judgement.answer.named:
            if named.probability is not None:
                stated.append(float(named.probability))
                right.append(named.id in truth)
    return stated, right


def _declared(scored: Sequence[Scored]) -> list[tuple[float, bool]]:
    """Stated probabilities, and whether the name or one of its declared group was concealed."""
    found = []
    for s in scored:
        truth = {hidden.id for hidden in s.judgement.key.effects}
        answer = s.judgement.answer
        for named in answer.named:
            if named.probability is not None:
                grouped = any(named.id in group and group & truth for group in answer.groups)
                found.append((float(named.probability), named.id in truth or grouped))
    return found


def _sure_rows(scored: Sequence[Scored]) -> list[tuple[str, str, str, str]]:
    declared = _declared(scored)
    sure = [right for stated, right in declared if stated >= SURE]
    score = brier_score([p for p, _ in declared], [right for _, right in declared])
    return [
        (f"a name with stated probability ≥ {SURE} that is wrong", "≤ 3 %", "≤ 1 %",
         str(Proportion(sum(not right for right in sure), len(sure)))),
        ("Brier score of stated probabilities, a declared group being right", "", "",
         f"{score:.3f} ({len(declared)} names)"),
        ("answers with contradictions", "0", "0",
         str(_share(scored, lambda j: bool(j.answer.contradictions)))),
    ]  # fmt: skip


def _class_rows(scored: Sequence[Scored]) -> list[tuple[str, str, str, str]]:
    """Requirements on worlds whose laws are not in the catalogue."""
    return [
        ("nulls with a name", "≤ 2 %", "≤ 0.5 %",
         str(_share(_of(scored, "null"), lambda j: j.named))),
        ("nulls and careful laboratories: a name of 0.5 or more that is no error of theirs", "2 %",
         "0.5 %", str(_share([*_of(scored, "null"), *_of(scored, "careful")], _falsely_named))),
        ("single strong: right id or declared group, nothing else", "93 %", "98 %",
         str(_share(_of(scored, "single", "strong"), _right))),
        ("single medium", "88 %", "95 %", str(_share(_of(scored, "single", "medium"), _right))),
        ("pairs, both strong", "80 %", "92 %",
         str(_share(_of(scored, "pair", "strong"), _right))),
        ("pairs, weaker", "", "", str(_share(_of(scored, "pair", "medium"), _right))),
        ("force in no catalogue: `unnamed`, right phase and direction", "88 %", "95 %",
         str(_share(_of(scored, "outside"), _said_rightly))),
        *_sure_rows(scored),
    ]  # fmt: skip


def _main_rows(scored: Sequence[Scored]) -> list[tuple[str, str, str, str]]:
    nulls = _of(scored, "null")
    starts = [s for s in scored if s.judgement.start_error is not None and _strong(s)]
    coverage, _ = _coverage(scored)
    error, _ = calibration_error(*_stated(scored))
    seconds = [s.judgement.answer.seconds for s in scored]
    long = [s.judgement.answer.seconds for s in scored if len(s.judgement.key.trials) >= 24]
    timing = f"median {np.median(seconds):.1f} s, slowest {max(seconds):.1f} s" if seconds else "–"
    if long:
        timing += f"; 24 trials: median {np.median(long):.1f} s"
    strong = _of(scored, "single", "strong")
    return [
        ("nulls with named physics", "≤ 2 %", "≤ 0.5 %",
         str(_share(nulls, lambda j: j.physics_named))),
        ("nulls with a name", "", "",
         str(_share(nulls, lambda j: j.named))),
        ("single weak effect: right id or its declared group", "", "",
         str(_share(_of(scored, "single", "weak"), lambda j: j.right))),
        ("single weak effect: a wrong id and no right one", "", "",
         str(_share(_of(scored, "single", "weak"), _misled))),
        ("single medium effect: right id or its declared group", "90 %", "97 %",
         str(_share(_of(scored, "single", "medium"), lambda j: j.right))),
        ("single strong effect", "97 %", "99.5 %", str(_share(strong, lambda j: j.right))),
        ("single strong effect, whatever else is named", "", "",
         str(_share(strong, lambda j: j.covered))),
        ("pairs, both strong", "85 %", "95 %",
         str(_share(_of(scored, "pair"), lambda j: j.right))),
        ("force in no catalogue: unnamed, right direction and place", "80 %", "95 %",
         str(_share(_distinct(scored), _said_rightly))),
        ("– reported as unnamed", "", "",
         str(_share(_distinct(scored), lambda j: j.unnamed_said))),
        ("– right place (phase, time)", "", "",
         str(_share(_distinct(scored), lambda j: j.place_right))),
        ("– right direction", "", "",
         str(_share(_distinct(scored), lambda j: j.direction_right))),
        ("force that two catalogue effects can mimic: unnamed or grouped with it", "", "",
         str(_share(_mimicked(scored), lambda j: j.unnamed_said))),
        ("exact twins reported as a group, with a separating measurement", "100 %", "–",
         str(_share(_of(scored, "twins"), lambda j: j.grouped))),
        ("start of a local effect within 5 % of the flight", "85 %", "95 %",
         str(_share(starts, lambda j: j.start_error is not None and j.start_error <= 0.05))),
        ("95 % intervals of fitted parameters that contain the truth", "88–99 %", "93–97 %",
         str(coverage)),
        *_sure_rows(scored),
        ("calibration error of stated probabilities", "0.08", "0.03", f"{error:.3f}"),
        ("processor time for a campaign, one process", "30 s", "8 s", timing),
    ]  # fmt: skip


def _falsely_named(judgement: Judgement) -> bool:
    """Whether something that was not concealed is more probable than not."""
    truth = {hidden.id for hidden in judgement.key.effects}
    return any(
        (named.probability or 0.0) >= 0.5 and named.id not in truth
        for named in judgement.answer.named
    )


def _misled(judgement: Judgement) -> bool:
    return bool(judgement.answer.ids) and not judgement.covered


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
             f"{s.judgement.answer.channel}]")
        )  # fmt: skip
    if not rows:
        return ["None.", ""]
    return _table(("campaign", "kind", "level", "Δχ²", "concealed", "said"), rows)


def _foreign_rows(foreign: Sequence[Scored]) -> list[str]:
    head = ("", "required", "goal", "measured")
    lines = _table(head, _class_rows(foreign))
    rows = []
    for s in foreign:
        key = s.judgement.key
        truth = " + ".join(f"{h.name} → {h.id}" for h in key.effects) or "nothing"
        rows.append(
            (s.name, key.level, f"{key.delta_chi2:.0f}", truth, _answer_words(s.judgement),
             "yes" if _good(s.judgement) else "no", f"{s.judgement.answer.seconds:.1f} s")
        )  # fmt: skip
    head = ("campaign", "level", "Δχ²", "concealed", "said", "right", "time")
    return [*lines, *_table(head, rows)]


def _second_section(scored: Sequence[Scored]) -> list[str]:
    if not scored:
        return ["Not requested.", ""]
    careful = scored[0].judgement.key.kind == "careful"
    laws = INSTRUMENTS if careful else (*NAMED, *UNNAMED)
    forms = [(law.name, law.id, law.form) for law in laws]
    _, bins = calibration_error(*map(list, zip(*_declared(scored), strict=True)))
    return [
        f"{len(scored)} campaigns. No law has the form that the catalogue contains.",
        "",
        *_table(("", "required", "goal", "measured"), _class_rows(scored)),
        *_reliability(bins),
        *_table(("law", "id", "form in this world"), forms),
        *_misses(scored),
    ]


def _reliability(bins: Sequence[tuple[float, float, int]]) -> list[str]:
    return _table(
        ("stated (mean)", "right", "names"),
        [(f"{stated:.2f}", f"{right:.2f}", str(count)) for stated, right, count in bins],
    )


def _right(judgement: Judgement) -> bool:
    return judgement.right


UNASKED = frozenset(
    {
        "Not requested.",
        "Not rendered for this page.",
        "Not available, or not requested.",
        "Not available.",
    }
)
"""Text of a section that was not requested."""

KEPT = "From an earlier run."


def with_kept_sections(page: str, before: str) -> str:
    """The page with sections that were not requested taken from the earlier page."""
    old = _sections(before)
    parts = []
    for heading, body in _sections(page).items():
        earlier = old.get(heading, "").strip()
        if body.strip() in UNASKED and earlier and earlier not in UNASKED:
            earlier = earlier.removeprefix(KEPT).strip()
            body = f"\n{KEPT}\n\n{earlier}\n\n"
        parts.append(f"{heading}\n{body}" if heading else body)
    return "".join(parts)


def _sections(page: str) -> dict[str, str]:
    """Text of each section by its heading; the text before the first heading under ""."""
    found: dict[str, str] = {}
    heading, lines = "", list[str]()
    for line in page.splitlines(keepends=True):
        if line.startswith("## "):
            found[heading] = "".join(lines)
            heading, lines = line.rstrip(), []
        else:
            lines.append(line)
    return found | {heading: "".join(lines)}


def proof_text(
    own: Sequence[Scored],
    foreign: Sequence[Scored],
    asked: Asked,
    real: Sequence[str],
    pixels: Sequence[str] = (),
    second: Sequence[Scored] = (),
    reliability: str = "",
) -> str:
    """The page in Markdown; `real` and `pixels` are the lines of those sections.

    `reliability` is the link to the reliability diagram, if there is one.
    """
    counts = Counter(s.judgement.key.kind for s in own)
    _, outside = _coverage(own)
    _, bins = calibration_error(*_stated(own))
    sizes = [s.judgement.group_size for s in own if s.judgement.group_size]
    lines = [
        "# The proof: campaigns with concealed physics",
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
        *_table(("", "required", "goal", "measured"), _main_rows(own)),
        f"Declared groups contain {np.median(sizes):.0f} ids in the median, at most {max(sizes)}."
        if sizes
        else "No group was declared.",
        "",
        "## Campaigns of a foreign simulator",
        "",
        *(_foreign_rows(foreign) if foreign else ["Not available.", ""]),
        "## A second world with other force laws",
        "",
        *_second_section(second),
        "## Stated probabilities in worlds with other force laws",
        "",
        *calibration_section([s.judgement for s in (*foreign, *second)], reliability),
        "## From pixels",
        "",
        *(pixels or ["Not rendered for this page.", ""]),
        "## Real recordings",
        "",
        *(real or ["Not available, or not requested.", ""]),
        "## By concealed effect",
        "",
        *_confusion(own),
        "## Stated probability and frequency of right answers",
        "",
        *_reliability(bins),
        "## Misses",
        "",
        *_misses([*own, *foreign]),
        "## Intervals that do not contain the truth",
        "",
        *([f"- {line}" for line in outside] or ["None."]),
        "",
    ]
    return "\n".join(lines)
