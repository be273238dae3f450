"""A run, from a checked scenario to a folder of results. The loop in `simulate` is the table of contents."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomli_w

from platoontraffic.errors import InputError, MissingError, RunError
from platoontraffic.lidar import Scene
from platoontraffic.observation.encounters import Encounters
from platoontraffic.observation.observer import Observer
from platoontraffic.results import plug_in_metrics, provenance, sumo_tables
from platoontraffic.results.columns import Instant
from platoontraffic.results.conclusion import MetricError, conclude, scene
from platoontraffic.results.recorder import SAFE_EVERY, Clocks, Recorder
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
    plug_in_metrics.check(scenario.metrics.metrics)
    network = Network.read(scenario.net)
    # In large networks these take seconds, which are not the loop's.
    network.middle_lines()
    network.entered_from  # noqa: B018
    static = static_scene(scenario, network)
    members = deploy(scenario, network, static)
    plans = obstacles.plans(scenario, network, members)
    return Prepared(scenario, network, static, members, plans, manoeuvres.orders(scenario, network, members))


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
            MetricError (a metric of a plug-in failed): likewise, with all other files;
            InputError (another plug-in failed), MissingError (no display): nothing is kept
    """
    spec = prepared.scenario.spec
    recorder = Recorder(folder, Clocks.of(spec.record, spec.run.step_s))
    try:
        _simulate(prepared, recorder, progress, window)
        return recorder.finish(replace)
    except MetricError as error:
        kept = recorder.keep_unfinished()
        raise MetricError(*error.faults, f"{kept}: all tables of the run are kept there") from error
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
    run, dt = scenario.spec.run, scenario.spec.run.step_s
    facts = provenance.provenance(scenario)
    recorder.write("config.toml", tomli_w.dumps(scenario.resolved(recorder.folder)))
    recorder.write_json("provenance.json", facts)
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
    safe_every = round(SAFE_EVERY / dt)

    watch = provenance.Stopwatch()
    read, signals, scan = watch("read", world.snapshot), watch("signals", world.signals), watch("scan", sensing.scan)
    odometry = watch("odometry", sensing.odometry)
    observe, measure = watch("observe", observer.watch), watch("measure", observer.measure)
    write, place, advance = watch("record", recorder.record), watch("place", world.place), watch("step", world.advance)
    decide, move = watch("decide", Fleet.decided), watch("move", Fleet.moved)
    show = watch("show", window.show) if window else lambda fleet, scans: None

    ways = {plan.id: plan.edges for plan in prepared.obstacles if plan.seen_by_sumo}

    began = time.perf_counter()
    with world:
        fleet = world.deploy(fleet, later)
        others = Obstacles(prepared.obstacles, fleet)
        encounters = Encounters(others, prepared.members)
        orders = manoeuvres.Orders(prepared.orders)
        breakdowns = Breakdowns(scenario.spec.breakdown)
        world.hold(others.bodies, ways)
        for step in range(steps + 1):
            traffic = read(fleet, np.inf if recorder.wants_all_traffic(step) else fleet.sight)
            broken = breakdowns.watch(fleet, traffic.time)
            scans = breakdowns.seen(scan(traffic, fleet, step), fleet)
            fleet, told = orders.given(fleet, traffic.time)
            lines = signals(fleet)
            fleet = decide(fleet, scans, dt, lines, odometry(fleet, step))
            roads = world.roads(fleet)
            noted = [*told, *broken, *world.violations(fleet)]
            events = observe(traffic, fleet, scans, roads, lines, noted)
            events += encounters.watch(traffic, fleet, events)
            write(Instant(step, traffic, fleet, scans, roads, events, measure))
            if step % safe_every == 0:
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
    recorder.note([Event(traffic.time, "end", "", "", *nowhere, ended)])
    recorder.write_json("scene.geojson", scene(prepared.scene, network))
    conclude(recorder, scenario, prepared.members, [plan.id for plan in prepared.obstacles], encounters)
    words = (recorder.folder / "run.log").read_text(errors="replace").splitlines()[:100]
    outcome = provenance.Outcome(traffic.time, wall, watch.seconds, words)
    recorder.write_json("provenance.json", provenance.finished(facts, outcome))


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
