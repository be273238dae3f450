"""The road network: its shape, its lanes, routes through it. The only importer of sumolib."""

from __future__ import annotations

import gzip
import math
import os
import re
import subprocess
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.parsers import expat

import numpy as np
import shapely
from shapely.geometry import LinearRing, LineString, Point, Polygon

from lidar import kerbs
from platoontraffic.errors import InputError, did_you_mean

if TYPE_CHECKING:
    import sumolib.net

CACHED_LANES = 100  # fewer are put together in some 15 ms, which is not worth a file in the user's home
NETWORK = "a SUMO network (.net.xml)"
OTHER_ROOTS = {
    "nodes": "a plain node file",
    "edges": "a plain edge file",
    "connections": "a plain connection file",
    "additional": "an additional file",
    "routes": "a route file",
    "configuration": "a configuration",
    "sumoConfiguration": "a SUMO configuration, which names a network",
    "neteditConfiguration": "a netedit configuration, which names a network",
    "netconvertConfiguration": "a netconvert configuration, which builds a network",
}


class Shape(NamedTuple):
    """A wall or a solid obstacle that stands in the world."""

    id: str
    kind: str  # "wall": a line; "obstacle": solid, and so are buildings
    coordinates: np.ndarray  # (k, 2) [m]
    filled: bool


def check_net_file(path: str | Path) -> None:
    """Raise InputError unless the file is a whole network: some broken ones kill SUMO and the process with it."""
    root, road, lanes = "", False, False

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal root, road, lanes
        if not root:
            root = tag
            if tag != "net":
                kind = OTHER_ROOTS.get(tag, "another kind of file")
                raise _fault(path, parser, f"root element is <{tag}>, {kind}; must be <net>, {NETWORK}")
            if not attributes.get("version"):
                raise _fault(path, parser, f"<net> has no version; must be {NETWORK} as netconvert writes it")
        elif tag == "edge":
            road = attributes.get("function", "normal") == "normal"
        elif tag == "lane" and road:
            lanes = True
            parser.StartElementHandler = None  # the rest need only be well-formed

    last = _parse(path, start, f"must be {NETWORK}")
    if not lanes:
        raise InputError(f"{path}:{last}: the network has no road; must have at least one edge with a lane")


def read_polygons(path: str | Path) -> list[Shape]:
    """Walls (type `wall`) and solid shapes (type `obstacle` or `building…`) of a .poly.xml; others are for the eye."""
    shapes: list[Shape] = []

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        kind = attributes.get("type", "")
        if kind.startswith("building"):
            kind = "obstacle"
        if tag != "poly" or kind not in ("wall", "obstacle"):
            return
        name = attributes.get("id", "")
        if attributes.get("geo", "0") in ("1", "true", "yes"):
            raise _fault(path, parser, f"poly '{name}': geo coordinates; must be coordinates of the network [m]")
        try:
            points = [tuple(map(float, point.split(",")))[:2] for point in attributes.get("shape", "").split()]
            coordinates = np.array(points, dtype=float).reshape(-1, 2)
        except ValueError:
            coordinates = np.full((1, 2), np.nan)
        least = 2 if kind == "wall" else 3
        if len(coordinates) < least or not np.isfinite(coordinates).all():
            shape = attributes.get("shape", "")
            raise _fault(path, parser, f"poly '{name}': shape \"{shape:.40}\"; must be {least} or more points x,y")
        shapes.append(Shape(name, kind, coordinates, attributes.get("fill", "0") in ("1", "true", "yes")))

    _parse(path, start, "must be an additional file with polygons (.poly.xml)")
    return shapes


class Configuration(NamedTuple):
    """What a SUMO configuration names, with whole paths; and the options by which it asks for output files."""

    path: Path
    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    outputs: Mapping[str, str]  # option -> file name, as written


def read_configuration(path: str | Path) -> Configuration:
    """The input files of a .sumocfg.

    raises: InputError where it, or a file that it names, is not there
    """
    path = Path(path)
    wanted = "must be a SUMO configuration (.sumocfg)"
    files: dict[str, list[Path]] = {"net-file": [], "route-files": [], "additional-files": []}
    short = {"net": "net-file", "n": "net-file", "routes": "route-files", "r": "route-files"}
    short |= {"additional": "additional-files", "a": "additional-files"}
    outputs: dict[str, str] = {}
    faults: list[str] = []
    root = ""

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal root
        root = root or tag
        if root not in ("configuration", "sumoConfiguration"):
            kind = OTHER_ROOTS.get(tag, "another kind of file")
            raise _fault(path, parser, f"root element is <{tag}>, {kind}; {wanted}")
        value = attributes.get("value", attributes.get("v", ""))
        option = short.get(tag, tag)
        if option in files:
            for name in filter(None, re.split(r"[,\s]+", value)):
                files[option].append(path.parent / name)
                if not files[option][-1].is_file():
                    faults.append(f"{path}:{parser.CurrentLineNumber}: <{tag}>: {name!r}: no such file")
        elif value and (tag.endswith("-output") or tag in ("log", "message-log", "error-log")):
            outputs[tag] = value

    last = _parse(path, start, wanted)
    if len(files["net-file"]) != 1:
        faults.append(f"{path}:{last}: names {len(files['net-file'])} networks; must name one, as <net-file>")
    if faults:
        raise InputError(*faults)
    routes, additional = (tuple(files[option]) for option in ("route-files", "additional-files"))
    return Configuration(path, files["net-file"][0], routes, additional, outputs)


def writes_files(path: Path) -> bool:
    """Whether an additional file has detectors, or others, that write into files beside it."""
    found = False

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal found
        found |= "file" in attributes

    _parse(path, start, "must be an additional file")
    return found


def build_net(config: str | Path, output: str | Path) -> None:
    """Run netconvert on a .netccfg. Equal sources give equal bytes: the header with date and paths is left out."""
    import sumo  # from eclipse-sumo, of the extra `gui`

    config, output = Path(config), Path(output)
    netconvert = Path(sumo.SUMO_HOME, "bin", "netconvert")
    done = subprocess.run(
        [netconvert, "-c", config.name, "-o", output.resolve()],
        cwd=config.parent,
        env={**os.environ, "SUMO_HOME": sumo.SUMO_HOME},
        capture_output=True,
        text=True,
    )
    if done.returncode:
        faults = re.findall(r"^Error: *(.+)$", done.stderr, re.MULTILINE) or [done.stderr.strip()]
        raise InputError(*(f"{config}: netconvert: {fault}" for fault in faults))
    text = output.read_text(encoding="utf-8")
    output.write_text(re.sub(r"<!-- generated on .*?-->\s*", "", text, count=1, flags=re.DOTALL), encoding="utf-8")


@dataclass(frozen=True, eq=False)
class Network:
    """A network that SUMO can load; x east, y north, headings counter-clockwise from east [rad]."""

    path: Path
    _net: sumolib.net.Net

    @classmethod
    def read(cls, path: str | Path) -> Network:
        """Check the file, then read it."""
        import sumolib.net  # 0.1 s, not for those who only check a file

        check_net_file(path)
        try:
            # Internal lanes are needed for routes; who must wait for whom is not.
            net = sumolib.net.readNet(str(path), withInternal=True, withFoes=False)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: something is missing ({error!r}); must be as netconvert writes it") from error
        if fault := _incomplete(net):
            raise InputError(f"{path}: {fault}; must be as netconvert writes it")
        return cls(Path(path), net)

    @cached_property
    def edges(self) -> Mapping[str, tuple[float, ...]]:
        """Lengths [m] of every road edge's lanes, rightmost first."""
        return {edge.getID(): tuple(lane.getLength() for lane in edge.getLanes()) for edge in self._roads}

    @cached_property
    def drivable(self) -> shapely.Geometry:
        """The area of all lanes and junctions: a polygon, or several where the network has parts."""
        lanes = [lane for edge in self._roads for lane in edge.getLanes()]
        shapes, widths = [lane.getShape() for lane in lanes], [lane.getWidth() for lane in lanes]
        cache = None
        if len(lanes) >= CACHED_LANES:
            import platformdirs

            cache = platformdirs.user_cache_path("platoontraffic")
        area = kerbs.drivable(shapes, widths, self._junction_areas().values(), cache)
        shapely.prepare(area)
        return area

    def outline(self, tolerance: float = 0.0) -> list[LinearRing]:
        """The borders of the drivable area, exact or within a tolerance [m]: the walls of a world that has walls."""
        return kerbs.borders(self.drivable, tolerance)

    @cached_property
    def widest_lane(self) -> float:
        """Its width [m]: tells the streets of cars from the paths of robots."""
        return max(lane.getWidth() for edge in self._roads for lane in edge.getLanes())

    def lane_pose(self, edge_id: str, lane_index: int = 0, position: float = 0.0) -> tuple[float, float, float]:
        """x, y [m] and heading [rad] on a lane's centre line, `position` [m] after its start."""
        lengths = self.edges[self._known(edge_id)]
        if not 0 <= lane_index < len(lengths):
            raise InputError(f"edge '{edge_id}' has no lane {lane_index}; must be 0..{len(lengths) - 1}, 0 rightmost")
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
        """The lane centre line along a route, across its junctions; a closed one ends where it starts. (k, 2) [m]

        lane: on the first edge. Where it does not lead on, the line crosses over to the nearest one that does.
        """
        if not edges:
            raise InputError("the route is empty; must name one or more edges")
        road = [self._net.getEdge(self._known(edge)) for edge in edges]
        if not 0 <= lane < road[0].getLaneNumber():
            raise InputError(f"edge '{edges[0]}' has no lane {lane}; must be 0..{road[0].getLaneNumber() - 1}")
        first, parts = lane, []
        for here, there in pairwise([*road, road[0]] if closed else road):
            link = min(self._links(here, there), key=lambda link: abs(link.getFromLane().getIndex() - lane))
            parts += [_crossing_over(here.getLane(lane), link.getFromLane()), *self._across(link)]
            lane = link.getToLane().getIndex()
        if not closed:
            parts.append(np.array(road[-1].getLane(lane).getShape()))
        elif lane != first:
            raise InputError(
                f"the route comes back to '{edges[0]}' in lane {lane}, not {first}; start it in lane {lane}"
            )
        else:
            parts.append(parts[0][:1])
        line = np.concatenate(parts)
        new = np.hypot(*np.diff(line, axis=0).T) > 1e-6
        return line[np.concatenate([[True], new])]

    def fastest_way(self, start: str, end: str) -> list[str]:
        """The edges from one to another that take the least time at the limits of speed."""
        a, b = (self._net.getEdge(self._known(edge)) for edge in (start, end))
        way, _ = self._net.getOptimalPath(a, b, fastest=True)
        if way is None:
            raise InputError(f"no way from edge '{start}' to '{end}'")
        return [edge.getID() for edge in way]

    def onward(self, edge_id: str, n: int = 2) -> tuple[str, ...]:
        """The edge and those met by driving on as straight as can be; n edges, fewer where the road ends."""
        way = [self._net.getEdge(self._known(edge_id))]
        while len(way) < n and (choices := way[-1].getOutgoing()):
            arriving = _heading(way[-1].getLane(0).getShape()[-2:])
            turns = {edge: abs(_wrapped(_heading(edge.getLane(0).getShape()[:2]) - arriving)) for edge in choices}
            way.append(min(turns, key=lambda edge: (turns[edge], edge.getID())))
        return tuple(edge.getID() for edge in way)

    def middle_lines(self) -> list[LineString]:
        """Where the two directions of a road meet, continued round corners up to junctions of three or more arms."""
        return list(self._middles.lines)

    def right_of_middle(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Distance [m] to the right of the road's middle, seen along each heading; left is negative. (n,)

        NaN inside junctions of three or more arms, on one-way roads and off the road. Which way along the road a
        heading points is judged over the stretch of road about it, so that a vehicle may turn on the spot in a corner.
        """
        middles = self._middles
        x, y, heading = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (x, y, heading))
        if not len(middles.lines):
            return np.full(len(x), np.nan)
        points = shapely.points(x, y)
        k = middles.tree.nearest(points)
        lines, reach = middles.lines[k], middles.reach[k]
        along, distance = shapely.line_locate_point(lines, points), shapely.distance(lines, points)

        def chord(half: np.ndarray | float) -> np.ndarray:
            length, ring = middles.length[k], middles.ring[k]
            ends = [np.where(ring, s % length, np.clip(s, 0, length)) for s in (along - half, along + half)]
            before, after = (shapely.get_coordinates(shapely.line_interpolate_point(lines, s)) for s in ends)
            return after - before

        road = chord(reach)
        sense = np.where(road[:, 0] * np.cos(heading) + road[:, 1] * np.sin(heading) < 0, -1, 1)
        foot = shapely.get_coordinates(shapely.line_interpolate_point(lines, along))
        here = chord(1e-3 * reach)  # at a vertex this is square to the bisector of the corner
        side = np.sign(here[:, 1] * (x - foot[:, 0]) - here[:, 0] * (y - foot[:, 1]))
        undefined = (
            (distance > 0.75 * reach)  # the outer corner of a square bend is 0.71 road widths from the middle
            | shapely.contains_xy(middles.junctions, x, y)
            | ~shapely.intersects_xy(self.drivable, x, y)
        )
        return np.where(undefined, np.nan, side * sense * distance)

    @cached_property
    def _roads(self) -> list[sumolib.net.edge.Edge]:
        return [edge for edge in self._net.getEdges(withInternal=False) if edge.getLaneNumber()]

    def _junction_areas(self) -> dict[str, shapely.Geometry]:
        """Junctions that have an area; dead ends have none, and shapes may cross themselves."""
        shapes = {node.getID(): node.getShape() for node in self._net.getNodes() if node.getType() != "internal"}
        return {node: Polygon(shape).buffer(0) for node, shape in shapes.items() if len(shape) >= 3}

    @cached_property
    def _middles(self) -> _Middles:
        """Middle of every two-way road; where exactly two roads meet, theirs become one line."""
        pieces: list[LineString] = []
        widths: list[float] = []
        neighbours: dict[str, set[str]] = {}
        ends: dict[str, list[np.ndarray]] = {}  # by node: last and last but one point of the lines that end there
        for edge in self._roads:
            a, b = edge.getFromNode(), edge.getToNode()
            neighbours.setdefault(a.getID(), set()).add(b.getID())
            neighbours.setdefault(b.getID(), set()).add(a.getID())
            for back in b.getOutgoing():
                if back.getToNode() is a and edge.getID() < back.getID() and (line := _common_border(edge, back)):
                    points = np.array(line.coords)
                    pieces.append(line)
                    widths.append(sum(lane.getWidth() for one in (edge, back) for lane in one.getLanes()))
                    ends.setdefault(a.getID(), []).append(points[:2])
                    ends.setdefault(b.getID(), []).append(points[:-3:-1])

        joints = []
        for node, arms in ends.items():
            if len(neighbours[node]) == 2 and len(arms) == 2:
                joints.append(_joint(*arms))
            elif len(neighbours[node]) == 1 and len(arms) == 1:
                joints.append(_up_to(arms[0], self._net.getNode(node).getCoord()))
        merged = shapely.line_merge(shapely.MultiLineString([*pieces, *filter(None, joints)]))
        lines = shapely.get_parts(merged)

        areas = self._junction_areas()
        junctions = shapely.union_all([areas[node] for node in areas if len(neighbours.get(node, ())) >= 3])
        shapely.prepare(junctions)
        shapely.prepare(lines)
        tree = shapely.STRtree(lines)
        reach = np.zeros(len(lines))
        if len(lines):
            np.maximum.at(reach, tree.nearest(shapely.line_interpolate_point(pieces, 0.5, normalized=True)), widths)
        return _Middles(lines, tree, shapely.length(lines), shapely.is_closed(lines), reach, junctions)

    def _known(self, edge_id: str) -> str:
        if edge_id not in self.edges:
            raise InputError(f"no edge '{edge_id}' in {self.path.name}{did_you_mean(edge_id, self.edges)}")
        return edge_id

    def _links(self, here: Any, there: Any) -> list[Any]:
        links = here.getConnections(there)
        if not links:
            ways = ", ".join(sorted(edge.getID() for edge in here.getOutgoing())) or "nothing, the road ends"
            raise InputError(f"no way from edge '{here.getID()}' to '{there.getID()}'; it leads to: {ways}")
        return links

    def _across(self, link: Any) -> list[np.ndarray]:
        """Centre lines of the lanes inside the junction: one, or several in a chain where vehicles wait midway."""
        parts = []
        while via := link.getViaLaneID():
            inside = self._net.getLane(via)
            parts.append(np.array(inside.getShape()))
            link = inside.getOutgoing()[0]
        return parts


def _incomplete(net: sumolib.net.Net) -> str:
    """What is missing of a network that was read but would crash SUMO, or what follows here; "" if nothing is."""
    reached = set()  # lanes inside junctions that a connection leads over
    for edge in net.getEdges():
        reached |= {link.getViaLaneID() for links in edge.getOutgoing().values() for link in links}
        for end, node in (("from", edge.getFromNode()), ("to", edge.getToNode())):
            if node.getType() is None:
                return f"edge '{edge.getID()}' goes {end} junction '{node.getID()}', which is not there"
        for lane in edge.getLanes():
            shape = np.array(lane.getShape() or [], dtype=float)
            if len(shape) < 2 or not np.isfinite(shape).all():
                return f"lane '{lane.getID()}' has no shape of two or more points"
    for node in net.getNodes():
        for name in filter(None, node.getInternal() if node.getType() != "internal" else ()):
            if not net.hasEdge(name.rpartition("_")[0]):
                return f"junction '{node.getID()}' names lane '{name}', which is not there"
            if net.getLane(name).getEdge().getFunction() == "internal" and name not in reached:
                return f"no connection leads over lane '{name}' in junction '{node.getID()}'"
    return ""


class _Middles(NamedTuple):
    """Middle lines and what is asked of them; arrays of shape (lines,)."""

    lines: np.ndarray
    tree: shapely.STRtree
    length: np.ndarray  # [m]
    ring: np.ndarray  # bool: the line closes
    reach: np.ndarray  # [m] width of the (widest part of the) road, both directions
    junctions: shapely.Geometry  # of three or more arms


def _common_border(edge: Any, back: Any) -> LineString | None:
    """The line midway between the inner borders of two opposite edges; None if they do not lie alongside."""
    width = min(one.getLanes()[-1].getWidth() for one in (edge, back))
    left, other = (
        LineString(lane.getShape()).offset_curve(lane.getWidth() / 2, join_style="mitre")
        for lane in (edge.getLanes()[-1], back.getLanes()[-1])
    )
    if left.geom_type != "LineString" or other.geom_type != "LineString" or left.is_empty or other.is_empty:
        return None
    if left.interpolate(0.5, normalized=True).distance(other) > width:
        return None
    points = shapely.points(left.coords)
    facing = shapely.line_interpolate_point(other, shapely.line_locate_point(other, points))
    return LineString((shapely.get_coordinates(points) + shapely.get_coordinates(facing)) / 2)


def _joint(one: np.ndarray, other: np.ndarray) -> LineString | None:
    """From the end of a line to that of another, by way of where both, prolonged, meet; ends: (last, last but one)."""
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
    """A line's continuation to beside the node where its road ends."""
    ahead = (end[0] - end[1]) / np.hypot(*(end[0] - end[1]))
    missing = float(ahead @ (np.array(node) - end[0]))
    return LineString([end[0], end[0] + missing * ahead]) if missing > 1e-6 else None


def _crossing_over(lane: Any, other: Any) -> np.ndarray:
    """A line that starts on a lane and ends on a lane of the same edge."""
    if lane is other:
        return np.array(lane.getShape())
    lines = [LineString(lane.getShape()), LineString(other.getShape())]
    share = np.unique([line.project(Point(p), normalized=True) for line in lines for p in line.coords])
    points = shapely.line_interpolate_point(np.array(lines)[:, None], share, normalized=True)
    begun, ended = shapely.get_coordinates(points).reshape(2, -1, 2)
    return begun + share[:, None] * (ended - begun)


def _heading(two: Sequence[Sequence[float]]) -> float:
    return math.atan2(two[1][1] - two[0][1], two[1][0] - two[0][0])


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)


def _fault(path: str | Path, parser: expat.XMLParserType, words: str) -> InputError:
    return InputError(f"{path}:{parser.CurrentLineNumber}: {words}")


def _parse(path: str | Path, start: Callable[[str, dict[str, str], expat.XMLParserType], None], wanted: str) -> int:
    """Read a plain or gzipped XML file to its end; the number of its last line. `start` sees every element."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder; {wanted}")
    if not path.is_file():
        raise InputError(f"{path}: no such file; {wanted}")
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: start(tag, attributes, parser)
    try:
        with path.open("rb") as file:
            magic = file.read(2)
        if not magic:
            raise InputError(f"{path}:1: the file is empty; {wanted}")
        with gzip.open(path) if magic == b"\x1f\x8b" else path.open("rb") as file:
            parser.ParseFile(file)
    except expat.ExpatError as error:
        early = error.code == expat.errors.codes[expat.errors.XML_ERROR_NO_ELEMENTS]
        words = "it ends too early" if early else expat.ErrorString(error.code)
        raise InputError(f"{path}:{error.lineno}: not whole XML ({words}); {wanted}") from None
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{path}:{parser.CurrentLineNumber}: cannot be read ({error}); {wanted}") from None
    return parser.CurrentLineNumber
