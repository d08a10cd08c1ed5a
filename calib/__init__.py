"""Pixels to metres: lens, pose, wall grid, projection, depth of the ball plane, time base."""
