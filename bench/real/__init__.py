"""Real recordings by others, with physics missing from their simple model."""
