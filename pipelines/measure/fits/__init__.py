"""Fits of swing, contact and flight, and the checks beside them."""
