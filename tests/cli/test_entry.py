"""The program from its first import on: Ctrl-C, and streams that are closed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.test_run import TABLES, equal_tables

SHORT = ("paper_loop", "run.duration_s=0.5", "platoon.size=2")

# Ctrl-C when a module is about to be imported.
INTERRUPTED = """
import os, signal, sys

class Interrupting:
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
sys.argv = ["platoontraffic", "run", "paper_loop", "run.duration_s=1", "--out", {out!r}]
from platoontraffic.cli.entry import main
main()
"""


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("module", ["typer", "rich.console", "pydantic", "numba", "libsumo"])
def test_control_c_while_modules_are_imported_is_one_word(tmp_path, module):
    code = INTERRUPTED.format(module=module, out=str(tmp_path / "out"))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def usual(tmp_path_factory) -> Path:
    return _run_closed((), tmp_path_factory.mktemp("usual"))


@pytest.mark.sumo
@pytest.mark.skipif(os.name == "nt", reason="descriptors of POSIX")
@pytest.mark.parametrize("closed", [(2,), (1,), (0,), (1, 2), (0, 1, 2)])
def test_a_run_needs_no_standard_streams(usual, tmp_path, closed):
    folder = _run_closed(closed, tmp_path)
    assert equal_tables(folder, usual, [*TABLES, "run.log"])


@pytest.mark.sumo
@pytest.mark.skipif(os.name == "nt", reason="descriptors of POSIX")
def test_a_run_of_a_program_without_a_console_needs_no_standard_streams(usual, tmp_path):
    code = (
        "import sys, os; os.close(2); sys.stdout = sys.stderr = None\n"
        "from pathlib import Path; from tests.support.runs import run\n"
        "run(Path(sys.argv[1]), *sys.argv[2:])"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path / "run", *SHORT], check=True)
    assert equal_tables(tmp_path / "run", usual, [*TABLES, "run.log"])


def _run_closed(closed: tuple[int, ...], folder: Path) -> Path:
    """A run by a process with these descriptors closed."""
    # By a shell: Popen would give the process's own ones for those that are not named.
    command = f'exec "$@" {" ".join(f"{number}>&-" for number in closed)}'
    program = [sys.executable, "-m", "platoontraffic", "run", *SHORT, "--out", str(folder)]
    assert subprocess.run(["sh", "-c", command, "sh", *program], stdout=subprocess.DEVNULL).returncode == 0
    (done,) = folder.glob("*/*/DONE")
    return done.parent
