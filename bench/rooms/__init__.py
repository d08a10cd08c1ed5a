"""Rooms, pendulums, balls and cameras drawn at random, filmed and followed."""
