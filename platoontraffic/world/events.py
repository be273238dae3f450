"""What happens in a run: rows of events.csv. Their kinds stand in `recording.KINDS`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Event(NamedTuple):
    time: float
    kind: str
    vehicle: str
    other: str
    x: float
    y: float
    edge: str
    duration: float  # of what has ended with this event; NaN: nothing has
    detail: str


class Noted(NamedTuple):
    """What happens to a member that is not seen by watching it."""

    row: int  # -1: it is not on the road
    kind: str
    detail: str
    duration: float = np.nan
    other: str = ""
    vehicle: str = ""  # who that is, if it is not on the road
