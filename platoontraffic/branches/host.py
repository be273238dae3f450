"""A process that holds one object, serves calls of it, and copies itself by forks: the inside of `process.Process`.

It has one thread, so that a fork is a whole copy: no bar, no listener, no thread of a library.
"""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import os
import pickle
import select
import signal
import sys
import traceback
from collections.abc import Callable
from functools import cache
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.reduction import recv_handle
from typing import Any

from platoontraffic.errors import InputError, RunError
from platoontraffic.results.conclusion import MetricError

PR_SET_PDEATHSIG = 1  # of <linux/prctl.h>
LOOK = 1.0  # interval at which an idle process looks whether its parent lives [s]

Say = Callable[[Any], None]  # tells the other side how far a call has come


class Host:
    """Serves calls that come over a connection.

    A call is (name, arguments): that method of the object is called, with `say` first. What is said on the way is
    ("said", value), its end ("done", result) or ("failed", exception). Both are plain pickles: those of
    `Connection.send` can also hold connections, and take longer.
    """

    def __init__(self, connection: Connection, parent: int) -> None:
        self._held: Any = None
        self._of(connection, parent)

    def _of(self, connection: Connection, parent: int) -> None:
        self._connection, self._parent = connection, parent
        self._forks: set[int] = set()
        self._calls = select.poll()  # made once: that of `Connection.poll` is made anew each time
        self._calls.register(connection, select.POLLIN)

    def serve(self) -> None:
        """Until the other side closes the connection, or the parent process ends."""
        while True:
            try:
                if not self._calls.poll(1e3 * LOOK):
                    if os.getppid() != self._parent:
                        return
                    continue
                name, arguments = pickle.loads(self._connection.recv_bytes())
                self._reap()
                self._answer(name, arguments)
            except (EOFError, OSError):
                return
            except KeyboardInterrupt:  # between two calls there is nothing to interrupt
                continue

    def close(self) -> None:
        """Close the object; kill the forks, which would be without a parent."""
        for fork in self._forks:
            with contextlib.suppress(OSError):
                os.kill(fork, signal.SIGKILL)
        if hasattr(self._held, "close"):
            self._held.close()

    def _answer(self, name: str, arguments: tuple) -> None:
        try:
            if name == "hold":
                module, _, kind = arguments[0].partition(":")
                self._held, result = getattr(import_module(module), kind)(*arguments[1:]), None
            elif name == "fork":
                result = self._fork(*arguments)
            else:
                result = getattr(self._held, name)(self._say, *arguments)
            self._send("done", result)
        except (Exception, KeyboardInterrupt) as error:
            self._send("failed", _sendable(error))

    def _fork(self, *arguments: Any) -> int | None:
        """Fork this process: the id of the fork, which has a connection of its own; in the fork None.

        The parent goes on when the copy's `forked` has returned: until then both share the offsets of open files.
        """
        other = recv_handle(self._connection)
        waits, tells = os.pipe()
        parent = os.getpid()
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        fork = os.fork()
        if fork:
            os.close(other)
            os.close(tells)
            os.read(waits, 1)  # nothing comes: it is closed
            os.close(waits)
            self._forks.add(fork)
            return fork
        os.close(waits)
        self._connection.close()
        self._of(Connection(other), parent)
        die_with(parent)
        try:
            self._held.forked(*arguments)
        except BaseException as error:
            self._send("failed", _sendable(error))
            os._exit(1)  # its files may still be the parent's: nothing is closed
        os.close(tells)
        return None

    def _reap(self) -> None:
        for fork in list(self._forks):
            if os.waitpid(fork, os.WNOHANG)[0]:
                self._forks.remove(fork)

    def _say(self, value: Any) -> None:
        self._send("said", value)

    def _send(self, kind: str, value: Any) -> None:
        self._connection.send_bytes(pickle.dumps((kind, value)))


def main(descriptor: int, parent: int) -> None:
    """
    descriptor : of the connection
    parent     : process that made this one
    """
    os.dup2(2, 1)  # prints of SUMO or a law are no results of the other side
    signal.signal(signal.SIGINT, signal.default_int_handler)
    faulthandler.register(signal.SIGUSR2)  # where does it hang?
    os.set_inheritable(descriptor, False)
    die_with(parent)
    host = Host(Connection(descriptor), parent)
    try:
        host.serve()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        host.close()
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)  # a fork never returns into what its parent was doing


def die_with(parent: int) -> None:
    """Have the system kill this process when the thread that started it has ended."""
    if sys.platform == "linux":
        _libc().prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(0)


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)


def _sendable(error: BaseException) -> BaseException:
    """The exception, with where it was raised as a note; exceptions of plug-ins may not exist on the other side."""
    if type(error) in (InputError, RunError, MetricError, KeyboardInterrupt, ValueError, RuntimeError):
        return error
    sent = RunError(f"{type(error).__name__}: {error}")
    sent.add_note("".join(traceback.format_exception(error)))
    return sent
