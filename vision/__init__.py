"""Clip to tracks: read frames, find and track the ball and the pendulum mass, find events."""
