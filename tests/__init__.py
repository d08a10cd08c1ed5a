"""Tests of the package and its benchmarks."""
