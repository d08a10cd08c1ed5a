"""The measuring chain: tracks in metres, swing, flight, contact, and the quantities that follow."""
