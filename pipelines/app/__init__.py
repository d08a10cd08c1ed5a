"""The page of `vision app`: open, measure, correct, export."""
