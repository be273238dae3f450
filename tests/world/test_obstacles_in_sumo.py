"""Obstacles in runs: SUMO's drivers brake for them, its pedestrians are seen, files record encounters; bad input."""

from __future__ import annotations

import re
from pathlib import Path

import libsumo
import numpy as np
import pandas as pd
import pytest
import shapely

from platoontraffic import scenario, simulation
from platoontraffic.errors import InputError
from platoontraffic.results import metrics
from platoontraffic.road.network import Network
from platoontraffic.sumo.world import World
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.traffic import TrafficSnapshot
from tests.support import ODD_NETS
from tests.support.runs import run

NETS = ODD_NETS
STEP = 0.1
NOBODY = Fleet.deployed([], STEP)

SCENARIO = """
[sumo]
net = "corridor"
traffic = false

[scene]
walls = "none"

[run]
duration_s = 20.0
step_s = 0.1

[record]
traffic_every_s = 0.1

[[platoon]]
size = 3
gap_m = 12.0
vehicle = "car"
start = { edge = "light_prio", position_m = 80.0, speed_mps = 8.0 }
to = "b2_east"
leader = { law = "path", speed_mps = 8.0, lidar = "car-leader" }
follower = { law = "tracking", lidar = { preset = "car-tracker", samples = 361 } }

"""


@pytest.fixture
def written(tmp_path):
    """A scenario file with obstacles; returns its path."""

    def write(obstacles: str) -> Path:
        file = tmp_path / "mine.toml"
        file.write_text(SCENARIO + obstacles)
        return file

    return write


def standing(name: str, x: float, y: float, heading: float, length: float, width: float, time=0.0) -> TrafficSnapshot:
    values = (np.array([v]) for v in (x, y, heading, 0.0, length, width))
    return TrafficSnapshot(time, (name,), *values)


def play(tmp_path, obstacles, seconds: float, routes=None, each=lambda world: None) -> list[TrafficSnapshot]:
    """Snapshots of a background vehicle on a road 300 m long; obstacles: those at a time."""
    seen = []
    with World(Network.read(NETS / "cross.net.xml"), STEP, 1, tmp_path / "words.log") as world:
        libsumo.route.add("south", ["north_in", "south_out"])
        libsumo.vehicle.add("f", "south", departPos="100", departSpeed="10")
        fleet = world.deploy(NOBODY)
        for step in range(round(seconds / STEP)):
            bodies = obstacles(step * STEP)
            world.hold(bodies, dict.fromkeys(bodies.ids, ()) if routes is None else routes)
            each(world)
            fleet = world.advance(fleet)
            seen.append(world.snapshot(fleet))
    return seen


def clearance(traffic: TrafficSnapshot, one: str, other: str) -> float:
    corners = traffic.boxes().corners()
    return shapely.distance(*shapely.polygons(corners[[traffic.ids.index(one), traffic.ids.index(other)]]))


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("size", "heading"),
    [((4.74, 1.76), -np.pi / 2), ((0.6, 0.6), 0.3), ((0.3, 0.5), 0.0)],
    ids=["car", "box", "walker"],
)
def test_a_driver_stops_before_an_obstacle_on_its_lane(tmp_path, size, heading):
    seen = play(tmp_path, lambda time: standing("o", 498.4, 100.0, heading, *size), 30.0)
    assert seen[-1].ids == ("f", "o")
    assert seen[-1].speed[0] < 0.01
    assert min(clearance(t, "f", "o") for t in seen) == pytest.approx(2.5, abs=0.6)  # measured from its front, not side
    assert {(t.x[1], t.y[1]) for t in seen} == {(498.4, 100.0)}


@pytest.mark.sumo
def test_a_driver_goes_on_when_the_obstacle_is_gone_and_one_that_an_obstacle_appears_on_is_removed(tmp_path):
    def some(time: float) -> TrafficSnapshot:
        if 3.0 <= time < 12.0:
            return standing("o", 498.4, 100.0, 0.3, 0.6, 0.6)
        return TrafficSnapshot(time, (), *np.empty((6, 0)))

    seen = play(tmp_path, some, 20.0)
    assert seen[115].speed[0] < 1
    assert seen[-1].y[0] < 90.0
    seen = play(tmp_path, lambda time: standing("o", 498.4, 200.0, 0.3, 0.6, 0.6), 1.0)
    assert seen[-1].ids == ("o",)


@pytest.mark.sumo
def test_a_driver_passes_an_obstacle_beside_the_road_and_one_that_sumo_does_not_have(tmp_path):
    """getRoadID of a vehicle that was never on a lane kills libsumo."""
    for routes, x in ((None, 494.0), ({}, 498.4)):
        seen = play(tmp_path, lambda time, x=x: standing("o", x, 100.0, 0.0, 0.5, 0.5), 15.0, routes)
        assert seen[-1].y[0] < 60.0
        assert seen[-1].ids == ("f", "o")


@pytest.mark.sumo
def test_a_pedestrian_of_sumo_is_in_the_snapshot_with_its_size(tmp_path):
    def add(world: World) -> None:
        if libsumo.simulation.getTime() == pytest.approx(0.2):
            libsumo.person.add("f", "north_in", 150.0)  # the name of a vehicle
            libsumo.person.appendWalkingStage("f", ["north_in"], 160.0)

    seen = play(tmp_path, lambda time: standing("o", 0.0, 0.0, 0.0, 1.0, 1.0), 8.0, {}, add)
    last = seen[-1]
    assert last.ids == ("f", "person.f", "o")
    assert (last.length[1], last.width[1]) == (0.215, 0.478)
    walked = np.array([(t.x[1], t.y[1]) for t in seen if "person.f" in t.ids])
    assert np.abs(walked[:, 0] - 498.4).max() < 2.0
    assert walked[0, 1] == pytest.approx(150.0, abs=0.5)
    assert walked[-1, 1] < walked[0, 1] - 2
    assert last.heading[1] == pytest.approx(-np.pi / 2)


@pytest.mark.sumo
def test_a_run_records_a_cut_in_a_pedestrian_and_their_outcome(written, tmp_path):
    file = written("""
[[obstacle]]
kind = "cut_in"
ahead_of = "platoon.2"
time_s = 4.0

[[obstacle]]
kind = "pedestrian"
id = "child"
edge = "light_prio"
position_m = 135.0
speed_mps = 3.0
when = { member = "platoon.0", within_m = 16.0 }

[[obstacle]]
kind = "car"
time_s = 10.0
start = { edge = "light_prio", position_m = 330.0 }
""")
    folder = run(tmp_path / "one", file)
    events, met = (pd.read_csv(folder / f"{name}.csv") for name in ("events", "encounters"))
    kinds = events.set_index("kind")
    assert list(events[events.kind == "obstacle"].vehicle_id) == ["child", "cut_in.0", "car.0"]
    assert (kinds.loc["cut_in", "vehicle_id"], kinds.loc["cut_in", "other_id"]) == ("platoon.2", "cut_in.0")
    assert kinds.loc[["cut_in", "steps_out"], "edge_id"].notna().all()
    assert (kinds.loc["steps_out", "vehicle_id"], kinds.loc["steps_out", "other_id"]) == ("platoon.0", "child")
    assert set(met.obstacle_id) == {"child", "cut_in.0"}
    assert (met.avoidable == 1).all()
    assert (met.contact == 0).all()
    assert (met.gap_min_m > 0.5).all()
    values = pd.read_csv(folder / "metrics.csv").query("scope == 'run'").set_index("metric").value
    assert values[["cut_ins", "steps_out", "unavoidable", "avoidable_contacts"]].tolist() == [1, 1, 0, 0]
    assert values["collisions_cut_in"] == values["collisions_pedestrian"] == 0
    assert set(pd.read_csv(folder / "traffic.csv").vehicle_id) == {"child", "cut_in.0", "car.0"}
    other = run(tmp_path / "other", file)
    for name in ("events", "encounters", "traffic", "trajectories", "metrics"):
        assert (folder / f"{name}.csv").read_bytes() == (other / f"{name}.csv").read_bytes()


@pytest.mark.sumo
def test_contacts_with_obstacles_are_counted_by_kind(written, tmp_path):
    """No vehicle can brake for a box that appears before its bumper."""
    file = written("""
[[obstacle]]
kind = "box"
time_s = 2.0
start = { edge = "light_prio", position_m = 98.0 }
""")
    folder = run(tmp_path / "one", file)
    values = pd.read_csv(folder / "metrics.csv").query("scope == 'run'").set_index("metric").value
    assert values["collisions_box"] >= 1
    assert values["collisions_car"] == 0
    assert set(values.index) >= {f"collisions_{kind}" for kind in metrics.OBSTACLES}


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ('kind = "pedestrain"', 2, "obstacle.0.kind: 'pedestrain': not known; did you mean 'pedestrian'?"),
        ("time_s = 3.0", 1, "obstacle.0.kind: missing; known: box, car, cut_in, pedestrian, robot"),
        ('kind = "box"\nAT 9.0;\ncolor = 3', 4, "obstacle.0.color: unknown key"),
        ('kind = "cut_in"\ntime_s = 3.0\nahead_of = "platoon.0"', 4, "'platoon.0': leads, there is no gap before it; "
         "must be a follower: platoon.1, platoon.2"),
        ('kind = "cut_in"\ntime_s = 3.0\nahead_of = "platon.1"', 4, "'platon.1': no such member; did you mean 'plat"),
        ('kind = "cut_in"\ntime_s = 3.0\nahead_of = "platoon.1"\nleaves_after_s = 1.5', 1, "leaves 1.5 s after "
         "it began a lane change that takes 3 s; must be no sooner than its end"),
        ('kind = "cut_in"\ntime_s = 30.0\nahead_of = "platoon.1"', 3, "30: must be before the end, run.duration"),
        ('kind = "cut_in"\ntime_s = 3.0\nid = "platoon.1"\nahead_of = "platoon.1"', 4, "is a member of a platoon"),
        ('kind = "car"\nstart = { edge = "light_pro", position_m = 9.0 }', 3, "0.start: no edge 'light_pro' in"),
        ('kind = "car"\nAT 900.0;', 3, "position 900 m is not on it; must be 0.."),
        ('kind = "car"\nAT 99.0, lateral_m = 9.0;', 3, "off the road"),
        ('kind = "car"\nAT 81.0;', 3, "car.0 would be on platoon.0 from the start"),
        ('kind = "box"\nx_m = 9.0', 1, "must have either `start`, or `x_m` and `y_m`"),
        ('kind = "box"\nx_m = 9.0\ny_m = 900.0', 3, "off the road; must touch it"),
        ('kind = "pedestrian"\nedge = "light_prio"\nposition_m = 9.0', 1, "must have either `time_s` or `when`"),
        ('kind = "pedestrian"\nedge = "prio_light"\nposition_m = 1e4\ntime_s = 1.0', 4, "obstacle.0.position_m: edge"),
        ('kind = "pedestrian"\nedge = "b2_east"\nposition_m = 9.0\nwhen = { member = "x.1", within_m = 9.0 }', 5,
         "obstacle.0.when.member: 'x.1': no such member"),
        ('kind = "pedestrian"\nedge = "rs_round_s"\nposition_m = 50.0\nwhen = { member = "platoon.1", within_m = 9.0 }',
         5, "the route of 'platoon.1' does not pass edge 'rs_round_s' at 50 m"),
        ('kind = "robot"\npath_m = [[1.0, 0.0], [1.0, 900.0]]', 3, "(1, 900) m is not on the road"),
        ('kind = "robot"\npath_m = [[1.0, 0.0]]', 3, "obstacle.0.path_m: "),
    ],
)  # fmt: skip
def test_a_fault_is_one_line_with_file_and_key_before_sumo_starts(written, text, line, what):
    text = re.sub(r"AT (.+?);", r'start = { edge = "light_prio", position_m = \1 }', text)
    file = written("[[obstacle]]\n" + text + "\n")
    first = SCENARIO.count("\n")
    with pytest.raises(InputError) as caught:
        simulation.prepare(scenario.load(file))
    (fault,) = caught.value.faults
    assert fault.startswith(f"{file}:{first + line}: "), fault
    assert what in fault


def test_an_id_that_another_obstacle_or_a_vehicle_of_sumo_has_is_refused(written, tmp_path):
    box = '[[obstacle]]\nkind = "box"\nid = "b"\nstart = { edge = "light_prio", position_m = 200.0 }\n'
    with pytest.raises(InputError, match=r"obstacle\.1\.id: 'b': obstacle\.0 has the same id; must be another"):
        scenario.load(written(box + box))
    (tmp_path / "some.rou.xml").write_text('<routes><trip id="b" depart="0" from="light_prio" to="b2_east"/></routes>')
    file = written(box)
    file.write_text(file.read_text().replace("traffic = false", 'traffic = false\nroutes = ["some.rou.xml"]'))
    with pytest.raises(
        InputError, match=r"obstacle\.0\.id: 'b': .*trip 'b' is, or makes, 'b', the id of this obstacle"
    ):
        scenario.load(file)


def test_an_argument_overrides_a_key_of_an_obstacle(written):
    file = written('[[obstacle]]\nkind = "cut_in"\nahead_of = "platoon.1"\ntime_s = 3.0\n')
    changed = scenario.load(file, ["obstacle.0.share=0.25", "obstacle.ahead_of=platoon.2"])
    assert (changed.spec.obstacle[0].share, changed.spec.obstacle[0].ahead_of) == (0.25, "platoon.2")
    assert scenario.load(file).resolved()["obstacle"][0]["time_s"] == 3.0
    assert "obstacle" not in scenario.load("paper_loop").resolved()
