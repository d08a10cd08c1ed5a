"""The calibration wizard: six steps from a clip to a setup file, as a page or on a terminal."""
