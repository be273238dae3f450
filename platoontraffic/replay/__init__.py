"""A run as one HTML page that plays it: made from the run's files, opened from disk, without a network."""

from platoontraffic.replay.page import page

__all__ = ["page"]
