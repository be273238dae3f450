"""datapackage.json: a Frictionless data package with the unit and meaning of every column of a run's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from platoontraffic.results.columns import (
    ENCOUNTERS,
    EVENTS,
    METRICS,
    PASSAGES,
    SCENE,
    STATISTICS,
    TRAFFIC,
    TRAJECTORIES,
    TRIPS,
    VEHICLES,
    Column,
)
from platoontraffic.results.scans import FIELDS, NAME
from platoontraffic.results.statistics import QUANTITIES
from platoontraffic.results.sumo_tables import TABLES
from platoontraffic.world.events import KINDS

TEXTS = (
    "Fields of type string are text, whatever it looks like, and are missing only where the cell is empty. An id of "
    "SUMO may begin with =, +, - or @: in a spreadsheet, import such fields as text, or they are formulas."
)
SUMMARY = "one row: the run, its varied values, and every metric of the run as <metric>_<unit>"


def data_package(
    name: str,
    title: str,
    *,
    traffic: bool = False,
    scans: bool = False,
    encounters: bool = False,
    trips: bool = False,
    passages: bool = False,
    sumo: Sequence[str] = (),
    metrics: Mapping[str, Mapping[str, str]] | None = None,
    summary: Sequence[Column] = (),
) -> dict[str, Any]:
    """The package of a run.

    traffic, scans, encounters, trips, passages : whether the run has these
    sumo                       : names of SUMO's tables that it has
    metrics                    : scope -> metric -> meaning, of the metrics that it has
    summary                    : columns of summary.csv
    """
    resources = [
        _table("trajectories", TRAJECTORIES),
        _table("events", EVENTS, kinds=KINDS),
        _table("metrics", METRICS, metrics=metrics or {}),
        _table("statistics", STATISTICS, quantities=_quantities()),
        _table("vehicles", VEHICLES),
        *([_table("traffic", TRAFFIC)] if traffic else []),
        *([_table("encounters", ENCOUNTERS)] if encounters else []),
        *([_table("trips", TRIPS)] if trips else []),
        *([_table("passages", PASSAGES)] if passages else []),
        _table("summary", summary, description=SUMMARY),
        {"name": "scene", "path": "scene.geojson", "description": SCENE},
        *([_scans()] if scans else []),
        *(_table(f"sumo_{table}", TABLES[table].written) for table in dict.fromkeys(sumo)),
    ]
    return {"name": name.lower(), "title": title or name, "description": TEXTS, "resources": resources}


def _table(name: str, columns: Sequence[Column], **more: Any) -> dict[str, Any]:
    fields = [{"name": c.name, "type": c.type, "unit": c.unit, "description": c.meaning} for c in columns]
    schema = {"fields": fields, "missingValues": [""]}
    return {"name": name, "path": f"{name}.csv", "format": "csv", "schema": schema, **more}


def _quantities() -> dict[str, dict[str, str]]:
    meanings = {column.name: column.meaning for column in TRAJECTORIES}
    return {one.name: {"unit": one.unit, "description": one.meaning or meanings[one.name]} for one in QUANTITIES}


def _scans() -> dict[str, Any]:
    arrays = [{"name": name, "unit": unit, "description": meaning} for name, (unit, meaning) in FIELDS.items()]
    return {"name": "scans", "path": NAME, "description": "a NumPy archive of arrays", "arrays": arrays}
