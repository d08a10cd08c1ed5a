"""Read video clips: open, time, and decode into upright frames."""
