"""Faults that nothing else has turned into words: one line each, and a file with the rest."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Iterator
from typing import TYPE_CHECKING

from platoontraffic.errors import shortened

if TYPE_CHECKING:
    from platoontraffic.world.prepared import Prepared

LONGEST = 300  # text of an exception in its line [characters]

# It reads what faulthandler writes when this process dies by a signal. It has a session of its own, so that Ctrl-C in
# a terminal does not reach it.
_WATCHER = """
import sys, tempfile
words = sys.stdin.buffer.read()
if words != b"ended":
    cause = words.decode(errors="replace").partition("\\n")[0].partition(": ")[2]
    line = f"{sys.argv[1]}: the process died {sys.argv[2]} ({cause.lower() or 'killed, or ended by a law'})"
    try:
        with tempfile.NamedTemporaryFile(prefix="platoontraffic-", suffix=".txt", delete=False) as file:
            file.write(line.encode(errors="replace") + b"\\n" + words)
        line += f"; details: {file.name}" if words else ""
        file.close()
    except OSError:
        pass
    sys.stderr.write(line + "\\n")
"""


def line_of(error: Exception) -> str:
    """An unexpected exception in one line. The traceback is in a file that the line names, if one can be written."""
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, OSError) and error.strerror:
        what = error.strerror
    elif isinstance(error, MemoryError):
        what = "out of memory"
    else:
        what = f"unexpected {type(error).__name__}: {shortened(' '.join(str(error).split()), LONGEST)}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="platoontraffic-", suffix=".txt", delete=False, encoding="utf-8", errors="backslashreplace"
        ) as file:
            file.write("".join(traceback.format_exception(error)))
    except OSError:
        return what
    return f"{what}; details, to report it: {file.name}"


@contextlib.contextmanager
def one_line_at_death(loaded: str, when: str = "in the middle of the run") -> Iterator[None]:
    """Say one line on stderr if this process dies by a signal: SUMO dies of some input.

    loaded, when: the files that SUMO has loaded, or loads, and what it was doing; for that line
    """
    try:
        watcher = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _WATCHER, loaded, when], stdin=subprocess.PIPE, start_new_session=True
        )
    except OSError:  # a run needs no second process
        yield
        return
    faulthandler.enable(watcher.stdin, all_threads=False)
    try:
        yield
    finally:
        faulthandler.disable()
        with contextlib.suppress(OSError):
            os.write(watcher.stdin.fileno(), b"ended")
            watcher.stdin.close()
        watcher.wait()


def try_to_load(prepared: Prepared) -> None:
    """Have SUMO load all that a run loads, and step nothing. raises: InputError (SUMO refuses a file)"""
    from platoontraffic import recording

    scenario = prepared.scenario
    with one_line_at_death(f"{scenario.spec.name} ({recording.loaded(scenario)})", "while SUMO loaded its files"):
        recording.try_to_load(prepared)
