"""The ball: candidates among what moved, joined into paths, chosen, and followed."""
