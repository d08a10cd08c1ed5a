"""Speed, completeness and size of the page in a real browser."""
