"""The story of a verdict as one HTML page that needs nothing else."""

import base64
import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment
from matplotlib.mathtext import math_to_image

from metrology import write_text_whole
from mismatch import Explained, Verdict
from mismatch.table.explain import TableExplained
from mismatch.verdict import NamedEffect
from pipelines.explain.plots import figure_of
from pipelines.explain.story import misfit_by_trial, paths_figure, residuals_figure
from pipelines.figures import Picture

__all__ = ["explain_report_html", "verdict_html", "write_explain_report"]

FORCES = "Mean residual in units of the noise over time, and the missing force with its 95 % band."
TABLE = "Recorded minus model for each number, over impact speed."


CELL = """<div style="max-width:60rem"><p><b>{{ headline }}</b></p>
{% for line in lines %}<p>{{ line }}</p>{% endfor %}</div>"""


def verdict_html(verdict: Verdict) -> str:
    """The story in plain words as HTML for a notebook's cell."""
    headline, *lines = verdict.text().splitlines()
    return Environment(autoescape=True).from_string(CELL).render(headline=headline, lines=lines)


def _page() -> str:
    return (files("pipelines.explain") / "page.html.j2").read_text(encoding="utf-8")


@dataclass(frozen=True)
class _Told:
    """A named effect with its law as a picture (SVG, base64), as text, and where it is from."""

    named: NamedEffect
    law: str
    text: str
    source: str


@dataclass(frozen=True)
class _File:
    name: str
    digest: str


def _png(figure: Picture) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _typeset(law: str) -> str:
    """A formula as SVG, base64; empty where matplotlib can't set it."""
    buffer = io.BytesIO()
    try:
        math_to_image(f"${law}$", buffer, dpi=150, format="svg")
    except (ValueError, RuntimeError):
        return ""
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def _told(explained: Explained | TableExplained) -> list[_Told]:
    if isinstance(explained, TableExplained):
        members = () if explained.best is None else explained.best.members
    else:
        best = explained.naming.best
        members = () if best is None else best.members
    told = []
    for named in explained.verdict.effects:
        effect = next((m.effect for m in members if m.id == named.id), None)
        law = "" if effect is None else effect.law
        source = "" if effect is None else effect.source
        told.append(_Told(named, _typeset(law), law, source))
    return told


def _provenance(paths: Sequence[Path]) -> list[_File]:
    return [
        _File(path.name, hashlib.sha256(path.read_bytes()).hexdigest())
        for path in paths
        if path.is_file()
    ]


def explain_report_html(
    explained: Explained | TableExplained, rests_on: Sequence[Path] = ()
) -> str:
    """The page as text; `rests_on` are its files, told with their hashes."""
    page = Environment(autoescape=True).from_string(_page())
    common = {
        "v": explained.verdict,
        "headline": explained.verdict.text().splitlines()[0],
        "effects": _told(explained),
        "png": _png(figure_of(explained)),
        "sources": _provenance(rests_on),
        "version": version("impact-vision"),
    }
    if isinstance(explained, TableExplained):
        return page.render(**common, caption=TABLE)
    forward = explained.prepared.forward
    swings = forward.mode == "swing"
    return page.render(
        **common,
        caption=FORCES,
        paths=_png(paths_figure(explained)),
        residuals=_png(residuals_figure(explained)),
        trials=misfit_by_trial(explained),
        unit="mrad" if swings else "mm",
        swings=swings,
        count=forward.records.count,
    )


def write_explain_report(
    explained: Explained | TableExplained, path: Path, rests_on: Sequence[Path] = ()
) -> None:
    """Write the page."""
    write_text_whole(path, explain_report_html(explained, rests_on))
