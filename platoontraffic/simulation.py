"""A run, from a checked scenario to a folder of results. The loop in `simulate` is the table of contents."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import shapely
import tomli_w

from platoontraffic.errors import InputError, MissingError, RunError
from platoontraffic.lidar import Scene
from platoontraffic.observation.encounters import Encounters
from platoontraffic.observation.observer import Observer
from platoontraffic.results import metrics, provenance, sumo_tables
from platoontraffic.results import recorder as recording
from platoontraffic.results.recorder import Recorder
from platoontraffic.road.network import Network
from platoontraffic.scenario import Run, Scenario
from platoontraffic.sumo.window import Window
from platoontraffic.sumo.world import World
from platoontraffic.world import manoeuvres, obstacles
from platoontraffic.world.breakdowns import Breakdowns
from platoontraffic.world.contact import Contacts
from platoontraffic.world.deployment import deploy, static_scene
from platoontraffic.world.events import Event
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.obstacles import Obstacles, Plan
from platoontraffic.world.sensing import Sensing

Progress = Callable[[float], None]  # told the simulated time [s] now and then
SAFE_EVERY = 10.0  # what was recorded is flushed to disk every so many simulated seconds


@dataclass(frozen=True)
class Prepared:
    """A scenario with its road read and its members placed: all that can be wrong with the input has been seen."""

    scenario: Scenario
    network: Network
    scene: Scene
    members: tuple[Member, ...]
    obstacles: tuple[Plan, ...] = ()
    orders: tuple[manoeuvres.Order, ...] = ()


def prepare(scenario: Scenario) -> Prepared:
    """raises: InputError"""
    network = Network.read(scenario.net)
    # In large networks these take seconds, which are not the loop's.
    network.middle_lines()
    network.entered_from  # noqa: B018
    scene = static_scene(scenario, network)
    members = deploy(scenario, network, scene)
    plans = obstacles.plans_of(scenario, network, members)
    return Prepared(scenario, network, scene, members, plans, manoeuvres.orders(scenario, network, members))


def result_folder(scenario: Scenario, results: Path) -> Path:
    return results / scenario.spec.name / provenance.run_id(scenario)


def simulate(
    prepared: Prepared,
    folder: Path,
    progress: Progress = lambda time: None,
    replace: bool = False,
    window: Window | None = None,
) -> Path:
    """Run, and leave everything in `folder`; returns it.

    replace: put the results in the place of an equal run's, which is there until then
    window : to watch it in

    raises: RunError (SUMO or the disk failed), KeyboardInterrupt: what was recorded is kept in `<folder>.unfinished`;
            InputError (a plug-in failed), MissingError (no display): nothing is kept
    """
    record = prepared.scenario.spec.record
    recorder = Recorder(folder, traffic=record.traffic_every_s is not None, scans=record.scans_every_s is not None)
    try:
        _simulate(prepared, recorder, progress, window)
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


def _simulate(prepared: Prepared, recorder: Recorder, progress: Progress, window: Window | None) -> None:
    scenario, network = prepared.scenario, prepared.network
    run, record = scenario.spec.run, scenario.spec.record
    dt = run.step_s
    facts = provenance.provenance(scenario)
    recorder.write("config.toml", tomli_w.dumps(scenario.resolved(recorder.folder)))
    recorder.write("provenance.json", recording.as_json(facts))
    fleet, later = _departures(prepared.members, dt)
    world = World(
        network,
        dt,
        scenario.seed,
        recorder.folder / "run.log",
        sumo_tables.sumo_options(scenario, recorder.folder),
        scenario.spec.sumo.warm_up_s,
        window,
    )
    sensing = Sensing(prepared.scene, scenario.spec.scene.lidar_engine, scenario.seed)
    observer = Observer(prepared.members, network, Contacts(prepared.scene, {m.id for m in prepared.members}))
    steps = round(run.duration_s / dt)
    record_every = round(record.every_s / dt)
    traffic_every = round((record.traffic_every_s or 1.0) / dt)
    scans_every = round((record.scans_every_s or 1.0) / dt)
    safe_every = round(SAFE_EVERY / dt)

    watch = provenance.Stopwatch()
    read, signals, scan = watch("read", world.snapshot), watch("signals", world.signals), watch("scan", sensing.scan)
    odometry = watch("odometry", sensing.odometry)
    observe, measure = watch("observe", observer.observe), watch("measure", observer.measure)
    write, place, advance = watch("record", recorder.record), watch("place", world.place), watch("step", world.advance)
    decide, move = watch("decide", Fleet.decided), watch("move", Fleet.moved)
    show = watch("show", window.show) if window else lambda fleet, scans: None

    ways = {plan.id: plan.edges for plan in prepared.obstacles if plan.seen_by_sumo}

    began = time.perf_counter()
    with world:
        fleet = world.deploy(fleet, later)
        others = Obstacles(prepared.obstacles, fleet)
        encounters = Encounters(others, prepared.members)
        orders = manoeuvres.Manoeuvres(prepared.orders)
        breakdowns = Breakdowns(scenario.spec.breakdown)
        world.hold(others.bodies, ways)
        for step in range(steps + 1):
            whole = record.traffic_every_s is not None and step % traffic_every == 0
            traffic = read(fleet, np.inf if whole else fleet.sight)
            broken = breakdowns.due(fleet, traffic.time)
            scans = breakdowns.blinded(scan(traffic, fleet, step), fleet)
            fleet, told = orders.applied(fleet, traffic.time)
            lines = signals(fleet)
            fleet = decide(fleet, scans, dt, lines, odometry(fleet, step))
            roads = world.roads(fleet)
            noted = [*told, *broken, *world.violations(fleet)]
            events = observe(traffic, fleet, scans, roads, lines, noted)
            recorder.note([*events, *encounters.observe(traffic, fleet, events)])
            if step % record_every == 0:
                write(traffic, fleet, measure(fleet), roads)
            if whole:
                recorder.record_traffic(traffic, len(fleet))
            if recorder.scans:
                recorder.scans.record(step, scans_every, traffic, fleet, scans)
            if step % safe_every == 0:
                recorder.flush()
                progress(traffic.time)
            if ended := _ended(run, fleet, world.waiting, step == steps):
                break
            brakes = breakdowns.brakes(fleet)
            fleet = move(fleet, dt, brakes)
            others.move(traffic, fleet.expected(dt), dt)
            place(fleet, brakes)
            world.hold(others.bodies, ways)
            show(fleet, scans)
            fleet = advance(fleet)
    wall = time.perf_counter() - began
    left = (m for platoon in world.waiting for m in platoon.members)
    nowhere = np.nan, np.nan, "", np.nan
    recorder.note(Event(traffic.time, "never_departed", m.id, "", *nowhere, "no room until the end") for m in left)
    recorder.note([Event(traffic.time, "end", "", "", *nowhere, ended, ended)])
    facts["status"] = "finished"
    facts["simulated_s"] = traffic.time
    facts["wall_s"] = round(wall, 3)
    facts["real_time_factor"] = round(traffic.time / wall, 2)
    facts["stage_s"] = {stage: round(seconds, 3) for stage, seconds in watch.seconds.items()}
    facts["sumo_words"] = (recorder.folder / "run.log").read_text(errors="replace").splitlines()[:100]
    _conclude(prepared, recorder, facts, encounters)


def _ended(run: Run, fleet: Fleet, waiting: Sequence[Fleet], last: bool) -> str:
    """Why the run ends with this step; "" if it goes on."""
    if not len(fleet) and not waiting:
        return "arrived"
    if run.laps and len(fleet) and not waiting and (np.abs(fleet.motion.turned) >= 2 * np.pi * run.laps).all():
        return "laps"
    return "duration" if last else ""


def _departures(members: Sequence[Member], dt: float) -> tuple[Fleet, list[Fleet]]:
    """Those that stand there at time 0, and the platoons that depart later."""
    number = {m.id: i for i, m in enumerate(members)}

    def fleet(some: list[Member]) -> Fleet:
        return Fleet.deployed(some, dt, np.array([number[m.id] for m in some], dtype=int))

    platoons: dict[str, list[Member]] = {}
    for m in members:
        platoons.setdefault(m.platoon, []).append(m)
    later = [fleet(platoon) for platoon in platoons.values() if platoon[0].departs > 0]
    return fleet([m for m in members if m.departs == 0]), later


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
