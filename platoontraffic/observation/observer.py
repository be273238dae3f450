"""What is measured of a run from outside: gaps, paths, locks, and the events that follow from them.

Nothing here is known to a law. Definitions stand in `recording.TRAJECTORIES` and `recording.KINDS`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely

from platoontraffic.controllers import Signals
from platoontraffic.controllers.calls import desired_distance
from platoontraffic.geometry.driven_paths import DrivenPaths, compiled
from platoontraffic.lidar import ScanBatch
from platoontraffic.lidar.laserscan import NO_HIT
from platoontraffic.observation.splits import NEAR_MORE, NEAR_TIMES, Splits
from platoontraffic.road.network import Network
from platoontraffic.vehicles.motion import FULL_SIZE, scale
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import Event, Noted
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot

# Details of a collision that is not the member's fault.
STRUCK, CHANGED = "struck from behind", "the other one changed lanes into its way"
LANE_CHANGE, CHANGED_FOR = 1.0, 2.0  # sideways in one step [m]: SUMO's cars change lanes at once; and so long ago [s]
NOTHING, WALL = "", "wall"  # what a target lies on, when it is no vehicle
STANDSTILL_AFTER = 10.0  # standing longer is an event [s]
STANDING = 1e-3  # slower than this is standing, and slower approach is none [m/s, rad/s]
BEAMS_ABOUT = 3  # a target's bearing may fall between beams, or on one that met nothing
ROUND_ABOUT = 2.0  # so many times as far as it is straight ahead it may be on the way
PIECES = 24  # a driven path keeps no more points than these in a vehicle's length

OFF_ROAD = 0.3  # farther outside the drivable area is off the road [m]
NEAR_MISS = 0.5  # a smaller gap is one [m]
EMERGENCY = 4.5  # harder braking is one, of members of full size [m/s2]


@dataclass(frozen=True)
class Measures:
    """One instant, seen from outside. Arrays (n,), NaN where there is no predecessor or no value."""

    gap: np.ndarray  # bumper to bumper along the predecessor's path [m]
    gap_error: np.ndarray  # against what the follower's law wants at its speed [m]
    time_gap: np.ndarray  # gap / own speed [s]
    closing: np.ndarray  # own speed minus the predecessor's [m/s]
    time_to_collision: np.ndarray  # gap / closing [s]
    needed_braking: np.ndarray  # closing^2 / (2 gap) [m/s2]
    beams: np.ndarray  # of the last scan on the predecessor
    occluded: np.ndarray  # share of the beams that would be on it if nothing else were there
    seen_gap: np.ndarray  # as the law sees it [m]
    seen_bearing: np.ndarray  # [rad]
    cross_track: np.ndarray  # of the driven axle, to the left of the path of the predecessor's [m]
    right_of_middle: np.ndarray  # of the centre, to the right of the road's middle line [m]
    off_road: np.ndarray  # of the driven axle, outside the drivable area [m]; 0 on it
    jerk: np.ndarray  # change of the acceleration over the last step [m/s3]
    target: np.ndarray  # id of a vehicle, WALL or NOTHING


class Observer:
    """Follows a fleet from step to step: `watch` in every step, `measure` in those that are recorded.

    Members come and go. What is remembered of them stands in arrays (N,) of all that the run ever has, at the member's
    number; arrays (n,) are of those on the road now.
    """

    def __init__(self, members: Sequence[Member], network: Network, contacts: Contacts) -> None:
        """members: all that the run ever has, by their number"""
        n = len(members)
        self._members = members
        self._network = network
        self._contacts = contacts
        length = np.array([m.model.length for m in members])
        self._full_size = length >= FULL_SIZE
        self._scale = scale(length)
        self._laser_to_bumper = np.array([m.seen_ahead_of_gap for m in members])

        self._here = np.zeros(n, dtype=bool)
        self._before: _Step | None = None
        self._laws: list[tuple[Any, np.ndarray]] = []  # see _by_law
        self._paths = DrivenPaths(length / PIECES)
        self._end = np.zeros(n)  # of each member's own path, a step before
        self._station = np.zeros(n)  # of each member on its predecessor's path
        self._ahead = np.full(n, -1)  # number of the member whose path that is
        self._gap, self._cross_track = np.full((2, n), np.nan)
        self._beams, self._occluded = np.full((2, n), np.nan)
        self._target = np.full(n, NOTHING, dtype=object)
        self._locked = np.zeros(n, dtype=bool)
        self._lost_since = np.full(n, np.nan)  # NaN: never locked, or not lost
        self._splits = Splits(self._scale)
        self._standing_since = np.full(n, np.nan)
        self._at_standstill = np.zeros(n, dtype=bool)
        self._acceleration, self._jerk = np.zeros((2, n))
        self._braking = np.zeros(n, dtype=bool)
        self._outside = np.zeros(n)  # the drivable area [m]
        self._off_road_since = np.full(n, np.nan)  # NaN: on the road
        self._near = np.zeros(n, dtype=bool)
        self._touching: set[tuple[str, str]] = set()
        self._traffic: TrafficSnapshot | None = None  # a step before
        self._changed: dict[str, float] = {}  # when others changed lanes last

    def watch(
        self,
        traffic: TrafficSnapshot,
        fleet: Fleet,
        scans: Sequence[ScanBatch | None],
        roads: list[tuple[str, str]],
        signals: Signals | None = None,
        noted: Sequence[Noted] = (),
    ) -> list[Event]:
        """The events of this step, with those that were noted elsewhere; signals: as a World tells them."""
        x, y = fleet.model.axle_position(fleet.motion)

        def event(kind: str, i: int, other: str = "", duration: float = np.nan, detail: str = "") -> Event:
            where = traffic.x[i], traffic.y[i], roads[i][0]
            return Event(traffic.time, kind, traffic.ids[i], other, *where, duration, detail)

        events = [*self._come_and_go(traffic, fleet, x, y, roads, event)]
        for one in noted:
            if one.kind in ("breaks_down", "repaired"):
                broken = self._splits.broken[fleet.number[one.row]]
                (broken.add if one.kind == "breaks_down" else broken.discard)(one.detail)
            if one.row >= 0:
                events.append(event(one.kind, one.row, one.other, one.duration, one.detail))
            else:
                nowhere = np.nan, np.nan, "", np.nan
                events.append(Event(traffic.time, one.kind, one.vehicle, one.other, *nowhere, one.detail))
        self._drive(fleet, x, y)
        events += self._look(traffic, fleet, scans, event)
        events += self._splits.watch(traffic, fleet, signals, self._together(fleet), event)
        events += self._standstills(traffic, fleet, event)
        events += self._brakings(traffic, fleet, event)
        events += self._contacts_and_near_misses(traffic, fleet, event)
        events += self._leave_road(traffic, fleet, x, y, event)
        self._before = _Step(traffic.time, fleet.number, traffic.x, traffic.y, roads)
        return events

    def measure(self, fleet: Fleet) -> Measures:
        """Of the step that was watched last."""
        number, motion = fleet.number, fleet.motion
        gap, to_bumper = self._gap[number], self._laser_to_bumper[number]
        follows = fleet.predecessor >= 0
        closing = np.where(follows, motion.speed - motion.speed[fleet.predecessor], np.nan)
        nearing, ahead = closing > STANDING, np.where(gap > 0, gap, np.nan)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            time_gap = np.where(motion.speed > STANDING, gap / motion.speed, np.nan)
            time_to_collision = np.where(nearing, ahead / closing, np.nan)
            needed_braking = np.where(nearing, closing**2 / (2 * ahead), 0 * closing)
        return Measures(
            gap=gap,
            gap_error=gap - (_wanted_distance(self._laws, fleet) - to_bumper),
            time_gap=time_gap,
            closing=closing,
            time_to_collision=time_to_collision,
            needed_braking=needed_braking,
            beams=np.where(follows, self._beams[number], np.nan),
            occluded=np.where(follows, self._occluded[number], np.nan),
            seen_gap=fleet.target.distance - to_bumper,
            seen_bearing=fleet.target.bearing,
            cross_track=self._cross_track[number],
            right_of_middle=self._network.right_of_middle(motion.x, motion.y, motion.heading),
            off_road=self._outside[number],
            jerk=self._jerk[number],
            target=self._target[number],
        )

    def _together(self, fleet: Fleet) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """What `Splits.watch` goes by."""
        number = fleet.number
        wanted = _wanted_distance(self._laws, fleet) - self._laser_to_bumper[number]
        too_far = self._gap[number] - np.maximum(NEAR_TIMES * wanted, wanted + NEAR_MORE * self._scale[number])
        return self._locked[number], self._target[number], np.nan_to_num(self._beams[number]), too_far

    def _come_and_go(self, traffic: TrafficSnapshot, fleet: Fleet, x, y, roads, event) -> Iterator[Event]:
        number, before = fleet.number, self._before
        new = np.flatnonzero(~self._here[number])
        self._here[:] = False
        self._here[number] = True
        for i in np.flatnonzero(~self._here[before.number]) if before else ():
            member = self._members[before.number[i]]
            where = before.x[i], before.y[i], before.roads[i][0]
            how = "" if member.place == 0 or member.arrives_alone else "with its leader"
            yield Event(traffic.time, "arrived", member.id, "", *where, np.nan, how)
        if before is None or not np.array_equal(number, before.number):
            self._laws = _by_law(fleet.members)
        if not len(new):
            return
        self._begin_paths(fleet, new, x, y)
        self._acceleration[number[new]] = fleet.motion.acceleration[new]
        for i in new:
            yield event("departed", i)

    def _begin_paths(self, fleet: Fleet, new: np.ndarray, x: np.ndarray, y: np.ndarray) -> None:
        """A member's path begins where the one behind it stands, so that this one is on it from the start."""
        number, length, heading = fleet.number, fleet.model.length, fleet.motion.heading
        back_x, back_y = x - length * np.cos(heading), y - length * np.sin(heading)
        followers = np.flatnonzero(fleet.predecessor >= 0)
        back_x[fleet.predecessor[followers]], back_y[fleet.predecessor[followers]] = x[followers], y[followers]
        self._paths.begin(number[new], back_x[new], back_y[new], x[new], y[new])
        self._end[number[new]] = self._paths.end(number[new])
        follows = new[fleet.predecessor[new] >= 0]
        ahead, anywhere = number[fleet.predecessor[follows]], np.full(len(follows), np.inf)
        station, _ = self._paths.project(ahead, x[follows], y[follows], np.zeros(len(follows)), anywhere)
        self._station[number[follows]], self._ahead[number[follows]] = np.nan_to_num(station), ahead

    def _drive(self, fleet: Fleet, x: np.ndarray, y: np.ndarray) -> None:
        """Lengthen all paths; find where on its predecessor's path each member is, and so the gap between them."""
        self._paths.drive(fleet.number, x, y, fleet.motion.speed < 0)
        rows = np.flatnonzero(fleet.predecessor >= 0)
        ahead, length, axle = fleet.predecessor[rows], fleet.model.length, fleet.model.axle
        number, number_ahead = fleet.number[rows], fleet.number[ahead]
        driven = self._paths.end(number) - self._end[number]
        near, reach = self._station[number], 2 * (length[rows] + np.abs(driven))
        # One that it follows from now on it is looked for behind, not where that one was laps ago.
        away = np.hypot(x[ahead] - x[rows], y[ahead] - y[rows])
        anew = self._ahead[number] != number_ahead
        near = np.where(anew, self._paths.end(number_ahead) - away, near)
        reach = np.where(anew, ROUND_ABOUT * (away + length[rows]), reach)
        self._ahead[fleet.number] = -1
        self._ahead[number] = number_ahead
        station, offset = self._paths.project(number_ahead, x[rows], y[rows], near, reach)
        front = station + length[rows] / 2 - axle[rows]
        rear = self._paths.end(number_ahead) - length[ahead] / 2 - axle[ahead]
        self._gap[fleet.number] = self._cross_track[fleet.number] = np.nan
        self._gap[number], self._cross_track[number] = rear - front, offset
        forgotten = np.isnan(station)
        self._station[number] = np.where(forgotten, self._station[number] + driven, station)
        self._end[fleet.number] = self._paths.end(fleet.number)

    def _look(
        self, traffic: TrafficSnapshot, fleet: Fleet, scans: Sequence[ScanBatch | None], event
    ) -> Iterator[Event]:
        """What each law's target lies on, and how much of the predecessor there is to be seen, where it has scanned."""
        seen = np.full((3, len(fleet)), -1)
        for group, scan in zip(fleet.groups, scans, strict=True):
            if scan is not None:
                _see(scan, traffic, group.rows, fleet, seen)
        rows = np.flatnonzero(seen[1] >= 0)
        number, ahead, (target, beams, alone) = fleet.number[rows], fleet.predecessor[rows], seen[:, rows]
        self._beams[number] = beams
        with np.errstate(divide="ignore", invalid="ignore"):
            self._occluded[number] = np.where(alone > 0, np.maximum(1 - beams / alone, 0), np.nan)
        # By name, since a row of the traffic may be another vehicle in the next step. What is no vehicle is a row from
        # the end.
        ids = np.array([*traffic.ids, NOTHING, WALL], dtype=object)
        before, self._target[number] = self._target[number], ids[target]
        nobody = number[ahead < 0]
        self._locked[nobody], self._lost_since[nobody] = False, np.nan
        yield from self._locks(traffic, fleet, rows[ahead >= 0], ids, before[ahead >= 0], seen[1], event)

    def _locks(
        self,
        traffic: TrafficSnapshot,
        fleet: Fleet,
        rows: np.ndarray,
        ids: np.ndarray,
        before: np.ndarray,
        beams: np.ndarray,
        event,
    ) -> Iterator[Event]:
        """rows, before: followers with a new scan, and their targets before it, (m,); beams: on predecessors, (n,)"""
        number, ahead = fleet.number[rows], ids[fleet.predecessor[rows]]
        target = self._target[number]
        on, locked = target == ahead, self._locked[number]
        self._locked[number] = on
        strange = ~on & (target != before) & (target != NOTHING)
        for k in np.flatnonzero(strange & ~self._splits.split[number]):
            yield event("wrong_target", rows[k], target[k])
        for k in np.flatnonzero(on & ~locked):
            since = self._lost_since[number[k]]
            if np.isnan(since):
                yield event("locked", rows[k], ahead[k])
            else:
                yield event("lock_regained", rows[k], ahead[k], traffic.time - since)
        for k in np.flatnonzero(~on & locked):
            self._lost_since[number[k]] = traffic.time
            if "laser" in self._splits.broken[number[k]]:
                cause = "its laser is broken"
            elif target[k] != NOTHING:
                cause = "took another for it"
            elif beams[rows[k]]:
                cause = f"not recognised, though {beams[rows[k]]} beams hit it"
            else:
                cause = "out of sight"
            yield event("lock_lost", rows[k], target[k], detail=cause)

    def _standstills(self, traffic: TrafficSnapshot, fleet: Fleet, event) -> Iterator[Event]:
        """One event a standstill, when it has lasted STANDSTILL_AFTER; one more when it ends, with its duration."""
        number = fleet.number
        moving = (np.abs(fleet.motion.speed) > STANDING) | (np.abs(fleet.motion.yaw_rate) > STANDING)
        since, noted = self._standing_since[number], self._at_standstill[number]
        since = np.where(np.isnan(since) & ~moving, traffic.time, since)
        began = ~moving & ~noted & (traffic.time - since > STANDSTILL_AFTER)
        for i in np.flatnonzero(began):
            why = self._splits.stopped_by(number[i]) or _stands_behind(traffic, i)
            if not why and fleet.predecessor[i] >= 0 and not self._locked[number[i]]:
                why = f"has lost {traffic.ids[fleet.predecessor[i]]}"
            yield event("standstill", i, detail=f"since {since[i]:.3f} s" + (why and f", {why}"))
        for i in np.flatnonzero(moving & noted):
            yield event("standstill_end", i, duration=traffic.time - since[i])
        self._standing_since[number] = np.where(moving, np.nan, since)
        self._at_standstill[number] = ~moving & (noted | began)

    def _brakings(self, traffic: TrafficSnapshot, fleet: Fleet, event) -> Iterator[Event]:
        number, acceleration = fleet.number, fleet.motion.acceleration
        if self._before is not None:
            self._jerk[number] = (acceleration - self._acceleration[number]) / (traffic.time - self._before.time)
        self._acceleration[number] = acceleration
        braking = self._full_size[number] & (acceleration < -EMERGENCY)
        for i in np.flatnonzero(braking & ~self._braking[number]):
            yield event("emergency_brake", i)
        self._braking[number] = braking

    def _contacts_and_near_misses(self, traffic: TrafficSnapshot, fleet: Fleet, event) -> Iterator[Event]:
        self._note_lane_changes(traffic, len(fleet))
        touching = self._contacts.of(traffic)
        for vehicle, other in sorted(touching - self._touching):
            i = traffic.ids.index(vehicle)
            changed = traffic.time - self._changed.get(other, -np.inf) < CHANGED_FOR
            yield event("collision", i, other, detail=CHANGED if changed else _struck(traffic, i, other))
        self._touching = touching
        number = fleet.number
        near = self._gap[number] < NEAR_MISS * self._scale[number]
        for i in np.flatnonzero(near & ~self._near[number]):
            vehicle, ahead = traffic.ids[i], traffic.ids[fleet.predecessor[i]]
            if not touching & {(vehicle, ahead), (ahead, vehicle)}:
                yield event("near_miss", i, ahead, detail=f"gap {self._gap[number[i]]:.3f} m")
        self._near[number] = near

    def _note_lane_changes(self, traffic: TrafficSnapshot, n: int) -> None:
        """Of those behind the first n, who are members."""
        before, self._traffic = self._traffic, traffic
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
            self._changed[traffic.ids[k]] = traffic.time

    def _leave_road(self, traffic: TrafficSnapshot, fleet: Fleet, x, y, event) -> Iterator[Event]:
        number, road = fleet.number, self._network.drivable
        outside = np.zeros(len(fleet))
        away = np.flatnonzero(~shapely.contains_xy(road, x, y))
        if len(away):
            outside[away] = shapely.distance(road, shapely.points(x[away], y[away]))
        self._outside[number] = outside
        off, since = outside > OFF_ROAD * self._scale[number], self._off_road_since[number]
        left, back = off & np.isnan(since), ~off & ~np.isnan(since)
        for i in np.flatnonzero(left):
            yield event("off_road", i, detail=f"{outside[i]:.3f} m outside")
        for i in np.flatnonzero(back):
            yield event("on_road", i, duration=traffic.time - since[i])
        self._off_road_since[number] = np.where(left, traffic.time, np.where(back, np.nan, since))


class _Step(NamedTuple):
    """Where members were, (n,)."""

    time: float
    number: np.ndarray
    x: np.ndarray
    y: np.ndarray
    roads: list[tuple[str, str]]


def _struck(traffic: TrafficSnapshot, i: int, other: str) -> str:
    """How two vehicles touch, by where the other's centre is as seen from one's own."""
    if other not in traffic.ids:
        return ""
    k = traffic.ids.index(other)
    cos, sin = math.cos(traffic.heading[i]), math.sin(traffic.heading[i])
    dx, dy = traffic.x[k] - traffic.x[i], traffic.y[k] - traffic.y[i]
    along, aside = dx * cos + dy * sin, dy * cos - dx * sin
    if abs(along) <= abs(aside) or math.cos(traffic.heading[k] - traffic.heading[i]) < 0.5:
        return "side by side or head on"
    return STRUCK if along < 0 else "struck it from behind"


def _stands_behind(traffic: TrafficSnapshot, i: int) -> str:
    """Who is straight ahead of a vehicle, within a car's length, or three of a robot's."""
    cos, sin = math.cos(traffic.heading[i]), math.sin(traffic.heading[i])
    length, side = traffic.length[i], np.array([-sin, cos]) * traffic.width[i] / 2
    front = np.array([traffic.x[i] + length / 2 * cos, traffic.y[i] + length / 2 * sin])
    way = np.array([cos, sin]) * (length if length >= FULL_SIZE else 3 * length)
    strip = shapely.Polygon([front - side, front + side, front + way + side, front + way - side])
    met = [k for k in np.flatnonzero(shapely.intersects(shapely.polygons(traffic.boxes().corners()), strip)) if k != i]
    ahead = [(traffic.x[k] - front[0]) * cos + (traffic.y[k] - front[1]) * sin for k in met]
    return f"behind {traffic.ids[met[int(np.argmin(ahead))]]}" if met else ""


def _see(scan: ScanBatch, traffic: TrafficSnapshot, rows: np.ndarray, fleet: Fleet, seen: np.ndarray) -> None:
    """Fill in, for some rows (m,), what their scans (m, k) show; seen: (3, n).

    First what most of the beams about the target's bearing met, as in `hits`, NO_HIT where they met nothing or there is
    no target. Then how many beams met the predecessor, 0 if there is none; and how many would, were there nothing else
    and no errors, by the middles of the beams at the instant at which the scan ends.
    """
    model, mount = scan.model, scan.model.mount
    fan = float(model.angle_min), model.angle_increment, float(model.range_max)
    eye = float(mount.x), float(mount.y), float(mount.yaw)
    boxes = traffic.x, traffic.y, traffic.heading, traffic.length, traffic.width
    bearing, ahead = fleet.target.bearing, fleet.predecessor
    _see_rows(rows, scan.ranges, scan.hits, model.directions, fan, eye, boxes, bearing, ahead, seen)


@compiled
def _see_rows(rows, ranges, hits, directions, fan, eye, boxes, bearing, ahead, seen):
    angle_min, increment, range_max = fan
    for i in range(len(rows)):
        row = rows[i]
        beam = np.rint((bearing[row] - angle_min) / increment)
        seen[0, row] = _most_about(beam, ranges[i], hits[i])
        seen[1, row] = seen[2, row] = 0
        if ahead[row] >= 0:
            for k in range(hits.shape[1]):
                seen[1, row] += (hits[i, k] == ahead[row]) & (ranges[i, k] < np.inf)
            seen[2, row] = _beams_across(row, ahead[row], boxes, eye, directions, range_max)


@compiled
def _most_about(beam, ranges, hits):
    """What most of the beams about one of them met; of several, that of the lowest number."""
    first, last = max(beam - BEAMS_ABOUT, 0.0), min(beam + BEAMS_ABOUT, len(hits) - 1.0)
    if math.isnan(beam) or first > last:
        return NO_HIT
    found, most = NO_HIT, 0
    about = range(int(first), int(last) + 1)
    for k in about:
        votes = 0
        for other in about:
            # A lost return is NaN.
            votes += (hits[other] == hits[k]) & (ranges[k] < np.inf) & (ranges[other] < np.inf)
        if votes > most or (votes == most and votes > 0 and hits[k] < found):
            most, found = votes, hits[k]
    return found


@compiled
def _beams_across(row, other, boxes, eye, directions, range_max):
    """How many beams from one vehicle meet the box of another."""
    x, y, heading, length, width = boxes
    # In the frame of the box, between whose rear and front, and whose sides, a beam is for a part of its way.
    cos, sin = math.cos(heading[row]), math.sin(heading[row])
    away_x = x[row] + cos * eye[0] - sin * eye[1] - x[other]
    away_y = y[row] + sin * eye[0] + cos * eye[1] - y[other]
    cos, sin = math.cos(heading[other]), math.sin(heading[other])
    from_x, from_y = cos * away_x + sin * away_y, cos * away_y - sin * away_x
    turned = heading[row] + eye[2] - heading[other]
    cos, sin = math.cos(turned), math.sin(turned)
    front, side = length[other] / 2, width[other] / 2
    count = 0
    for k in range(directions.shape[1]):
        per_x = 1.0 / (cos * directions[0, k] - sin * directions[1, k])
        per_y = 1.0 / (sin * directions[0, k] + cos * directions[1, k])
        a, b = (-front - from_x) * per_x, (front - from_x) * per_x
        c, d = (-side - from_y) * per_y, (side - from_y) * per_y
        enters, leaves = max(min(a, b), min(c, d)), min(max(a, b), max(c, d))
        count += (enters <= leaves) & (leaves >= 0.0) & (enters <= range_max)
    return count


def _by_law(members: Sequence[Member]) -> list[tuple[Any, np.ndarray]]:
    """Laws, and the rows of the members that have each."""
    rows: dict[Any, list[int]] = {}
    for i, m in enumerate(members):
        rows.setdefault(m.law, []).append(i)
    return [(law, np.array(of_law)) for law, of_law in rows.items()]


def _wanted_distance(laws: list[tuple[Any, np.ndarray]], fleet: Fleet) -> np.ndarray:
    """What each law wants from laser to rear at its vehicle's speed [m], (n,); NaN if it names nothing."""
    wanted = np.full(len(fleet), np.nan)
    for law, rows in laws:
        speed = fleet.motion.speed[rows]
        try:
            wanted[rows] = law.desired_distance(speed)
        except Exception:  # it takes one speed at a time; or it fails, then again here, and that is said
            wanted[rows] = [desired_distance(law, v) for v in speed]
    return wanted
