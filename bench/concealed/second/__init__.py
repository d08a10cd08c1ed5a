"""Second generator, with laws, contact and solver of its own."""
