"""The effect catalogue: one object each, for simulator, renderer and mismatch engine."""

from physics.effects.base import (
    Contact,
    Effect,
    Flight,
    Outcome,
    Parameter,
    Phase,
    Swing,
    Values,
    View,
)
from physics.effects.catalogue import CATALOGUE, MEASUREMENT_IDS, catalogue_with, effect_named

__all__ = [
    "CATALOGUE",
    "MEASUREMENT_IDS",
    "Contact",
    "Effect",
    "Flight",
    "Outcome",
    "Parameter",
    "Phase",
    "Swing",
    "Values",
    "View",
    "catalogue_with",
    "effect_named",
]
