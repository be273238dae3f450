"""Contacts between members and other vehicles or walls, and gaps that come close to one.

A contact is caused by one of the two, whichever of them is a member. The one that entered the other's lane less than
LANE_CHANGE_BLAME before is the cause (`lane_entries`), whichever struck the other. If neither did, the one behind is
the cause; and if neither is behind, abreast or head on, the one that has swung its rear into the other (`swings`).
If neither has, the contact counts as caused by the member, with these exceptions. The other was not there
APPEARANCE_BLAME before: SUMO has inserted it before a member that is about to leave the junction there. Or the member
was not there one step before: SUMO has inserted that beside the other. Or the other came from another direction, and
struck a member that had stood for STOOD_BLAME on the lanes of its own edge: SUMO's drivers see vehicles on their own
lane only, and drive through what stands where lanes of two directions overlap. Its pedestrians walk into what stands
anywhere. Or lanes of two directions overlap so much there that two vehicles that keep to them touch
(`overlapping_lanes`). Or a part of the other was beyond the middle of the road, and all of the member was on its own
side: long vehicles that keep the middle of their front on the lane cut bends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely

from platoontraffic.observation.lane_entries import SAME_DIRECTION, STANDS, LaneEntries, Together
from platoontraffic.observation.overlapping_lanes import OnLane, is_caused_by_road
from platoontraffic.observation.step import Step
from platoontraffic.observation.swings import Course, swung
from platoontraffic.observation.thresholds_kernel import comes_near
from platoontraffic.road.network import Network
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import NEAR_MISS_GAP, STOOD_BLAME, WALL, Event
from platoontraffic.world.traffic import PERSON, TrafficSnapshot

DETAILS = {
    "": "",
    "struck_from_behind": "struck from behind",
    "struck_other_from_behind": "struck it from behind",
    "beside": "side by side or head on",
    "swung_out": "swung its rear into the other, in a bend that no vehicle on wheels can drive so",
    "stood": "the other came from another direction, and struck it where it stood",
    "lanes_overlap": "each was in the middle of its lane, and the lanes of two directions overlap there",
    "other_crossed_middle": "the other was beyond the middle of the road",
    "other_swung_out": "the other swung its rear into it, in a bend that no vehicle on wheels can drive so",
}
SIDE = 0.1  # distance beyond the middle of the road up to which a vehicle is on its own side [m]
POINTS = 1.0  # greatest distance of the points of an outline that are compared with the middle of the road [m]


class Collisions:
    """Episodes of contact; `touching` are the pairs of this step, as in `Contacts.of`."""

    def __init__(self, contacts: Contacts, network: Network) -> None:
        self._contacts, self._network = contacts, network
        self._entries = LaneEntries(network.drivable)
        self.touching: set[tuple[str, str]] = set()

    def observe(self, step: Step, may_touch: np.ndarray) -> Iterator[Event]:
        """collision

        may_touch: rows of the bodies that may touch one another; walls are asked for here
        """
        traffic, n = step.traffic, step.fleet.number.size
        self._entries.observe(traffic)
        if self._contacts.may_touch_walls(traffic, n):
            may_touch = np.union1d(may_touch, np.arange(n))
        before, self.touching = self.touching, set()
        if len(may_touch):
            self.touching = self._contacts.of(traffic.only(may_touch))
        if traffic.other_levels and self.touching:
            row = {name: k for k, name in enumerate(traffic.ids)}
            self.touching = {
                pair for pair in self.touching if pair[1] == WALL or not traffic.are_apart(*map(row.__getitem__, pair))
            }
        for vehicle, other in sorted(self.touching - before) if self.touching else ():
            i = traffic.ids.index(vehicle)
            entry, both = self._entries.of(vehicle, other), self._entries.together(vehicle, other)
            what = "beside" if _were_abreast(both) else _impact(traffic, i, other)
            if what == "beside" and not entry:
                what = self._beside(both)
                if what == "beside" and self._was_struck(vehicle, other, both, step.roads[i][0]):
                    what = "stood"
                elif what == "beside" and self._lanes_overlap(both):
                    what = "lanes_overlap"
                elif what == "beside" and self._crossed_the_middle(both):
                    what = "other_crossed_middle"
            detail = DETAILS[what]
            if not entry and self._entries.is_new(vehicle):
                what, detail = "appeared", "SUMO had just inserted it"
            elif not entry and self._entries.appeared(other):
                what, detail = "other_appeared", f"SUMO had just inserted {other}"
            if entry:
                what = "changed_lanes" if entry.vehicle == vehicle else "other_changed_lanes"
                before = f"{step.traffic.time - entry.time:.1f} s before, gap {entry.gap:.1f} m"
                detail = f"{entry.vehicle} changed lanes into the path of the other {before}"
            yield step.event("collision", i, other, what=what, detail=detail)

    def _was_struck(self, vehicle: str, other: str, both: Together, edge: str) -> bool:
        """Whether a vehicle, the first one, had stood on the lanes of its edge, and the other one struck it."""
        is_person = other.startswith(PERSON)
        if not ((is_person or _came_from_elsewhere(both)) and self._entries.has_stood(vehicle, STOOD_BLAME)):
            return False
        if is_person:
            return True
        course = Course.of(*both.poses[0], both.length[0], both.width[0])
        return self._network.is_on_lanes(edge, course.outline().moved(0.0, 0.0))

    def _lanes_overlap(self, both: Together) -> bool:
        """Whether two oncoming vehicles keep to their lanes, and these overlap."""
        found = []
        for poses, length, width in zip(both.poses, both.length, both.width, strict=True):
            x, y, heading = (float(values[-1]) for values in poses)
            middle = self._network.lane_headed(x, y, heading)
            if middle is None:
                return False
            found.append(OnLane(middle, Course.of(*poses, float(length), float(width)).outline()))
        one, other = found
        oncoming = math.cos(other.outline.heading - one.outline.heading) < -SAME_DIRECTION
        return oncoming and is_caused_by_road(one, other)

    def _crossed_the_middle(self, both: Together) -> bool:
        """Whether the second vehicle is beyond the middle of the road, and the first one nowhere."""
        outlines = []  # by points at most POINTS apart: of a long body in a bend, only the middle may be there
        for poses, length, width in zip(both.poses, both.length, both.width, strict=True):
            outline = Course.of(*poses, float(length), float(width)).outline()
            x, y = shapely.get_coordinates(shapely.segmentize(outline.moved(0, 0), POINTS)).T
            right = self._network.right_of_middle(x, y, np.full(len(x), outline.heading))
            outlines.append((x, y, -right if self._network.left_hand else right))
        (x, y, own), (_, _, its) = outlines
        in_junction = np.isnan(own) & shapely.contains_xy(self._network.drivable, x, y)  # or on a one-way road
        return not (in_junction | (own < -SIDE)).any() and bool((its < -SIDE).any())

    def _beside(self, both: Together) -> str:
        """The kind of a contact side by side or head on, by which of the two has swung into the other."""
        if len(both.time) < 2:
            return "beside"
        courses = [Course.of(*both.poses[n], both.length[n], both.width[n]) for n in (0, 1)]

        def on_own_side(n: int) -> bool:
            x, y, heading = (values[-1:] for values in both.poses[n])
            right = float(self._network.right_of_middle(x, y, heading)[0])
            if math.isnan(right):  # inside a junction, or on a one-way road
                body = courses[n].outline().moved(0, 0)
                return self._network.keeps_to_a_lane(float(x[0]), float(y[0]), float(heading[0]), body)
            return (-right if self._network.left_hand else right) > both.width[n] / 2 - SIDE

        return {None: "beside", 0: "swung_out", 1: "other_swung_out"}[swung(both.time, courses, on_own_side)]


class NearMisses:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, scale: np.ndarray) -> None:
        """scale: size of each member beside a car, (N,); NEAR_MISS_GAP shrinks with it"""
        self._least = NEAR_MISS_GAP * scale  # [m]
        self._near = np.zeros(len(scale), dtype=bool)  # one step before

    def observe(self, step: Step, gap: np.ndarray, touching: set[tuple[str, str]]) -> Iterator[Event]:
        """near_miss

        gap     : (n,) [m], NaN where there is none
        touching: pairs in contact, as in `Contacts.of`
        """
        ids, begins = step.traffic.ids, np.empty(gap.size, dtype=bool)
        if not comes_near(step.fleet.number, gap, self._least, self._near, begins):
            return
        for i in begins.nonzero()[0]:
            vehicle, ahead = ids[i], ids[step.fleet.predecessor[i]]
            if not touching & {(vehicle, ahead), (ahead, vehicle)}:
                yield step.event("near_miss", i, ahead, detail=f"gap {gap[i]:.3f} m")


def _were_abreast(both: Together) -> bool:
    """Whether two vehicles that touch now were beside each other, by any part of their lengths, one step before."""
    if len(both.time) < 2:
        return False
    (x, y, heading), (other_x, other_y, other_heading) = ([float(part[-2]) for part in one] for one in both.poses)
    mean = math.atan2(math.sin(heading) + math.sin(other_heading), math.cos(heading) + math.cos(other_heading))
    along = (other_x - x) * math.cos(mean) + (other_y - y) * math.sin(mean)
    return abs(along) < both.length.mean() and math.cos(other_heading - heading) >= SAME_DIRECTION


def _came_from_elsewhere(both: Together) -> bool:
    """Whether the second vehicle has moved, and heads in another direction than the first one."""
    (_, _, heading), (x, y, other_heading) = both.poses
    has_moved = bool((np.hypot(x - x[-1], y - y[-1]) > STANDS).any())
    return has_moved and math.cos(other_heading[-1] - heading[-1]) < SAME_DIRECTION


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
