"""The paper recomputed: audit of its tables, investigation of Table 5, figures."""

from pipelines.paper.audit import Cell, Explanation, as_rows, audit, investigate
from pipelines.paper.command import draw_figures, paper_command

__all__ = [
    "Cell",
    "Explanation",
    "as_rows",
    "audit",
    "draw_figures",
    "investigate",
    "paper_command",
]
