"""Replay of a run: one HTML page, made from the run's files; it opens from disk without a network."""

from platoontraffic.replay.content import NoMembersError
from platoontraffic.replay.page import page, page_of_two

__all__ = ["NoMembersError", "page", "page_of_two"]
