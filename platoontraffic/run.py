"""A run: a simulation that is recorded, from a prepared scenario to a folder of results."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import tomli_w

from platoontraffic.errors import InputError, MissingError, RunError
from platoontraffic.observation.instant import Instant
from platoontraffic.results import provenance
from platoontraffic.results.columns import STATISTICS
from platoontraffic.results.conclusion import MetricError, conclude, scene
from platoontraffic.results.recorder import Clocks, Recorder, is_done
from platoontraffic.results.sumo_refusal import loaded
from platoontraffic.scenario import Scenario
from platoontraffic.simulation import Outcome, Prepared, Simulation, prepare, setting_of
from platoontraffic.sumo.window import Window
from platoontraffic.world.events import Event

__all__ = ["Watcher", "Window", "is_done", "loaded", "prepare", "result_folder", "run"]

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


def run(
    prepared: Prepared,
    folder: Path,
    watchers: Sequence[Watcher] = (),
    *,
    replace: bool = False,
    window: Window | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Path:
    """Simulate, and leave everything in `folder`; returns it.

    replace : replace the results of an equal run, which stay in place until these are complete
    window  : SUMO with a window, in place of the SUMO in this process
    say     : called with a line if something else was in `folder`, which is kept beside it

    raises: RunError (SUMO or the disk failed), KeyboardInterrupt: what was recorded is kept in `<folder>.unfinished`;
            MetricError (a metric of a plug-in failed): likewise, with all other files;
            InputError (another plug-in failed), MissingError (no display): nothing is kept
    """
    spec = prepared.scenario.spec
    recorder = Recorder(folder, Clocks.of(spec.record, spec.run.step_s))
    try:
        _record(prepared, recorder, watchers, window)
        finished = recorder.finish(replace)
        if recorder.moved:
            say(f"{recorder.moved}: was in the place of the results, with files that are not of the run; it is kept")
        return finished
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


def _record(prepared: Prepared, recorder: Recorder, watchers: Sequence[Watcher], window: Window | None) -> None:
    """Write all files of a run but DONE."""
    scenario = prepared.scenario
    facts = provenance.before(scenario)
    recorder.write("config.toml", tomli_w.dumps(scenario.resolved(recorder.folder)))
    recorder.write_json("provenance.json", facts)
    recorder.write_json("scene.geojson", scene(prepared.scene, prepared.network))
    setting = setting_of(prepared, recorder.folder, window)
    if window:
        watchers = [*watchers, WindowWatcher(window, setting.dt)]
    began = time.perf_counter()
    with Simulation(setting) as simulation:
        timed = simulation.stopwatch.call
        try:
            for instant in simulation:
                timed("record", recorder.record, instant)
                for watcher in watchers:
                    timed("show", watcher.show, instant)
        finally:  # of a run that is interrupted, too
            recorder.write_table("statistics.csv", simulation.statistics(), STATISTICS)
        wall, outcome = time.perf_counter() - began, simulation.outcome
    _note_end(recorder, outcome)
    conclude(recorder, scenario, prepared.members, [plan.id for plan in prepared.obstacles], simulation.encounters)
    words = (recorder.folder / "run.log").read_text(errors="replace").splitlines()[:SUMO_WORDS]
    facts = provenance.finished(facts, outcome.time, wall, simulation.stopwatch.seconds, words)
    recorder.write_json("provenance.json", facts)


def _note_end(recorder: Recorder, outcome: Outcome) -> None:
    """The events at the end that no observer sees."""
    nowhere = np.nan, np.nan, "", np.nan
    recorder.note(
        Event(outcome.time, "never_departed", m.id, "", *nowhere, "no room until the end")
        for m in outcome.never_departed
    )
    recorder.note([Event(outcome.time, "end", "", "", *nowhere, outcome.ended, outcome.ended)])
