"""Middle lines of two-way roads, and the side of the road on which a vehicle is. Edges and lanes are sumolib's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString

from platoontraffic.road.permissions import is_road

BESIDE = (
    0.75  # largest distance from its middle that counts as on a road [road widths]; a square bend's outer corner: 0.71
)


class _Border(NamedTuple):
    """The line between the two directions of one road."""

    line: LineString
    width: float  # of the road, both directions [m]
    ends: tuple[Any, Any]  # nodes


class MiddleLines(NamedTuple):
    """Middle lines of a network; arrays of shape (lines,)."""

    lines: np.ndarray
    tree: shapely.STRtree
    length: np.ndarray  # [m]
    ring: np.ndarray  # bool: the line closes
    reach: np.ndarray  # width of the (widest part of the) road, both directions [m]
    junctions: shapely.Geometry  # of three or more arms

    @classmethod
    def of(cls, roads: Sequence[Any], left_hand: bool, areas: Mapping[str, shapely.Geometry]) -> MiddleLines:
        """Middle of every two-way road; where exactly two roads meet, their lines become one.

        roads : edges
        areas : of junctions, by id
        """
        borders, neighbours = list(_borders(roads, left_hand)), _neighbours(roads)
        pieces = [border.line for border in borders]
        lines = shapely.get_parts(shapely.line_merge(shapely.MultiLineString([*pieces, *_joints(borders, neighbours)])))
        junctions = shapely.union_all([areas[node] for node in areas if len(neighbours.get(node, ())) >= 3])
        shapely.prepare(junctions)
        shapely.prepare(lines)
        tree = shapely.STRtree(lines)
        reach = np.zeros(len(lines))
        if len(lines):
            line_of = tree.nearest(shapely.line_interpolate_point(pieces, 0.5, normalized=True))
            np.maximum.at(reach, line_of, [border.width for border in borders])
        return cls(lines, tree, shapely.length(lines), shapely.is_closed(lines), reach, junctions)

    def right_of(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray, drivable: shapely.Geometry) -> np.ndarray:
        """Distance to the right of the middle, as `Network.right_of_middle` [m], (n,)."""
        right = np.full(len(x), np.nan)
        if not len(self.lines):
            return right
        rows, k, distance = self._nearest(x, y)
        defined = distance <= BESIDE * self.reach[k]
        defined &= ~shapely.contains_xy(self.junctions, x[rows], y[rows])
        defined &= shapely.intersects_xy(drivable, x[rows], y[rows])
        rows, k, distance = rows[defined], k[defined], distance[defined]
        x, y, heading = x[rows], y[rows], heading[rows]
        along = shapely.line_locate_point(self.lines[k], shapely.points(x, y))
        road = self._chord(k, along, self.reach[k])
        sense = np.where(road[:, 0] * np.cos(heading) + road[:, 1] * np.sin(heading) < 0, -1, 1)
        foot = shapely.get_coordinates(shapely.line_interpolate_point(self.lines[k], along))
        here = self._chord(k, along, 1e-3 * self.reach[k])  # at a vertex: square to the bisector of the corner
        side = np.sign(here[:, 1] * (x - foot[:, 0]) - here[:, 0] * (y - foot[:, 1]))
        right[rows] = side * sense * distance
        return right

    def _nearest(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For points that have a line within BESIDE of the widest road: row, nearest line, distance [m]; (m,)."""
        points = shapely.points(x, y)
        # Five times as fast as the tree's `nearest`, which also has to search for lines that are far away.
        rows, k = self.tree.query(points, predicate="dwithin", distance=BESIDE * self.reach.max())
        distance = shapely.distance(self.lines[k], points[rows])
        order = np.lexsort((distance, rows))
        rows, k, distance = rows[order], k[order], distance[order]
        first = np.diff(rows, prepend=-1) > 0
        return rows[first], k[first], distance[first]

    def _chord(self, k: np.ndarray, along: np.ndarray, half: np.ndarray) -> np.ndarray:
        """Vectors from `half` before to `half` after stations `along` of lines k [m], (m, 2)."""
        length, ring = self.length[k], self.ring[k]
        ends = [np.where(ring, s % length, np.clip(s, 0, length)) for s in (along - half, along + half)]
        before, after = (shapely.get_coordinates(shapely.line_interpolate_point(self.lines[k], s)) for s in ends)
        return after - before


def _neighbours(roads: Sequence[Any]) -> dict[str, set[str]]:
    """Ids of the nodes that roads join to each node."""
    neighbours: dict[str, set[str]] = {}
    for edge in roads:
        a, b = edge.getFromNode().getID(), edge.getToNode().getID()
        neighbours.setdefault(a, set()).add(b)
        neighbours.setdefault(b, set()).add(a)
    return neighbours


def _borders(roads: Sequence[Any], left_hand: bool) -> Iterator[_Border]:
    """The border between each pair of opposite edges that lie alongside each other."""
    known = {edge.getID() for edge in roads}
    for edge in roads:
        a, b = edge.getFromNode(), edge.getToNode()
        for back in b.getOutgoing():
            if back.getToNode() is not a or back.getID() not in known or edge.getID() > back.getID():
                continue
            if back is edge.getBidi():  # one lane for both directions has no middle
                continue
            if line := _common_border(edge, back, left_hand):
                lanes = [lane for one in (edge, back) for lane in one.getLanes()]
                yield _Border(line, sum(lane.getWidth() for lane in lanes if is_road(lane)), (a, b))


def _common_border(edge: Any, back: Any, left_hand: bool) -> LineString | None:
    """The line midway between the inner borders of two opposite edges; None if they do not lie alongside."""
    inner = [[lane for lane in one.getLanes() if is_road(lane)][-1] for one in (edge, back)]
    width, side = min(lane.getWidth() for lane in inner), -0.5 if left_hand else 0.5
    left, other = (
        LineString(lane.getShape()).offset_curve(side * lane.getWidth(), join_style="mitre") for lane in inner
    )
    if left.geom_type != "LineString" or other.geom_type != "LineString" or left.is_empty or other.is_empty:
        return None
    if left.interpolate(0.5, normalized=True).distance(other) > width:
        return None
    points = shapely.points(left.coords)
    facing = shapely.line_interpolate_point(other, shapely.line_locate_point(other, points))
    return LineString((shapely.get_coordinates(points) + shapely.get_coordinates(facing)) / 2)


def _joints(borders: Sequence[_Border], neighbours: Mapping[str, set[str]]) -> list[LineString]:
    """Pieces that join the borders of two roads at their common node, and prolong those of dead ends."""
    arms: dict[str, list[np.ndarray]] = {}  # by node: last and last but one point of the borders that end there
    nodes = {}
    for border in borders:
        points = np.array(border.line.coords)
        for node, end in zip(border.ends, (points[:2], points[:-3:-1]), strict=True):
            arms.setdefault(node.getID(), []).append(end)
            nodes[node.getID()] = node
    joints = []
    for name, ends in arms.items():
        if len(neighbours[name]) == 2 and len(ends) == 2:
            joints.append(_joint(*ends))
        elif len(neighbours[name]) == 1 and len(ends) == 1:
            joints.append(_up_to(ends[0], nodes[name].getCoord()))
    return [joint for joint in joints if joint]


def _joint(one: np.ndarray, other: np.ndarray) -> LineString | None:
    """From the end of one line to that of another, by the point where both, prolonged, meet.

    one, other : last and last but one point (2, 2)
    """
    p, q = one[0], other[0]
    if np.array_equal(p, q):
        return None
    u, v = p - one[1], q - other[1]
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) > 0.05 * np.hypot(*u) * np.hypot(*v):
        gap = q - p
        s = (gap[0] * v[1] - gap[1] * v[0]) / cross
        t = (gap[0] * u[1] - gap[1] * u[0]) / cross
        if s > 0 and t > 0 and max(s * np.hypot(*u), t * np.hypot(*v)) < 2 * np.hypot(*gap):
            return LineString([p, p + s * u, q])
    return LineString([p, q])


def _up_to(end: np.ndarray, node: tuple[float, float]) -> LineString | None:
    """The continuation of a line to beside the node where its road ends."""
    ahead = (end[0] - end[1]) / np.hypot(*(end[0] - end[1]))
    missing = float(ahead @ (np.array(node) - end[0]))
    return LineString([end[0], end[0] + missing * ahead]) if missing > 1e-6 else None
