"""From tracks to quantities: contact, flight, gravity, checks, uncertainties."""
