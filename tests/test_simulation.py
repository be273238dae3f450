"""The simulation stepped from outside: as a run does it, overridden, reset, and asked too late."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from platoontraffic import scenario
from platoontraffic.controllers.law import Decision, Law
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.errors import InputError
from platoontraffic.lidar import Noise
from platoontraffic.observation.instant import Instant
from platoontraffic.observation.observer import Observer
from platoontraffic.results.recorder import Clocks, Recorder
from platoontraffic.simulation import Setting, Simulation, prepare, setting_of
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.odometry import ODOMETRY
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import Member
from platoontraffic.world.ground import BareGround
from tests.support.bench import DT, FOLLOWER_EYE, NO_WALLS, constant, platoon
from tests.support.observed import ROAD
from tests.support.runs import run

NOISY = replace(FOLLOWER_EYE, noise=Noise(sigma=0.005, dropout=0.05))
STEPS = 60


def robots() -> list[Member]:
    """A leader that drives a circle, and two followers whose lasers and odometry have errors."""
    return platoon(constant(0.1, 0.05), RepairedFollower(), 2, eye=NOISY, odometry=ODOMETRY["car"])


def of_robots(members: Sequence[Member] | None = None, steps: int | None = STEPS) -> Simulation:
    return Simulation(Setting(members or robots(), NO_WALLS, DT, steps=steps, seed=3))


def stepped(simulation: Simulation) -> Iterator[Instant]:
    now = simulation.reset()
    yield now
    while not now.ended:
        now = simulation.step()
        yield now


def facts(now: Instant) -> list[Any]:
    """Everything that an instant says, but for laws and measures."""
    fleet, scans = now.fleet, [scan and scan.ranges for scan in now.scans]
    state = [vars(fleet.motion), vars(now.traffic), fleet.command.twist, fleet.command.drive, fleet.target]
    return [now.step, now.time, *state, scans, list(now.roads), list(now.events), now.ended]


def test_the_seed_of_a_deployed_simulation_may_still_be_chosen():
    simulation, other = of_robots(), of_robots()
    simulation.deploy()
    simulation.setting = replace(simulation.setting, seed=4)
    np.testing.assert_equal(facts(simulation.begin()), facts(Simulation(simulation.setting).reset()))
    assert not np.array_equal(simulation.now.scans[1].ranges, other.reset().scans[1].ranges)


# ---- as a run


def files_of(name: str, changes: Sequence[str], folder: Path) -> list[bytes]:
    """Trajectories and events, recorded by whoever steps the simulation."""
    loaded = scenario.load(name, changes)
    recorder = Recorder(folder, Clocks.of(loaded.spec.record, loaded.spec.run.step_s))
    with Simulation(setting_of(prepare(loaded))) as simulation:
        for now in stepped(simulation):
            recorder.record(now)
    recorder.close_tables()
    return [(recorder.folder / table).read_bytes() for table in ("trajectories.csv", "events.csv")]


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("paper_loop", ["run.duration_s=5"]),
        ("corridor_two_platoons", ["run.duration_s=10"]),
        pytest.param("grid_platoons", ["run.duration_s=100"], marks=pytest.mark.soak),
    ],
)
def test_a_simulation_stepped_from_outside_is_the_run(tmp_path, name, changes):
    folder = run(tmp_path / "run", name, *changes)
    trajectories, events = files_of(name, changes, tmp_path / "stepped")
    assert trajectories == (folder / "trajectories.csv").read_bytes()
    of_run = (folder / "events.csv").read_bytes()
    assert of_run.startswith(events)
    at_the_end = of_run[len(events) :].splitlines()  # what only a run notes
    assert {line.split(b",")[1] for line in at_the_end} <= {b"never_departed", b"end"}
    assert b",end," in at_the_end[-1]


def test_iterating_is_stepping():
    with of_robots() as one, of_robots() as other:
        for a, b in zip(one, stepped(other), strict=True):
            np.testing.assert_equal(facts(a), facts(b))


# ---- the end


def test_it_ends_after_its_steps_and_takes_no_more():
    with of_robots(steps=3) as simulation:
        *before, last = simulation
        assert [now.ended for now in before] == [""] * 3
        assert (last.step, last.time, last.ended) == (3, pytest.approx(3 * DT), "duration")
        assert simulation.outcome == (last.time, "duration", [])
        with pytest.raises(RuntimeError, match="has ended"):
            simulation.step()


def test_it_has_no_outcome_before_its_end():
    with of_robots() as simulation:
        simulation.reset()
        with pytest.raises(RuntimeError, match="has not ended"):
            _ = simulation.outcome


# ---- other commands than those of the laws


def test_a_member_whose_command_is_overridden_drives_as_by_a_law_that_commands_the_same():
    ordered = [replace(m, law=constant(0.2, -0.1)) if m.place == 1 else m for m in robots()]
    with of_robots() as one, of_robots(ordered) as other:
        one.reset()
        other.reset()
        for _ in range(STEPS):
            now, expected = one.step({"robot.1": Twist(0.2, -0.1)}), other.step()
            np.testing.assert_equal(vars(now.fleet.motion), vars(expected.fleet.motion))


def test_an_override_lasts_for_one_step():
    with of_robots(platoon(constant(0.1))) as simulation:
        x = [simulation.reset().fleet.motion.x[0]]
        for override in ({}, {"robot.0": Twist(0.0, 0.0)}, {}):
            x.append(simulation.step(override).fleet.motion.x[0])
    assert np.diff(x) == pytest.approx([0.1 * DT, 0.0, 0.1 * DT])


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ([Twist(0.1, 0.0)], "must be commands by member id"),
        ({"robot.7": Twist(0.1, 0.0)}, "'robot.7': no member on the road; did you mean"),
        ({"robot.1": Twist(np.nan, 0.0)}, "'robot.1': .*; must be two finite numbers"),
        ({"robot.1": Drive(np.inf, 0.0)}, "'robot.1': .*; must be two finite numbers"),
    ],
)
def test_an_override_that_cannot_be_driven_is_refused_and_changes_nothing(override, said):
    with of_robots() as one, of_robots() as other:
        one.reset()
        other.reset()
        with pytest.raises(ValueError, match=said):
            one.step(override)
        np.testing.assert_equal(facts(one.step()), facts(other.step()))


@pytest.mark.sumo
def test_a_member_that_sumo_drives_takes_no_command():
    with Simulation.load("highway_platoon", "sumo.warm_up_s=0") as simulation:
        simulation.reset()
        with pytest.raises(ValueError, match=r"'platoon\.0': SUMO drives it"):
            simulation.step({"platoon.0": Drive(0.0, 0.0)})


# ---- what goes wrong


@dataclass(frozen=True)
class FailsOnce(Law):
    at: float  # [s]

    def __call__(self, sensed, memory, dt):
        if abs(sensed.scan.stamp - self.at) < DT / 2:
            raise ValueError("for once")
        return Decision(Twist(0 * sensed.speed, 0 * sensed.speed))


def test_after_a_step_that_has_failed_there_is_none():
    """Some have moved, others have not: it went on with the wrong time."""
    with of_robots(platoon(FailsOnce(2 * DT))) as simulation:
        simulation.reset()
        simulation.step()
        with pytest.raises(InputError, match="for once"):
            simulation.step()
        with pytest.raises(RuntimeError, match=r"the last step has failed; reset\(\) begins anew"):
            simulation.step()
        assert simulation.reset().step == 0
        assert simulation.step().step == 1


def test_after_a_reset_that_has_failed_there_is_no_step(monkeypatch):
    """It went on with the vehicles of the run before, in the world of the next."""
    with of_robots() as simulation:
        simulation.reset()
        simulation.step()
        for stage in ("deploy", "snapshot"):
            with monkeypatch.context() as patched:
                patched.setattr(BareGround, stage, lambda *_: 1 / 0)
                with pytest.raises(ZeroDivisionError):
                    simulation.reset()
            with pytest.raises(RuntimeError, match=r"reset\(\) gives the first instant"):
                simulation.step()
        simulation.reset()
        assert simulation.step().step == 1


@pytest.mark.sumo
def test_a_closed_simulation_says_so():
    with Simulation.load("highway_platoon", "sumo.warm_up_s=0") as simulation:
        simulation.reset()
    with pytest.raises(RuntimeError, match="the simulation is closed"):
        simulation.step()
    with pytest.raises(RuntimeError, match="the simulation is closed"):
        _ = simulation.sumo


@pytest.mark.sumo
def test_after_close_another_simulation_may_begin():
    one, other = (Simulation.load("highway_platoon", "sumo.warm_up_s=0") for _ in range(2))
    one.reset()
    one.close()
    assert other.reset().step == 0
    other.close()
    other.close()  # again, which does nothing
    with pytest.raises(RuntimeError, match="the simulation is closed"):
        other.step()


def test_changes_are_texts():
    with pytest.raises(InputError, match=r"changes: .*: must be texts such as 'platoon.size=3'"):
        Simulation.load("paper_loop", ["platoon.size=3"])


def test_a_scenario_is_a_file_or_a_name():
    with pytest.raises(InputError, match="scenario: None: must be a file, or the name of a shipped one"):
        Simulation.load(None)


# ---- measures


def test_measures_must_be_looked_at_before_the_next_step():
    members = robots()

    def observer() -> Observer:
        return Observer(members, ROAD, Contacts(NO_WALLS, {m.id for m in members}))

    with Simulation(Setting(members, NO_WALLS, DT, steps=STEPS, observer=observer)) as simulation:
        first = simulation.reset()
        second = simulation.step()
        with pytest.raises(RuntimeError, match="before the next step"):
            _ = first.measures
        kept = second.measures
        simulation.step()
        assert second.measures is kept


def test_a_simulation_without_observer_has_no_measures():
    with of_robots() as simulation:
        with pytest.raises(RuntimeError, match="no observer"):
            _ = simulation.reset().measures
        with pytest.raises(RuntimeError, match="no observer"):
            simulation.statistics()


# ---- again


def test_a_reset_in_the_middle_gives_the_same_instants_again():
    with of_robots() as simulation:
        simulation.reset()
        first = [facts(simulation.step()) for _ in range(STEPS // 2)]
        simulation.reset()
        again = [facts(simulation.step()) for _ in range(STEPS // 2)]
    np.testing.assert_equal(again, first)


@pytest.mark.sumo
def test_a_reset_begins_anew_in_sumo():
    changes = ["run.duration_s=3", "sumo.warm_up_s=30"]
    with Simulation.load("corridor_two_platoons", *changes) as simulation:
        first, again = ([facts(now) for now in simulation] for _ in range(2))
    assert len(first) == 31
    assert len(first[0][3]["ids"]) > 10  # with background traffic
    np.testing.assert_equal(again, first)


def test_the_order_of_members_does_not_matter():
    with of_robots() as one, of_robots(robots()[::-1]) as other:
        for a, b in zip(one, other, strict=True):
            assert [m.id for m in a.fleet.members] == [m.id for m in b.fleet.members][::-1]
            for name, values in vars(a.fleet.motion).items():
                np.testing.assert_array_equal(values, vars(b.fleet.motion)[name][::-1])


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("before", "meanwhile", "after"), [(700, None, 700), (700, 900, 900), (0, None, 0), (200_000, None, 200_000)]
)
def test_python_collects_rarely_while_a_simulation_is_open(before, meanwhile, after):
    """What the program has set stays."""
    usual = gc.get_threshold()
    gc.set_threshold(before, *usual[1:])
    try:
        with Simulation.load("highway_platoon", "sumo.warm_up_s=0") as simulation:
            simulation.reset()
            assert gc.get_threshold()[0] == (50_000 if before == 700 else before)
            if meanwhile:
                gc.set_threshold(meanwhile, *usual[1:])
        assert gc.get_threshold()[0] == after
    finally:
        gc.set_threshold(*usual)
