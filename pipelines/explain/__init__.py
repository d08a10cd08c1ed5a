"""`vision explain`: where simulation and recording differ, and what was left out."""
