"""Setup file of a lab: schema, reading, checks and defaults."""
