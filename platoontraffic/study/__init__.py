"""Studies: many runs, and their tables."""
