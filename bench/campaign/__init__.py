"""Measure what a campaign must reach."""
