"""Effect catalogue shared by simulator, renderer and mismatch engine.

The catalogue is loaded when first used: a measurement needs drag and lift only.
"""

from typing import TYPE_CHECKING, Any

from physics.effects.base import (
    MAX_SIZE,
    CameraView,
    Contact,
    Coordinate,
    Effect,
    EffectId,
    Extent,
    FlightState,
    Form,
    Level,
    Outcome,
    Parameter,
    Phase,
    Size,
    SwingState,
    Term,
    Values,
)

if TYPE_CHECKING:
    from physics.effects.catalogue import CATALOGUE, MEASUREMENT_IDS, effect_named

__all__ = [
    "CATALOGUE",
    "MAX_SIZE",
    "MEASUREMENT_IDS",
    "CameraView",
    "Contact",
    "Coordinate",
    "Effect",
    "EffectId",
    "Extent",
    "FlightState",
    "Form",
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

_OF_CATALOGUE = ("CATALOGUE", "MEASUREMENT_IDS", "effect_named")


def __getattr__(name: str) -> Any:
    if name in _OF_CATALOGUE:
        from physics.effects import catalogue

        return getattr(catalogue, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
