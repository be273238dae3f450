"""Background traffic beside the platoons: from shipped networks, route files and configurations."""

from __future__ import annotations

import filecmp
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario, shipped, simulation
from platoontraffic.errors import InputError
from platoontraffic.recording import run as run_into
from platoontraffic.road.sumo_configuration import read_configuration
from tests.support import ODD_NETS

pytestmark = pytest.mark.sumo

RING = shipped.networks()["ring"].parent
EDGES = re.findall(r'<edge id="([^":]+)"', (RING / "ring.edg.xml").read_text())

ROAD = """
[scene]
walls = "none"

[run]
step_s = 0.1
duration_s = {duration}

[[platoon]]
id = "laser"
start = {{ edge = "{edge}", position_m = 50.0 }}
route = [{route}]
loop = true
vehicle = {{ length_m = 4.5, width_m = 1.8, axle_m = -1.3, wheel_separation_m = 1.5, wheel_radius_m = 0.3 }}

[platoon.leader]
law = "path"
speed_mps = {speed}
lidar = {{ preset = "car-leader", rate_hz = 10.0 }}
"""


def write(folder: Path, sumo: str, duration: float = 5.0, speed: float = 10.0, edges=EDGES) -> Path:
    route = ", ".join(f'"{edge}"' for edge in edges)
    road = ROAD.format(duration=duration, edge=edges[0], route=route, speed=speed)
    road = road if edges is EDGES else road.replace("loop = true\n", "")
    file = folder / "traffic.toml"
    file.write_text(f"[sumo]\n{sumo}\n{road}", encoding="utf-8")
    return file


def run(file: Path, to: Path, *changes: str) -> tuple[Path, list]:
    """The folder of a run, and its snapshots."""
    prepared = simulation.prepare(scenario.load(file, changes))
    return run_into(prepared, to)


@pytest.fixture
def configuration(tmp_path) -> Path:
    """A user's folder: a configuration that asks for outputs, and a detector that writes beside its own file."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    for name in ("ring.net.xml", "ring.rou.xml"):
        (folder / name).write_bytes((RING / name).read_bytes())
    lane = f"{EDGES[0]}_0"
    (folder / "counters.add.xml").write_text(
        f'<additional><e1Detector id="d" lane="{lane}" pos="10" freq="1" file="counted.xml"/></additional>'
    )
    (folder / "all.sumocfg").write_text(
        "<configuration><input><net-file value='ring.net.xml'/><route-files value='ring.rou.xml'/>"
        "<additional-files value='counters.add.xml'/></input>"
        "<output><tripinfo-output value='trips.xml'/></output><time><begin value='100'/></time>"
        "<gui_only><start value='true'/></gui_only></configuration>"
    )
    return folder


def test_a_configuration_runs_and_no_file_is_written_beside_it(configuration, tmp_path):
    before = {file.name: file.read_bytes() for file in configuration.iterdir()}
    folder = run(write(tmp_path, 'config = "theirs/all.sumocfg"\nwarm_up_s = 20.0'), tmp_path / "one")
    assert {file.name: file.read_bytes() for file in configuration.iterdir()} == before
    assert (folder / "sumo_trips.xml").stat().st_size > 0
    assert (folder / "sumo_counted.xml").stat().st_size > 0
    rows = pd.read_csv(folder / "trajectories.csv")
    assert rows.time_s.iloc[0] == 0  # whatever time SUMO had
    again = run(folder / "config.toml", tmp_path / "two")
    assert filecmp.cmp(folder / "trajectories.csv", again / "trajectories.csv", shallow=False)


def test_a_shipped_network_brings_its_traffic_unless_the_scenario_says_otherwise(tmp_path):
    ours = 'net = "ring"\nwarm_up_s = 60.0'
    with_traffic = scenario.load(write(tmp_path, ours))
    assert [file.name for file in with_traffic.route_files] == ["ring.rou.xml"]
    without = scenario.load(write(tmp_path, ours + "\ntraffic = false"))
    assert without.route_files == ()
    assert [file.name for file in without.additional] == ["ring.poly.xml"]


def test_traffic_stops_behind_a_standing_robot_that_has_room_at_the_start(tmp_path, monkeypatch):
    snapshots = []
    read = simulation.World.snapshot

    def snapshot(world, fleet, reach=np.inf):
        snapshots.append(read(world, fleet))
        return snapshots[-1]

    monkeypatch.setattr(simulation.World, "snapshot", snapshot)
    one_lane = write(tmp_path, 'net = "corridor"\nwarm_up_s = 60.0', duration=60.0, speed=0.01, edges=["west_light"])
    run(one_lane, tmp_path / "one")
    first, last = snapshots[1], snapshots[-1]  # the very first is taken to make room
    assert len(first.ids) > 5
    gaps = np.hypot(first.x[1:] - first.x[0], first.y[1:] - first.y[0]) - (first.length[1:] + first.length[0]) / 2
    assert gaps.min() > 0
    # One vehicle waits right behind, at SUMO's minimum gap; none has driven through the robot.
    gap = (last.x[0] - last.length[0] / 2) - (last.x[1:] + last.length[1:] / 2)
    behind = (np.abs(last.y[1:] - last.y[0]) < 1) & (gap > 0)
    assert 1.5 < gap[behind].min() < 3.5
    assert last.speed[1:][behind][gap[behind].argmin()] < 0.1
    contacts = pd.read_csv(tmp_path / "one" / "events.csv").query("kind == 'collision'")
    assert contacts.empty


def test_each_step_reads_all_vehicles_in_range_of_a_member_and_not_all_others(tmp_path, monkeypatch):
    read, left_out = simulation.World.snapshot, []

    def snapshot(world, fleet, reach=np.inf):
        some, everything = read(world, fleet, reach), read(world, fleet)
        away = np.hypot(everything.x - everything.x[0], everything.y - everything.y[0]) - everything.length / 2
        near = [name for name, far in zip(everything.ids, away > reach, strict=True) if not far]
        assert set(near) <= set(some.ids)
        assert list(some.ids) == [name for name in everything.ids if name in some.ids]
        left_out.append(len(everything.ids) - len(some.ids))
        return some

    monkeypatch.setattr(simulation.World, "snapshot", snapshot)
    run(write(tmp_path, 'net = "corridor"\nwarm_up_s = 120.0', 20.0, edges=["west_light"]), tmp_path / "one")
    assert max(left_out) > 5


@pytest.mark.parametrize(
    ("sumo", "said"),
    [
        ('net = "ring"\nconfig = "a.sumocfg"', "sumo: must have either `net` or `config`"),
        ("traffic = true", "sumo: must have either `net` or `config`"),
        ('config = "nowhere.sumocfg"', "sumo.config: {}/nowhere.sumocfg: no such file; must be a SUMO configuration"),
        ('net = "ring"\nroutes = ["nowhere.rou.xml"]', "sumo.routes.0: 'nowhere.rou.xml': no such file"),
        ('net = "ring"\nwarm_up_s = -1.0', "sumo.warm_up_s: -1.0: should be greater than or equal to 0"),
        ('net = "ring"\nwarm_up_s = 0.25', "sumo.warm_up_s: 0.25: must be a multiple of run.step_s = 0.1"),
    ],
)
def test_faults_in_the_table_sumo_are_named(tmp_path, sumo, said):
    with pytest.raises(InputError) as caught:
        scenario.load(write(tmp_path, sumo))
    assert any(said.format(tmp_path) in fault for fault in caught.value.faults), caught.value.faults


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<net/>", ":1: root element is <net>, a network; must be a SUMO configuration"),
        ("<net/>", "; `prove` and `nets check` take a network, the key sumo.net of a scenario names one"),
        ("<configuration>", "not whole XML"),
        ("<configuration/>", ":1: names no network; must name one, as <net-file>"),
        ("<configuration><net-file value='x.net.xml'/></configuration>", ":1: <net-file>: 'x.net.xml': no such file"),
    ],
)
def test_faults_in_a_configuration_are_named(tmp_path, text, said):
    file = tmp_path / "faulty.sumocfg"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_configuration(file)
    assert f"{file}" in str(caught.value)
    assert said in str(caught.value)


def test_routes_that_sumo_refuses_are_reported_in_its_words(tmp_path):
    route = '<route edges="nowhere"/>'
    (tmp_path / "bad.rou.xml").write_text(f'<routes><vehicle id="v" depart="0">{route}</vehicle></routes>')
    with pytest.raises(InputError, match="nowhere"):
        run(write(tmp_path, 'net = "ring"\ntraffic = false\nroutes = ["bad.rou.xml"]'), tmp_path / "one")


def test_a_leader_takes_the_fastest_route_to_a_named_edge(tmp_path):
    file = write(tmp_path, 'net = "corridor"', edges=["west_light"])
    text = file.read_text().replace('route = ["west_light"]', 'to = "b2_east"')
    file.write_text(text)
    (leader,) = simulation.prepare(scenario.load(file)).members
    assert (leader.route.edges[0], leader.route.edges[-1]) == ("west_light", "b2_east")
    assert leader.route.length > 1500  # along the whole of the corridor
    for to, said in (("nowhere", "no edge 'nowhere' in"), ("", "should have at least 1 character")):
        file.write_text(text.replace('"b2_east"', f'"{to}"'))
        with pytest.raises(InputError, match=rf"platoon\.0\.to: .*{said}"):
            simulation.prepare(scenario.load(file))
    file.write_text(text.replace('to = "b2_east"', 'to = "b2_east"\nroute = ["west_light"]'))
    with pytest.raises(InputError, match="must have one or the other"):
        scenario.load(file)


def test_a_route_that_turns_back_more_tightly_than_a_car_can_is_refused(tmp_path):
    cross = ODD_NETS / "cross.net.xml"
    file = write(tmp_path, f'net = "{cross.as_posix()}"', edges=["north_in", "north_out"])
    simulation.prepare(scenario.load(file))  # a robot turns on the spot
    file.write_text(re.sub("vehicle = .*", 'vehicle = "car"', file.read_text()))
    with pytest.raises(InputError, match=r"platoon\.0\.route: turns back from 'north_in' to 'north_out' on a radius"):
        simulation.prepare(scenario.load(file))


# ---- a leader that SUMO drives


def led_by_sumo(folder: Path, sumo: str, duration: float, edge: str, to: str) -> Path:
    file = write(folder, sumo, duration, edges=[edge])
    text = file.read_text().replace(f'route = ["{edge}"]', f'to = "{to}"').replace('law = "path"', 'law = "sumo"')
    text = re.sub(r"^speed_mps = .*\n", "", text, flags=re.MULTILINE)
    file.write_text(text)
    return file


@pytest.mark.slow
def test_sumo_drives_the_leader_by_its_own_rules(tmp_path):
    file = led_by_sumo(tmp_path, 'net = "corridor"\nwarm_up_s = 60.0', 400.0, "west_light", "b2_east")
    folder = run(file, tmp_path / "one")
    rows = pd.read_csv(folder / "trajectories.csv")
    assert rows.edge_id.iloc[-1] == "b2_east"
    end = pd.read_csv(folder / "events.csv").iloc[-1]
    assert (end.kind, end.detail) == ("end", "arrived")
    assert rows.speed_mps.max() <= 13.9 * 1.01  # the limit
    assert rows.accel_mps2.min() > -9.1
    # The readings fit together: the distance that the centre moved is the speed over time.
    step = np.hypot(rows.x_m.diff(), rows.y_m.diff())[1:]
    assert step.sum() == pytest.approx((rows.speed_mps[1:] * 0.1).sum(), rel=0.02)
    again = run(folder / "config.toml", tmp_path / "two")
    assert filecmp.cmp(folder / "trajectories.csv", again / "trajectories.csv", shallow=False)


def test_cars_follow_a_leader_that_sumo_drives(tmp_path):
    file = led_by_sumo(tmp_path, 'net = "highway"\ntraffic = false', 60.0, "e0_e1", "e4_e5")
    follower = (
        'follower = { law = "repaired", stand_off_m = 4.0, group_step_m = 1.0, lidar = '
        '{ preset = "car-follower", noise = "none", rate_hz = 10.0 } }\nsize = 3\ngap_m = 6.0\n'
    )
    car = 'vehicle = { type = "car", response_s = 0.2, lag_s = 0.1 }\n'
    text = file.read_text().replace('id = "laser"\n', 'id = "laser"\n' + follower)
    text = re.sub(r"^vehicle = .*\n", car, text, flags=re.MULTILINE)
    file.write_text(text.replace('law = "sumo"', 'law = "sumo"\nmax_speed_mps = 15.0'))
    folder = run(file, tmp_path / "one")
    metrics = pd.read_csv(folder / "metrics.csv").query("scope == 'vehicle'").set_index(["vehicle_id", "metric"]).value
    rows = pd.read_csv(folder / "trajectories.csv").query("time_s > 50")
    leader = rows[rows.place == 0]
    assert leader.speed_mps.mean() > 10
    for name in ("laser.1", "laser.2"):
        assert metrics[name, "lock_on_ratio"] == 1
        assert metrics[name, "collisions"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "speed", "stand_off"), [("ring_platoon", 10.0, 4.0), ("highway_platoon", 20.0, 6.0)])
def test_a_shipped_platoon_of_cars_holds_its_gaps_in_traffic(tmp_path, name, speed, stand_off):
    folder = run(name, tmp_path / "one")
    metrics = pd.read_csv(folder / "metrics.csv").query("scope == 'vehicle'").set_index(["vehicle_id", "metric"]).value
    rows = pd.read_csv(folder / "trajectories.csv")
    steady = rows[(rows.time_s > 60) & (rows.place > 0)]
    # The laser stands 0.03 m behind the bumper, and the law wants its distance at speed / 1.1107 beyond the stand-off.
    wanted = stand_off + speed / 1.1107 - 0.03
    assert steady.groupby("vehicle_id").gap_m.mean().to_numpy() == pytest.approx(wanted, rel=0.02)
    for place in range(1, 5):
        assert metrics[f"platoon.{place}", "lock_on_ratio"] >= 0.99
        assert metrics[f"platoon.{place}", "collisions"] == 0


def test_background_traffic_is_recorded_on_request(tmp_path):
    file = write(tmp_path, 'net = "ring"\nwarm_up_s = 60.0')
    folder = run(file, tmp_path / "one", "record.traffic_every_s=1.0")
    rows = pd.read_csv(folder / "traffic.csv")
    assert sorted(rows.time_s.unique()) == [0, 1, 2, 3, 4, 5]
    assert not rows.vehicle_id.str.startswith("laser").any()
    one = rows[rows.vehicle_id == rows.vehicle_id[0]]
    moved = np.hypot(one.x_m.diff(), one.y_m.diff())[1:]
    assert moved.to_numpy() == pytest.approx(one.speed_mps[1:].to_numpy(), rel=0.1)  # a second apart
    assert not (run(file, tmp_path / "two") / "traffic.csv").exists()
    with pytest.raises(InputError, match=r"record.traffic_every_s: 0.15: must be a multiple"):
        scenario.load(file, ["record.traffic_every_s=0.15"])
