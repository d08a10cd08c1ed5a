"""Pages of `vision app`, one module each."""
