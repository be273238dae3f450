"""SUMO in a process of its own, called through traci; the only file that imports traci."""

from __future__ import annotations

import contextlib
import io
import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

from platoontraffic.sumo.programs import home_of, program

RETRY_AFTER = 0.1  # until SUMO has read its network and listens [s]
PATIENCE = 10.0  # with a SUMO that is to end [s]


class RemoteSumo:
    """A `Client`: has the functions of the module libsumo; they go to a SUMO of its own.

    Any number of them may run in one process, each with its own connection. A call takes 10 to 100 times longer than
    libsumo's.

    name: of the program
    """

    def __init__(self, name: str = "sumo") -> None:
        """raises: MissingError (eclipse-sumo is not installed)"""
        self._program = program(name)
        self._connection: Any = None  # has a domain by each of libsumo's names

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    @property
    def constants(self) -> ModuleType:
        return _traci().tc

    @property
    def TraCIException(self) -> type[Exception]:
        return _traci().TraCIException

    @property
    def FatalTraCIError(self) -> type[Exception]:
        return _traci().FatalTraCIError

    def start(self, options: Sequence[str]) -> None:
        """Start the program with SUMO's options, and wait until it has read all files.

        raises: TraCIException (it refuses them)
        """
        self._folder = tempfile.TemporaryDirectory(prefix="platoontraffic-")
        self._words.touch()
        with socket.create_server(("localhost", 0)) as free:
            port = free.getsockname()[1]
        options = [*options[1:], *self._more_options(options)]
        options += ["--error-log", self._words, "--remote-port", str(port)]
        with self._stderr.open("wb") as file:
            self._process = subprocess.Popen(
                [self._program, *options],
                env=home_of(self._program),
                stdout=file,
                stderr=file,
                start_new_session=True,  # Ctrl-C is for this process, which then ends SUMO
            )
        try:
            with redirect_stdout(io.StringIO()):  # traci counts its tries there
                # No label: traci would keep a connection with one in a table of the process.
                self._connection = _traci().connect(port, sys.maxsize, "localhost", self._process, RETRY_AFTER)
            self._connection.getVersion()  # answered when all files have been read
        except BaseException as error:
            reason = self._why_not_started(error)
            self._end()
            if reason is error:
                raise
            raise reason from error

    @property
    def _words(self) -> Path:
        """SUMO's warnings and errors."""
        return Path(self._folder.name, "words")

    @property
    def _stderr(self) -> Path:
        return Path(self._folder.name, "stderr")

    def _more_options(self, options: Sequence[str]) -> Sequence[Any]:
        """The program's own, beside SUMO's."""
        return ()

    def _why_not_started(self, error: BaseException) -> BaseException:
        """The error of this package for an error at the start."""
        if not isinstance(error, self.FatalTraCIError):
            return error
        self._exit_code()  # before it is killed: it still writes why it ends
        return self.TraCIException(str(error))

    def _exit_code(self) -> int | None:
        """Exit code of a SUMO that answers no more; None if it does not end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self._process.wait(PATIENCE)
        return None

    def simulationStep(self, until: float = 0.0) -> None:
        self._connection.simulationStep(until)

    def close(self) -> None:
        watchdog = threading.Timer(PATIENCE, self._process.kill)
        watchdog.start()
        with contextlib.suppress(Exception):  # interrupted between question and answer, traci may raise anything
            self._connection.close(wait=False)
            self._process.wait()
        watchdog.cancel()
        self._end()

    def _end(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        os.write(2, self._words.read_bytes())  # where libsumo prints its messages
        self._folder.cleanup()


def _traci() -> ModuleType:
    """Not the package: where libsumo has imported it, that is libsumo under another name."""
    import traci.main

    return traci.main
