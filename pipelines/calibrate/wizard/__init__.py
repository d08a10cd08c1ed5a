"""The calibration wizard: from a clip to a setup file in six steps."""
