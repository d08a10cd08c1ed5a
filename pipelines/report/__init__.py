"""A measurement on one page: results, checks, plots and uncertainty budgets."""

from pipelines.report.inputs import (
    Check,
    Curve,
    GapRecord,
    Moment,
    PathRecord,
    ReportInput,
    SpeedRecord,
)
from pipelines.report.labels import quantity_label
from pipelines.report.page import report_html, write_report
from pipelines.report.plots import write_plot

__all__ = [
    "Check",
    "Curve",
    "GapRecord",
    "Moment",
    "PathRecord",
    "ReportInput",
    "SpeedRecord",
    "quantity_label",
    "report_html",
    "write_plot",
    "write_report",
]
