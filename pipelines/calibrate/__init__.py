"""`vision calibrate`: lenses, walls, capture rates, plans and the wizard."""
