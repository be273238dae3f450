"""The files of a run that are made of its complete tables: metrics, summary, data dictionary, scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import shapely

from platoontraffic.errors import InputError
from platoontraffic.lidar import Scene
from platoontraffic.observation.encounters import Encounters
from platoontraffic.results import flows, metrics, plug_in_metrics, sumo_tables
from platoontraffic.results.columns import ENCOUNTERS, METRICS, TRIPS, Column, integer, text
from platoontraffic.results.data_package import data_package
from platoontraffic.results.metrics import Value
from platoontraffic.results.recorder import Recorder
from platoontraffic.road.network import Network
from platoontraffic.scenario import Scenario
from platoontraffic.world.fleet import Member
from platoontraffic.world.trips import Trip

TYPES = {str: "string", int: "integer", float: "number", bool: "boolean"}  # of varied values, in datapackage.json


class MetricError(InputError):
    """Metrics of plug-ins failed; every other file of the run is complete."""


def conclude(
    recorder: Recorder,
    scenario: Scenario,
    members: Sequence[Member],
    obstacles: Sequence[str],
    encounters: Encounters,
    trips: Sequence[Trip],
    waits: Mapping[str, float],
) -> None:
    """Write these files; to be called when SUMO is closed.

    members, obstacles : all that the run ever had, the latter by id
    trips              : of members from the traffic
    waits              : of vehicles, for others of their platoons [s]
    raises             : MetricError
    """
    spec = scenario.spec
    recorder.close_tables()
    sumo_tables.write_tables(recorder, scenario)
    if obstacles:
        recorder.write_table("encounters.csv", encounters.rows(), ENCOUNTERS)
    with_trips = bool(spec.equip) and "trips" in spec.record.sumo
    if with_trips:
        others = _trips_of_others(recorder, members, obstacles)
        recorder.write_table("trips.csv", all_trips(trips, others, _end(recorder), waits), TRIPS)
    values = _values(recorder, scenario, members, obstacles, with_trips)
    of_plug_ins, faults = _of_plug_ins(recorder, scenario)
    values += of_plug_ins
    recorder.write_table("metrics.csv", values, METRICS)
    recorder.write_vehicles(members)
    recorder.write("summary.csv", metrics.summary(spec.name, spec.seed, scenario.varied, values))
    package = data_package(
        spec.name,
        spec.title,
        traffic=spec.record.traffic_every_s is not None,
        scans=spec.record.scans_every_s is not None,
        encounters=bool(obstacles),
        trips=with_trips,
        passages=bool(spec.record.passages),
        sumo=spec.record.sumo,
        metrics=_meanings(values, scenario),
        summary=_summary_columns(values, scenario),
    )
    for resource in package["resources"]:  # by which a reader knows a damaged file
        resource["bytes"] = (recorder.folder / resource["path"]).stat().st_size
    recorder.write_json("datapackage.json", package)
    if faults:
        raise MetricError(*faults)


def scene(static: Scene, network: Network) -> dict[str, Any]:
    """The road and what stands beside it as GeoJSON, in the network's metres: the ground of all pictures."""
    walls = static.segments.reshape(-1, 2, 2)
    parts = {
        "road": network.drivable,
        "junctions": shapely.MultiPolygon(network.junctions()),
        "lanes": shapely.MultiLineString(network.lane_borders()),
        "middle": shapely.MultiLineString(network.middle_lines()),
        "walls": shapely.MultiLineString(list(walls)),
        "buildings": static.solids or shapely.MultiPolygon(),
    }
    signals = network.signal_lines()
    parts["signals"] = shapely.MultiLineString([line for line, _, _ in signals])
    more = {"signals": {"links": [(light, number) for _, light, number in signals]}}
    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {"kind": kind, **more.get(kind, {})},
                "geometry": shapely.geometry.mapping(shape),
            }
            for kind, shape in parts.items()
        ],
    }


def _end(recorder: Recorder) -> float:
    """End of the run [s]."""
    events = recorder.read_table("events")
    return float(events.loc[events.kind == "end", "time_s"].iloc[0])


def _trips_of_others(recorder: Recorder, members: Sequence[Member], obstacles: Sequence[str]) -> pd.DataFrame:
    """The rows of sumo_trips.csv without members and obstacles: SUMO knows too little about them."""
    table = recorder.read_table("sumo_trips")
    return table[~table.vehicle_id.isin([*(m.id for m in members), *obstacles])]


def all_trips(trips: Sequence[Trip], others: pd.DataFrame, end: float, waits: Mapping[str, float]) -> list[tuple]:
    """The rows of trips.csv by departure: trips of members from the traffic, and of others by the table sumo_trips.

    end   : of the run [s]
    waits : of vehicles, for others of their platoons [s]; those of members are in their trips
    """
    waited = [waits.get(vehicle, 0.0) for vehicle in others.vehicle_id]
    others = others.assign(depart_delay_s=others.depart_delay_s + waited)
    rows = []
    for trip in trips:
        over = trip.ended if trip.status != "running" else end
        arrival = trip.ended if trip.status == "arrived" else None
        own = trip.distance, trip.waiting, trip.time_loss, trip.depart_delay, trip.co2, trip.fuel
        rows.append((trip.vehicle, trip.type, 1, trip.status, trip.departed, arrival, over - trip.departed, *own))
    names = [column.name for column in TRIPS if column.name != "member"]
    for row in others[names].astype(object).where(others[names].notna(), None).itertuples(index=False):
        rows.append((*row[:2], 0, *row[2:]))
    return sorted(rows, key=lambda row: (row[4] is None, row[4] or 0.0, row[0]))


def _values(
    recorder: Recorder, scenario: Scenario, members: Sequence[Member], obstacles: Sequence[str], with_trips: bool
) -> list[Value]:
    """The tool's own metrics."""
    spec = scenario.spec
    loops = {p.id for p in spec.platoon if p.loop or spec.run.laps} | {m.platoon for m in members if m.route is None}
    tables = (recorder.read_table(name, object) for name in ("trajectories", "events", "statistics"))
    values = metrics.compute(*tables, loops)
    if "trips" in spec.record.sumo:
        values += metrics.of_trips("traffic", _trips_of_others(recorder, members, obstacles))
    if with_trips:
        trips = recorder.read_table("trips")
        values += [*metrics.of_trips("everybody", trips), *metrics.of_trips("equipped", trips[trips.member == 1])]
    if spec.record.passages:
        values += flows.of_passages(recorder.read_table("passages"), spec.record.passages, _end(recorder))
    if obstacles:
        values += metrics.of_obstacles(recorder.read_table("encounters"), recorder.read_table("events"))
    return values


def _of_plug_ins(recorder: Recorder, scenario: Scenario) -> tuple[list[Value], list[str]]:
    """Values of the scenario's own metrics, and the faults of those that failed."""
    values: list[Value] = []
    faults: list[str] = []
    for plug_in in scenario.metrics.metrics:
        try:
            values += plug_in_metrics.compute(
                plug_in, recorder.read_table("trajectories"), recorder.read_table("events")
            )
        except InputError as error:
            faults += error.faults
    return values, faults


def _summary_columns(values: Sequence[Value], scenario: Scenario) -> list[Column]:
    """The columns of summary.csv; a varied value is what it is in the scenario: a platoon may be called 007."""
    return [
        text("scenario", "name of the scenario"),
        integer("seed", "seed of the run"),
        *(
            Column(key, TYPES.get(type(value), "any"), "", "key of the scenario")
            for key, value in scenario.varied.items()
        ),
        *(_summary_column(one) for one in values if one.scope in ("run", *metrics.OF_TRIPS)),
    ]


def _summary_column(of: Value) -> Column:
    name = metrics.column(of.scope, of.name, of.unit)
    type = "integer" if name in metrics.INTEGERS else "number"
    return Column(name, type, of.unit, f"metric {of.name} of scope {of.scope}")


def _meanings(values: Sequence[Value], scenario: Scenario) -> dict[str, dict[str, str]]:
    """Scope -> metric -> meaning, of the metrics that the run has."""
    known, brought = metrics.meanings(), plug_in_metrics.meanings(scenario.metrics.metrics)
    known["everybody"] |= flows.meanings(scenario.spec.record.passages)
    there: dict[str, dict[str, str]] = {}
    for one in values:
        of_scope = known[one.scope] | brought.get(one.scope, {})
        there.setdefault(one.scope, {})[one.name] = of_scope[one.name]
    return there
