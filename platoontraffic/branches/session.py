"""A simulation in a process of its own, to be stepped and to be copied."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from platoontraffic import scenario as scenarios
from platoontraffic.branches.host import Say
from platoontraffic.branches.process import Process
from platoontraffic.branches.runs import check_has_no_branch
from platoontraffic.errors import InputError
from platoontraffic.observation.instant import Instant
from platoontraffic.results import statistics
from platoontraffic.results.own_copies import take_own_copies
from platoontraffic.scenario import Change, Scenario
from platoontraffic.scenario.overrides import branch_of, check_once
from platoontraffic.simulation import Outcome, Simulation, prepare, setting_of
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.world.prepared import after_branch, branched


class SimulationProcess:
    """A simulation in a process of its own, which is copied exactly by `branch`, at any instant.

        with SimulationProcess.load("corridor_tracking", "run.duration_s=60") as simulation:
            simulation.run(until=20)
            with simulation.branch("platoon.follower.time_headway_s=2") as wider:
                print(simulation.run().measures.gap, wider.run().measures.gap)

    The copy has the same traffic, members, memories and random numbers. It goes on by itself, and ends with the process
    that it was copied from. Each has a process of its own, so several may run at a time, each called by a thread of its
    own. On Linux a process ends with the thread that loaded it.
    """

    def __init__(self, scenario: Scenario, process: Process, folder: TemporaryDirectory, now: Instant) -> None:
        self.now = now  # the last instant
        self._scenario, self._process, self._folder = scenario, process, folder

    @classmethod
    def load(cls, scenario: str | Path, *changes: str, seed: int | None = None) -> SimulationProcess:
        """The simulation of a scenario file, or of a shipped scenario, at its first instant; keys changed: `key=value`.

        raises: InputError with one line for every fault found, RunError, MissingError (this system has no fork)
        """
        loaded = scenarios.load(scenario, changes, seed, to_branch=True)
        folder = TemporaryDirectory(prefix="platoontraffic-")
        process = Process.holding(_Held, str(scenario), changes, seed, Path(folder.name))
        return cls(loaded, process, folder, process.call("begin"))

    def __enter__(self) -> SimulationProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Instant]:
        """The present instant, then those after it."""
        yield self.now
        while not self.now.ended:
            yield self.step()

    def step(self, override: Mapping[str, Twist | Drive] | None = None) -> Instant:
        """As `Simulation.step`."""
        self._check_goes_on()
        self.now = self._process.call("step", override)
        return self.now

    def run(self, until: float = math.inf, heard: Callable[[float], None] = lambda time: None) -> Instant:
        """Simulate until a time [s], or to the end; the last instant. Errors as of `Simulation.step`.

        heard: called with each time that is reached [s]
        """
        self.now = self._process.call("run", until, heard=heard)
        return self.now

    def branch(self, *changes: str) -> SimulationProcess:
        """An exact copy at this instant, in a process of its own, with keys changed as in the scenario's `branch.then`.

        raises: InputError with one line for every fault of the changes, RunError, RuntimeError (it is closed, or
                has ended and there are changes)
        """
        if self._process.closed:
            raise RuntimeError("the simulation is closed")
        if not all(isinstance(change, str) for change in changes):
            raise InputError(f"changes: {changes}: must be texts such as 'platoon.follower.law=acc'")
        scenario, parsed = self._scenario, [Change.parse(text, number) for number, text in enumerate(changes, start=1)]
        check_once(parsed)
        if parsed:
            self._check_goes_on()
            check_has_no_branch(scenario)
            scenario = scenario.branched(branch_of(self.now.time, parsed)).then
        copy = TemporaryDirectory(prefix="platoontraffic-", dir=self._folder.name, ignore_cleanup_errors=True)
        return SimulationProcess(scenario, self._process.fork(parsed, Path(copy.name)), copy, self.now)

    def statistics(self) -> list[statistics.Row]:
        """As `Simulation.statistics`."""
        return self._process.call("statistics")

    @property
    def outcome(self) -> Outcome:
        """As `Simulation.outcome`."""
        return self._process.call("outcome")

    def close(self) -> None:
        """End the process, and with it the copies that were made of it; not in a fork of the program."""
        self._process.close()
        if self._process.is_own:
            self._folder.cleanup()

    def _check_goes_on(self) -> None:
        """raises: RuntimeError if it has ended, and is not closed"""
        if self.now.ended and not self._process.closed:
            raise RuntimeError(f"the simulation has ended ({self.now.ended}); load() begins anew")


class _Held:
    """The simulation inside the process."""

    def __init__(self, scenario: str, changes: Sequence[str], seed: int | None, folder: Path) -> None:
        self._folder = folder / "files"
        self._folder.mkdir()
        self._prepared = prepare(scenarios.load(scenario, changes, seed, to_branch=True))
        self._simulation = Simulation(setting_of(self._prepared, self._folder, forkable=True))

    def begin(self, say: Say) -> Instant:
        return self._simulation.reset()

    def step(self, say: Say, override: Mapping[str, Twist | Drive] | None) -> Instant:
        return self._simulation.step(override)

    def run(self, say: Say, until: float) -> Instant:
        now = self._simulation.now
        while not now.ended and now.time < until - self._simulation.setting.dt / 2:
            now = self._simulation.step()
            say(now.time)
        return now

    def statistics(self, say: Say) -> list[statistics.Row]:
        return self._simulation.statistics()

    def outcome(self, say: Say) -> Outcome:
        return self._simulation.outcome

    def forked(self, changes: Sequence[Change], folder: Path) -> None:
        before, self._folder = self._folder, folder / "files"
        take_own_copies(before, self._folder)
        self._simulation.goes_on_in(self._folder)
        if changes:
            scenario = self._prepared.scenario.branched(branch_of(self._simulation.now.time, changes))
            prepared = branched(self._prepared, scenario)
            self._simulation.becomes(setting_of(prepared, self._folder))
            self._prepared = after_branch(prepared)

    def close(self) -> None:
        self._simulation.close()
