"""SUMO's process: where its messages go."""

import contextlib
import itertools
import os
import sys

import pytest

from platoontraffic.sumo import process
from platoontraffic.sumo.process import Process


class _Silent:
    """A SUMO that does nothing."""

    class TraCIException(Exception):
        pass

    class FatalTraCIError(Exception):
        pass

    def start(self, options):
        pass

    def simulationStep(self, until):
        os.write(2, b"of SUMO\n")

    def close(self):
        os.write(2, b"of SUMO\n")


def _interrupt_at_line(number):
    """Raise KeyboardInterrupt, as Ctrl-C may, before the line of that number that `process` runs from now on."""
    left = number

    def trace(frame, event, _):
        nonlocal left
        if frame.f_code.co_filename != process.__file__:
            return None
        if event == "line":
            left -= 1
            if left < 0:
                sys.settrace(None)
                raise KeyboardInterrupt
        return trace

    sys.settrace(trace)


@contextlib.contextmanager
def _stderr_is(path):
    """Descriptor 2 is a file."""
    before = os.dup(2)
    with path.open("wb") as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)


def _started(sumo):
    sumo.start([])


def _stepped(sumo):
    sumo.step()


def _closed(sumo):
    sumo.close(None)


@pytest.mark.skipif(sys.gettrace() is not None, reason="the tests are traced")
@pytest.mark.parametrize("interrupted", [_started, _stepped, _closed])
def test_ctrl_c_at_any_line_leaves_stderr_to_the_program(tmp_path, interrupted):
    calls = [_started, _stepped, _closed]
    before, after = calls[: calls.index(interrupted)], calls[calls.index(interrupted) + 1 :]
    for line in itertools.count():
        terminal, is_interrupted = tmp_path / f"terminal {line}", False
        sumo = Process(_Silent(), tmp_path / "net.xml", tmp_path / "log")
        with _stderr_is(terminal):
            for call in before:
                call(sumo)
            _interrupt_at_line(line)
            try:
                interrupted(sumo)
            except KeyboardInterrupt:
                is_interrupted = True
            finally:
                sys.settrace(None)
            if not (is_interrupted and interrupted is _started):
                for call in after:
                    call(sumo)
            os.write(2, b"of the program\n")
        assert terminal.read_bytes() == b"of the program\n", f"interrupted at line {line} of those that ran"
        if not is_interrupted:
            break
    assert line > 10
