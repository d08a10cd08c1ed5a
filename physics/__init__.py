"""Physics of pendulum, impact and flight, with an effect catalogue.

Numbers are floats in SI; there is no input or output.
"""
