"""How many numeric constants tell their unit and source."""
