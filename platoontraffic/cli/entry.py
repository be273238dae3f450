"""The start of the program: standard streams that can be written, and one word at Ctrl-C, from the first import on."""

from __future__ import annotations

import os
import sys
from typing import Any

from platoontraffic.cli.signals import end_at_once


def main() -> None:
    """Entry point."""
    open_streams()
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")
    end_at_once()
    if fault := _of_the_shell(sys.argv[1:], os.environ.get("NUMBA_NUM_THREADS", "1")):
        print(fault, file=sys.stderr)
        sys.exit(2)
    from platoontraffic.cli.main import app

    try:
        code = app(standalone_mode=False)
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        code = _of_usage(error)
    sys.exit(code)


def _of_usage(error: Any) -> int:
    """Say what is wrong with the words of a command in one line; returns the exit code.

    error: click's, or that of the copy of click in typer
    """
    if type(error).__name__ == "NoArgsIsHelpError":  # no words at all: the help
        error.show()
    else:
        print(f"platoontraffic: {' '.join(error.format_message().split()).rstrip('.')}", file=sys.stderr)
    return error.exit_code


def open_streams() -> None:
    """Open those of stdin, stdout and stderr that are closed, as for a daemon, on the null device.

    Otherwise the next files to be opened would be them, and SUMO's messages would go into a table.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
            os.set_inheritable(number, True)
            setattr(sys, name, open(number, mode, encoding="utf-8"))  # noqa: SIM115 (for the whole process)


def _of_the_shell(arguments: list[str], threads: str) -> str:
    """What is wrong with how the command is called; "" if nothing is."""
    for number, argument in enumerate(arguments, start=1):
        try:
            argument.encode()
        except UnicodeEncodeError:
            return f"word {number} of the command, {argument!a}: is not UTF-8"
        name, equals, value = argument.partition("=")
        if not argument:  # as of a variable of the shell that is not set; as a path it would be the working directory
            return f"word {number} of the command: is empty; must be a text, or be left out"
        if name.startswith("--") and equals and not value:
            return f"{name}: is empty; must be a text, or be left out"
    sound = threads.isdecimal() and int(threads) > 0
    return "" if sound else f"NUMBA_NUM_THREADS={threads}: must be a whole number, 1 or more"
