"""The wall grid: found by itself, at sub-pixel precision."""
