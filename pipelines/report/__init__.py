"""One-page report: results, checks, plots and uncertainty budgets.

`page` and `plots` draw it; they are imported only where needed.
"""

from pipelines.report.inputs import (
    Curve,
    GapRecord,
    Moment,
    PathRecord,
    ReportInput,
    SpeedRecord,
    quantity_label,
)

__all__ = [
    "Curve",
    "GapRecord",
    "Moment",
    "PathRecord",
    "ReportInput",
    "SpeedRecord",
    "quantity_label",
]
