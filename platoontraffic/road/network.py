"""The road network: its shape, its lanes, routes through it. The only importer of sumolib."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely.geometry import LinearRing, LineString, Polygon

from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.lidar import kerbs
from platoontraffic.road import levels, light_programs
from platoontraffic.road.fastest_routes import TURNS_BACK, FastestRoutes
from platoontraffic.road.lane_ids import edge_of
from platoontraffic.road.lane_routes import CHANGING, Change, LaneRoute, Line, inside, least_changes, links_between
from platoontraffic.road.lane_times import LaneTimes
from platoontraffic.road.middle_lines import MiddleLines
from platoontraffic.road.netconvert import build_net
from platoontraffic.road.permissions import CAR, is_road, users
from platoontraffic.road.sumo_configuration import Configuration, read_configuration
from platoontraffic.road.sumo_files import (
    Shape,
    check_net_file,
    file_named_in,
    id_clashes,
    names_files,
    read_polygons,
)
from platoontraffic.road.sumo_values import MOST

if TYPE_CHECKING:
    import sumolib.net

# Beside Network, the names of this room's other files that other rooms use.
__all__ = [
    "CHANGING",
    "Configuration",
    "Line",
    "Network",
    "Shape",
    "build_net",
    "check_net_file",
    "file_named_in",
    "id_clashes",
    "names_files",
    "read_configuration",
    "read_polygons",
]

CACHED_LANES = 100  # below this number, computing the drivable area takes some 15 ms: not worth a file in the cache
OFF_MIDDLE = 0.3  # of a vehicle that keeps to its lane, at most [lane widths]
ALONG = 1.0  # least length on which lanes overlap [m]
MARGIN = 0.3  # by which a corner of a vehicle may be beside its lanes and junctions [m]
UNREGULATED = "unregulated", "traffic_light_unregulated"  # types of junctions at which nobody has to give way
REVERSAL_PENALTY = 3600.0  # extra travel time that a route may take to avoid turning back [s]
START_POSITION = 40.0  # of a sample trip on its first lane, where that is long enough [m]


@dataclass(frozen=True, eq=False)
class Network:
    """A network that SUMO can load; x east, y north, headings counter-clockwise from east [rad]."""

    path: Path
    _net: sumolib.net.Net
    left_hand: bool = False  # traffic keeps to the left

    @classmethod
    def read(cls, path: str | Path) -> Network:
        """Check a file, then read it.

        raises : InputError where the network is broken or incomplete
        """
        import sumolib.net  # takes 0.1 s, which checking a file need not wait for

        left_hand = check_net_file(path)
        try:
            # Routes need the lanes inside junctions; conflicts between links are asked of SUMO itself.
            net = sumolib.net.readNet(str(path), withInternal=True, withFoes=False)
            fault = _incomplete(net)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: something is missing ({error!r}); must be as netconvert writes it") from error
        if fault:
            raise InputError(f"{path}: {fault}; must be as netconvert writes it")
        return cls(Path(path), net, left_hand)

    @cached_property
    def edges(self) -> Mapping[str, tuple[float, ...]]:
        """Lengths of every road edge's lanes [m], the rightmost lane first; in left-hand traffic, the leftmost."""
        return {edge.getID(): tuple(lane.getLength() for lane in edge.getLanes()) for edge in self._roads}

    @cached_property
    def drivable(self) -> shapely.Geometry:
        """The area of all lanes and junctions: one polygon, or several where the network has separate parts.

        raises: InputError if there is no lane, as in a network of railways
        """
        lanes = [lane for edge in self._roads for lane in edge.getLanes() if is_road(lane)]
        if not lanes:
            raise InputError(f"{self.path}: the network has no lane for road vehicles; must have one")
        shapes, widths = [lane.getShape() for lane in lanes], [lane.getWidth() for lane in lanes]
        cache = None
        if len(lanes) >= CACHED_LANES:
            import platformdirs

            cache = platformdirs.user_cache_path("platoontraffic")
        area = kerbs.drivable(shapes, widths, self._junction_areas.values(), cache)
        shapely.prepare(area)
        return area

    def own_side(self, edge: str) -> shapely.Geometry:
        """The area of all lanes of an edge and of the junctions at its ends, `MARGIN` larger."""
        if edge not in self._own_sides:
            road, areas = self._net.getEdge(edge), self._junction_areas
            ends = [areas[node.getID()] for node in (road.getFromNode(), road.getToNode()) if node.getID() in areas]
            self._own_sides[edge] = shapely.union_all([*self._lanes_of(edge, "square"), *ends]).buffer(MARGIN)
            shapely.prepare(self._own_sides[edge])
        return self._own_sides[edge]

    def is_on_lanes(self, edge: str, body: shapely.Geometry) -> bool:
        """Whether a body is on the lanes of an edge, `MARGIN` larger; False inside junctions."""
        if not self._net.hasEdge(edge) or self._net.getEdge(edge).getFunction() == "internal":
            return False
        return shapely.union_all(self._lanes_of(edge, "flat")).buffer(MARGIN).covers(body)

    def _lanes_of(self, edge: str, ends: str) -> list[shapely.Geometry]:
        """The areas of the lanes of an edge; with flat ends, or with square ones, half a lane longer."""
        lanes = self._net.getEdge(edge).getLanes()
        return [LineString(one.getShape()).buffer(one.getWidth() / 2, cap_style=ends) for one in lanes]

    @cached_property
    def _own_sides(self) -> dict[str, shapely.Geometry]:
        return {}

    def outline(self, tolerance: float = 0.0) -> list[LinearRing]:
        """The borders of the drivable area, within a tolerance [m]; they are the walls where a scene has walls."""
        return kerbs.borders(self.drivable, tolerance)

    @cached_property
    def widest_lane(self) -> float:
        """Width of the widest lane [m]: distinguishes streets for cars from lanes for robots."""
        return max((lane.getWidth() for edge in self._roads for lane in edge.getLanes()), default=0.0)

    def limit(self, edge_id: str, lane_index: int = 0) -> float:
        """The speed limit of a lane [m/s]."""
        return self._net.getEdge(self._known(edge_id)).getLane(lane_index).getSpeed()

    def lane_width(self, edge_id: str, lane_index: int = 0) -> float:
        """The width of a lane [m]."""
        return self._net.getEdge(self._known(edge_id)).getLane(lane_index).getWidth()

    def lane_pose(self, edge_id: str, lane_index: int = 0, position: float = 0.0) -> tuple[float, float, float]:
        """x, y [m] and heading [rad] on a lane's centre line, `position` [m] after its start.

        raises : InputError where there is no such place, or not for cars
        """
        lengths = self.edges[self._known(edge_id)]
        self._check_lane(self._net.getEdge(edge_id), lane_index)
        length = lengths[lane_index]
        if not 0 <= position <= length + 1e-9:
            raise InputError(f"edge '{edge_id}': position {position:g} m is not on it; must be 0..{length:g} m")
        points = np.array(self._net.getEdge(edge_id).getLane(lane_index).getShape())
        steps = np.diff(points, axis=0)
        ends = np.cumsum(np.hypot(*steps.T))
        along = position / length * ends[-1]  # a lane's stated length may differ from that of its line
        k = min(int(np.searchsorted(ends, along, side="right")), len(steps) - 1)
        back = (ends[k] - along) / np.hypot(*steps[k])
        x, y = points[k + 1] - back * steps[k]
        return float(x), float(y), math.atan2(steps[k, 1], steps[k, 0])

    def route_line(self, edges: Sequence[str], lane: int = 0, closed: bool = False) -> np.ndarray:
        """The points of `route_lanes`."""
        return self.route_lanes(edges, lane, closed)[0]

    def route_lanes(
        self, edges: Sequence[str], lane: int = 0, closed: bool = False, position: float = 0.0,
        change: Change | None = None, longest: float = math.inf, before: Sequence[Line] = (),
    ) -> tuple[np.ndarray, np.ndarray, list[Line]]:  # fmt: skip
        """The centre line of the lanes of a route, across its junctions; a closed one ends where it starts.

        lane     : index on the first edge; lanes are changed as rarely as the route allows, near an edge's begin
        position : before which lanes are not changed [m], on the first edge, where driving starts, or on the change's
        change   : the first one; None: any
        longest  : greatest length of a change over one lane of that edge [m]
        before   : changes that are made before on that edge, with their stations on it
        returns  : points (k, 2) [m]; speed limit from each point on (k,) [m/s]; stop lines and lane changes
        raises   : InputError where there is no such route
        """
        if not edges:
            raise InputError("the route is empty; must name one or more edges")
        road = [self._net.getEdge(self._known(edge)) for edge in edges]
        for edge in road:
            self._check_edge(edge)
        self._check_lane(road[0], lane)
        first, route = lane, LaneRoute(self._net, self.left_hand)
        lap = [*road, road[0]] if closed else road
        links = least_changes(lap, lane, lane if closed else None, position, change)
        on = change.edge if change else 0
        for i, (here, link) in enumerate(zip(lap, links, strict=False)):
            route.cross(here.getLane(lane), link, *((position, longest, before) if i == on else (0.0,)))
            lane = link.getToLane().getIndex()
        if not closed:
            route.add(road[-1].getLane(lane))
        elif lane == first:
            route.close(road[0].getLane(lane))
        else:
            raise InputError(f"the route returns to '{edges[0]}' in lane {lane}, not {first}; start it in lane {lane}")
        return route.joined()

    def lane_for(self, edges: Sequence[str], classes: Collection[str] = ()) -> int:
        """Index of the lane for cars of the first edge from which a route crosses the fewest lanes; of equal ones, the
        right one.

        classes: of SUMO's vehicles, to all of which the lane is to be open too
        """
        road = [self._net.getEdge(self._known(edge)) for edge in edges]

        def crossed(lane: int) -> int:
            number = 0
            try:
                for link in least_changes(road, lane, None):
                    number += abs(link.getFromLane().getIndex() - lane)
                    lane = link.getToLane().getIndex()
            except ValueError:  # there is no way on
                return 1000
            return number

        fit = (lane.getIndex() for lane in road[0].getLanes() if all(map(lane.allows, (CAR, *classes))))
        return min(fit, key=crossed, default=0)

    def lane_times(self, edges: Sequence[str]) -> LaneTimes:
        """What each lane by which a vehicle may leave an edge of a route costs. edges: of the route"""
        return LaneTimes([self._net.getEdge(edge) for edge in edges])

    def fastest_route(self, start: str, end: str) -> list[str]:
        """The edges of the route that takes the least time at the speed limits, `start` and `end` included.

        It turns back on a road only where there is no other route.
        """
        a, b = (self._net.getEdge(self._known(edge)) for edge in (start, end))
        for edge in (a, b):
            self._check_edge(edge)
        route, _ = self._net.getOptimalPath(a, b, fastest=True, vClass=CAR, reversalPenalty=REVERSAL_PENALTY)
        if route is None:
            raise InputError(f"no route for cars from edge '{start}' to '{end}'")
        return [edge.getID() for edge in route]

    def fastest_routes(self, vclass: str = CAR) -> FastestRoutes:
        """Routes as SUMO finds them for trips on an empty network."""
        return FastestRoutes(self._net, vclass)

    def beyond(self, edge: str) -> Callable[[str], bool]:
        """Whether an edge lies beyond the end of this one: in the junction there, or among the edges that leave it.

        An edge that is reached only by turning back does not, so that a vehicle that is put onto it has not passed the
        end.
        """
        inside, reached = f":{self._net.getEdge(edge).getToNode().getID()}_", self._net.getEdge(edge).getOutgoing()
        onward = {
            out.getID() for out, links in reached.items()
            if any(link.getDirection() not in TURNS_BACK for link in links)
        }  # fmt: skip
        return lambda other: other.startswith(inside) or other in onward

    def leads_on(self, edge: str) -> bool:
        """Whether cars can drive on at an edge's end, other than by turning back."""
        onward = self._net.getEdge(edge).getAllowedOutgoing(CAR).values()
        return any(link.getDirection() not in TURNS_BACK for links in onward for link in links)

    def check_reversals(self, edges: Sequence[str], radius: float) -> None:
        """Raise InputError where a route turns back on its road on a smaller radius than the given one [m]."""
        for here, there in pairwise(map(self._net.getEdge, edges)):
            for link in links_between(here, there):
                half_circle = sum(lane.getLength() for lane in inside(link, self._net))
                if link.getDirection() in TURNS_BACK and half_circle < math.pi * radius:
                    raise InputError(
                        f"turns back from '{here.getID()}' to '{there.getID()}' on a radius of "
                        f"{half_circle / math.pi:.1f} m; the vehicle needs {radius:.1f} m"
                    )

    def sample_trip(self) -> tuple[str, float, str]:
        """The longest lane for cars, a position on it [m], and an edge that can be reached from there."""
        lanes = [lane for edge in self._roads for lane in edge.getLanes() if lane.allows(CAR)]
        if not lanes:
            raise InputError(f"{self.path}: the network has no lane for cars")
        lane = max(lanes, key=lambda lane: (lane.getLength(), lane.getID()))
        position = min(START_POSITION, round(0.9 * lane.getLength(), 1))
        return lane.getID(), position, self.onward(lane.getEdge().getID(), 4)[-1]

    def lanes_for_cars(self) -> list[tuple[str, int, float]]:
        """Edge, index and length [m] of every lane on which platoons can start."""
        roads = (edge for edge in self._roads if not edge.getBidi())
        return [
            (edge.getID(), lane.getIndex(), lane.getLength())
            for edge in roads
            for lane in edge.getLanes()
            if lane.allows(CAR)
        ]

    def lanes_at(self, x: Sequence[float], y: Sequence[float]) -> list[str]:
        """The lane on which each point is, by the nearest centre line, inside junctions too; "" beside the road."""
        lanes, lines = self._centre_lines
        points = shapely.points(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        nearest = lines.nearest(points)
        away = shapely.distance(points, lines.geometries[nearest])
        found = zip((lanes[k] for k in nearest.tolist()), away.tolist(), strict=True)
        return [lane.getID() if distance <= lane.getWidth() / 2 else "" for lane, distance in found]

    def lane_headed(self, x: float, y: float, heading: float) -> LineString | None:
        """The centre line of the lane on which a vehicle is, by its centre and heading; None inside junctions.

        Of lanes that overlap it is one that leads where the vehicle is headed, the nearest of these.
        """
        found = self._headed(x, y, heading, *self._lines_outside)
        return min(found, key=lambda one: one[0])[1] if found else None

    def keeps_to_a_lane(self, x: float, y: float, heading: float, body: shapely.Geometry) -> bool:
        """Whether a body, by its centre and heading, is on one lane, and one before and behind that, `MARGIN` larger.

        Inside a junction that is the path of one connection.
        """

        def beyond(lane: Any) -> list[Any]:
            links = [(link.getViaLaneID(), link.getToLane()) for link in lane.getOutgoing()]
            return [self._net.getLane(via) if via else onto for via, onto in links]

        for _, line, lane in self._headed(x, y, heading, *self._centre_lines):
            for before in [*lane.getIncoming(onlyDirect=True), None]:
                for behind in [*beyond(lane), None]:
                    lines = [(LineString(one.getShape()), one.getWidth()) for one in (before, behind) if one]
                    areas = [one.buffer(width / 2 + MARGIN) for one, width in [*lines, (line, lane.getWidth())]]
                    if shapely.union_all(areas).covers(body):
                        return True
        return False

    def overlaps_another(self, lane_id: str) -> bool:
        """Whether a lane runs so near to one of another edge that a vehicle which keeps to it may be on both.

        So it is on roads with kinks, which are narrower than their lanes, and where a bridge crosses.
        """
        lanes, lines = self._lines_outside
        own = self._net.getLane(lane_id)
        line, edge = LineString(own.getShape()), own.getEdge()
        for k in lines.query(line, predicate="dwithin", distance=(0.5 + OFF_MIDDLE) * self.widest_lane).tolist():
            if lanes[k].getEdge() is not edge:
                about = lines.geometries[k].buffer((0.5 + OFF_MIDDLE) * lanes[k].getWidth(), cap_style="flat")
                if line.intersection(about).length > ALONG:
                    return True
        return False

    def _headed(
        self, x: float, y: float, heading: float, lanes: Sequence[Any], lines: shapely.STRtree
    ) -> list[tuple[float, LineString, Any]]:
        """Distance [m], centre line and lane of those lanes at a place that lead where a vehicle is headed."""
        here, found = shapely.Point(x, y), []
        for k in lines.query(here, predicate="dwithin", distance=self.widest_lane / 2).tolist():
            lane, line = lanes[k], lines.geometries[k]
            along, away = line.project(here), line.distance(here)
            ends = [line.interpolate(min(max(along + by, 0.0), line.length)).coords[0] for by in (-0.1, 0.1)]
            if away <= lane.getWidth() / 2 and math.cos(_heading(ends) - heading) > 0.5:
                found.append((away, line, lane))
        return found

    @cached_property
    def _centre_lines(self) -> tuple[list[Any], shapely.STRtree]:
        return _lines_of(self._net.getEdges(withInternal=True))

    @cached_property
    def _lines_outside(self) -> tuple[list[Any], shapely.STRtree]:
        """As `_centre_lines`, but not of lanes inside junctions: in large networks these are most."""
        return _lines_of(self._roads)

    def upstream(self, lane_id: str, reach: float) -> list[tuple[str, float]]:
        """A lane and the lanes that lead to it within `reach` [m] of its end, those inside junctions too.

        Each with the shortest distance from its end to the end of the first [m].
        """
        distances: dict[str, float] = {}
        todo = [(0.0, lane_id)]
        while todo:
            distance, name = heapq.heappop(todo)
            if name in distances:  # already reached by a shorter path; round blocks the number of paths explodes
                continue
            distances[name] = distance
            lane = self._net.getLane(name)
            if (beyond := distance + lane.getLength()) < reach:
                for before in lane.getIncoming(onlyDirect=True):
                    heapq.heappush(todo, (beyond, before.getID()))
        return list(distances.items())

    def approaches(self, lane_id: str, reach: float) -> Iterator[tuple[str, ...]]:
        """The lanes before a lane on each path that leads to it, those inside junctions too, in driving order.

        reach: distance from which a path is found, to the end of the lane [m]
        """
        lane = self._net.getLane(lane_id)
        before = lane.getIncoming(onlyDirect=True) if (left := reach - lane.getLength()) > 0 else []
        for one in before:
            yield from ((*path, one.getID()) for path in self.approaches(one.getID(), left))
        if not before:
            yield ()

    def only_before(self, lane_id: str) -> str:
        """The lane, which may be inside a junction, from which all vehicles on a lane come.

        "" if there are several or none, or if it leads elsewhere too.
        """
        before = self._net.getLane(lane_id).getIncoming(onlyDirect=True)
        is_only = len(before) == 1 and len(before[0].getOutgoing()) == 1
        return before[0].getID() if is_only else ""

    @cached_property
    def entered_from(self) -> Mapping[str, str]:
        """The lane from which vehicles enter each lane inside junctions, by id."""
        links = (link for edge in self._roads for links in edge.getOutgoing().values() for link in links)
        return {lane.getID(): link.getFromLane().getID() for link in links for lane in inside(link, self._net)}

    @cached_property
    def has_junctions(self) -> bool:
        """Whether some road leads to two others, or is reached from two, other than by turning back."""
        onward = [
            (edge, out) for edge in self._roads for out, links in edge.getOutgoing().items()
            if any(link.getDirection() not in TURNS_BACK for link in links)
        ]  # fmt: skip
        return any(len({pair[k] for pair in onward}) < len(onward) for k in (0, 1))

    def inside_with(self, lane_id: str) -> Sequence[str]:
        """All lanes inside the junction in which a lane is; () if it is in none."""
        return self._inside_of.get(junction_of(lane_id), ())

    @cached_property
    def _inside_of(self) -> Mapping[str, list[str]]:
        lanes: dict[str, list[str]] = {}
        for name in sorted(self.entered_from):
            lanes.setdefault(junction_of(name), []).append(name)
        return lanes

    @cached_property
    def unregulated(self) -> frozenset[str]:
        """Lanes inside junctions at which nobody has to give way, though paths cross: SUMO's types of UNREGULATED."""
        return frozenset(
            lane for lane in self.entered_from
            if self._net.getNode(junction_of(lane)).getType() in UNREGULATED
        )  # fmt: skip

    def onward(self, edge_id: str, n: int = 2) -> tuple[str, ...]:
        """An edge and the next ones along the straightest route; n edges, fewer where the road ends."""
        route = [self._net.getEdge(self._known(edge_id))]
        while len(route) < n and (choices := route[-1].getAllowedOutgoing(CAR)):
            arriving = _heading(route[-1].getLane(0).getShape()[-2:])
            turns = {edge: abs(_wrapped(_heading(edge.getLane(0).getShape()[:2]) - arriving)) for edge in choices}
            route.append(min(turns, key=lambda edge: (turns[edge], edge.getID())))
        return tuple(edge.getID() for edge in route)

    def middle_lines(self) -> list[LineString]:
        """Lines between the directions of each road, continued round corners up to junctions of three or more arms."""
        return list(self._middles.lines)

    def crossed_without_junction(self, edges: Sequence[str]) -> dict[str, list[tuple[str, float, float]]]:
        """The roads over or below each of some edges, as `levels.crossings`."""
        if new := [edge for edge in edges if edge not in self._crossed]:
            lines = {e.getID(): [np.array(lane.getShape()) for lane in e.getLanes()] for e in self._roads}
            self._crossed.update(levels.crossings(lines, new))
        return {edge: self._crossed[edge] for edge in edges}

    def lane_borders(self) -> list[LineString]:
        """Lines between neighbouring lanes of one direction."""
        borders = []
        for edge in self._roads:
            for lane in [*filter(is_road, edge.getLanes())][1:]:
                beside = lane.getWidth() / 2 * (1 if self.left_hand else -1)
                border = LineString(lane.getShape()).offset_curve(beside, join_style="mitre")
                borders += [part for part in shapely.get_parts(border) if not part.is_empty]
        return borders

    def signal_lines(self) -> list[tuple[LineString, str, int]]:
        """The stop line of each link that a traffic light controls, the light, and the link's number in its state.

        Links from one lane have equal parts of its stop line each.
        """
        found = []
        for lane in (lane for edge in self._roads for lane in edge.getLanes()):
            links = [link for link in lane.getOutgoing() if link.getTLSID()]
            heading, end = _heading(lane.getShape()[-2:]), np.array(lane.getShape()[-1])
            left = lane.getWidth() / 2 * np.array([-math.sin(heading), math.cos(heading)])
            for k, link in enumerate(links):
                part = [end + (2 * share / len(links) - 1) * left for share in (k, k + 1)]
                found.append((LineString(part), link.getTLSID(), link.getTLLinkIndex()))
        return found

    @cached_property
    def longest_closed(self) -> Mapping[tuple[str, int], float]:
        """As `light_programs.longest_closed`."""
        return light_programs.longest_closed(self.path)

    def junctions(self) -> list[shapely.Polygon]:
        """The areas of all junctions that have one."""
        parts = shapely.get_parts(list(self._junction_areas.values()))
        return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]

    def right_of_middle(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Distance to the right of the road's middle, seen along each heading; negative to the left [m], (n,).

        NaN inside junctions of three or more arms, on one-way roads and off the road. The direction of the road is
        that of a stretch as long as the road is wide on both sides, so that a vehicle may turn on the spot in a corner.
        """
        x, y, heading = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (x, y, heading))
        return self._middles.right_of(x, y, heading, self.drivable)

    @cached_property
    def _crossed(self) -> dict[str, list[tuple[str, float, float]]]:
        """Roads over or below each edge that has been asked for."""
        return {}

    @cached_property
    def _roads(self) -> list[sumolib.net.edge.Edge]:
        """Edges for road vehicles: no railways, waterways and footpaths."""
        return [edge for edge in self._net.getEdges(withInternal=False) if any(map(is_road, edge.getLanes()))]

    @cached_property
    def _junction_areas(self) -> dict[str, shapely.Geometry]:
        """Areas of junctions by id; dead ends have none, and shapes may intersect themselves."""
        nodes = dict.fromkeys(node for edge in self._roads for node in (edge.getFromNode(), edge.getToNode()))
        shapes = {node.getID(): node.getShape() for node in nodes}
        return {node: Polygon(shape).buffer(0) for node, shape in shapes.items() if len(shape) >= 3}

    @cached_property
    def _middles(self) -> MiddleLines:
        return MiddleLines.of(self._roads, self.left_hand, self._junction_areas)

    def _known(self, edge_id: str) -> str:
        if edge_id not in self.edges:
            if self._net.hasEdge(edge_id):
                edge = self._net.getEdge(edge_id)
                raise InputError(f"edge '{edge_id}' is not a road: it is {users(edge)}")
            raise InputError(f"no edge '{edge_id}' in {self.path.name}{did_you_mean(edge_id, self.edges)}")
        return edge_id

    def has_edge(self, edge_id: str) -> bool:
        """Whether there is such an edge, be it a road or not."""
        return bool(self._net.hasEdge(edge_id))

    def leads_to(self, edge_id: str, next_id: str) -> bool:
        """Whether a link leads from an edge to another one, whoever may use it."""
        return self._net.getEdge(next_id) in self._net.getEdge(edge_id).getOutgoing()

    def edges_after(self, edge_id: str) -> list[str]:
        """The edges to which links lead from an edge, whoever may use them."""
        return sorted(edge.getID() for edge in self._net.getEdge(edge_id).getOutgoing())

    def number_of_lanes(self, edge_id: str) -> int:
        return self._net.getEdge(edge_id).getLaneNumber()

    def check_roads(self, edges: Iterable[str]) -> None:
        """Raise InputError with a fault for each that is not an edge on which platoons can drive."""
        faults: list[str] = []
        for edge in dict.fromkeys(edges):
            try:
                self._check_edge(self._net.getEdge(self._known(edge)))
            except InputError as error:
                faults += error.faults
        if faults:
            raise InputError(*faults)

    def _check_edge(self, edge: Any) -> None:
        """Raise InputError where platoons cannot drive."""
        if not edge.allows(CAR):
            raise InputError(f"edge '{edge.getID()}' has no lane for cars: it is {users(edge)}")
        if back := edge.getBidi():  # SUMO would now and then take a member for an oncoming vehicle
            raise InputError(f"edge '{edge.getID()}' shares its lane with oncoming '{back.getID()}'; must have its own")

    def _check_lane(self, edge: Any, index: int) -> None:
        """Raise InputError where the edge has no such lane, or cars may not use it."""
        self._check_edge(edge)
        n, outer = edge.getLaneNumber(), "leftmost" if self.left_hand else "rightmost"
        if not 0 <= index < n:
            raise InputError(f"edge '{edge.getID()}' has no lane {index}; must be 0..{n - 1}, 0 {outer}")
        fit = [str(lane.getIndex()) for lane in edge.getLanes() if lane.allows(CAR)]
        if str(index) not in fit:
            its_users, lanes = users(edge.getLane(index)), " or ".join(fit)
            raise InputError(f"edge '{edge.getID()}' lane {index} is {its_users}; must be one for cars: {lanes}")


def _incomplete(net: sumolib.net.Net) -> str:
    """The part that a network lacks and SUMO, or this tool, would crash without; "" if it is complete."""
    reached = set()  # lanes inside junctions that belong to a connection
    for edge in net.getEdges():
        reached |= {link.getViaLaneID() for links in edge.getOutgoing().values() for link in links}
        for end, node in (("from", edge.getFromNode()), ("to", edge.getToNode())):
            if node is None:
                return f"edge '{edge.getID()}' does not name the junction {end} which it goes"
            if node.getType() is None:
                return f"edge '{edge.getID()}' goes {end} junction '{node.getID()}', which is missing"
        for lane in edge.getLanes():
            shape = np.array(lane.getShape() or [], dtype=float)
            no_extent = len(shape) < 2 or (edge.getFunction() != "internal" and (shape == shape[0]).all())
            if no_extent or not (np.abs(shape) <= MOST).all():
                return f"lane '{lane.getID()}' has no shape of two or more points"
    for node in net.getNodes():
        for name in filter(None, node.getInternal() if node.getType() != "internal" else ()):
            if not net.hasEdge(edge_of(name)):
                return f"junction '{node.getID()}' names lane '{name}', which is missing"
            if net.getLane(name).getEdge().getFunction() == "internal" and name not in reached:
                return f"no connection leads over lane '{name}' in junction '{node.getID()}'"
    stuck = (lane for name in sorted(reached - {""}) if not _leads_out(lane := net.getLane(name)))
    return next((f"no connection leads on from lane '{lane.getID()}', inside a junction" for lane in stuck), "")


def _leads_out(lane: Any) -> bool:
    """Whether the connections from a lane inside a junction lead out of it."""
    seen = set()
    while lane.getEdge().getFunction() == "internal":
        links = lane.getOutgoing()
        if not links or lane in seen:
            return False
        seen.add(lane)
        lane = links[0].getToLane()
    return True


def junction_of(lane_id: str) -> str:
    """The junction of a lane inside it; of another lane, something else."""
    return lane_id[1:].rsplit("_", 2)[0]


def _lines_of(edges: Iterable[Any]) -> tuple[list[Any], shapely.STRtree]:
    """Lanes of edges, and their centre lines."""
    lanes = [lane for edge in edges for lane in edge.getLanes() if is_road(lane)]
    shapes = [lane.getShape() for lane in lanes]
    of_lane = np.repeat(np.arange(len(lanes)), [len(shape) for shape in shapes])
    # All at once: of a large town there are tens of thousands.
    return lanes, shapely.STRtree(shapely.linestrings([point for shape in shapes for point in shape], indices=of_lane))


def _heading(two: Sequence[Sequence[float]]) -> float:
    """Heading from one point to another [rad]."""
    return math.atan2(two[1][1] - two[0][1], two[1][0] - two[0][0])


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)
