"""The wizard as a page in the browser."""
