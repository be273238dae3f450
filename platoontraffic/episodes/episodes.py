"""The simulation of an environment: in SUMO, a parent that warms up and a fork of it an episode; or on bare ground."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from platoontraffic import scenario as scenarios
from platoontraffic.branches.host import Say
from platoontraffic.controllers.calls import desired_distance
from platoontraffic.controllers.external import External
from platoontraffic.controllers.law import Neighbour, Sensed, Signals
from platoontraffic.controllers.policy import inputs_of
from platoontraffic.errors import InputError, RunError, did_you_mean
from platoontraffic.lidar import LidarModel, ScanBatch
from platoontraffic.observation.instant import Instant
from platoontraffic.results.conclusion import scene
from platoontraffic.results.own_copies import take_own_copies
from platoontraffic.results.statistics import QUANTITIES
from platoontraffic.scenario import Change, Learn, Scenario
from platoontraffic.simulation import Prepared, Setting, Simulation, prepare, setting_of
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.records import changed
from platoontraffic.world.events import EVENT_KINDS, Event
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import BareGround

FIELDS = {one.name: one.field for one in QUANTITIES}
GROUP_SHIFT = np.zeros(10)  # inputs of a group where nothing is seen
FIXED = ("seed", "equip", "branch", "learn")  # keys and tables that are the same in all episodes
COMMANDS = {"twist": Twist, "drive": Drive}
OF_BOTH = ("collision",)  # events that concern their `other` as well


class Source(NamedTuple):
    """What the scenario of an environment is loaded from."""

    scenario: str
    changes: tuple[str, ...] = ()
    vehicles: tuple[str, ...] = ()  # members that learn; (): see `_learners`
    all: bool = False  # all followers learn, if `vehicles` names none


class Seat(NamedTuple):
    """A member that learns."""

    id: str
    lidar: LidarModel
    top_speed: float  # [m/s]
    low: tuple[float, float]  # least command
    high: tuple[float, float]

    @property
    def most(self) -> tuple[float, float]:
        """Greatest speed [m/s] and yaw rate [rad/s], either way, that are observed."""
        return 2 * self.top_speed, 2 * math.pi


class Facts(NamedTuple):
    """What an environment is made of."""

    learn: Learn
    seats: tuple[Seat, ...]
    command: str  # "twist" or "drive"
    interval: float  # from one decision to the next [s]
    known: tuple[str, ...]  # other members that are observed: "truth", "messages", each also with "_leader"
    seed: int  # of the scenario


class Frame(NamedTuple):
    """What members that learn have at a decision: n of each, in the order of the seats.

    It goes to another process in every step. Arrays, and tuples of a class of their own, take several times as long to
    be sent as plain tuples, numbers and bytes.
    """

    time: float  # [s]
    ended: str  # as of `Instant`
    here: list[bool]  # on the road
    ranges: np.ndarray | None  # [m], (n, k) float32, +inf: nothing; None if the observation is a vector
    own: list[tuple[float, float]] | np.ndarray  # measured speed [m/s] and yaw rate [rad/s]; or the vector, (n, ...)
    terms: list[list[float]]  # of the reward since the last decision, weighted, in the order of `learn.reward`
    values: list[tuple[float, ...]]  # of quantities, now, in the order of `FIELDS`; NaN: it has none
    events: list[tuple[str, ...]]  # kinds since the last decision
    known: dict[str, np.ndarray]  # by the names in `Facts.known`: fields of `Neighbour`, (n, 7)

    @classmethod
    def received(cls, plain: tuple) -> Frame:
        """The frame that was sent as `plain`."""
        frame = cls._make(plain)
        if frame.ranges is None:
            return frame
        return frame._replace(ranges=np.frombuffer(frame.ranges, np.float32).reshape(len(frame.here), -1))

    def plain(self) -> tuple:
        """The frame as it is sent."""
        return (*self[:3], None if self.ranges is None else self.ranges.tobytes(), *self[4:])


class Places(NamedTuple):
    """Where the members that learn are in a fleet."""

    members: tuple[Member, ...]  # of the fleet
    groups: tuple[np.ndarray, ...]  # rows of its groups
    rows: list[int | None]  # of each member that learns in the fleet; None: it is not on the road
    in_groups: tuple[tuple[int, int, int], ...]  # seat, group, row in the group

    @classmethod
    def of(cls, learners: Sequence[str], fleet: Fleet) -> Places:
        row_of = {name: row for row, name in enumerate(fleet.ids)}
        seats = {row_of[name]: i for i, name in enumerate(learners) if name in row_of}
        in_groups = tuple(
            (seats[row], g, k)
            for g, group in enumerate(fleet.groups)
            for k, row in enumerate(group.rows.tolist())
            if row in seats
        )
        rows = [row_of.get(name) for name in learners]
        return cls(fleet.members, tuple(group.rows for group in fleet.groups), rows, in_groups)

    def hold_in(self, fleet: Fleet) -> bool:
        groups = fleet.groups
        if fleet.members is not self.members or len(groups) != len(self.groups):
            return False
        return all(group.rows is rows for group, rows in zip(groups, self.groups, strict=True))


class Episodes:
    """A parent: SUMO after its warm-up, and in a fork of it an episode. Or one episode after another, without SUMO."""

    def __init__(self, source: Source, number: int = 0, folder: Path | None = None) -> None:
        """
        number : of the parent, from 0
        folder : for the files of its SUMO; None: there is none

        raises: InputError
        """
        self._source, self._folder = source, folder and folder / "files"
        base = scenarios.load(source.scenario, source.changes)
        self._learn = base.spec.learn or Learn()
        _check(self._learn, base)
        self._seed = base.seed + number
        random = np.random.default_rng([self._seed, number])
        drawn = {key: one for key, one in self._learn.draw.items() if key.startswith("sumo.")}
        self._drawn = {key: draw(random, one) for key, one in drawn.items()}
        self._prepared = self._prepare({}) if drawn or number else prepare(base)
        self._learners = _learners(self._prepared, source, self._learn)
        self._facts = self._facts_of(self._prepared)
        if number == 0:
            self._check_episodes(base)
        self._open, self._world = ExitStack(), None
        self._simulation: Simulation | None = None  # of the episode; or of a parent, deployed: see `_warm_up`
        self._undrawn = self._setting(self._prepared)  # of episodes for which nothing is drawn
        _kernels(self._undrawn)
        if self._folder:
            self._warm_up()

    def _warm_up(self) -> None:
        self._folder.mkdir()
        self._world = self._open.enter_context(setting_of(self._prepared, self._folder, forkable=True).ground())
        self._world.warm_up()
        setting = self._setting(self._prepared)
        self._world.load_kernels(setting.departures[0])
        observer = setting.observer()  # a fork uses its copy of it once
        self._undrawn = changed(setting, observer=lambda: observer)
        gc.collect()
        if not self._facts.learn.draw:  # episodes differ by their seeds only, and may begin with the same deployment
            self._simulation = Simulation(self._undrawn)
            self._simulation.deploy()
            self._simulation.world.look_ahead(self._undrawn.members)
        gc.freeze()  # in forks, collections need not touch, and so copy, what is here

    def _check_episodes(self, base: Scenario) -> None:
        """raises: InputError where episodes are shorter than a decision, or where what is drawn changes the spaces"""
        facts, learn = self._facts, self._learn
        if learn.episode_s and learn.episode_s < facts.interval:
            what = f"{learn.episode_s:g}: must be no less than the time between two decisions, {facts.interval:g} s"
            raise InputError(base.fault(("learn", "episode_s"), what))
        for key, values in facts.learn.draw.items():
            faults: list[InputError] = []
            values = values if isinstance(values, list) else list(values.values())
            for value in values:
                try:
                    prepared = self._prepare({key: value})
                except InputError as error:  # with what else is drawn it may be sound; else `chosen` raises it
                    faults.append(error)
                    continue
                if not self._still_learn(prepared) or _spaces(self._facts_of(prepared)) != _spaces(facts):
                    what = f"{value}: changes which members learn, what they observe or what they command; must not"
                    raise InputError(base.fault(("learn", "draw", key), what))
            if len(faults) == len(values):
                raise faults[0]

    def _still_learn(self, prepared: Prepared) -> bool:
        try:
            return _learners(prepared, self._source, self._learn) == self._learners
        except InputError:
            return False

    def facts(self, say: Say) -> Facts:
        return self._facts

    def _facts_of(self, prepared: Prepared) -> Facts:
        """raises: InputError where the seats of the members that learn differ"""
        members = {m.id: m for m in prepared.members}
        seats = [members[name] for name in self._learners]
        if len({(m.lidar, _with_seat(m).law.needs) for m in seats}) > 1:
            names = ", ".join(self._learners)
            raise InputError(f"{names}: members that learn in one environment must have equal lasers and needs")
        drawn = {key: one for key, one in self._learn.draw.items() if not key.startswith("sumo.")}
        command = self._learn.command or ("drive" if seats[0].model.turning_radius > 0 else "twist")
        return Facts(
            self._learn.model_copy(update={"draw": drawn}),
            tuple(Seat(m.id, m.lidar, float(m.model.top_speed), *_limits(m, command)) for m in seats),
            command,
            1 / seats[0].lidar.rate,
            _known(_with_seat(seats[0]).law.needs) if self._learn.observation == "dict" else (),
            prepared.scenario.seed,
        )

    def forked(self, seed: int, values: Mapping[str, Any], folder: Path) -> None:
        before, self._folder = self._folder, folder / "files"
        take_own_copies(before, self._folder)
        self._world.logs_in(self._folder)
        self.chosen(seed, values)

    def chosen(self, seed: int, values: Mapping[str, Any]) -> None:
        """What the next episode depends on: the seed of the sensors' errors, and what is drawn. raises: InputError"""
        if self._simulation is None:
            self._simulation = Simulation(self._setting(self._prepare(values)) if values else self._undrawn)
            self._simulation.deploy()
        self._simulation.setting = changed(self._simulation.setting, seed=seed)
        self._ranges: list[np.ndarray | None] = [None] * len(self._learners)

    def begin(self, say: Say) -> tuple:
        """The first decision, as `Frame.plain`: when the first scan of a member that learns has arrived."""
        simulation, events = self._simulation, []
        now = simulation.begin()
        self._places = Places.of(self._learners, now.fleet)
        while not (now.ended or self._keep(now)):
            events += now.events
            now = simulation.step()
        if not self._places.in_groups:
            raise RunError(f"{', '.join(self._learners)}: did not depart before the end of the episode ({now.ended})")
        columns = simulation.observer.statistics.values.dtype.names
        self._fields = itemgetter(*map(columns.index, FIELDS.values()))
        names, reward = list(FIELDS), enumerate(self._learn.reward.items())
        self._paid = [(i, weight, names.index(name)) for i, (name, weight) in reward if name in FIELDS]
        self._every = now.fleet.groups[self._places.in_groups[0][1]].every
        if self._learn.episode_s:
            last = now.step + round(self._learn.episode_s / simulation.setting.dt)
            simulation.setting = changed(simulation.setting, steps=min(simulation.setting.steps, last))
        kinds = self._kinds([*events, *now.events])
        return self._frame(now, self._values(self._places), [[] for _ in self._learners], kinds).plain()

    def step(self, say: Say, commands: dict[str, tuple[float, float]]) -> tuple:
        """The next decision, as `Frame.plain`.

        commands: the two values of a `Twist` or a `Drive`, by member
        """
        simulation, learn, kind = self._simulation, self._learn, COMMANDS[self._facts.command]
        here = simulation.now.fleet.ids
        given: dict[str, Twist | Drive] | None = {name: kind(*one) for name, one in commands.items() if name in here}
        dt, terms, events = simulation.setting.dt, [[0.0] * len(learn.reward) for _ in self._learners], []
        for _ in range(self._every):
            now = simulation.step(given)
            given = None  # it holds until the next decision
            events += now.events
            arrived = self._keep(now)
            values = self._values(self._places)
            for own, paid in zip(values, terms, strict=True):
                for i, weight, column in self._paid:
                    if not math.isnan(own[column]):
                        paid[i] += weight * abs(own[column]) * dt
            if now.ended or arrived:
                break
        kinds = self._kinds(events)
        for i, (name, weight) in enumerate(learn.reward.items()):
            for own, paid in zip(kinds, terms, strict=True) if name not in FIELDS else ():
                if name in own:
                    paid[i] += weight * own.count(name)
        return self._frame(now, values, terms, kinds).plain()

    def scene(self, say: Say) -> dict[str, Any]:
        """GeoJSON, as scene.geojson of a run."""
        return scene(self._prepared.scene, self._prepared.network)

    def bodies(self, say: Say) -> tuple[np.ndarray, int, list[int]]:
        """Of all vehicles near the members: x, y, heading, length and width, members first, (n, 5).

        returns also: how many are members, and the rows of those that learn
        """
        now, t = self._simulation.now, self._simulation.now.traffic
        return (
            np.stack([t.x, t.y, t.heading, t.length, t.width], axis=1),
            len(now.fleet),
            [row for row in self._places.rows if row is not None],
        )

    def spent(self, say: Say) -> float:
        """CPU time of the process of SUMO and the episode [s]; 0: they have none of their own."""
        return time.process_time() if self._world else 0.0

    def metrics(self, say: Say) -> list[dict[str, float]]:
        """Statistics of each member that learns over the episode: `gap_m_mean`, `gap_m_rms`, `gap_m_min` ..."""
        statistics, found = self._simulation.observer.statistics, []
        number = {m.id: i for i, m in enumerate(self._simulation.setting.members)}
        for learner in self._learners:
            of = statistics.of(number[learner])
            table = {
                f"{name}_{end}": float(getattr(of[field], part))
                for name, field in FIELDS.items()
                for end, part in (("mean", "mean"), ("rms", "rms"), ("min", "least"), ("max", "most"))
                if field in of
            }
            found.append(table)
        return found

    def end(self) -> None:
        """Close the simulation of the episode, if there is one."""
        if self._simulation:
            self._simulation.close()
            self._simulation = None

    def close(self) -> None:
        self._open.close()

    def _prepare(self, values: Mapping[str, Any]) -> Prepared:
        changes = [Change.parse(text, i) for i, text in enumerate(self._source.changes, start=1)]
        drawn = (self._drawn | dict(values)).items()
        changes += [Change(key, value, f"learn.draw.{key}", f"{key}={value}") for key, value in drawn]
        scenario = scenarios.load(self._source.scenario, changes, self._seed)
        before = getattr(self, "_prepared", None)
        return prepare(scenario, before and before.network)

    def _setting(self, prepared: Prepared) -> Setting:
        """With the seats of the members that learn."""
        setting = setting_of(prepared, self._folder, warm=self._world)
        members = tuple(_with_seat(m) if m.id in self._learners else m for m in setting.members)
        ground = setting.ground if self._folder else lambda: BareGround(setting.dt)
        return replace(setting, members=members, ground=ground, whole_traffic_every=None)

    def _values(self, places: Places) -> list[tuple[float, ...]]:
        """Of quantities, as in a frame."""
        numbers, none = self._simulation.observer.statistics.numbers, (math.nan,) * len(FIELDS)
        return [none if row is None else self._fields(numbers[row].tolist()) for row in places.rows]

    def _keep(self, now: Instant) -> bool:
        """Keep where the members that learn are, and their scans, if any has arrived; whether it has."""
        if not self._places.hold_in(now.fleet):
            self._places = Places.of(self._learners, now.fleet)
        arrived = False
        for seat, group, k in self._places.in_groups:
            if (batch := now.scans[group]) is not None:
                self._ranges[seat], arrived = batch.ranges[k], True
        return arrived

    def _kinds(self, events: Sequence[Event]) -> list[tuple[str, ...]]:
        """Kinds of the events of each member that learns."""
        return [
            tuple(e.kind for e in events if e.vehicle == name or (e.kind in OF_BOTH and e.other == name))
            for name in self._learners
        ]

    def _frame(
        self, now: Instant, values: list[tuple[float, ...]], terms: list[list[float]], kinds: list[tuple[str, ...]]
    ) -> Frame:
        """terms, kinds: of the reward, at the beginning none, and of events, since the last decision"""
        places = self._places
        fleet, observes = now.fleet, self._learn.observation
        speed, yaw_rate = now.odometry or (fleet.motion.speed, fleet.motion.yaw_rate)
        moves = [(0.0, 0.0) if row is None else (float(speed[row]), float(yaw_rate[row])) for row in places.rows]
        samples = next((len(one) for one in self._ranges if one is not None), 1)
        ranges = np.array([np.full(samples, np.inf) if one is None else one for one in self._ranges])
        if observes == "dict":
            seen = ranges.astype(np.float32, copy=False), moves
        else:
            seen = None, self._vector(now, ranges, np.array(moves))
        here, known = [row is not None for row in places.rows], self._others(fleet)
        return Frame(now.time, now.ended, here, *seen, terms, values, kinds, known)

    def _others(self, fleet: Fleet) -> dict[str, np.ndarray]:
        """Other members as the members that learn know them, as in a frame."""
        found = {name: np.full((len(self._learners), len(Neighbour._fields)), np.nan) for name in self._facts.known}
        for group in fleet.groups if found else ():
            for k, row in enumerate(group.rows):
                if (name := fleet.members[row].id) in self._learners and group.memory is not None:
                    for key, values in found.items():
                        source, _, vehicle = key.partition("_")
                        other = getattr(getattr(group.memory, source), vehicle or "predecessor")
                        values[self._learners.index(name)] = [one[k] for one in other]
        return found

    def _vector(self, now: Instant, ranges: np.ndarray, own: np.ndarray) -> np.ndarray:
        """The observation as a vector, (n, ...)."""
        lidar = next(m.lidar for m in self._simulation.setting.members if m.id == self._learners[0])
        n, kind = len(self._learners), self._learn.observation
        if ranges.shape[1] == 1:  # nothing has been measured yet
            ranges = np.full((n, lidar.samples), np.inf)
        batch = ScanBatch(lidar, now.time, tuple(self._learners), ranges, None, np.zeros(n, bool))
        shift = GROUP_SHIFT if kind == "group" else np.zeros(self._learn.sectors + 2)
        return inputs_of(kind, shift, Sensed(batch, own[:, 0], own[:, 1])).values


def _spaces(facts: Facts) -> tuple:
    """What the spaces of observations and actions are made of. Errors and mounts of the lasers are not."""
    seats = [(seat._replace(lidar=None), *_of_space(seat.lidar)) for seat in facts.seats]
    return seats, facts.command, facts.interval, facts.known


_of_space = attrgetter("samples", "angle_min", "angle_max", "range_min", "range_max")


def unheard(value: Any) -> None:
    """Nobody asks how far a call has come."""


def draw(random: np.random.Generator, values: Any) -> Any:
    """A value of a range or a list, as of the table `learn.draw`."""
    if isinstance(values, list):
        return values[int(random.integers(len(values)))]
    low, high = values["from"], values["to"]
    return int(random.integers(low, high + 1)) if type(low) is type(high) is int else float(random.uniform(low, high))


def _check(learn: Learn, scenario: Scenario) -> None:
    """raises: InputError with a line for each name that is not known"""
    faults = []
    for key, names, known in (
        ("reward", learn.reward, [*FIELDS, *EVENT_KINDS]),
        ("ends", learn.ends, list(EVENT_KINDS)),
    ):
        what = "quantity of statistics.csv or kind of event" if key == "reward" else "kind of event"
        faults += [
            scenario.fault(("learn", key), f"{name!r}: no {what}{did_you_mean(name, known)}")
            for name in names
            if name not in known
        ]
    faults += [
        scenario.fault(("learn", "draw", key), "cannot be drawn: it is the same in all episodes")
        for key in learn.draw
        if key.partition(".")[0] in FIXED or key in ("run.step_s", "record.sumo")
    ]
    if faults:
        raise InputError(*faults)


def _learners(prepared: Prepared, source: Source, learn: Learn) -> tuple[str, ...]:
    """Ids of the members that learn. raises: InputError"""
    members = {m.id: m for m in prepared.members}
    named = source.vehicles or ((learn.vehicle,) if learn.vehicle and not source.all else ())
    if learn.vehicle and learn.vehicle not in members:
        what = f"{learn.vehicle!r}: no member{did_you_mean(learn.vehicle, members)}"
        raise InputError(prepared.scenario.fault(("learn", "vehicle"), what))
    if twice := sorted({name for name in named if named.count(name) > 1}):
        raise InputError(*(f"vehicle: {name!r}: is named twice; must be named once" for name in twice))
    if unknown := [name for name in named if name not in members]:
        raise InputError(*(f"vehicle: {name!r}: no member{did_you_mean(name, members)}" for name in unknown))
    found = tuple(named)
    if not found:
        outside = [m.id for m in members.values() if isinstance(m.law, External)]
        followers = outside or [m.id for m in members.values() if m.place > 0]
        if not followers:
            raise InputError(f"{prepared.scenario.source}: has no follower that could learn")
        found = tuple(followers if source.all else followers[:1])
    if native := [name for name in found if members[name].law.native]:
        raise InputError(f"{', '.join(native)}: SUMO drives it; it cannot learn")
    empty = [m.id for m in members.values() if isinstance(m.law, External) and m.id not in found]
    if empty:
        raise InputError(f"{', '.join(empty)}: law 'external' without a driver: only {', '.join(found)} learns here")
    return found


def _with_seat(member: Member) -> Member:
    """It is to keep the distance that its law in the scenario declares, as at 0 and 1 m/s."""
    law = member.law
    if not isinstance(law, External):
        stop, slow = (float(desired_distance(law, speed)) for speed in (0.0, 1.0))
        to_laser = 0.0 if law.distance_from == "laser" else member.seen_ahead_of_gap
        observes = tuple(sorted(law.needs & {"truth", "messages", "leader"}))
        distance = {} if np.isnan(stop) else {"stand_off": stop + to_laser, "headway": slow - stop}
        law = External(observes=observes, **distance)
    return replace(member, law=law, further_lidars=(), sensors=())


def _known(needs: Collection[str]) -> tuple[str, ...]:
    """Names of the other members that a law with such needs is told of."""
    endings = ("", "_leader") if "leader" in needs else ("",)
    return tuple(source + end for source in ("truth", "messages") if source in needs for end in endings)


def _limits(member: Member, command: str) -> tuple[tuple[float, float], tuple[float, float]]:
    """Least and greatest command of a member's vehicle."""
    model = member.model
    top = float(model.top_speed)
    sharpest = 1 / model.turning_radius if model.turning_radius > 0 else 2 / model.width
    if command == "twist":
        return (0.0, -top * sharpest), (top, top * sharpest)
    hardest, strongest = float(model.hardest_braking), float(model.strongest_acceleration(np.zeros(1))[0])
    return (-min(hardest, 10.0), -sharpest), (min(strongest, 10.0), sharpest)


class _OpenRoad(BareGround):
    """Bare ground where nobody has to stop."""

    def signals(self, fleet: Fleet) -> Signals:
        n = len(fleet)
        return Signals(np.full(n, np.inf), np.ones(n, bool), *np.zeros((2, n), bool), np.zeros(n, int))


def _kernels(setting: Setting) -> None:
    """Load what is compiled, once for all forks: a few steps without SUMO."""
    members = tuple(replace(m, law=External()) if m.law.native else m for m in setting.members)
    with Simulation(
        replace(setting, members=members, ground=lambda: _OpenRoad(setting.dt), channel=None, then=None)
    ) as simulation:
        simulation.reset()
        for _ in range(4):
            if not simulation.now.ended:
                simulation.step()
