"""Motions that are measurements in their own right: free flights and drops, swings, collisions."""
