"""The process of a warm-up, and of each run that begins with it: the inside of `warm_ups`."""

from __future__ import annotations

import os
import shutil
from contextlib import ExitStack
from pathlib import Path

from platoontraffic import scenario
from platoontraffic.branches.host import Say
from platoontraffic.recording import Warm
from platoontraffic.results.own_copies import take_own_copies
from platoontraffic.simulation import prepare, setting_of
from platoontraffic.study.silence import Job, Outcome
from platoontraffic.study.worker import alone, attempt


class WarmRoad:
    """Background traffic after its warm-up, inside the process."""

    def __init__(self, job: Job, folder: Path) -> None:
        checked = scenario.load(job["base"], [scenario.Change(*change) for change in job["changes"]], job["seed"])
        prepared = prepare(checked)
        self._network, self._folder = prepared.network, folder / "files"
        self._folder.mkdir()
        self._open = ExitStack()  # never closed: the process ends
        self._world = self._open.enter_context(setting_of(prepared, self._folder, forkable=True).ground())
        self._world.warm_up()

    def forked(self, job: Job) -> None:
        os.setsid()  # whatever the run starts is found by its session
        before, self._folder = self._folder, self._folder.with_name(str(os.getpid()))
        take_own_copies(before, self._folder)

    def run(self, say: Say, job: Job) -> Outcome:
        with alone(Path(job["lock"]), job["id"]):
            outcome = attempt(job, say, self._network, Warm(self._world, self._folder))
        shutil.rmtree(self._folder, ignore_errors=True)
        return outcome
