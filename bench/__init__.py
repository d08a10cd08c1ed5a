"""Benchmarks of accuracy, robustness and speed; not installed with the package."""
