"""Signals that end the program. One that is ignored stays so: SIGINT in a shell's background jobs, SIGHUP by nohup."""

from __future__ import annotations

import errno
import os
import signal
from types import FrameType


def end_at_once() -> None:
    """End at Ctrl-C without a traceback, until a command begins; nothing can be lost before."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def command_begins() -> None:
    """Raise KeyboardInterrupt at Ctrl-C from now on."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def is_of_control_c(error: BaseException | None) -> bool:
    """Whether it is a KeyboardInterrupt, or compiled code has made a SystemError of one."""
    while isinstance(error, SystemError):
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt)


def end_as_at_control_c() -> None:
    """Raise KeyboardInterrupt at the system's signals too: what was recorded is then kept."""
    # A cluster ends jobs by SIGTERM, a terminal that is closed by SIGHUP. Windows has no SIGHUP.
    for name, handler in (("SIGTERM", signal.default_int_handler), ("SIGHUP", _hung_up)):
        number = getattr(signal, name, None)
        if number and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, handler)


def _hung_up(number: int, frame: FrameType | None) -> None:
    """KeyboardInterrupt; what is still said to a terminal that is gone goes nowhere, instead of being an error."""
    import termios  # not on Windows

    null = os.open(os.devnull, os.O_RDWR)
    for name in os.listdir("/dev/fd"):  # stderr may have another number while SUMO's messages go to its log
        try:
            termios.tcgetattr(int(name))
        except termios.error as error:
            if error.args[0] == errno.EIO:
                os.dup2(null, int(name))
    os.close(null)
    raise KeyboardInterrupt


def _end(number: int, frame: FrameType | None) -> None:
    """Not by an exception, which an import of compiled code may turn into another one."""
    os.write(2, b"interrupted\n")
    os._exit(130)
