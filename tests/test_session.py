"""Runs, batches and simulations from Python."""

import numpy as np
import pytest

import platoontraffic
from platoontraffic import Simulation
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.errors import InputError, RunError
from platoontraffic.simulation import Setting
from tests.support import ROOT

pytestmark = pytest.mark.sumo


def test_a_run_gives_its_results_and_is_not_repeated(tmp_path):
    first = platoontraffic.run("paper_loop", "run.duration_s=0.5", seed=3, results=tmp_path)
    written = (first.folder / "DONE").stat().st_mtime_ns
    again = platoontraffic.run("paper_loop", "run.duration_s=0.5", seed=3, results=tmp_path)
    assert first.trajectories.equals(again.trajectories)
    assert (again.folder / "DONE").stat().st_mtime_ns == written


def test_a_batch_gives_its_tables_and_names_a_run_that_fails(tmp_path):
    study = tmp_path / "two.toml"
    (tmp_path / "loop.toml").write_text((ROOT / "scenarios" / "paper_loop.toml").read_text())
    study.write_text('base = "loop.toml"\nset.run.duration_s = 0.5\ngrid.platoon.leader.law = ["reactive", "mine:Law"]')
    (tmp_path / "mine.py").write_text(
        "from dataclasses import dataclass\n@dataclass(frozen=True)\nclass Law:\n    def __call__(self, *_): 1 / 0\n"
    )
    with pytest.raises(RunError, match=r"1 of 2 runs failed; .*division by zero"):
        platoontraffic.batch(study, results=tmp_path / "results", jobs=1)
    study.write_text('base = "loop.toml"\nset.run.duration_s = 0.5\nreplications = 2')
    batch = platoontraffic.batch(study, "platoon.size=2", results=tmp_path / "other", jobs=1)
    assert list(batch.summary.seed) == [1, 2]


@pytest.mark.parametrize("jobs", [0, -1, 1.5, "2"])
def test_jobs_are_a_whole_number_from_one(tmp_path, jobs):
    with pytest.raises(InputError, match=f"jobs: {jobs!r}: must be a whole number, 1 or more"):
        platoontraffic.batch("yardsticks", results=tmp_path / "results", jobs=jobs)
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: platoontraffic.run("paper_loop", results=5), "results: 5: must be a folder"),
        (lambda: platoontraffic.batch("yardsticks", results=None), "results: None: must be a folder"),
        (lambda: platoontraffic.run(5), "scenario: 5: must be a file, or the name of a shipped one"),
        (lambda: platoontraffic.batch(5), "study: 5: must be a file, or the name of a shipped one"),
        (lambda: platoontraffic.run("paper_loop", 5), "changes: (5,): must be texts such as 'platoon.size=3'"),
        (lambda: platoontraffic.batch("yardsticks", 5), "changes: (5,): must be texts such as 'platoon.size=3'"),
    ],
)
def test_an_argument_of_another_type_is_said_in_a_line(call, said):
    with pytest.raises(InputError) as raised:
        call()
    assert str(raised.value) == said


def test_a_seed_may_be_of_numpy_but_not_a_fraction(tmp_path):
    one = Simulation.load("paper_loop", seed=np.int64(7))
    assert one.setting.seed == 7
    with pytest.raises(InputError, match="seed"):
        Simulation.load("paper_loop", seed=1.5)


def test_laws_replace_those_of_the_scenario():
    wider = {"robot.2": RepairedFollower(stand_off=0.6)}
    gaps = []
    for laws in (None, wider):
        with Simulation.load("paper_loop", "run.duration_s=20", laws=laws) as simulation:
            *_, last = simulation
            gaps.append(last.measures.gap)
    assert gaps[1][1] == gaps[0][1]  # it is ahead of the other law
    assert gaps[1][2] - gaps[0][2] == pytest.approx(0.15, abs=0.04)
    with pytest.raises(InputError, match=r"'robot\.9': no member.*\n?.*") as raised:
        Simulation.load("paper_loop", laws={"robot.9": RepairedFollower(), "robot.1": 3})
    assert len(raised.value.faults) == 2


def test_sumo_is_handed_out():
    with Simulation.load("paper_loop", "run.duration_s=1") as simulation:
        with pytest.raises(RuntimeError, match="no SUMO"):
            simulation.sumo  # noqa: B018
        now = simulation.reset()
        x, y = simulation.sumo.vehicle.getPosition("robot.0")
        motion = now.fleet.motion
        assert np.hypot(x - motion.x[0], y - motion.y[0]) == pytest.approx(0.1, abs=1e-6)  # the front bumper
    bare = Simulation(Setting((), None, 0.1))
    with pytest.raises(RuntimeError, match="no SUMO"):
        bare.sumo  # noqa: B018
