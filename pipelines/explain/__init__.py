"""`vision explain`: find and name the physics missing from the model."""
