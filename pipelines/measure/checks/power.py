"""When a check that found nothing may say "passed"."""

__all__ = ["LEAST_POWER"]

LEAST_POWER = 0.5
"""Probability of noticing an error that matters; a check that would rather miss it can't tell."""
