"""Frames to tracks: reading clips, finding and following the ball and the pendulum mass, events."""
