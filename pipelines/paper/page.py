"""The generated parts of docs/model.md: the audit, the candidates for Table 5, the pictures.

Run ``python -m pipelines.paper.page docs/model.md`` after a change of the physics.
"""

import re
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from metrology import UsageError, write_text_whole
from physics.bodies import BALLS
from pipelines.paper.audit import audit
from pipelines.paper.cells import Cell
from pipelines.paper.conclusions import (
    conclusions,
    draw_sensitivities,
    implied_fits,
    swing_checks,
)
from pipelines.paper.figures import draw_figures
from pipelines.paper.speeds import measured_speeds
from pipelines.paper.table5 import ALLOWANCE, contact_candidate, investigate

__all__ = ["PICTURES", "refresh", "sections"]

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
