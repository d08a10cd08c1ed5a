"""Read clips, track ball and pendulum mass, and find events."""
