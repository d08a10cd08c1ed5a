"""The error classes of this project and their exit codes.

::

    ImpactVisionError
    ├── UsageError                 2  a wrong option, unit, name or combination
    │   ├── SetupError             2  the setup file is wrong; names the place and the nearest key
    │   ├── UnitError              2  "50 parsecs of mm" is not a length
    │   ├── OutputError            2  a file can't be written: no folder, no permission, disk full
    │   └── DomainError            2  a number outside what the physics allows (also a ValueError)
    ├── ClipError                  3  the clip can't be read: missing, truncated, no video in it
    └── MeasurementError           4  read, but the quantity can't be measured from it
        ├── NotFoundError          4  no ball, no pendulum, no contact, no landing in view
        ├── CalibrationError       4  no grid, wrong pitch, too few views, camera moved
        ├── TooLittleDataError     4  too few trials or points
        └── NoFitError             4  no model can be fitted: singular, not finite, no optimum

Every error has a message that states what is wrong and where, and a hint on what to do.
"""

from typing import ClassVar

__all__ = [
    "CalibrationError",
    "ClipError",
    "DomainError",
    "ImpactVisionError",
    "MeasurementError",
    "NoFitError",
    "NotFoundError",
    "OutputError",
    "SetupError",
    "TooLittleDataError",
    "UnitError",
    "UsageError",
]


class ImpactVisionError(Exception):
    """Base class of all errors that this project raises on purpose.

    Parameters
    ----------
    message : str
        What is wrong, and where.
    hint : str, optional
        What to do.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    @property
    def in_one_line(self) -> str:
        """Message and hint in one line, as the reason of a missing quantity."""
        return self.message if self.hint is None else f"{self.message}. {self.hint}"

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message}\n{self.hint}"


class UsageError(ImpactVisionError):
    """A wrong option, name or combination of options."""

    exit_code = 2


class SetupError(UsageError):
    """The setup file is wrong; the message names the key and the nearest right one."""


class UnitError(UsageError):
    """A text that is not a quantity of the required dimension."""


class OutputError(UsageError):
    """A file can't be written."""


class DomainError(UsageError, ValueError):
    """A number outside the domain in which a law holds or a body can exist."""


class ClipError(ImpactVisionError):
    """The clip can't be read."""

    exit_code = 3


class MeasurementError(ImpactVisionError):
    """The clip was read, but the quantity can't be measured from it."""

    exit_code = 4


class NotFoundError(MeasurementError):
    """An object is not in the picture: ball, pendulum, contact, landing."""


class CalibrationError(MeasurementError):
    """Pixels can't be converted to metres: no grid, wrong pitch, too few views."""


class TooLittleDataError(MeasurementError):
    """Too few trials or points."""


class NoFitError(MeasurementError):
    """No model can be fitted to these numbers: singular, not finite, or without an optimum."""
