"""SUMO's own account of a demand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import libsumo


class Loaded(NamedTuple):
    depart: float  # asked for [s]
    type: str
    speed_factor: str


def loaded(
    folder: Path,
    net: Path,
    routes: Sequence[Path],
    additional: Sequence[Path] = (),
    begin: int = 0,
    end: int = 100,
    options: Sequence[str] = (),
) -> dict[str, Loaded]:
    """Every vehicle that SUMO loads from begin to end [s]; none of them is inserted."""
    found = {}
    more = ("--max-num-vehicles", "0", "--step-length", "0.1", *options)
    for trip in _trips(folder, net, routes, additional, begin, end, more):
        depart = round(end - float(trip.attrib["departDelay"]), 3)
        found[trip.attrib["id"]] = Loaded(depart, trip.attrib["vType"], trip.attrib["speedFactor"])
    return found


def trips(folder: Path, net: Path, routes: Sequence[Path], end: int = 100, options: Sequence[str] = ()) -> list[bytes]:
    """SUMO's table of trips at its full precision, a row a vehicle, sorted."""
    return sorted(map(ElementTree.tostring, _trips(folder, net, routes, (), 0, end, options)))


def _trips(
    folder: Path,
    net: Path,
    routes: Sequence[Path],
    additional: Sequence[Path],
    begin: int,
    end: int,
    options: Sequence[str],
) -> list[ElementTree.Element]:
    table = folder / "trips.xml"
    files = [("-r", routes), ("-a", additional)]
    libsumo.start([
        "sumo", "-n", str(net), *(word for key, names in files if names for word in (key, ",".join(map(str, names)))),
        "--begin", str(begin), "--end", str(end), "--tripinfo-output", str(table), "--precision", "6",
        "--tripinfo-output.write-undeparted", "true", "--tripinfo-output.write-unfinished", "true",
        "--time-to-teleport", "-1", "--no-step-log", "true", "--no-warnings", "true", *options,
    ])  # fmt: skip
    try:
        libsumo.simulationStep(end)
    finally:
        libsumo.close()
    return list(ElementTree.parse(table).iter("tripinfo"))
