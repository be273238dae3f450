"""Locks: the object that each law takes for its predecessor, and how much of the true one its scan shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar import ScanBatch
from platoontraffic.observation.hindrances import Hindrances
from platoontraffic.observation.locks_kernel import NOT_SCANNED, count_in, look_rows
from platoontraffic.observation.step import Cause, Step
from platoontraffic.vehicles.records import every
from platoontraffic.world.events import Event
from platoontraffic.world.under_way import Seen

NOTHING = ""  # the target of a law that has none, or that lies on no surface
NEVER = -2  # number of the predecessor of a member that has not scanned


class Locks:
    """Arrays (N,) of all members of the run, by their number; each as of the scan that the member used last."""

    def __init__(self, n: int, hindrances: Hindrances) -> None:
        self._hindrances = hindrances
        self.target = np.full(n, NOTHING, dtype=object)  # id of a vehicle, WALL or NOTHING
        self.locked = np.zeros(n, dtype=bool)  # the target is the true predecessor
        self._lost_since = np.full(n, np.nan)  # [s]; NaN: never locked, or not lost
        self.beams = np.full(n, np.nan)  # on the predecessor
        self.occluded = np.full(n, np.nan)  # share of the beams that would meet the predecessor if it were alone
        self._ahead = np.full(n, NEVER)  # number of the predecessor; -1: none
        # One step before, where all members scanned: ids of all bodies, numbers of the members, their predecessors, and
        # the surfaces that their targets were on.
        self._latest: tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray] | None = None

    def observe(self, step: Step, scans: Sequence[ScanBatch | None], split: np.ndarray) -> Iterator[Event]:
        """wrong_target, locked, lock_regained, lock_lost

        scans: one a group of the fleet, None where it has used none in this step
        split: members that are split off, (N,) bool
        """
        fleet, ids = step.fleet, step.traffic.ids
        sight = _sight(step, scans)
        scanned = count_in(fleet.number, sight.beams, sight.alone, self.beams, self.occluded)
        latest, self._latest, looked = self._latest, None, sight.beams != NOT_SCANNED
        if scanned == fleet.number.size and all([seen.traffic is step.traffic for seen in step.seen]):
            self._latest = ids, fleet.number, fleet.predecessor, sight.surface
            if latest and ids == latest[0] and fleet.number is latest[1] and fleet.predecessor is latest[2]:
                looked = sight.surface != latest[3]  # for all others as at the last scan, so what is locked is too
        rows = looked.nonzero()[0]
        if not rows.size:
            return
        number, ahead = fleet.number[rows], fleet.predecessor[rows]
        # By id, since a row of the snapshot may be another vehicle in the next step.
        targets, before = _surfaces(step, sight, looked)[rows], self.target[number]
        number_ahead = np.where(ahead < 0, -1, fleet.number[ahead])
        if every(self._ahead[number] == number_ahead) and targets.tolist() == before.tolist():
            return
        other = number[(self._ahead[number] != number_ahead) & (number_ahead >= 0)]
        self.locked[other], self._lost_since[other] = False, np.nan  # on the new one it has never been locked
        self._ahead[number] = number_ahead
        ids, self.target[number] = np.array(ids[: len(fleet)], dtype=object), targets
        leaders, follows = number[ahead < 0], ahead >= 0
        self.locked[leaders], self._lost_since[leaders] = False, np.nan
        yield from self._compare(step, rows[follows], ids[ahead[follows]], before[follows], split)

    def _compare(
        self, step: Step, rows: np.ndarray, ahead: np.ndarray, before: np.ndarray, split: np.ndarray
    ) -> Iterator[Event]:
        """Targets against predecessors; rows: of followers with a new scan; ahead, before: ids of their predecessors
        and former targets; all (m,)."""
        number = step.fleet.number[rows]
        target, was_locked = self.target[number], self.locked[number]
        locked = target == ahead
        self.locked[number] = locked
        wrong = ~locked & (target != before) & (target != NOTHING) & ~split[number]
        for k in wrong.nonzero()[0]:
            yield step.event("wrong_target", rows[k], target[k])
        for k in (locked & ~was_locked).nonzero()[0]:
            since = self._lost_since[number[k]]
            if np.isnan(since):
                yield step.event("locked", rows[k], ahead[k])
            else:
                yield step.event("lock_regained", rows[k], ahead[k], step.traffic.time - since)
        for k in (~locked & was_locked).nonzero()[0]:
            self._lost_since[number[k]] = step.traffic.time
            cause = self._cause(number[k])
            yield step.event("lock_lost", rows[k], target[k], what=cause.what, detail=cause.detail)

    def _cause(self, number: int) -> Cause:
        """Why a member's lock was lost at its last scan."""
        if self._hindrances.laser_is_broken(number):
            return Cause("broken", "its laser is broken")
        if self.target[number] != NOTHING:
            return Cause("taken", "took another for its predecessor")
        if beams := self.beams[number]:
            return Cause("not_recognised", f"not recognised, though {beams:g} beams hit it")
        return Cause("out_of_sight", "out of sight")


class Sight(NamedTuple):
    """Contents of the scans of a step, (n,) int; valid where `beams` is not NOT_SCANNED."""

    surface: np.ndarray  # that most beams about the target's bearing met: as in `ScanBatch.hits`; NO_HIT: no target
    beams: np.ndarray  # returns from the predecessor; 0 without one
    alone: np.ndarray  # beams that meet the predecessor, were there nothing else and no errors


def _sight(step: Step, scans: Sequence[ScanBatch | None]) -> Sight:
    fleet, contents = step.fleet, np.empty((3, step.fleet.number.size), dtype=np.intp)
    contents[:] = NOT_SCANNED
    sight = Sight(*contents)
    for group, scan, seen in zip(fleet.groups, scans, step.seen, strict=True):
        if scan is None:
            continue
        ahead = fleet.predecessor[group.rows]
        if seen.traffic is not step.traffic:  # a row may have been another vehicle then
            ids = [fleet.members[i].id if i >= 0 else "" for i in ahead]
            ahead = np.array([seen.traffic.ids.index(one) if one in seen.traffic.ids else -1 for one in ids])
        look(scan, seen, group.rows, fleet.target.bearing, ahead, sight)
    return sight


def _surfaces(step: Step, sight: Sight, wanted: np.ndarray) -> np.ndarray:
    """Names of the surfaces that the targets lie on, (n,), where they are wanted and there is a scan."""
    names = np.empty(step.fleet.number.size, dtype=object)
    for group, seen in zip(step.fleet.groups, step.seen, strict=True):
        if seen is not None:
            rows = group.rows[wanted[group.rows]]
            names[rows] = [seen.traffic.surfaces[hit] for hit in sight.surface[rows].tolist()]
    return names


def look(scan: ScanBatch, seen: Seen, rows: np.ndarray, bearing: np.ndarray, ahead: np.ndarray, sight: Sight) -> None:
    """Fill in `sight` for the rows (m,) of the fleet that these scans belong to.

    `alone` is counted by the middles of the beams at the instant at which the scan ends.

    bearing : of the targets, (n,)
    ahead   : rows of the predecessors in the traffic that was seen, (m,); -1: there is none
    """
    model, traffic = scan.model, seen.traffic
    if "look" not in model.kept:
        eye = float(model.mount.x), float(model.mount.y), float(model.mount.yaw)
        model.kept["look"] = (float(model.angle_min), model.angle_increment, float(model.range_max)), eye
    fan, eye = model.kept["look"]
    boxes = traffic.x, traffic.y, traffic.heading, traffic.length, traffic.width
    places = rows, seen.rows, ahead
    look_rows(places, scan.ranges, scan.hits, model.directions, fan, eye, boxes, bearing, *sight)
