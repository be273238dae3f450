"""The processes of an environment: parents that have warmed up, an episode, and the next one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, NamedTuple

from platoontraffic.branches.process import Process
from platoontraffic.episodes.episodes import Episodes, Facts, Source
from platoontraffic.errors import InputError, RunError


class Plan(NamedTuple):
    """All that an episode depends on."""

    parent: int  # number, from 0
    seed: int  # of the sensors' errors
    values: dict[str, Any]  # keys of the scenario that were drawn


class _Next(NamedTuple):
    """An episode that is being made."""

    plan: Plan
    parent: Process
    connection: Connection  # to the episode
    folder: TemporaryDirectory


class Parents:
    """They are made when they are needed first, and end with this object, or with the thread that made them."""

    def __init__(self, source: Source) -> None:
        """raises: InputError, MissingError (this system has no fork), RunError (a member cannot be inserted)"""
        self._source = source
        self._folder = TemporaryDirectory(prefix="platoontraffic-", ignore_cleanup_errors=True)
        self._processes: dict[int, Process] = {}
        self._episode: Process | None = None
        self._of_episode: TemporaryDirectory | None = None
        self._last: tuple[Process | None, TemporaryDirectory | None] = None, None  # that is ending
        self._next: _Next | None = None
        self.facts: Facts = self._parent(0).call("facts")

    def begin(self, plan: Plan) -> tuple:
        """The first frame of a new episode, as `Frame.plain`; it ends the last one.

        raises: InputError, RunError, KeyboardInterrupt
        """
        _end(*self._last)
        self._last = self._episode, self._of_episode
        self._episode = self._of_episode = None
        try:
            if self._next and self._next.plan != plan:
                with contextlib.suppress(InputError, RunError):  # of an episode that nobody asked for
                    self._answer()
                self.end()
            if self._next is None:
                self._send(plan)
            self._answer()
            self._kill_last()  # not before: while its memory is freed, a fork takes twice as long
            return self._episode.answer()
        except KeyboardInterrupt:
            self.end()
            raise
        finally:
            self._kill_last()

    def _kill_last(self) -> None:
        if self._last[0] and not self._last[0].closed:
            self._last[0].kill()

    def prepare(self, plan: Plan) -> None:
        """Make an episode while another one goes on, if its parent is warm."""
        if self._next is None and plan.parent in self._processes and not self._processes[plan.parent].closed:
            with contextlib.suppress(RunError):  # `begin` makes the parent anew
                self._send(plan)

    def call(self, name: str, *arguments: Any) -> Any:
        """The result of a method of the episode. raises: RuntimeError (there is none), what the method raises"""
        if self._episode is None or self._episode.closed:
            raise RuntimeError("there is no episode: reset() begins one")
        return self._episode.call(name, *arguments)

    def end(self) -> None:
        """End the episode."""
        _end(self._episode, self._of_episode)
        self._episode = self._of_episode = None

    def close(self) -> None:
        if not all(parent.is_own for parent in self._processes.values()):  # in a fork of the program
            return
        self.end()
        _end(*self._last)
        if self._next:
            self._next.connection.close()
            self._next = None  # its parent ends it
        while self._processes:
            self._processes.popitem()[1].close()
        self._folder.cleanup()

    def _parent(self, number: int) -> Process:
        if number not in self._processes or self._processes[number].closed:
            folder = Path(mkdtemp(dir=self._folder.name))
            self._processes[number] = Process.holding(Episodes, self._source, number, folder)
        return self._processes[number]

    def _send(self, plan: Plan) -> None:
        """Begin to make an episode."""
        parent = self._parent(plan.parent)
        folder = TemporaryDirectory(prefix="platoontraffic-", dir=self._folder.name, ignore_cleanup_errors=True)
        with _forgotten_if_interrupted(parent):
            connection = parent.send_fork(plan.seed, plan.values, Path(folder.name), then="begin")
            self._next = _Next(plan, parent, connection, folder)

    def _answer(self) -> None:
        """Wait for the fork that is to be the episode."""
        made, self._next = self._next, None
        self._of_episode = made.folder
        with _forgotten_if_interrupted(made.parent):
            self._episode = made.parent.answer_fork(made.connection)


@contextlib.contextmanager
def _forgotten_if_interrupted(parent: Process) -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:  # what comes from it next would be the answer to another call
        parent.kill()
        parent.close()
        raise


def _end(episode: Process | None, folder: TemporaryDirectory | None) -> None:
    if episode and not episode.closed:
        episode.kill()
        episode.close()
    if folder:
        folder.cleanup()
