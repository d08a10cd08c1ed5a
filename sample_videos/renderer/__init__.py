"""The scene renderer: stage, light, bodies and sensor to pictures."""
