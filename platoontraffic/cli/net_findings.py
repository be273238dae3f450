"""Faults of a network, and notes on it for its user."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from platoontraffic.cli.net_content import Content, read
from platoontraffic.errors import InputError

ROBOT_LANES = 2.0  # width up to which a lane is one for robots, or too narrow for cars [m]
AT_MOST = 8  # findings of one kind that are listed
ON_RAILS = {"tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car"}
TURNAROUND = "t"  # direction of a connection


class Findings(NamedTuple):
    """Findings about a network, one line each."""

    faults: tuple[str, ...] = ()  # they make a run fail
    notes: tuple[str, ...] = ()  # they do not


def findings(net: Path) -> Findings:
    """Faults of a network, or else notes on it."""
    from platoontraffic.road.network import Network  # here, because it takes long to import

    try:
        content, network = read(net), Network.read(net)
        if not any(lane.for_cars for edge in content.roads().values() for lane in edge.lanes):
            return Findings((f"{net}: no lane for cars: all are for {_users(content)} only",))
        if network.drivable.area <= 0:
            return Findings((f"{net}: nothing to drive on: the lanes have no area",))
    except InputError as error:
        return Findings(error.faults)
    kinds = (_permissions, _widths, _ends, _insides, _side)
    return Findings(notes=tuple(f"{net}: note: {line}" for kind in kinds for line in some(kind(content))))


def some(lines: Iterator[str]) -> Iterator[str]:
    """The first lines, and the number of further ones."""
    for i, line in enumerate(every := list(lines)):
        if i == AT_MOST < len(every) - 1:
            yield f"and {len(every) - i} more of this kind"
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
                users = f"{', '.join(sorted(lane.allowed)) or 'no vehicles'} only"
            yield f"lane '{lane.id}': {users}, but part of the road's area in this tool"


def _widths(content: Content) -> Iterator[str]:
    lanes = [lane for edge in content.roads().values() for lane in edge.lanes if lane.for_cars]
    narrow = [lane for lane in lanes if lane.width <= ROBOT_LANES]
    if len(narrow) == len(lanes):
        widest = max(lane.width for lane in lanes)
        yield f"narrow: no lane is wider than {widest:g} m; suitable for small robots, without SUMO traffic"
        return
    for lane in narrow:
        yield f"lane '{lane.id}': {lane.width:g} m wide, too narrow for cars"


def _ends(content: Content) -> Iterator[str]:
    """Lanes that lead nowhere and edges that cannot be reached, at junctions where other roads continue."""
    roads = {name: edge for name, edge in content.roads().items() if any(lane.for_cars for lane in edge.lanes)}
    leading = {link.source for link in content.links}
    left, reached = {name for name, _ in leading}, {link.target[0] for link in content.links}
    going_on = {link.source[0] for link in content.links if link.rules[0] != TURNAROUND}
    onward: dict[str, set[str]] = {}  # junctions to which roads lead from each junction
    origins: dict[str, set[str]] = {}  # junctions from which roads lead to each
    for edge in roads.values():
        onward.setdefault(edge.start, set()).add(edge.end)
        origins.setdefault(edge.end, set()).add(edge.start)
    for name, edge in roads.items():
        if name in left:
            for i, lane in enumerate(edge.lanes):
                if name in going_on and lane.for_cars and not lane.merges and (name, i) not in leading:
                    yield f"lane '{lane.id}' has no connection at junction '{edge.end}'; other lanes of its edge have"
        elif onward.get(edge.end, set()) - {edge.start}:
            yield f"edge '{name}' leads nowhere, though roads lead on from junction '{edge.end}'"
        if name not in reached and origins.get(edge.start, set()) - {edge.end}:
            yield f"edge '{name}' cannot be reached, though roads lead to junction '{edge.start}'"


def _insides(content: Content) -> Iterator[str]:
    roads = content.roads()
    across = [link for link in content.links if link.source[0] in roads and link.target[0] in roads]
    without = [link for link in across if not link.via]
    if across and len(without) == len(across):
        yield "no lanes inside junctions: routes cross them in straight lines; build without no-internal-links"
        return
    for link in without:
        yield f"no lane inside the junction from '{'_'.join(map(str, link.source))}' to '{link.target[0]}'"


def _side(content: Content) -> Iterator[str]:
    if content.options.get("lefthand") in ("1", "true"):
        yield "left-hand traffic: distances to the right of the road's middle have the other sign"
