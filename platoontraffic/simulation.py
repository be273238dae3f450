"""Platoons in traffic, one instant at a time. The loop, `Simulation.step`, is the table of contents of the package."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from platoontraffic import scenario as scenarios
from platoontraffic.controllers.law import Law
from platoontraffic.errors import InputError, RunError, did_you_mean
from platoontraffic.lidar import Scene
from platoontraffic.observation.encounters import Encounters
from platoontraffic.observation.instant import Instant
from platoontraffic.observation.observer import Measures, Observer
from platoontraffic.observation.statistics import Statistics
from platoontraffic.observation.violations import Violations
from platoontraffic.results import plug_in_metrics, statistics
from platoontraffic.results.own_copies import named_for_forks
from platoontraffic.results.provenance import Stopwatch, Untimed
from platoontraffic.results.sumo_refusal import failure, refusal
from platoontraffic.results.sumo_tables import plainly_named, sumo_options
from platoontraffic.road.network import Network
from platoontraffic.scenario import Breakdown, Channel, Scenario
from platoontraffic.sumo.client import Client
from platoontraffic.sumo.process import FailedError, RefusedError
from platoontraffic.sumo.world import World
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.records import every
from platoontraffic.world import prepared as preparation
from platoontraffic.world.breakdowns import Breakdowns
from platoontraffic.world.channel import Messages
from platoontraffic.world.contact import Contacts
from platoontraffic.world.convoys import Convoys
from platoontraffic.world.events import Event, Noted
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import BareGround, Ground
from platoontraffic.world.manoeuvres import Manoeuvres, Order
from platoontraffic.world.obstacles import Obstacles, Plan
from platoontraffic.world.prepared import Prepared, departures
from platoontraffic.world.recruits import Recruits
from platoontraffic.world.sensing import Sensing, arriving
from platoontraffic.world.stuck import Stuck
from platoontraffic.world.trips import Trip
from platoontraffic.world.ways_round import WaysRound

CLOSED = "the simulation is closed"
COLLECTED_AFTER = 50_000  # new objects after which Python's garbage collector runs

__all__ = ["Instant", "Outcome", "Prepared", "Setting", "Simulation", "prepare", "setting_of"]


def prepare(scenario: Scenario, network: Network | None = None) -> Prepared:
    """A scenario made ready to be simulated. raises: InputError with one line for every fault found

    network: its network, if it was read before
    """
    plug_in_metrics.check(scenario.metrics.metrics)
    return preparation.prepare(scenario, network)


class Unobserved:
    """Stands in for an observer where nothing is to be measured."""

    def observe(self, *_: Any) -> list[Event]:
        return []

    def measure(self, fleet: Fleet) -> Measures:
        raise RuntimeError("this simulation has no observer, so it has no measures")

    def refit(self, members: Sequence[Member]) -> None: ...

    def close(self) -> None: ...

    def extend(self, newcomers: Sequence[Member]) -> None: ...

    @property
    def statistics(self) -> Statistics:
        raise RuntimeError("this simulation has no observer, so it has no statistics")


class Then(NamedTuple):
    """Other laws, sensors and breakdowns from one step on."""

    step: int  # the last one that is decided as before
    members: Sequence[Member]  # all of the simulation, in the same order
    breakdowns: Sequence[Breakdown]


@dataclass(frozen=True)
class Setting:
    """All that a simulation is made of. A reset begins with the same setting again."""

    members: Sequence[Member]
    scene: Scene  # static obstacles
    dt: float  # [s]
    steps: int | None = None  # after which it ends; None: it has no set end
    seed: int = 0  # of all sensor errors
    lidar_engine: str = "raster"
    ground: Callable[[], AbstractContextManager[Ground]] | None = None  # a new world; None: bare ground
    observer: Callable[[], Observer | Unobserved] = Unobserved
    obstacles: Sequence[Plan] = ()
    orders: Sequence[Order] = ()
    breakdowns: Sequence[Breakdown] = ()
    map: Network | None = None  # that members know; None: they find no way round what stands in their way
    recruits: Recruits | None = None  # vehicles of the traffic that become members
    channel: Channel | None = None  # of messages between members; None: there are none
    laps: float | None = None  # it ends when every member has turned through as many full circles
    ends_at_contact: bool = False  # it ends when a member touches something
    whole_traffic_every: int | None = None  # steps from one instant with `whole` to the next; None: none has it
    then: Then | None = None

    @cached_property
    def departures(self) -> tuple[Fleet, list[Fleet]]:
        """The members at their start poses: as of `prepared.departures`."""
        return departures(self.members, self.dt)


class Outcome(NamedTuple):
    """How a simulation ended."""

    time: float  # [s]
    ended: str  # as in `Instant`
    never_departed: Sequence[Member]  # they waited for room until the end


class Simulation:
    """Platoons in traffic, one instant at a time: what moves and what is remembered. It writes no files.

    A context manager, and an iterator of instants:

        with Simulation.load("corridor_platoon", "run.duration_s=60") as simulation:
            for instant in simulation:
                print(instant.time, instant.measures.gap)

    In place of the iteration, `reset` gives the first instant and each `step` the next one. One process holds one
    simulation in SUMO at a time; a `SimulationProcess` has a process of its own.
    """

    def __init__(self, setting: Setting, stopwatch: Stopwatch | Untimed | None = None) -> None:
        """stopwatch: of the stages of a step; None: they are not timed"""
        self.setting = setting
        self.stopwatch = stopwatch or Untimed()
        self.now: Instant | None = None
        self._stopped = ""  # why it cannot go on; "": it can
        self._open = ExitStack()
        self._of_parents: list[ExitStack] = []

    @classmethod
    def load(
        cls, scenario: str | Path, *changes: str, seed: int | None = None, laws: Mapping[str, Law] | None = None
    ) -> Simulation:
        """The simulation of a scenario file, or of a shipped scenario by its name, with keys changed: `key=value`.

        laws: in place of those of the scenario, by member id; the sensors are those of the scenario

        raises: InputError with one line for every fault found
        """
        setting = setting_of(prepare(scenarios.load(scenario, changes, seed)))
        return cls(with_laws(setting, laws) if laws else setting)

    def __enter__(self) -> Simulation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped = CLOSED
        self._open.__exit__(kind, error, trace)

    def close(self) -> None:
        """End SUMO, so that another simulation may begin in this process; as at the end of `with`."""
        self.__exit__(None, None, None)

    def __iter__(self) -> Iterator[Instant]:
        yield self.reset()
        while not self.now.ended:
            yield self.step()

    def reset(self) -> Instant:
        """Begin anew, in a new world; the first instant.

        raises: InputError (SUMO refuses a file), RunError (a member cannot be inserted, or SUMO already runs here)
        """
        self.deploy()
        return self.begin()

    def deploy(self) -> None:
        """The part of a reset that no seed of the setting changes: a new world, with the members at their places."""
        self._open.close()
        self.now = None
        setting, watch = self.setting, self.stopwatch
        world = self._open.enter_context(setting.ground() if setting.ground else BareGround(setting.dt))
        self.world = watch.wrap(world, snapshot="read", signals="signals", place="place", advance="step")
        self.observer = watch.wrap(setting.observer(), observe="observe", measure="measure")
        self._open.callback(self.observer.close)
        self.manoeuvres, self.breakdowns = Manoeuvres(setting.orders), Breakdowns(setting.breakdowns)
        self.stuck, self._remedies = Stuck(setting.recruits.tables if setting.recruits else ()), {}
        self.convoys, self.ways_round = Convoys(), WaysRound(setting.map)
        self.violations = Violations()
        self.members = list(setting.members)  # all that it has had, by their number
        self._deployed = self.world.deploy(*setting.departures)
        self.obstacles = Obstacles(setting.obstacles, self._deployed)
        self.encounters = Encounters(self.obstacles, setting.members)
        self._hold_obstacles()
        if isinstance(world, World):
            self._open.enter_context(_collected_rarely())
            # What is here lasts, and a collection that looks through the network takes as long as some steps.
            if not gc.get_freeze_count():
                gc.freeze()
                self._open.callback(gc.unfreeze)

    def begin(self) -> Instant:
        """The rest of a reset, after `deploy`: the first instant. Until then another seed may be set."""
        setting = self.setting
        sensing = Sensing(setting.scene, setting.lidar_engine, setting.seed)
        self.sensors = self.stopwatch.wrap(sensing, sense="scan")
        self.messages = _new_messages(setting)
        self._stopped = ""
        return self._decide(0, self._deployed)

    def step(self, override: Mapping[str, Twist | Drive] | None = None) -> Instant:
        """Every member moves by its command; then the next instant.

        override: commands, by member id, in place of those of the members' laws, until these decide again

        raises: ValueError (a command for no member, for one that SUMO drives, or not finite), RunError (SUMO failed),
                InputError (a plug-in failed), RuntimeError (there was no reset, the simulation has ended or is closed,
                or the last step has failed)
        """
        if self._stopped:
            raise RuntimeError(f"{self._stopped}; reset() begins anew")
        if self.now is None:
            raise RuntimeError("reset() gives the first instant, step() those after it")
        if self.now.ended:
            raise RuntimeError(f"the simulation has ended ({self.now.ended}); reset() begins anew")
        if self.setting.then and self.now.step == self.setting.then.step:
            self._refit(self.setting.then)
        fleet, dt, timed = self.now.fleet, self.setting.dt, self.stopwatch.call
        if override:
            fleet = fleet.commanded(override)
        self._stopped = "the last step has failed"  # until it has not: some may have moved when others have not
        if self._remedies:
            fleet = self.world.without(fleet, self._remedies)
        brakes = self.breakdowns.brakes(fleet)
        fleet = timed("move", fleet.moved, dt, brakes)
        self.obstacles.move(self.now.traffic, fleet.expected(dt), dt)
        self.world.place(fleet, brakes, self.ways_round.passed)
        self._hold_obstacles()
        self._decide(self.now.step + 1, self.world.advance(fleet))
        self._stopped = ""
        return self.now

    def _refit(self, then: Then) -> None:
        """Every member has the law and the sensors of `then` from now on."""
        members = {m.id: m for m in then.members}
        self.now = replace(self.now, fleet=self.now.fleet.refitted(members, self.setting.dt))
        self.world.refit(members)
        self.observer.refit(then.members)
        self.breakdowns.replace(then.breakdowns)

    def _decide(self, step: int, fleet: Fleet) -> Instant:
        """Every member senses the same world; then every law decides."""
        dt, timed = self.setting.dt, self.stopwatch.call
        parted, fleet = self._recruited(fleet) if self.setting.recruits else ([], fleet)
        traffic, whole = self.world.snapshot(fleet, fleet.sight), None
        if (every := self.setting.whole_traffic_every) and step % every == 0:
            whole = self.world.snapshot(fleet)
        failed = self.breakdowns.due(fleet, traffic.time)
        stuck, self._remedies = self.stuck.observe(fleet, traffic.time)
        fleet, ordered = self.manoeuvres.applied(fleet.regrouped(), traffic.time)
        if ordered:
            self.ways_round.forget(note.vehicle for note in ordered if note.what == "leave")
        measured = self.sensors.sense(traffic, fleet, step, self.breakdowns.blind(fleet))
        sensed, fleet = arriving(measured, fleet, step)
        roads = self.world.roads(fleet)
        signals = self.world.signals(fleet)
        round_it, fleet = self.ways_round.followed(fleet, roads, sensed, signals, traffic.time)
        messages, fleet, radio = self.messages.received(fleet, step, traffic.time)
        fleet = timed("decide", fleet.decided, sensed.scans, dt, signals, sensed.odometry, sensed.readings, messages)
        entered = list(self.violations.observe(self.world.entries(fleet), fleet))
        noted = [*parted, *ordered, *failed, *stuck, *round_it, *radio, *entered]
        events = self.observer.observe(traffic, fleet, sensed.scans, roads, signals, noted, sensed.seen)
        events = [*events, *self.encounters.observe(traffic, fleet, roads, events)]
        self.now = Instant(
            step,
            traffic,
            fleet,
            sensed.scans,
            roads,
            events,
            self.observer.measure,
            ended=self._ended(step, fleet, events),
            passages=self.world.passages(fleet),
            readings=sensed.readings,
            seen=sensed.seen,
            odometry=sensed.odometry,
            whole=whole,
        )
        return self.now

    def _recruited(self, fleet: Fleet) -> tuple[list[Noted], Fleet]:
        """The fleet in which the members from the traffic follow one another, and events of those whose routes part.

        Those that have departed in the last step are observed from now on.
        """
        if fleet.number.max(initial=-1) >= len(self.members):
            fleet = self._welcome(fleet)
        return self.convoys.parted(fleet, self.world.roads(fleet))

    def _welcome(self, fleet: Fleet) -> Fleet:
        new = sorted((number, i) for i, number in enumerate(fleet.number) if number >= len(self.members))
        newcomers = [fleet.members[i] for _, i in new]
        self.members += newcomers
        for one in (self.observer, self.encounters, self.messages):
            one.extend(newcomers)
        return self.convoys.joined(fleet, [m.id for m in newcomers])

    def goes_on_in(self, folder: Path) -> None:
        """In a fork of the process: SUMO's files are those in `folder` now, and closing leaves the parent's alone."""
        self._of_parents.append(self._open.pop_all())  # kept: it would be closed if it were collected
        self._open.push(self.world)
        self.world.logs_in(folder)

    def becomes(self, setting: Setting) -> None:
        """Go on by another setting, with the same members: until its `then`, all else is as before."""
        if setting.channel and not self.setting.channel:
            self.messages = _new_messages(setting)  # nobody has listened yet
        self.setting = setting

    @property
    def sumo(self) -> Client:
        """SUMO as libsumo has it: `simulation.sumo.trafficlight.setPhase(...)`. Its frames and units are SUMO's own.

        What it changes holds from the next step on. Members are driven by the simulation, and the clock is its own.

        raises: RuntimeError (there was no reset, or there is no SUMO)
        """
        if self._stopped == CLOSED:
            raise RuntimeError(f"there is no SUMO: {CLOSED}")
        if self.now is None or not isinstance(world := self.world, World):
            raise RuntimeError("there is no SUMO: reset() starts it, where the simulation has a road network")
        return world.client

    @property
    def outcome(self) -> Outcome:
        """raises: RuntimeError while it goes on"""
        if self.now is None or not self.now.ended:
            raise RuntimeError("the simulation has not ended")
        waiting = [member for platoon in self.world.waiting for member in platoon.members]
        return Outcome(self.now.time, self.now.ended, waiting)

    def trips(self) -> list[Trip]:
        """Trips until now of the members from the traffic, by their beginning."""
        return self.world.trips if self.now else []

    def statistics(self) -> list[statistics.Row]:
        """Statistics of every member's measured values over all steps until now, the rows of statistics.csv.

        raises: RuntimeError if it has no observer
        """
        if self.now is None:
            return []
        return list(statistics.rows(self.observer.statistics, self.members, self.setting.dt))

    def _hold_obstacles(self) -> None:
        if plans := self.obstacles.plans:
            self.world.hold(self.obstacles.bodies, {plan.id: plan.edges for plan in plans if plan.seen_by_sumo})

    def _ended(self, step: int, fleet: Fleet, events: Sequence[Event]) -> str:
        """Why the simulation ends at this instant; "" if it goes on."""
        waiting, laps = self.world.waiting, self.setting.laps
        if not fleet.members and not waiting and not self.world.expects_more:
            return "arrived"
        if laps and fleet.members and not waiting:
            turned, whole = fleet.motion.turned, 2 * np.pi * laps
            if abs(turned[0]) >= whole and every(np.abs(turned) >= whole):  # the first one decides nearly always
                return "laps"
        if self.setting.ends_at_contact and any(event.kind == "collision" for event in events):
            return "contact"
        if self.world.gridlocked and not (self.setting.obstacles or self.setting.breakdowns):  # those may end by plan
            return "gridlock"
        return "duration" if step == self.setting.steps else ""


@contextmanager
def _collected_rarely() -> Iterator[None]:
    """Python's garbage collector runs more rarely: a step of a thousand members makes thousands of objects."""
    before, after = gc.get_threshold(), (COLLECTED_AFTER, *gc.get_threshold()[1:])
    if not 0 < before[0] < COLLECTED_AFTER:  # 0: the program has switched it off
        yield
        return
    gc.set_threshold(*after)
    try:
        yield
    finally:
        if gc.get_threshold() == after:  # the program has not set another one meanwhile
            gc.set_threshold(*before)


def with_laws(setting: Setting, laws: Mapping[str, Law]) -> Setting:
    """The setting with other laws for some members, by id. raises: InputError"""
    ids = [m.id for m in setting.members]
    faults = [f"laws: {name!r}: no member{did_you_mean(name, ids)}" for name in laws if name not in ids]
    faults += [f"laws: {name!r}: {law!r} is no Law" for name, law in laws.items() if not isinstance(law, Law)]
    if faults:
        raise InputError(*faults)
    members = tuple(replace(m, law=laws.get(m.id, m.law)) for m in setting.members)
    return replace(setting, members=members)


def _new_messages(setting: Setting) -> Messages:
    """Of a run that begins: nothing has been sent yet."""
    return Messages(setting.channel, setting.members, setting.dt, setting.seed, setting.scene.solids)


@contextmanager
def _naming_files(scenario: Scenario) -> Iterator[None]:
    """SUMO's errors name the file that they are about."""
    try:
        yield
    except RefusedError as error:
        raise InputError(refusal(error.words, scenario)) from error
    except FailedError as error:
        raise RunError(failure(error.when, error.words, scenario)) from error.__cause__


def setting_of(
    prepared: Prepared,
    folder: Path | None = None,
    client: Client | None = None,
    forkable: bool = False,
    warm: World | None = None,
) -> Setting:
    """The setting of a scenario in SUMO.

    folder   : for the files that SUMO writes; None: a temporary one
    client   : the SUMO to call, such as a window's; None: libsumo, in this process
    forkable : this process may be forked; see `goes_on_in`
    warm     : a world after its warm-up, which goes on as this one
    """
    named = named_for_forks if forkable else plainly_named
    scenario, spec = prepared.scenario, prepared.scenario.spec
    recruits = (
        Recruits(scenario, prepared.network, prepared.platooning and prepared.platooning.plan) if spec.equip else None
    )
    dt, members = spec.run.step_s, prepared.members

    @contextmanager
    def ground() -> Iterator[World]:
        with ExitStack() as stack:
            files = folder or Path(stack.enter_context(TemporaryDirectory(prefix="platoontraffic-")))
            # SUMO may be reading the files that are made for its options.
            options = {}
            if not warm:
                named_files = stack.enter_context(named(files))
                options = sumo_options(scenario, named_files, prepared.platooning, prepared.unsorted)
            words, warm_up = files / "run.log", spec.sumo.warm_up_s
            more = client, warm, recruits, spec.record.passages
            world = World(prepared.network, dt, scenario.seed, words, options, warm_up, *more)
            stack.enter_context(_naming_files(scenario))
            yield stack.enter_context(world)

    def observer() -> Observer:
        return Observer(members, prepared.network, Contacts(prepared.scene, {m.id for m in members}))

    return Setting(
        members,
        prepared.scene,
        dt,
        steps=round(spec.run.duration_s / dt),
        seed=scenario.seed,
        lidar_engine=spec.scene.lidar_engine,
        ground=ground,
        observer=observer,
        obstacles=prepared.obstacles,
        orders=prepared.orders,
        breakdowns=spec.breakdown,
        map=prepared.network,
        recruits=recruits,
        channel=spec.channel,
        laps=spec.run.laps,
        ends_at_contact=spec.run.ends_at_contact,
        whole_traffic_every=steps_of(spec.record.traffic_every_s, dt),
        then=_then(prepared),
    )


def _then(prepared: Prepared) -> Then | None:
    scenario = prepared.scenario
    if scenario.then is None:
        return None
    step = round(scenario.spec.branch.at_s / scenario.spec.run.step_s)
    return Then(step, prepared.then, scenario.then.spec.breakdown)


def steps_of(every: float | None, dt: float) -> int | None:
    """A period [s] in steps."""
    return None if every is None else round(every / dt)
