"""The next stop lines of members, where they need not be judged: while they are so far away that the traffic about them
does not count, and between two looks.

Most members drive between junctions. Whether their lines are still far is decided for all of them at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.path_kernel import LOOK
from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.sumo.ego import Ego, checks_from

BACK = 1.0  # distance by which a member may be farther back than it was [m], as where its place is found anew


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
        _copy([*self._columns(), *self.state], [*other._columns(), *other.state], places)
        for k, j in places:
            self.lines[k] = other.lines[j]

    def _columns(self) -> Iterator[np.ndarray]:
        yield from (self._lane, self._station, self._begins, self._looks_from, self.by_light, self.changes)

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

    def still(self, front: np.ndarray, speed: np.ndarray, lanes: Sequence[str]) -> tuple[np.ndarray, LineState]:
        """Which members still have a far line, (n,); and the lines of all: those of the others do not count.

        front: stations of the front bumpers [m]
        speed: [m/s]
        lanes: on which they are
        """
        distance, looks_from = self._station - front, self._looks_from
        is_far = np.where(np.isnan(looks_from), distance >= checks_from(speed, self._length), distance > looks_from)
        is_far &= (self._lane == np.array(lanes, object)) & (front > self._begins)
        return is_far, LineState(distance, *(values.copy() for values in self.state[1:]))


class LastLook:
    """The lines of n members as they were judged last; between two looks each of them comes nearer."""

    def __init__(self, n: int) -> None:
        self._front = np.full(n, np.nan)  # station of the front bumper then [m]; NaN: it has not been judged
        self._state = LineState(*(np.zeros(n, kind) for kind in (float, bool, bool, bool, int)))

    def take_over(self, other: LastLook, places: Sequence[tuple[int, int]]) -> None:
        """Lines of others: place here, place there."""
        _copy((self._front, *self._state), (other._front, *other._state), places)

    def note(self, front: np.ndarray, state: LineState) -> None:
        """They have been judged. front: stations of the front bumpers [m]"""
        self._front, self._state = front, state

    def now(self, front: np.ndarray) -> tuple[np.ndarray, LineState]:
        """Which members have not been judged, or are beyond their lines by now, (n,); and the lines of all.

        front: stations of the front bumpers [m]; on a closed route they begin anew
        """
        driven = front - self._front
        distance = self._state.distance - np.nan_to_num(driven)
        is_over = (self._state.distance > 0) & (distance <= 0)
        is_new = ~(driven >= -BACK)  # so is the begin of another lap
        return is_new | is_over, self._state._replace(distance=distance)


def _copy(mine: Sequence[np.ndarray], others: Sequence[np.ndarray], places: Sequence[tuple[int, int]]) -> None:
    """Copy values of arrays. places: place here, place there"""
    if not places:
        return
    here, there = (list(column) for column in zip(*places, strict=True))
    for values, its in zip(mine, others, strict=True):
        values[here] = its[there]
