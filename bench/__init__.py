"""Measurements of how well the package does what it says; not installed with it."""
