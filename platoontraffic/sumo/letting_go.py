"""SUMO's vehicles that wait inside a junction for a member which stands, and could drive past it.

SUMO's driver gives way to every vehicle that has priority and is inside the junction or comes to it, also to a member
that stands there because a body is in its way. Where that body is the one that waits, both would stand for ever. A
human driver goes as soon as it is clear that the other one does not. So a vehicle that stands inside a junction is told
to ignore a member (SUMO's parameter `junctionModel.ignoreIDs`) that has stood before a body for `AFTER`, if its own
body stays `CLEARANCE` away from the member's on its path through the junction; until the member moves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set

import numpy as np
import shapely

from platoontraffic.lidar import Boxes
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.conflicts import LINK_ONTO, LINK_VIA
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.standing import STANDS, before_bodies

AFTER = 5.0  # time that a member has stood before a body [s]
EVERY = 1.0  # period of looking for vehicles that wait [s]
CLEARANCE = 0.3  # between the bodies [m]
BESIDE = 0.8  # share of their distance that is kept, if that is less at the begin
NEAR = 60.0  # a vehicle further away does not wait for the member [m]
SPACING = 1.0  # of the places on its path [m]
IGNORED = "junctionModel.ignoreIDs"


class LettingGo:
    """Which vehicles ignore which members."""

    def __init__(self, sumo: Client, network: Network) -> None:
        self._sumo, self._network = sumo, network
        self._since: dict[str, float] = {}  # of members that stand before a body [s]
        self._ignored: dict[str, set[str]] = {}  # members, by the vehicle that ignores them
        self._looked = -np.inf  # [s]

    def observe(self, fleet: Fleet, where: Mapping[str, tuple[str, str]], time: float) -> None:
        """Before every step.

        where : edge and lane of each member
        time  : SUMO's clock [s]
        """
        blocked = {fleet.ids[one.row]: one.row for one in before_bodies(fleet)}
        self._since = {name: self._since.get(name, time) for name in blocked} if blocked else {}
        if self._ignored:
            self._end(blocked.keys())
        if time < self._looked + EVERY - 1e-6:
            return
        self._looked = time
        for name, row in blocked.items():
            if time - self._since[name] < AFTER - 1e-6:
                continue
            waiting = [foe for foe in self._waiting(where[name][1], where) if name not in self._ignored.get(foe, ())]
            body = shapely.polygons(_box(fleet, row).corners())[0] if waiting else None
            for foe in waiting:
                if self._passes(foe, body):
                    self._ignore(foe, {*self._ignored.get(foe, ()), name})

    def _end(self, blocked: Set[str]) -> None:
        """Vehicles that have left the junction give way again, and so do those that ignored a member that moves now."""
        for foe, members in list(self._ignored.items()):
            try:
                inside = self._sumo.vehicle.getRoadID(foe)[:1] == ":"
            except self._sumo.TraCIException:  # it has left the simulation
                del self._ignored[foe]
                continue
            if not (inside and members <= blocked):
                self._ignore(foe, members & blocked if inside else set())

    def _ignore(self, foe: str, members: set[str]) -> None:
        self._sumo.vehicle.setParameter(foe, IGNORED, " ".join(sorted(members)))
        if members:
            self._ignored[foe] = members
        else:
            del self._ignored[foe]

    def _waiting(self, lane: str, members: Mapping[str, tuple[str, str]]) -> Iterator[str]:
        """Vehicles that SUMO drives and that stand inside the junction on which, or before which, a lane is."""
        if lane and lane[0] != ":":
            lane = next((link[LINK_VIA] for link in self._sumo.lane.getLinks(lane) if link[LINK_VIA]), "")
        for inside in self._network.inside_with(lane):
            for foe in self._sumo.lane.getLastStepVehicleIDs(inside):
                if foe not in members and self._sumo.vehicle.getSpeed(foe) < STANDS:
                    yield foe

    def _passes(self, foe: str, body: shapely.Geometry) -> bool:
        """Whether a vehicle on its way through the junction stays away from a body."""
        vehicle = self._sumo.vehicle
        if shapely.distance(shapely.Point(vehicle.getPosition(foe)), body) > NEAR:
            return False
        path, inside = self._path(vehicle.getLaneID(foe))
        begin, length = vehicle.getLanePosition(foe), vehicle.getLength(foe)
        steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
        front = np.arange(begin, inside + length, SPACING)
        # Its rear is on the path too, which is prolonged straight before its begin.
        ends = [np.column_stack([_on(steps, path[:, k], s) for k in (0, 1)]) for s in (front, front - length)]
        middle, along = (ends[0] + ends[1]) / 2, ends[0] - ends[1]
        n = len(front)
        size = np.full(n, length), np.full(n, vehicle.getWidth(foe))
        boxes = Boxes(*middle.T, np.arctan2(*along.T[::-1]), *size, np.arange(n))
        away = shapely.distance(shapely.polygons(boxes.corners()), body)
        return bool((away > min(CLEARANCE, BESIDE * away[0])).all())

    def _path(self, lane: str) -> tuple[np.ndarray, float]:
        """The line of a lane inside a junction and of those that it leads to, (k, 2) [m], and its length inside."""
        lanes = [lane]
        while lanes[-1][0] == ":" and (links := self._sumo.lane.getLinks(lanes[-1])):
            lanes.append(links[0][LINK_VIA] or links[0][LINK_ONTO])
        line = np.array([point for name in lanes for point in self._sumo.lane.getShape(name)])
        inside = sum(self._sumo.lane.getLength(name) for name in lanes if name[0] == ":")
        return line[np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > 1e-6])], inside


def _box(fleet: Fleet, row: int) -> Boxes:
    motion, model, one = fleet.motion, fleet.model, slice(row, row + 1)
    return Boxes(
        motion.x[one], motion.y[one], motion.heading[one], model.length[one], model.width[one], np.zeros(1, int)
    )


def _on(stations: np.ndarray, values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Values at places along a line, prolonged straight before its begin."""
    slope = (values[1] - values[0]) / (stations[1] - stations[0])
    return np.where(there < 0, values[0] + slope * there, np.interp(there, stations, values))
