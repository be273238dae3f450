"""The road network, routes on it, and lines with stations."""
