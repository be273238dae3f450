"""Contacts between members and other vehicles or walls, and gaps that come close to one."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from platoontraffic.observation.step import Step
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import LANE_CHANGE_BLAME, NEAR_MISS_GAP, Event
from platoontraffic.world.traffic import TrafficSnapshot

LANE_CHANGE = 1.0  # sideways motion in one step that is a lane change [m]: SUMO's vehicles change lanes at once
SAME_DIRECTION = 0.5  # least cosine between two headings for one vehicle to strike the other from behind

DETAILS = {
    "": "",
    "struck_from_behind": "struck from behind",
    "struck_other_from_behind": "struck it from behind",
    "other_changed_lanes": "the other one changed lanes into its path",
    "beside": "side by side or head on",
}


class Collisions:
    """Episodes of contact; `touching` are the pairs of this step, as in `Contacts.of`."""

    def __init__(self, contacts: Contacts) -> None:
        self._contacts = contacts
        self._lane_changes = LaneChanges()
        self.touching: set[tuple[str, str]] = set()

    def observe(self, step: Step) -> Iterator[Event]:
        """collision"""
        traffic = step.traffic
        self._lane_changes.observe(traffic, len(step.fleet))
        before, self.touching = self.touching, self._contacts.of(traffic)
        for vehicle, other in sorted(self.touching - before):
            i = traffic.ids.index(vehicle)
            what = "other_changed_lanes" if self._lane_changes.lately(other, step.time) else _impact(traffic, i, other)
            yield step.event("collision", i, other, what=what, detail=DETAILS[what])


class LaneChanges:
    """When background vehicles last changed lanes."""

    def __init__(self) -> None:
        self._before: TrafficSnapshot | None = None
        self._times: dict[str, float] = {}  # by vehicle [s]

    def observe(self, traffic: TrafficSnapshot, n: int) -> None:
        """The vehicles behind the first n of the snapshot, which are members."""
        before, self._before = self._before, traffic
        if before is not None and before.ids == traffic.ids:
            was = np.arange(n, len(traffic.ids))
        else:
            row = {name: k for k, name in enumerate(before.ids)} if before else {}
            was = np.array([row.get(name, -1) for name in traffic.ids[n:]], dtype=int)
        here = np.arange(n, len(traffic.ids))[was >= 0]
        was = was[was >= 0]
        if not len(here):
            return
        dx, dy = traffic.x[here] - before.x[was], traffic.y[here] - before.y[was]
        aside = np.abs(dy * np.cos(traffic.heading[here]) - dx * np.sin(traffic.heading[here]))
        for k in here[aside > LANE_CHANGE]:
            self._times[traffic.ids[k]] = traffic.time

    def lately(self, vehicle: str, time: float) -> bool:
        return time - self._times.get(vehicle, -np.inf) < LANE_CHANGE_BLAME


class NearMisses:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, scale: np.ndarray) -> None:
        """scale: size of each member beside a car, (N,); NEAR_MISS_GAP shrinks with it"""
        self._scale = scale
        self._near = np.zeros(len(scale), dtype=bool)  # one step before

    def observe(self, step: Step, gap: np.ndarray, touching: set[tuple[str, str]]) -> Iterator[Event]:
        """near_miss

        gap     : (n,) [m], NaN where there is none
        touching: pairs in contact, as in `Contacts.of`
        """
        number, ids = step.number, step.traffic.ids
        near = gap < NEAR_MISS_GAP * self._scale[number]
        for i in np.flatnonzero(near & ~self._near[number]):
            vehicle, ahead = ids[i], ids[step.fleet.predecessor[i]]
            if not touching & {(vehicle, ahead), (ahead, vehicle)}:
                yield step.event("near_miss", i, ahead, detail=f"gap {gap[i]:.3f} m")
        self._near[number] = near


def _impact(traffic: TrafficSnapshot, row: int, other: str) -> str:
    """The kind of a collision, by the position of the other's centre in the frame of the vehicle in `row`.

    "" where `other` is a wall
    """
    if other not in traffic.ids:
        return ""
    k = traffic.ids.index(other)
    cos, sin = math.cos(traffic.heading[row]), math.sin(traffic.heading[row])
    dx, dy = traffic.x[k] - traffic.x[row], traffic.y[k] - traffic.y[row]
    along, aside = dx * cos + dy * sin, dy * cos - dx * sin
    if abs(along) <= abs(aside) or math.cos(traffic.heading[k] - traffic.heading[row]) < SAME_DIRECTION:
        return "beside"
    return "struck_from_behind" if along < 0 else "struck_other_from_behind"
