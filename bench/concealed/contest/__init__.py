"""Contestants: the engine, and what others would do."""
