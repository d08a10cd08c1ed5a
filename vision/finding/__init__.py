"""Find round moving objects: detect in each frame, link to tracklets, select."""
