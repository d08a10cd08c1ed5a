"""Inputs as people hand them in: what comes out of each."""
