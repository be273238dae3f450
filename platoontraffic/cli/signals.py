"""Signals that end the program. One that is ignored stays so: SIGINT in a shell's background jobs, SIGHUP by nohup."""

from __future__ import annotations

import _thread
import errno
import os
import signal
import sys
import threading
from types import FrameType

AGAIN_AFTER = 1.0  # Ctrl-C that ended nothing comes again after this time [s]

_lost: list[BaseException] = []  # KeyboardInterrupts that ended nothing: see `_raise_again`


def end_at_once() -> None:
    """End at Ctrl-C without a traceback, until a command begins; nothing can be lost before."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


def command_begins() -> None:
    """Raise KeyboardInterrupt at Ctrl-C from now on, again if it is lost."""
    if signal.getsignal(signal.SIGINT) is _end:
        sys.unraisablehook = _raise_again
        signal.signal(signal.SIGINT, signal.default_int_handler)


def is_of_control_c(error: BaseException | None) -> bool:
    """Whether it is a KeyboardInterrupt, or comes of one: compiled code makes a SystemError of it, and the compiler,
    which loses it in a callback, fails a little later."""
    while isinstance(error, SystemError):
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt) or bool(_lost)


def _raise_again(unraisable: sys.UnraisableHookArgs) -> None:
    """Note a KeyboardInterrupt that Python can raise to nobody, as in a callback of C, and raise one a little later,
    where what called back has not failed by then."""
    if not isinstance(unraisable.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    _lost.append(unraisable.exc_value)
    again = threading.Timer(AGAIN_AFTER, _thread.interrupt_main)
    again.daemon = True
    again.start()


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
