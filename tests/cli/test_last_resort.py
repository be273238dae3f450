"""What is said where nothing else is: exceptions without words of their own, and deaths by a signal."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from platoontraffic.cli import last_resort
from platoontraffic.cli.commands import commands_of
from tests.support import ROOT

LAW = """
from platoontraffic.controllers.reactive import ReactiveLeader

class Mine(ReactiveLeader):
    def __call__(self, *_):
        {act}
"""


def app_that_raises(error: BaseException) -> typer.Typer:
    app = typer.Typer()

    @commands_of(app)
    def fail() -> None:
        raise error

    return app


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (KeyError("x"), "unexpected KeyError: 'x'; details, to report it: "),
        (IndexError("a\nb"), "unexpected IndexError: a b; details, to report it: "),
        (MemoryError(), "out of memory; details, to report it: "),
        (RecursionError("deep"), "unexpected RecursionError: deep; details, to report it: "),
        (OSError(28, "No space left on device"), "No space left on device; details, to report it: "),
        (ValueError("x" * 10_000), "unexpected ValueError: xxx"),
    ],
)
def test_an_exception_is_one_line_and_a_file(error: Exception, said: str):
    done = CliRunner().invoke(app_that_raises(error), [])
    (line,) = done.stderr.splitlines()
    assert line.startswith(said)
    assert len(line) < 1000
    assert done.exit_code == 1
    rest = Path(line.partition("report it: ")[2])
    assert "Traceback" in rest.read_text(encoding="utf-8")
    rest.unlink()


def test_ctrl_c_in_compiled_code_is_one_word():
    inner, outer = SystemError("returned a result with an exception set"), SystemError("again")
    inner.__cause__, outer.__cause__ = KeyboardInterrupt(), inner
    outer.add_note("what was recorded until then is kept in x")
    done = CliRunner().invoke(app_that_raises(outer), [])
    assert (done.exit_code, done.stderr) == (130, "interrupted\nwhat was recorded until then is kept in x\n")


# Ctrl-C in a callback of C, where Python can raise it to nobody: so the compiler of kernels fails later.
LOST = """
import ctypes, os, signal, time
from platoontraffic.cli import entry, main
from platoontraffic.cli.commands import commands_of

@ctypes.CFUNCTYPE(None)
def callback():
    os.kill(os.getpid(), signal.SIGINT)
    sum(range(10))

def fail() -> None:
    callback()
    {then}

commands_of(main.app)(fail)
import sys
sys.argv = ["platoontraffic", "fail"]
signal.signal(signal.SIGINT, signal.default_int_handler)  # the tests may run under nohup
entry.main()
"""


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    "then", ['raise RuntimeError("no compiled object yet")', "[time.sleep(0.1) for _ in range(100)]"]
)
def test_ctrl_c_that_a_callback_loses_is_one_word(then: str):
    done = subprocess.run([sys.executable, "-c", LOST.format(then=then)], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")


def test_no_file_is_no_fault(monkeypatch: pytest.MonkeyPatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(last_resort.tempfile, "NamedTemporaryFile", full)
    assert last_resort.line_of(KeyError("x")) == "unexpected KeyError: 'x'"


def test_a_name_that_the_system_refuses_is_bad_input():
    done = CliRunner().invoke(app_that_raises(PermissionError(13, "Permission denied", "there")), [])
    assert (done.exit_code, done.stderr) == (2, "there: Permission denied\n")


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("act", "code", "how"),
    [
        ("import ctypes; ctypes.string_at(0)", -11, "segmentation fault"),
        ("import os; os.abort()", -6, "aborted"),
        ("import os; os._exit(7)", 7, "killed, or ended by a law"),
    ],
)
def test_a_death_in_the_middle_of_a_run_is_one_line(act: str, code: int, how: str, tmp_path: Path, scenario_file):
    (tmp_path / "mine.py").write_text(LAW.format(act=act))
    file = scenario_file(('law = "reactive"', 'law = "mine:Mine"'))
    words = [sys.executable, "-m", "platoontraffic", "run", file, "run.duration_s=1", "--out", tmp_path / "out"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, env=os.environ | {"TMPDIR": str(tmp_path)})
    assert done.returncode == code
    (line,) = [line for line in done.stderr.splitlines() if "died" in line]
    assert re.match(r"\w+ \(net ", line)
    assert "lab_loop.net.xml): the process died in the middle of the run" in line
    assert how in line
    assert "Fatal" not in done.stderr
    if code < 0:
        assert "string_at" in Path(line.partition("details: ")[2]).read_text() or code == -6


@pytest.mark.sumo
def test_a_run_that_ends_well_says_nothing_of_it(tmp_path: Path):
    words = [sys.executable, "-m", "platoontraffic", "run", "paper_loop", "run.duration_s=1", "-q", "--out", tmp_path]
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
