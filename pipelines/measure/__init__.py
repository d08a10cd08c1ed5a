"""Measurement of clips: metres, swing, flight, contact, quantities."""
