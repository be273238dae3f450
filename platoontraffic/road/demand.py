"""The demand of a scenario, read before SUMO runs: the vehicles that SUMO will load, and the choice of a share of them.

Times are computed in whole milliseconds, as SUMO does.
"""

from __future__ import annotations

import hashlib
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from platoontraffic.errors import InputError
from platoontraffic.road.sumo_configuration import in_seconds
from platoontraffic.road.sumo_files import TRAFFIC, element_of, fault_at, parse

VEHICLES = ("vehicle", "trip", "flow")
TRANSPORTED = ("person", "personFlow", "container", "containerFlow")
DEFAULT_TYPE = "DEFAULT_VEHTYPE"
DEFAULT_CLASS = "passenger"
# Types that SUMO has without a file, unless a file defines them anew.
DEFAULT_CLASSES = {
    DEFAULT_TYPE: DEFAULT_CLASS, "DEFAULT_PEDTYPE": "pedestrian", "DEFAULT_BIKETYPE": "bicycle",
    "DEFAULT_TAXITYPE": "taxi", "DEFAULT_RAILTYPE": "rail", "DEFAULT_CONTAINERTYPE": "container",
}  # fmt: skip
DAY = 86_400_000  # a flow without an end lasts so long [ms]
MOST = 1_000_000  # vehicles of a flow


class Kind(NamedTuple):
    """A vehicle type and its vehicle class."""

    type: str
    vclass: str


class Vehicle(NamedTuple):
    """A vehicle of the demand, before SUMO loads it."""

    id: str
    type: str  # as the demand names it: a vehicle type, or a distribution of types
    depart: float | None  # [s]; None if it is triggered by a person or a container, or by a split of a train
    edges: tuple[str, ...]  # its route; if `routed`, the edges that are given: from, via, to
    routed: bool  # SUMO finds the route at departure
    drawn: bool  # SUMO draws the route from a distribution; `edges` is the common beginning
    stops: bool  # it stops on its route
    taz: bool  # its route begins or ends in a district (TAZ)
    lane: str  # departLane as written, "" if it is not given
    position: str  # departPos as written, "" if it is not given
    flow: str  # the flow that makes it, "" if none
    file: Path  # the route file or additional file, not the one that it includes


class Demand(NamedTuple):
    """The vehicles that SUMO loads at a scale of 1, in the order of the files: additional files come first."""

    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    begin: float  # of the simulation [s]
    end: float | None  # of the simulation [s]
    vehicles: list[Vehicle]
    types: Mapping[str, tuple[Kind, ...]]  # of a type: itself; of a distribution: the types that SUMO draws from
    random_flows: Mapping[str, float]  # flows that draw their departures -> vehicles to be expected
    dropped: frozenset[tuple[str, str]]  # (tag, id) of elements that SUMO ignores: they are not in order of departure
    persons: int  # flows counted as one
    containers: int
    in_order: bool  # SUMO ignores what is not in order of departure in route files
    unsorted: Mapping[Path, tuple[str, ...]]  # route files with such elements -> their ids

    def kinds(self, vehicle: Vehicle) -> tuple[Kind, ...]:
        """Types, with their classes, of which the vehicle will have one."""
        return self.types.get(vehicle.type, (Kind(vehicle.type, DEFAULT_CLASS),))


class Selection(NamedTuple):
    """A share of a demand. Empty sets allow all."""

    seed: int
    share: float  # 0..1
    types: frozenset[str] = frozenset()
    classes: frozenset[str] = frozenset()
    edges: frozenset[str] = frozenset()  # of departure
    begin: float = 0.0  # of the departures [s]
    end: float = math.inf  # [s]

    def takes(self, vehicle_id: str, kind: Kind, edge: str, depart: float) -> bool:
        """Whether a vehicle belongs to the share.

        depart : the departure that the demand asks for [s]: that of SUMO may be later, and depends on the traffic
        """
        return (
            (not self.types or kind.type in self.types)
            and (not self.classes or kind.vclass in self.classes)
            and (not self.edges or edge in self.edges)
            and self.begin <= depart < self.end
            and chosen(self.seed, vehicle_id, self.share)
        )


def chosen(seed: int, vehicle_id: str, share: float) -> bool:
    """Whether a vehicle is among a share of all; smaller shares are parts of larger ones."""
    return drawn(seed, vehicle_id) < share


def drawn(seed: int, vehicle_id: str) -> float:
    """A number in [0, 1) that depends on the seed and an id only."""
    digest = hashlib.blake2b(f"{seed}/{vehicle_id}".encode(), digest_size=8).digest()
    return (int.from_bytes(digest, "big") >> 11) / 2**53


def common_beginning(one: tuple[str, ...], other: tuple[str, ...]) -> tuple[str, ...]:
    """The edges with which both routes begin."""
    shorter = min(len(one), len(other))
    return one[: next((i for i in range(shorter) if one[i] != other[i]), shorter)]


def read_demand(
    routes: Iterable[Path],
    additional: Iterable[Path] = (),
    begin: float = 0.0,
    end: float | None = None,
    in_order: bool = True,
) -> Demand:
    """The vehicles of route files and additional files, flows expanded.

    begin, end : of the simulation as SUMO is given them [s]: vehicles before its begin are not loaded, and flows
                 without an own begin or end take these
    in_order   : SUMO ignores what is not in order of departure in route files, as it does if its option `route-steps`
                 is above 0
    raises     : InputError where a file cannot be read
    """
    routes, additional = tuple(routes), tuple(additional)
    reader = _Reader(milliseconds(begin), None if end is None else milliseconds(end))
    for file in additional:
        reader.read(file, in_order=False)
    for file in routes:
        reader.read(file, in_order)
    types = {name: (Kind(name, vclass),) for name, vclass in reader.classes.items()}
    for name, drawn in reader.distributions.items():
        types[name] = tuple(kind for part in drawn for kind in types.get(part, (Kind(part, DEFAULT_CLASS),)))
    return Demand(
        routes, additional, begin, end, reader.resolved(), types,
        reader.random_flows, frozenset(reader.dropped), reader.persons, reader.containers, in_order,
        {file: tuple(names) for file, names in reader.unsorted.items()},
    )  # fmt: skip


class _Route(NamedTuple):
    edges: tuple[str, ...] = ()
    drawn: bool = False
    stops: bool = False


@dataclass
class Walk:
    """Goes through files as SUMO does: includes, defaults of flows, elements that are not in order of departure."""

    begin: int  # of the simulation [ms]
    end: int | None  # [ms]
    file: Path = Path()
    dropped: set[tuple[str, str]] = field(default_factory=set)
    unsorted: dict[Path, list[str]] = field(default_factory=dict)  # ids of those that are not in order, by their file
    _in_order: bool = False
    _last: int = -1  # departure of the last element that counts for the order [ms]
    _open: list[str] = field(default_factory=list)  # tags of the elements around
    _interval: tuple[int | None, int | None] | None = None
    _within: tuple[Path, ...] = ()  # files that are being read, each included by the one before
    _skipped: int = 0  # depth inside an element that SUMO ignores

    def read(self, file: Path, in_order: bool) -> None:
        """Go through a file. in_order: SUMO ignores what departs before an element above it (route files)."""
        self.file, self._in_order, self._last = file, in_order, -1
        self._go(file)

    def opened(self, tag: str, attributes: dict[str, str], parent: str) -> None:
        """An element begins."""

    def closed(self, tag: str, parent: str) -> None:
        """An element ends."""

    def text(self, text: str) -> None:
        """A piece of what stands between tags."""

    @property
    def defaults(self) -> tuple[int | None, int | None]:
        """Begin and end of flows that have none [ms]."""
        return self._interval or (self.begin, self.end)

    def _go(self, file: Path) -> None:
        if file.resolve() in self._within:
            raise InputError(f"{self._within[-1]}: includes {file.name}, which leads back to it; must not")
        least = 1 if self._within else 0  # the root of an included file is not an element of its own
        self._within = (*self._within, file.resolve())
        depth = 0

        def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
            nonlocal depth
            depth += 1
            try:
                if depth > least:
                    self._start(tag, attributes, file)
            except InputError:
                raise
            except ValueError as error:
                raise fault_at(file, parser, f"{element_of(tag, attributes)}: {error}") from None

        def end(tag: str) -> None:
            nonlocal depth
            depth -= 1
            if depth >= least:
                self._end(tag)

        parse(file, start, TRAFFIC, end, lambda text: None if self._skipped else self.text(text))
        self._within = self._within[:-1]

    def _start(self, tag: str, attributes: dict[str, str], file: Path) -> None:
        parent = self._open[-1] if self._open else ""
        self._open.append(tag)
        if self._skipped:
            self._skipped += 1
        elif tag == "include" and attributes.get("href"):
            self._go(file.parent / attributes["href"])
        elif tag in (*VEHICLES, *TRANSPORTED) and parent != "calibrator" and self._ignores(tag, attributes):
            self._skipped = 1
            self.dropped.add((tag, attributes.get("id", "")))
        else:
            if tag == "interval" and parent != "calibrator":
                self._interval = time_of(attributes, "begin", self.begin), time_of(attributes, "end", self.end)
            self.opened(tag, attributes, parent)

    def _end(self, tag: str) -> None:
        self._open.pop()
        if self._skipped:
            self._skipped -= 1
        elif tag != "include":
            self.closed(tag, self._open[-1] if self._open else "")
        if tag == "interval":
            self._interval = None

    def _ignores(self, tag: str, attributes: dict[str, str]) -> bool:
        """Whether SUMO ignores an element because one above it departs later, or the simulation begins later."""
        depart = self.depart(tag, attributes)
        if depart is None:
            return False
        flow = tag.lower().endswith("flow")
        if depart < self.begin and not flow:
            return True
        if self._in_order and depart < self._last:
            self.unsorted.setdefault(self.file, []).append(attributes.get("id", ""))
            return True
        if not attributes.get("line"):  # lines of public transport do not count
            self._last = depart
        return False

    def depart(self, tag: str, attributes: Mapping[str, str]) -> int | None:
        """The departure of an element, of a flow its begin [ms]; None if it is an event."""
        if tag.lower().endswith("flow"):
            return time_of(attributes, "begin", self.defaults[0])
        return time_of(attributes, "depart", self.begin)


@dataclass
class _Reader(Walk):
    """Collects vehicles, routes and types."""

    classes: dict[str, str] = field(default_factory=lambda: dict(DEFAULT_CLASSES))
    distributions: dict[str, list[str]] = field(default_factory=dict)  # types by distribution
    random_flows: dict[str, float] = field(default_factory=dict)
    persons: int = 0
    containers: int = 0
    _routes: dict[str, _Route] = field(default_factory=dict)
    _vehicles: list[Vehicle] = field(default_factory=list)
    _later: list[tuple[int, str]] = field(default_factory=list)  # vehicles whose route is not known yet, and its id
    _vehicle: Vehicle | None = None  # the one that is being read
    _route_id: str = ""  # its route by reference
    _departures: Sequence[int | None] = ()  # [ms]
    _types: list[str] = field(default_factory=list)  # of the distribution that is being read
    _route: _Route = field(default_factory=_Route)  # that is being read
    _choices: list[_Route] = field(default_factory=list)  # of the distribution of routes that is being read
    _names: list[str] = field(default_factory=list)  # of the route and the distribution that are being read
    _tuples: dict[str, tuple[str, ...]] = field(default_factory=dict)  # equal routes share their memory

    def resolved(self) -> list[Vehicle]:
        """The vehicles, also those whose routes were defined after them."""
        for i, route_id in self._later:
            self._vehicles[i] = _on(self._vehicles[i], self._routes.get(route_id, _Route()))
        return self._vehicles

    def opened(self, tag: str, attributes: dict[str, str], parent: str) -> None:
        name = attributes.get("id", "")
        if tag in VEHICLES and parent != "calibrator":
            self._begin_vehicle(tag, attributes)
        elif tag == "route":
            self._names.append(name)
            edges = self._shared(attributes.get("edges", "")) * (int(attributes.get("repeat") or 0) + 1)
            self._route = self._routes.get(attributes.get("refId", ""), _Route(edges))
        elif tag == "routeDistribution":
            self._names.append(name)
            self._choices = [self._routes.get(route, _Route()) for route in attributes.get("routes", "").split()]
        elif tag == "stop" and parent == "route":
            self._route = self._route._replace(stops=True)
        elif tag == "stop" and parent in VEHICLES and self._vehicle:
            self._vehicle = self._vehicle._replace(stops=True)
        elif tag == "vType":
            if name:
                self.classes[name] = attributes.get("vClass", DEFAULT_CLASS)
            if parent == "vTypeDistribution":
                self._types.append(name or attributes.get("refId", ""))
        elif tag == "vTypeDistribution":
            self._types = self.distributions.setdefault(name, [])
            self._types += attributes.get("vTypes", "").split()
        else:
            self.persons += tag in ("person", "personFlow")
            self.containers += tag in ("container", "containerFlow")

    def closed(self, tag: str, parent: str) -> None:
        if tag == "route":
            if parent == "routeDistribution":
                self._choices.append(self._route)
            self._define(self._names.pop(), self._route, parent)
        elif tag == "routeDistribution":
            together = reduce(common_beginning, (route.edges for route in self._choices)) if self._choices else ()
            differ = any(route.edges != together for route in self._choices)
            stops = any(route.stops for route in self._choices)
            self._define(self._names.pop(), _Route(together, differ, stops), parent)
        elif tag in VEHICLES and self._vehicle:
            self._end_vehicle(self._vehicle)
            self._vehicle = None

    def _define(self, name: str, route: _Route, parent: str) -> None:
        """Take in a route or a distribution of routes: that of the vehicle that is being read, or one with a name."""
        if parent in VEHICLES and self._vehicle:
            self._vehicle = _on(self._vehicle, route)
        elif name:
            self._routes[name] = route

    def _begin_vehicle(self, tag: str, attributes: dict[str, str]) -> None:
        name = attributes.get("id", "")
        self._departures = (self.depart(tag, attributes),)
        if tag == "flow":
            departures = departures_of(attributes, *self.defaults, self.begin)
            if departures is None:
                self.random_flows[name] = _expected(attributes, *self.defaults, self.begin)
            self._departures = departures or ()
            if len(self._departures) > MOST:
                raise ValueError(f"makes {len(self._departures):,} vehicles; must be {MOST:,} at most")
        self._route_id = attributes.get("route", "")
        start, via, to = (attributes.get(key, "") for key in ("from", "via", "to"))
        self._vehicle = Vehicle(
            id=name,
            type=sys.intern(attributes.get("type", DEFAULT_TYPE)),
            depart=None,
            edges=self._shared(f"{start} {via} {to}") if start else (),
            routed=True,  # unless a route follows
            drawn=False,
            stops=False,
            taz=not (start and to) and any(key in attributes for key in ("fromTaz", "toTaz")),
            lane=sys.intern(attributes.get("departLane", "")),
            position=sys.intern(attributes.get("departPos", "")),
            flow=name if tag == "flow" else "",
            file=self.file,
        )

    def _end_vehicle(self, vehicle: Vehicle) -> None:
        known = self._routes.get(self._route_id)
        if known:
            vehicle = _on(vehicle, known)
        for k, depart in enumerate(self._departures):
            if self._route_id and not known:
                self._later.append((len(self._vehicles), self._route_id))
            name = f"{vehicle.flow}.{k}" if vehicle.flow else vehicle.id
            self._vehicles.append(vehicle._replace(id=name, depart=None if depart is None else depart / 1000))

    def _shared(self, text: str) -> tuple[str, ...]:
        """The edges named in a text, one tuple for equal texts."""
        if text not in self._tuples:
            self._tuples[text] = tuple(map(sys.intern, text.split()))
        return self._tuples[text]


def _on(vehicle: Vehicle, route: _Route) -> Vehicle:
    """The vehicle with a route."""
    stops = vehicle.stops or route.stops
    return vehicle._replace(edges=route.edges, routed=False, drawn=route.drawn, stops=stops, taz=False)


def departures_of(
    flow: Mapping[str, str], begin: int | None, end: int | None, first: int
) -> Sequence[int | None] | None:
    """Departures of a flow's vehicles [ms], None for those that an event triggers; None if SUMO draws them.

    begin, end : if the flow has none [ms]
    first      : begin of the simulation [ms]: the vehicles before it are left out, and not numbered
    """
    if _is_random(flow):
        return None
    starts, ends = _span(flow, begin, end)
    number = int(flow["number"]) if "number" in flow else None
    if starts is None:
        return [None] * (number or 0)
    rate = flow.get("vehsPerHour", flow.get("perHour"))
    interval = milliseconds(3600 / float(rate)) if rate and float(rate) > 0 else time_of(flow, "period", None)
    if number is None:
        number = -(-(ends - starts) // interval) if interval else 0
    elif interval is None:
        interval = (ends - starts) // number if number else 0
    if not interval:
        return [starts] * number if starts >= first else []
    passed = max(0, -(-(first - starts) // interval))
    return range(starts + passed * interval, starts + number * interval, interval)


def _is_random(flow: Mapping[str, str]) -> bool:
    """Whether SUMO draws the departures of a flow."""
    return "probability" in flow or flow.get("period", "").startswith("exp")


def _span(flow: Mapping[str, str], begin: int | None, end: int | None) -> tuple[int | None, int]:
    """Begin, None if it is triggered, and end of a flow [ms]."""
    starts = time_of(flow, "begin", begin)
    default = (starts or 0) + DAY if end is None else end
    ends = time_of(flow, "end", default)
    return starts, default if ends is None else ends


def _expected(flow: Mapping[str, str], begin: int | None, end: int | None, first: int) -> float:
    """The mean number of vehicles of a flow that draws its departures."""
    if "number" in flow:
        return float(flow["number"])
    starts, ends = _span(flow, begin, end)
    rate = flow.get("probability") or flow["period"].removeprefix("exp").strip("() ")
    return float(rate) * max(0, ends - max(starts or 0, first)) / 1000


def time_of(attributes: Mapping[str, str], name: str, default: int | None) -> int | None:
    """A time of an element [ms]; the default if there is none, or `begin`; None if it is an event, as `triggered`.

    raises : ValueError
    """
    text = attributes.get(name, "begin")
    if text == "begin":
        return default
    if text in ("triggered", "containerTriggered", "split", "now"):
        return None
    try:
        return milliseconds(in_seconds(text))
    except (ValueError, OverflowError):
        raise ValueError(f'{name} = "{text:.40}"; must be a time') from None


def milliseconds(seconds: float) -> int:
    """Seconds as SUMO rounds them."""
    return math.floor(seconds * 1000 + 0.5)
