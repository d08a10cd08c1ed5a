"""What happens to a tracked object: motion models, segments and events, kind with a probability."""

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
