"""Studies: one scenario at many points, the batches that run them, and their tables."""
