"""Foundation of all packages: errors, quantities, units, least squares, files."""

from metrology.defaults import Default, Defaults
from metrology.errors import (
    CalibrationError,
    ClipError,
    DomainError,
    ImpactVisionError,
    MeasurementError,
    NoFitError,
    NotFoundError,
    OutputError,
    SetupError,
    TooLittleDataError,
    UnitError,
    UsageError,
)
from metrology.files import (
    parse_toml,
    read_small_text,
    refuse_unwritable,
    write_each,
    write_text_whole,
    written_whole,
)
from metrology.measurands import (
    Given,
    Measurand,
    parse_measured,
    parse_quantity,
    read_given,
    read_number,
    read_scale,
)
from metrology.quantity import Contribution, Quantity, UncertaintySource

__all__ = [
    "CalibrationError",
    "ClipError",
    "Contribution",
    "Default",
    "Defaults",
    "DomainError",
    "Given",
    "ImpactVisionError",
    "Measurand",
    "MeasurementError",
    "NoFitError",
    "NotFoundError",
    "OutputError",
    "Quantity",
    "SetupError",
    "TooLittleDataError",
    "UncertaintySource",
    "UnitError",
    "UsageError",
    "measurands",
    "parse_measured",
    "parse_quantity",
    "parse_toml",
    "read_given",
    "read_number",
    "read_scale",
    "read_small_text",
    "refuse_unwritable",
    "write_each",
    "write_text_whole",
    "written_whole",
]
