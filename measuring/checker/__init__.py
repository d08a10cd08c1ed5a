"""Contradictions among the inputs of a measurement, with cause and cure."""
