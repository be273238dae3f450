"""Tracks the predecessor by laser, and remembers its path."""
