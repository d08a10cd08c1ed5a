"""Concealed campaigns rendered as clips, measured and explained."""
