"""The content of a network file as it is written, with nothing derived from it."""

from __future__ import annotations

import gzip
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from platoontraffic.errors import InputError
from platoontraffic.road.permissions import CAR
from platoontraffic.road.sumo_files import check_net_file

Points = tuple[tuple[float, ...], ...]  # x, y [m]


@dataclass(frozen=True)
class Lane:
    """One lane of a road, or inside a junction."""

    id: str
    width: float  # [m]
    length: float  # [m]
    speed: float  # [m/s]
    shape: Points  # centre line
    allowed: frozenset[str] | None  # vehicle classes; None: all except the banned ones
    banned: frozenset[str]
    merges: bool  # an acceleration lane, which ends by design

    @property
    def for_cars(self) -> bool:
        return (self.allowed is None or CAR in self.allowed) and not self.banned & {CAR, "all"}


class Edge(NamedTuple):
    """A road in one direction, with function "normal"; edges inside junctions are "internal", "crossing" and so on."""

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
    """The elements of a network file."""

    options: Mapping[str, str]  # attributes of <net>
    boundary: str
    edges: Mapping[str, Edge]
    links: tuple[Link, ...]
    junctions: Mapping[str, tuple[str, Points]]  # type and outline
    lights: Mapping[str, tuple[tuple[str, ...], ...]]  # by id and program: duration and state of each phase

    def roads(self) -> dict[str, Edge]:
        """All edges except those inside junctions."""
        return {name: edge for name, edge in self.edges.items() if edge.function == "normal" and edge.lanes}


def read(net: Path) -> Content:
    """The content of a network file, plain or gzipped.

    raises : InputError where it is not a whole network as netconvert writes it
    """
    check_net_file(net)
    with net.open("rb") as file:
        zipped = file.read(2) == b"\x1f\x8b"
    with gzip.open(net) if zipped else net.open("rb") as file:
        root = ET.parse(file).getroot()
    ids = Counter(item.get("id", "") for item in root.iterfind("edge"))
    if doubled := [f"{net}: edge '{name}' occurs more than once" for name, times in ids.items() if times > 1]:
        raise InputError(*doubled)
    try:
        return _content(root)
    except ValueError as error:
        raise InputError(f"{net}: {error}; must be as netconvert writes it") from None


def _content(root: ET.Element) -> Content:
    location = root.find("location")
    junctions = [item for item in root.iterfind("junction") if item.get("type") != "internal"]
    return Content(
        options=root.attrib,
        boundary="" if location is None else location.get("convBoundary", ""),
        edges={item.get("id", ""): _edge(item) for item in root.iterfind("edge")},
        links=tuple(map(_link, root.iterfind("connection"))),
        junctions={item.get("id", ""): (item.get("type", ""), _points(item)) for item in junctions},
        lights={f"{item.get('id')} {item.get('programID')}": _phases(item) for item in root.iterfind("tlLogic")},
    )


def _phases(item: ET.Element) -> tuple[tuple[str, str], ...]:
    return tuple((phase.get("duration", ""), phase.get("state", "")) for phase in item.iterfind("phase"))


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


def stem(net: Path) -> str:
    """The file's name without its endings."""
    return re.sub(r"(\.net)?(\.xml)?(\.gz)?$", "", net.name)
