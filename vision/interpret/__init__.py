"""What happens to a tracked object: motion models, segments and events, kind with a probability."""

from vision.interpret.kinds import Interpretation, Kind, interpret
from vision.interpret.models import Observations
from vision.interpret.segments import Event, EventKind, Model, Segment

__all__ = [
    "Event",
    "EventKind",
    "Interpretation",
    "Kind",
    "Model",
    "Observations",
    "Segment",
    "interpret",
]
