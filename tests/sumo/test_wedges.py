"""Members in the wedge that a bend leaves between two lanes, on lanes shorter than they are and on others."""

from __future__ import annotations

import pytest

from platoontraffic.road.netconvert import build_net
from platoontraffic.simulation import Simulation
from platoontraffic.vehicles.motion import Drive

pytestmark = pytest.mark.sumo

NODES = """<nodes><node id="a" x="0" y="0"/><node id="b" x="60" y="0" radius="0.1"/>
<node id="c" x="{end}" y="0" radius="0.1"/><node id="d" x="{beyond}" y="30"/></nodes>"""
EDGES = """<edges><edge id="ab" from="a" to="b" speed="14"/><edge id="bc" from="b" to="c" speed="14"/>
<edge id="cd" from="c" to="d" speed="14"/></edges>"""
CONFIGURATION = """<configuration><input><node-files value="n.nod.xml"/><edge-files value="n.edg.xml"/></input>
<processing><no-turnarounds value="true"/></processing>
<junctions><junctions.internal-link-detail value="2"/></junctions></configuration>"""
STRAIGHT_ON = {"platoon.0": Drive(0.5, 0.0)}
SCENARIO = """
[sumo]
net = "n.net.xml"
[scene]
walls = "none"
[run]
step_s = 0.05
duration_s = 5
[[platoon]]
size = 1
vehicle = "car"
start = {{ edge = "{edge}", position_m = {position}, lateral_m = -0.65 }}
to = "cd"
leader = {{ law = "path", lidar = "car-leader" }}
"""

DEAD_END = {
    "n.nod.xml": """<nodes><node id="a" x="0" y="0"/><node id="b" x="60" y="0" radius="6"/>
<node id="c" x="120" y="0"/></nodes>""",
    "n.edg.xml": """<edges><edge id="ab" from="a" to="b" numLanes="2" speed="14"/>
<edge id="bc" from="b" to="c" speed="14"/></edges>""",
    "n.con.xml": '<connections><connection from="ab" to="bc" fromLane="0" toLane="0"/></connections>',
    "n.netccfg": CONFIGURATION.replace("</input>", '<connection-files value="n.con.xml"/></input>'),
    "s.toml": SCENARIO.format(edge="ab", position=50.0)
    .replace("lateral_m = -0.65", "lane = 1")
    .replace("cd", "bc")
    .replace("duration_s = 5", "duration_s = 20"),
}


def _driven(folder, files, until):
    """Roads of the member, and its lane in SUMO, at each instant until it is on a road."""
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    for name, text in files.items():
        (folder / name).write_text(text)
    build_net(folder / "n.netccfg", folder / "n.net.xml")
    with Simulation.load(folder / "s.toml") as simulation:
        now, roads, in_sumo = simulation.reset(), [], []
        while now.roads[:1] != [until]:
            now = simulation.step(STRAIGHT_ON)
            roads.append(now.roads[0])
            in_sumo.append(simulation.sumo.vehicle.getLaneID("platoon.0"))
    return roads, in_sumo


@pytest.mark.parametrize(("length", "edge", "position"), [(2.4, "ab", 60.0), (20.0, "bc", 17.5)])
def test_a_member_in_the_wedge_of_a_bend_stays_on_the_network(tmp_path, length, edge, position):
    """The bend to the left leaves a wedge of 0.2 m, 0.65 m to the right of the lanes, that lies before the one and
    behind the other. A vehicle that left the network there killed SUMO: in a city, on a lane of 2.3 m, and in a grid of
    all-way stops, at the end of a lane inside a corner."""
    nodes = NODES.format(end=60 + length, beyond=107.6 + length)
    scenario = SCENARIO.format(edge=edge, position=position)
    files = {"n.nod.xml": nodes, "n.edg.xml": EDGES, "n.netccfg": CONFIGURATION, "s.toml": scenario}
    roads, in_sumo = _driven(tmp_path, files, ("cd", "cd_0"))
    assert roads[0][0] == "bc"
    assert all(lane for _, lane in roads)
    assert all(in_sumo)


def test_a_member_beyond_a_lane_that_leads_nowhere_stays_on_the_network_too(tmp_path):
    """It drives on its lane until the lane ends, so SUMO takes it to be there still, and ignores that it is moved
    there: a run of a city ended at the next shadow of such a member."""
    roads, in_sumo = _driven(tmp_path, DEAD_END, (":b_0", ":b_0_0"))
    assert {lane for _, lane in roads} == {"ab_1", ":b_0_0"}
    assert all(in_sumo)
