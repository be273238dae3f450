"""The processes of an environment: parents that have warmed up, and the episode, a fork of one of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

from platoontraffic.branches.process import Process
from platoontraffic.episodes.episodes import Episodes, Facts, Frame, Source


class Parents:
    """They are made when they are needed first, and end with this object, or with the thread that made them."""

    def __init__(self, source: Source) -> None:
        """raises: InputError, MissingError (this system has no fork)"""
        self._source = source
        self._folder = TemporaryDirectory(prefix="platoontraffic-", ignore_cleanup_errors=True)
        self._processes: dict[int, Process] = {}
        self._episode: Process | None = None
        self._of_episode: TemporaryDirectory | None = None
        self.facts: Facts = self._parent(0).call("facts")

    def begin(self, number: int, seed: int, values: Mapping[str, Any]) -> Frame:
        """The first frame of a new episode, which ends the last one. raises: InputError, RunError, KeyboardInterrupt"""
        last, self._episode = (self._episode, self._of_episode), None
        if last[0] and not last[0].closed:
            last[0].kill()  # it ends while the next one begins
        try:
            parent = self._parent(number)
            folder = TemporaryDirectory(prefix="platoontraffic-", dir=self._folder.name, ignore_cleanup_errors=True)
            self._of_episode = folder
            try:
                self._episode = parent.fork(seed, dict(values), Path(folder.name))
            except KeyboardInterrupt:  # what comes from it next would be the answer to another call
                parent.kill()
                self._processes.pop(number).close()
                raise
            return self.call("begin")
        finally:
            _end(*last)

    def call(self, name: str, *arguments: Any) -> Any:
        """The result of a method of the episode. raises: RuntimeError (there is none), what the method raises"""
        if self._episode is None or self._episode.closed:
            raise RuntimeError("there is no episode: reset() begins one")
        return self._episode.call(name, *arguments)

    def end(self) -> None:
        """End the episode."""
        last = self._episode, self._of_episode
        self._episode = self._of_episode = None
        _end(*last)

    def close(self) -> None:
        self.end()
        while self._processes:
            self._processes.popitem()[1].close()
        self._folder.cleanup()

    def _parent(self, number: int) -> Process:
        if number not in self._processes or self._processes[number].closed:
            folder = Path(mkdtemp(dir=self._folder.name))
            self._processes[number] = Process.holding(Episodes, self._source, number, folder)
        return self._processes[number]


def _end(episode: Process | None, folder: TemporaryDirectory | None) -> None:
    if episode and not episode.closed:
        episode.kill()
        episode.close()
    if folder:
        folder.cleanup()
