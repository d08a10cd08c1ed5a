"""The coefficient of restitution: laws, fits, and the inversion of Eq. 17."""
