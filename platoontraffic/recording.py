"""A run: a simulation that is recorded, from a prepared scenario to a folder of results."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import tomli_w

from platoontraffic.controllers.external import External
from platoontraffic.errors import InputError, MissingError, RunError
from platoontraffic.observation.instant import Instant
from platoontraffic.results import provenance
from platoontraffic.results.columns import STATISTICS
from platoontraffic.results.conclusion import MetricError, conclude, scene
from platoontraffic.results.own_copies import take_own_copies
from platoontraffic.results.recorder import Clocks, Recorder, check_place, is_done
from platoontraffic.results.sumo_refusal import loaded
from platoontraffic.scenario import Scenario
from platoontraffic.scenario.drivers import key_of
from platoontraffic.simulation import Outcome, Prepared, Simulation, prepare, setting_of
from platoontraffic.sumo.window import Window
from platoontraffic.sumo.world import World
from platoontraffic.world.events import Event

__all__ = [
    "Recording", "Watcher", "Window", "check_place", "is_done", "loaded", "prepare", "result_folder", "run",
    "try_to_load",
]  # fmt: skip

SUMO_WORDS = 100  # first lines of run.log that provenance.json repeats


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


class Warm(NamedTuple):
    """SUMO after a warm-up, in this process."""

    world: World
    folder: Path  # of its files


class Recording:
    """A run while it lasts: a simulation, and the folder that it is recorded in.

    Whatever fails ends it, and leaves the folder as `run` says; errors as of `run`.
    """

    def __init__(
        self,
        prepared: Prepared,
        folder: Path,
        window: Window | None = None,
        forkable: bool = False,
        warm: Warm | None = None,
    ) -> None:
        """
        forkable : the process may be forked; see `goes_on_as`
        warm     : what it begins with, in place of a SUMO of its own
        """
        scenario, spec = prepared.scenario, prepared.scenario.spec
        if any(isinstance(m.law, External) for m in prepared.members):
            outside = [role for role, law in scenario.laws.items() if isinstance(law, External)]
            what = "'external' has its commands from a program that steps the simulation; a run needs another law"
            raise InputError(*(scenario.fault((*key_of(spec, role), "law"), what) for role in outside))
        self._window, self._wall, self._closed = window, 0.0, False
        self._recorder = Recorder(folder, Clocks.of(spec.record, spec.run.step_s))
        world = warm and warm.world
        setting = setting_of(prepared, self._recorder.folder, window, forkable, world)
        self.simulation = Simulation(setting, provenance.Stopwatch())
        with self._ended_by_errors():
            if warm:
                take_own_copies(warm.folder, self._recorder.folder)
                world.logs_in(self._recorder.folder)
            self._run_of(prepared)

    def advance(self, watchers: Sequence[Watcher] = (), until: float = math.inf) -> Instant:
        """Simulate and record, until a time [s] or to the end; the last instant."""
        simulation, setting = self.simulation, self.simulation.setting
        if self._window:
            watchers = [*watchers, WindowWatcher(self._window, setting.dt)]
        last, timed, began = round(min(until / setting.dt, 2**53)), simulation.stopwatch.call, time.perf_counter()
        with self._ended_by_errors():
            now = simulation.now
            while now is None or not (now.ended or now.step >= last):
                now = simulation.reset() if now is None else simulation.step()
                timed("record", self._recorder.record, now)
                for watcher in watchers:
                    timed("show", watcher.show, now)
        self._wall += time.perf_counter() - began
        return now

    def goes_on_as(self, prepared: Prepared, folder: Path) -> None:
        """In a fork of the process: go on as the run of a scenario with a branch at this instant, in its own folder.

        What fails must end the fork at once: until then its files may be those of its parent.
        """
        self._recorder.goes_on_in(folder)
        self.simulation.goes_on_in(self._recorder.folder)
        self.simulation.becomes(setting_of(prepared, self._recorder.folder))
        self._run_of(prepared)

    def finish(self, replace: bool = False, say: Callable[[str], None] = lambda text: None) -> Path:
        """Write what is made of the complete tables; the folder. Arguments as of `run`."""
        recorder, prepared, simulation = self._recorder, self._prepared, self.simulation
        with self._ended_by_errors():
            began, outcome = time.perf_counter(), simulation.outcome
            self._close()
            wall = self._wall + time.perf_counter() - began
            _note_end(recorder, outcome)
            obstacles = [plan.id for plan in prepared.obstacles]
            waits = prepared.platooning.plan.waits if prepared.platooning else {}
            conclude(
                recorder,
                prepared.scenario,
                simulation.members,
                obstacles,
                simulation.encounters,
                simulation.trips(),
                waits,
            )
            messages = _messages((recorder.folder / "run.log").read_text(encoding="utf-8", errors="replace"))
            recorder.write("run.log", "".join(f"{line}\n" for line in messages))
            if recruits := simulation.setting.recruits:
                self._facts["not_equipped"] = dict(sorted(recruits.left.items()))
                self._facts["undrivable_routes"] = [fault._asdict() for fault in recruits.undrivable]
            facts = provenance.finished(
                self._facts, outcome.time, wall, simulation.stopwatch.seconds, messages[:SUMO_WORDS]
            )
            recorder.write_json("provenance.json", facts)
            finished = recorder.finish(replace)
        if recorder.moved:
            say(f"{recorder.moved}: was in the place of the results, with files that are not of the run; it is kept")
        return finished

    def abandon(self) -> None:
        """End it before its end; what was recorded is kept."""
        if not self._closed:
            with suppress(KeyboardInterrupt), self._ended_by_errors():
                raise KeyboardInterrupt

    def _run_of(self, prepared: Prepared) -> None:
        """Write what is known of a run before it."""
        self._prepared, recorder = prepared, self._recorder
        self._facts = provenance.before(prepared.scenario)
        recorder.write("config.toml", tomli_w.dumps(prepared.scenario.resolved(recorder.folder)))
        recorder.write_json("provenance.json", self._facts)
        recorder.write_json("scene.geojson", scene(prepared.scene, prepared.network))

    def _close(self, error: BaseException | None = None) -> None:
        """End SUMO, because of an error if there is one; the last table of the loop."""
        self._closed = True
        try:
            self._recorder.write_table("statistics.csv", self.simulation.statistics(), STATISTICS)
        finally:
            self.simulation.__exit__(type(error) if error else None, error, error and error.__traceback__)

    @contextmanager
    def _ended_by_errors(self) -> Iterator[None]:
        recorder = self._recorder
        try:
            try:
                yield
            except BaseException as error:
                if not self._closed:
                    self._close(error)
                raise
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


def try_to_load(prepared: Prepared) -> None:
    """Have SUMO load all that a run loads, and step nothing. raises: InputError (SUMO refuses a file)"""
    with setting_of(prepared).ground():
        pass


def run(
    prepared: Prepared,
    folder: Path,
    watchers: Sequence[Watcher] = (),
    *,
    replace: bool = False,
    window: Window | None = None,
    warm: Warm | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Path:
    """Simulate, and leave everything in `folder`; returns it.

    replace : replace the results of an equal run, which stay in place until these are complete
    window  : SUMO with a window, in place of the SUMO in this process
    warm    : what it begins with, in place of a SUMO of its own
    say     : called with a line if something else was in `folder`, which is kept beside it

    raises: RunError (SUMO or the disk failed), KeyboardInterrupt: what was recorded is kept in `<folder>.unfinished`;
            MetricError (a metric of a plug-in failed): likewise, with all other files;
            InputError (another plug-in failed), MissingError (no display): nothing is kept
    """
    recording = Recording(prepared, folder, window, warm=warm)
    recording.advance(watchers)
    return recording.finish(replace, say)


def _messages(log: str) -> list[str]:
    """SUMO's messages, without those that it has only because members are moved from outside."""
    said = log.splitlines()
    kept = [line for line in said if not ("moved by TraCI" in line and "implied speed" in line)]
    if not said:
        return []
    head = "SUMO's messages. A collision of a member here is none if events.csv has none: SUMO knows only its lane."
    if left_out := len(said) - len(kept):
        head += f" Left out: {left_out} warnings of implied speeds of members, which SUMO does not drive."
    return [head, *kept]


def _note_end(recorder: Recorder, outcome: Outcome) -> None:
    """The events at the end that no observer sees."""
    nowhere = np.nan, np.nan, "", np.nan
    recorder.note(
        Event(outcome.time, "never_departed", m.id, "", *nowhere, "no room until the end")
        for m in outcome.never_departed
    )
    recorder.note([Event(outcome.time, "end", "", "", *nowhere, outcome.ended, outcome.ended)])
