"""The paper recomputed: audit of its tables, investigation of Table 5, figures."""

from pipelines.paper.audit import Explanation, audit, investigate
from pipelines.paper.command import paper_command
from pipelines.paper.figures import draw_figures
from pipelines.paper.printed import Cell, as_rows

__all__ = [
    "Cell",
    "Explanation",
    "as_rows",
    "audit",
    "draw_figures",
    "investigate",
    "paper_command",
]
