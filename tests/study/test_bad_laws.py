"""Whatever a law does to its process, the batch ends, its row says why, and every other run is done."""

from __future__ import annotations

import csv
import json
import re
import signal
from pathlib import Path

import pytest

from platoontraffic.errors import InputError
from platoontraffic.study import batch, silence, study, worker_process
from tests.support.bad_laws import KINDS
from tests.support.batches import alive, call, done, invoked, started, statuses, until, workers_below

pytestmark = [pytest.mark.sumo, pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="processes of Linux")]

# Errors in runs.csv; the other kinds do no harm. Every limit is far above what the others take.
LIMITS = ("--timeout", 15, "--memory", 1000)
ERRORS = {
    "hangs": "timeout after 15 s",
    "hangs and ignores signals": "timeout after 15 s",
    "hangs in compiled code": "timeout after 15 s",
    "stops itself": "timeout after 15 s",
    "closes all descriptors": "the process of the run closed its connection to the batch",
    "leaves a child and hangs": "timeout after 15 s",
    "leaves a child and dies": "the process of the run died of SIGSEGV",
    "leaves a child of its own session and hangs": "timeout after 15 s",
    "fills memory": "memory above 1000 MB",
    "fills memory of a child": "memory above 1000 MB",
    "dies": "the process of the run died of SIGSEGV",
    "dies of a signal without a name": "the process of the run died of signal 40",
    "kills its group": "the process of the run died of SIGKILL",
    "ends": "the process of the run died of exit code 0",
    "exits": r".*bad_laws.py:\d+: law Bad failed at 0.000 s: SystemExit: enough",
    "fails": r".*bad_laws.py:\d+: law Bad failed at 0.000 s: ZeroDivisionError: .*",
    "makes numpy strict": "FloatingPointError: .*",
}


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "runs.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def only(kinds: list[str], folder: Path) -> list[str]:
    """Lines of summary.csv of these kinds."""
    ids = [row["id"] for row in rows(folder) if row["platoon.follower.kind"] in kinds]
    lines = (folder / "summary.csv").read_text().splitlines()
    return [line for line in lines[1:] if line.partition(",")[0] in ids]


def test_a_run_that_hangs_is_stopped_and_its_row_says_so(bad, tmp_path):
    folder, file = tmp_path / "out" / "bad", bad("hangs and ignores signals", "fine", "hangs")
    ended = call(file, "-j", 2, "--timeout", 15, "--out", tmp_path / "out")
    assert ended.returncode == 1
    assert [row["error"] for row in rows(folder)] == ["timeout after 15 s", "", "timeout after 15 s"]
    kept = folder / f"{rows(folder)[2]['id']}.unfinished"
    assert "in sleep" in json.loads((kept / "failure.json").read_text())["traceback"]
    assert (kept / "trajectories.csv").is_file()
    assert not list(folder.glob("*.partial"))
    again = invoked(file, "-j", 2, "--timeout", 15, "--out", tmp_path / "out")
    assert "(1 of them earlier), 2 failed" in again.stdout
    again = batch.run(study.load(file), folder, slots=2, retry_failed=True, limits=batch.Limits(timeout=1.0))
    assert (again.progress.ended_now, set(again.failures.values())) == (2, {"timeout after 1 s"})
    times = [float(row["wall_s"]) for row in rows(folder) if row["error"]]
    assert all(1.0 < time < 1.9 for time in times)  # it takes a second more until the process is stopped


def test_a_run_that_finishes_while_it_is_stopped_is_done(bad, tmp_path, monkeypatch):
    folder = tmp_path / "out"

    def finishes(process: worker_process.WorkerProcess) -> str:
        until(lambda: done(folder))
        return ""

    monkeypatch.setattr(worker_process.WorkerProcess, "_where", finishes)
    report = batch.run(study.load(bad("fine")), folder, slots=1, limits=batch.Limits(timeout=0.01))
    assert (report.progress.done, report.progress.failed, report.failures) == (1, 0, {})
    assert statuses(folder) == ["done"]
    assert not list(folder.glob("*.unfinished"))


@pytest.mark.parametrize(
    "kind", ["closes all descriptors", pytest.param("leaves a child and dies", marks=pytest.mark.slow)]
)
def test_a_process_that_cannot_answer_does_not_hang_the_batch(bad, tmp_path, kind):
    ended = call(bad(kind, "fine"), "-j", 1, "--out", tmp_path / "out")
    assert ended.returncode == 1
    assert statuses(tmp_path / "out" / "bad") == ["failed", "done"]
    assert re.fullmatch(ERRORS[kind], rows(tmp_path / "out" / "bad")[0]["error"])


@pytest.mark.parametrize("executor", ["processes", pytest.param("dask", marks=pytest.mark.slow)])
def test_a_run_that_takes_too_much_memory_is_stopped(bad, tmp_path, executor):
    if executor == "dask":
        pytest.importorskip("distributed")
    ended = call(bad("fills memory", "fine"), "-j", 2, "--executor", executor, *LIMITS, "--out", tmp_path / "out")
    errors = [row["error"] for row in rows(tmp_path / "out" / "bad")]
    assert (ended.returncode, errors) == (1, ["memory above 1000 MB", ""])


@pytest.mark.slow
def test_memory_that_earlier_runs_left_is_not_the_next_runs(bad, tmp_path):
    file = bad("fine", replications=6)
    law = tmp_path / "bad_laws.py"  # 20 steps of 10 MB a run
    law.write_text(law.read_text().replace('"fine": lambda: None', '"fine": lambda: KEPT.append(np.ones(1_250_000))'))
    folder = tmp_path / "out"
    report = batch.run(study.load(file), folder, slots=1, limits=batch.Limits(memory=900.0))
    assert report.failures == {}


def test_a_run_does_not_fail_for_what_another_did_to_its_process(bad, tmp_path):
    report = batch.run(study.load(bad("spoils its process", "fine", replications=3)), tmp_path / "out", slots=1)
    assert report.failures == {}


def test_a_law_that_forks_leaves_the_tables_of_one_that_does_not(bad, tmp_path):
    file = bad("forks", "fine", replications=2)
    folder = tmp_path / "out"
    assert batch.run(study.load(file), folder, slots=1).failures == {}
    forks, fine = ([r["id"] for r in rows(folder) if r["platoon.follower.kind"] == kind] for kind in ("forks", "fine"))
    for one, other in zip(forks, fine, strict=True):
        for name in ("trajectories.csv", "events.csv", "metrics.csv"):
            assert (folder / one / name).read_bytes() == (folder / other / name).read_bytes()


def test_a_run_without_progress_is_named_while_it_lasts(bad, tmp_path, monkeypatch):
    monkeypatch.setattr(silence, "SILENCE", 1.0)
    heard = []

    class Watcher:
        def progress(self, at: batch.Progress) -> None:
            heard.append("ended")

        def silent(self, named: silence.Silence, laws: tuple[str, ...]) -> None:
            heard.append((named.id, named.seconds, named.simulated, laws))

    limits = batch.Limits(timeout=6.0)
    report = batch.run(study.load(bad("hangs")), tmp_path / "out", slots=1, limits=limits, watcher=Watcher())
    ((run_id, error),) = report.failures.items()
    assert error == "timeout after 6 s"
    laws = ("reactive", "bad_laws:Bad")
    assert heard == [*((run_id, seconds, None, laws) for seconds in (1.0, 2.0, 4.0, 0.0)), "ended"]


def test_a_serial_run_without_progress_is_named_but_limits_are_refused(bad, tmp_path, monkeypatch):
    monkeypatch.setattr(silence, "SILENCE", 0.5)
    file = bad("hangs")
    law = tmp_path / "bad_laws.py"
    law.write_text(law.read_text().replace("time.sleep(1e6)", "time.sleep(0.8)"))
    heard = []

    class Watcher:
        def progress(self, at: batch.Progress) -> None: ...

        def silent(self, named: silence.Silence, laws: tuple[str, ...]) -> None:
            heard.append(named.seconds)

    batch.run(study.load(file, ["run.duration_s=0.1"]), tmp_path / "out", "serial", watcher=Watcher())
    assert {0.5, 0.0} <= set(heard)
    for limits in (batch.Limits(timeout=60.0), batch.Limits(memory=2000.0)):
        with pytest.raises(InputError, match=r"^--\w+: not with the executor serial, which cannot stop a run"):
            batch.run(study.load(file), tmp_path / "other", "serial", limits=limits)


@pytest.mark.parametrize(("option", "value"), [("--timeout", "0"), ("--timeout", "nan"), ("--memory", "-1")])
def test_a_limit_is_positive_and_finite(option, value, tmp_path):
    ended = invoked("paper_follower", option, value, "--out", tmp_path)
    assert (ended.returncode, ended.stderr) == (2, f"{option}: {value}: must be positive and finite\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["parent", "batch"])
def test_a_law_that_hangs_outlives_neither_its_batch_nor_an_interrupt(bad, tmp_path, killed, victim):
    kinds = "hangs in compiled code", "hangs and ignores signals", "leaves a child of its own session and hangs"
    file = bad(*kinds, replications=2)
    folder = tmp_path / "out" / "bad"
    killed.append(started(file, "-j", 6, "--out", tmp_path / "out"))
    until(lambda: len(list(folder.glob("*.partial"))) == 6)
    until(lambda: len(workers_below(killed[-1].pid)) == 8)
    workers = workers_below(killed[-1].pid)
    assert len(workers) == 8
    if victim == "parent":
        killed[-1].kill()
    else:
        killed[-1].send_signal(signal.SIGINT)
    out, err = killed[-1].communicate(timeout=30)
    until(lambda: not any(map(alive, workers)), deadline=10)
    if victim == "batch":
        assert (killed[-1].returncode, out) == (130, "")
        assert "\ninterrupted\n0 of 6 runs are done" in err


@pytest.mark.slow
def test_every_kind_of_bad_law_costs_only_its_own_runs(bad, tmp_path):
    folder, kinds = tmp_path / "out" / "bad", list(KINDS)
    ended = call(bad(*kinds), "-j", 2, *LIMITS, "--out", tmp_path / "out")
    assert ended.returncode == 1
    for row, kind in zip(rows(folder), kinds, strict=True):
        assert re.fullmatch(ERRORS.get(kind, ""), row["error"]), (kind, row["error"])
    harmless = [kind for kind in kinds if kind not in ERRORS]
    assert len({line.split(",", 4)[4] for line in only(harmless, folder)}) == 1  # after id, seed, kind and tag
    assert len(done(folder)) == len(harmless)
