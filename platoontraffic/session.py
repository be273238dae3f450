"""Runs and batches from Python, as the commands `run` and `batch` make them."""

from __future__ import annotations

import os
from numbers import Integral
from pathlib import Path

from platoontraffic import recording
from platoontraffic import scenario as scenarios
from platoontraffic.analysis import Batch, Results, load
from platoontraffic.errors import InputError, RunError
from platoontraffic.study import batch as batches
from platoontraffic.study import study as studies


def run(
    scenario: str | Path, *changes: str, seed: int | None = None, results: str | Path = "results", force: bool = False
) -> Results:
    """Run a scenario file, or a shipped scenario by its name, and load its results: tables, events, scans, the scene.

    changes : keys of the scenario to change: `key=value`
    results : folder; the run's own folder in it is `Results.folder`
    force   : repeat the run even if its results exist

    raises: InputError with one line for every fault found, RunError, MetricError
    """
    results = _folder(results)
    prepared = recording.prepare(scenarios.load(scenario, changes, seed))
    folder = recording.result_folder(prepared.scenario, results)
    if force or not recording.is_done(folder):
        recording.run(prepared, folder, replace=force)
    return load(folder)


def batch(
    study: str | Path, *changes: str, results: str | Path = "results", jobs: int | None = None, retry: bool = False
) -> Batch:
    """Run all missing runs of a study file, or of a shipped study by its name, and load its tables.

    changes : keys of the scenario to change in every run: `key=value`
    results : folder; the study's own folder in it is `Batch.folder`
    jobs    : runs at a time; default: one per processor
    retry   : repeat runs that failed before

    raises: InputError with one line for every fault found, RunError (runs failed; all others are kept)
    """
    if jobs is None:
        jobs = os.cpu_count() or 1
    elif not isinstance(jobs, Integral) or jobs < 1:
        raise InputError(f"jobs: {jobs!r}: must be a whole number, 1 or more")
    results = _folder(results)
    loaded = studies.load(study, changes)
    folder = results / loaded.name
    report = batches.run(loaded, folder, slots=int(jobs), retry_failed=retry)
    if report.failures:
        first = next(iter(report.failures.items()))
        raise RunError(f"{folder}: {len(report.failures)} of {len(loaded.runs)} runs failed; {first[0]}: {first[1]}")
    return load(folder)


def _folder(results: str | Path) -> Path:
    """raises: InputError if it is no name of a folder"""
    if not isinstance(results, str | Path):
        raise InputError(f"results: {results!r}: must be a folder")
    return Path(results)
