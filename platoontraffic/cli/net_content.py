"""The content of a network file as it is written, with nothing derived from it."""

from __future__ import annotations

import gc
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from xml.parsers.expat import XMLParserType

from platoontraffic.errors import InputError
from platoontraffic.road.permissions import CAR
from platoontraffic.road.sumo_files import check_net_file, parse

Points = tuple[tuple[float, ...], ...]  # x, y [m]
NOBODY: frozenset[str] = frozenset()


class Lane(NamedTuple):
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
    inside: Mapping[str, tuple[str, ...]]  # ids of the lanes inside each junction
    lights: Mapping[str, tuple[tuple[str, ...], ...]]  # by id and program: duration and state of each phase

    def roads(self) -> dict[str, Edge]:
        """All edges except those inside junctions."""
        return {name: edge for name, edge in self.edges.items() if edge.function == "normal" and edge.lanes}


def read(net: Path) -> Content:
    """The content of a network file, plain or gzipped.

    raises : InputError where it is not a whole network as netconvert writes it
    """
    check_net_file(net)
    reader = _Reader()
    try:
        with _no_collection():
            parse(net, reader.start, "must be a SUMO network as netconvert writes it")
    except IndexError as error:
        raise InputError(f"{net}: {error}; must be as netconvert writes it") from None
    if reader.doubled:
        raise InputError(*(f"{net}: edge '{name}' occurs more than once" for name in reader.doubled))
    return reader.content()


@contextmanager
def _no_collection() -> Iterator[None]:
    """Without garbage collection, which takes as long as reading: it looks for rings among all that is read."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


class _Reader:
    """Gathers the elements of a network in the order of its file."""

    def __init__(self) -> None:
        self._options: dict[str, str] | None = None
        self._boundary = ""
        self._edges: dict[str, tuple[tuple[str, str, str, str], list[Lane]]] = {}
        self._lanes: list[Lane] = []  # of the edge that is read
        self._links: list[Link] = []
        self._junctions: dict[str, tuple[str, Points]] = {}
        self._inside: dict[str, tuple[str, ...]] = {}
        self._lights: dict[str, list[tuple[str, str]]] = {}
        self._phases: list[tuple[str, str]] = []  # of the light that is read
        self.doubled: list[str] = []  # edges
        self._readers: dict[str, Callable[[dict[str, str]], None]] = {
            "lane": self._lane, "connection": self._link, "edge": self._edge, "junction": self._junction,
            "tlLogic": self._light, "phase": self._phase, "location": self._location,
        }  # fmt: skip

    def start(self, tag: str, attributes: dict[str, str], parser: XMLParserType) -> None:
        if self._options is None:
            self._options = attributes
        elif found := self._readers.get(tag):
            found(attributes)

    def content(self) -> Content:
        return Content(
            options=self._options or {},
            boundary=self._boundary,
            edges={name: Edge(*of_edge, tuple(lanes)) for name, (of_edge, lanes) in self._edges.items()},
            links=tuple(self._links),
            junctions=self._junctions,
            inside=self._inside,
            lights={name: tuple(phases) for name, phases in self._lights.items()},
        )

    def _location(self, item: dict[str, str]) -> None:
        self._boundary = item.get("convBoundary", "")

    def _edge(self, item: dict[str, str]) -> None:
        name, self._lanes = item.get("id", ""), []
        if name in self._edges and name not in self.doubled:
            self.doubled.append(name)
        get = item.get
        self._edges[name] = (
            (get("function", "normal"), get("from", ""), get("to", ""), get("priority", "")),
            self._lanes,
        )

    def _lane(self, item: dict[str, str]) -> None:
        allow, disallow = item.get("allow", "all"), item.get("disallow", "")
        self._lanes.append(
            Lane(
                item.get("id", ""),
                float(item.get("width", "3.2")),
                float(item.get("length", "nan")),
                float(item.get("speed", "nan")),
                _points(item),
                None if allow == "all" else frozenset(allow.split()),
                frozenset(disallow.split()) if disallow else NOBODY,
                item.get("acceleration") in ("1", "true"),
            )
        )

    def _link(self, item: dict[str, str]) -> None:
        get = item.get
        source, target = (get("from", ""), int(get("fromLane", "0"))), (get("to", ""), int(get("toLane", "0")))
        rules = get("dir", ""), get("state", ""), get("tl", ""), get("linkIndex", "")
        self._links.append(Link(source, target, get("via", ""), rules))

    def _junction(self, item: dict[str, str]) -> None:
        if item.get("type") != "internal":
            name = item.get("id", "")
            self._junctions[name] = item.get("type", ""), _points(item)
            self._inside[name] = tuple(item.get("intLanes", "").split())

    def _light(self, item: dict[str, str]) -> None:
        self._phases = self._lights[f"{item.get('id')} {item.get('programID')}"] = []

    def _phase(self, item: dict[str, str]) -> None:
        self._phases.append((item.get("duration", ""), item.get("state", "")))


def _points(item: Mapping[str, str]) -> Points:
    return tuple([tuple(map(float, point.split(",")[:2])) for point in item.get("shape", "").split()])


def stem(net: Path) -> str:
    """The file's name without its endings."""
    return re.sub(r"(\.net)?(\.xml)?(\.gz)?$", "", net.name)
