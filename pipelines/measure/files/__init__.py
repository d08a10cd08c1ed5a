"""A measurement as files: table, JSON, CSV, tracks, pictures."""
