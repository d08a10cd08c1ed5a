"""Read and write tracks and tables of other programs."""
