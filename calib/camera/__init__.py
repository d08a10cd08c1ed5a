"""The camera: lens, pose, calibration boards, and lens files."""
