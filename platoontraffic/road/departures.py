"""Copies of route files in which some vehicles depart later."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import IO, NamedTuple
from xml.sax.saxutils import escape, quoteattr

from platoontraffic.road.demand import TRANSPORTED, VEHICLES, Demand, Walk, departures_of, milliseconds
from platoontraffic.road.sumo_files import file_named_in

# SUMO ignores a vehicle that departs before one above it, unless that one is of a line of public transport. So those
# that wait keep their place in the file, on a line: SUMO draws types and speed factors in the order of the file.
LINE = "waits"
OF_FLOWS = ("id", "begin", "end", "number", "period", "vehsPerHour", "perHour")  # attributes that vehicles do not have


def with_departures(
    demand: Demand,
    waits: Mapping[str, float],
    folder: Path,
    expand: bool = False,
    lanes: Mapping[str, int] = MappingProxyType({}),
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Route files and additional files of a demand with which some vehicles depart later.

    Copies differ from their originals in `depart` and `line` of vehicles that wait, in `departLane`, in flows, and in
    names of files that SUMO reads, which are absolute. They lack what SUMO ignores for its order: with `route-steps` 0
    it would load that. Types and speed factors that SUMO draws stay the same; if there are several route files, only
    with its option `route-steps` 0, which reads each at once.

    If a vehicle of a flow waits, all flows are expanded into vehicles, except those with random or triggered
    departures and those that stop. SUMO then draws the same as for flows only if the demand has nothing but flows,
    each flow has a type of its own, not a distribution, and no two flows have departures within one step.

    waits   : vehicle -> wait [s]
    folder  : for the copies
    lanes   : vehicle -> index of the lane on which it departs; others depart as before
    expand  : expand flows even if none of their vehicles waits, so that runs with and without waits have the same draws
    returns : route files and additional files, copies in the place of those that change
    raises  : ValueError for a vehicle that the demand does not have, or whose departure is not known
    """
    movable = {v.id: v for v in demand.vehicles if v.depart is not None and not (v.flow and v.stops)}
    if unknown := sorted((waits.keys() | lanes.keys()) - movable.keys()):
        raise ValueError(f"the departure of vehicle '{unknown[0]}' cannot be changed")
    moved = {name: milliseconds(wait) for name, wait in waits.items() if wait > 0}
    expand = expand or any(movable[name].flow for name in moved.keys() | lanes.keys())
    flows = {v.flow for v in movable.values() if v.flow} if expand else set()
    changed = {v.file for v in movable.values() if v.id in moved or v.id in lanes or v.flow in flows}
    changed |= demand.unsorted.keys()
    copies = []
    for kind, files in (("routes", demand.routes), ("additional", demand.additional)):
        for i, file in enumerate(files):
            copy = folder / f"departures_{kind}_{i}_{file.name.removesuffix('.gz')}"
            copies.append(copy if file in changed else file)
            if file in changed:
                with copy.open("w", encoding="utf-8") as out:
                    begin, end = milliseconds(demand.begin), None if demand.end is None else milliseconds(demand.end)
                    _Copier(begin, end, out=out, waits=moved, flows=flows, lanes=lanes).read(
                        file, in_order=kind == "routes" and demand.in_order
                    )
    return tuple(copies[: len(demand.routes)]), tuple(copies[len(demand.routes) :])


class _Expanded(NamedTuple):
    """A vehicle of a flow that is to be written."""

    depart: int  # before it waits [ms]
    flow: int  # place of its flow in the file
    number: int  # within its flow
    text: str


@dataclass
class _Copier(Walk):
    """Writes what it reads, with later departures and without flows."""

    out: IO[str] | None = None
    waits: Mapping[str, int] = field(default_factory=dict)  # [ms]
    flows: Collection[str] = ()  # to be expanded
    lanes: Mapping[str, int] = field(default_factory=dict)
    _due: list[_Expanded] = field(default_factory=list)  # a heap
    _coming: list[Iterator[_Expanded]] = field(default_factory=list)  # the rest of each flow
    _flow: dict[str, str] | None = None  # attributes of the flow that is being read
    _departures: Sequence[int | None] = ()  # its [ms]
    _inner: list[str] = field(default_factory=list)  # text of the elements within it
    _has_route: bool = False
    _root: str = ""

    def read(self, file: Path, in_order: bool) -> None:
        self._put('<?xml version="1.0" encoding="UTF-8"?>\n')
        super().read(file, in_order)
        self._put("\n")

    def opened(self, tag: str, attributes: dict[str, str], parent: str) -> None:
        if self._flow is not None:
            self._has_route |= tag in ("route", "routeDistribution")
        elif tag in (*VEHICLES, *TRANSPORTED) and parent != "calibrator":
            depart = self.depart(tag, attributes)
            if depart is not None:
                self._write_due(depart)
            name = attributes.get("id", "")
            if tag == "flow" and name in self.flows:
                self._flow, self._inner, self._has_route = attributes, [], "route" in attributes
                self._departures = departures_of(attributes, *self.defaults, self.begin) or ()
                return
            if tag in ("vehicle", "trip"):
                attributes = self._later(attributes, depart)
        named = file_named_in(tag, attributes)
        if named and not named.written:
            attributes = {**attributes, named.attribute: str(self._within[-1].parent / named.name)}
        self._put(f"<{tag}{_written(attributes)}>")

    def closed(self, tag: str, parent: str) -> None:
        if self._flow is not None and tag == "flow":
            self._begin_expanding(self._flow)
            self._flow = None
            return
        if not parent:
            self._write_due(None)
        self._put(f"</{tag}>")

    def text(self, text: str) -> None:
        self._put(escape(text))

    def _put(self, text: str) -> None:
        if self._flow is not None:
            self._inner.append(text)
        elif self.out:
            self.out.write(text)

    def _later(self, attributes: Mapping[str, str], depart: int | None) -> dict[str, str]:
        """Attributes of a vehicle, with its later departure if it waits."""
        if (lane := self.lanes.get(attributes.get("id", ""))) is not None:
            attributes = {**attributes, "departLane": str(lane)}
        wait = self.waits.get(attributes.get("id", ""))
        if depart is None or wait is None:
            return dict(attributes)
        return {**attributes, "depart": f"{(depart + wait) / 1000:.3f}", "line": attributes.get("line") or LINE}

    def _begin_expanding(self, flow: dict[str, str]) -> None:
        tag, inner, place = "vehicle" if self._has_route else "trip", "".join(self._inner), len(self._coming)
        common = {key: value for key, value in flow.items() if key not in OF_FLOWS}

        def vehicles(departures: Sequence[int | None]) -> Iterator[_Expanded]:
            for k, depart in enumerate(departures):
                own = {"id": f"{flow['id']}.{k}", "depart": f"{(depart or 0) / 1000:.3f}", **common}
                text = f"<{tag}{_written(self._later(own, depart))}>{inner}</{tag}>"
                yield _Expanded(depart or 0, place, k, text)

        self._coming.append(vehicles(self._departures))
        self._push(place)

    def _push(self, flow: int) -> None:
        if (vehicle := next(self._coming[flow], None)) is not None:
            heapq.heappush(self._due, vehicle)

    def _write_due(self, before: int | None) -> None:
        """Write the vehicles of flows that depart before a time [ms], all if it is None."""
        while self._due and (before is None or self._due[0].depart < before):
            vehicle = heapq.heappop(self._due)
            self._put(vehicle.text + "\n    ")
            self._push(vehicle.flow)


def _written(attributes: Mapping[str, str]) -> str:
    return "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
