"""Members as vehicles of SUMO's: inserted, moved to their poses, and kept as other drivers must see them."""

from __future__ import annotations

import contextlib
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import compress, count, repeat
from operator import ne, not_, or_, sub
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely

from platoontraffic.errors import RunError
from platoontraffic.road.lane_ids import edge_of, index_of
from platoontraffic.road.network import Network, junction_of
from platoontraffic.road.route import Route
from platoontraffic.sumo.client import Client, direct
from platoontraffic.sumo.conflicts import LINK_ONTO, LINK_VIA
from platoontraffic.sumo.frame import centre_of, heading_of, sumo_angle
from platoontraffic.sumo.placement_kernel import fill_in_poses
from platoontraffic.sumo.plexe import feed, switch_on
from platoontraffic.sumo.reads import Once
from platoontraffic.sumo.shadows import Mover, Shadows
from platoontraffic.sumo.vehicle_types import (
    ALL_CHECKS_ON,
    ANY_SPEED,
    AS_THE_ROUTE_DOES,
    USUAL_LANE_CHANGES,
    kind_of,
    limit_acceleration,
    make_type_from,
    make_type_of,
    release,
)
from platoontraffic.world.fleet import Fleet, Member

# Arguments of moveToXY: edge and lane, before the position; keepRoute and matchThreshold [m], behind the angle.
# keepRoute 2: the exact pose, on whatever lane lies there, never an error. A search within 10 m is cheaper than within
# the default 100 m and finds the same lanes; within 5 m it takes wrong ones in junctions. Where roads overlap it is
# 100 m: SUMO compares lanes by their distances over the greatest of these. A vehicle inside all lanes that are found
# has only zeros to compare, and SUMO takes the lane that it has read first, of whatever direction.
ANY_LANE = ("", -1)
ANYWHERE = tuple(map(repeat, ANY_LANE))  # columns of any number of rows
EXACTLY = (2, 10.0)
WHERE_LANES_OVERLAP = (2, 100.0)
# The exact pose on a lane of its route, if one is near. On a lane as short as a vehicle: a bend leaves a wedge between
# two lanes that belongs to none, and SUMO may die of a vehicle that leaves the network in it while its rear is on a
# third lane. And inside a junction once it is on its path, up to ASIDE from its middle: the driver behind would not see
# it on another path. The same on a lane that overlaps one of another edge: oncoming drivers would stop before it.
ON_ITS_ROUTE = (3, 5.0)
SHORT, ASIDE = 6.0, 1.0  # [m]

WEDGE = 2.5  # distance from the end of the lane before up to which a member off all lanes is in such a wedge [m]
NEAR = 10.0  # distance from the begin of another lane of its route up to which it is put there instead [m]
BEFORE_END = 0.1  # distance from that end at which it is put back, as is one that is held a little over its line [m]

# A vehicle comes nearer to another one by at most so much [m/s]; no lane stays unlooked at for longer [s].
PASSES_BY, IN_ORDER_FOR = 50.0, 0.5

OWN_DRIVER = -1  # argument of setSpeed: SUMO's driver model chooses the speed again

NO_ATTRIBUTES: Mapping[str, str] = MappingProxyType({})

Entry = tuple[str, str, str]  # a member enters a junction: its id, the lane it leaves, the lane inside


class Placement:
    """The members in SUMO.

    step: of SUMO's [s]
    """

    def __init__(self, sumo: Client, network: Network, step: float) -> None:
        self._sumo, self._network, self._step = sumo, network, step
        self._shadows = Shadows(sumo, network, step)
        self.where: dict[str, tuple[str, str]] = {}  # edge and lane of each member
        self._in_order_until: defaultdict[str, float] = defaultdict(float)  # SUMO's clock [s], by lane
        # Of the members with these ids: edge and lane after the last step, the lane alone, and until when that is in
        # order, as last looked up.
        self._located_of: tuple[str, ...] = ()
        self._roads: list[tuple[str, str]] = []
        self._lanes: list[str] = []
        self._rows_until = np.empty(0)
        self._entries: list[Entry] = []  # since `entries` was last called
        self._was_in: dict[str, str] = {}  # junctions that members were in when they were set back before a closed line
        self._leg: dict[str, int] = {}  # index, among its route's edges, of the edge that each member is on
        # Of each member: route last set in SUMO, and the edge it began with.
        self._routed: dict[str, tuple[str, Route | None] | None] = defaultdict(lambda: None)
        self._settled_of: tuple[Member, ...] = ()  # at the last call of `settle`
        self._unsettled: set[str] = set()  # those of them of which the route may have to be set anew
        self._is_short: dict[str, bool] = {}  # by lane
        self._overlaps: dict[str, bool] = {}  # by lane
        self._on_overlapping: set[str] = set()  # members on a lane that overlaps one of another edge ...
        self._on_short: set[str] = set()  # ... on a short lane ...
        self._on_route: set[str] = set()  # ... on their path in a junction, or an overlapping lane of their route ...
        self._bound: set[str] = set()  # ... and those that were moved ON_ITS_ROUTE in the last step
        self._edge_inside = Once(self._find_edge_inside)
        self._class_of = Once(lambda name: sumo.vehicle.getVehicleClass(name))
        self._slowed: set[str] = set()  # SUMO-driven members with a failed drive
        self._movers: list[Mover] = []  # the members that SUMO does not drive ...
        self._movers_of: tuple[str, ...] = ()  # ... of these

    def roads(self, fleet: Fleet) -> list[tuple[str, str]]:
        """Edge and lane of each member after the last step; the lane is "" off the road."""
        if fleet.ids is not self._located_of:
            self._find_rows(fleet)
        return [*self._roads]

    def lanes(self, fleet: Fleet) -> list[str]:
        """The lane of each member after the last step; "" off the road."""
        if fleet.ids is not self._located_of:
            self._find_rows(fleet)
        return self._lanes

    def _find_rows(self, fleet: Fleet) -> None:
        self._located_of, self._roads = fleet.ids, [self.where.get(name, ("", "")) for name in fleet.ids]
        self._lanes = [lane for _, lane in self._roads]
        self._rows_until = np.zeros(len(fleet.ids))

    def entries(self) -> list[Entry]:
        """Members that have entered junctions since the last call."""
        entries, self._entries = self._entries, []
        return entries

    # ---- inserting

    def insert(self, fleet: Fleet) -> None:
        """Put members onto their lanes; in the step after, `place` moves them to their start poses."""
        for member, native in zip(fleet.members, fleet.native.tolist(), strict=True):
            self._add(member, native)
        # A vehicle must have been on a lane before it may stand where there is none, as in the outer corner of a bend;
        # and moving it onto one inserts it even where another waits at the same position.
        for member in fleet.members:
            x, y, heading = self._network.lane_pose(member.edge, member.lane, member.position)
            overlaps = self._overlaps_another(f"{member.edge}_{member.lane}")
            for here in (self._on_overlapping, self._on_route):
                (here.add if overlaps else here.discard)(member.id)
            how = ON_ITS_ROUTE if overlaps else EXACTLY
            self._sumo.vehicle.moveToXY(member.id, *ANY_LANE, x, y, sumo_angle(heading), *how)

    def _add(self, member: Member, native: bool) -> None:
        types, kind, model = self._sumo.vehicletype, kind_of(member.id), member.model
        make_type_of(self._sumo, kind, model, member.law.vehicle_type if native else NO_ATTRIBUTES)
        if native:
            types.setSpeedFactor(kind, member.law.speed_factor)
            types.setMaxSpeed(kind, min(member.law.max_speed, model.top_speed))
            types.setImperfection(kind, member.law.imperfection)
            self._sumo.route.add(kind, self._edges_ahead(member, member.edge))
        else:
            self._sumo.route.add(kind, [member.edge])
        self._sumo.vehicle.add(
            member.id, kind, typeID=kind, depart="now", departLane=str(member.lane),
            departPos=str(member.position), departSpeed=str(member.speed),
        )  # fmt: skip

    def take_over(self, platoon: Fleet) -> Fleet:
        """A platoon that SUMO has just inserted: from now on the fleet moves it, or SUMO drives it and it is read."""
        vehicle = self._sumo.vehicle
        followed = np.isin(np.arange(len(platoon)), platoon.predecessor[~platoon.native])
        for i, (member, native) in enumerate(zip(platoon.members, platoon.native, strict=True)):
            if not native:
                release(self._sumo, member.id)
                continue
            if followed[i]:  # back on the right it would cut in before its own followers
                vehicle.setParameter(member.id, "laneChangeModel.lcKeepRight", "0")
            if not member.law.overtakes:
                vehicle.setLaneChangeMode(member.id, AS_THE_ROUTE_DOES)
            if member.law.controller:
                switch_on(self._sumo, platoon, i)
        self.locate(platoon)
        self.settle(platoon)
        return self.read(platoon)

    def adopt(self, vehicles: Fleet) -> Fleet:
        """Vehicles of the traffic that become members, each where it is."""
        vehicle = self._sumo.vehicle
        for member, native in zip(vehicles.members, vehicles.native.tolist(), strict=True):
            kind = kind_of(member.id)
            make_type_from(self._sumo, kind, vehicle.getTypeID(member.id), member.model, native)
            vehicle.setType(member.id, kind)
            if not native:
                vehicle.setSpeedFactor(member.id, ANY_SPEED)
        return self.take_over(vehicles)

    def hand_back(self, member: Member, kind: str, speed_factor: float) -> None:
        """From now on SUMO drives a member from the traffic, where it is, as the driver that it was.

        Where it is on no lane SUMO would lose it: it is put onto the nearest one of its route.

        kind: the type that it had
        """
        vehicle, name = self._sumo.vehicle, member.id
        edge, lane = self.where[name]
        if not lane:
            edge = self._put_on_its_route(member)
        if edge in member.route.edges:
            self._set_route(name, self._edges_ahead(member, edge))
        vehicle.setType(name, kind)
        vehicle.setSpeedFactor(name, speed_factor)
        vehicle.setSpeedMode(name, ALL_CHECKS_ON)
        vehicle.setLaneChangeMode(name, USUAL_LANE_CHANGES)
        vehicle.setSpeed(name, OWN_DRIVER)
        self.forget([name])

    def forget(self, names: Iterable[str]) -> None:
        """These are members no longer: they have left the road, or are SUMO's."""
        self._shadows.forget(names)
        for name in names:
            for known in (self.where, self._routed, self._leg, self._was_in):
                known.pop(name, None)
            for there in (self._on_overlapping, self._on_short, self._on_route, self._bound):
                there.discard(name)

    def _put_on_its_route(self, member: Member) -> str:
        """Put a member onto the nearest lane of the edge of its route that it was on, or of the next one; that edge."""
        vehicle, lanes, found = self._sumo.vehicle, self._sumo.lane, []
        here, own = shapely.Point(vehicle.getPosition(member.id)), self._class_of[member.id]
        for edge in member.route.edges[self._leg.get(member.id, 0) :][:2]:
            for name in (f"{edge}_{k}" for k in range(len(self._network.edges[edge]))):
                if self._allows(name, own):
                    line = shapely.LineString(lanes.getShape(name))
                    found.append((line.distance(here), edge, name, line.project(here, normalized=True)))
        _, edge, name, share = min(found)
        place = min(share * lanes.getLength(name), lanes.getLength(name) - BEFORE_END)
        self._move_to(member.id, name, place)
        return edge

    def _allows(self, lane: str, kind: str) -> bool:
        """Whether a lane is open to vehicles of a class."""
        allowed = self._sumo.lane.getAllowed(lane)
        return (not allowed or kind in allowed) and kind not in self._sumo.lane.getDisallowed(lane)

    def _move_to(self, name: str, lane: str, place: float) -> None:
        """Move a vehicle that may be off the road. SUMO does nothing where it has just left that lane."""
        vehicle = self._sumo.vehicle
        vehicle.moveTo(name, lane, place)
        if not vehicle.getLaneID(name):
            vehicle.moveTo(name, self._another_lane(name, lane), 0.0)
            vehicle.moveTo(name, lane, place)

    # ---- before a step

    def place(self, fleet: Fleet, brakes: np.ndarray | None, over_line: Mapping[str, float]) -> None:
        """Tell SUMO the pose of every moved member at the end of the coming step.

        brakes  : deceleration of members with a failed drive, (n,), by which SUMO-driven ones are slowed; NaN: sound
                  [m/s2]
        over_line: how far members that stand at a closed line are over it [m]. SUMO has them before it: its drivers
                  give way to all that stand inside a junction, and a left-turner would never leave it

        raises: RunError (a pose is not finite: SUMO would accept it)
        """
        motion, move, row_of = fleet.motion, direct(self._sumo.vehicle.moveToXY), fleet.row_of
        n = motion.x.size
        poses = np.empty((3, n))
        if not fill_in_poses(motion.x, motion.y, motion.heading, fleet.model.length, poses):
            raise RunError("a member's pose is not finite")
        self._shadows.cast(self._moved(fleet))
        aside = direct(self._sumo.vehicle.getLateralLanePosition)
        x, y, angle = poses.tolist()
        held = over_line.keys() & row_of.keys()
        for name in held:
            i = row_of[name]
            x[i], y[i] = _set_back(x[i], y[i], angle[i], over_line[name] + BEFORE_END)
            if (inside := self.where[name][1])[:1] == ":":
                self._was_in[name] = junction_of(inside)
        keep_route, threshold = [EXACTLY[0]] * n, [EXACTLY[1]] * n
        self._bound = set()
        for name in self._on_overlapping | self._on_short | self._on_route:
            if (i := row_of.get(name)) is None or fleet.native[i]:
                continue
            how = WHERE_LANES_OVERLAP if name in self._on_overlapping else EXACTLY
            on_path = name in self._on_route and name not in held and abs(aside(name)) < ASIDE
            if name in self._on_short or on_path:
                self._bound.add(name)
                how = ON_ITS_ROUTE
            keep_route[i], threshold[i] = how
        # Thousands in every step: arguments go from columns into the calls without a loop of Python.
        columns = fleet.ids, *ANYWHERE, x, y, angle, keep_route, threshold
        deque(map(move, *_of_moved(fleet, columns)), maxlen=0)
        if fleet.native_rows.size:
            strongest = fleet.model.strongest_acceleration(motion.speed)
            for i in fleet.native_rows:
                if "accel" not in fleet.members[i].law.vehicle_type:
                    limit_acceleration(self._sumo, kind_of(fleet.members[i].id), float(strongest[i]))
        self._slow(fleet, brakes)

    def _is_a_short_lane(self, lane: str) -> bool:
        if lane not in self._is_short:
            self._is_short[lane] = bool(lane) and self._sumo.lane.getLength(lane) < SHORT
        return self._is_short[lane]

    def _overlaps_another(self, lane: str) -> bool:
        if lane not in self._overlaps:
            self._overlaps[lane] = lane[:1] not in ("", ":") and self._network.overlaps_another(lane)
        return self._overlaps[lane]

    def _slow(self, fleet: Fleet, brakes: np.ndarray | None) -> None:
        """Slow SUMO-driven members with a failed drive; repaired ones drive by themselves again."""
        if brakes is None and not self._slowed:
            return
        slowed = set()
        for i in () if brakes is None else np.flatnonzero(fleet.native & ~np.isnan(brakes)):
            speed = max(float(fleet.motion.speed[i] - brakes[i] * self._step), 0.0)
            self._sumo.vehicle.setSpeed(fleet.members[i].id, speed)
            slowed.add(fleet.members[i].id)
        for member in fleet.members if self._slowed else ():
            if member.id in self._slowed - slowed:
                self._sumo.vehicle.setSpeed(member.id, OWN_DRIVER)
        self._slowed = slowed

    # ---- after a step

    def locate(self, fleet: Fleet) -> None:
        """Read the edge and lane of every member, and note those that have entered a junction."""
        ids, where = fleet.ids, self.where
        lanes, located = list(map(direct(self._sumo.vehicle.getLaneID), ids)), self.lanes(fleet)
        elsewhere = map(ne, lanes, located)
        if "" in lanes:  # some are off the road
            elsewhere = map(or_, elsewhere, map(not_, lanes))
        for row in [*compress(count(), elsewhere)]:  # few
            name, lane, before = ids[row], lanes[row], located[row]
            if before and not lane and self._put_back(name, before):
                continue
            enters = lane[:1] == ":" and before and before[0] != ":"
            if enters and self._was_in.pop(name, None) != junction_of(lane):
                self._entries.append((name, before, lane))
            where[name] = self._roads[row] = self._sumo.vehicle.getRoadID(name), lane
            located[row] = lane
            self._in_order_until.pop(lane, None)
            self._rows_until[row] = 0.0
            if (routed := self._routed[name]) and routed[0] != where[name][0]:
                self._routed[name] = "", routed[1]  # SUMO may replace its route before it is on that edge again
            self._unsettled.add(name)
            (self._on_short.add if self._is_a_short_lane(lane) else self._on_short.discard)(name)
            overlaps = self._overlaps_another(lane)
            (self._on_overlapping.add if overlaps else self._on_overlapping.discard)(name)
            on_path = (lane[:1] == ":" or overlaps) and self._keeps_to_its_route(fleet.members[row], lane)
            (self._on_route.add if on_path else self._on_route.discard)(name)
        self._shadows.observe(self._moved(fleet), where)

    def _keeps_to_its_route(self, member: Member, lane: str) -> bool:
        """Whether a member is on a lane of its route; inside a junction also whether it was in the last step."""
        if member.route is None:
            return False
        if lane[:1] != ":":
            return edge_of(lane) in member.route.edges
        line = next((line for line in member.route.lines if lane in line.via), None)
        if line is None:
            return member.id in self._bound
        edges = edge_of(line.lane), edge_of(line.onto)
        return self._edge_inside[*edges, self._class_of[member.id]] == edge_of(line.via[0])

    def _find_edge_inside(self, key: tuple[str, str, str]) -> str:
        """The edge inside a junction on which SUMO looks for vehicles of a route from one edge to the next.

        It is that of the first lane that leads there, though others may have others, as beside a lane for buses.

        key: edges before and beyond the junction, class of the vehicle
        """
        before, beyond, kind = key
        for k in range(len(self._network.edges[before])):
            for link in self._sumo.lane.getLinks(f"{before}_{k}"):
                via = link[LINK_VIA]
                if edge_of(link[LINK_ONTO]) == beyond and via and self._allows(via, kind):
                    return edge_of(via)
        return ""

    def _put_back(self, name: str, lane: str) -> bool:
        """Put a member that is in the wedge beyond a lane back at the end of that lane, until its next move.

        SUMO may die in the next step of a vehicle that has left the network before a junction or inside it, and its
        drivers would not see it.
        """
        vehicle, lanes = self._sumo.vehicle, self._sumo.lane
        front = vehicle.getPosition(name)
        if math.dist(front, lanes.getShape(lane)[-1]) > WEDGE:
            return False
        end, begins = max(lanes.getLength(lane) - BEFORE_END, 0.0), [f"{edge}_0" for edge in vehicle.getRoute(name)]
        with contextlib.suppress(self._sumo.TraCIException):
            self._move_to(name, lane, end)
            return True
        # The lane is not on its route: another edge was nearer, and SUMO has given it a route that leads there.
        if near := [begin for begin in begins if math.dist(front, lanes.getShape(begin)[0]) < NEAR]:
            vehicle.moveTo(name, near[0], 0.0)
        return False

    def put_in_order(self, fleet: Fleet, time: float) -> None:
        """Repair SUMO's order of vehicles on lanes where a member has passed another vehicle; after `locate`.

        SUMO looks for a vehicle's place in a lane's order only when it enters the lane, and takes the next in the order
        for its leader. So members leave the lane and enter it again, both before the next step: no driver sees them
        elsewhere. Where vehicles are far apart they are asked for more rarely: none passes another one so soon.

        time: SUMO's clock [s]
        """
        due = ((self._rows_until <= time + 1e-6) & ~fleet.native).nonzero()[0].tolist()
        if not due:
            return
        vehicle, on_lane = self._sumo.vehicle, direct(self._sumo.lane.getLastStepVehicleIDs)
        position_of, where = direct(vehicle.getLanePosition), self.where
        lanes, until = [*map(self._lanes.__getitem__, due)], self._in_order_until
        self._rows_until[due] = [*map(until.__getitem__, lanes)]
        for lane in dict.fromkeys(filter(None, lanes)):
            if until[lane] > time + 1e-6:
                continue
            order = on_lane(lane)
            positions = list(map(position_of, order)) if len(order) > 1 else []
            apart = min(map(sub, positions[1:], positions), default=math.inf)
            if apart >= 0:
                until[lane] = time + min(apart / PASSES_BY, IN_ORDER_FOR)
                continue
            position = dict(zip(order, positions, strict=True))
            names = [mover.id for mover in self._moved(fleet) if where[mover.id][1] == lane]
            away = {name: other for name in names if (other := self._another_lane(name, lane))}
            for name, other in away.items():
                vehicle.moveTo(name, other, 0.0)
            for name in away:
                vehicle.moveTo(name, lane, position[name])
            self._shadows.lost(away)

    def _another_lane(self, name: str, lane: str) -> str:
        """Another lane of a vehicle's edge, or of the next or previous edge of its route; "" if there is none."""
        edge = edge_of(lane)
        if self._sumo.edge.getLaneNumber(edge) > 1:
            return f"{edge}_{int(index_of(lane) == 0)}"
        route, here = self._sumo.vehicle.getRoute(name), self._sumo.vehicle.getRouteIndex(name)
        return next((f"{other}_0" for other in (*route[here + 1 : here + 2], *route[max(here - 1, 0) : here])), "")

    def settle(self, fleet: Fleet) -> None:
        """Correct the members' speeds and routes in SUMO."""
        set_speed, speeds = direct(self._sumo.vehicle.setPreviousSpeed), np.abs(fleet.motion.speed).tolist()
        # The speed SUMO derives is wrong where a lane's length is not that of the path driven: at corners.
        deque(map(set_speed, *_of_moved(fleet, (fleet.ids, speeds))), maxlen=0)
        if fleet.members is not self._settled_of:
            self._settled_of, self._unsettled = fleet.members, set(fleet.ids)
        row_of, where, edges = fleet.row_of, self.where, self._network.edges
        # Inside junctions there is nothing to set.
        on_edges = [name for name in self._unsettled if name in row_of and where[name][0] in edges]
        for row in sorted(map(row_of.__getitem__, on_edges)):
            member = fleet.members[row]
            # A SUMO-driven one keeps to the route that it was given.
            if (fleet.native[row] and not member.route.closed) or self._is_settled(member):
                self._unsettled.remove(member.id)

    def _is_settled(self, member: Member) -> bool:
        """Set the route of a member outside junctions in SUMO, where it is not; False: try again after the next step.

        Other drivers judge right of way by the route. Moving a vehicle off its route replaces the route.
        """
        vehicle, edge = self._sumo.vehicle, self.where[member.id][0]
        routed = self._routed[member.id]
        if routed == (edge, member.route):
            return True
        if vehicle.getRoute(member.id)[vehicle.getRouteIndex(member.id)] != edge:
            return False  # for a few steps after a junction SUMO still counts it to the edge before
        if member.route and edge not in member.route.edges:  # beside its route: SUMO knows what it is on
            self._routed.pop(member.id, None)
            return False
        if routed and _edges(routed[1]) != _edges(member.route):
            self._leg.pop(member.id, None)
        self._set_route(member.id, self._edges_ahead(member, edge))
        self._routed[member.id] = edge, member.route
        return True

    def _set_route(self, name: str, ahead: list[str]) -> None:
        """Give a vehicle its route from the edge on that it is on.

        SUMO keeps the edges that it has driven in front of the route, and refuses the whole if one of these is closed
        to it: where it was beside its lane inside a junction, and so came from a road of buses as SUMO sees it.
        Vehicles of the class "ignoring" may drive on every road. Where SUMO refuses that too, the route is the one that
        SUMO has made.
        """
        vehicle, types, kind = self._sumo.vehicle, self._sumo.vehicletype, kind_of(name)
        try:
            vehicle.setRoute(name, ahead)
        except self._sumo.TraCIException:
            own = types.getVehicleClass(kind)
            types.setVehicleClass(kind, "ignoring")
            with contextlib.suppress(self._sumo.TraCIException):
                vehicle.setRoute(name, ahead)
            types.setVehicleClass(kind, own)

    def _edges_ahead(self, member: Member, edge: str) -> list[str]:
        """The intended edges from this one on; straight on for a member without a route."""
        if not member.route:
            return list(self._network.onward(edge))
        edges = member.route.edges
        leg = self._leg.get(member.id, 0)
        # The next visit of an edge that the route uses more than once.
        here = edges.index(edge, leg) if edge in edges[leg:] else edges.index(edge)
        self._leg[member.id] = here
        return [*edges[here:], *(edges[:here] if member.route.closed else ())]

    def read(self, fleet: Fleet) -> Fleet:
        """The fleet with the poses of SUMO-driven members."""
        rows, vehicle = fleet.native_rows, self._sumo.vehicle
        if not len(rows):
            return fleet
        names = [fleet.members[i].id for i in rows]
        front = np.array([vehicle.getPosition(name) for name in names])
        heading = heading_of(np.array([vehicle.getAngle(name) for name in names]))
        speed = np.array([vehicle.getSpeed(name) for name in names])
        fleet = fleet.driven(rows, *centre_of(*front.T, heading, fleet.model.length[rows]), heading, speed, self._step)
        feed(self._sumo, fleet)
        return fleet

    def _moved(self, fleet: Fleet) -> list[Mover]:
        """The members that SUMO does not drive."""
        if fleet.ids is not self._movers_of:
            members = zip(fleet.members, fleet.native.tolist(), strict=True)
            self._movers = [Mover(m.id, kind_of(m.id), m.model.width) for m, native in members if not native]
            self._movers_of = fleet.ids
        return self._movers


def _edges(route: Route | None) -> tuple[str, ...]:
    return route.edges if route else ()


def _set_back(x: float, y: float, angle: float, distance: float) -> tuple[float, float]:
    """A place as SUMO has it, some distance [m] farther back. angle: clockwise from north [deg]"""
    course = math.radians(90 - angle)
    return x - distance * math.cos(course), y - distance * math.sin(course)


def _of_moved(fleet: Fleet, columns: Sequence[Iterable[Any]]) -> Sequence[Iterable[Any]]:
    """Columns with one value a member, without those of the members that SUMO drives."""
    if not fleet.native_rows.size:
        return columns
    moved = (~fleet.native).tolist()
    return [compress(column, moved) for column in columns]
