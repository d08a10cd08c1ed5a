"""A second world, which shares no law, no contact and no solver with the first or the engine."""
