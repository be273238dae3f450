"""Measurements of a run from outside, which no law knows: gaps, locks, and the events that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from platoontraffic.controllers import Signals
from platoontraffic.geometry.driven_paths import DrivenPaths
from platoontraffic.lidar import ScanBatch
from platoontraffic.observation.braking import Braking
from platoontraffic.observation.closeness import Closeness
from platoontraffic.observation.collisions import Collisions, NearMisses
from platoontraffic.observation.encroachments import Encroachments
from platoontraffic.observation.gaps import DesiredGaps, Gaps
from platoontraffic.observation.hindrances import Hindrances
from platoontraffic.observation.limits import Limits
from platoontraffic.observation.locks import Locks
from platoontraffic.observation.off_road import OffRoad
from platoontraffic.observation.presence import Presence
from platoontraffic.observation.splits import Splits
from platoontraffic.observation.standstills import Standstills
from platoontraffic.observation.statistics import Statistics
from platoontraffic.observation.step import Step
from platoontraffic.road.network import Network
from platoontraffic.vehicles.motion import scale
from platoontraffic.world.contact import Contacts
from platoontraffic.world.events import Event, Noted
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen


@dataclass(frozen=True)
class Measures:
    """Measured values of all members at one instant, (n,), in the fleet's order; NaN without a predecessor or value."""

    gap: np.ndarray  # front bumper to the predecessor's rear bumper, along the predecessor's path [m]
    gap_error: np.ndarray  # gap minus the gap that the law wants at this speed [m]
    time_gap: np.ndarray  # gap / own speed [s]
    closing: np.ndarray  # own speed minus the predecessor's [m/s]
    time_to_collision: np.ndarray  # gap / closing speed [s]
    needed_braking: np.ndarray  # deceleration that avoids a collision, closing^2 / (2 gap) [m/s2]
    beams: np.ndarray  # returns from the predecessor in the last scan
    occluded: np.ndarray  # share of the beams on the predecessor, were it alone, that did not return from it
    seen_gap: np.ndarray  # gap to the law's target, as the law sees it [m]
    seen_bearing: np.ndarray  # bearing of that target from the laser, to the left [rad]
    cross_track: np.ndarray  # offset of the driven axle to the left of the path of the predecessor's [m]
    right_of_middle: np.ndarray  # offset of the centre to the right of the road's middle line [m]
    off_road: np.ndarray  # distance of the driven axle from the drivable area [m]; 0 in it
    jerk: np.ndarray  # change of the acceleration over the last step, over its length [m/s3]
    target: np.ndarray  # what the law's target lies on: a vehicle's id, WALL, or ""
    clearance: np.ndarray  # least distance between the own outline and that of another body [m]
    closest: np.ndarray  # id of that body, or ""
    contact_in: np.ndarray  # least time until the outline touches that of a body, if all go straight on [s]


class Observer:
    """Follows a fleet: `observe` in every step, `measure` in those that are recorded; `statistics` are over all steps.

    Members come and go. Memory of them stands in arrays (N,) of all members of the run, at the member's number; arrays
    (n,) have a row for each member that is on the road.
    """

    def __init__(self, members: Sequence[Member], network: Network, contacts: Contacts) -> None:
        """members: all of the run, by their number"""
        length = np.array([m.model.length for m in members])
        size = scale(length)
        self._members, self._network, self._contacts = members, network, contacts
        self._presence = Presence(members)
        self._gaps = Gaps(members)
        self._desired_gaps = DesiredGaps(members)
        self._hindrances = Hindrances(size)
        self._locks = Locks(len(members), self._hindrances)
        self._limits = Limits(len(members))
        self._splits = Splits(size, self._locks, self._hindrances, self._limits)
        self._standstills = Standstills(len(members), self._locks, self._hindrances, self._limits)
        self._braking = Braking(length)
        self._collisions = Collisions(contacts, network)
        self._near_misses = NearMisses(size)
        self._closeness = Closeness(size)
        self._encroachments = Encroachments(members)
        self._off_road = OffRoad(network.drivable, size)
        self.statistics = Statistics(len(members))
        self._fleet: Fleet | None = None  # that was observed last

    def close(self) -> None:
        """It observes no more."""
        self._contacts.close()

    def extend(self, newcomers: Sequence[Member]) -> None:
        """Further members of the run, with the numbers that come next."""
        before = len(self._members)
        self._members = (*self._members, *newcomers)
        self._contacts.members |= {m.id for m in newcomers}
        theirs, of_none = (vars(Observer(some, self._network, self._contacts)) for some in (newcomers, ()))
        for name, part in theirs.items():
            if hasattr(part, "__dict__") and name not in ("_network", "_contacts", "_encroachments"):
                _extend(getattr(self, name), part, of_none[name], before, len(newcomers))
        self._encroachments.number_platoons(newcomers)
        self._presence.members = self._members

    def refit(self, members: Sequence[Member]) -> None:
        """All members, by their number, with the laws and sensors that they have from now on."""
        self._presence.members, self._desired_gaps = members, DesiredGaps(members)

    def observe(
        self,
        traffic: TrafficSnapshot,
        fleet: Fleet,
        scans: Sequence[ScanBatch | None],
        roads: list[tuple[str, str]],
        signals: Signals | None = None,
        noted: Sequence[Noted] = (),
        seen: Sequence[Seen | None] = (),
    ) -> list[Event]:
        """The events of this step, including those that were noted elsewhere.

        scans  : one a group of the fleet, that its law used in this step; None: it used none
        roads  : edge and lane of each member, (n,)
        signals: state of the next stop lines, (n,); None if no law is given it
        seen   : the world at the instant of each scan; by default this one
        """
        self._fleet = fleet
        seen = seen or [Seen(traffic, group.rows) for group in fleet.groups]
        step = Step(traffic, fleet, roads, signals, *fleet.model.axle_position(fleet.motion), seen)
        events = [*self._presence.observe(step, self._splits.left_behind, noted), *map(step.noted, noted)]
        for event in events:
            if event.kind == "given_up":
                self._contacts.release(event.vehicle)
        if len(new := self._presence.new):
            self._gaps.begin(step, new)
            self._braking.begin(step, new)
        if noted:
            self._hindrances.note_breakdowns(noted, fleet)
        self._gaps.observe(step)
        gap, desired_gap = self._gaps.gap[fleet.number], self._desired_gaps.of(fleet)
        events += self._locks.observe(step, scans, self._splits.split)
        events += self._limits.observe(step, scans)
        events += self._hindrances.observe(step)
        events += self._splits.observe(step, gap, desired_gap)
        events += self._standstills.observe(step)
        events += self._braking.observe(step)
        self._closeness.look(step)
        events += self._collisions.observe(step, self._closeness.may_touch)
        behind = np.where(self._gaps.beside[fleet.number], np.nan, gap)
        events += self._near_misses.observe(step, behind, self._collisions.touching)
        events += self._closeness.observe(step, self._collisions.touching)
        events += self._encroachments.observe(step)
        events += self._off_road.observe(step)
        self.statistics.observe(
            step,
            gap=gap,
            desired_gap=desired_gap,
            jerk=self._braking.jerk,
            cross_track=self._gaps.cross_track,
            beside=self._gaps.beside,
            beams=self._locks.beams,
            occluded=self._locks.occluded,
            clearance=self._closeness.clearance,
            contact_in=self._closeness.contact_in,
        )
        return events

    def measure(self, fleet: Fleet) -> Measures:
        """Measured values at the step that was observed last.

        fleet: as then; raises RuntimeError if it is another
        """
        if fleet is not self._fleet:
            raise RuntimeError("the measures of an instant must be looked at before the next step")
        number, motion, values = fleet.number, fleet.motion, self.statistics.values
        return Measures(
            gap=values["gap"],
            gap_error=values["gap_error"],
            time_gap=values["time_gap"],
            closing=values["closing"],
            time_to_collision=values["time_to_collision"],
            needed_braking=values["needed_braking"],
            beams=np.where(fleet.predecessor >= 0, self._locks.beams[number], np.nan),
            occluded=values["occluded"],
            seen_gap=fleet.target.distance - self._desired_gaps.laser_to_bumper[number],
            seen_bearing=fleet.target.bearing,
            cross_track=values["cross_track"],
            right_of_middle=self._network.right_of_middle(motion.x, motion.y, motion.heading),
            off_road=self._off_road.distance[number],
            jerk=values["jerk"],
            target=self._locks.target[number],
            clearance=values["clearance"],
            closest=self._closeness.closest(),
            contact_in=values["contact_in"],
        )


def _extend(part: Any, theirs: Any, of_none: Any, before: int, count: int) -> None:
    """Give the arrays of all members in a part of the observer the rows of newcomers.

    theirs  : the part of an observer of `count` newcomers
    of_none : that of an observer of no members: its arrays of all members are empty
    before  : number of members that `part` knows
    """
    for name, rows in vars(theirs).items():
        own = getattr(part, name)
        if isinstance(own, DrivenPaths):
            own.extend(rows.spacing)
        elif isinstance(own, np.ndarray | list):
            lengths = len(own), len(rows), len(getattr(of_none, name))
            if lengths == (before, count, 0):  # else it is of something else
                setattr(part, name, [*own, *rows] if isinstance(own, list) else np.concatenate([own, rows]))
