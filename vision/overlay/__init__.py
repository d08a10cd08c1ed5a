"""The overlay video: every frame with what was found in it."""

__all__ = ["OVERLAY_SUFFIXES"]

OVERLAY_SUFFIXES = (".mp4", ".mov", ".mkv")
"""Kinds of file an overlay can be."""
