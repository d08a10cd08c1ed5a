"""`vision simulate` and `vision plan`: the forward model and its inversion."""
