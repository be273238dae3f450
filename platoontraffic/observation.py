"""What is measured of a run from outside: gaps, paths, locks, and the events that follow from them.

Nothing here is known to a law. Definitions stand in `recording.TRAJECTORIES` and `recording.EVENTS`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from lidar import ScanBatch
from platoontraffic.contact import Contacts
from platoontraffic.fleet import Fleet, desired_distance
from platoontraffic.network import Network
from platoontraffic.polyline import Polyline
from platoontraffic.traffic import TrafficSnapshot

NOTHING, WALL = -2, -1  # what a target lies on, when it is not a row of the snapshot
STANDSTILL_AFTER = 10.0  # standing longer is an event [s]
STANDING = 1e-3  # slower than this is standing [m/s, rad/s]
BEAMS_ABOUT = 3  # a target's bearing may fall between beams, or on one that met nothing


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


@dataclass(frozen=True)
class Measures:
    """One instant, seen from outside. Arrays (n,), NaN where there is no predecessor or no value."""

    gap: np.ndarray  # bumper to bumper along the predecessor's path [m]
    gap_error: np.ndarray  # against what the follower's law wants at its speed [m]
    time_gap: np.ndarray  # gap / own speed [s]
    seen_gap: np.ndarray  # as the law sees it [m]
    seen_bearing: np.ndarray  # [rad]
    cross_track: np.ndarray  # of the driven axle, to the left of the path of the predecessor's [m]
    right_of_middle: np.ndarray  # of the centre, to the right of the road's middle line [m]
    target: np.ndarray  # row of the snapshot, WALL or NOTHING


class Observer:
    """Follows a fleet from step to step: `watch` in every step, `measure` in those that are recorded."""

    def __init__(self, fleet: Fleet, network: Network, contacts: Contacts) -> None:
        n = len(fleet)
        self._network = network
        self._contacts = contacts
        self._driven = [_path_so_far(fleet, i) for i in range(n)]
        self._station = [0.0] * n  # of each member on its predecessor's path
        self._measured = [path.end for path in self._driven]  # how far each had driven when it was last measured
        self._target = np.full(n, NOTHING)
        self._target_before = self._target
        self._locked: list[float | None] = [None] * n  # since when; None: not locked
        self._lost: list[float | None] = [None] * n  # since when; None: not lost, or never locked
        self._standing_since = np.full(n, np.nan)
        self._at_standstill = np.zeros(n, dtype=bool)
        self._touching: set[tuple[str, str]] = set()
        self._off_road = np.zeros(n, dtype=bool)

    def watch(
        self, traffic: TrafficSnapshot, fleet: Fleet, scans: Sequence[ScanBatch | None], roads: list[tuple[str, str]]
    ) -> list[Event]:
        """The events of this step."""
        seen = self._take_targets(fleet, scans)
        x, y = fleet.model.axle_position(fleet.motion)
        for path, point_x, point_y, speed in zip(self._driven, x, y, fleet.motion.speed, strict=True):
            if speed < 0:
                path.retract(point_x, point_y)
            else:
                path.append(point_x, point_y)

        row = {m.id: i for i, m in enumerate(fleet.members)}

        def event(kind: str, i: int, other: str = "", duration: float = np.nan, detail: str = "") -> Event:
            where = traffic.x[i], traffic.y[i], roads[i][0]
            return Event(traffic.time, kind, fleet.members[i].id, other, *where, duration, detail)

        return [
            *self._lock_events(traffic, fleet, seen, event),
            *self._standstill_events(traffic, fleet, event),
            *self._contact_events(traffic, row, event),
            *self._road_events(x, y, event),
        ]

    def measure(self, fleet: Fleet) -> Measures:
        n, model, motion = len(fleet), fleet.model, fleet.motion
        gap, gap_error, cross_track = (np.full(n, np.nan) for _ in range(3))
        x, y = model.axle_position(motion)
        for i, ahead in enumerate(fleet.predecessor):
            if ahead < 0:
                continue
            path = self._driven[ahead]
            driven = abs(self._driven[i].end - self._measured[i])
            reach = 2 * (model.length[i] + driven)
            self._station[i], cross_track[i] = path.project(x[i], y[i], near=self._station[i], window=reach)
            self._measured[i] = self._driven[i].end
            front = self._station[i] + model.length[i] / 2 - model.axle[i]
            rear = path.end - model.length[ahead] / 2 - model.axle[ahead]
            gap[i] = rear - front
            member = fleet.members[i]
            gap_error[i] = gap[i] - (desired_distance(member, motion.speed[i]) - member.seen_ahead_of_gap)
        laser_to_bumper = np.array([m.seen_ahead_of_gap for m in fleet.members])
        with np.errstate(divide="ignore"):
            time_gap = np.where(motion.speed > STANDING, gap / motion.speed, np.nan)
        right = self._network.right_of_middle(motion.x, motion.y, motion.heading)
        seen = fleet.target.distance - laser_to_bumper
        return Measures(gap, gap_error, time_gap, seen, fleet.target.bearing, cross_track, right, self._target.copy())

    def _take_targets(self, fleet: Fleet, scans: Sequence[ScanBatch | None]) -> np.ndarray:
        """Note what each law's target lies on; how many beams hit each member's predecessor (n,), -1: no new scan."""
        seen = np.full(len(fleet), -1)
        for group, batch in zip(fleet.groups, scans, strict=True):
            if batch is None:
                continue
            bearing = fleet.target.bearing[group.rows]
            model = batch.model
            for k, i in enumerate(group.rows):
                hits = np.where(batch.ranges[k] < np.inf, batch.hits[k], NOTHING)  # without returns that were lost
                seen[i] = np.count_nonzero(hits == fleet.predecessor[i]) if fleet.predecessor[i] >= 0 else 0
                self._target[i] = NOTHING
                if np.isnan(bearing[k]):
                    continue
                beam = round((bearing[k] - model.angle_min) / model.angle_increment)
                about = hits[max(beam - BEAMS_ABOUT, 0) : max(beam + BEAMS_ABOUT + 1, 0)]
                found = about[about != NOTHING]
                if len(found):
                    self._target[i] = np.bincount(found - WALL).argmax() + WALL
        return seen

    def _lock_events(self, traffic: TrafficSnapshot, fleet: Fleet, seen: np.ndarray, event) -> Iterator[Event]:
        for i, ahead in enumerate(fleet.predecessor):
            if ahead < 0 or seen[i] < 0:
                continue
            target, before = self._target[i], self._target_before[i]
            if target not in (ahead, before, NOTHING):
                yield event("wrong_target", i, _name(traffic, target))
            if target == ahead:
                if self._locked[i] is None:
                    if self._lost[i] is None:
                        yield event("locked", i, fleet.members[ahead].id)
                    else:
                        yield event("lock_regained", i, fleet.members[ahead].id, traffic.time - self._lost[i])
                    self._locked[i], self._lost[i] = traffic.time, None
            elif self._locked[i] is not None:
                self._locked[i], self._lost[i] = None, traffic.time
                if target != NOTHING:
                    cause = "took another for it"
                elif seen[i]:
                    cause = f"not recognised, though {seen[i]} beams hit it"
                else:
                    cause = "out of sight"
                yield event("lock_lost", i, _name(traffic, target), detail=cause)
        self._target_before = self._target.copy()

    def _standstill_events(self, traffic: TrafficSnapshot, fleet: Fleet, event) -> Iterator[Event]:
        """One event a standstill, when it has lasted STANDSTILL_AFTER; one more when it ends, with its duration."""
        moving = (np.abs(fleet.motion.speed) > STANDING) | (np.abs(fleet.motion.yaw_rate) > STANDING)
        self._standing_since[moving & ~self._at_standstill] = np.nan
        began = np.isnan(self._standing_since) & ~moving
        self._standing_since[began] = traffic.time
        duration = traffic.time - self._standing_since
        for i in np.flatnonzero(~moving & (duration > STANDSTILL_AFTER) & ~self._at_standstill):
            self._at_standstill[i] = True
            yield event("standstill", i, detail=f"since {self._standing_since[i]:.3f} s")
        for i in np.flatnonzero(moving & self._at_standstill):
            self._at_standstill[i] = False
            yield event("standstill_end", i, duration=duration[i])
            self._standing_since[i] = np.nan

    def _contact_events(self, traffic: TrafficSnapshot, row: dict[str, int], event) -> Iterator[Event]:
        touching = self._contacts.of(traffic)
        for vehicle, other in sorted(touching - self._touching):
            yield event("collision", row[vehicle], other)
        self._touching = touching

    def _road_events(self, x: np.ndarray, y: np.ndarray, event) -> Iterator[Event]:
        off = ~shapely.contains_xy(self._network.drivable, x, y)
        for i in np.flatnonzero(off & ~self._off_road):
            yield event("off_road", i)
        self._off_road = off


def _path_so_far(fleet: Fleet, i: int) -> Polyline:
    """A member's path begins where the one behind it stands, so that this one is on it from the start."""
    x, y = fleet.model.axle_position(fleet.motion)
    behind = np.flatnonzero(fleet.predecessor == i)
    if len(behind):
        back = np.array([x[behind[0]], y[behind[0]]])
    else:
        heading = fleet.motion.heading[i]
        back = np.array([x[i], y[i]]) - fleet.model.length[i] * np.array([np.cos(heading), np.sin(heading)])
    return Polyline(np.array([back, (x[i], y[i])]))


def _name(traffic: TrafficSnapshot, target: int) -> str:
    return {NOTHING: "", WALL: "wall"}[target] if target < 0 else traffic.ids[target]
