"""Clips as they come: opened, timed, decoded into upright frames."""
