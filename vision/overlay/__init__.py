"""The overlay video: every frame with what was found in it."""
