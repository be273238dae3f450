"""Vehicles: how commands become motion, and the motion that vehicles measure of themselves."""
