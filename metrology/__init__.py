"""The ground every room stands on: error tree, quantities, unit strings, whole files."""

from metrology.errors import (
    CalibrationError,
    ClipError,
    DomainError,
    ImpactVisionError,
    MeasurementError,
    NotFoundError,
    SetupError,
    TooLittleDataError,
    UnitError,
    UsageError,
)
from metrology.files import write_text_whole, written_whole
from metrology.quantity import Contribution, Quantity
from metrology.sources import UncertaintySource
from metrology.units import parse_quantity, parse_with_uncertainty

__all__ = [
    "CalibrationError",
    "ClipError",
    "Contribution",
    "DomainError",
    "ImpactVisionError",
    "MeasurementError",
    "NotFoundError",
    "Quantity",
    "SetupError",
    "TooLittleDataError",
    "UncertaintySource",
    "UnitError",
    "UsageError",
    "parse_quantity",
    "parse_with_uncertainty",
    "write_text_whole",
    "written_whole",
]
