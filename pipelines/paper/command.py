"""`vision paper`: the tables beside the print, the investigation of Table 5, and the figures.

The generated parts of docs/model.md: the audit, the candidates for Table 5, the pictures.

Run ``python -m pipelines.paper.command docs/model.md`` after a change of the physics.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from metrology import UsageError, write_text_whole
from physics.bodies import BALLS
from pipelines.doors import FileRole
from pipelines.paper.audit import (
    ALLOWANCE,
    Explanation,
    audit,
    conclusions,
    contact_candidate,
    draw_sensitivities,
    implied_fits,
    investigate,
    measured_speeds,
    swing_checks,
)
from pipelines.paper.figures import draw_figures
from pipelines.paper.printed import Cell, as_rows
from pipelines.terminal import screen

__all__ = ["paper_command", "sections"]


def paper_document(
    cells: tuple[Cell, ...], explanations: tuple[Explanation, ...]
) -> dict[str, Any]:
    """The contract's JSON with the candidates for Table 5 and the checks of the text added."""
    return {
        "cells": as_rows(cells),
        "table_5": [
            {
                "candidate": e.name,
                "data": e.data,
                "parameters": dict(e.parameters),
                "rms_m": e.rms,
                "largest_m": e.largest,
                "allowed": e.allowed,
                "believable_values": e.physical,
            }
            for e in explanations
        ],
        "conclusions": [asdict(conclusion) for conclusion in conclusions()],
        "swing": [asdict(check) for check in swing_checks()],
    }


def _cell_table(cells: tuple[Cell, ...], number: int, notes: list[str]) -> Table:
    table = Table(title=f"Table {number}")
    for name, justify in (("row", "left"), ("column", "left")):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for name in ("print", "ours", "difference"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    table.add_column("note", justify="right")
    for cell in cells:
        if cell.table == number:
            mark = str(notes.index(cell.note) + 1) if cell.note else ""
            table.add_row(
                cell.row,
                cell.column,
                f"{cell.printed:.6g}",
                f"{cell.ours:.6g}",
                f"{cell.difference:+.2g}",
                cell.verdict,
                mark,
            )
    return table


def _candidate_table(explanations: tuple[Explanation, ...]) -> Table:
    table = Table(title="Table 5: what could be missing")
    for name in ("data", "candidate"):
        table.add_column(name)
    for name in ("rms (mm)", "largest (mm)"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    for e in explanations:
        verdict = "allowed" if e.allowed else "excluded"
        if e.allowed and not e.physical:
            verdict = "fits, with values no lab would have"
        table.add_row(e.data, e.name, f"{e.rms * 1e3:.1f}", f"{e.largest * 1e3:.1f}", verdict)
    return table


def paper_command(
    json_to: Annotated[
        str | None,
        typer.Option("--json", help="Cells as JSON; - for stdout.", metavar="FILE"),
        FileRole.WRITES,
    ] = None,
    csv_to: Annotated[
        Path | None, typer.Option("--csv", help="Cells as CSV."), FileRole.WRITES
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Draw the figures into this folder.", metavar="DIR")
    ] = None,
    table: Annotated[int | None, typer.Option(help="Show only this table.", metavar="N")] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print no tables.")] = False,
) -> None:
    """Recompute every table of the paper beside the print, and redraw its figures.

    Example: vision paper --table 6 --figures figures
    """
    cells = audit()
    if table is not None:
        if table not in {cell.table for cell in cells}:
            raise UsageError(f"there is no table {table} to recompute", hint="Tables 2 to 10.")
        cells = tuple(cell for cell in cells if cell.table == table)
    explained = table in (None, 5)
    candidates = (*investigate("simulated"), *investigate("experiment")) if explained else ()
    document = json.dumps(
        paper_document(cells, candidates), indent=2, ensure_ascii=False, allow_nan=False
    )
    if csv_to is not None:
        _write_csv(csv_to, cells)
    if figures is not None:
        draw_figures(figures)
        draw_sensitivities(figures / "sensitivity_of_cor.png")
    if json_to not in (None, "-"):
        write_text_whole(Path(str(json_to)), document + "\n")
    if json_to == "-":
        sys.stdout.write(document + "\n")
    elif not quiet:
        _show(cells, candidates)


def _write_csv(path: Path, cells: tuple[Cell, ...]) -> None:
    import pandas as pd

    write_text_whole(path, pd.DataFrame(as_rows(cells)).to_csv(index=False))


def _show(cells: tuple[Cell, ...], candidates: tuple[Explanation, ...]) -> None:
    console = screen()
    for number in sorted({cell.table for cell in cells}):
        notes = list(dict.fromkeys(c.note for c in cells if c.table == number and c.note))
        console.print(_cell_table(cells, number, notes))
        for count, note in enumerate(notes, 1):
            console.print(f"  {count}: {note}")
    if candidates:
        console.print(_candidate_table(candidates))
    for conclusion in conclusions():
        values = ", ".join(f"{name} {value:+.3f}" for name, value in conclusion.elasticity.items())
        word = "holds" if conclusion.holds else "does not hold"
        console.print(f"{conclusion.claim}: {word} ({values})")
    for check in swing_checks():
        if check.flagged:
            console.print(
                f"{check.ball}, {check.backswing_deg} deg: the measured {check.measured:.4f} m/s is"
                f" above the frictionless limit of {check.limit:.4f} m/s; it needs"
                f" {check.backswing_needed_deg:.1f} deg",
            )
    for verdict, count in Counter(cell.verdict for cell in cells).most_common():
        console.print(f"{count:4d} cells: {verdict}")


PICTURES = ("02", "05", "12", "22", "27")

"""Figures of the paper shown on the page."""


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _audit_section(cells: tuple[Cell, ...]) -> str:
    counts = Counter((cell.table, cell.verdict) for cell in cells)
    verdicts = list(dict.fromkeys(cell.verdict for cell in cells))
    tables = sorted({cell.table for cell in cells})
    summary = _table(
        ("table", *verdicts),
        [(str(t), *(str(counts.get((t, v), 0)) for v in verdicts)) for t in tables],
    )
    parts = [summary]
    for number in tables:
        mine = [cell for cell in cells if cell.table == number]
        rows = [
            (
                cell.row,
                cell.column,
                f"{cell.printed:.6g}",
                f"{cell.ours:.5g}",
                f"{cell.difference:+.2g}",
                cell.verdict,
                cell.note,
            )
            for cell in mine
        ]
        header = ("row", "column", "print", "ours", "difference", "verdict", "note")
        parts.append(f"#### Table {number}\n\n{_table(header, rows)}")
    return "\n\n".join(parts)


def _candidates_section() -> str:
    rows = []
    for data in ("simulated", "experiment"):
        for e in investigate(data):
            if not e.allowed:
                verdict = "excluded"
            else:
                verdict = "allowed" if e.physical else "fits, with values no lab would have"
            count = str(len(e.parameters))
            rows.append(
                (data, e.name, count, f"{e.rms * 1e3:.1f}", f"{e.largest * 1e3:.1f}", verdict)
            )
    allowance = ", ".join(f"{name} {value * 1e3:.0f} mm" for name, value in ALLOWANCE.items())
    header = ("distances", "candidate", "free numbers", "rms (mm)", "largest (mm)", "verdict")
    return f"Largest miss allowed: {allowance}.\n\n{_table(header, rows)}"


def _launch_section() -> str:
    rows = []
    for name in BALLS:
        constant, turned = contact_candidate(name)
        for speed, fixed, angle in zip(measured_speeds(name), constant, turned, strict=True):
            rows.append((name, f"{speed:.3f}", f"{fixed:.1f}", f"{angle:.1f}"))
    header = ("ball", "impact speed (m/s)", "paper's launch angle (deg)", "contact in time (deg)")
    return _table(header, rows)


def _conclusions_section() -> str:
    rows = [
        (
            c.claim,
            *(f"{c.elasticity[name]:+.3f}" for name in BALLS),
            "holds" if c.holds else "does not hold",
        )
        for c in conclusions()
    ]
    return _table(("claim", *BALLS, "verdict"), rows)


def _swing_section() -> str:
    rows = [
        (
            check.ball,
            str(check.backswing_deg),
            f"{check.measured:.4f}",
            f"{check.measured / check.limit:.4f}",
            f"{check.backswing_needed_deg:.1f}",
            "too fast" if check.flagged else "",
        )
        for check in swing_checks()
    ]
    header = ("ball", "back-swing (deg)", "speed (m/s)", "of the limit", "needs (deg)", "flag")
    return _table(header, rows)


def _fits_section() -> str:
    rows = []
    for name in BALLS:
        for fit in implied_fits(name):
            values = ", ".join(
                f"{p.name} {p.value:.4f} ({p.low:.4f} to {p.high:.4f})" for p in fit.parameters
            )
            rows.append(
                (name, fit.model, values, str(fit.dof), f"{fit.chi2:.3g}", f"{fit.bic:.4g}")
            )
    return _table(("ball", "law", "parameters (95 %)", "dof", "χ²", "BIC"), rows)


def sections() -> dict[str, str]:
    """All generated parts by the name in their markers."""
    return {
        "launch": _launch_section(),
        "conclusions": _conclusions_section(),
        "fits": _fits_section(),
        "swing": _swing_section(),
        "table-5": _candidates_section(),
        "audit": _audit_section(audit()),
    }


def filled(text: str, parts: dict[str, str]) -> str:
    """`text` with what stands between ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->`` replaced.

    Raises
    ------
    UsageError
        If a marker is missing.
    """
    for name, part in parts.items():
        pattern = re.compile(f"(<!-- {name}:begin -->).*?(<!-- {name}:end -->)", re.DOTALL)
        found = pattern.search(text)
        if found is None:
            raise UsageError(f"the page has no place for {name!r}")
        begin, end = (f"<!-- {name}:{edge} -->" for edge in ("begin", "end"))
        text = "".join((text[: found.start()], begin, "\n", part, "\n", end, text[found.end() :]))
    return text


def refresh(page: Path) -> None:
    """Fill the page's generated parts and draw its pictures beside it."""
    write_text_whole(page, filled(page.read_text(encoding="utf-8"), sections()))
    folder = page.parent / "pictures"
    for path in draw_figures(folder, only=PICTURES):
        path.replace(folder / f"model_{path.name}")
    draw_sensitivities(folder / "model_sensitivity.png")


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    refresh(Path(sys.argv[1]))
