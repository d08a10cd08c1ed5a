"""The ball in the air: forces, integration, closed form."""
