"""Estimation of the predecessor by laser, and the path that it has driven."""
