"""Find where simulation and recording differ, and what is missing."""

from mismatch.explain import ExplainedCampaign, Options, explain, explain_in_full
from mismatch.records import (
    BallModel,
    Baseline,
    CampaignRecords,
    ContactTable,
    Scatter,
    Trial,
)
from mismatch.verdict import EngineVerdict

__all__ = [
    "BallModel",
    "Baseline",
    "CampaignRecords",
    "ContactTable",
    "EngineVerdict",
    "ExplainedCampaign",
    "Options",
    "Scatter",
    "Trial",
    "explain",
    "explain_in_full",
]
