"""A measurement on one page: results, checks, plots and uncertainty budgets.

What the page and the plots are made of; `page` and `plots` draw them, and are imported where they
are wanted.
"""

from pipelines.report.inputs import (
    Check,
    CheckKind,
    CheckOutcome,
    Curve,
    GapRecord,
    Moment,
    PathRecord,
    ReportInput,
    SpeedRecord,
    quantity_label,
)

__all__ = [
    "Check",
    "CheckKind",
    "CheckOutcome",
    "Curve",
    "GapRecord",
    "Moment",
    "PathRecord",
    "ReportInput",
    "SpeedRecord",
    "quantity_label",
]
