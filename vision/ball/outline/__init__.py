"""The sub-pixel outline of a ball against the known background."""
