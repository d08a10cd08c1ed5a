"""Section of the proof on the filmed campaigns."""

import json
from pathlib import Path

from bench.concealed.answer import Answer, answer_from_json
from bench.concealed.filmed.scenes import FILMED, SIZE, Filmed

__all__ = ["right", "section"]


def right(filmed: Filmed, answer: Answer) -> bool:
    """Whether the concealed effect is named or in a declared group, and nothing else is named."""
    if not filmed.id:
        return not answer.failure and not answer.ids
    groups = [group for group in answer.groups if filmed.id in group]
    if filmed.id not in answer.ids and not groups:
        return False
    allowed = {filmed.id}.union(*groups)
    if filmed.id == "camera_roll":
        # A rotation about another point is the same rotation plus a shift.
        allowed.add("origin_offset")
    return answer.ids <= allowed


def _words(answer: Answer) -> str:
    if answer.failure:
        return f"failed: {answer.failure[:90]}"
    names = ", ".join(sorted(answer.ids)) or answer.verdict
    groups = "; ".join("{" + ", ".join(sorted(group)) + "}" for group in answer.groups)
    return f"{names} {groups}".strip()


def section(folder: Path) -> list[str]:
    """Lines of the section, from the results of `pixels` in a folder."""
    path = folder / "results.json"
    if not path.exists():
        return []
    results = json.loads(path.read_text(encoding="utf-8"))
    rows, hits = [], 0
    for filmed in FILMED:
        raw = results.get(filmed.name)
        if raw is None:
            continue
        answer = answer_from_json(raw, raw["seconds"])
        good = right(filmed, answer)
        hits += good
        sizes = "; ".join(
            f"{name} {value:.3g} ± {std or float('nan'):.1g}"
            for named in answer.named
            for name, (value, std) in named.parameters.items()
        )
        rows.append(
            f"| {filmed.name} | {filmed.description} | {raw.get('clips', '–')} | {_words(answer)} |"
            f" {sizes or '–'} | {'yes' if good else 'no'} |"
        )
    missing = [filmed.name for filmed in FILMED if filmed.name not in results]
    left = f"; not answered for this page: {', '.join(missing)}" if missing else ""
    return [
        f"{len(FILMED)} campaigns of eight clips of {SIZE[0]} × {SIZE[1]} px, rendered by"
        " `sample_videos`, measured and explained as `vision explain CLIP…` does"
        f" (`python -m bench.concealed.filmed.pixels`): {hits} of {len(rows)} right{left}.",
        "",
        "| campaign | concealed | clips measured | answer | parameters | right |",
        "|---|---|---|---|---|---|",
        *rows,
        "",
    ]
