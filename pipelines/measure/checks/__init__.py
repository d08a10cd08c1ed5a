"""What a measurement is held against, and what follows where it does not hold."""
