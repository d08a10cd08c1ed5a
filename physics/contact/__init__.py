"""Pendulum and ball in contact: laws, their solution in time, and the instantaneous impact."""
