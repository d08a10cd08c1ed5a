"""The pendulum mass: found, followed on its arc, and its striking face."""
