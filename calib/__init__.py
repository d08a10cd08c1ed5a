"""Pixels to metres: lens, camera pose, wall grid, projection onto the wall, depth of the ball plane, time base."""
