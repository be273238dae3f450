"""Batches: every executor leaves the same tables, and a failed or killed run costs no other run."""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from platoontraffic.errors import InputError
from platoontraffic.study import batch, batch_folder, study
from platoontraffic.study.folder_lock import Lock
from tests.support.batches import (
    DIES,
    LAW,
    alive,
    call,
    children,
    done,
    invoked,
    started,
    statuses,
    tables,
    until,
    workers_below,
)

needs_signals = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
pytestmark = pytest.mark.sumo


def test_a_batch_leaves_tables_and_is_not_repeated(tiny, tmp_path):
    first = invoked(tiny(), "-j", 2, "--out", tmp_path / "out")
    folder = tmp_path / "out" / "tiny"
    assert (first.returncode, first.stderr) == (0, "")
    alone = f"a run alone, RUN being its id in summary.csv: platoontraffic run {folder}/RUN/config.toml"
    assert first.stdout == f"4 runs: 4 done, 0 failed\n{alone}\n{folder}\n"
    before, made = tables(folder), done(folder)
    assert before[0][0] == ["id", "status", "seed", "platoon.follower.heading_gain_per_s", "error"]
    assert [row[1:4] for row in before[0][1:]] == [
        ["done", "1", "1.0"], ["done", "2", "1.0"], ["done", "1", "2.0"], ["done", "2", "2.0"],
    ]  # fmt: skip
    second = invoked(tiny(), "--out", tmp_path / "out")
    assert "4 done (4 of them earlier), 0 failed" in second.stdout
    assert done(folder) == made
    assert tables(folder) == before
    assert sorted(entry.name for entry in folder.iterdir() if entry.name not in made) == [
        ".lock", "datapackage.json", "runs.csv", "study.toml", "summary.csv",
    ]  # fmt: skip


def test_all_executors_and_shards_leave_the_same_tables(tiny, tmp_path):
    file = tiny()
    batch.run(study.load(file), tmp_path / "processes", slots=2)
    batch.run(study.load(file), tmp_path / "serial", "serial")
    for number in (3, 1, 2):
        batch.run(study.load(file), tmp_path / "shards", "serial", shard=batch.Shard(number, 3))
    assert tables(tmp_path / "processes") == tables(tmp_path / "serial") == tables(tmp_path / "shards")


def test_a_run_of_a_batch_equals_the_run_alone(tiny, tmp_path):
    batch.run(study.load(tiny()), tmp_path / "batch" / "paper_loop", "serial")
    words = ["run", "paper_loop", "run.duration_s=0.5", "platoon.size=2", "platoon.follower.heading_gain_per_s=2.0"]
    words += ["platoon.follower.lidar.noise=utm30lx"]
    command = [sys.executable, "-m", "platoontraffic", *words, "--seed", "2", "-q", "--out", str(tmp_path / "alone")]
    alone = Path(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
    together = tmp_path / "batch" / "paper_loop" / alone.name
    for name in ("trajectories.csv", "events.csv", "metrics.csv"):
        assert (alone / name).read_bytes() == (together / name).read_bytes()


def test_an_edited_study_repeats_only_what_changed(tiny, tmp_path):
    folder = tmp_path / "out"
    batch.run(study.load(tiny()), folder, "serial")
    made = done(folder)
    report = batch.run(study.load(tiny(gains=3)), folder, "serial")
    assert (report.progress.runs, report.progress.earlier, report.progress.done) == (6, 4, 6)
    assert made.items() <= done(folder).items()
    fewer = batch.run(study.load(tiny(gains=1)), folder, "serial")
    assert (fewer.progress.runs, fewer.progress.earlier) == (2, 2)
    assert len(statuses(folder)) == 2


def test_tables_that_lose_runs_are_named_before_they_are_replaced(tiny, tmp_path):
    def said(file: Path) -> str:
        return invoked(file, "--executor", "serial", "-q", "--out", tmp_path / "out").stderr

    first, grown = said(tiny(1, 1)), said(tiny(2, 1))
    (tmp_path / "other").mkdir()
    other = tmp_path / "other" / "tiny.toml"
    other.write_text(tiny(1, 1).read_text().replace("duration_s = 0.5", "duration_s = 0.4"))
    folder = tmp_path / "out" / "tiny"
    earlier = done(folder)
    assert (first, grown) == ("", "")
    assert said(other) == (
        f"{folder}: its tables have 2 runs not of this study; the tables are replaced, no run is removed\n"
    )
    assert earlier.items() <= done(folder).items()
    assert said(other) == ""


def test_half_written_runs_are_done_again(tiny, tmp_path):
    folder = tmp_path / "out"
    batch.run(study.load(tiny()), folder, "serial")
    before, (one, other, more, _) = tables(folder), sorted(done(folder))
    (folder / one / "DONE").unlink()
    shutil.rmtree(folder / other)
    (folder / f"{other}.123.partial").mkdir()
    (folder / f"{more}.123.partial").mkdir()
    (folder / f"{other}.unfinished").mkdir()
    report = batch.run(study.load(tiny()), folder, "serial")
    assert report.progress.earlier == 2
    assert tables(folder) == before
    assert not [*folder.glob("*.partial"), *folder.glob("*.unfinished")]


@pytest.mark.parametrize("name", ["summary.csv", "provenance.json"])
def test_a_damaged_run_is_an_input_error_that_names_the_file(tiny, tmp_path, name):
    batch.run(study.load(tiny()), tmp_path / "out" / "tiny", "serial")
    damaged = next((tmp_path / "out" / "tiny").glob(f"*-s1/{name}"))
    damaged.write_text("")
    with pytest.raises(InputError, match=re.escape(f"{damaged}: is missing or damaged")):
        batch.run(study.load(tiny()), tmp_path / "out" / "tiny", "serial")


@pytest.mark.slow
@needs_signals
@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_a_run_that_dies_by_a_signal_costs_only_itself(tiny, tmp_path, executor):
    if executor == "dask":
        pytest.importorskip("distributed")
    ended = call(tiny(4, 1, DIES), "-j", 2, "--executor", executor, "--out", tmp_path / "out")
    folder = tmp_path / "out" / "tiny"
    assert ended.returncode == 1
    assert statuses(folder) == ["done", "done", "failed", "done"]
    error = "the process of the run died of SIGSEGV"
    assert tables(folder)[0][3][-1] == error
    assert error in ended.stdout
    failure = json.loads(next(folder.glob("*.unfinished/failure.json")).read_text())
    assert "law.py" in failure["traceback"]  # faulthandler's
    assert next(folder.glob("*.unfinished/config.toml")).is_file()


def test_a_failed_run_keeps_its_error_and_is_repeated_only_on_request(tiny, tmp_path):
    folder = tmp_path / "out"
    bad = "raise ValueError('this is\\nthe reason')"
    first = batch.run(study.load(tiny(4, 1, bad)), folder, "serial")
    (error,) = first.failures.values()
    assert "law Law failed at 0.000 s: ValueError: this is the reason" in error
    again = batch.run(study.load(tiny(4, 1, bad)), folder, "serial")
    assert again.failures == first.failures
    assert again.progress.ended_now == 0
    retried = batch.run(study.load(tiny(4, 1, bad)), folder, "serial", retry_failed=True)
    assert retried.progress.ended_now == 1
    assert retried.failures == first.failures
    mended = batch.run(study.load(tiny(4, 1, "pass")), folder, "serial")  # another law is another run
    assert (mended.failures, mended.progress.done) == ({}, 4)


def test_output_of_a_law_does_not_disturb_the_worker(tiny, tmp_path):
    report = batch.run(study.load(tiny(4, 1, "print('{\"error\": 1}', flush=True)")), tmp_path / "out", slots=1)
    assert report.progress.done == 4


@needs_signals
@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_a_signal_ends_a_batch_and_leaves_no_process(tiny, tmp_path, killed, number):
    running = started(tiny(5, 40), "-j", 2, "--out", tmp_path / "out")
    killed.append(running)
    folder = tmp_path / "out" / "tiny"
    until(lambda: len(done(folder)) > 2)
    workers = children(running.pid)
    running.send_signal(number)
    out, err = running.communicate(timeout=20)
    assert (running.returncode, out) == (130, "")
    said, counts = err.splitlines()
    assert said == "interrupted"
    assert counts == f"{len(done(folder))} of 200 runs are done; started again, the batch goes on from there"
    assert workers
    assert not any(map(alive, workers))
    assert statuses(folder).count("done") == len(done(folder))
    assert not list(folder.glob("*.partial"))


@pytest.mark.slow
@needs_signals
def test_workers_end_with_their_parent(tiny, tmp_path, killed):
    running = started(tiny(5, 40), "-j", 2, "--out", tmp_path / "out")
    killed.append(running)
    until(lambda: len(done(tmp_path / "out" / "tiny")) > 2)
    workers = children(running.pid)
    assert len(workers) == 2
    running.kill()
    until(lambda: not any(map(alive, workers)), deadline=10)


@pytest.mark.slow
def test_a_second_batch_on_the_same_folder_is_refused(tiny, tmp_path, killed):
    file = tiny(5, 40)
    killed.append(started(file, "-j", 1, "--out", tmp_path / "out"))
    until(lambda: (tmp_path / "out" / "tiny" / "study.toml").is_file())
    second = call(file, "--out", tmp_path / "out")
    assert (second.returncode, second.stderr.count("\n")) == (2, 1)
    assert "another batch is at work there" in second.stderr


@pytest.mark.slow
def test_shards_work_side_by_side_but_not_on_the_same_runs(tiny, tmp_path):
    shard = (tiny(5, 40), "-j", 1, "--out", tmp_path / "out", "--shard")
    assert call(*shard, "1/200").returncode == 0
    with contextlib.closing(Lock(tmp_path / "out" / "tiny" / batch_folder.LOCK)) as lock:
        assert lock.take(0, 100)  # as a batch of the shard 1/2 does
        assert "another batch" in call(*shard, "1/3").stderr
        assert "another batch" in call(*shard, "3/3", "platoon.gap_m=0.5").stderr
        assert call(*shard, "200/200").stdout.startswith("1 runs: 1 done")


def test_the_lock_of_a_process_that_dies_is_free_again(tmp_path):
    lock = str(tmp_path / "lock")
    code = f"from platoontraffic.study.folder_lock import Lock; Lock({lock!r}).take(3, 4); print(1); input()"
    other = subprocess.Popen(
        [sys.executable, "-c", f"from pathlib import Path; {code}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    other.stdout.readline()
    lock = Lock(tmp_path / "lock")
    assert lock.take(0, 3)
    assert not lock.take(6, 1)
    other.kill()
    other.communicate()
    assert lock.take(6, 1)
    lock.close()


def test_a_folder_that_is_not_of_this_study_is_left_unchanged(tiny, tmp_path):
    loaded = study.load(tiny())
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="not the folder of a batch"):
        batch.run(loaded, folder)
    assert [f.name for f in folder.iterdir()] == ["notes.txt"]
    (folder / "notes.txt").unlink()
    batch.run(loaded, folder, "serial")
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    (tmp_path / "tiny.toml").write_text((tmp_path / "tiny.toml").read_text().replace("paper_loop", "paper_path"))
    with pytest.raises(InputError, match="holds another study, 'tiny' on 'paper_loop'; for 'tiny' on 'paper_path'"):
        batch.run(study.load(tmp_path / "tiny.toml"), folder)
    (folder / "study.toml").write_text("half a stu")
    with pytest.raises(InputError, match="is not the study of a batch"):
        batch.run(loaded, folder)
    (folder / "study.toml").write_bytes(before[folder / "study.toml"])
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_a_folder_that_cannot_be_written_is_reported_in_one_line(tiny, tmp_path):
    (tmp_path / "file").write_text("")
    ended = invoked(tiny(), "--out", tmp_path / "file")
    assert (ended.returncode, ended.stderr) == (2, f"{tmp_path / 'file' / 'tiny'}: Not a directory\n")


@needs_signals
def test_a_full_disk_stops_the_batch_in_one_line(tiny, tmp_path):
    """A limit on the size of files makes writes fail, as a full disk does."""
    import resource

    def little() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2500, 2500))

    ended = call(tiny(), "-j", 1, "--out", tmp_path / "out", preexec_fn=little)
    assert ended.returncode == 1
    assert "File too large" in ended.stderr.splitlines()[0]
    assert not list((tmp_path / "out").glob("*/*/DONE"))
    assert batch.run(study.load(tiny()), tmp_path / "out" / "tiny", "serial").progress.done == 4


def test_a_batch_stops_when_an_input_file_changes(tiny, tmp_path, monkeypatch):
    loaded = study.load(tiny(4, 1, "pass"))
    (tmp_path / "law.py").write_text(LAW.format(how="pass") + "\n# edited\n")
    with pytest.raises(InputError, match="is not what it was when the batch was started"):
        batch.run(loaded, tmp_path / "out", "serial")
    assert not list((tmp_path / "out").glob("*/failure.json"))


def test_a_dry_run_of_a_part_lists_the_runs_of_that_part(tiny, tmp_path):
    dry = [
        json.loads(invoked(tiny(), "--dry-run", "--json", "--out", tmp_path, *shard).stdout)
        for shard in ((), ("--shard", "1/2"), ("--shard", "2/2"))
    ]
    whole, *parts = ({run["id"] for run in one["runs"]} for one in dry)
    assert all(parts)
    assert parts[0] | parts[1] == whole
    assert not parts[0] & parts[1]


def test_a_dry_run_writes_nothing_and_counts_finished_runs(tiny, tmp_path):
    dry = invoked(tiny(), "--dry-run", "--json", "--out", tmp_path / "out")
    assert [run["status"] for run in json.loads(dry.stdout)["runs"]] == ["waiting"] * 4
    assert not (tmp_path / "out").exists()
    batch.run(study.load(tiny()), tmp_path / "out" / "tiny", "serial")
    dry = invoked(tiny(gains=3), "--dry-run", "--out", tmp_path / "out")
    assert "6 runs, 2 to do, about " in dry.stdout
    assert "(from the 4 finished runs)" in dry.stdout


def test_json_is_one_document(tiny, tmp_path):
    ended = invoked(tiny(), "--json", "--executor", "serial", "--out", tmp_path / "out")
    report = json.loads(ended.stdout)
    assert (report["runs"], report["done"], report["failures"]) == (4, 4, {})


def test_a_missing_scheduler_and_missing_dask_are_reported_in_one_line(tiny, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    from platoontraffic.errors import MissingError

    with pytest.raises(InputError, match="no dask scheduler can be reached"):
        batch.run(study.load(tiny()), tmp_path / "out", "dask:nonsense")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingError, match=r"platoontraffic\[cluster\]"):
        batch.run(study.load(tiny()), tmp_path / "out", "dask")


def _dask_cluster(folder: Path, killed: list[subprocess.Popen]) -> str:
    """Starts a scheduler and two workers by hand, of two threads each; returns the scheduler's address."""
    said = folder / "scheduler.json"
    module = [sys.executable, "-m", "distributed.cli"]
    options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
    scheduler = [*module[:2], "distributed.cli.dask_scheduler", "--port", "0", "--scheduler-file", str(said)]
    killed.append(subprocess.Popen([*scheduler, "--no-dashboard"], **options))
    until(said.is_file)
    until(lambda: said.read_text().endswith("}"))
    for _ in range(2):
        worker = [*module[:2], "distributed.cli.dask_worker", "--scheduler-file", str(said), "--nthreads", "2"]
        killed.append(subprocess.Popen([*worker, "--no-dashboard", "--no-nanny"], **options))
    return json.loads(said.read_text())["address"]


@pytest.mark.soak
def test_a_scheduler_with_two_workers_started_by_hand_leaves_the_same_tables(tiny, tmp_path, killed):
    pytest.importorskip("distributed")
    file = tiny(5, 4)
    batch.run(study.load(file), tmp_path / "processes", slots=2)
    batch.run(study.load(file), tmp_path / "local", "dask", slots=2)
    batch.run(study.load(file), tmp_path / "cluster", f"dask:{_dask_cluster(tmp_path, killed)}")
    assert tables(tmp_path / "processes") == tables(tmp_path / "local") == tables(tmp_path / "cluster")


@pytest.mark.soak
@needs_signals
@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_200_runs_are_the_same_however_often_they_are_killed(tiny, tmp_path, killed, executor):
    if executor == "dask":
        pytest.importorskip("distributed")
    file, folder = tiny(10, 20), tmp_path / "out" / "tiny"
    batch.run(study.load(file), tmp_path / "undisturbed", slots=2)
    rng = random.Random(1)
    for victim in ("parent", "worker", "parent", "worker", "parent"):
        if not killed or killed[-1].poll() is not None:
            killed.append(started(file, "-j", 2, "--executor", executor, "--out", tmp_path / "out"))
        had = len(done(folder))
        more = rng.randint(3, 35)
        until(lambda had=had, more=more: len(done(folder)) >= had + more, deadline=300)
        time.sleep(rng.random())
        workers = workers_below(killed[-1].pid)
        if victim == "parent":
            killed[-1].kill()
            killed[-1].communicate()
            until(lambda workers=workers: not any(map(alive, workers)))
        else:
            os.kill(rng.choice(workers), signal.SIGKILL)
    before = done(folder)
    assert 0 < len(before) < 200
    ended = call(file, "-j", 2, "--executor", executor, "--out", tmp_path / "out")
    assert ended.returncode == 0, ended
    assert before.items() <= done(folder).items()
    assert tables(folder) == tables(tmp_path / "undisturbed")
    assert not [*folder.glob("*.partial"), *folder.glob("*.unfinished")]


@pytest.mark.soak
@needs_signals
@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_199_of_200_runs_survive_one_that_dies(tiny, tmp_path, executor):
    if executor == "dask":
        pytest.importorskip("distributed")
    ended = call(tiny(200, 1, DIES), "-j", 2, "--executor", executor, "--out", tmp_path / "out")
    assert ended.returncode == 1
    assert statuses(tmp_path / "out" / "tiny") == ["done"] * 2 + ["failed"] + ["done"] * 197


@pytest.mark.soak
@needs_signals
def test_the_memory_of_the_parent_does_not_grow_with_the_runs(tiny, tmp_path, killed):
    killed.append(started(tiny(50, 20), "run.duration_s=0.1", "-j", 2, "--out", tmp_path / "out"))
    folder = tmp_path / "out" / "tiny"

    def resident() -> float:  # [MB]
        status = Path(f"/proc/{killed[-1].pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0]) / 1024

    until(lambda: len(done(folder)) > 100, deadline=600)
    early = resident()
    until(lambda: len(done(folder)) > 950, deadline=3000)
    assert resident() < early + 5
    assert killed[-1].communicate(timeout=300)[0].startswith("1000 runs: 1000 done")
