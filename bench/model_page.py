"""Compute the tables and figures of the page on the model from the paper recomputed.

Run: python -m bench.model_page; then python -m bench.insert fills docs/model.md from
docs/results/model.json.
"""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from metrology.files import write_text_whole
from physics.bodies import BALLS
from physics.cor_fit import CorLawFit, CorPoints, LawKind, fit_cor_laws
from pipelines import paper

__all__ = ["tables"]

DOCS = Path(__file__).parents[1] / "docs"
RESULTS = DOCS / "results" / "model.json"
PAGE_FIGURES = ("02", "05", "12", "22", "27")
"""Figures shown on the page."""

Rows = list[tuple[str, ...]]


def _launch() -> Rows:
    rows: Rows = [
        ("ball", "impact speed (m/s)", "paper's launch angle (deg)", "time-resolved (deg)")
    ]
    for name, ball in BALLS.items():
        fixed = f"{np.rad2deg(ball.launch_angle):.1f}"
        turned = np.rad2deg(np.asarray(paper.launched(name, True, "variable").launch_angle))
        for speed, angle in zip(paper.measured_speeds(name), turned, strict=True):
            rows.append((name, f"{speed:.3f}", fixed, f"{angle:.1f}"))
    return rows


def _conclusions() -> Rows:
    rows: Rows = [("claim", *BALLS, "verdict")]
    for one in paper.conclusions():
        numbers = (f"{one.elasticity[name]:+.3f}" for name in BALLS)
        rows.append((one.claim, *numbers, "holds" if one.holds else "does not hold"))
    return rows


def implied_fits(name: str) -> tuple[CorLawFit, ...]:
    """Laws of restitution fitted to the four e implied by Table 6, the preferred first.

    The uncertainty is that of the table's last digit.
    """
    cor, share = paper.implied_cor(BALLS[name])
    return fit_cor_laws(
        CorPoints(
            speed=paper.measured_speeds(name),
            cor=cor,
            std=1e-4 / np.sqrt(12.0) / share,
            shared=np.zeros((len(cor), 0)),
            session=np.zeros(len(cor), dtype=np.int64),
        ),
        strike_scatter=False,
    )


def _fits() -> Rows:
    rows: Rows = [("ball", "law", "parameters (95 %)", "probability")]
    for name in BALLS:
        for fit in implied_fits(name):
            values = ", ".join(
                f"{key} {p.value:.4f} ({p.low:.4f} to {p.high:.4f})"
                for key, p in fit.parameters.items()
                if fit.law is not LawKind.FREE
            )
            rows.append((name, str(fit.law), values, f"{fit.probability:.3g}"))
    return rows


def _swing() -> Rows:
    rows: Rows = [
        ("ball", "back-swing (deg)", "speed (m/s)", "relative to limit", "needs (deg)", "flag")
    ]
    for one in paper.swing_checks():
        numbers = f"{one.measured:.4f}", f"{one.measured / one.limit:.4f}"
        needed, flag = f"{one.backswing_needed_deg:.1f}", "too fast" if one.flagged else ""
        rows.append((one.ball, str(one.backswing_deg), *numbers, needed, flag))
    return rows


def _candidates() -> Rows:
    rows: Rows = [
        (
            "distances",
            "candidate",
            "parameters",
            "rms (mm)",
            "largest (mm)",
            "allowed (mm)",
            "verdict",
        )
    ]
    for data in paper.MAX_MISFIT_M:
        for one in paper.fit_candidates(data):
            sizes = [f"{1e3 * size:.1f}" for size in (one.rms_m, one.largest_m)]
            sizes.append(f"{1e3 * paper.MAX_MISFIT_M[data]:.0f}")
            rows.append((data, one.candidate, str(len(one.parameters)), *sizes, one.verdict))
    return rows


def _audit() -> Rows:
    cells = paper.audit()
    counts = Counter((cell.table, cell.verdict) for cell in cells)
    verdicts = list(dict.fromkeys(cell.verdict for cell in cells))
    numbers = sorted({cell.table for cell in cells})
    counted = [(str(n), *(str(counts[n, verdict]) for verdict in verdicts)) for n in numbers]
    return [("table", *verdicts), *counted]


def tables() -> dict[str, Sequence[Any]]:
    """Rows of each table of the page, the header first."""
    return {
        "launch": _launch(),
        "conclusions": _conclusions(),
        "fits": _fits(),
        "swing": _swing(),
        "candidates": _candidates(),
        "audit": _audit(),
    }


def main() -> None:
    """Write tables and figures."""
    np.seterr(all="raise", under="ignore")
    write_text_whole(RESULTS, json.dumps(tables(), indent=1, ensure_ascii=False) + "\n")
    pictures = DOCS / "pictures"
    for path in paper.draw_figures(pictures, only=PAGE_FIGURES):
        path.replace(pictures / f"model_{path.name}")
    paper.draw_sensitivities(pictures / "model_sensitivity.png")


if __name__ == "__main__":
    main()
