"""Hostile inputs to every command: drawn at random, run, and counted by outcome."""
