"""The forward model of all trials, with any set of effects."""
