"""Calibration: lens, camera pose, wall grid and ball plane; pixels to metres."""
