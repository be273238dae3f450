"""The next stop lines of members, while they are so far away that the traffic about them does not count.

Most members drive between junctions. Whether their lines are still far is decided for all of them at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.path_kernel import LOOK
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.sumo.ego import Ego, checks_from


class LineState(NamedTuple):
    """A row of `Signals`."""

    distance: float
    open: bool
    minor: bool
    changing: bool
    reason: int


class FarLines:
    """The far lines of n members. A line is judged again when its member is near, or comes to another lane."""

    def __init__(self, egos: Sequence[Ego]) -> None:
        n = len(egos)
        self._length = np.array([ego.length for ego in egos])  # of the members [m]
        self._lane = np.full(n, None)  # on which each member was; None: it has no far line
        self._station = np.zeros(n)  # of the line [m]
        self._begins = np.zeros(n)  # station of the line before [m]
        self._looks_from = np.zeros(n)  # distance from which it is judged [m]; NaN: the speed decides
        self.lines: list[Line | None] = [None] * n
        self.by_light = np.zeros(n, bool)  # a light decides whether it is open
        self.changes = np.zeros(n, bool)  # a lane change begins there
        self.state = LineState(*(np.zeros(n, kind) for kind in (float, bool, bool, bool, int)))  # but for the distance

    def take_over(self, other: FarLines, places: Sequence[tuple[int, int]]) -> None:
        """Far lines of others: place here, place there."""
        if not places:
            return
        here, there = (list(column) for column in zip(*places, strict=True))
        for name in ("_lane", "_station", "_begins", "_looks_from", "by_light", "changes"):
            getattr(self, name)[here] = getattr(other, name)[there]
        for mine, its in zip(self.state, other.state, strict=True):
            mine[here] = its[there]
        for k, j in places:
            self.lines[k] = other.lines[j]

    def note(self, k: int, ego: Ego, begins: float, line: Line, state: LineState, gives_way: bool) -> None:
        """Remember the next line of a member, if it is far.

        begins    : station of the line before [m]
        gives_way : whether the member looks for others before the line
        """
        looks_from = LOOK * ego.length if gives_way and not line.light else math.nan
        # As in `still`, where arrays would take long for one.
        is_far = state.distance >= ego.checks_from if math.isnan(looks_from) else state.distance > looks_from
        if not is_far:
            return
        self._lane[k], self._station[k] = ego.lane, line.station
        self._begins[k], self._looks_from[k] = begins, looks_from
        self.lines[k], self.by_light[k], self.changes[k] = line, bool(line.light), line.state == CHANGING
        for values, value in zip(self.state, state, strict=True):
            values[k] = value

    def still(self, front: np.ndarray, speed: np.ndarray, lanes: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Which members still have a far line, (n,), and the distances of those [m].

        front: stations of the front bumpers [m]
        speed: [m/s]
        lanes: on which they are
        """
        distance, looks_from = self._station - front, self._looks_from
        is_far = np.where(np.isnan(looks_from), distance >= checks_from(speed, self._length), distance > looks_from)
        return (self._lane == np.array(lanes, object)) & (front > self._begins) & is_far, distance


class LastLook:
    """The lines of n members as they were judged at the last look."""

    def __init__(self, egos: Sequence[Ego]) -> None:
        n = len(egos)
        self._front = np.full(n, np.nan)
        self._state = LineState(*(np.zeros(n, kind) for kind in (float, bool, bool, bool, int)))

    def take_over(self, other: LastLook, places: Sequence[tuple[int, int]]) -> None:
        if not places:
            return
        here, there = (list(column) for column in zip(*places, strict=True))
        self._front[here] = other._front[there]
        for mine, its in zip(self._state, other._state, strict=True):
            mine[here] = its[there]

    def are_over(self, front: np.ndarray) -> np.ndarray:
        driven = front - self._front
        distance = self._state.distance
        return ~(driven > -1.0) | ((distance > 0) & (distance <= driven))

    def state_at(self, front: np.ndarray) -> LineState:
        driven = front - self._front
        return self._state._replace(distance=np.where(np.isnan(driven), self._state.distance, self._state.distance - driven))

    def note(self, front: np.ndarray, state) -> None:
        self._front = front
        self._state = LineState(*state)
