"""Signals that end the program. One that is ignored stays so: SIGINT in a shell's background jobs, SIGHUP by nohup."""

from __future__ import annotations

import os
import signal
from types import FrameType

# A cluster ends jobs by SIGTERM, a terminal that is closed by SIGHUP. Windows has no SIGHUP.
OF_THE_SYSTEM = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


def end_at_once() -> None:
    """End at Ctrl-C without a traceback, until a command begins; nothing can be lost before."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def command_begins() -> None:
    """Raise KeyboardInterrupt at Ctrl-C from now on."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def end_as_at_control_c() -> None:
    """Raise KeyboardInterrupt at the system's signals too: what was recorded is then kept."""
    for number in OF_THE_SYSTEM:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


def _end(number: int, frame: FrameType | None) -> None:
    """Not by an exception, which an import of compiled code may turn into another one."""
    os.write(2, b"interrupted\n")
    os._exit(130)
