"""Input and output files of SUMO in a run.

SUMO writes into the folder of the run only. Its trips, its summary and its edges become tidy tables there.
"""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from xml.etree import ElementTree

from platoontraffic.results.columns import Column
from platoontraffic.results.recorder import Recorder
from platoontraffic.road.demand import Demand
from platoontraffic.road.departures import with_departures
from platoontraffic.road.network import file_named_in, names_files
from platoontraffic.scenario import Scenario
from platoontraffic.sumo.vehicle_types import driver_types
from platoontraffic.world.prepared import Platooning

LANE_CHANGE_DURATION = (
    "3"  # of SUMO-driven vehicles, where lasers follow them [s]; by default SUMO's cars jump sideways
)
SSM = "device.ssm.file"  # without this option SUMO writes one file a vehicle into the working directory


@contextmanager
def plainly_named(folder: Path) -> Iterator[Path]:
    """The folder by a name that SUMO takes for a path: it reads `:` as a port, and puts the environment into ${NAME}.

    Such a folder is named by a link to it.
    """
    if not re.search(r"[:,$]", str(folder.absolute())):
        yield folder
        return
    with TemporaryDirectory(prefix="platoontraffic-") as beside:
        link = Path(beside) / "run"
        link.symlink_to(folder.absolute(), target_is_directory=True)
        yield link


def sumo_options(
    scenario: Scenario, folder: Path, platooning: Platooning | None = None, unsorted: Demand | None = None
) -> dict[str, str]:
    """Options that let SUMO read the scenario's files and write into `folder` only.

    platooning: platoons that vehicles of the traffic form
    unsorted  : the demand, where SUMO ignores a part of it for its order
    """
    folder = folder.absolute()  # SUMO resolves relative names against the file that holds them
    config, record = scenario.configuration, scenario.spec.record
    options = dict(config.options) if config else {}
    options["net-file"] = str(_harmless(scenario.net, folder, "net"))
    routes, additional = scenario.route_files, scenario.additional_of_sumo
    if platooning:
        plan, demand, lanes = platooning
        routes, additional = with_departures(demand, plan.waits, folder, expand=True, lanes=lanes)
    elif unsorted:
        routes, additional = with_departures(unsorted, {}, folder)
    if scenario.spec.equip:
        options["route-steps"] = "0"  # types and speed factors are drawn alike, whoever waits: `road.departures`
    for option, files in (("route-files", routes), ("additional-files", additional)):
        safe = [str(_harmless(file, folder, f"{option.partition('-')[0]}_{i}")) for i, file in enumerate(files)]
        if option == "additional-files" and (added := _added(scenario)):
            (folder / _ADDED).write_text(f"<additional>{added}</additional>\n", encoding="utf-8")
            safe.append(str(folder / _ADDED))
        if safe:
            options[option] = ",".join(safe)
    if (demand := scenario.spec.sumo.demand) is not None:
        options["scale"] = str(demand * float(options.get("scale", 1)))  # a factor on the configuration's own scale
    if scenario.spec.sumo.lane_change_s is not None:
        options["lanechange.duration"] = str(scenario.spec.sumo.lane_change_s)
    elif "lateral-resolution" not in options and any(law.native for law in scenario.laws.values()):
        options.setdefault("lanechange.duration", LANE_CHANGE_DURATION)
    options |= {option: str(_inside(folder, name)) for option, name in (config.outputs if config else {}).items()}
    options.setdefault(SSM, str(folder / "sumo_ssm.xml"))
    for name in ("trips", "summary"):
        option = TABLES[name].option
        if name in record.sumo and not options.get(option, "").endswith(
            ".xml"
        ):  # SUMO chooses the format by the suffix
            options[option] = str(folder / _RAW.format(name))
    if "trips" in record.sumo:
        options |= {"tripinfo-output.write-unfinished": "true", "tripinfo-output.write-undeparted": "true"}
        options["device.emissions.probability"] = "1"
    if "summary" in record.sumo:
        options["summary-output.period"] = str(record.sumo_every_s)
    return options


def _added(scenario: Scenario) -> str:
    """Elements by which SUMO writes the tables that no option switches on, and types of the vehicles that it drives."""
    begin, record = scenario.start, scenario.spec.record
    elements = [driver_types(law.vehicle_type for law in scenario.laws.values())]
    if "edges" in record.sumo:
        when = f'begin="{begin:.3f}" freq="{record.sumo_every_s}"'
        elements.append(f'<edgeData id="platoontraffic" file="{_RAW.format("edges")}" {when} excludeEmpty="true"/>')
    if "signals" in record.sumo:
        elements.append(f'<timedEvent type="SaveTLSSwitchStates" dest="{_RAW.format("signals")}"/>')
    return "".join(elements)


def _inside(folder: Path, name: str) -> Path:
    """Path inside `folder` for a file that SUMO was to write elsewhere.

    Colons are replaced because SUMO reads them as network addresses, and TIME because SUMO replaces it by the date.
    """
    name = (Path(name).name if Path(name).is_absolute() else name).removeprefix("sumo_")
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", name).strip("._").replace("TIME", "time")
    return folder / f"sumo_{'as_' if name in _TAKEN else ''}{name}"


def _harmless(file: Path, folder: Path, label: str) -> Path:
    """The file; if it makes SUMO write files, a copy in `folder` that makes SUMO write them there."""
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

    option: str  # of SUMO, that switches it on
    row: str  # XML element of a row
    columns: tuple[tuple[str, float, Column], ...]  # attribute, factor to the column's unit, column

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


MG = 1e-6  # a milligram [kg]
_ADDED = "sumo_outputs.add.xml"
_RAW = "sumo_{}.raw.xml"  # SUMO's own file, until the table is made of it

TABLES = {
    "trips": Table(
        "tripinfo-output",
        "tripinfo",
        (
            _text(
                "id", "vehicle_id", "vehicle; also members, for which SUMO's values are inexact: use trajectories.csv"
            ),
            _text("vType", "type", "vehicle type"),
            _text("status", "status", "'arrived', at the end 'running' or 'waiting' to depart, or 'removed' by SUMO"),
            _time("depart", "depart_s", "departure; members are inserted two steps before the time 0 of the run"),
            _time("arrival", "arrival_s", "arrival, since the platoons were placed; empty for unfinished trips"),
            _time("duration", "duration_s", "time on the road, for unfinished trips until the end"),
            _number("routeLength", "route_length_m", "m", "distance driven"),
            _time("waitingTime", "waiting_s", "time slower than 0.1 m/s, without planned stops"),
            _time("stopTime", "stop_s", "time at planned stops"),
            _time("timeLoss", "time_loss_s", "time lost by driving slower than possible"),
            _time("departDelay", "depart_delay_s", "delay of departure for want of room"),
            _number("CO2_abs", "co2_kg", "kg", "CO2 emitted", MG),
            _number("CO_abs", "co_kg", "kg", "CO emitted", MG),
            _number("HC_abs", "hc_kg", "kg", "HC emitted", MG),
            _number("NOx_abs", "nox_kg", "kg", "NOx emitted", MG),
            _number("PMx_abs", "pmx_kg", "kg", "PMx emitted", MG),
            _number("fuel_abs", "fuel_kg", "kg", "fuel used", MG),
            _number("electricity_abs", "electricity_kwh", "kWh", "electricity used", 1e-3),
        ),
    ),
    "summary": Table(
        "summary-output",
        "step",
        (
            _time("time", "time_s", "time since the platoons were placed"),
            _count("inserted", "inserted", "vehicles that have departed since SUMO's start, members included"),
            _count("running", "running", "vehicles on the road"),
            _count("waiting", "waiting", "vehicles waiting for room to depart"),
            _count("arrived", "arrived", "vehicles that have arrived since SUMO's start"),
            _count("halting", "halting", "vehicles slower than 0.1 m/s"),
            _count("teleports", "teleports", "vehicles that SUMO has teleported"),
            _time("meanWaitingTime", "waiting_mean_s", "mean delay of departure of all vehicles that have departed"),
            _time("meanTravelTime", "travel_time_mean_s", "mean travel time of all vehicles that have arrived"),
            _number("meanSpeed", "speed_mean_mps", "m/s", "mean speed of the vehicles on the road"),
            _number("meanSpeedRelative", "speed_relative_mean", "", "mean ratio of their speed to the speed limit"),
        ),
    ),
    "edges": Table(
        "",
        "edge",
        (
            _time("begin", "begin_s", "begin of the interval, since the platoons were placed"),
            _time("end", "end_s", "end of the interval, since the platoons were placed"),
            _text("id", "edge_id", "SUMO's edge; only edges with a vehicle in the interval"),
            _time("sampledSeconds", "sampled_s", "total time of vehicles on the edge, members included"),
            _time("traveltime", "travel_time_s", "mean time to drive over the edge"),
            _number("density", "density_perkm", "1/km", "vehicles per length of road"),
            _number("occupancy", "occupancy", "", "share of the lanes' length that is covered by vehicles", 0.01),
            _time("waitingTime", "waiting_s", "total time of vehicles slower than 0.1 m/s"),
            _time("timeLoss", "time_loss_s", "total time lost by driving slower than possible"),
            _number("speed", "speed_mean_mps", "m/s", "mean speed"),
            _number("flow", "flow_perh", "1/h", "vehicles per hour"),
            _count("departed", "departed", "vehicles that departed on it"),
            _count("arrived", "arrived", "vehicles that arrived on it"),
            _count(
                "entered",
                "entered",
                "vehicles that came from another edge; also members that change lanes, up to five times",
            ),
            _count("left", "left", "vehicles that went on to another edge; members as in `entered`"),
        ),
    ),
}

TABLES["signals"] = Table(
    "",
    "tlsState",
    (
        _time("time", "time_s", "time from which the light has this state; 0 for the state at the start"),
        _text("id", "signal_id", "SUMO's traffic light"),
        _text(
            "state", "state", "a letter for each link of the light: G, g green, y amber, r red, u red and amber, o off"
        ),
    ),
)

_TAKEN = [f"{name}.csv" for name in TABLES]


def write_tables(recorder: Recorder, scenario: Scenario) -> None:
    """Write the tables of `record.sumo`, such as sumo_trips.csv; to be called when SUMO is closed."""
    asked = scenario.configuration.outputs if scenario.configuration else {}
    for name in dict.fromkeys(scenario.spec.record.sumo):
        table = TABLES[name]
        own = recorder.folder / _RAW.format(name)
        file = own if own.is_file() or not table.option else _inside(recorder.folder, asked[table.option])
        rows = (_signal_rows if name == "signals" else _rows)(file, table, scenario.start)
        recorder.write_table(f"sumo_{name}.csv", rows, table.written)
        own.unlink(missing_ok=True)
    (recorder.folder / _ADDED).unlink(missing_ok=True)


def _signal_rows(file: Path, table: Table, start: float) -> Iterator[tuple]:
    """State of each light at `start`, and every one after it."""
    before: dict[str, tuple] = {}
    for _, element in ElementTree.iterparse(file) if file.is_file() else ():  # without lights SUMO writes no file
        if element.tag == table.row:
            time, light = float(element.get("time", 0)) - start, element.get("id", "")
            row = max(time, 0.0), light, element.get("state", "")
            if time <= 0:
                before[light] = row
                continue
            yield from before.values()
            before.clear()
            yield row
    yield from before.values()


def _rows(file: Path, table: Table, start: float) -> Iterator[tuple]:
    """Rows at or after `start`, in SUMO's order."""
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
        root.clear()  # frees the memory of rows that have been read
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
    """Value of a cell; None where SUMO wrote -1, which stands for no value."""
    if column.type == "string":
        return text
    number = float(text) if text else -1.0
    return None if number == -1 else int(number) if column.type == "integer" else number * scale
