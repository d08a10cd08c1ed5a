"""Clips with known truth: followed objects, and the shipped samples."""
