"""Vehicles: how commands become motion, and what they know of it."""
