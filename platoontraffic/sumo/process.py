"""SUMO from start to close: its options, the messages that it prints, and its failures as errors of this package."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from platoontraffic.errors import InputError, RunError
from platoontraffic.sumo.client import Client, libsumo

# The network that libsumo simulates now. It holds one simulation a process; a second start would replace the first
# without a message.
_in_this_process: list[Path] = []
CLOSED = -1  # a descriptor of stderr where that is closed


def start_options(network: Path, step: float, seed: int, more: Mapping[str, str]) -> list[str]:
    """SUMO's command line.

    step: [s]
    more: options by their names without dashes: files to read and to write
    """
    options = [
        "sumo",
        *("--step-length", str(step), "--seed", str(seed)),
        *("--time-to-teleport", "-1", "--collision.action", "warn", "--collision.check-junctions", "true"),
        *("--collision.mingap-factor", "0", "--emergencydecel.warning-threshold", "1000000"),
        *("--no-step-log", "true", "--duration-log.disable", "true", "--precision", "6"),
    ]
    for option, value in {"net-file": str(network), **more}.items():
        options += [f"--{option}", value]
    return options


class RefusedError(InputError):
    """SUMO refuses its input; words: SUMO's own."""

    def __init__(self, network: Path, words: str) -> None:
        super().__init__(f"{network}: SUMO refuses it: {words}")
        self.words = words


class FailedError(RunError):
    """SUMO failed while it was running.

    when  : `40 s` of its clock, or `its end`
    words : SUMO's own
    """

    def __init__(self, when: str, words: str) -> None:
        super().__init__(f"SUMO failed at {when}: {words}")
        self.when, self.words = when, words


class Process:
    """A SUMO that is started, stepped and closed.

    network : file that it simulates, for messages
    log     : file to which its messages are appended
    """

    def __init__(self, sumo: Client, network: Path, log: Path) -> None:
        self._sumo, self._network, self.log = sumo, network, log
        self._stderr: int | None = None  # a descriptor of it, while messages go to the log

    def start(self, options: Sequence[str]) -> None:
        """raises: RunError (libsumo already runs in this process), RefusedError"""
        if self._sumo is libsumo and _in_this_process:
            running = _in_this_process[0]
            raise RunError(f"SUMO already runs {running} in this process; libsumo holds one simulation a process")
        self._file = self.log.open("ab")
        self._log_number = self._file.fileno()
        try:
            with self._logged():
                self._sumo.start(options)
        except BaseException as error:
            self._log_ends()
            self._file.close()
            if isinstance(error, self._sumo.TraCIException):
                raise RefusedError(self._network, self._reason(error)) from error
            raise
        if self._sumo is libsumo:
            _in_this_process.append(self._network)

    def step(self, until: float = 0.0) -> None:
        """One step, or all steps to a time of SUMO's clock [s]."""
        try:
            self._log_begins()
            self._sumo.simulationStep(until)
        finally:
            self._log_ends()

    def close(self, error: BaseException | None) -> None:
        """End SUMO, if that has not been done.

        error : because of which it is closed
        raises: FailedError in its place, if SUMO failed
        """
        if self._file.closed:
            return
        if self._sumo is libsumo:
            _in_this_process.clear()
        failed = isinstance(error, (self._sumo.TraCIException, self._sumo.FatalTraCIError))
        when = "its end"
        if failed:
            with contextlib.suppress(self._sumo.FatalTraCIError):  # a remote SUMO may be gone
                when = f"{self._sumo.simulation.getTime():g} s"
        try:
            with self._logged():
                self._sumo.close()
        finally:
            self._log_ends()
            self._file.close()
        if failed:
            raise FailedError(when, self._reason(error)) from error

    def _reason(self, error: Exception) -> str:
        """SUMO's own first error message; its exception often says 'Process Error' only."""
        log = self.log.read_text(encoding="utf-8", errors="replace")
        errors = re.findall(r"^Error: *(.+(?:\n .+)*)", log, re.MULTILINE)  # continuation lines are indented
        return " ".join(errors[0].split()) if errors else str(error)

    @contextlib.contextmanager
    def _logged(self) -> Iterator[None]:
        try:
            self._log_begins()
            yield
        finally:
            self._log_ends()

    def _log_begins(self) -> None:
        """Messages go to the log: SUMO prints them from C++ to file descriptor 2, past Python's sys.stderr."""
        # Ctrl-C may come between any two lines. `_stderr` is set before descriptor 2 is turned to the log, so that a
        # later call of `_log_ends` restores it if Ctrl-C ended this one.
        if sys.stderr:  # None in a process without a console
            sys.stderr.flush()
        if self._stderr is None:
            try:
                self._stderr = os.dup(2)
            except OSError:
                self._stderr = CLOSED
        os.dup2(self._log_number, 2)

    def _log_ends(self) -> None:
        stderr = self._stderr
        if stderr is None:
            return
        if stderr == CLOSED:
            self._stderr = None
            with contextlib.suppress(OSError):  # Ctrl-C came before it was turned to the log
                os.close(2)
            return
        os.dup2(stderr, 2)
        self._stderr = None
        os.close(stderr)
