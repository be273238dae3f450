"""How close members come to all other bodies: distances between outlines, times to collision, near misses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from platoontraffic.observation import closeness_kernel
from platoontraffic.observation.step import Step
from platoontraffic.world.events import (
    CLEARANCE_REACH,
    CONTACT_HORIZON,
    NEAR_MISS_GAP,
    NEAR_MISS_SPEED,
    Event,
)
from platoontraffic.world.traffic import TrafficSnapshot

CLOSE = 1e-3  # distance from which on two bodies do not touch, whatever is rounded [m]
NOTHING = np.empty(0, dtype=np.intp)  # no rows
PAIRS = 4  # pairs a member that can begin to be near in one step


class Closeness:
    """Arrays (N,) of all members of the run, by their number, as of the last step; NaN where there is nothing."""

    def __init__(self, scale: np.ndarray) -> None:
        """scale: size of each member beside a car, (N,); NEAR_MISS_GAP shrinks with it"""
        n, self._near_gap = len(scale), NEAR_MISS_GAP * scale  # [m]
        self.clearance, self.contact_in = np.full((2, n), np.nan)
        self._closest: tuple[np.ndarray, tuple[str, ...]] = NOTHING, ()  # rows in the last step, ids
        self.may_touch = NOTHING  # rows of members that a body may touch, and of those bodies
        self._pairs = np.empty((0, 2), dtype=np.intp)  # rows of those that are near
        self._near: set[tuple[str, str]] = set()  # one step before

    def look(self, step: Step) -> None:
        """Measure the distances of this step."""
        number, bodies = step.fleet.number, _bodies(step.traffic)
        rows, pairs = np.empty(number.size, dtype=np.intp), np.empty((PAIRS * number.size, 2), dtype=np.intp)
        limits = CLOSE, CLEARANCE_REACH, CONTACT_HORIZON, self._near_gap, NEAR_MISS_SPEED
        found = self.clearance, rows, self.contact_in, pairs
        count, any_close = closeness_kernel.look(bodies, number, *limits, *found)
        self._pairs, self._closest = pairs[:count], (rows, step.traffic.ids)
        self.may_touch = NOTHING
        if any_close:
            self.may_touch = _about(step.traffic, (self.clearance[number] < CLOSE).nonzero()[0])

    def closest(self) -> np.ndarray:
        """Ids of the bodies closest to the members on the road in the last step, "" where there is none, (n,)."""
        rows, ids = self._closest
        return np.array([ids[k] if k >= 0 else "" for k in rows.tolist()], dtype=object)

    def observe(self, step: Step, touching: set[tuple[str, str]]) -> Iterator[Event]:
        """near_miss_other, by the distances of `look`

        touching: pairs in contact, as in `Contacts.of`
        """
        traffic, predecessor, before = step.traffic, step.fleet.predecessor, self._near
        n, self._near = predecessor.size, set()
        for i, k in self._pairs.tolist():
            if predecessor[i] == k or (k < n and predecessor[k] == i) or traffic.are_apart(i, k):
                continue
            pair = traffic.ids[i], traffic.ids[k]
            self._near.add(pair)
            if pair not in before and not touching & {pair, pair[::-1]}:
                speed = np.hypot(*(_velocity(traffic, k) - _velocity(traffic, i)))
                detail = f"within {self._near_gap[step.fleet.number[i]]:.2f} m at {speed:.1f} m/s against each other"
                yield step.event("near_miss_other", i, pair[1], detail=detail)


def look_around(traffic: TrafficSnapshot, n: int, near: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of the first n bodies: clearance [m], row of the closest body, time to contact [s], (n,), and the pairs that are
    nearer than `near` (n,) [m] and move against each other, (m, 2). As in `closeness_kernel.look_around`."""
    (clearance, contact_in), closest = np.empty((2, n)), np.empty(n, dtype=np.intp)
    pairs = np.empty((PAIRS * n, 2), dtype=np.intp)
    limits = CLEARANCE_REACH, CONTACT_HORIZON, near, NEAR_MISS_SPEED
    count = closeness_kernel.look_around(_bodies(traffic), n, *limits, clearance, closest, contact_in, pairs)
    return clearance, closest, contact_in, pairs[:count]


def _bodies(traffic: TrafficSnapshot) -> tuple[np.ndarray, ...]:
    """The fields of `closeness_kernel.Bodies`, but whole lengths and widths."""
    return traffic.x, traffic.y, *traffic.facing, traffic.length, traffic.width, traffic.speed


def _about(traffic: TrafficSnapshot, rows: np.ndarray) -> np.ndarray:
    """Rows of these bodies, and of all that may be nearer to one of them than `CLOSE`, in order."""
    radius = np.hypot(traffic.length, traffic.width) / 2 + CLOSE
    x, y = (values[rows, None] - values for values in (traffic.x, traffic.y))
    return (np.hypot(x, y) <= radius[rows, None] + radius).any(axis=0).nonzero()[0]


def _velocity(traffic: TrafficSnapshot, row: int) -> np.ndarray:
    return traffic.speed[row] * np.array([np.cos(traffic.heading[row]), np.sin(traffic.heading[row])])
