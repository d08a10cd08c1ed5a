"""The paper's model and beyond it: pendulum, impact, restitution, air, flight, effects.

Floats in SI, no input or output.
"""
