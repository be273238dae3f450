"""Worker processes that do not start, and what the parent knows of processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from platoontraffic.errors import RunError
from platoontraffic.study import batch, process_tree, processes, silence, study
from tests.support.batches import alive, call, tables, until

needs_proc = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="processes of Linux")


@pytest.fixture
def interpreter(tmp_path, monkeypatch):
    """Has worker processes begin with some lines of shell; `$n` is the number of the start, from 1."""

    def write(lines: str) -> None:
        file = tmp_path / "python"
        counted = f'echo >> "{tmp_path}/starts"; n=$(wc -l < "{tmp_path}/starts")'
        file.write_text(f'#!/bin/sh\n{counted}\n{lines}\nexec "{sys.executable}" "$@"\n')
        file.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(file))
        monkeypatch.setattr(processes, "PAUSE", 0.01)

    return write


@pytest.mark.sumo
@needs_proc
def test_processes_that_are_killed_while_they_start_cost_no_run(tiny, tmp_path, interpreter):
    batch.run(study.load(tiny()), tmp_path / "undisturbed", slots=1)
    interpreter("[ $n -lt 6 ] && kill -9 $$")
    assert batch.run(study.load(tiny()), tmp_path / "out", slots=1).failures == {}
    assert tables(tmp_path / "out") == tables(tmp_path / "undisturbed")


@pytest.mark.sumo
@needs_proc
@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("kill -9 $$", "the process of the run died of SIGKILL before it had started (6 times in a row)"),
        (
            "echo why it is broken >&2; exit 1",
            "the process of the run died of exit code 1 before it had started: why it is broken (2 times in a row)",
        ),
    ],
)
def test_a_process_that_never_starts_ends_the_batch_in_one_line(tiny, tmp_path, interpreter, lines, message):
    interpreter(lines)
    with pytest.raises(RunError) as error:
        batch.run(study.load(tiny()), tmp_path / "out", slots=1)
    assert str(error.value) == message
    assert error.value.__notes__ == ["0 of 4 runs are done; started again, the batch goes on from there"]


@pytest.mark.sumo
@needs_proc
def test_a_system_that_starts_no_process_ends_the_batch_in_one_line(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "PAUSE", 0.01)
    monkeypatch.setattr(sys, "executable", str(tmp_path))
    with pytest.raises(RunError, match=r"^no process can be started: Permission denied \(6 times in a row\)"):
        batch.run(study.load(tiny()), tmp_path / "out", slots=2)


@needs_proc
def test_memory_is_that_of_a_process_and_its_children():
    code = "import os; os.fork(); held = bytearray(b'x') * 100_000_000; os.write(1, b'held\\n'); input()"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        for _ in range(2):
            assert process.stdout.readline() == b"held\n"
        assert 200 < process_tree.Census().memory(process.pid) < 300
        process_tree.end(process.pid)
    until(lambda: process_tree.Census().memory(process.pid) == 0, deadline=10)


@needs_proc
def test_a_process_ends_with_all_that_it_has_started():
    """Children that ignore signals, in a session of their own, and whose parent has ended.

    They write to one pipe: `print` would write a number and the end of its line one after the other.
    """
    code = """
import os, signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
if os.fork() == 0:
    if os.fork() == 0:
        os.write(1, b"%d\\n" % os.getpid())
        time.sleep(1e6)
    os._exit(0)
if os.fork() == 0:
    os.setsid()
    os.write(1, b"%d\\n" % os.getpid())
    if os.fork() == 0:
        os.write(1, b"%d\\n" % os.getpid())
    time.sleep(1e6)
time.sleep(1e6)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, start_new_session=True) as process:
        try:
            children = [int(process.stdout.readline()) for _ in range(3)]
            assert all(map(alive, children))
            process_tree.end(process.pid)
            until(lambda: not any(map(alive, children)), deadline=5)
        finally:
            process.kill()  # or a failure would wait for it
    assert process.returncode == -signal.SIGKILL


def test_a_silent_run_is_named_whenever_the_time_has_doubled(monkeypatch):
    now, heard = [0.0], []
    monkeypatch.setattr(silence, "SILENCE", 60.0)
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    pulse = silence.Pulse("a", heard.append)
    for now[0] in range(250):
        pulse.check()
    pulse.beat(1.5)
    for now[0] in range(250, 400, 30):
        pulse.check()
        if now[0] == 280:
            pulse.beat(2.0)
    pulse.end()
    assert heard == [
        ("a", 60.0, None), ("a", 120.0, None), ("a", 240.0, None), ("a", 0.0, 1.5), ("a", 60.0, 2.0), ("a", 0.0, 2.0),
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.sumo
@needs_proc
def test_a_batch_needs_no_folder_for_temporary_files(tiny, tmp_path):
    """All folders are read-only but that of the results."""
    script = (
        f"for at in /tmp /var/tmp /dev/shm; do mount --bind $at $at; done; mount --bind '{tmp_path}' '{tmp_path}';"
        'for at in /tmp /var/tmp /dev/shm; do mount -o remount,bind,ro $at; done; cd /proc; exec "$@"'
    )
    in_namespace = ["unshare", "-m", "sh", "-ec", script, "sh"]
    if subprocess.run([*in_namespace, "true"], capture_output=True).returncode:
        pytest.skip("no mounts allowed")
    root = Path(batch.__file__).parents[2]
    env = os.environ | {"HOME": "/proc", "TMPDIR": "/proc", "PYTHONPATH": str(root)}
    ended = call(tiny(), "-j", 2, "--out", tmp_path / "out", within=in_namespace, env=env)
    assert (ended.returncode, ended.stderr) == (0, "")
