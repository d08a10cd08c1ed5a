"""The project's least squares, under the name that fits import."""

from metrology.least_squares import Fitted, fit

__all__ = ["Fitted", "fit"]
