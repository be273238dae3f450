"""A platoon that comes to a queue at a light, and the lanes that it takes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from platoontraffic.road.lane_routes import CHANGING, Line
from platoontraffic.simulation import Simulation
from platoontraffic.sumo.lane_choice import _together
from tests.support.generated import crossroads

pytestmark = pytest.mark.sumo

STAYS = 'lcStrategic="-1" lcCooperative="-1" lcSpeedGain="0" lcKeepRight="0" sigma="0"'  # it changes no lanes
END = 110.0  # position from which the lane counts [m]: beyond a change, and before the end of the longest queue
SCENARIO = """
seed = 1
sumo = {{ net = "cross.net.xml", routes = ["queue.rou.xml"], warm_up_s = 2.0 }}
run = {{ step_s = 0.1, duration_s = 15.0 }}
scene.walls = "none"

[[platoon]]
id = "p"
size = {size}
gap_m = 3.0
vehicle = "car"
start = {{ edge = "wc", lane = {lane}, position_m = {position}, speed_mps = 8.0 }}
route = ["wc", "{onto}"]
leader = {{ law = "path", lidar = "car-leader" }}
follower = {{ law = "tracking", lidar = "car-tracker", policy = "obey", on_loss = "drive" }}
"""


@pytest.fixture
def lanes(tmp_path):
    """The lanes on which members come to a red light, where so many cars stand on each."""
    crossroads(tmp_path)

    def run(queued: tuple[int, int], lane: int = 0, onto: str = "ce", stops: str = "", **start) -> dict[str, set[str]]:
        cars = "".join(
            f'<vehicle id="c{k}.{i}" type="stays" depart="0" departLane="{k}" departPos="{185 - 8 * i}"'
            f' departSpeed="0"><route edges="wc ce"/>{stops}</vehicle>'
            for k, n in enumerate(queued)
            for i in range(n)
        )
        (tmp_path / "queue.rou.xml").write_text(f'<routes><vType id="stays" {STAYS}/>{cars}</routes>')
        start = {"size": 3, "position": 60.0} | start
        (tmp_path / "scenario.toml").write_text(SCENARIO.format(lane=lane, onto=onto, **start))
        taken: dict[str, set[str]] = {f"p.{k}": set() for k in range(start["size"])}
        with Simulation.load(tmp_path / "scenario.toml") as simulation:
            now = simulation.reset()
            simulation.sumo.trafficlight.setPhase("c", 0)
            while not now.ended:
                assert not [event for event in now.events if event.kind == "collision"]
                for name, (edge, its) in zip(now.fleet.ids, now.roads, strict=True):
                    if edge == "wc" and simulation.sumo.vehicle.getLanePosition(name) > END:
                        taken[name].add(its)
                now = simulation.step()
        return taken

    return run


@pytest.mark.parametrize("lane", [0, 1])
def test_it_goes_round_a_queue_on_the_lane_beside(lanes, lane):
    queued = [0, 0]
    queued[lane] = 6
    beside = {f"wc_{1 - lane}"}
    assert lanes(tuple(queued), lane) == {"p.0": beside, "p.1": beside, "p.2": beside}


def test_it_goes_round_a_vehicle_at_a_stop(lanes):
    bus = '<stop lane="wc_0" endPos="186" startPos="150" duration="60"/>'
    assert lanes((1, 0), stops=bus) == {"p.0": {"wc_1"}, "p.1": {"wc_1"}, "p.2": {"wc_1"}}


def test_at_the_begin_of_the_edge_it_waits_for_room(lanes):
    """A change needs some road before it. One did not look again for 10 s, and stood in the queue."""
    assert lanes((6, 0), size=1, position=5.0) == {"p.0": {"wc_1"}}


@pytest.mark.parametrize(
    ("queued", "onto"),
    [
        ((6, 5), "ce"),  # hardly shorter
        ((2, 0), "ce"),  # not worth a lane change
        ((6, 0), "cs"),  # from the other lane nothing leads to its route
    ],
)
def test_else_it_stays(lanes, queued, onto):
    assert lanes(queued, 0, onto) == {"p.0": {"wc_0"}, "p.1": {"wc_0"}, "p.2": {"wc_0"}}


class Fleet(SimpleNamespace):
    def __len__(self) -> int:
        return len(self.ids)


def test_a_member_chooses_for_itself_where_its_predecessor_has_left_the_edge_by_another_lane():
    """One stood before a full road for 50 s: those ahead of it had gone round on the lane beside."""

    def route(*lanes: str):
        lines = [Line(100.0 * k, "M", "", 0, lane, "", (), 8.0) for k, lane in enumerate(lanes, 1)]
        return SimpleNamespace(lines=(Line(90.0, CHANGING, "", 0, "a_0", "a_1", (), 16.0), *lines))

    right, left, other = route("a_0", "b_0"), route("a_1", "b_0"), route("a_0", "b_1")
    members = [SimpleNamespace(route=one) for one in (right, left, right, other)]
    fleet = Fleet(
        motion=SimpleNamespace(x=np.array([120.0, 80.0, 70.0, 30.0]), y=np.zeros(4)),
        predecessor=np.array([-1, 0, 1, 2]), ids=list("pqrs"), members=members,
        progress=SimpleNamespace(
            rows=np.arange(4), station=np.array([120.0, 80.0, 70.0, 30.0]), front=np.full(4, 2.5)
        ),
    )  # fmt: skip

    assert _together(fleet, set("pqrs")) == {0: [], 1: [], 2: [3]}  # all leave by a_0 but the second
    assert _together(fleet, set("prs")) == {0: [1], 2: [3]}
    assert _together(fleet, set()) == {0: [1, 2, 3]}
