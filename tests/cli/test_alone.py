"""A run after one that was killed, beside one that lives, and where something else is in its place."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from platoontraffic.cli.main import app

pytestmark = [pytest.mark.sumo, pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")]

LONG = ("paper_loop", "run.duration_s=30", "platoon.size=2")
SHORT = ("paper_loop", "run.duration_s=0.5", "platoon.size=2")


def command(out: Path, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "platoontraffic", "run", *arguments, "--out", str(out)]


def started(out: Path, scenario: tuple[str, ...]) -> subprocess.Popen[str]:
    """A run that has recorded some rows."""
    run = subprocess.Popen(command(out, *scenario), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 120
    while not any(table.stat().st_size > 10_000 for table in out.glob("*/*.partial/trajectories.csv")):
        assert time.monotonic() < until
        assert run.poll() is None, run.communicate()
        time.sleep(0.05)
    return run


def killed(out: Path, scenario: tuple[str, ...]) -> Path:
    """The folder that a killed run leaves."""
    run = started(out, scenario)
    run.kill()
    run.communicate()
    (left,) = out.glob("*/*.partial")
    return left


def call(out: Path, *arguments: str) -> Result:
    """In this process: to start one takes longer than the run."""
    return CliRunner().invoke(app, command(out, *arguments)[3:])


def test_a_killed_run_is_tidied_by_the_next_one_with_a_word(tmp_path):
    left = killed(tmp_path, LONG)
    done = subprocess.run(command(tmp_path, *LONG, "-q"), capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, f"{left}: was left by a run that was killed; it is removed\n")
    assert list((tmp_path / "paper_loop").iterdir()) == [Path(done.stdout.strip())]


def test_a_run_waits_for_an_equal_one_that_lives_and_takes_over_when_that_is_killed(tmp_path):
    first = started(tmp_path, LONG)
    first.send_signal(signal.SIGSTOP)  # so it lives however long the second one takes to start
    (left,) = tmp_path.glob("*/*.partial")
    second = subprocess.Popen(command(tmp_path, *LONG), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    said = second.stderr.readline()
    assert "another process executes this run" in said
    assert left.is_dir()
    first.kill()
    first.communicate()
    _, said = second.communicate()
    assert (second.returncode, said) == (0, f"{left}: was left by a run that was killed; it is removed\n")
    assert [f.name for f in (tmp_path / "paper_loop").iterdir()] == [left.name.partition(".")[0]]


def test_an_equal_run_that_has_waited_is_not_repeated(tmp_path):
    runs = [
        subprocess.Popen(command(tmp_path, *SHORT, "-q"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    said = [run.communicate() for run in runs]
    assert [run.returncode for run in runs] == [0, 0, 0]
    assert len(set(said)) == 1
    assert len(list((tmp_path / "paper_loop").iterdir())) == 1


NAMESPACE = ["unshare", "-p", "-f", "--mount-proc"]
CAN_SHARE = shutil.which("unshare") and subprocess.run([*NAMESPACE, "true"], capture_output=True).returncode == 0


@pytest.mark.skipif(not CAN_SHARE, reason="needs process namespaces")
def test_a_run_killed_in_a_container_is_done_in_the_next_one_with_the_same_process_id(tmp_path):
    script = '"$@" -q & p=$!; {}; wait $p'
    wait = f"while ! grep -q . {tmp_path}/*/*.partial/trajectories.csv; do sleep 0.1; done; kill -9 $p"
    for then in (wait, ":"):
        contained = [*NAMESPACE, "bash", "-c", script.format(then), "bash", *command(tmp_path, *LONG)]
        done = subprocess.run(contained, capture_output=True, text=True)
    assert (done.returncode, "was left by a run that was killed" in done.stderr) == (0, True)
    assert [f.name for f in (tmp_path / "paper_loop").iterdir()] == [Path(done.stdout.strip()).name]


def test_a_run_that_ignores_hangups_goes_on(tmp_path):
    """As nohup has it."""
    ignoring = f"import os, signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); os.execv({sys.executable!r}, "
    code = ignoring + f"{command(tmp_path, 'paper_loop', 'run.duration_s=5', 'platoon.size=2')!r})"
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    while run.poll() is None:
        run.send_signal(signal.SIGHUP) if list(tmp_path.glob("*/*.partial")) else None
        time.sleep(0.1)
    assert run.returncode == 0


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """Name of the folder of a run, below that for results."""
    out = tmp_path_factory.mktemp("out")
    done = call(out, *SHORT, "-q")
    return Path(done.stdout.strip()).relative_to(out)


def test_a_folder_with_files_that_are_not_of_the_run_is_kept_beside_it(place, tmp_path):
    for i in (1, 2):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "notes.txt").write_text(f"mine {i}")
        done = call(tmp_path, *SHORT, "-q")
        assert (done.exit_code, done.stderr.count("\n")) == (0, 1)
        assert "with files that are not of the run; it is kept" in done.stderr
        shutil.rmtree(tmp_path / place)
    kept = [tmp_path / f"{place}.earlier", tmp_path / f"{place}.earlier-2"]
    assert [(folder / "notes.txt").read_text() for folder in kept] == ["mine 1", "mine 2"]


def test_a_folder_that_is_repeated_by_force_keeps_notes_but_not_pages(place, tmp_path):
    call(tmp_path, *SHORT, "-q")
    (tmp_path / place / "report.html").write_text("a page")
    assert call(tmp_path, *SHORT, "-q", "--force").stderr == ""
    assert not (tmp_path / place / "report.html").exists()
    (tmp_path / place / "notes.txt").write_text("mine")
    (tmp_path / place / "DONE").unlink()
    call(tmp_path, *SHORT, "-q")
    assert (tmp_path / f"{place}.earlier" / "notes.txt").read_text() == "mine"
    assert (tmp_path / f"{place}.earlier" / "trajectories.csv").is_file()
    assert sorted(f.name for f in (tmp_path / place).parent.iterdir()) == [place.name, f"{place.name}.earlier"]


@pytest.mark.parametrize("what", ["file", "link"])
def test_a_file_or_a_link_in_the_place_of_the_run_is_kept_beside_it(place, tmp_path, what):
    (tmp_path / place).parent.mkdir()
    (tmp_path / "elsewhere").mkdir()
    if what == "file":
        (tmp_path / place).write_text("mine")
    else:
        (tmp_path / place).symlink_to(tmp_path / "elsewhere")
    assert call(tmp_path, *SHORT, "-q").exit_code == 0
    assert (tmp_path / place / "DONE").is_file()
    kept = tmp_path / f"{place}.earlier"
    assert kept.read_text() == "mine" if what == "file" else kept.readlink() == tmp_path / "elsewhere"
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.slow
def test_a_terminal_that_is_closed_ends_a_run_as_control_c_does(tmp_path):
    import pty

    process, terminal = pty.fork()
    if not process:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run under nohup
        os.execv(sys.executable, command(tmp_path, *LONG[:1], "run.duration_s=600"))
    until = time.monotonic() + 120
    while not any(table.stat().st_size > 10_000 for table in tmp_path.glob("*/*.partial/trajectories.csv")):
        assert time.monotonic() < until
        time.sleep(0.1)
    os.close(terminal)
    _, status = os.waitpid(process, 0)
    assert os.waitstatus_to_exitcode(status) == 130
    assert [f.suffix for f in (tmp_path / "paper_loop").iterdir()] == [".unfinished"]
