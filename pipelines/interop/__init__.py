"""Tracks and tables of other programs: read into one form, and written so that they open there."""
