"""A process with all that it has started: its memory, and its end. Memory needs /proc, as Linux has it."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from pathlib import Path
from typing import NamedTuple

PROC = Path("/proc")
PERIOD = 0.5  # age at which the list of processes is read again [s]
ROUNDS = 20  # attempts to end a tree in which processes start others all the time


class _Kin(NamedTuple):
    parent: int
    session: int


class Census:
    """The processes of this machine, read from /proc at most once in `PERIOD`."""

    def __init__(self) -> None:
        self._kin: dict[int, _Kin] = {}
        self._due = 0.0
        self._lock = threading.Lock()

    def memory(self, pid: int) -> float:
        """Resident and swapped memory of a process, which leads a session, and of all below it [MB].

        Pages that a fork shares with its parent count for both. raises: OSError if there is no /proc
        """
        with self._lock:
            if time.monotonic() > self._due:
                self._kin = _living()
                self._due = time.monotonic() + PERIOD
            tree = _tree(pid, self._kin)
        return sum(map(_memory, tree | {pid}))


def end(pid: int) -> None:
    """Kill a process, which leads a session, and all that it has started, as far as they can be found."""
    for _ in range(ROUNDS):
        try:
            tree = _tree(pid, _living())  # before any ends: the system gives its children to another
        except OSError:  # no /proc
            tree = set()
        with contextlib.suppress(OSError):
            os.killpg(pid, signal.SIGKILL)
        for member in tree:
            with contextlib.suppress(OSError):
                os.kill(member, signal.SIGKILL)
        if not tree:
            return


def _tree(pid: int, kin: dict[int, _Kin]) -> set[int]:
    """The process, if it lives, all of its session, and all below one of these."""
    found = {member for member, (_, session) in kin.items() if member == pid or session == pid}
    while new := {member for member, (parent, _) in kin.items() if parent in found} - found:
        found |= new
    return found


def _living() -> dict[int, _Kin]:
    """All processes that are not zombies. raises: OSError if there is no /proc"""
    kin = {}
    for name in os.listdir(PROC):
        if name.isdecimal():
            with contextlib.suppress(OSError):  # it has ended in the meantime
                # pid (name, which may have blanks and brackets) state parent group session ...
                state, parent, _, session = (PROC / name / "stat").read_text().rpartition(")")[2].split()[:4]
                if state not in "ZX":
                    kin[int(name)] = _Kin(int(parent), int(session))
    return kin


def _memory(pid: int) -> float:
    """[MB]; 0 if the process has ended."""
    try:
        lines = (PROC / str(pid) / "status").read_text(errors="replace").splitlines()
    except OSError:
        return 0.0
    return sum(int(line.split()[1]) * 1024e-6 for line in lines if line.startswith(("VmRSS:", "VmSwap:")))
