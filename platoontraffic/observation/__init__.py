"""Measurements of a run from outside, and the events that follow from them."""
