"""Scans and odometry that are used later than they were taken."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from platoontraffic.controllers import Decision, Law
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.lidar import LidarModel, Mount, Noise
from platoontraffic.observation.observer import Observer
from platoontraffic.results.scans import ScanRecorder
from platoontraffic.scenario import Breakdown
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.motion import Twist
from platoontraffic.vehicles.odometry import OdometryErrors
from platoontraffic.world.contact import Contacts
from platoontraffic.world.ground import BareGround
from tests.support.bench import NO_WALLS, constant, platoon
from tests.support.observed import ROAD

DT = 0.1
EYE = LidarModel(181, -0.5, 0.5, 0.01, 20.0, rate=5.0, mount=Mount(0.05), noise=Noise(sigma=0.02))


@dataclass(frozen=True)
class Noting(Law):
    """Drives straight on; its memory is what it was given."""

    def __call__(self, sensed, memory, dt):
        n = len(sensed.speed)
        given = [(sensed.scan.stamp, sensed.age, sensed.odometry_age, dt, float(sensed.speed[i])) for i in range(n)]
        before = memory or [()] * n
        return Decision(Twist(sensed.speed, np.zeros(n)), [(*old, new) for old, new in zip(before, given, strict=True)])


def members(delay: float, odometry: float = 0.0, law: Law = Noting(), eye: LidarModel = EYE, speed: float = 0.3):
    eye = replace(eye, delay=delay)
    return platoon(law, law, 2, leader_eye=eye, eye=eye, distance=1.0, speed=speed,
                   odometry=OdometryErrors(delay=odometry))  # fmt: skip


def instants(some, steps: int = 30, **more):
    with Simulation(Setting(some, NO_WALLS, DT, steps, **more)) as simulation:
        return list(simulation)


@pytest.mark.parametrize(("delay", "steps"), [(0.0, 0), (0.1, 1), (0.25, 3), (0.3, 3), (0.7, 7), (1.0, 10)])
def test_each_scan_is_used_once_and_in_order_in_the_first_step_after_its_delay(delay, steps):
    """At 0.7 s four scans are under way."""
    seen = instants(members(delay))
    used = [(now.step, now.scans[0].stamp) for now in seen if now.scans[0] is not None]
    assert [step for step, _ in used] == list(range(steps, 31, 2))
    assert [stamp for _, stamp in used] == pytest.approx([DT * k for k in range(0, 31 - steps, 2)])
    given = seen[-1].fleet.groups[0].memory[0]
    assert {age for _, age, *_ in given} == {steps * DT}
    assert {dt for *_, dt, _ in given} == {2 * DT}


def test_a_late_scan_is_that_of_its_instant_bit_for_bit():
    new, late = instants(members(0.0)), instants(members(0.3))
    for now in late[3:]:
        then = new[now.step - 3]
        for scan, seen, same in zip(now.scans, now.seen, then.scans, strict=True):
            assert (scan is None) == (same is None)
            if scan is not None:
                np.testing.assert_array_equal(scan.ranges, same.ranges)
                np.testing.assert_array_equal(scan.hits, same.hits)
                assert seen.traffic.time == then.time
                assert seen.traffic.x == pytest.approx(then.traffic.x)


def test_a_straight_platoon_measures_the_distance_of_then():
    """The leader drives away at 0.4 m/s from a follower at 0.3 m/s."""
    some = members(0.5, law=constant(0.3), eye=replace(EYE, noise=Noise()))
    some[0] = replace(some[0], law=constant(0.4), speed=0.4)
    for now in instants(some)[5:]:
        scan = now.scans[1]
        if scan is not None:
            at_first = scan.ranges[0].min() - 0.1 * (now.time - 0.5)
            assert at_first == pytest.approx(1.0, abs=2e-3)


def test_odometry_is_that_of_then_and_before_the_first_that_of_the_start():
    given = instants(members(0.0, odometry=0.4, law=Faster()))[-1].fleet.groups[0].memory[0]
    assert [speed for *_, speed in given] == pytest.approx([0.3] * 3 + [0.3 + 0.02 * k for k in range(1, 14)], abs=1e-9)
    assert {age for _, _, age, *_ in given} == {4 * DT}


@dataclass(frozen=True)
class Faster(Noting):
    """Each decision is 0.02 m/s faster than the one before."""

    def __call__(self, sensed, memory, dt):
        decision = super().__call__(sensed, memory, dt)
        speed = 0.3 + 0.02 * len(decision.memory[0])
        return decision._replace(command=decision.command._replace(speed=np.full(len(sensed.speed), speed)))


def test_before_the_first_scan_a_vehicle_keeps_its_speed_and_no_law_decides():
    seen = instants(members(0.5, law=constant(0.1)))
    assert all(scan is None for now in seen[:5] for scan in now.scans)
    speed = np.array([now.fleet.motion.speed[1] for now in seen])
    assert speed[:6] == pytest.approx(np.full(6, 0.3))
    assert speed[7:] == pytest.approx(np.full(24, 0.1))


class Leaving(BareGround):
    """One member leaves the road after some steps."""

    def __init__(self, step: float, gone: str, after: int) -> None:
        super().__init__(step)
        self._gone, self._after = gone, after

    def advance(self, fleet):
        fleet = super().advance(fleet)
        return fleet.without({self._gone} & {m.id for m in fleet.members}) if self._steps >= self._after else fleet


def aside(gone_first: bool):
    """A lone robot, and a platoon; the robot comes first or last."""
    lone = [replace(m, id="lone", platoon="lone") for m in platoon(constant(0.0), at=(0.0, 9.0, 0.0))]
    law = RepairedFollower(stand_off=0.4)
    behind = platoon(constant(0.3), law, 2, leader_eye=EYE, eye=replace(EYE, delay=0.5), distance=0.7, speed=0.3)
    return [*lone, *behind] if gone_first else [*behind, *lone]


def observer(some):
    return lambda: Observer(some, ROAD, Contacts(NO_WALLS, {m.id for m in some}))


def measured(some, names, **more):
    """Targets and beams of some members at each instant."""
    found = []
    with Simulation(Setting(some, NO_WALLS, DT, 30, observer=observer(some), **more)) as simulation:
        for now in simulation:
            rows = [now.traffic.ids.index(name) for name in names if name in now.traffic.ids]
            found.append([(now.measures.target[i], now.measures.beams[i], now.measures.occluded[i]) for i in rows])
    return found


@pytest.mark.parametrize("gone_first", [True, False])
def test_sight_and_target_are_those_of_the_scan_that_is_used(gone_first):
    """That a robot far aside leaves changes nothing, though all rows after its own are others then."""
    some, names = aside(gone_first), ("robot.1", "robot.2")
    leaves = measured(some, names, ground=lambda: Leaving(DT, "lone", 12))
    assert leaves[5:] == measured(some, names)[5:]
    assert [[target for target, *_ in one] for one in leaves[5:]] == [["robot.0", "robot.1"]] * 26
    assert min(beams for one in leaves[5:] for _, beams, _ in one) > 5
    assert max(abs(occluded) for one in leaves[5:] for *_, occluded in one) < 0.1


def test_a_predecessor_that_has_left_is_still_seen_in_scans_that_were_under_way():
    some = aside(True)
    with Simulation(Setting(some, NO_WALLS, DT, 30, ground=lambda: Leaving(DT, "robot.1", 12))) as simulation:
        names = []
        for now in simulation:
            group = next(k for k, one in enumerate(now.fleet.groups) if one.delay)
            scan, seen = now.scans[group], now.seen[group]
            if scan is not None:
                assert list(scan.ids) == [now.fleet.members[i].id for i in now.fleet.groups[group].rows]
                assert [seen.traffic.ids[i] for i in seen.rows] == list(scan.ids)
                hit = {seen.traffic.ids[i] for i in np.unique(scan.hits[-1]) if i >= 0}
                names.append((now.step, hit))
    assert {step: hit for step, hit in names if step < 17} == {k: {"robot.1"} for k in (5, 7, 9, 11, 13, 15)}
    assert all(hit == {"robot.0"} for step, hit in names if step >= 17)


def test_scans_before_a_breakdown_still_come_and_lost_ones_after_the_repair():
    broken = Breakdown(vehicle="robot.1", what="laser", time_s=1.0, lasts_s=1.0)
    seen = instants(members(0.5), breakdowns=[broken])
    lost = [now.step for now in seen if now.scans[0] is not None and np.isnan(now.scans[0].ranges[1]).all()]
    assert lost == [15, 17, 19, 21, 23]


def test_a_second_run_after_a_reset_and_commands_from_outside():
    some = members(0.5)
    with Simulation(Setting(some, NO_WALLS, DT, 20)) as simulation:
        first = [now.traffic.x.tolist() for now in simulation]
        simulation.reset()
        again = [simulation.now.traffic.x.tolist()] + [simulation.step().traffic.x.tolist() for _ in range(20)]
        assert first == again
        simulation.reset()
        for _ in range(20):
            now = simulation.step({"robot.1": Twist(0.0, 0.0)})
        assert now.traffic.x[1] - again[0][1] < 0.05
        assert now.traffic.x[2] == again[20][2]


def test_scans_are_recorded_by_the_time_at_which_they_were_taken(tmp_path):
    some = members(0.5)
    some[0] = replace(some[0], lidar=replace(EYE, rate=10.0))
    recorder, x = ScanRecorder(tmp_path), {}
    with Simulation(Setting(some, NO_WALLS, DT, 30)) as simulation:
        for now in simulation:
            recorder.record(now, 1)
            x |= {(m.id, now.step): value for m, value in zip(now.fleet.members, now.traffic.x, strict=True)}
    recorder.close()
    with np.load(tmp_path / "scans.npz", allow_pickle=False) as archive:
        scans = dict(archive)
    names, steps = scans["vehicle_id"][scans["vehicle"]], np.rint(scans["time_s"] / DT).astype(int)
    assert (np.diff(steps) >= 0).all()
    assert steps[names == "robot.0"].tolist() == list(range(31))
    assert steps[names == "robot.1"].tolist() == list(range(0, 26, 2))
    assert scans["x_m"] == pytest.approx([x[name, step] for name, step in zip(names, steps, strict=True)])
    assert dict(zip(scans["vehicle_id"], scans["delay_s"], strict=True)) == {
        "robot.0": 0,
        "robot.1": 0.5,
        "robot.2": 0.5,
    }
