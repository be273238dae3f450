"""What SUMO reads in a run and what it writes: every file that it writes comes into the run's folder, and its trips,
its summary and its edges become tables as tidy as the others.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import pandas as pd

from platoontraffic.road.network import file_named_in, names_files
from platoontraffic.results.columns import Column
from platoontraffic.results.recorder import Recorder
from platoontraffic.scenario import Scenario

CHANGES_LANES_IN = "3"  # [s], where a laser is to follow; at once, as is SUMO's default, cars jump aside
SSM = "device.ssm.file"  # without this option SUMO writes a file a vehicle where the process runs


def sumo_options(scenario: Scenario, folder: Path) -> dict[str, str]:
    """Options by which SUMO reads the scenario's files and writes into `folder` only."""
    folder = folder.absolute()  # SUMO takes names for relative to the file that holds them
    config, record = scenario.configuration, scenario.spec.record
    options = dict(config.options) if config else {}
    options["net-file"] = str(_harmless(scenario.net, folder, "net"))
    # Polygons are for laser and eye; SUMO has no use for them.
    additional = [file for file in scenario.additional if ".poly.xml" not in file.name]
    for option, files in (("route-files", scenario.route_files), ("additional-files", additional)):
        safe = [str(_harmless(file, folder, f"{option.partition('-')[0]}_{i}")) for i, file in enumerate(files)]
        if "edges" in record.sumo and option == "additional-files":
            safe.append(str(_edge_data(scenario, folder)))
        if safe:
            options[option] = ",".join(safe)
    if (demand := scenario.spec.sumo.demand) is not None:
        options["scale"] = str(demand * float(options.get("scale", 1)))  # of what the configuration asks for
    if scenario.spec.sumo.lane_change_s is not None:
        options["lanechange.duration"] = str(scenario.spec.sumo.lane_change_s)
    elif "lateral-resolution" not in options and any(getattr(law, "native", False) for law in scenario.laws.values()):
        options.setdefault("lanechange.duration", CHANGES_LANES_IN)
    options |= {option: str(_inside(folder, name)) for option, name in (config.outputs if config else {}).items()}
    options.setdefault(SSM, str(folder / "sumo_ssm.xml"))
    for name in ("trips", "summary"):
        option = TABLES[name].option
        if name in record.sumo and not options.get(option, "").endswith(".xml"):  # SUMO goes by the name's end
            options[option] = str(folder / _RAW.format(name))
    if "trips" in record.sumo:
        options |= {"tripinfo-output.write-unfinished": "true", "tripinfo-output.write-undeparted": "true"}
        options["device.emissions.probability"] = "1"
    if "summary" in record.sumo:
        options["summary-output.period"] = str(record.sumo_every_s)
    return options


def _edge_data(scenario: Scenario, folder: Path) -> Path:
    begin = start_time(scenario)
    file = folder / "sumo_edges.add.xml"
    when = f'begin="{begin:.3f}" freq="{scenario.spec.record.sumo_every_s}"'
    edge_data = f'<edgeData id="platoontraffic" file="{_RAW.format("edges")}" {when} excludeEmpty="true"/>'
    file.write_text(f"<additional>{edge_data}</additional>\n", encoding="utf-8")
    return file


def _inside(folder: Path, name: str) -> Path:
    """Where a file that is to be written elsewhere is written instead.

    SUMO takes a colon for an address of the network, and puts the date for TIME.
    """
    name = (Path(name).name if Path(name).is_absolute() else name).removeprefix("sumo_")
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._").replace("TIME", "time")
    return folder / f"sumo_{'as_' if name in _TAKEN else ''}{name}"


def _harmless(file: Path, folder: Path, label: str) -> Path:
    """The file, or where it has SUMO write somewhere, a copy in `folder` that has it write there."""
    if not names_files(file):
        return file.absolute()
    opened = gzip.open if file.read_bytes()[:2] == b"\x1f\x8b" else open
    with opened(file, "rb") as source:
        tree = ElementTree.parse(source)
    for i, element in enumerate(tree.iter()):
        if named := file_named_in(element.tag, element.attrib):
            if named.written:
                path = _inside(folder, named.name)
            elif element.tag == "include":
                path = _harmless(file.parent / named.name, folder, f"{label}_{i}")
            else:
                path = (file.parent / named.name).absolute()
            element.set(named.attribute, str(path))
    copy = folder / f"sumo_{label}_{file.name.removesuffix('.gz')}"
    tree.write(copy, encoding="utf-8", xml_declaration=True)
    return copy


# ---- SUMO's tables


class Table(NamedTuple):
    """One of SUMO's outputs as a table."""

    option: str  # by which SUMO writes it
    row: str  # its XML element of a row
    columns: tuple[tuple[str, float, Column], ...]  # attribute, its unit in the column's, column

    @property
    def written(self) -> tuple[Column, ...]:
        """The columns of the table as it is written."""
        return tuple(column for *_, column in self.columns)


def _number(attribute: str, name: str, unit: str, meaning: str, scale: float = 1.0) -> tuple[str, float, Column]:
    return attribute, scale, Column(name, "number", unit, meaning, "%.9g")


def _time(attribute: str, name: str, meaning: str) -> tuple[str, float, Column]:
    return attribute, 1.0, Column(name, "number", "s", meaning, "%.3f")


def _count(attribute: str, name: str, meaning: str) -> tuple[str, float, Column]:
    return attribute, 1.0, Column(name, "integer", "", meaning, "%d")


def _text(attribute: str, name: str, meaning: str) -> tuple[str, float, Column]:
    return attribute, 1.0, Column(name, "string", "", meaning)


MG = 1e-6  # milligrams [kg]
_RAW = "sumo_{}.raw.xml"  # what SUMO writes, until it is a table

TABLES = {
    "trips": Table(
        "tripinfo-output",
        "tripinfo",
        (
            _text("id", "vehicle_id", "of a member too, of whom SUMO knows too little: use its trajectory"),
            _text("vType", "type", "vehicle type"),
            _text("status", "status", "'arrived', 'running' or 'waiting' to depart at the end, or 'removed' by SUMO"),
            _time("depart", "depart_s", "since the platoons were placed, and so negative for those there before"),
            _time("arrival", "arrival_s", "likewise; empty for trips not finished"),
            _time("duration", "duration_s", "on the road, until the end where not finished"),
            _number("routeLength", "route_length_m", "m", "distance driven"),
            _time("waitingTime", "waiting_s", "slower than 0.1 m/s, without planned stops"),
            _time("stopTime", "stop_s", "at planned stops"),
            _time("timeLoss", "time_loss_s", "by driving slower than would be possible"),
            _time("departDelay", "depart_delay_s", "by which it came late on the road for want of room"),
            _number("CO2_abs", "co2_kg", "kg", "emitted", MG),
            _number("CO_abs", "co_kg", "kg", "emitted", MG),
            _number("HC_abs", "hc_kg", "kg", "emitted", MG),
            _number("NOx_abs", "nox_kg", "kg", "emitted", MG),
            _number("PMx_abs", "pmx_kg", "kg", "emitted", MG),
            _number("fuel_abs", "fuel_kg", "kg", "used", MG),
            _number("electricity_abs", "electricity_kwh", "kWh", "used", 1e-3),
        ),
    ),
    "summary": Table(
        "summary-output",
        "step",
        (
            _time("time", "time_s", "since the platoons were placed"),
            _count("inserted", "inserted", "vehicles that have departed since SUMO's start; members are counted too"),
            _count("running", "running", "vehicles on the road"),
            _count("waiting", "waiting", "vehicles that wait for room to depart"),
            _count("arrived", "arrived", "vehicles that have arrived since SUMO's start"),
            _count("halting", "halting", "vehicles slower than 0.1 m/s"),
            _count("teleports", "teleports", "vehicles that SUMO has put elsewhere"),
            _time("meanWaitingTime", "waiting_mean_s", "until departure, of all that have departed"),
            _time("meanTravelTime", "travel_time_mean_s", "of all that have arrived"),
            _number("meanSpeed", "speed_mean_mps", "m/s", "of vehicles on the road"),
            _number("meanSpeedRelative", "speed_relative_mean", "", "of them: speed over the limit of speed"),
        ),
    ),
    "edges": Table(
        "",
        "edge",
        (
            _time("begin", "begin_s", "of the interval, since the platoons were placed"),
            _time("end", "end_s", "of the interval"),
            _text("id", "edge_id", "SUMO's edge; those without a vehicle in the interval are left out"),
            _time("sampledSeconds", "sampled_s", "time that vehicles, members too, were on it, summed up"),
            _time("traveltime", "travel_time_s", "mean time to drive over it"),
            _number("density", "density_perkm", "1/km", "vehicles by length of road"),
            _number("occupancy", "occupancy", "", "share of the lanes' length under vehicles", 0.01),
            _time("waitingTime", "waiting_s", "slower than 0.1 m/s, summed up"),
            _time("timeLoss", "time_loss_s", "summed up"),
            _number("speed", "speed_mean_mps", "m/s", "mean"),
            _number("flow", "flow_perh", "1/h", "vehicles an hour"),
            _count("departed", "departed", "vehicles that departed on it"),
            _count("arrived", "arrived", "vehicles that arrived on it"),
            _count("entered", "entered", "vehicles that came from another edge"),
            _count("left", "left", "vehicles that went on to another edge"),
        ),
    ),
}

_TAKEN = [f"{name}.csv" for name in TABLES]


def start_time(scenario: Scenario) -> float:
    """SUMO's time when the platoons stand at their places [s]: to put them there takes two steps."""
    begin = scenario.configuration.begin if scenario.configuration else 0.0
    return begin + scenario.spec.sumo.warm_up_s + 2 * scenario.spec.run.step_s


def write_tables(recorder: Recorder, scenario: Scenario) -> None:
    """SUMO's outputs that were asked for, as sumo_trips.csv and so on; to be called when SUMO is closed."""
    asked = scenario.configuration.outputs if scenario.configuration else {}
    for name in dict.fromkeys(scenario.spec.record.sumo):
        table = TABLES[name]
        own = recorder.folder / _RAW.format(name)
        file = own if own.is_file() else _inside(recorder.folder, asked[table.option])
        rows = _rows(file, table, start_time(scenario))
        recorder.write_table(f"sumo_{name}.csv", rows, table.written)
        own.unlink(missing_ok=True)
    (recorder.folder / "sumo_edges.add.xml").unlink(missing_ok=True)


def _rows(file: Path, table: Table, start: float) -> Iterator[tuple]:
    """Rows of what happened after `start`, in SUMO's order."""
    interval: dict[str, str] = {}
    root = None
    for event, element in ElementTree.iterparse(file, events=("start", "end")):
        root = element if root is None else root
        if element.tag == "interval":
            interval = {name: element.get(name, "") for name in ("begin", "end")}
        if event == "start" or element.tag != table.row:
            continue
        given = {**interval, **element.attrib}
        for part in element:  # emissions are inside a trip
            given |= part.attrib
        if table.row == "tripinfo":
            given["status"] = _status(given)
        root.clear()  # what has been read is not kept
        values = {column.name: _value(given.get(a, ""), scale, column) for a, scale, column in table.columns}
        for name in {"time_s", "depart_s", "arrival_s", "begin_s", "end_s"} & values.keys():
            values[name] = None if values[name] is None else values[name] - start
        if values.get("time_s", 0.0) >= -1e-6 and (values.get("arrival_s") or 0.0) >= -1e-6:
            yield tuple(values.values())


def _status(trip: dict[str, str]) -> str:
    if float(trip["depart"]) < 0:
        return "waiting"
    if trip["vaporized"] == "end" or (not trip["vaporized"] and float(trip["arrival"]) < 0):
        return "running"
    return "removed" if trip["vaporized"] else "arrived"


def _value(text: str, scale: float, column: Column) -> Any:
    """As SUMO wrote it; it writes -1 where there is nothing to say."""
    if column.type == "string":
        return text
    number = float(text) if text else -1.0
    return None if number == -1 else int(number) if column.type == "integer" else number * scale


def read_trips(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "sumo_trips.csv", dtype={name: str for name in ("vehicle_id", "type", "status")})
