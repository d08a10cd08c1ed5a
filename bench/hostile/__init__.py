"""Hostile inputs at every door: drawn, run as a user would, counted by what came of them."""
