"""Clips with known truth: following, gravity, and the shipped samples."""
