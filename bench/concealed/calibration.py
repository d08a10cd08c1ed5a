"""Compare stated probabilities with frequencies.

A name counts as right only if exactly that effect was concealed; how often its declared group
contains the truth is listed separately. Only worlds with other force laws count: the own
generator uses the catalogue's forms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.concealed.score import Judgement
from bench.concealed.statistics import Proportion, brier_score, calibration_error, wilson
from metrology import written_whole
from pipelines.report.plots import Picture

__all__ = [
    "Claim",
    "calibration_section",
    "claims_of",
    "draw_reliability",
]

SURE = 0.9
DOUBTED = 0.5


@dataclass(frozen=True)
class Claim:
    """A name with its probability, and whether it or its declared group was right.

    Attributes
    ----------
    stated : float
    right, by_group : bool
    grouped : bool
        Whether alternatives were declared.
    names : int
        Number of names in the answer.
    """

    stated: float
    right: bool
    by_group: bool
    grouped: bool
    names: int = 1


def claims_of(judgements: Sequence[Judgement]) -> list[Claim]:
    """Every name with a probability."""
    found = []
    for judgement in judgements:
        truth = {hidden.id for hidden in judgement.key.effects}
        answer = judgement.answer
        for named in answer.named:
            if named.probability is None:
                continue
            mine = [group for group in answer.groups if named.id in group]
            right = named.id in truth
            held = right or any(group & truth for group in mine)
            found.append(
                Claim(float(named.probability), right, held, bool(mine), len(answer.named))
            )
    return found


def _succession(right: int, total: int) -> float:
    """Laplace's rule: probability that the next one is right."""
    return (right + 1) / (total + 2)


def _row(name: str, claims: Sequence[Claim]) -> str:
    if not claims:
        return f"| {name} | – | – | – | – |"
    right = sum(claim.right for claim in claims)
    held = sum(claim.by_group for claim in claims)
    mean = sum(claim.stated for claim in claims) / len(claims)
    shares = [str(Proportion(count, len(claims))) for count in (right, held)]
    return f"| {name} | {mean:.2f} | {' | '.join(shares)} | {_succession(right, len(claims)):.2f} |"


def calibration_section(judgements: Sequence[Judgement], picture: str = "") -> list[str]:
    """Markdown lines: scores, classes of names, and a reliability table."""
    claims = claims_of(judgements)
    if not claims:
        return ["Nothing was named.", ""]
    stated, right = [c.stated for c in claims], [c.right for c in claims]
    base = sum(right) / len(right)
    error, bins = calibration_error(stated, right)
    classes = {
        f"alone, stated ≥ {SURE}": [c for c in claims if not c.grouped and c.stated >= SURE],
        f"alone, between {DOUBTED} and {SURE}": [
            c for c in claims if not c.grouped and DOUBTED <= c.stated < SURE
        ],
        f"in a group, stated ≥ {SURE}": [c for c in claims if c.grouped and c.stated >= SURE],
        f"in a group, between {DOUBTED} and {SURE}": [
            c for c in claims if c.grouped and DOUBTED <= c.stated < SURE
        ],
        f"below {DOUBTED}": [c for c in claims if c.stated < DOUBTED],
    }
    lines = [
        f"{len(claims)} names in {len(judgements)} campaigns. Brier score"
        f" {brier_score(stated, right):.3f}; always stating the fraction of right names,"
        f" {base:.2f}, gives {base * (1 - base):.3f}. Mean calibration error: {error:.3f}.",
        "",
        "| names | stated (mean) | name right | name or group right | next one right, by the"
        " rule of succession |",
        "|---|---|---|---|---|",
        *(_row(name, part) for name, part in classes.items()),
        "",
        "| stated (mean) | right | 95 % | names |",
        "|---|---|---|---|",
    ]
    for mean, share, count in bins:
        low, high = wilson(round(share * count), count)
        lines.append(f"| {mean:.2f} | {share:.2f} | {low:.2f}–{high:.2f} | {count} |")
    if picture:
        lines += ["", f"![Stated probability against frequency]({picture})"]
    return [*lines, ""]


def draw_reliability(judgements: Sequence[Judgement], page: Path) -> str:
    """Frequency over stated probability, with 95 % intervals and number of names.

    Returns
    -------
    str
        Link from `page` to the picture in the folder of pictures next to the page's folder; empty
        if there is no such folder or nothing was named.
    """
    claims = claims_of(judgements)
    path = page.parent.parent / "pictures" / "reliability.svg"
    if not claims or not path.parent.is_dir():
        return ""
    _, bins = calibration_error([c.stated for c in claims], [c.right for c in claims])
    figure = Picture(figsize=(4.6, 4.4), layout="constrained")
    axis = figure.subplots()
    axis.plot([0, 1], [0, 1], "-", color="0.7", lw=1.0)
    for mean, share, count in bins:
        low, high = wilson(round(share * count), count)
        axis.plot([mean, mean], [low, high], "-", color="tab:blue", lw=1.2)
        axis.plot(mean, share, "o", color="tab:blue", ms=3.0 + 1.5 * count**0.5)
        axis.annotate(str(count), (mean, share), (6, -10), textcoords="offset points", fontsize=8)
    axis.set_xlabel("stated probability of a name")
    axis.set_ylabel("fraction of such names that were concealed")
    axis.set_xlim(0.0, 1.06)
    axis.set_ylim(-0.06, 1.06)
    with written_whole(path) as part:
        figure.savefig(part, format=path.suffix.lstrip("."), dpi=130)
    return f"../pictures/{path.name}"
