"""Fits of a model to records, and their proof on data kept aside."""
