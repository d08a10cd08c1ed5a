"""Where simulation and recording differ, what was left out, and how the new model does."""

from mismatch.explain import Explained, Options, explain, explain_in_full
from mismatch.model.baseline import BallModel, Baseline, ContactTable, Scatter
from mismatch.records.records import Campaign, Trial
from mismatch.verdict import Verdict

__all__ = [
    "BallModel",
    "Baseline",
    "Campaign",
    "ContactTable",
    "Explained",
    "Options",
    "Scatter",
    "Trial",
    "Verdict",
    "explain",
    "explain_in_full",
]
