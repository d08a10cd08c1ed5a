"""Clips that ship with the package, and the scene renderer that made them."""
