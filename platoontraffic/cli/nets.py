"""Networks for the command line: what is shipped, building, checking, editing, taking edited ones back into sources."""

from __future__ import annotations

import gzip
import os
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from rich.console import Console

from platoontraffic import shipped
from platoontraffic.cli.commands import commands_of
from platoontraffic.errors import InputError, RunError, did_you_mean
from platoontraffic.sumo.programs import home_of, need_display, no_display, program

ROBOT_LANES = 2.0  # [m] no wider than this: a lane of a network for robots, or too narrow for cars
TOLERANCE = 0.01  # [m] within which the shapes of a network and of its rebuilt twin must agree
AT_MOST = 8  # findings of one kind that are written out
CAR = "passenger"
ON_RAILS = {"tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"}
PLAIN = ("nod", "edg", "con", "tll", "typ")  # kinds of source files, as netconvert writes them
TURNAROUND = "t"  # direction of a connection
HEADER = re.compile(r"<!-- generated on .*?-->\s*", re.DOTALL)  # has date and paths


# What a network file says --------------------------------------------------------------------------------------------

Points = tuple[tuple[float, ...], ...]  # x, y [m]


@dataclass(frozen=True)
class Lane:
    """One lane of a road, or inside a junction."""

    id: str
    width: float  # [m]
    length: float  # [m]
    speed: float  # [m/s]
    shape: Points  # centre line
    allowed: frozenset[str] | None  # classes of vehicles; None: all but the banned ones
    banned: frozenset[str]
    merges: bool  # an acceleration lane, which is meant to end

    @property
    def for_cars(self) -> bool:
        return (self.allowed is None or CAR in self.allowed) and not self.banned & {CAR, "all"}


class Edge(NamedTuple):
    """A road in one direction; function "normal". Others lie inside junctions: "internal", "crossing" and so on."""

    function: str
    start: str  # junctions
    end: str
    priority: str
    lanes: tuple[Lane, ...]


class Link(NamedTuple):
    """A connection of two lanes, each (edge, index); `via` is the lane inside the junction."""

    source: tuple[str, int]
    target: tuple[str, int]
    via: str
    rules: tuple[str, ...]  # direction, state, id of the light, index of its signal


class Content(NamedTuple):
    """A network file as it is written, with nothing derived from it."""

    options: Mapping[str, str]  # attributes of <net>
    boundary: str
    edges: Mapping[str, Edge]
    links: tuple[Link, ...]
    junctions: Mapping[str, tuple[str, Points]]  # type and outline
    lights: Mapping[str, tuple[tuple[str, ...], ...]]  # by id and programme: duration and state of each phase

    def roads(self) -> dict[str, Edge]:
        """All edges but those inside junctions."""
        return {name: edge for name, edge in self.edges.items() if edge.function == "normal" and edge.lanes}


def read(net: Path) -> Content:
    """All that the tool wants to know of a whole network file, plain or gzipped."""
    from platoontraffic.road.sumo_files import check_net_file

    check_net_file(net)
    with net.open("rb") as file:
        zipped = file.read(2) == b"\x1f\x8b"
    with gzip.open(net) if zipped else net.open("rb") as file:
        root = ET.parse(file).getroot()
    ids = Counter(item.get("id", "") for item in root.iterfind("edge"))
    if doubled := [f"{net}: edge '{name}' occurs more than once" for name, times in ids.items() if times > 1]:
        raise InputError(*doubled)
    try:
        location = root.find("location")
        return Content(
            root.attrib,
            "" if location is None else location.get("convBoundary", ""),
            {item.get("id", ""): _edge(item) for item in root.iterfind("edge")},
            tuple(map(_link, root.iterfind("connection"))),
            {
                item.get("id", ""): (item.get("type", ""), _points(item))
                for item in root.iterfind("junction")
                if item.get("type") != "internal"
            },
            {
                f"{item.get('id')} {item.get('programID')}": tuple(
                    (phase.get("duration", ""), phase.get("state", "")) for phase in item.iterfind("phase")
                )
                for item in root.iterfind("tlLogic")
            },
        )
    except ValueError as error:
        raise InputError(f"{net}: {error}; must be as netconvert writes it") from None


def _edge(item: ET.Element) -> Edge:
    lanes = tuple(map(_lane, item.iterfind("lane")))
    ends = item.get("from", ""), item.get("to", "")
    return Edge(item.get("function", "normal"), *ends, item.get("priority", ""), lanes)


def _lane(item: ET.Element) -> Lane:
    allow, disallow = item.get("allow", "all"), item.get("disallow", "")
    return Lane(
        item.get("id", ""),
        float(item.get("width", "3.2")),
        float(item.get("length", "nan")),
        float(item.get("speed", "nan")),
        _points(item),
        None if allow == "all" else frozenset(allow.split()),
        frozenset(disallow.split()),
        item.get("acceleration") in ("1", "true"),
    )


def _link(item: ET.Element) -> Link:
    rules = tuple(item.get(key, "") for key in ("dir", "state", "tl", "linkIndex"))
    source, target = ((item.get(side, ""), int(item.get(f"{side}Lane", "0"))) for side in ("from", "to"))
    return Link(source, target, item.get("via", ""), rules)


def _points(item: ET.Element) -> Points:
    return tuple(tuple(map(float, point.split(",")[:2])) for point in item.get("shape", "").split())


# list ----------------------------------------------------------------------------------------------------------------


def described(net: Path) -> str:
    """What a network is and how large, in one line."""
    content = read(net)
    roads = content.roads()
    lanes = [lane for edge in roads.values() for lane in edge.lanes]
    counts, widths = sorted({len(edge.lanes) for edge in roads.values()}), sorted({lane.width for lane in lanes})
    ways = Counter((edge.start, edge.end) for edge in roads.values())
    road = sum(edge.lanes[0].length / (2 if ways[edge.end, edge.start] else 1) for edge in roads.values())
    lights = len({link.rules[2] for link in content.links if link.rules[2]})
    size = [
        f"{_span(counts)} lane{'s' * (counts[-1] > 1)} of {_span(widths)} m a direction",
        f"{road:.0f} m of road" if road < 1000 else f"{road / 1000:.1f} km of road",
        f"{lights or 'no'} junction{'s' * (lights != 1)} with lights",
    ]
    return f"{_purpose(net)} {', '.join(size)}.".strip()


def _span(values: list) -> str:
    return f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g}"


def _purpose(net: Path) -> str:
    """The first sentence of the comment that opens its node file."""
    nodes = net.with_name(f"{_stem(net)}.nod.xml")
    text = nodes.read_text(encoding="utf-8") if nodes.is_file() else ""
    comment = re.search(r"<!--\s*(.*?)\s*-->", text, re.DOTALL)
    return re.split(r"(?<=\.)\s", " ".join(comment[1].split()))[0] if comment else ""


def _stem(net: Path) -> str:
    return re.sub(r"(\.net)?(\.xml)?(\.gz)?$", "", net.name)


# build ---------------------------------------------------------------------------------------------------------------


def build(config: Path, output: Path | None = None) -> Path:
    """Build a network from its sources and return its path. Where that fails, the old network stays."""
    from platoontraffic.road.netconvert import build_net
    from platoontraffic.road.sumo_files import check_net_file

    root = _root(config, "a netconvert configuration (.netccfg)")
    if root.tag != "netconvertConfiguration":
        raise InputError(f"{config}: root element is <{root.tag}>; must be <netconvertConfiguration>, a .netccfg")
    if output is None:
        named = root.find(".//output-file")
        output = config.with_suffix(".net.xml") if named is None else config.parent / named.get("value", "")
    if output.is_dir() or not output.parent.is_dir():
        what = "is a folder" if output.is_dir() else f"no such folder: {output.parent}"
        raise InputError(f"{output}: {what}; must be a file to write")
    program("netconvert")
    try:
        with tempfile.TemporaryDirectory(dir=output.parent, prefix=".build-") as folder:
            built = Path(folder, "built.net.xml")
            build_net(config, built)
            check_net_file(built)
            built.replace(output)
    except OSError as error:
        raise InputError(f"{output}: cannot be written: {error.strerror}") from error
    return output


def _root(path: Path, wanted: str) -> ET.Element:
    """Root element of an XML file that is there and whole."""
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}; must be {wanted}")
    try:
        return ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"{path}:{error.position[0]}: not whole XML; must be {wanted}") from None


def _run(program: Path, *arguments: str | Path, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([program, *arguments], cwd=folder, env=home_of(program), capture_output=True, text=True)


# check ---------------------------------------------------------------------------------------------------------------


class Findings(NamedTuple):
    """What is to be said about a network, a line each."""

    faults: tuple[str, ...] = ()  # a run would fail
    notes: tuple[str, ...] = ()  # it would not, but its user should know


def findings(net: Path) -> Findings:
    """What is wrong with a network for this tool."""
    from platoontraffic.road.network import Network

    try:
        content, network = read(net), Network.read(net)
        if not any(lane.for_cars for edge in content.roads().values() for lane in edge.lanes):
            return Findings((f"{net}: no lane for cars: all are for {_users(content)} only",))
        if network.drivable.area <= 0:
            return Findings((f"{net}: nothing to drive on: the lanes have no area",))
    except InputError as error:
        return Findings(error.faults)
    kinds = (_permissions, _widths, _ends, _insides, _side)
    return Findings(notes=tuple(f"{net}: note: {line}" for kind in kinds for line in _some(kind(content))))


def _some(lines: Iterator[str]) -> Iterator[str]:
    """The first ones, and how many there are beyond."""
    for i, line in enumerate(every := list(lines)):
        if i == AT_MOST < len(every) - 1:
            yield f"and {len(every) - i} more like that"
            return
        yield line


def _users(content: Content) -> str:
    users = {user for edge in content.roads().values() for lane in edge.lanes for user in lane.allowed or ()}
    return "rails" if users and users <= ON_RAILS else ", ".join(sorted(users)) or "none"


def _permissions(content: Content) -> Iterator[str]:
    for edge in content.roads().values():
        for lane in edge.lanes:
            if lane.for_cars:
                continue
            if lane.allowed is None:
                users = "no cars"
            elif lane.allowed <= ON_RAILS:
                users = "rails only"
            else:
                users = f"{', '.join(sorted(lane.allowed)) or 'nobody'} only"
            yield f"lane '{lane.id}': {users}, and yet part of the road's area as the tool sees it"


def _widths(content: Content) -> Iterator[str]:
    lanes = [lane for edge in content.roads().values() for lane in edge.lanes if lane.for_cars]
    narrow = [lane for lane in lanes if lane.width <= ROBOT_LANES]
    if len(narrow) == len(lanes):
        widest = max(lane.width for lane in lanes)
        yield f"narrow: no lane is wider than {widest:g} m; for small robots, without SUMO's own traffic"
        return
    for lane in narrow:
        yield f"lane '{lane.id}': {lane.width:g} m wide, too narrow for cars"


def _ends(content: Content) -> Iterator[str]:
    """Lanes that lead nowhere and edges that nobody can reach, where the network goes on."""
    roads = {name: edge for name, edge in content.roads().items() if any(lane.for_cars for lane in edge.lanes)}
    leading = {link.source for link in content.links}
    left, reached = {name for name, _ in leading}, {link.target[0] for link in content.links}
    going_on = {link.source[0] for link in content.links if link.rules[0] != TURNAROUND}
    onward: dict[str, set[str]] = {}  # where roads from a junction lead, and where those to it come from
    origins: dict[str, set[str]] = {}
    for edge in roads.values():
        onward.setdefault(edge.start, set()).add(edge.end)
        origins.setdefault(edge.end, set()).add(edge.start)
    for name, edge in roads.items():
        if name in left:
            for i, lane in enumerate(edge.lanes):
                if name in going_on and lane.for_cars and not lane.merges and (name, i) not in leading:
                    yield f"lane '{lane.id}' has no connection at junction '{edge.end}'; others of its edge have"
        elif onward.get(edge.end, set()) - {edge.start}:
            yield f"edge '{name}' leads nowhere, though roads go on from junction '{edge.end}'"
        if name not in reached and origins.get(edge.start, set()) - {edge.end}:
            yield f"edge '{name}' cannot be reached, though roads lead to junction '{edge.start}'"


def _insides(content: Content) -> Iterator[str]:
    roads = content.roads()
    across = [link for link in content.links if link.source[0] in roads and link.target[0] in roads]
    without = [link for link in across if not link.via]
    if across and len(without) == len(across):
        yield "no lanes inside junctions: lines along lanes jump across them; build without no-internal-links"
        return
    for link in without:
        yield f"no lane inside the junction from '{'_'.join(map(str, link.source))}' to '{link.target[0]}'"


def _side(content: Content) -> Iterator[str]:
    if content.options.get("lefthand") in ("1", "true"):
        yield "left-hand traffic: what is measured to the right of the road's middle has the other sign"


# edit ----------------------------------------------------------------------------------------------------------------

OPENED_BY = {
    "neteditConfiguration": "--netecfg-file",
    "sumoConfiguration": "--sumocfg-file",
    "net": "--sumo-net-file",
}


def edit(name: str) -> None:
    """Open a shipped network, a network or a netedit configuration in netedit, and wait until it is closed."""
    net = shipped.networks().get(name)
    path = net.with_name(f"{name}.netecfg") if net else _file(name)
    if path.suffix == ".gz":
        raise InputError(f"{path}: is gzipped; unpack it first")
    root = _root(path, "a shipped network's name, a .net.xml, a .netecfg or a .sumocfg")
    if root.tag not in OPENED_BY:
        raise InputError(f"{path}: root element is <{root.tag}>; must be one of: {', '.join(OPENED_BY)}")
    netedit = program("netedit")
    need_display("netedit")
    done = _run(netedit, OPENED_BY[root.tag], path.resolve())
    if "unable to open display" in done.stderr:
        raise no_display("netedit")
    if done.returncode:
        raise RunError(f"{path}: netedit ended with {done.returncode}: {done.stderr.strip().rpartition(chr(10))[2]}")


def _file(name: str) -> Path:
    """A network by its shipped name or path."""
    networks = shipped.networks()
    if name not in networks and not Path(name).exists():
        hint = "" if os.sep in name or "." in name else did_you_mean(name, networks)
        raise InputError(f"{name}: no such file, nor a shipped network{hint}")
    return networks.get(name, Path(name))


# import --------------------------------------------------------------------------------------------------------------


def import_net(net: Path, folder: Path, force: bool = False) -> list[Path]:
    """Turn a network back into plain sources and a .netccfg that builds an equal one; returns the files written.

    Nothing is written unless the sources build a network with the same lanes, connections, junctions and lights.
    """
    from platoontraffic.road.netconvert import build_net

    content, name = read(net), _stem(net)
    netconvert = program("netconvert")
    with tempfile.TemporaryDirectory(prefix="platoontraffic-") as temporary:
        work = Path(temporary)
        precision = str(_decimals(content.boundary))
        options = ("--plain-output-prefix", name, "--precision", precision)
        done = _run(netconvert, "--sumo-net-file", net.resolve(), *options, folder=work)
        if done.returncode:
            faults = re.findall(r"^Error: *(.+)$", done.stderr, re.MULTILINE) or [done.stderr.strip()]
            raise InputError(*(f"{net}: netconvert: {fault}" for fault in faults))
        sources = [file for kind in PLAIN if (file := work / f"{name}.{kind}.xml").is_file()]
        for file in sources:
            file.write_text(HEADER.sub("", file.read_text(encoding="utf-8"), count=1), encoding="utf-8")
        config = work / f"{name}.netccfg"
        config.write_text(_config(config, precision), encoding="utf-8")
        try:
            build_net(config, work / "rebuilt.net.xml")
        except InputError as error:
            faults = [fault.rpartition(f"{config}: ")[2] for fault in error.faults]
            raise InputError(*(f"{net}: its sources do not build: {fault}" for fault in faults)) from error
        if different := list(_some(differences(content, read(work / "rebuilt.net.xml")))):
            raise InputError(*(f"{net}: its sources would build another network: {line}" for line in different))
        targets = {file: folder / file.name for file in (*sources, config)}
        if (there := [target for target in targets.values() if target.exists()]) and not force:
            raise InputError(*(f"{target}: is already there and is kept; --force replaces it" for target in there))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for file, target in targets.items():
                target.write_bytes(file.read_bytes())
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
    return list(targets.values())


def _decimals(boundary: str) -> int:
    """How many decimals a network's coordinates have."""
    return max(2, *(len(number.partition(".")[2]) for number in boundary.split(",")), 0)


def _config(plain: Path, precision: str) -> str:
    """The configuration that netconvert left beside its plain output, made to build a network in the same folder."""
    name = plain.stem
    root = ET.fromstring(plain.read_text(encoding="utf-8"))
    root.attrib.clear()
    for old in root.findall("output"):
        root.remove(old)
    output = ET.Element("output")
    ET.SubElement(output, "output-file", value=f"{name}.net.xml")
    ET.SubElement(output, "precision", value=precision)
    root.insert(1, output)
    ET.indent(root, "    ")
    text = ET.tostring(root, encoding="unicode", short_empty_elements=True).replace(" />", "/>")
    head = f"<!-- netconvert -c {name}.netccfg builds {name}.net.xml -->"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n\n{head}\n{text}\n'


def differences(one: Content, other: Content) -> Iterator[str]:
    """Where two networks differ, shapes by more than TOLERANCE; not in the ids of what lies inside junctions."""
    for what, a, b in (
        ("edge", one.roads(), other.roads()),
        ("junction", one.junctions, other.junctions),
        ("light", one.lights, other.lights),
        ("connection", _joined(one), _joined(other)),
    ):
        yield from (f"{what} '{key}' is missing" for key in a.keys() - b.keys())
        yield from (f"{what} '{key}' is new" for key in b.keys() - a.keys())
        for key in sorted(a.keys() & b.keys()):
            if not _alike(a[key], b[key]):
                yield f"{what} '{key}' is another"


def _joined(content: Content) -> dict[str, tuple]:
    """Every connection of two roads, with the shape of the way inside the junction, whatever its lanes are called."""
    roads = content.roads()
    inside = {lane.id: lane.shape for edge in content.edges.values() for lane in edge.lanes}
    onward = {"_".join(map(str, link.source)): link.via for link in content.links if link.source[0] not in roads}
    joined = {}
    for link in content.links:
        if link.source[0] in roads and link.target[0] in roads:
            way, via = [], link.via
            while via:
                way += [point for point in inside.get(via, ()) if not way or point != way[-1]]
                via = onward.get(via, "")
            lanes = ("_".join(map(str, lane)) for lane in (link.source, link.target))
            joined[" to ".join(lanes)] = (link.rules, tuple(way))
    return joined


def _alike(a: object, b: object) -> bool:
    """Equal, but for shapes and lengths that may differ by the tolerance."""
    if isinstance(a, Lane) and isinstance(b, Lane):
        same = ("id", "width", "speed", "allowed", "banned", "merges")
        equal = all(getattr(a, key) == getattr(b, key) for key in same)
        return equal and abs(a.length - b.length) <= 1.5 * TOLERANCE and _alike(a.shape, b.shape)
    if isinstance(a, tuple) and isinstance(b, tuple):
        if a and b and all(isinstance(p, tuple) and p and isinstance(p[0], float) for p in (*a, *b)):
            return _near(a, b)
        return len(a) == len(b) and all(map(_alike, a, b))
    return a == b


def _near(a: Points, b: Points) -> bool:
    from shapely.geometry import LineString

    if min(len(a), len(b)) < 2:
        return a == b
    one, other = LineString(a), LineString(b)
    return one.hausdorff_distance(other) <= 1.5 * TOLERANCE  # both are rounded


# The commands --------------------------------------------------------------------------------------------------------

nets_app = typer.Typer(help="Road networks: list, build, check, edit, import.", no_args_is_help=True)
out = Console(highlight=False, soft_wrap=True)


command = commands_of(nets_app)
NetName = Annotated[str, typer.Argument(metavar="NET", help="a network file, or a shipped name")]


@command
def list_nets() -> None:
    """List the shipped networks."""
    for name, net in shipped.networks().items():
        out.print(f"{name:12} {described(net)}")


@command
def build_command(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="a .netccfg")],
    to: Annotated[Path | None, typer.Option("-o", "--to", help="the network; default: what CONFIG says")] = None,
) -> None:
    """Build a network from its plain sources."""
    print(build(config, to))


@command
def check_command(
    nets: Annotated[list[str], typer.Argument(metavar="NET...", help="networks, or shipped names")],
) -> None:
    """Say what is wrong with networks, before a run does."""
    faults: list[str] = []
    for name in nets:
        try:
            found = findings(net := _file(name))
        except InputError as error:
            found, net = Findings(error.faults), Path(name)
        faults += found.faults
        for note in found.notes:
            out.print(note, markup=False)
        if not found.faults and not found.notes:
            out.print(f"{net}: fine", markup=False)
    if faults:
        raise InputError(*faults)


@command
def edit_command(
    name: Annotated[str, typer.Argument(metavar="NAME|NET|NETECFG", help="a shipped network, or a file")],
) -> None:
    """Open a network in netedit."""
    edit(name)


@command
def import_command(
    net: NetName,
    folder: Annotated[Path, typer.Argument(help="where the sources go; made if it is not there")],
    force: Annotated[bool, typer.Option("--force", help="replace sources that are there; their comments go")] = False,
) -> None:
    """Take a network that netedit saved back into plain sources."""
    written = import_net(_file(net), folder, force)
    for path in written:
        print(path)
