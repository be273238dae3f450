"""The road network: its shape, its lanes, routes through it. The only importer of sumolib."""

from __future__ import annotations

import gzip
import heapq
import math
import os
import re
import subprocess
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.parsers import expat

import numpy as np
import shapely
from shapely.geometry import LinearRing, LineString, Point, Polygon

from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.lidar import kerbs

if TYPE_CHECKING:
    import sumolib.net

CACHED_LANES = 100  # fewer are put together in some 15 ms, which is not worth a file in the user's home
BESIDE = 0.75  # so far from its middle one is on a road, in its widths: a square bend's outer corner is at 0.71
NETWORK = "a SUMO network (.net.xml)"
CHANGING = "change"
CHANGE_AFTER = 5.0  # a route changes lanes so far after an edge's begin, in lane widths: 16 m in streets
CHANGE = 12.0  # length of that, per lane, in the same: 38 m, 3 s at 13 m/s
CAR = "passenger"  # SUMO's class of vehicles that members are
TURNS_BACK = "tT"  # directions of links on which one comes back on the same road; T where one keeps left
ROUND = 3600.0  # so much longer may a way be that does not [s]
NO_ROAD = frozenset(
    ("pedestrian", "wheelchair", "tram", "rail_urban", "rail", "rail_electric", "rail_fast", "lightrail", "cityrail",
     "rail_slow", "subway", "cable_car", "ship", "container", "aircraft", "drone")
)  # fmt: skip
OTHER_ROOTS = {
    "net": "a network",
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


class Line(NamedTuple):
    """Where a lane ends at a junction, and who goes first there; or where the route begins to change lanes."""

    station: float  # on the route [m]
    state: str  # as SUMO's: M and G go first, m, s and w give way; or CHANGING
    light: str  # that rules it; "" if none does
    index: int  # of this way across among that light's
    lane: str
    onto: str  # lane beyond the junction, or beside
    via: tuple[str, ...]  # lanes inside it: two or more where one may have to wait midway
    across: float  # their length, or that of the change of lanes [m]
    to_end: float = 0.0  # from where a change begins to the lane's end [m]


class Shape(NamedTuple):
    """A wall or a solid obstacle that stands in the world."""

    id: str
    kind: str  # "wall": a line; "obstacle": solid, and so are buildings
    coordinates: np.ndarray  # (k, 2) [m]
    filled: bool


def check_net_file(path: str | Path) -> bool:
    """Raise InputError unless the file is a whole network: some broken ones kill SUMO and the process with it.

    returns: whether its traffic keeps to the left
    """
    root, road, lanes, left_hand = "", False, False, False

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal root, road, lanes, left_hand
        if not root:
            root, left_hand = tag, attributes.get("lefthand") in ("true", "1")
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
    return left_hand


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
    """What a SUMO configuration says, with whole paths."""

    path: Path
    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    inputs: tuple[Path, ...] = ()  # further files: of weights, a state to begin with
    options: Mapping[str, str] = MappingProxyType({})  # what else SUMO is to be told
    outputs: Mapping[str, str] = MappingProxyType({})  # option by which it asks for an output -> file name, as written
    ignored: tuple[str, ...] = ()  # options of sumo-gui, those that are set here, and those that cannot be honoured
    begin: float = 0.0  # [s]
    end: float | None = None
    step: float | None = None


# Options under another name, as far as it matters here which they are.
SYNONYMS = {
    "n": "net-file", "net": "net-file", "r": "route-files", "routes": "route-files",
    "a": "additional-files", "additional": "additional-files", "w": "weight-files", "weights": "weight-files",
    "b": "begin", "e": "end", "srand": "seed", "abs-rand": "random", "no-duration-log": "duration-log.disable",
    "H": "human-readable-time", "v": "verbose", "c": "configuration-file", "configuration": "configuration-file",
    "C": "save-configuration", "t": "duration-log.statistics", "l": "log", "log-file": "log",
    "ndump": "netstate-dump", "netstate": "netstate-dump", "netstate-output": "netstate-dump",
    "summary": "summary-output", "tripinfo": "tripinfo-output", "vehroutes": "vehroute-output",
    "person-fcd": "person-fcd-output", "personinfo": "personinfo-output", "personroutes": "personroute-output",
    "statistics-output": "statistic-output", "device.fcd-replay.file": "device.fcd-replay.files",
    "sumo-net-file": "net-file",
}  # fmt: skip
INPUTS = {
    "net-file", "route-files", "additional-files", "weight-files", "load-state", "astar.all-distances",
    "astar.landmark-distances", "device.fcd-replay.files", "device.ssm.filter-edges.input-file",
    "fcd-output.filter-edges.input-file", "pedestrian.jupedsim.wkt",
}  # fmt: skip
OUTPUT = re.compile(r".*[-.]output|(message-|error-)?log|netstate-dump|device\.(ssm|toc)\.file")
IGNORED = re.compile(
    r"step-length|seed|random|precision|time-to-teleport.*|collision\.(?!check-junctions\.mingap).*|no-step-log"
    r"|step-log\..*|duration-log\..*|emergencydecel\.warning-threshold"  # are set here, or follow from that
    r"|remote-port|num-clients|configuration-file|save-.*|output[-.].*|human-readable-time|vtk-output|print-options"
    r"|verbose|help|version|language"  # would wait for others, write beside the input, or change what is read back
    r"|gui-.*|quit-on-end|game.*|start|delay|breakpoints|edgedata-files|alternative-net-file|selection-file|demo"
    r"|disable-textures|registry-viewport|window-.*|tracker-interval|osg-view|[gQGSdDTBmN]"  # of sumo-gui
)
NOWHERE = ("NUL", "/dev/null")  # output files that SUMO does not write


def read_configuration(path: str | Path) -> Configuration:
    """What a .sumocfg, or a .netecfg of netedit, has SUMO do.

    raises: InputError where it, or a file that it names, is not there, or it asks for what there is not
    """
    path = Path(path)
    wanted = "must be a SUMO configuration (.sumocfg), or one of netedit (.netecfg)"
    given: dict[str, tuple[str, int]] = {}  # option -> value and line
    faults: list[str] = []
    ignored: list[str] = []
    root = section = ""

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal root, section
        root = root or tag
        if root not in ("configuration", "sumoConfiguration", "neteditConfiguration"):
            kind = OTHER_ROOTS.get(tag, "another kind of file")
            raise _fault(path, parser, f"root element is <{tag}>, {kind}; {wanted}")
        value = attributes.get("value", attributes.get("v"))
        option = SYNONYMS.get(tag, tag)
        if value is None:
            section = tag
        elif section == "gui_only" or IGNORED.fullmatch(option):
            ignored.append(tag)
            if option == "step-length":
                given[option] = value, parser.CurrentLineNumber
        elif option == "net-file" and option in given:
            faults.append(f"{path}:{parser.CurrentLineNumber}: <{tag}>: a second network; must name one")
        elif value:
            given[option] = _environment(value), parser.CurrentLineNumber

    last = _parse(path, start, wanted)
    if root == "neteditConfiguration":  # of netedit's own options SUMO knows none
        if "sumocfg-file" in given:
            inner = read_configuration(path.parent / given["sumocfg-file"][0])
            return inner._replace(path=path, inputs=(*inner.inputs, inner.path))
        given = {o: given[o] for o in ("net-file", "route-files", "additional-files") if o in given}
        ignored = []
    files: dict[str, tuple[Path, ...]] = {}
    for option in INPUTS & given.keys():
        value, line = given.pop(option)
        files[option] = tuple(path.parent / name.strip() for name in value.split(","))
        missing = [file for file in files[option] if not file.is_file()]
        faults += [f"{path}:{line}: <{option}>: '{os.path.relpath(f, path.parent)}': no such file" for f in missing]
    if "net-file" not in files:
        faults.append(f"{path}:{last}: names no network; must name one, as <net-file>")
    elif len(files["net-file"]) > 1:
        faults.append(f"{path}:{last}: names {len(files['net-file'])} networks; must name one, as <net-file>")
    times: dict[str, float] = {}
    for option in {"begin", "end", "step-length"} & given.keys():
        value, line = given[option]
        try:
            times[option] = _seconds(value)
        except ValueError:
            faults.append(f"{path}:{line}: <{option}>: '{value}'; must be a time: seconds, or hours:minutes:seconds")
    if given.get("mesosim", ("", 0))[0].lower() in ("true", "1", "yes", "on", "x", "t"):
        faults.append(f"{path}:{given['mesosim'][1]}: <mesosim>: the mesoscopic model has no lanes; must be off")
    if faults:
        raise InputError(*faults)
    given.pop("step-length", None)
    main = [files.pop(option, ()) for option in ("net-file", "route-files", "additional-files")]
    options = {option: ",".join(str(file.resolve()) for file in files[option]) for option in sorted(files)}
    options |= {option: value for option, (value, _) in given.items() if not OUTPUT.fullmatch(option)}
    outputs = {o: value for o, (value, _) in given.items() if OUTPUT.fullmatch(o) and value not in NOWHERE}
    return Configuration(
        path, main[0][0], main[1], main[2],
        inputs=tuple(file for option in sorted(files) for file in files[option]),
        options=options,
        outputs=outputs,
        ignored=tuple(ignored),
        begin=max(times.get("begin", 0.0), 0.0),
        end=times["end"] if times.get("end", -1) >= 0 else None,
        step=times.get("step-length"),
    )  # fmt: skip


class Named(NamedTuple):
    """A file that an input of SUMO names."""

    element: str
    attribute: str
    name: str
    written: bool  # by SUMO, which reads the others


WRITTEN_TO = {"timedEvent": "dest", "calibrator": "output"}  # elsewhere the attribute is `file`
READ = {"rerouter": "file", "variableSpeedSign": "file", "calibrator": "file", "include": "href"}
PARAMETERS = ("device.ssm.file", "device.toc.file", "file")  # `file` is of traffic lights with detectors


def file_named_in(element: str, attributes: Mapping[str, str]) -> Named | None:
    """The file that an element of a network, of routes or of additional things has SUMO write, or read."""
    if element == "param":
        attribute, written = "value", attributes.get("key") in PARAMETERS
        if not written:
            return None
    else:
        attribute, written = WRITTEN_TO.get(element, "file"), True
        if READ.get(element, "") in attributes:
            attribute, written = READ[element], False
    name = attributes.get(attribute, "")
    return Named(element, attribute, name, written) if name and name not in NOWHERE else None


def names_files(path: Path) -> bool:
    """Whether a file names some that SUMO writes, beside it or elsewhere, or includes others."""
    found = False

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal found
        if file_named_in(tag, attributes):
            found = True
            parser.StartElementHandler = None

    _parse(path, start, "must be a file that SUMO can read")
    return found


def id_clashes(path: Path, ids: Collection[str]) -> list[tuple[str, str]]:
    """(id, `file:line: what`) for every vehicle of a route file that would have one of these ids.

    A flow numbers its vehicles: those of flow `x` are `x.0`, `x.1` and so on.
    """
    clashes: list[tuple[str, str]] = []
    by_flow = {name.rpartition(".")[0]: name for name in sorted(ids, reverse=True)}

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        name = attributes.get("id", "")
        made = by_flow.get(name) if tag in ("flow", "calibrator") else name if tag in ("vehicle", "trip") else None
        if made in ids:
            what = f"{tag} '{name}' is, or makes, '{made}'"
            clashes.append((made, f"{path}:{parser.CurrentLineNumber}: {what}"))

    _parse(path, start, "must be a route file or an additional file of SUMO")
    return clashes


def _is_road(lane: Any) -> bool:
    return not NO_ROAD.issuperset(lane.getPermissions())


def _users(lane_or_edge: Any) -> str:
    """`for bus, taxi`: whom a lane, or an edge, allows."""
    allowed = sorted(lane_or_edge.getPermissions())
    return f"for {', '.join(allowed[:3])}{' and others' if len(allowed) > 3 else ''}" if allowed else "closed to all"


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
    left_hand: bool = False  # traffic keeps to the left

    @classmethod
    def read(cls, path: str | Path) -> Network:
        """Check the file, then read it."""
        import sumolib.net  # 0.1 s, not for those who only check a file

        left_hand = check_net_file(path)
        try:
            # Internal lanes are needed for routes; who must wait for whom is not.
            net = sumolib.net.readNet(str(path), withInternal=True, withFoes=False)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: something is missing ({error!r}); must be as netconvert writes it") from error
        if fault := _incomplete(net):
            raise InputError(f"{path}: {fault}; must be as netconvert writes it")
        return cls(Path(path), net, left_hand)

    @cached_property
    def edges(self) -> Mapping[str, tuple[float, ...]]:
        """Lengths [m] of every road edge's lanes, rightmost first; with left-hand traffic, leftmost."""
        return {edge.getID(): tuple(lane.getLength() for lane in edge.getLanes()) for edge in self._roads}

    @cached_property
    def drivable(self) -> shapely.Geometry:
        """The area of all lanes and junctions: a polygon, or several where the network has parts."""
        lanes = [lane for edge in self._roads for lane in edge.getLanes() if _is_road(lane)]
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
        return max((lane.getWidth() for edge in self._roads for lane in edge.getLanes()), default=0.0)

    def limit(self, edge_id: str, lane_index: int = 0) -> float:
        """Of speed on a lane [m/s]."""
        return self._net.getEdge(self._known(edge_id)).getLane(lane_index).getSpeed()

    def lane_width(self, edge_id: str, lane_index: int = 0) -> float:
        """[m]"""
        return self._net.getEdge(self._known(edge_id)).getLane(lane_index).getWidth()

    def lane_pose(self, edge_id: str, lane_index: int = 0, position: float = 0.0) -> tuple[float, float, float]:
        """x, y [m] and heading [rad] on a lane's centre line, `position` [m] after its start."""
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
        self, edges: Sequence[str], lane: int = 0, closed: bool = False, position: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray, list[Line]]:
        """The lane centre line along a route, across its junctions; a closed one ends where it starts. (k, 2) [m]

        Then the limit of speed from each of its points on, (k,) [m/s], and the lines at which one stops on the way.

        lane     : on the first edge; it is changed as seldom as the route lets it, each time at an edge's begin
        position : on the first edge, whence one drives [m]
        """
        if not edges:
            raise InputError("the route is empty; must name one or more edges")
        road = [self._net.getEdge(self._known(edge)) for edge in edges]
        for edge in road:
            self._check_edge(edge)
        self._check_lane(road[0], lane)
        first, parts, limits, lines = lane, [], [], []
        on = [*road, road[0]] if closed else road
        for here, link in zip(on, self._least_changes(on, lane, lane if closed else None), strict=False):
            across = self._across(link)
            way, before, change = _crossing_over(here.getLane(lane), link.getFromLane(), 0.0 if parts else position)
            if lane != link.getFromLane().getIndex():
                begins = sum(_length(part) for part in parts) + before
                sides = here.getLane(lane).getID(), link.getFromLane().getID()
                lines.append(Line(begins, CHANGING, "", 0, *sides, (), change, _length(way) - before))
            parts.append(way)
            station = sum(_length(part) for part in parts)
            ends = link.getFromLane().getID(), link.getToLane().getID()
            via, length = tuple(inside.getID() for inside in across), sum(inside.getLength() for inside in across)
            lines.append(Line(station, link.getState(), link.getTLSID(), link.getTLLinkIndex(), *ends, via, length))
            parts += [np.array(inside.getShape()) for inside in across]
            limits += [here.getLane(lane).getSpeed(), *(inside.getSpeed() for inside in across)]
            lane = link.getToLane().getIndex()
        limits.append(road[0 if closed else -1].getLane(lane).getSpeed())
        if not closed:
            parts.append(np.array(road[-1].getLane(lane).getShape()))
        elif lane != first:
            raise InputError(
                f"the route comes back to '{edges[0]}' in lane {lane}, not {first}; start it in lane {lane}"
            )
        else:
            parts.append(parts[0][:1])
        line, limit = np.concatenate(parts), np.repeat(limits, [len(part) for part in parts])
        # Where one lane's last point is the next one's first, the limit is that of the next.
        new = np.concatenate([np.hypot(*np.diff(line, axis=0).T) > 1e-6, [True]])
        return line[new], limit[new], lines

    def _least_changes(self, road: Sequence[Any], lane: int, last: int | None) -> list[Any]:
        """The links from each edge to the next by which the fewest lanes are crossed, from a lane to `last` if it can.

        Of equal ways the one that stays longest where it is.
        """
        ways: dict[int, tuple[int, list[Any]]] = {lane: (0, [])}  # lane now -> lanes crossed, links
        for here, there in pairwise(road):
            onward: dict[int, tuple[int, list[Any]]] = {}
            for now, (crossed, links) in ways.items():
                for link in self._links(here, there):
                    cost, to = crossed + abs(link.getFromLane().getIndex() - now), link.getToLane().getIndex()
                    if to not in onward or cost < onward[to][0]:
                        onward[to] = cost, [*links, link]
            ways = onward
        return ways[last][1] if last in ways else min(ways.values(), key=lambda way: way[0])[1]

    def fastest_way(self, start: str, end: str) -> list[str]:
        """The edges from one to another that take the least time at the limits of speed.

        They turn back on a road only where there is no other way.
        """
        a, b = (self._net.getEdge(self._known(edge)) for edge in (start, end))
        for edge in (a, b):
            self._check_edge(edge)
        way, _ = self._net.getOptimalPath(a, b, fastest=True, vClass=CAR, reversalPenalty=ROUND)
        if way is None:
            raise InputError(f"no way for cars from edge '{start}' to '{end}'")
        return [edge.getID() for edge in way]

    def leads_on(self, edge: str) -> bool:
        """Whether cars find a way on at an edge's end, other than back."""
        onward = self._net.getEdge(edge).getAllowedOutgoing(CAR).values()
        return any(link.getDirection() not in TURNS_BACK for links in onward for link in links)

    def check_reversals(self, edges: Sequence[str], radius: float) -> None:
        """Raise InputError where a route turns back on its road more tightly than on a radius [m]."""
        for here, there in pairwise(map(self._net.getEdge, edges)):
            for link in self._links(here, there):
                half_circle = sum(inside.getLength() for inside in self._across(link))
                if link.getDirection() in TURNS_BACK and half_circle < math.pi * radius:
                    raise InputError(
                        f"turns back from '{here.getID()}' to '{there.getID()}' on a radius of "
                        f"{half_circle / math.pi:.1f} m; the vehicle needs {radius:.1f} m"
                    )

    def sample_way(self) -> tuple[str, float, str]:
        """A lane on which platoons may start, a position [m] there and an edge that they can reach."""
        lanes = [lane for edge in self._roads for lane in edge.getLanes() if lane.allows(CAR)]
        if not lanes:
            raise InputError(f"{self.path}: the network has no lane for cars")
        lane = max(lanes, key=lambda lane: (lane.getLength(), lane.getID()))
        position = min(40.0, round(0.9 * lane.getLength(), 1))
        return lane.getID(), position, self.onward(lane.getEdge().getID(), 4)[-1]

    def upstream(self, lane_id: str, reach: float) -> list[tuple[str, float]]:
        """A lane and those that lead to it, up to `reach` before its end; and the shortest way from each one's end [m].

        Without the lanes inside junctions, whose vehicles are few and soon on the next.
        """
        ways: dict[str, float] = {}
        todo = [(0.0, lane_id)]
        while todo:
            way, name = heapq.heappop(todo)
            if name in ways:  # by a shorter way; round blocks there are more ways than can be counted
                continue
            ways[name] = way
            lane = self._net.getLane(name)
            if (beyond := way + lane.getLength()) < reach:
                for before in lane.getIncoming(onlyDirect=False):
                    if before.getEdge().getFunction() != "internal":
                        heapq.heappush(todo, (beyond, before.getID()))
        return list(ways.items())

    @cached_property
    def entered_from(self) -> Mapping[str, str]:
        """The lane from which one comes onto each lane inside junctions."""
        links = (link for edge in self._roads for links in edge.getOutgoing().values() for link in links)
        return {inside.getID(): link.getFromLane().getID() for link in links for inside in self._across(link)}

    def onward(self, edge_id: str, n: int = 2) -> tuple[str, ...]:
        """The edge and those met by driving on as straight as can be; n edges, fewer where the road ends."""
        way = [self._net.getEdge(self._known(edge_id))]
        while len(way) < n and (choices := way[-1].getAllowedOutgoing(CAR)):
            arriving = _heading(way[-1].getLane(0).getShape()[-2:])
            turns = {edge: abs(_wrapped(_heading(edge.getLane(0).getShape()[:2]) - arriving)) for edge in choices}
            way.append(min(turns, key=lambda edge: (turns[edge], edge.getID())))
        return tuple(edge.getID() for edge in way)

    def middle_lines(self) -> list[LineString]:
        """Where the two directions of a road meet, continued round corners up to junctions of three or more arms."""
        return list(self._middles.lines)

    def lane_borders(self) -> list[LineString]:
        """Between neighbouring lanes of one direction."""
        borders = []
        for edge in self._roads:
            for lane in [*filter(_is_road, edge.getLanes())][1:]:
                beside = lane.getWidth() / 2 * (1 if self.left_hand else -1)
                border = LineString(lane.getShape()).offset_curve(beside, join_style="mitre")
                borders += [part for part in shapely.get_parts(border) if not part.is_empty]
        return borders

    def junctions(self) -> list[shapely.Polygon]:
        """Their areas."""
        parts = shapely.get_parts(list(self._junction_areas().values()))
        return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]

    def right_of_middle(self, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Distance [m] to the right of the road's middle, seen along each heading; left is negative. (n,)

        NaN inside junctions of three or more arms, on one-way roads and off the road. Which way along the road a
        heading points is judged over the stretch of road about it, so that a vehicle may turn on the spot in a corner.
        """
        middles = self._middles
        x, y, heading = (np.atleast_1d(np.asarray(value, dtype=float)) for value in (x, y, heading))
        right = np.full(len(x), np.nan)
        if not len(middles.lines):
            return right
        rows, k, distance = middles.nearest(x, y)
        defined = distance <= BESIDE * middles.reach[k]
        defined &= ~shapely.contains_xy(middles.junctions, x[rows], y[rows])
        defined &= shapely.intersects_xy(self.drivable, x[rows], y[rows])
        rows, k, distance = rows[defined], k[defined], distance[defined]
        x, y, heading = x[rows], y[rows], heading[rows]
        lines, reach = middles.lines[k], middles.reach[k]
        along = shapely.line_locate_point(lines, shapely.points(x, y))

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
        right[rows] = side * sense * distance
        return right

    @cached_property
    def _roads(self) -> list[sumolib.net.edge.Edge]:
        """Edges that vehicles can drive on: no railways, waterways and footpaths."""
        return [edge for edge in self._net.getEdges(withInternal=False) if any(map(_is_road, edge.getLanes()))]

    def _junction_areas(self) -> dict[str, shapely.Geometry]:
        """Junctions that have an area; dead ends have none, and shapes may cross themselves."""
        nodes = dict.fromkeys(node for edge in self._roads for node in (edge.getFromNode(), edge.getToNode()))
        shapes = {node.getID(): node.getShape() for node in nodes}
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
                if back.getToNode() is not a or back.getID() not in self.edges or edge.getID() > back.getID():
                    continue
                if back is edge.getBidi():  # one lane for both directions has no middle
                    continue
                if line := self._common_border(edge, back):
                    points = np.array(line.coords)
                    pieces.append(line)
                    lanes = [lane for one in (edge, back) for lane in one.getLanes()]
                    widths.append(sum(lane.getWidth() for lane in lanes if _is_road(lane)))
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

    def _common_border(self, edge: Any, back: Any) -> LineString | None:
        """The line midway between the inner borders of two opposite edges; None if they do not lie alongside."""
        inner = [[lane for lane in one.getLanes() if _is_road(lane)][-1] for one in (edge, back)]
        width, side = min(lane.getWidth() for lane in inner), -0.5 if self.left_hand else 0.5
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

    def _known(self, edge_id: str) -> str:
        if edge_id not in self.edges:
            if self._net.hasEdge(edge_id):
                edge = self._net.getEdge(edge_id)
                raise InputError(f"edge '{edge_id}' is no road: it is {_users(edge)}")
            raise InputError(f"no edge '{edge_id}' in {self.path.name}{did_you_mean(edge_id, self.edges)}")
        return edge_id

    def _links(self, here: Any, there: Any) -> list[Any]:
        links = here.getAllowedOutgoing(CAR).get(there, [])
        if not links:
            ways = ", ".join(sorted(edge.getID() for edge in here.getAllowedOutgoing(CAR))) or "nothing, the road ends"
            raise InputError(f"no way from edge '{here.getID()}' to '{there.getID()}'; it leads to: {ways}")
        return links

    def _check_edge(self, edge: Any) -> None:
        """Raise InputError where platoons cannot drive."""
        if not edge.allows(CAR):
            raise InputError(f"edge '{edge.getID()}' has no lane for cars: it is {_users(edge)}")
        if back := edge.getBidi():  # SUMO would take a member for oncoming now and then
            raise InputError(f"edge '{edge.getID()}' shares its lane with oncoming '{back.getID()}'; must have its own")

    def _check_lane(self, edge: Any, index: int) -> None:
        """Raise InputError where there is no such lane, or none for cars."""
        self._check_edge(edge)
        n, outer = edge.getLaneNumber(), "leftmost" if self.left_hand else "rightmost"
        if not 0 <= index < n:
            raise InputError(f"edge '{edge.getID()}' has no lane {index}; must be 0..{n - 1}, 0 {outer}")
        fit = [str(lane.getIndex()) for lane in edge.getLanes() if lane.allows(CAR)]
        if str(index) not in fit:
            users, others = _users(edge.getLane(index)), " or ".join(fit)
            raise InputError(f"edge '{edge.getID()}' lane {index} is {users}; must be one for cars: {others}")

    def _across(self, link: Any) -> list[Any]:
        """The lanes inside the junction: one, or several in a chain where vehicles wait midway."""
        lanes = []
        while via := link.getViaLaneID():
            lanes.append(self._net.getLane(via))
            link = lanes[-1].getOutgoing()[0]
        return lanes


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

    def nearest(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the points that have a line within BESIDE of the widest road: row, nearest line and how far off, (m,)."""
        points = shapely.points(x, y)
        # Five times as fast as the tree's `nearest`, which has to find the way to lines far off as well.
        rows, k = self.tree.query(points, predicate="dwithin", distance=BESIDE * self.reach.max())
        distance = shapely.distance(self.lines[k], points[rows])
        order = np.lexsort((distance, rows))
        rows, k, distance = rows[order], k[order], distance[order]
        first = np.diff(rows, prepend=-1) > 0
        return rows[first], k[first], distance[first]


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


def _crossing_over(lane: Any, other: Any, position: float) -> tuple[np.ndarray, float, float]:
    """A line that starts on a lane and crosses over to another of the same edge; where that begins, how long it is [m].

    position: after which it does [m]
    """
    line, beside = LineString(lane.getShape()), LineString(other.getShape())
    if lane is other:
        return np.array(lane.getShape()), 0.0, 0.0
    wanted = CHANGE * lane.getWidth() * abs(lane.getIndex() - other.getIndex()) / line.length
    begin = min((position + CHANGE_AFTER * lane.getWidth()) / line.length, max(1 - wanted, 0.1))
    way = min(wanted, 1 - begin)
    ends = [one.project(Point(p), normalized=True) for one in (line, beside) for p in one.coords]
    share = np.unique([*ends, begin, begin + way])
    points = shapely.line_interpolate_point(np.array([line, beside])[:, None], share, normalized=True)
    begun, ended = shapely.get_coordinates(points).reshape(2, -1, 2)
    points = begun + np.clip((share - begin) / way, 0.0, 1.0)[:, None] * (ended - begun)
    return points, begin * line.length, way * line.length


def _length(line: np.ndarray) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _heading(two: Sequence[Sequence[float]]) -> float:
    return math.atan2(two[1][1] - two[0][1], two[1][0] - two[0][0])


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)


def _environment(value: str) -> str:
    """SUMO puts what the environment says for ${NAME}."""
    return re.sub(r"\$\{(\w+)\}", lambda match: os.environ.get(match[1], match[0]), value)


def _seconds(time: str) -> float:
    """SUMO's times: seconds, or [days:]hours:minutes:seconds."""
    *larger, seconds = map(float, time.split(":"))
    if len(larger) not in (0, 2, 3):
        raise ValueError(time)
    return seconds + sum(part * unit for part, unit in zip(reversed(larger), (60, 3600, 86400), strict=False))


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
