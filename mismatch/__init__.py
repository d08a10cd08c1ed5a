"""Where simulation and recording differ, what physics was left out, and how much better the new model is."""
