"""The house in numbers and as a picture."""
