"""Followers that are split off from their platoons, why, and when they are back.

A follower is in its platoon while its law's target is its true predecessor, and the gap is at most SPLIT_GAP_FACTOR
times the gap that the law wants, or at most SPLIT_GAP_MARGIN longer. It is split off once that has not been so for
SPLIT_AFTER; and from an order to join until it has joined. While it is split off and its gap is longer than that, it is
left behind.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import shapely

from platoontraffic.observation.hindrances import Hindrances
from platoontraffic.observation.limits import Limits
from platoontraffic.observation.locks import NOTHING, Locks
from platoontraffic.observation.splits_kernel import BEGINS, update
from platoontraffic.observation.step import Cause, Step
from platoontraffic.world.events import Event
from platoontraffic.world.traffic import TrafficSnapshot


class Splits:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, scale: np.ndarray, locks: Locks, hindrances: Hindrances, limits: Limits) -> None:
        """scale: size of each member beside a car, (N,); SPLIT_GAP_MARGIN shrinks with it"""
        n, self._scale = len(scale), scale
        self._locks, self._hindrances, self._limits = locks, hindrances, limits
        self.split = np.zeros(n, dtype=bool)  # those split off now
        self.left_behind = np.zeros(n, dtype=bool)
        self._begun = np.full(n, np.nan)  # start of the last split [s]
        self._apart_since = np.full(n, np.nan)  # [s]; NaN: in its platoon
        self._follows, self._here = np.zeros((2, n), dtype=bool)  # one step before

    def observe(self, step: Step, gap: np.ndarray, desired_gap: np.ndarray) -> Iterator[Event]:
        """split, rejoined

        gap, desired_gap: (n,) [m], NaN where there is none
        """
        fleet, time = step.fleet, step.traffic.time
        number, predecessor, locked = fleet.number, fleet.predecessor, self._locks.locked
        own = self._scale, self.split, self.left_behind, self._begun, self._apart_since, self._follows, self._here
        changes = np.empty(number.size, dtype=np.int8)
        if not update(time, number, predecessor, fleet.native, locked, gap, desired_gap, own, changes):
            return
        for i in (changes == BEGINS).nonzero()[0]:
            cause = self._cause(step, i)
            yield step.event("split", i, step.traffic.ids[predecessor[i]], what=cause.what, detail=cause.detail)
        for i in (changes > BEGINS).nonzero()[0]:
            self._hindrances.forget_hold(number[i])
            if predecessor[i] >= 0:
                yield step.event("rejoined", i, step.traffic.ids[predecessor[i]], time - self._begun[number[i]])

    def _cause(self, step: Step, row: int) -> Cause:
        number, ahead = step.fleet.number[row], step.fleet.predecessor[row]
        if cause := self._hindrances.lately(number, step.traffic.time):
            return cause
        if self._limits.reason(number) == "beside":
            return Cause("beside", "no room beside it to go over to the lane of its predecessor")
        body = self._limits.body(number) if self._limits.reason(number) == "obstacle" else ""
        if body and body != step.traffic.ids[ahead]:
            return Cause("blocked", f"blocked by {body}")
        if between := _between(step.traffic, row, ahead):
            return Cause("between", f"{', '.join(between)} between")
        if self._locks.locked[number]:
            return Cause("fell_behind", "fell behind")
        target, beams = self._locks.target[number], np.nan_to_num(self._locks.beams[number])
        if target != NOTHING:
            return Cause("taken", f"took {target} for its predecessor")
        if beams:
            return Cause("not_recognised", f"not recognised, though {beams:g} beams hit it")
        return Cause("out_of_sight", "out of sight")


def _between(traffic: TrafficSnapshot, row: int, ahead: int) -> list[str]:
    """Vehicles on the straight line from one vehicle's front to another's rear, rows of `traffic`."""
    ends = [
        (traffic.x[k] + side * traffic.length[k] / 2 * np.cos(traffic.heading[k]),
         traffic.y[k] + side * traffic.length[k] / 2 * np.sin(traffic.heading[k]))
        for k, side in ((row, 1), (ahead, -1))
    ]  # fmt: skip
    boxes = shapely.polygons(traffic.boxes().corners())
    met = np.flatnonzero(shapely.intersects(boxes, shapely.LineString(ends)))
    return sorted(traffic.ids[k] for k in met if k not in (row, ahead) and not traffic.are_apart(row, k))
