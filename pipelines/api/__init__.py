"""Python interface: the work of the commands, with results for notebooks."""
