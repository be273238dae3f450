"""Platoons that depart later, wait for room, and arrive."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import libsumo
import numpy as np
import pandas as pd
import pytest
import shapely

from platoontraffic import scenario, simulation
from platoontraffic.errors import InputError
from platoontraffic.simulation import Simulation
from platoontraffic.vehicles.catalogue import VEHICLES
from tests.support import ODD_NETS
from tests.support.runs import run

CROSS = ODD_NETS / "cross.net.xml"
LENGTH, WIDTH = VEHICLES["car"].length, VEHICLES["car"].width
EYE = '{ preset = "car-follower", fov_deg = 16.0 }'
FOLLOWER = f'{{ law = "repaired", stand_off_m = 4.0, group_step_m = 1.0, lidar = {EYE} }}'
PATH = '{ law = "path", speed_mps = 8.0, lidar = "car-leader" }'
SUMO = '{ law = "sumo", max_speed_mps = 8.0 }'
END = 492.8  # length of the arms of the cross [m]
EAST = 'route = ["west_in", "east_out"]'

pytestmark = pytest.mark.sumo


def platoon(
    name: str,
    start: str,
    leader: str = PATH,
    size: int = 1,
    route: str = EAST,
    follower: str = FOLLOWER,
    gap: float = 6.0,
) -> str:
    behind = f"follower = {follower}" if size > 1 else ""
    return f"""
[[platoon]]
id = "{name}"
size = {size}
vehicle = {{ type = "car", response_s = 0.2, lag_s = 0.1 }}
gap_m = {gap}
start = {{ {start} }}
{route}
leader = {leader}
{behind}
"""


@pytest.fixture
def written(tmp_path) -> Callable[..., Path]:
    def write(*platoons: str, duration: float = 20.0, net: str | Path = CROSS, name: str = "mine") -> Path:
        file = tmp_path / f"{name}.toml"
        sumo = f'[sumo]\nnet = "{net}"\ntraffic = false\n[scene]\nwalls = "none"\n'
        file.write_text(f"{sumo}[run]\nstep_s = 0.1\nduration_s = {duration}\n" + "".join(platoons))
        return file

    return write


@pytest.fixture
def tables(tmp_path, written) -> Callable[..., tuple[pd.DataFrame, pd.DataFrame]]:
    """Runs platoons, and returns their trajectories and events."""

    def play(*platoons: str, name: str = "mine", changes=(), **options) -> tuple[pd.DataFrame, pd.DataFrame]:
        folder = run(tmp_path / name, written(*platoons, name=name, **options), *changes)
        return pd.read_csv(folder / "trajectories.csv"), pd.read_csv(folder / "events.csv")

    return play


def of(table: pd.DataFrame, vehicle: str) -> pd.DataFrame:
    return table[table.vehicle_id == vehicle].reset_index(drop=True)


def events(table: pd.DataFrame, kind: str) -> dict[str, float]:
    """Time of the event by vehicle."""
    some = table[table.kind == kind]
    return dict(zip(some.vehicle_id, some.time_s, strict=True))


def ending(table: pd.DataFrame) -> tuple[float, str]:
    (row,) = table[table.kind == "end"].itertuples()
    return row.time_s, row.detail


def clearance(table: pd.DataFrame, one: str, other: str) -> pd.Series:
    """Distance between two footprints [m] at the times at which both are on the road."""
    both = of(table, one).merge(of(table, other), on="time_s")
    box = shapely.box(-LENGTH / 2, -WIDTH / 2, LENGTH / 2, WIDTH / 2)

    def footprint(x: float, y: float, heading: float) -> shapely.Polygon:
        turned = shapely.affinity.rotate(box, heading, origin=(0, 0), use_radians=True)
        return shapely.affinity.translate(turned, x, y)

    columns = [[f"{name}_{side}" for name in ("x_m", "y_m", "heading_rad")] for side in "xy"]
    ones, others = ([footprint(*row) for row in both[names].to_numpy()] for names in columns)
    return pd.Series(shapely.distance(ones, others), index=both.time_s)


# ---- departures


@pytest.mark.parametrize("leader", [PATH, SUMO], ids=["path", "sumo"])
@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_a_platoon_departs_at_its_time_place_and_speed(tables, leader, speed):
    here = platoon("a", 'edge = "north_in", position_m = 50', route='to = "south_out"')
    start = f'edge = "west_in", position_m = 100, time_s = 2.3, speed_mps = {speed}'
    rows, noted = tables(here, platoon("b", start, leader, size=3), duration=4.0)
    for place in range(3):
        member = of(rows, f"b.{place}")
        assert member.time_s[0] == 2.3
        np.testing.assert_allclose(np.diff(member.time_s), 0.1, atol=1e-9)
        assert member.x_m[0] == pytest.approx(100 - LENGTH / 2 - place * (LENGTH + 6.0), abs=1e-6)
        assert (member.y_m[0], member.heading_rad[0]) == pytest.approx((-4.8, 0), abs=1e-6)
        assert member.speed_mps[0] == pytest.approx(speed, abs=1e-9)
    assert of(rows, "a.0").time_s[0] == 0
    assert events(noted, "departed") == {"a.0": 0.0, "b.0": 2.3, "b.1": 2.3, "b.2": 2.3}
    assert of(rows, "b.1").gap_m[0] == pytest.approx(6.0, abs=1e-6)


def test_a_run_may_begin_without_members(tables):
    rows, noted = tables(platoon("a", 'edge = "west_in", position_m = 100, time_s = 1.0'), duration=2.0)
    assert rows.time_s.min() == 1.0
    assert events(noted, "departed") == {"a.0": 1.0}
    assert ending(noted) == (2.0, "duration")


def test_a_platoon_that_departs_later_drives_as_one_that_departs_at_once(tables):
    start = 'edge = "west_in", position_m = 100'
    (one, _), (other, _) = (
        tables(platoon("a", start + later, size=3), duration=duration, name=name)
        for later, duration, name in (("", 10.0, "first"), (", time_s = 5.0", 15.0, "second"))
    )
    assert len(one) == len(other)
    same = ["vehicle_id", "x_m", "y_m", "speed_mps", "gap_m"]
    pd.testing.assert_frame_equal(one[same], other[same], rtol=0, atol=0.05)  # each scan has its own noise


# ---- waiting for room


def standing(tmp_path: Path, seconds: float) -> str:
    """A leader that stands for some time and then drives."""
    (tmp_path / "stands.csv").write_text(f"time_s,speed_mps\n0,0\n{seconds},0\n{seconds + 4},8\n")
    return '{ law = "path", trace = "stands.csv", lidar = "car-leader" }'


def test_a_platoon_departs_once_another_has_left_its_place(tables, tmp_path):
    place = 'edge = "west_in", position_m = 100'
    first = platoon("a", place, standing(tmp_path, 4.0))
    rows, noted = tables(first, platoon("b", place + ", time_s = 2.0", size=2), duration=12.0)
    came = events(noted, "departed")["b.0"]
    assert 4.0 < came < 10.0
    assert events(noted, "departed")["b.1"] == came == of(rows, "b.0").time_s[0]
    assert of(rows, "b.0").x_m[0] == pytest.approx(100 - LENGTH / 2)
    there = clearance(rows, "a.0", "b.0")
    assert there.iloc[0] >= LENGTH  # as much room as its own length
    a = of(rows, "a.0").set_index("time_s").x_m
    a.index = a.index.round(3)
    assert a[round(came - 0.2, 3)] - 100 - LENGTH / 2 < LENGTH  # not yet, two steps before
    assert there.min() > 2.0
    assert "collision" not in set(noted.kind)


def test_a_platoon_never_departs_while_another_stands_in_its_place(tables, tmp_path):
    place = 'edge = "west_in", position_m = 100'
    first = platoon("a", place, standing(tmp_path, 100.0))
    rows, noted = tables(first, platoon("b", place + ", time_s = 2.0", size=2), duration=6.0)
    assert set(rows.vehicle_id) == {"a.0"}
    assert events(noted, "departed") == {"a.0": 0.0}
    assert events(noted, "never_departed") == {"b.0": 6.0, "b.1": 6.0}
    assert ending(noted) == (6.0, "duration")


def test_platoons_that_wait_for_one_place_depart_one_at_a_time(tables, tmp_path):
    place = 'edge = "west_in", position_m = 100'
    waiting = (platoon(name, f"{place}, time_s = {time}") for name, time in (("b", 2.0), ("c", 2.5), ("d", 3.0)))
    rows, noted = tables(platoon("a", place, standing(tmp_path, 4.0)), *waiting, duration=20.0)
    came = events(noted, "departed")
    assert came["a.0"] < came["b.0"] < came["c.0"] < came["d.0"]
    assert "collision" not in set(noted.kind)
    for one, other in (("a.0", "b.0"), ("b.0", "c.0"), ("c.0", "d.0")):
        assert clearance(rows, one, other).min() > 2.0


def test_a_platoon_that_waits_does_not_delay_one_elsewhere(tables, tmp_path):
    place = 'edge = "west_in", position_m = 100'
    blocked = platoon("b", place + ", time_s = 1.0")
    free = platoon("c", 'edge = "east_in", position_m = 100, time_s = 2.0', route='to = "west_out"')
    _, noted = tables(platoon("a", place, standing(tmp_path, 100.0)), blocked, free, duration=3.0)
    assert events(noted, "departed") == {"a.0": 0.0, "c.0": 2.0}


def test_a_vehicle_on_the_adjacent_lane_does_not_delay_a_departure(tables, tmp_path):
    place = 'edge = "west_in", position_m = 100'
    other = platoon("b", place + ", lane = 1, time_s = 1.0", route='route = ["west_in", "east_out"]')
    _, noted = tables(platoon("a", place, standing(tmp_path, 100.0)), other, duration=2.0)
    assert events(noted, "departed") == {"a.0": 0.0, "b.0": 1.0}


def test_a_platoon_does_not_depart_around_another_vehicle(tables, tmp_path):
    """The other vehicle stands in the 30 m between two members, out of the clearance of both."""
    stands = platoon("a", 'edge = "west_in", position_m = 83', standing(tmp_path, 100.0))
    pair = platoon("b", 'edge = "west_in", position_m = 100, time_s = 1.0', size=2, gap=30.0)
    _, noted = tables(stands, pair, duration=3.0)
    assert events(noted, "departed") == {"a.0": 0.0}


@pytest.mark.parametrize("leader", [PATH, SUMO.replace("8.0", "30.0")], ids=["path", "sumo"])
def test_a_platoon_does_not_depart_too_fast_to_stop_behind_another(tables, tmp_path, leader):
    """The other platoon stands 11 m ahead; braking from 13 m/s takes 19 m, from 3 m/s 1 m."""
    stands = platoon("a", 'edge = "west_in", position_m = 120', standing(tmp_path, 100.0))
    start = 'edge = "west_in", position_m = 104, time_s = 1.0, speed_mps = '
    _, noted = tables(stands, platoon("b", start + "13.0", leader), duration=5.0, name="fast")
    assert "b.0" not in events(noted, "departed")
    _, noted = tables(stands, platoon("b", start + "3.0", leader), duration=5.0, name="slow")
    assert events(noted, "departed")["b.0"] == 1.0
    assert "collision" not in set(noted.kind)


# ---- refused departures


def faults(file: Path) -> tuple[str, ...]:
    with pytest.raises(InputError) as error:
        simulation.prepare(scenario.load(file))
    return error.value.faults


def test_two_platoons_at_one_place_are_refused_only_at_one_time(written):
    place = 'edge = "west_in", position_m = 100, time_s = '
    (fault,) = faults(written(platoon("a", place + "3.0"), platoon("b", place + "3.0")))
    assert fault.endswith("platoon.1.start: b.0 would start on a.0")
    simulation.prepare(scenario.load(written(platoon("a", place + "3.0"), platoon("b", place + "3.1"))))


@pytest.mark.parametrize(
    ("time", "said"),
    [
        (2.05, "2.05: must be a multiple of run.step_s = 0.1"),
        (0.01, "0.01: must be a multiple of run.step_s = 0.1"),
        (20.0, "20: must be before the end, run.duration_s = 20"),
        (1e6, "1e+06: must be before the end, run.duration_s = 20"),
        (-1.0, "-1.0: should be greater than or equal to 0"),
        ("nan", "nan: should be"),
    ],
)
def test_times_of_departure_that_no_step_has_are_refused(written, time, said):
    (fault,) = faults(written(platoon("a", f'edge = "west_in", position_m = 100, time_s = {time}')))
    assert f"mine.toml:15: platoon.0.start.time_s: {said}" in fault


@pytest.mark.parametrize(("leader", "speed"), [(PATH, 60.0), (SUMO, 20.0)], ids=["path", "sumo"])
def test_a_departure_faster_than_the_vehicle_or_the_limit_is_refused(written, leader, speed):
    """SUMO would end the run at that moment. A moved car may drive 55 m/s, a SUMO-driven one the limit of 13.9 m/s."""
    start = f'edge = "west_in", position_m = 100, time_s = 5.0, speed_mps = {speed}'
    (fault,) = faults(written(platoon("a", start, leader)))
    assert "mine.toml:15: platoon.0.start" in fault
    assert f"{speed:g}" in fault


def test_a_sumo_driven_follower_must_start_on_the_edge_of_its_leader(written):
    """SUMO inserts it there; a moved one may start anywhere."""
    (fault,) = faults(written(platoon("a", 'edge = "west_in", position_m = 7', size=2, follower=SUMO)))
    assert "platoon.0.start: position_m 7: SUMO inserts the follower on this edge; must be from 7.24" in fault


# ---- arrivals


@pytest.mark.parametrize("leader", [PATH, SUMO], ids=["path", "sumo"])
def test_a_platoon_arrives_with_its_leader_and_the_run_ends(tables, leader):
    start = 'edge = "east_out", position_m = 460, speed_mps = 8.0'
    rows, noted = tables(platoon("a", start, leader, size=3), duration=20.0)
    came = events(noted, "arrived")
    (time,) = set(came.values())
    assert set(came) == {"a.0", "a.1", "a.2"}
    assert ending(noted) == (time, "arrived")
    front = of(rows, "a.0").x_m.iloc[-1] + LENGTH / 2
    assert 1000 - 2 * 8.0 * 0.1 - 0.1 <= front <= 1000 + 1e-6
    last = [of(rows, name).time_s.iloc[-1] for name in came]
    assert last == pytest.approx([time - 0.1] * 3)
    where = noted[noted.kind == "arrived"].set_index("vehicle_id").x_m
    for name in came:
        assert where[name] == pytest.approx(of(rows, name).x_m.iloc[-1])


def test_a_run_ends_when_the_last_platoon_has_departed_and_arrived(tables):
    first = platoon("a", 'edge = "east_out", position_m = 480, speed_mps = 8.0')
    later = platoon("b", 'edge = "north_out", position_m = 270, time_s = 6.0', route='route = ["north_out"]')
    rows, noted = tables(first, later, duration=30.0)
    arrived = events(noted, "arrived")
    assert arrived["a.0"] < 3.0 < 6.0 < arrived["b.0"]
    assert ending(noted) == (arrived["b.0"], "arrived")
    assert not len(rows[(rows.time_s > arrived["a.0"]) & (rows.time_s < 6.0)])


def test_laps_are_not_complete_before_all_platoons_have_departed(tables):
    lap = 'route = ["east_north", "north_west", "west_south", "south_east"]\nloop = true'
    first = platoon("a", 'edge = "east_north", position_m = 80, speed_mps = 8.0', route=lap)
    later = platoon("b", 'edge = "west_south", position_m = 80, speed_mps = 8.0, time_s = 8.0', route=lap)
    _, noted = tables(first, later, changes=["run.laps=0.05"], duration=30.0, net="ring")
    assert "b.0" in events(noted, "departed")
    time, why = ending(noted)
    assert (why, time) == ("laps", pytest.approx(8.0 + 0.05 * 2 * np.pi * 159 / 8.0, abs=1.0))


@pytest.mark.parametrize("leader", [PATH, SUMO], ids=["path", "sumo"])
def test_a_member_that_has_arrived_is_removed_from_sumo(written, leader):
    """Another platoon, which stays, keeps the simulation going."""
    arrives = platoon("a", 'edge = "east_out", position_m = 460, speed_mps = 8.0', leader, size=3)
    stays = platoon("z", 'edge = "north_in", position_m = 50', route='to = "south_out"')
    there: list[tuple[set[str], set[str]]] = []
    with Simulation.load(written(arrives, stays, duration=8.0)) as simulation:
        for now in simulation:
            there.append(({m.id for m in now.fleet.members}, set(libsumo.vehicle.getIDList())))
    assert there[0] == ({"a.0", "a.1", "a.2", "z.0"},) * 2
    gone = [members for members, _ in there].index({"z.0"})
    assert all(members == ids for members, ids in there[:gone])
    assert all(members == ids == {"z.0"} for members, ids in there[gone + 1 :])
    assert gone < len(there) - 10


@pytest.mark.parametrize("of_a", [PATH, SUMO], ids=["path", "sumo"])
def test_departures_and_arrivals_do_not_change_other_platoons(tables, of_a, tmp_path):
    """A platoon that shares law and lidar with one that arrives, and with one that departs, far off on the ring."""
    start = 'edge = "west_south", position_m = 100, speed_mps = 5.0'
    stays = platoon(
        "z", start, size=3, route='route = ["east_north", "north_west", "west_south", "south_east"]\nloop = true'
    )
    goes = platoon("a", 'edge = "east_north", position_m = 200', of_a, size=2, route='route = ["east_north"]')
    comes = platoon("c", 'edge = "east_north", position_m = 50, time_s = 4.0', size=2, route='to = "north_west"')
    for name, platoons in (("alone", [stays]), ("among", [goes, stays, comes])):
        _, noted = tables(*platoons, duration=12.0, net="ring", name=name)
    assert {"a.0", "a.1"} == set(events(noted, "arrived"))
    assert events(noted, "departed")["c.0"] == 4.0
    alone, among = (
        [row for row in (tmp_path / name / "trajectories.csv").read_bytes().splitlines() if b",z," in row]
        for name in ("alone", "among")
    )
    assert len(alone) == 3 * 121
    assert among == alone
