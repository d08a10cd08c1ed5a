"""HTML of a measurement: the self-contained report page and a notebook cell."""

import base64
import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from metrology import Contribution, Quantity, write_text_whole
from metrology.quantity import format_pair, format_unit
from pipelines.doors import DATE
from pipelines.report.inputs import ReportInput, for_people, quantity_label, quantity_rows

if TYPE_CHECKING:
    from pipelines.report.plots import Panel

__all__ = [
    "report_html",
    "results_html",
    "write_report",
]

MAX_MAIN_ROWS = 5
"""Results at the top of the page (chosen: they fit next to the picture); all are folded below."""

MAX_SHEET_ROWS, MAX_SHEET_PLOTS, MAX_SHEET_WARNINGS = 8, 2, 4
"""Results, plots and warnings on one A4 page (chosen: they fit on it)."""

_NOTEBOOK_CELL = """<div style="max-width:60rem">
{% if title %}<div><b>{{ title }}</b></div>{% endif %}
{% for warning in warnings %}<div style="border-left:4px solid #b03a00;padding:.1rem .6rem;
margin:.2rem 0">{{ warning[:1]|upper }}{{ warning[1:] }}</div>{% endfor %}
{% if still %}<img alt="a frame with ball, pendulum and path drawn into it"
src="data:image/jpeg;base64,{{ still }}" style="max-width:100%;margin:.4rem 0">{% endif %}
<table><thead><tr><th style="text-align:left">quantity</th>
<th style="text-align:left">value ± standard uncertainty</th></tr></thead><tbody>
{% for label, value, known in rows %}<tr><td style="text-align:left">{{ label }}</td>
<td style="text-align:left">{% if known %}{{ value }}{% else %}<i>{{ value }}</i>{% endif %}</td>
</tr>{% endfor %}</tbody></table></div>"""


def results_html(
    title: str,
    quantities: Sequence[Quantity],
    warnings: Sequence[str] = (),
    still_png: bytes | None = None,
) -> str:
    """Table of results with warnings above it and an optional picture.

    Parameters
    ----------
    still_png : bytes, optional
        A frame of the clip.

    Returns
    -------
    str
        HTML; every text in it is escaped.
    """
    rows = quantity_rows(quantities)
    still = None if still_png is None else base64.b64encode(_as_jpeg(still_png)).decode("ascii")
    # imported here: not every command that shows results writes a page
    from jinja2 import Environment, StrictUndefined

    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(_NOTEBOOK_CELL)
    return template.render(title=title, rows=rows, warnings=warnings, still=still)


def _as_jpeg(png: bytes) -> bytes:
    """JPEG of a PNG: a seventh of the size, since a notebook keeps every picture."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").save(buffer, format="JPEG", quality=85)
    return buffer.getvalue()


@dataclass(frozen=True)
class _BudgetLine:
    source: str
    std: str
    percentage: float


@dataclass(frozen=True)
class _Row:
    label: str
    value: str
    std: str
    interval: str
    unit: str
    reason: str
    relative: str
    budget: tuple[_BudgetLine, ...]


def write_report(path: Path, report: ReportInput, panels: "Sequence[Panel]" = ()) -> None:
    """Write the page, completely or not at all; `panels` are drawn before its own plots.

    Raises
    ------
    UsageError
        If its folder does not exist or can't be written to.
    """
    write_text_whole(path, report_html(report, panels))


def report_html(
    report: ReportInput,
    panels: "Sequence[Panel]" = (),
    *,
    command: str = "",
    label: Callable[[str], str] = quantity_label,
) -> str:
    """Return the page as HTML; every text in it is escaped.

    Parameters
    ----------
    panels : sequence of Panel
        Further plots, before those of the report.
    command : str
        For one A4 page without what is folded: the command that repeats it.
    label : callable
        Label of a quantity.

    Returns
    -------
    str
        HTML with embedded pictures.
    """
    from jinja2 import Environment, StrictUndefined

    from pipelines.report.plots import panel_svg, panels_of

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = files("pipelines.report").joinpath("page.html.j2").read_text(encoding="utf-8")
    plots = []
    for panel in (*panels, *panels_of(report)):
        picture, points = panel_svg(panel)
        plots.append((panel[0], _data_uri("image/svg+xml", picture.encode()), points))
    still = None if report.still_png is None else _data_uri("image/png", report.still_png)
    rows = [_row(quantity, label(quantity.name)) for quantity in report.quantities]
    most = (MAX_SHEET_ROWS, MAX_SHEET_PLOTS) if command else (MAX_MAIN_ROWS, len(plots))
    common = _common_reasons(rows)
    return environment.from_string(source).render(
        report=report,
        main=[row for row in rows if row.value][: most[0]],
        rows=[row for row in rows if row.reason not in common],
        shared_reasons=common,
        plots=plots[: most[1]],
        command=command,
        warnings=report.warnings[:MAX_SHEET_WARNINGS] if command else report.warnings,
        still=still,
        made=os.environ.get(DATE, ""),
    )


def _row(given: Quantity, label: str) -> _Row:
    quantity = for_people(given)
    unit = format_unit(quantity.unit)
    if quantity.value is None:
        return _Row(label, "", "", "", unit, quantity.reason or "not measured", "", ())
    value, std = format_pair(quantity.value, quantity.std)
    interval = relative = ""
    if quantity.std:
        # k = 2: about 95 % if the budget is nearly normally distributed (GUM, annex G)
        low, high = (
            format_pair(quantity.value + k * quantity.std, quantity.std)[0] for k in (-2, 2)
        )
        interval = f"{low} to {high}"
        if quantity.value:
            relative = f"{100 * quantity.std / abs(quantity.value):.2g} %"
    budget = tuple(_budget_line(line, quantity.std) for line in _largest_first(quantity.budget))
    return _Row(label, value, std or "", interval, unit, "", relative, budget)


def _common_reasons(rows: list[_Row]) -> dict[str, list[str]]:
    """Labels grouped by a reason that several percentage; listed once, below the results."""
    labels: dict[str, list[str]] = {}
    for row in rows:
        if row.reason:
            labels.setdefault(row.reason, []).append(row.label)
    return {reason: named for reason, named in labels.items() if len(named) > 1}


def _largest_first(budget: tuple[Contribution, ...]) -> list[Contribution]:
    return sorted(budget, key=lambda line: -abs(line.std))


def _budget_line(line: Contribution, total: float | None) -> _BudgetLine:
    percentage = 100.0 * (line.std / total) ** 2 if total else 0.0
    return _BudgetLine(line.source, f"{abs(line.std):.2g}", percentage)


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
