"""Batches that are disturbed from outside leave the tables of those that are not."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.support.bad_laws import KINDS
from tests.support.batches import alive, call, done, started, statuses, tables, until, workers_below

pytestmark = [pytest.mark.sumo, pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes of Linux")]

YOUNG = 1.5  # age at which a worker is still starting [s]


def age(pid: int) -> float:
    """Time since a process was started [s]; infinite if it has ended."""
    try:
        ticks = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19])
    except OSError:
        return float("inf")
    return float(Path("/proc/uptime").read_text().split()[0]) - ticks / os.sysconf("SC_CLK_TCK")


def kill_at_random(rng: random.Random, parent: subprocess.Popen, before: list[str]) -> str:
    """Kill a batch, one of its workers or one that starts; returns which. Each kind is among the first three."""
    workers = workers_below(parent.pid)
    missing = sorted({"parent", "worker", "starting"} - set(before))
    victim = rng.choice(missing or ["parent", "worker", "worker", "starting", "starting"])
    if victim == "parent":
        parent.kill()
        parent.communicate()
        until(lambda: not any(map(alive, workers)))
        return victim
    if victim == "starting":
        until(lambda: parent.poll() is not None or any(age(worker) < YOUNG for worker in workers_below(parent.pid)))
        workers = [worker for worker in workers_below(parent.pid) if age(worker) < YOUNG]
    if workers:
        with contextlib.suppress(ProcessLookupError):  # it has ended in the meantime
            os.kill(rng.choice(workers), signal.SIGKILL)
    return victim


@pytest.mark.parametrize(
    ("runs", "kills", "seed"),
    [
        pytest.param(30, 8, 1, marks=pytest.mark.slow),
        *(pytest.param(200, 40, seed, marks=pytest.mark.soak) for seed in (1, 2, 3)),
    ],
)
def test_bad_laws_and_kills_leave_the_tables_as_they_are_or_rows_that_say_why(bad, tmp_path, killed, runs, kills, seed):
    rng = random.Random(seed)
    kinds = list(KINDS)[:: 1 if runs > 100 else 3]
    kinds += ["fine"] * (runs - len(kinds))
    rng.shuffle(kinds)
    words = (bad(*kinds), "-j", 4, "--timeout", 20, "--memory", 1000, "--out")
    call(*words, tmp_path / "undisturbed")
    expected, folder = tables(tmp_path / "undisturbed" / "bad"), tmp_path / "out" / "bad"
    assert statuses(tmp_path / "undisturbed" / "bad").count("done") > 0.7 * runs
    victims = []
    while len(victims) < kills:
        if not killed or killed[-1].poll() is not None:
            if "waiting" not in (statuses(folder) if (folder / "runs.csv").is_file() else ["waiting"]):
                break
            killed.append(started(*words, tmp_path / "out"))
            until(lambda: workers_below(killed[-1].pid), deadline=120)
        time.sleep(rng.uniform(0.0, 3.0))
        victims.append(kill_at_random(rng, killed[-1], victims))
    if killed[-1].poll() is None:
        killed[-1].communicate(timeout=600)
    call(*words, tmp_path / "out")
    for row, undisturbed in zip(tables(folder)[0], expected[0], strict=True):
        by_kill = [undisturbed[0], "failed", *undisturbed[2:-1], "the process of the run died of SIGKILL"]
        assert row in (undisturbed, by_kill), victims
    call(*words, tmp_path / "out", "--retry-failed")
    assert tables(folder) == expected, victims
    assert {"parent", "worker", "starting"} <= set(victims)


@pytest.mark.slow
def test_a_batch_that_is_killed_with_its_container_goes_on_in_another(tiny, tmp_path, killed):
    """Every process has the same number as before."""
    container = ["unshare", "-p", "-f", "--kill-child", "--mount-proc"]
    if subprocess.run([*container, "true"], capture_output=True).returncode:
        pytest.skip("no namespaces allowed")
    file, folder = tiny(5, 8), tmp_path / "out" / "tiny"
    call(file, "-j", 2, "--out", tmp_path / "undisturbed")
    for _ in range(3):
        had = len(done(folder))
        killed.append(started(file, "-j", 2, "--out", tmp_path / "out", within=container))
        until(lambda had=had: len(done(folder)) > had + 4 and list(folder.glob("*.partial")), deadline=120)
        killed[-1].kill()
        killed[-1].communicate()
    ended = call(file, "-j", 2, "--out", tmp_path / "out", within=container)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert tables(folder) == tables(tmp_path / "undisturbed" / "tiny")
    assert not [*folder.glob("*.partial"), *folder.glob("*.unfinished")]


@pytest.mark.slow
def test_a_batch_on_a_full_disk_ends_and_goes_on_when_there_is_room(tiny, tmp_path):
    out, kept = tmp_path / "out", tmp_path / "kept"
    file = tiny(5, 8)
    call(file, "-j", 2, "--out", tmp_path / "undisturbed")
    out.mkdir()
    kept.mkdir()

    def with_a_disk(size: str) -> subprocess.CompletedProcess:
        text = (
            f"mount -t tmpfs -o size={size} none '{out}'; cp -r '{kept}/.' '{out}'; code=0; \"$@\" || code=$?;"
            f"rm -r '{kept}'; cp -r '{out}' '{kept}'; exit $code"
        )
        return call(file, "-j", 2, "--out", out, within=["unshare", "-m", "sh", "-ec", text, "sh"])

    if subprocess.run(["unshare", "-m", "mount", "-t", "tmpfs", "none", out], capture_output=True).returncode:
        pytest.skip("no mounts allowed")
    full = with_a_disk("600k")
    assert full.returncode != 0
    assert "No space left on device" in full.stderr.splitlines()[0]
    assert 0 < len(done(kept / "tiny")) < 40
    assert with_a_disk("100m").returncode == 0
    assert tables(kept / "tiny") == tables(tmp_path / "undisturbed" / "tiny")
