"""The start of the program: standard streams that can be written, and one word at Ctrl-C, from the first import on."""

from __future__ import annotations

import os
import sys

from platoontraffic.cli.signals import end_at_once


def main() -> None:
    """Entry point."""
    open_streams()
    end_at_once()
    from platoontraffic.cli.main import app

    app()


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
