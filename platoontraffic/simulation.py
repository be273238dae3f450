"""A run, from a checked scenario to a folder of results. The loop in `simulate` is the table of contents."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import shapely
import tomli_w

from lidar import Scene
from platoontraffic import metrics, provenance, recording
from platoontraffic.contact import Contacts
from platoontraffic.deployment import deploy, static_scene
from platoontraffic.errors import InputError, RunError
from platoontraffic.fleet import Fleet, Member
from platoontraffic.network import Network, writes_files
from platoontraffic.observation import Event, Observer
from platoontraffic.recording import Recorder
from platoontraffic.scenario import Scenario
from platoontraffic.sensing import Sensing
from platoontraffic.sumo import World

Progress = Callable[[float], None]  # told the simulated time [s] now and then
SAFE_EVERY = 10.0  # what was recorded is flushed to disk every so many simulated seconds


@dataclass(frozen=True)
class Prepared:
    """A scenario with its road read and its members placed: all that can be wrong with the input has been seen."""

    scenario: Scenario
    network: Network
    scene: Scene
    members: tuple[Member, ...]


def prepare(scenario: Scenario) -> Prepared:
    """raises: InputError"""
    network = Network.read(scenario.net)
    scene = static_scene(scenario, network)
    return Prepared(scenario, network, scene, deploy(scenario, network, scene))


def result_folder(scenario: Scenario, results: Path) -> Path:
    return results / scenario.spec.name / provenance.run_id(scenario)


def simulate(prepared: Prepared, folder: Path, progress: Progress = lambda time: None, replace: bool = False) -> Path:
    """Run, and leave everything in `folder`; returns it.

    replace: put the results in the place of an equal run's, which is there until then

    raises: RunError (SUMO or the disk failed), KeyboardInterrupt: what was recorded is kept in `<folder>.unfinished`;
            InputError (a plug-in failed): nothing is kept
    """
    recorder = Recorder(folder)
    try:
        _simulate(prepared, recorder, progress)
        return recorder.finish(replace)
    except InputError:
        recorder.discard()
        raise
    except (Exception, KeyboardInterrupt) as error:
        kept = recorder.keep_unfinished()
        if isinstance(error, OSError):
            raise RunError(f"{kept}: {error.strerror}; what was recorded until then is kept there") from error
        error.add_note(f"what was recorded until then is kept in {kept}")
        raise


def _simulate(prepared: Prepared, recorder: Recorder, progress: Progress) -> None:
    scenario, network = prepared.scenario, prepared.network
    run, record = scenario.spec.run, scenario.spec.record
    dt = run.step_s
    facts = provenance.provenance(scenario)
    recorder.write("config.toml", tomli_w.dumps(scenario.resolved(recorder.folder)))
    recorder.write("provenance.json", recording.as_json(facts))
    fleet = Fleet.deployed(prepared.members, dt)
    world = World(
        network,
        dt,
        scenario.seed,
        recorder.folder / "run.log",
        scenario.routes,
        _additional(scenario, recorder.folder),
        scenario.config.path if scenario.config else None,
        _outputs(scenario, recorder.folder),
        scenario.spec.sumo.warm_up_s,
    )
    sensing = Sensing(prepared.scene, scenario.spec.scene.lidar_engine, scenario.seed)
    observer = Observer(fleet, network, Contacts(prepared.scene, {m.id for m in prepared.members}))
    steps = round(run.duration_s / dt)
    record_every = round(record.every_s / dt)
    safe_every = round(SAFE_EVERY / dt)

    watch = provenance.Stopwatch()
    read, scan = watch("read", world.snapshot), watch("scan", sensing.scan)
    observe, measure = watch("observe", observer.watch), watch("measure", observer.measure)
    write, place, advance = watch("record", recorder.record), watch("place", world.place), watch("step", world.advance)
    decide, move = watch("decide", Fleet.decided), watch("move", Fleet.moved)

    began = time.perf_counter()
    with world:
        fleet = world.deploy(fleet)
        ended = "duration"
        for step in range(steps + 1):
            traffic = read(fleet)
            scans = scan(traffic, fleet, step)
            fleet = decide(fleet, scans, dt)
            roads = world.roads(fleet)
            recorder.note(observe(traffic, fleet, scans, roads))
            if step % record_every == 0:
                write(traffic, fleet, measure(fleet), roads)
            if step % safe_every == 0:
                recorder.flush()
                progress(traffic.time)
            if run.laps and (np.abs(fleet.motion.turned) >= 2 * np.pi * run.laps).all():
                ended = "laps"
            if step == steps or ended == "laps":
                break
            fleet = move(fleet, dt)
            place(fleet)
            fleet = advance(fleet)
            if world.arrived:  # SUMO has them no more
                ended = "arrived"
                break
    wall = time.perf_counter() - began
    recorder.note([Event(traffic.time, "end", "", "", np.nan, np.nan, "", np.nan, ended)])
    facts["status"] = "finished"
    facts["simulated_s"] = traffic.time
    facts["wall_s"] = round(wall, 3)
    facts["real_time_factor"] = round(traffic.time / wall, 2)
    facts["stage_s"] = {stage: round(seconds, 3) for stage, seconds in watch.seconds.items()}
    facts["sumo_words"] = (recorder.folder / "run.log").read_text(errors="replace").splitlines()[:100]
    _conclude(prepared, recorder, facts)


def _additional(scenario: Scenario, folder: Path) -> list[Path]:
    """What SUMO is to load. What writes files does so beside itself: it is copied into the run's folder."""
    files = []
    for i, file in enumerate(scenario.additional):
        if file.name.endswith(".poly.xml"):  # for laser and eye; SUMO has no use for polygons
            continue
        if writes_files(file):
            file = shutil.copy(file, folder / f"sumo_{i}_{file.name}")
        files.append(Path(file))
    return files


def _outputs(scenario: Scenario, folder: Path) -> dict[str, Path]:
    """Output files that a SUMO configuration asks for come into the run's folder."""
    wanted = scenario.config.outputs if scenario.config else {}
    return {option: folder / f"sumo_{Path(name).name}" for option, name in wanted.items()}


def _conclude(prepared: Prepared, recorder: Recorder, facts: dict) -> None:
    """The files that are made of the whole run."""
    scenario, spec = prepared.scenario, prepared.scenario.spec
    recorder.close_tables()
    values = metrics.compute(*(pd.read_csv(recorder.folder / f"{t}.csv") for t in ("trajectories", "events")))
    recorder.write_table("metrics.csv", values, recording.METRICS)
    recorder.write("summary.csv", metrics.summary(spec.name, spec.seed, scenario.varied, values))
    recorder.write("scene.geojson", recording.as_json(_scene(prepared)))
    recorder.write("datapackage.json", recording.as_json(recording.datapackage(spec.name, spec.title)))
    recorder.write("provenance.json", recording.as_json(facts))


def _scene(prepared: Prepared) -> dict:
    """Road, middle lines and walls as GeoJSON, in the network's metres: what pictures are drawn on."""
    walls = prepared.scene.segments.reshape(-1, 2, 2)
    parts = {
        "road": prepared.network.drivable,
        "middle": shapely.MultiLineString(prepared.network.middle_lines()),
        "walls": shapely.MultiLineString(list(walls)),
    }
    return {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": {"kind": kind}, "geometry": shapely.geometry.mapping(shape)}
            for kind, shape in parts.items()
        ],
    }
