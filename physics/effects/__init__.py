"""The effect catalogue: one object each, for simulator, renderer and mismatch engine."""

from physics.effects.base import (
    LARGEST_SIZE,
    CameraView,
    Contact,
    Coordinate,
    Effect,
    EffectId,
    Extent,
    FlightState,
    Level,
    Outcome,
    Parameter,
    Phase,
    Size,
    SwingState,
    Term,
    Values,
)
from physics.effects.catalogue import CATALOGUE, MEASUREMENT_IDS, effect_named

__all__ = [
    "CATALOGUE",
    "LARGEST_SIZE",
    "MEASUREMENT_IDS",
    "CameraView",
    "Contact",
    "Coordinate",
    "Effect",
    "EffectId",
    "Extent",
    "FlightState",
    "Level",
    "Outcome",
    "Parameter",
    "Phase",
    "Size",
    "SwingState",
    "Term",
    "Values",
    "effect_named",
]
