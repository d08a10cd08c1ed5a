"""Where a mismatch sits and what was left out."""
