"""Blind test of the mismatch engine on campaigns with concealed physics."""
