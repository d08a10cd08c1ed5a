"""Random scenes with a pendulum and a ball: rendered, followed and measured."""
