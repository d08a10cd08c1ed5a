"""Where simulation and recording differ, what was left out, and how much better the new model is."""

from mismatch.baseline import Baseline, BallModel, ContactTable, Scatter
from mismatch.campaign import Campaign, Trial
from mismatch.explain import Explained, Options, explain, explain_in_full
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
