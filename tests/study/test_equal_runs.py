"""Runs that differ in nothing but a seed on which nothing depends: one is simulated, the others get its results."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from platoontraffic import scenario
from platoontraffic.recording import run
from platoontraffic.simulation import prepare
from platoontraffic.study import batch, study, worker
from tests.support.batches import done, invoked, tables

pytestmark = pytest.mark.sumo

STUDY = """
base = "{base}"
seeds = [{seeds}]
[set]
run.duration_s = 0.5
record.scans_every_s = 0.1
[grid]
platoon.size = [2, 3]
"""


def written(folder: Path, *seeds: int, base: str = "paper_loop") -> study.Study:
    (folder / "equal.toml").write_text(STUDY.format(base=base, seeds=", ".join(map(str, seeds))))
    return study.load(folder / "equal.toml")


def simulated(folder: Path) -> list[str]:
    return sorted(run for run in done(folder) if "equal_to" not in provenance(folder / run))


def provenance(folder: Path) -> dict:
    return json.loads((folder / "provenance.json").read_text())


@pytest.mark.parametrize("base", ["paper_loop", "lab_obstacles"])
def test_a_copy_has_the_bytes_of_the_run_that_it_stands_for(tmp_path, base):
    loaded, folder = written(tmp_path, 7, 3, base=base), tmp_path / "out"
    batch.run(loaded, folder, "serial")
    first, other = loaded.runs[:2]
    assert simulated(folder) == sorted(one.id for one in loaded.runs if one.seed == 7)
    alone = run(prepare(scenario.load(base, other.changes, other.seed)), tmp_path / "alone" / other.id)
    names = {file.name for file in alone.iterdir()}
    assert {file.name for file in (folder / other.id).iterdir()} == names
    for name in names - {"provenance.json"}:
        assert (folder / other.id / name).read_bytes() == (alone / name).read_bytes(), name
    there, here = provenance(alone), provenance(folder / other.id)
    times = {"wall_s", "real_time_factor", "stage_s", "command_line"}
    assert {key: here[key] for key in here.keys() - times} == {key: there[key] for key in there.keys() - times} | {
        "equal_to": first.id
    }


def test_executors_shards_and_resumed_batches_leave_the_same_tables(tmp_path):
    loaded = written(tmp_path, 1, 2, 3)
    batch.run(loaded, tmp_path / "processes", slots=2)
    for number in (2, 1):
        batch.run(loaded, tmp_path / "shards", "serial", shard=batch.Shard(number, 2))
    batch.run(written(tmp_path, 1), tmp_path / "resumed", "serial")
    before = done(tmp_path / "resumed")
    report = batch.run(loaded, tmp_path / "resumed", "serial")
    assert (report.progress.earlier, report.progress.ended_now, report.progress.done) == (2, 4, 6)
    assert before.items() <= done(tmp_path / "resumed").items()
    assert tables(tmp_path / "processes") == tables(tmp_path / "shards") == tables(tmp_path / "resumed")
    assert len(simulated(tmp_path / "processes")) == len(simulated(tmp_path / "resumed")) == 2


def test_pages_made_of_a_run_are_not_copied(tmp_path):
    first = written(tmp_path, 1)
    batch.run(first, tmp_path / "out", "serial")
    (tmp_path / "out" / first.runs[0].id / "report.html").write_text("of seed 1")
    loaded = written(tmp_path, 1, 2)
    batch.run(loaded, tmp_path / "out", "serial")
    assert not (tmp_path / "out" / loaded.runs[1].id / "report.html").exists()


def test_a_run_is_simulated_if_the_one_that_it_equals_has_failed(tmp_path, monkeypatch):
    loaded, executed = written(tmp_path, 1, 2), worker.attempt
    fails = loaded.runs[0].id

    def attempt(job: dict, *rest: object) -> dict:
        if job["id"] == fails:
            return {"error": "too late", "traceback": "", "wall_s": 0.0}
        return executed(job, *rest)

    monkeypatch.setattr(worker, "attempt", attempt)
    report = batch.run(loaded, tmp_path / "out", "serial")
    assert report.failures == {fails: "too late"}
    assert simulated(tmp_path / "out") == sorted(one.id for one in loaded.runs[1:3])


def test_a_batch_says_that_it_simulates_one_of_equal_runs(tmp_path):
    written(tmp_path, 1, 2)
    ended = invoked(tmp_path / "equal.toml", "--executor", "serial", "--out", tmp_path / "out")
    said = "2 of these runs are equal to others, because nothing in them is random: one seed is simulated\n"
    assert (ended.returncode, ended.stderr) == (0, said)
    assert "4 runs: 4 done, 0 failed" in ended.stdout


def test_a_dry_run_of_a_part_speaks_of_its_own_runs(tmp_path):
    """Of four runs two are equal to others; a part with one run said so too."""
    written(tmp_path, 1, 2)
    ended = invoked(tmp_path / "equal.toml", "--dry-run", "--shard", "1/4", "--out", tmp_path / "out")
    assert "1 run, 1 to do" in ended.stdout
    assert "of these runs" not in ended.stdout
