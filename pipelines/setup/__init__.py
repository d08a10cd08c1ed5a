"""The setup file: what a lab knows, read once and checked."""
