"""`vision paper`: the tables beside the print, the investigation of Table 5, and the figures."""

import json
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from metrology import UsageError, write_text_whole
from pipelines.paper.audit import audit
from pipelines.paper.cells import Cell, as_rows
from pipelines.paper.conclusions import conclusions, draw_sensitivities, swing_checks
from pipelines.paper.figures import draw_figures
from pipelines.paper.table5 import Explanation, investigate
from pipelines.terminal import screen

__all__ = ["paper_command", "paper_document"]


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
        str | None, typer.Option("--json", help="Cells as JSON; - for stdout.", metavar="FILE")
    ] = None,
    csv_to: Annotated[Path | None, typer.Option("--csv", help="Cells as CSV.")] = None,
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
