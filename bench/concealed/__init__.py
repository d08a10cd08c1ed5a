"""The blind proof of the mismatch engine: campaigns with concealed physics, and their scoring."""
