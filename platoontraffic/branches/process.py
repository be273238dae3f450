"""A process that holds one object and can be forked, seen from outside: calls go in, results and errors come out."""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.reduction import send_handle
from typing import Any, Self

from platoontraffic.errors import MissingError, RunError

# A simulation has one thread; further threads of its libraries would only compete with the processes beside it.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
GRACE = 5.0  # time that a process has to close what it holds [s]

can_fork = hasattr(os, "fork")


class Process:
    """A process made to be forked: it holds one object, of which methods are called, and has one thread.

    The object's methods get `say` before their arguments: what they say on the way comes to `heard`. In a fork, its
    method `forked` is called first.
    """

    def __init__(self, quiet: bool = False) -> None:
        """quiet: what is written to its stderr is lost. raises: MissingError where there is no fork"""
        if not can_fork:
            raise MissingError("this system has no fork, so processes cannot be copied")
        ours, theirs = socket.socketpair()
        with theirs:
            code = (
                f"import sys; sys.path[:] = {sys.path!r}\n"
                f"from platoontraffic.branches.host import main; main({theirs.fileno()}, {os.getpid()})"
            )
            self._popen: subprocess.Popen | None = subprocess.Popen(
                [sys.executable, "-X", "faulthandler", "-c", code],
                stdin=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL if quiet else None,
                pass_fds=[theirs.fileno()],
                env=ONE_THREAD | os.environ,
                start_new_session=True,  # Ctrl-C in a terminal is for this process, which tells the others
            )
        self._open(Connection(ours.detach()), self._popen.pid)

    @classmethod
    def holding(cls, kind: type, *arguments: Any) -> Self:
        """A process that holds kind(*arguments), which is made there. raises: what that raises; as the class"""
        process = cls()
        process.call("hold", f"{kind.__module__}:{kind.__qualname__}", *arguments)
        return process

    def _open(self, connection: Connection, pid: int) -> None:
        self._connection, self.pid, self._owner = connection, pid, os.getpid()
        self.close = weakref.finalize(self, _close, self._owner, connection, pid, getattr(self, "_popen", None))

    def call(self, name: str, *arguments: Any, heard: Callable[[Any], None] = lambda value: None) -> Any:
        """The result of a method of the object.

        raises: what the method raises; RunError if the process has died; KeyboardInterrupt, also in the method
        """
        if self.closed:
            raise RuntimeError("the process is closed")
        self.send(name, *arguments)
        try:
            kind, value = self._end(heard)
        except BaseException:  # Ctrl-C, or an error of `heard`: a later call would get the answer to this one
            self.interrupt()
            self.close()
            raise
        if kind == "failed":
            raise value
        return value

    def send(self, name: str, *arguments: Any) -> None:
        """Begin a call, the result of which `answer` gives; the process is busy until then."""
        try:
            self._connection.send_bytes(pickle.dumps((name, arguments)))
        except OSError:
            raise self._dead() from None

    def answer(self, heard: Callable[[Any], None] = lambda value: None) -> Any:
        """The result of the call that was sent; errors as of `call`."""
        kind, value = self._end(heard)
        if kind == "failed":
            raise value
        return value

    def _end(self, heard: Callable[[Any], None]) -> tuple[str, Any]:
        while True:
            kind, value = self.word()
            if kind != "said":
                return kind, value
            heard(value)

    def word(self) -> tuple[str, Any]:
        """What comes next of a call: "said", "done" or "failed", and the value, result or exception.

        raises: RunError if the process has died
        """
        try:
            return pickle.loads(self._connection.recv_bytes())
        except (EOFError, OSError):
            raise self._dead() from None

    def fork(self, *arguments: Any) -> Self:
        """An exact copy of the process, of which the object's method `forked` was called with these arguments.

        raises: what that raises, RunError
        """
        return self.answer_fork(self.send_fork(*arguments))

    def send_fork(self, *arguments: Any, then: str = "") -> Connection:
        """Begin a `fork`, which `answer_fork` gives: the connection to it; the process is busy until then.

        then: method that the copy calls next; its `answer` gives the result
        """
        ours, theirs = socket.socketpair()
        connection = Connection(ours.detach())
        with theirs:
            self.send("fork", *arguments)
            try:
                send_handle(self._connection, theirs.fileno(), self.pid)
            except OSError:  # it has died in the meantime
                raise self._dead() from None
        if then:
            connection.send_bytes(pickle.dumps((then, ())))
        return connection

    def answer_fork(self, connection: Connection) -> Self:
        """The `fork` of this connection; errors as there."""
        pid = self.answer()
        fork = type(self).__new__(type(self))
        fork._open(connection, pid)
        fork.answer()
        return fork

    def speaks(self, within: float) -> bool:
        """Whether there is a `word` within a time [s]; also if it has died."""
        try:
            return self._connection.poll(within)
        except OSError:  # it was closed by another thread
            return True

    @property
    def is_own(self) -> bool:
        """This program made it, and is no fork of the one that did."""
        return os.getpid() == self._owner

    def kill(self) -> None:
        if not self.is_own:
            return
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def fileno(self) -> int:
        """For `multiprocessing.connection.wait`: when there is something to `answer`."""
        return self._connection.fileno()

    def interrupt(self) -> None:
        """Raise KeyboardInterrupt in the method that is called."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGINT)

    @property
    def closed(self) -> bool:
        return not self.close.alive

    def _dead(self) -> RunError:
        self.close()
        return RunError(f"the process of the simulation ({self.pid}) has died")


def _close(owner: int, connection: Connection, pid: int, popen: subprocess.Popen | None) -> None:
    """Let the process close what it holds, and kill it if that takes too long. When it ends, its connection does.

    owner: id of the process that made it; in a fork of that one only the copy of the connection is closed
    """
    if os.getpid() != owner:
        connection.close()
        return
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(connection.fileno())) as ours:
        ours.shutdown(socket.SHUT_WR)
    until = time.monotonic() + GRACE
    try:
        while connection.poll(max(until - time.monotonic(), 0.0)):
            connection.recv_bytes()  # of a call that is not answered
        os.kill(pid, signal.SIGKILL)
    except (EOFError, OSError):  # it has ended
        pass
    connection.close()
    if popen:
        popen.wait()
