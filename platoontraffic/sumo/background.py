"""Background traffic: SUMO's own vehicles and pedestrians, those of them that may matter to a member."""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence, Set
from itertools import chain, compress
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import Client, direct
from platoontraffic.sumo.frame import centre_of, heading_of
from platoontraffic.sumo.reads import Once
from platoontraffic.world.events import CONTACT_HORIZON
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.traffic import PERSON, TrafficSnapshot

RECHECK_AFTER = 0.5  # period after which distant vehicles are measured again [s]
GAINS = 10.0  # greatest acceleration of a vehicle [m/s2]
STRETCHED = 2.0  # a lane is drawn at most so many times as long as it is stated to be: there SUMO's cars move faster
JUMPS = 10.0  # distance by which a vehicle may move aside within the period [m]: SUMO's cars change lanes at once
BRIDGE = 30.0  # distance from a crossing of two levels within which vehicles on the other road are left out [m]
AT_BRIDGE = 150.0  # distance from it within which members count [m]
NO_VALUES = (np.empty(0),) * 6  # of no vehicles
PERSON_SIZE = 1.0  # bound of half a pedestrian's length or width [m]

compiled = compiler(__file__)


class Driven(NamedTuple):
    """How n vehicles drive."""

    front: np.ndarray  # of the bumpers [m], (n, 2)
    speed: np.ndarray  # [m/s], (n,)


class Background:
    """Reads background traffic. Distant vehicles are skipped by a Verlet list.

    A vehicle so far from every member that it cannot come within range before the next check is not asked for its
    position until then. The list of the remaining vehicles is in SUMO's order, by id, and is kept up to date with the
    vehicles that enter and leave the simulation.

    A vehicle on a bridge over a member's road, or below one, is left out: the world of lasers and contacts is flat.
    Where members are on both roads, near that place, it is left in, and `apart` from those on the other road.

    apart: by row of a member, ids of the bodies on another level near it, members included; as of the last `traffic`
    """

    def __init__(self, sumo: Client, network: Network) -> None:
        self._sumo, self._network = sumo, network
        self._crossing: list[tuple[str, str]] = []  # roads of the members' routes, and others that cross them
        self._places = np.empty((0, 2))  # where they do [m]
        self._crossing_for: tuple[Member, ...] = ()
        self.apart: dict[int, set[str]] = {}
        # Length, width [m] by vehicle.
        self._sizes = Once(lambda name: (sumo.vehicle.getLength(name), sumo.vehicle.getWidth(name)))
        self._skipped: set[str] = set()  # members, held obstacles, distant vehicles
        self._skipped_for: tuple[Member, ...] = ()  # members at the last check
        self._skipped_until = -np.inf  # [s], SUMO's clock
        self._sized: tuple[Sequence[str], np.ndarray] = (), np.empty((2, 0))  # sizes of the vehicles read last
        self._on_road: list[str] | None = None  # all vehicles; None: unknown
        self._near: list[str] | None = None  # those that are not skipped
        self._expected = 0  # vehicles on the road or due
        self._time = 0.0  # SUMO's clock after the last step [s]

    def traffic(self, fleet: Fleet, reach: float, held: Set[str], time: float) -> TrafficSnapshot:
        """Background vehicles and pedestrians, minus most that do not matter to any member.

        reach: as in `_range` [m]; inf: all
        held : vehicles in SUMO that are obstacles
        time : of the snapshot [s]
        """
        names, driven = self._names(fleet, reach, held)
        vehicles = self._on_their_level(fleet, self.read(names, time, driven))
        return (
            vehicles.with_others(self._people(fleet, reach, time))
            if direct(self._sumo.person.getIDCount)()
            else vehicles
        )

    def read(self, names: Sequence[str], time: float, driven: Driven | None = None) -> TrafficSnapshot:
        """Vehicles of SUMO's by name. driven: as they have been read at this instant; None: they have not"""
        n, vehicle = len(names), self._sumo.vehicle
        if not n:
            return TrafficSnapshot(time, (), *NO_VALUES)
        # Thousands in every step: numbers go from the calls into the arrays without lists between them.
        if names is not self._sized[0]:  # the list of near vehicles holds for several steps
            sizes = np.fromiter(chain.from_iterable(map(self._sizes.__getitem__, names)), float, 2 * n).reshape(-1, 2)
            self._sized = names, np.ascontiguousarray(sizes.T)
        length, width = self._sized[1]
        front, speed = driven or (self._fronts(names), self._speeds(names))
        heading = heading_of(np.fromiter(map(direct(vehicle.getAngle), names), float, n))
        x, y = centre_of(*front.T, heading, length)
        return TrafficSnapshot(time, tuple(names), x, y, heading, speed, length, width)

    def _on_their_level(self, fleet: Fleet, vehicles: TrafficSnapshot) -> TrafficSnapshot:
        """Without vehicles near a place where their road crosses that of a member near it on another level."""
        if fleet.members is not self._crossing_for:
            edges = {edge for member in fleet.members if member.route for edge in member.route.edges}
            bridges = self._network.crossed_without_junction(sorted(edges))
            crossings = [(edge, *one) for edge, others in bridges.items() for one in others]
            self._crossing = [roads for *roads, _, _ in crossings]
            self._places = np.array([place for _, _, *place in crossings]).reshape(-1, 2)
            self._crossing_for = fleet.members
        self.apart = {}
        if not self._crossing:
            return vehicles
        own, stays = fleet.motion, np.ones(len(vehicles.ids), bool)
        far = _farther(self._places, own.x, own.y, np.full(len(self._places), AT_BRIDGE))
        for k in np.flatnonzero(~far).tolist():
            (road, other), (x, y) = self._crossing[k], self._places[k]
            away = np.hypot(own.x - x, own.y - y)
            driven = {i: self._driven(fleet.members[i], road, other) for i in np.flatnonzero(away < AT_BRIDGE).tolist()}
            if {road} not in driven.values():
                continue
            there = np.flatnonzero(np.hypot(vehicles.x - x, vehicles.y - y) < BRIDGE).tolist()
            there = [i for i in there if self._sumo.vehicle.getRoadID(vehicles.ids[i]) == other]
            if all(on == {road} for on in driven.values()):
                stays[there] = False
                continue
            names = {vehicles.ids[i] for i in there}
            names |= {fleet.ids[i] for i, on in driven.items() if on == {other} and away[i] < BRIDGE}
            for i, on in driven.items() if names else ():
                if on == {road}:
                    self.apart.setdefault(i, set()).update(names)
        if stays.all():
            return vehicles
        gone = {*compress(vehicles.ids, ~stays)}
        for names in self.apart.values():
            names -= gone
        return self.read(list(compress(vehicles.ids, stays)), vehicles.time)

    def _driven(self, member: Member, *roads: str) -> set[str]:
        """Those of two roads that a member drives on, or will; where its route takes both, the one on which it is."""
        edges, here = member.route.edges if member.route else (), self._sumo.vehicle.getLaneID(member.id)
        road = edge_of(self._network.entered_from.get(here, here))
        ahead = edges[edges.index(road) :] if road in edges else edges
        driven = {*roads} & {*ahead}
        return driven if len(driven) < len(roads) else driven & {road}

    def stepped(self, time: float) -> None:
        """To be called after every step of SUMO's: the vehicles on the road may be others. time: SUMO's clock [s]"""
        self._time, simulation = time, self._sumo.simulation
        came, went = direct(simulation.getDepartedNumber)(), direct(simulation.getArrivedNumber)()
        jump = direct(simulation.getStartingTeleportNumber)() or direct(simulation.getEndingTeleportNumber)()
        before, self._expected = self._expected, direct(simulation.getMinExpectedNumber)()
        if jump or self._expected != before + direct(simulation.getLoadedNumber)() - went:
            self._on_road = self._near = None  # somebody has removed or added a vehicle
        elif self._on_road is not None and (came or went):
            gone = set(simulation.getArrivedIDList())
            come = [name for name in simulation.getDepartedIDList() if name not in gone]
            self._on_road = _changed(self._on_road, gone, come)
            if self._near is not None:
                self._near = _changed(self._near, gone, [name for name in come if name not in self._skipped])

    def _names(self, fleet: Fleet, reach: float, held: Set[str]) -> tuple[list[str], Driven | None]:
        """The vehicles that may be in range, and how they drive, if that has just been read."""
        if reach == np.inf:
            own = {m.id for m in fleet.members} | held
            return [name for name in self._sumo.vehicle.getIDList() if name not in own], None
        time, driven = self._time, None
        if time >= self._skipped_until or fleet.members is not self._skipped_for or not held <= self._skipped:
            driven = self._check_distances(fleet, held, reach, time)
        if self._near is None:
            self._near = self._others(self._skipped)
        return self._near, driven

    def _others(self, names: Set[str]) -> list[str]:
        if self._on_road is None:
            self._on_road = list(self._sumo.vehicle.getIDList())
        return [name for name in self._on_road if name not in names]

    def _check_distances(self, fleet: Fleet, held: Set[str], reach: float, time: float) -> Driven:
        """Find the vehicles that are skipped from now on; the near ones."""
        own, members = fleet.motion, {m.id for m in fleet.members}
        if not held <= self._skipped or not members.issuperset(m.id for m in self._skipped_for):
            self._on_road = None  # members that have left are removed, and vehicles where an obstacle appears
        skipped = members | held
        names = self._others(skipped)
        length = np.array([self._sizes[name][0] for name in names])
        fronts, speed = self._fronts(names), self._speeds(names)
        fastest = np.abs(own.speed).max(initial=0.0)
        closes = RECHECK_AFTER * (STRETCHED * speed + fastest + GAINS * RECHECK_AFTER) + JUMPS
        far = _farther(fronts, own.x, own.y, _range(fleet, reach, speed) + 2 * length + closes)
        self._skipped = skipped | set(compress(names, far))
        self._skipped_for, self._skipped_until = fleet.members, time + RECHECK_AFTER
        self._near = list(compress(names, ~far))
        return Driven(fronts[~far], speed[~far])

    def _people(self, fleet: Fleet, reach: float, time: float) -> TrafficSnapshot:
        """Pedestrians; persons inside vehicles are not among them."""
        person = self._sumo.person
        names = [name for name in person.getIDList() if not person.getVehicle(name)]
        front = np.array([person.getPosition(name) for name in names]).reshape(-1, 2)
        speed = np.array(list(map(person.getSpeed, names)), float)
        if reach < np.inf:
            near = ~_farther(front, fleet.motion.x, fleet.motion.y, _range(fleet, reach, speed) + PERSON_SIZE)
            names, front, speed = list(compress(names, near)), front[near], speed[near]
        heading = heading_of(np.array([person.getAngle(name) for name in names]))
        length, width = (np.array(list(map(get, names)), float) for get in (person.getLength, person.getWidth))
        x, y = centre_of(*front.T, heading, length)
        return TrafficSnapshot(time, tuple(PERSON + name for name in names), x, y, heading, speed, length, width)

    def _fronts(self, names: Sequence[str]) -> np.ndarray:
        """Positions of front bumpers (n, 2) [m]."""
        numbers = chain.from_iterable(map(direct(self._sumo.vehicle.getPosition), names))
        return np.fromiter(numbers, float, 2 * len(names)).reshape(-1, 2)

    def _speeds(self, names: Sequence[str]) -> np.ndarray:
        return np.fromiter(map(direct(self._sumo.vehicle.getSpeed), names), float, len(names))


def _range(fleet: Fleet, reach: float, speed: np.ndarray) -> np.ndarray:
    """How near bodies with these speeds (m,) [m/s] must be to a member to matter [m], from its centre to their outline:
    they are within reach, or may come to the same place as a member within `CONTACT_HORIZON`."""
    fastest, longest = np.abs(fleet.motion.speed).max(initial=0.0), fleet.model.length.max(initial=0.0)
    return np.maximum(reach, CONTACT_HORIZON * (speed + fastest) + longest)


def _changed(names: list[str], gone: Set[str], come: Sequence[str]) -> list[str]:
    """Sorted names without those that are gone, and with those that have come."""
    names = [name for name in names if name not in gone]
    for name in come:
        insort(names, name)
    return names


@compiled
def _farther(points, x, y, reach):
    """Whether each of points (n, 2) is farther than its reach (n,) from every x, y (m,) [m]."""
    far, by_x = np.ones(len(points), np.bool_), np.argsort(x)
    x, y = x[by_x], y[by_x]
    for i in range(len(points)):
        for k in range(np.searchsorted(x, points[i, 0] - reach[i]), len(x)):
            dx, dy = points[i, 0] - x[k], points[i, 1] - y[k]
            if dx < -reach[i]:
                break
            if dx * dx + dy * dy <= reach[i] * reach[i]:
                far[i] = False
                break
    return far
