"""The tables of a batch, over all its runs: runs.csv, summary.csv, datapackage.json."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from platoontraffic.errors import InputError
from platoontraffic.results.metrics import COUNTS, INTEGERS, column
from platoontraffic.results.recorder import as_json
from platoontraffic.scenario import Spec
from platoontraffic.study.batch_folder import DONE, FAILED, WAITING, failure, read_json, replacing, state
from platoontraffic.study.folder_lock import TABLES, Lock
from platoontraffic.study.study import Run, Study


def write_tables(study: Study, folder: Path, lock: Lock, patience: float) -> None:
    """Write the tables of the folder's present state, in the order of the study, not in that of the runs' ends.

    patience: longest wait for another shard that writes them [s]. The shard that writes last must also read last, so a
              shard reads the states only while it holds the lock
    """
    until = time.monotonic() + patience
    while not lock.take(TABLES, 1):
        if time.monotonic() > until:
            return
        time.sleep(0.1)
    try:
        states = {run.id: state(folder, run.id) for run in study.runs}
        done = [run for run in study.runs if states[run.id] == DONE]
        metrics = list(dict.fromkeys(name for run in done for name in _metrics(folder / run.id)))
        _write_runs(study, folder, states)
        _write_summary(study, folder, done, metrics)
        units = _units(folder / done[0].id) if done else {}
        with replacing(folder / "datapackage.json") as file:
            file.write(as_json(_data_package(study, metrics, units)))
    finally:
        lock.release(TABLES, 1)


def lost_rows(study: Study, folder: Path) -> int:
    """Number of ended runs in the folder's runs.csv that a study does not have, so that its tables lose them."""
    file = folder / "runs.csv"
    if not file.is_file():
        return 0
    ids = {run.id for run in study.runs}
    with file.open(encoding="utf-8", errors="replace", newline="") as opened:
        return sum(row.get("status") in (DONE, FAILED) and row.get("id") not in ids for row in csv.DictReader(opened))


def _write_runs(study: Study, folder: Path, states: dict[str, str]) -> None:
    with replacing(folder / "runs.csv") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["id", "status", "seed", *study.keys, "error", "wall_s"])
        for run in study.runs:
            error, wall = "", ""
            if states[run.id] == DONE:
                wall = read_json(folder / run.id / "provenance.json").get("wall_s", "")
            elif states[run.id] == FAILED:
                failed = failure(folder, run.id)
                error, wall = failed["error"], failed.get("wall_s", "")
            rows.writerow([run.id, states[run.id], run.seed, *map(_cell, run.values.values()), error, wall])


def _write_summary(study: Study, folder: Path, done: Sequence[Run], metrics: Sequence[str]) -> None:
    with replacing(folder / "summary.csv") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["id", "seed", *study.keys, *metrics])
        for run in done:
            values = _metrics(folder / run.id)
            given = [values.get(name, "") for name in metrics]
            rows.writerow([run.id, run.seed, *map(_cell, run.values.values()), *given])


def _metrics(run_folder: Path) -> dict[str, str]:
    """Column -> value of a run's summary.csv, without the columns of the scenario. raises: InputError"""
    file = run_folder / "summary.csv"
    try:
        names, values = csv.reader(io.StringIO(file.read_text(encoding="utf-8"), newline=""))
        row = zip(names, values, strict=True)
    except (OSError, ValueError):
        raise InputError(f"{file}: is missing or damaged; remove {run_folder} to repeat the run") from None
    own = {"scenario", *Spec.model_fields}
    return {name: value for name, value in row if name.partition(".")[0] not in own}  # edges may have dots


def _units(run_folder: Path) -> dict[str, str]:
    """Unit of each column of metrics."""
    with (run_folder / "metrics.csv").open(encoding="utf-8", newline="") as file:
        return {column(row["scope"], row["metric"], row["unit"]): row["unit"] for row in csv.DictReader(file)}


def _data_package(study: Study, metrics: Sequence[str], units: dict[str, str]) -> dict[str, Any]:
    def field(name: str, type: str, meaning: str, unit: str = "") -> dict[str, str]:
        return {"name": name, "type": type, "unit": unit, "description": meaning}

    run = field("id", "string", "id of the run, and name of its folder")
    seed = field("seed", "integer", "seed of the run")
    texts = {key for run in study.runs for key, value in run.values.items() if isinstance(value, str)}
    varied = [field(key, "string" if key in texts else "any", "key of the scenario") for key in study.keys]
    status = field("status", "string", f"{DONE}, {FAILED} or {WAITING}")
    error = field("error", "string", "cause of the failure; empty otherwise")
    wall = field("wall_s", "number", "wall time of the run", "s")
    meaning = "metric; its meaning is in the runs' datapackage.json"
    values = [
        field(name, "integer" if name in INTEGERS else "number", meaning, units.get(name, ""))
        | ({"statistic": "count"} if name in COUNTS else {})
        for name in metrics
    ]
    tables = {"runs": [run, status, seed, *varied, error, wall], "summary": [run, seed, *varied, *values]}
    resources = [
        {"name": name, "path": f"{name}.csv", "format": "csv", "schema": {"fields": fields, "missingValues": [""]}}
        for name, fields in tables.items()
    ]
    return {"name": study.name.lower(), "title": study.table["title"] or study.name, "resources": resources}


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value
