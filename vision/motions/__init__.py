"""Motion of a tracked object: models, segments, events, probable kind."""

from vision.motions.kinds import Interpretation, interpret
from vision.motions.models import Observations
from vision.motions.segments import Event, EventKind, Model, Segment

__all__ = [
    "Event",
    "EventKind",
    "Interpretation",
    "Model",
    "Observations",
    "Segment",
    "interpret",
]
