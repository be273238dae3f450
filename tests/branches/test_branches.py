"""A simulation that was copied, its copies, and one that nobody copied: the same bytes."""

from __future__ import annotations

import os
import re
import signal
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from platoontraffic import scenario, shipped
from platoontraffic.branches.process import Process, can_fork
from platoontraffic.branches.runs import Branch, Source, _Recorded, run_branches
from platoontraffic.branches.session import SimulationProcess
from platoontraffic.errors import InputError, RunError
from platoontraffic.recording import run
from platoontraffic.scenario import Change
from platoontraffic.scenario.overrides import branch_of
from platoontraffic.simulation import Simulation, prepare

pytestmark = [pytest.mark.sumo, pytest.mark.skipif(not can_fork, reason="this system cannot copy a process")]

HEADWAY = "platoon.follower.time_headway_s"

# A configuration that lets SUMO write into files that stay open, and into one that it opens late: conflicts.
CONFIGURATION = """<configuration>
    <input>
        <net-file value="{net}"/>
        <route-files value="{routes},late.rou.xml"/>
        <route-steps value="2"/>
        <additional-files value="{stops},detector.add.xml"/>
    </input>
    <output>
        <fcd-output value="cars.xml"/>
        <summary-output value="summary.xml"/>
        <queue-output value="queues.xml"/>
        <precision value="6"/>
    </output>
    <ssm_device>
        <device.ssm.probability value="1"/>
        <device.ssm.file value="conflicts.xml"/>
    </ssm_device>
</configuration>
"""
DETECTOR = '<additional><inductionLoop id="loop" lane="{lane}" pos="20" period="5" file="loop.xml"/></additional>'


def late_routes() -> str:
    """Cars that SUMO reads step by step from a file that is larger than what it reads at once."""
    param = f'<param key="padding" value="{"x" * 60_000}"/>'
    cars = (
        f'<vehicle id="late{i}" depart="{2 * i}" departSpeed="max"><route edges="A2_B2 B2_C2 C2_D2"/>{param}</vehicle>'
        for i in range(40)
    )
    return f"<routes>{''.join(cars)}</routes>"


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped town, of which SUMO writes everything."""
    folder, net = tmp_path_factory.mktemp("town"), shipped.networks()["grid"]
    routes = net.with_name("grid.rou.xml")
    (folder / "late.rou.xml").write_text(late_routes())
    (folder / "detector.add.xml").write_text(DETECTOR.format(lane="A0_B0_0"))
    (folder / "town.sumocfg").write_text(
        CONFIGURATION.format(net=net.resolve(), routes=routes.resolve(), stops=net.with_name("grid.add.xml").resolve())
    )
    text = shipped.scenarios()["grid_platoons"].read_text()
    text = text.replace('net = "grid"', 'config = "town.sumocfg"')
    (folder / "town.toml").write_text(text)
    (folder / "first.toml").write_text("[[platoon]]".join(text.split("[[platoon]]")[:3]))
    return folder / "town.toml"


def files_of(folder: Path) -> dict[str, bytes]:
    """The files of a run, but for times by the clock on the wall, and the scenario."""
    files = {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    for name in ("provenance.json", "config.toml", "summary.csv", "datapackage.json"):
        del files[name]
    for name in [name for name in files if name.startswith("sumo_additional_")]:  # they name the folder
        del files[name]
    for name in [name for name in files if "summary" in name]:
        files[name] = re.sub(rb'duration="[^"]*"', b"", files[name])
    # SUMO says in the head of a file when and how it was written.
    return {name: re.sub(rb"<!--.*?-->", b"", text, flags=re.DOTALL) for name, text in files.items()}


def assert_same(folder: Path, other: Path) -> None:
    one, two = files_of(folder), files_of(other)
    assert sorted(one) == sorted(two)
    assert [name for name in one if one[name] != two[name]] == []


def copies_are_exact(name: str | Path, changes: Sequence[str], times: Sequence[float], folder: Path) -> None:
    """The run that is copied at some times [s], each copy, and the undisturbed run."""
    undisturbed = run(prepare(scenario.load(name, changes)), folder / "undisturbed")
    trunk, copies = Process.holding(_Recorded, Source(str(name), tuple(changes)), folder / "trunk", []), []
    for time_ in times:
        trunk.call("advance", time_)
        same = Change("platoon.leader.lidar.mount_y_m", 0.0, "test", "")
        copies.append(trunk.fork(tuple(branch_of(time_, [same])), folder / f"copy{time_:g}"))
    for process in (copies[0], trunk, *copies[1:]):
        process.call("finish", False)
    trunk.close()
    assert_same(folder / "trunk", undisturbed)
    for time_ in times:
        assert_same(folder / f"copy{time_:g}", undisturbed)


SHORT = ("run.duration_s=10", "record.traffic_every_s=0.5", "record.scans_every_s=0.5")


@pytest.mark.slow
def test_copies_of_a_town_are_exact(town: Path, tmp_path: Path) -> None:
    changes = (*SHORT, "sumo.warm_up_s=20", "record.sumo=trips,summary,edges", "record.sumo_every_s=5")
    copies_are_exact(town.with_name("first.toml"), changes, (0.1, 4.3, 7.0), tmp_path)
    written = files_of(tmp_path / "trunk")
    assert {
        "sumo_cars.xml",
        "sumo_queues.xml",
        "sumo_loop.xml",
        "sumo_conflicts.xml",
        "sumo_trips.csv",
        "scans.npz",
    } <= set(written)
    assert written["sumo_cars.xml"].count(b"<timestep") == 302
    assert b'id="late13"' in written["sumo_cars.xml"]


SUMO_TABLES = "record.sumo=trips,summary,edges"


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        pytest.param("paper_loop", ("run.laps=0.2", "record.scans_every_s=1"), marks=pytest.mark.slow),
        pytest.param("corridor_two_platoons", ("run.duration_s=120", SUMO_TABLES, *SHORT[1:]), marks=pytest.mark.slow),
        pytest.param("town", ("run.duration_s=120", SUMO_TABLES, *SHORT[1:]), marks=pytest.mark.soak),
    ],
)
def test_copies_are_exact(name: str, changes: Sequence[str], town: Path, tmp_path: Path) -> None:
    file = town.with_name(f"{name}.toml")
    copies_are_exact(file if file.exists() else name, changes, (10.0, 25.0, 40.0), tmp_path)


def test_a_branch_equals_its_run_from_the_begin(tmp_path: Path) -> None:
    """With a law of another class, other gains, another laser and a breakdown; `config.toml` repeats each."""
    changes = (*SHORT, "record.sumo=trips")
    thens = (
        (f"{HEADWAY}=2",),
        ("platoon.follower.law=repaired",),
        ("platoon.follower.lidar.noise=none", "platoon.follower.on_loss=stop"),
        ('breakdown=[{ vehicle = "platoon.2", what = "drive", time_s = 6.0 }]',),
    )
    source, branches = Source("corridor_tracking", changes), []
    base = scenario.load("corridor_tracking", changes)
    for i, then in enumerate(thens):
        of_branch = branch_of(5.0, [Change.parse(text, 1) for text in then])
        branches.append(Branch(tuple(of_branch), tmp_path / f"branch{i}"))
    assert [one.error for one in run_branches(source, tmp_path / "trunk", 5.0, branches, 2)] == [None] * 5
    before = (tmp_path / "trunk" / "trajectories.csv").read_bytes()
    for branch in branches:
        whole = run(prepare(base.branched(branch.changes)), tmp_path / "whole" / branch.folder.name)
        assert_same(branch.folder, whole)
        again = scenario.load(branch.folder / "config.toml")
        assert again.resolved() == base.branched(branch.changes).resolved()
        after = (branch.folder / "trajectories.csv").read_bytes()
        common = before.index(b"\n5.100,")
        assert after[:common] == before[:common]
        assert after != before


# ---- stepped from outside


def test_copies_go_on_as_the_simulation_in_this_process() -> None:
    changes = ("run.duration_s=10",)
    with Simulation.load("corridor_tracking", *changes) as simulation:
        instants = list(simulation)
    with SimulationProcess.load("corridor_tracking", *changes) as trunk:
        assert trunk.run(until=4.0).time == 4.0
        with trunk.branch() as copy, trunk.branch(f"{HEADWAY}=3") as other:
            with copy.branch() as of_copy:
                assert (of_copy.run().fleet.motion.x == instants[-1].fleet.motion.x).all()
            for one in (trunk, copy):
                for expected in instants[trunk.now.step + 1 :] if one is copy else ():
                    now = one.step()
                    assert (now.fleet.motion.x == expected.fleet.motion.x).all()
                    assert (now.traffic.x == expected.traffic.x).all()
            assert copy.outcome.ended == "duration"
            assert copy.statistics() == trunk_statistics(changes)
            assert (other.run().fleet.motion.x != instants[-1].fleet.motion.x).any()
        now = trunk.run()  # its copies have gone on, it has not
        assert np.array_equal(now.measures.gap, instants[-1].measures.gap, equal_nan=True)


def trunk_statistics(changes: Sequence[str]) -> list:
    with Simulation.load("corridor_tracking", *changes) as simulation:
        for _ in simulation:
            pass
        return simulation.statistics()


# ---- faults


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(holds) -> bool:
    for _ in range(100):
        if holds():
            return True
        time.sleep(0.1)
    return False


@pytest.fixture(scope="module")
def root():
    with SimulationProcess.load("corridor_tracking", "run.duration_s=30") as root:
        root.run(until=1.0)
        yield root


@pytest.fixture
def trunk(root: SimulationProcess):
    """A copy, which has copies in its turn."""
    with root.branch() as trunk:
        yield trunk


def test_a_branch_that_is_killed_costs_nothing_else(trunk: SimulationProcess) -> None:
    killed, hangs, other = trunk.branch(), trunk.branch(), trunk.branch()
    os.kill(killed._process.pid, signal.SIGKILL)
    os.kill(hangs._process.pid, signal.SIGSTOP)
    with pytest.raises(RunError, match="has died"):
        killed.step()
    one, two = trunk.run(until=3.0), other.run(until=3.0)
    assert (one.fleet.motion.x == two.fleet.motion.x).all()
    began = time.monotonic()
    for process in (killed, hangs, other):
        process.close()
    assert time.monotonic() - began < 20
    assert until(lambda: not alive(hangs._process.pid))
    assert until(lambda: not os.path.exists(killed._folder.name))


def test_a_process_that_dies_while_it_is_asked_to_fork_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    process = Process(quiet=True)
    os.kill(process.pid, signal.SIGKILL)
    process._popen.wait()
    monkeypatch.setattr(Process, "send", lambda self, *call: None)  # it was alive then
    with pytest.raises(RunError, match="has died"):
        process.fork()


def test_a_trunk_that_is_killed_leaves_no_branch(trunk: SimulationProcess) -> None:
    branches = [trunk.branch() for _ in range(3)]
    pids = [one._process.pid for one in branches]
    os.kill(trunk._process.pid, signal.SIGKILL)
    assert until(lambda: not any(map(alive, pids)))
    with pytest.raises(RunError, match="has died"):
        branches[0].step()


def test_many_branches_leave_nothing(trunk: SimulationProcess) -> None:
    def left() -> tuple[int, int, int]:
        pid = trunk._process.pid
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return len(os.listdir("/proc/self/fd")), len(os.listdir(f"/proc/{pid}/fd")), pages

    for _ in range(5):
        trunk.branch().close()
    before = left()
    for _ in range(50):
        trunk.branch().close()
    mine, theirs, pages = left()
    assert (mine, theirs) == before[:2]
    assert pages < before[2] * 1.05
    assert len(os.listdir(trunk._folder.name)) == 1


def test_ctrl_c_ends_a_run_from_outside() -> None:
    with SimulationProcess.load("corridor_tracking", "run.duration_s=4000", "platoon.size=2") as long:
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            long.run()
        with pytest.raises(RuntimeError, match="closed"):  # not the answer to the call before
            long.step()
        with pytest.raises(RuntimeError, match="closed"):
            long.branch()


@pytest.mark.parametrize("at", [2.0, 3000.0], ids=["after the branch", "before it"])
def test_ctrl_c_keeps_what_was_recorded(at: float, tmp_path: Path) -> None:
    source = Source("corridor_tracking", ("run.duration_s=4000", "platoon.size=2"))
    branch = Branch(tuple(branch_of(at, [Change.parse(f"{HEADWAY}=2", 1)])), tmp_path / "branch")
    simulated = 0.0

    def reached(time_: float) -> None:
        nonlocal simulated
        before, simulated = simulated, simulated + time_
        if before < 5.0 <= simulated:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt) as error:
        run_branches(source, tmp_path / "trunk", at, [branch], 2, reached=reached)
    kept = sorted(path.name for path in tmp_path.iterdir())
    assert kept == (["branch.unfinished", "trunk.unfinished"] if at == 2.0 else ["trunk.unfinished"])
    assert (tmp_path / "trunk.unfinished" / "trajectories.csv").read_bytes().count(b"\n") > 20
    assert len(error.value.__notes__) == len(kept)


def test_a_branch_that_cannot_be_recorded_costs_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    change = tuple(branch_of(1.0, [Change.parse(f"{HEADWAY}=2", 1)]))
    branches = [Branch(change, tmp_path / "file" / "branch"), Branch(change, tmp_path / "branch")]
    source = Source("corridor_tracking", ("run.duration_s=2", "platoon.size=2"))
    ended = run_branches(source, tmp_path / "trunk", 1.0, branches, 2)
    assert {one.folder for one in ended if one.error} == {tmp_path / "file" / "branch"}
    assert_same(
        tmp_path / "trunk", run(prepare(scenario.load("corridor_tracking", source.changes)), tmp_path / "alone")
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["alone", "branch", "file", "trunk"]


def test_faults_of_changes_are_reported_before_the_copy(trunk: SimulationProcess) -> None:
    with pytest.raises(InputError) as error:
        trunk.branch("platoon.size=3", "platoon.follower.time_hedway_s=2")
    assert len(error.value.faults) == 1
    assert "platoon.0.size: does not change at a branch" in str(error.value)
    with pytest.raises(InputError, match="time_headway_s"):
        trunk.branch("platoon.follower.time_hedway_s=2")
    with pytest.raises(InputError, match="must be given once"):
        trunk.branch(f"{HEADWAY}=2", f"{HEADWAY}=3")
    changes = "branch.at_s=1", f"branch.then.{HEADWAY}=2"
    with (
        SimulationProcess.load("corridor_tracking", *changes) as other,
        pytest.raises(InputError, match="at 1 s itself"),
    ):
        other.branch(f"{HEADWAY}=3")
    with pytest.raises(InputError, match="must be texts such as"):
        trunk.branch(3)
    with pytest.raises(ValueError, match="no member"):
        trunk.step({"nobody": None})
    assert trunk.step().time > 1.0


def test_a_process_at_its_end_says_what_begins_anew() -> None:
    with SimulationProcess.load("corridor_tracking", "run.duration_s=0.2") as simulation:
        simulation.run()
        with pytest.raises(RuntimeError, match=r"has ended \(duration\); load\(\) begins anew"):  # it has no reset()
            simulation.step()
        with pytest.raises(RuntimeError, match="has ended"):
            simulation.branch(f"{HEADWAY}=2")
