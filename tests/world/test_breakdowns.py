"""Breakdowns of drives and lasers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario
from platoontraffic.errors import InputError
from platoontraffic.scenario import Breakdown
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.motion import Command, Drive, Motion, Twist
from platoontraffic.world.breakdowns import Breakdowns
from platoontraffic.world.fleet import Fleet
from tests.support.bench import BLIND, constant, platoon
from tests.support.runs import run

CAR = """
[sumo]
net = "corridor"
traffic = false
[scene]
walls = "none"
[run]
duration_s = {seconds}
step_s = 0.1
[[platoon]]
size = 4
gap_m = 10.0
vehicle = "car"
start = {{ edge = "light_prio", position_m = 70.0, speed_mps = 10.0 }}
to = "b2_east"
leader = {{ {leader} }}
follower = {{ law = "tracking", policy = "obey", on_loss = "{on_loss}" }}
[[breakdown]]
{breakdown}
"""
PATH = 'law = "path", speed_mps = 10.0, lidar = "car-leader"'


def written(folder, breakdown: str, seconds: float = 60.0, leader: str = PATH, on_loss: str = "drive"):
    file = folder / "breakdown.toml"
    file.write_text(CAR.format(seconds=seconds, leader=leader, on_loss=on_loss, breakdown=breakdown), encoding="utf-8")
    return file


def results(tmp_path, *given, **more) -> tuple[pd.DataFrame, pd.DataFrame]:
    folder = run(tmp_path / "run", written(tmp_path, *given, **more))
    events, rows = (pd.read_csv(folder / f"{name}.csv") for name in ("events", "trajectories"))
    assert not events.kind.isin(["collision", "near_miss", "off_road"]).any()
    return events, rows


def test_a_broken_drive_brakes_at_least_as_hard_as_commanded_and_keeps_its_curvature():
    """Two robots commanded by a twist, the second at rest; cars that accelerate, brake, stand, and roll backwards."""
    command = Command(
        Twist(np.array([0.001, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([0.3, 0.3, 0.0, 0.0, 0.0, 0.0])),
        Drive(np.array([np.nan, np.nan, 1.0, -6.0, -1.0, -1.0]), np.array([np.nan, np.nan, 0.01, 0.02, 0.03, 0.0])),
    )
    motion = replace(
        Motion.at_rest(*np.zeros((3, 6))),
        speed=np.array([0.4, 0.0, 10.0, 10.0, 0.0, -0.05]),
        yaw_rate=np.array([0.2, 0.3, 0.1, 0.2, 0.0, 0.0]),
    )
    braked = command.braked(np.full(6, 2.0), motion, 0.1).drive
    np.testing.assert_allclose(braked.acceleration, [-2.0, 0.0, -2.0, -6.0, 0.0, 0.5])
    np.testing.assert_allclose(braked.curvature, [0.5, 0.0, 0.01, 0.02, 0.03, 0.0])
    as_before = command.braked(np.full(6, np.nan), motion, 0.1).drive
    np.testing.assert_array_equal(as_before.acceleration, command.drive.acceleration)
    np.testing.assert_array_equal(as_before.curvature, command.drive.curvature)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_robot_rolls_v_squared_over_two_a_forwards_or_backwards_and_stands(sign):
    fleet = Fleet.deployed(platoon(constant(sign * 0.4)), 0.01)
    fleet = replace(fleet, motion=replace(fleet.motion, speed=np.array([sign * 0.4])))
    breakdowns = Breakdowns([Breakdown(vehicle="robot.0", what="drive", time_s=0.0, rate_mps2=0.5)])
    breakdowns.due(fleet, 0.0)
    for _ in range(200):
        fleet = fleet.moved(0.01, breakdowns.brakes(fleet))
    assert fleet.motion.speed[0] == 0.0
    assert fleet.motion.x[0] == pytest.approx(sign * (0.4**2 / (2 * 0.5) - 0.4 * 0.01 / 2))


def test_breakdowns_and_repairs_are_noted_once_and_only_of_members_on_the_road():
    fleet = Fleet.deployed(platoon(constant(0.0), constant(0.0), 1, eye=BLIND), 0.1)
    one = Breakdown(vehicle="robot.1", what="laser", time_s=1.0, lasts_s=0.5)
    breakdowns = Breakdowns([one, Breakdown(vehicle="other.0", what="drive", time_s=0.0)])
    noted = {round(k * 0.1, 1): breakdowns.due(fleet, k * 0.1) for k in range(30)}
    assert {time: [(n.row, n.kind, n.what) for n in news] for time, news in noted.items() if news} == {
        1.0: [(1, "breaks_down", "laser")],
        1.5: [(1, "repaired", "laser")],
    }
    assert noted[1.5][0].duration == pytest.approx(0.5)
    assert breakdowns.brakes(fleet) is None
    anew = Breakdowns([one])
    anew.due(fleet, 1.2)
    assert anew.due(fleet.without({"robot.1"}), 1.3) == []
    assert [n.kind for n in anew.due(fleet, 1.4)] == ["breaks_down"]


@pytest.mark.sumo
def test_followers_of_a_broken_car_stand_behind_it_and_go_on_after_its_repair(tmp_path):
    events, rows = results(tmp_path, 'vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 10.0\nlasts_s = 20.0', 70.0)
    own = {name: of for name, of in rows.groupby("vehicle_id")}
    broken = own["platoon.1"]
    at, speed = broken[broken.time_s == 10.0].x_m.item(), broken[broken.time_s == 10.0].speed_mps.item()
    stood = broken[broken.time_s.between(20.0, 30.0)]
    assert (stood.speed_mps == 0).all()
    lag = CARS["car"].brake_lag
    assert stood.x_m.iloc[0] - at == pytest.approx(speed**2 / (2 * 2.0) + lag * speed, abs=0.05)
    behind = own["platoon.2"][own["platoon.2"].time_s.between(22.0, 30.0)]
    assert (behind.speed_mps < 0.05).all()
    assert behind.gap_m.between(2.5, 3.6).all()
    split = events[events.kind == "split"]
    assert split[["vehicle_id", "what"]].values.tolist() == [["platoon.1", "broken"]]
    repaired = events[events.kind == "repaired"]
    assert repaired[["time_s", "vehicle_id", "duration_s", "what"]].values.tolist() == [
        [30.0, "platoon.1", 20.0, "drive"]
    ]
    assert (own["platoon.3"].set_index("time_s").speed_mps.loc[50.0:60.0] > 5.0).all()


@pytest.mark.sumo
@pytest.mark.parametrize("on_loss", ["stop", "drive"])
@pytest.mark.parametrize("vehicle", ["platoon.0", "platoon.2"])
def test_a_member_without_laser_stops_until_the_repair(tmp_path, vehicle, on_loss):
    _, rows = results(
        tmp_path, f'vehicle = "{vehicle}"\nwhat = "laser"\ntime_s = 5.0\nlasts_s = 15.0', 30.0, on_loss=on_loss
    )
    own = rows[rows.vehicle_id == vehicle].set_index("time_s")
    assert (own.speed_mps.loc[15.0:20.0] == 0).all()
    assert own.accel_mps2.min() > -3.6
    beams = own.beams_on_predecessor.loc[5.5:19.5]
    assert ((beams == 0) | beams.isna()).all()
    drives_on = vehicle == "platoon.0" or on_loss == "drive"
    assert (own.speed_mps.loc[25.0:].max() > 5.0) == drives_on


@pytest.mark.sumo
def test_a_sumo_driven_leader_can_break_down(tmp_path):
    events, rows = results(
        tmp_path,
        'vehicle = "platoon.0"\nwhat = "drive"\ntime_s = 10.0\nlasts_s = 20.0\nrate_mps2 = 1.0',
        50.0,
        'law = "sumo", max_speed_mps = 10.0',
    )
    own = rows[rows.vehicle_id == "platoon.0"].set_index("time_s")
    assert own.accel_mps2.loc[10.5:18.0].median() == pytest.approx(-1.0)
    assert (own.speed_mps.loc[21.0:30.0] == 0).all()
    assert own.speed_mps.loc[40.0] > 5.0
    assert (events.kind == "arrived").sum() == 0


@pytest.mark.parametrize(
    ("breakdown", "leader", "said"),
    [
        (
            'vehicle = "platoon.9"\nwhat = "drive"\ntime_s = 1.0',
            PATH,
            "'platoon.9': no such member; did you mean",
        ),
        ('vehicle = "platoon.1"\nwhat = "engine"\ntime_s = 1.0', PATH, "what"),
        (
            'vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 60.0',
            PATH,
            "60: must be before the end, run.duration_s",
        ),
        ('vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 1.0\nlasts_s = 0.0', PATH, "lasts_s"),
        ('vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 1.0\nrate_mps2 = 0.0', PATH, "rate_mps2"),
        (
            'vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 1.0\nlasts_s = 0.05',
            PATH,
            "lasts_s: 0.05: must be at least",
        ),
        (
            'vehicle = "platoon.0"\nwhat = "laser"\ntime_s = 1.0',
            'law = "sumo"',
            "platoon.0 has none, because SUMO",
        ),
    ],
)
def test_an_impossible_breakdown_is_a_fault_with_its_line(tmp_path, breakdown, leader, said):
    with pytest.raises(InputError) as error:
        scenario.load(written(tmp_path, breakdown, leader=leader))
    (fault,) = error.value.faults
    assert said in fault
    assert "breakdown.0" in fault
    assert fault.startswith(f"{tmp_path / 'breakdown.toml'}:")


def test_a_broken_part_cannot_break_again_before_its_repair(tmp_path):
    again = 'vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 5.0\nlasts_s = 5.0\n'
    text = again + "[[breakdown]]\n" + again.replace("time_s = 5.0", "time_s = 9.0")
    with pytest.raises(InputError, match=r"breakdown\.1\.time_s: 9: breakdown\.0 breaks the same drive until 10"):
        scenario.load(written(tmp_path, text))
    scenario.load(written(tmp_path, text.replace("9.0", "11.0")))
    scenario.load(written(tmp_path, text.replace('"drive"', '"laser"', 1)))


@pytest.mark.sumo
def test_a_broken_drive_is_a_cause_despite_the_repair_of_the_laser(tmp_path):
    events, _ = results(
        tmp_path,
        'vehicle = "platoon.1"\nwhat = "drive"\ntime_s = 10.0\n[[breakdown]]\n'
        'vehicle = "platoon.1"\nwhat = "laser"\ntime_s = 11.0\nlasts_s = 2.0',
        40.0,
    )
    split = events[(events.kind == "split") & (events.vehicle_id == "platoon.1")]
    assert split.what.item() == "broken"
    stands = events[(events.kind == "standstill") & (events.vehicle_id == "platoon.1")]
    assert stands.what.tolist() == ["broken"]
    assert stands.detail.item().endswith(", its drive is broken")
