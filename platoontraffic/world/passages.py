"""A vehicle passes the end of an edge."""

from __future__ import annotations

from typing import NamedTuple


class Passage(NamedTuple):
    """A row of passages.csv: the front bumper has crossed the end of a lane in the last step."""

    time: float  # [s]
    edge: str
    lane: int  # index
    vehicle: str
    type: str  # a member from the traffic: the type that it had there
    member: bool
    speed: float  # [m/s]
