"""Tables with a few numbers per trial."""
