"""`vision calibrate`: lenses, walls, rates, plans, and the wizard."""
