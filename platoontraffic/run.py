"""A run: a simulation that is recorded, from a prepared scenario to a folder of results."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pandas as pd
import shapely
import tomli_w

from platoontraffic.errors import InputError, MissingError, RunError
from platoontraffic.observation.encounters import Encounters
from platoontraffic.results import metrics, provenance, sumo_tables
from platoontraffic.results import recorder as recording
from platoontraffic.results.recorder import Recorder, is_done
from platoontraffic.scenario import Scenario
from platoontraffic.simulation import Instant, Prepared, Simulation, prepare, setting_of, steps_of
from platoontraffic.sumo.window import Window
from platoontraffic.world.events import Event

__all__ = ["Watcher", "Window", "is_done", "prepare", "result_folder", "run"]

FLUSH_PERIOD = 10.0  # recorded rows are flushed to disk after as much simulated time [s]


class Watcher(Protocol):
    """Something that shows a run while it lasts."""

    def show(self, instant: Instant) -> None: ...


class WindowWatcher:
    """Draws each instant in sumo-gui: what members see, from where they will be at the end of the coming step."""

    def __init__(self, window: Window, dt: float) -> None:
        self._window, self._dt = window, dt

    def show(self, instant: Instant) -> None:
        if not instant.ended:
            self._window.show(instant.fleet.moved(self._dt), instant.scans)


def result_folder(scenario: Scenario, results: Path) -> Path:
    return results / scenario.spec.name / provenance.run_id(scenario)


def run(
    prepared: Prepared,
    folder: Path,
    watchers: Sequence[Watcher] = (),
    *,
    replace: bool = False,
    window: Window | None = None,
) -> Path:
    """Simulate, and leave everything in `folder`; returns it.

    replace : replace the results of an equal run, which stay in place until these are complete
    window  : SUMO with a window, in place of the SUMO in this process

    raises: RunError (SUMO or the disk failed), KeyboardInterrupt: what was recorded is kept in `<folder>.unfinished`;
            InputError (a plug-in failed), MissingError (no display): nothing is kept
    """
    record = prepared.scenario.spec.record
    recorder = Recorder(folder, traffic=record.traffic_every_s is not None, scans=record.scans_every_s is not None)
    try:
        _record(prepared, recorder, watchers, window)
        return recorder.finish(replace)
    except (InputError, MissingError):
        recorder.discard()
        raise
    except (Exception, KeyboardInterrupt) as error:
        kept = recorder.keep_unfinished()
        if isinstance(error, OSError):
            raise RunError(f"{kept}: {error.strerror}; what was recorded until then is kept there") from error
        error.add_note(f"what was recorded until then is kept in {kept}")
        raise


def _record(prepared: Prepared, recorder: Recorder, watchers: Sequence[Watcher], window: Window | None) -> None:
    scenario = prepared.scenario
    facts = provenance.provenance(scenario)
    recorder.write("config.toml", tomli_w.dumps(scenario.resolved(recorder.folder)))
    recorder.write("provenance.json", recording.as_json(facts))
    setting = setting_of(prepared, recorder.folder, window)
    if window:
        watchers = [*watchers, WindowWatcher(window, setting.dt)]
    began = time.perf_counter()
    with Simulation(setting) as simulation:
        clocks = Clocks(scenario, setting.dt)
        record = simulation.stopwatch("record", clocks.record)
        show = simulation.stopwatch("show", _show)
        for instant in simulation:
            record(recorder, instant)
            show(watchers, instant)
        wall, outcome = time.perf_counter() - began, simulation.outcome
    nowhere = np.nan, np.nan, "", np.nan
    recorder.note(
        Event(outcome.time, "never_departed", m.id, "", *nowhere, "no room until the end")
        for m in outcome.never_departed
    )
    recorder.note([Event(outcome.time, "end", "", "", *nowhere, outcome.ended)])
    facts["status"] = "finished"
    facts["simulated_s"] = outcome.time
    facts["wall_s"] = round(wall, 3)
    facts["real_time_factor"] = round(outcome.time / wall, 2)
    facts["stage_s"] = {stage: round(seconds, 3) for stage, seconds in simulation.stopwatch.seconds.items()}
    facts["sumo_words"] = (recorder.folder / "run.log").read_text(errors="replace").splitlines()[:100]
    _conclude(prepared, recorder, facts, simulation.encounters)


def _show(watchers: Sequence[Watcher], instant: Instant) -> None:
    for watcher in watchers:
        watcher.show(instant)


class Clocks:
    """When each table gets its rows, in steps."""

    def __init__(self, scenario: Scenario, dt: float) -> None:
        record = scenario.spec.record
        self._trajectories, self._flush = round(record.every_s / dt), round(FLUSH_PERIOD / dt)
        self._traffic, self._scans = steps_of(record.traffic_every_s, dt), steps_of(record.scans_every_s, dt)

    def record(self, recorder: Recorder, instant: Instant) -> None:
        step, traffic, fleet = instant.step, instant.traffic, instant.fleet
        recorder.note(instant.events)
        if step % self._trajectories == 0:
            recorder.record(traffic, fleet, instant.measures, instant.roads)
        if self._traffic and step % self._traffic == 0:
            recorder.record_traffic(traffic, len(fleet))
        if self._scans:
            recorder.scans.record(step, self._scans, traffic, fleet, instant.scans)
        if step % self._flush == 0:
            recorder.flush()


def _conclude(prepared: Prepared, recorder: Recorder, facts: dict, encounters: Encounters) -> None:
    """The files that are made of the whole run."""
    scenario, spec = prepared.scenario, prepared.scenario.spec
    recorder.close_tables()
    values = metrics.compute(*(pd.read_csv(recorder.folder / f"{t}.csv") for t in ("trajectories", "events")))
    sumo_tables.write_tables(recorder, scenario)
    if "trips" in spec.record.sumo:
        trips = sumo_tables.read_trips(recorder.folder)
        others = {m.id for m in prepared.members} | {plan.id for plan in prepared.obstacles}
        of_traffic = sumo_tables.traffic_metrics(trips, others)
        values += [metrics.Metric("traffic", "", "", *metric) for metric in of_traffic]
    if prepared.obstacles:
        recorder.write_table("encounters.csv", encounters.rows(), recording.ENCOUNTERS)
        values += metrics.of_obstacles(*(pd.read_csv(recorder.folder / f"{t}.csv") for t in ("encounters", "events")))
    recorder.write_table("metrics.csv", values, recording.METRICS)
    recorder.write_vehicles(prepared.members)
    recorder.write("summary.csv", metrics.summary(spec.name, spec.seed, scenario.varied, values))
    recorder.write("scene.geojson", recording.as_json(_scene(prepared)))
    recorded = {
        "traffic": spec.record.traffic_every_s is not None,
        "encounters": bool(prepared.obstacles),
        "scans": spec.record.scans_every_s is not None,
    }
    package = recording.datapackage(spec.name, spec.title, **recorded)
    described = next(resource for resource in package["resources"] if resource["name"] == "metrics")
    described["metrics"] = meanings = {}
    for m in values:
        of_traffic = m.scope == "traffic"
        meanings.setdefault(m.scope, {})[m.name] = (
            sumo_tables.MEANINGS[m.name] if of_traffic else metrics.meaning(m.name)
        )
    package["resources"] += sumo_tables.resources(spec.record.sumo)
    recorder.write("datapackage.json", recording.as_json(package))
    facts["sumo_options_ignored"] = list(scenario.configuration.ignored) if scenario.configuration else []
    recorder.write("provenance.json", recording.as_json(facts))


def _scene(prepared: Prepared) -> dict:
    """The road and what stands beside it as GeoJSON, in the network's metres: what pictures are drawn on."""
    walls, network = prepared.scene.segments.reshape(-1, 2, 2), prepared.network
    parts = {
        "road": network.drivable,
        "junctions": shapely.MultiPolygon(network.junctions()),
        "lanes": shapely.MultiLineString(network.lane_borders()),
        "middle": shapely.MultiLineString(network.middle_lines()),
        "walls": shapely.MultiLineString(list(walls)),
        "buildings": prepared.scene.solids or shapely.MultiPolygon(),
    }
    return {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": {"kind": kind}, "geometry": shapely.geometry.mapping(shape)}
            for kind, shape in parts.items()
        ],
    }
