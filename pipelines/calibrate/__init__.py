"""`vision calibrate`: set-up of a clip, lenses, walls, capture rates, plans."""
