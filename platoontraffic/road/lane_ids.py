"""Ids of lanes, which SUMO makes of the id of the edge and the lane's index from the right: `north_0`."""

from __future__ import annotations


def edge_of(lane: str) -> str:
    return lane.rpartition("_")[0]


def index_of(lane: str) -> int:
    """0: the rightmost one; on left-hand roads the leftmost one."""
    return int(lane.rpartition("_")[2])
