"""The shipped networks: built from their sources, complete, and of the stated shape."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from platoontraffic.network import Network, build_net, read_polygons

NETS = Path(__file__).parents[1] / "sumo_nets"
NAMES = ["lab_loop", "lab_world", "lab_curves"]


def network(name):
    return Network.read(NETS / name / f"{name}.net.xml")


@pytest.mark.parametrize("name", NAMES)
def test_sources_build_the_committed_net(name, tmp_path):
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    built = tmp_path / f"{name}.net.xml"
    build_net(NETS / name / f"{name}.netccfg", built)
    committed = NETS / name / f"{name}.net.xml"
    assert ET.canonicalize(from_file=built, strip_text=True) == ET.canonicalize(from_file=committed, strip_text=True)


@pytest.mark.parametrize("name", NAMES)
def test_committed_net_tells_nothing_of_the_machine_that_built_it(name):
    assert "generated on" not in (NETS / name / f"{name}.net.xml").read_text()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("suffix", "root", "inputs"),
    [
        ("netecfg", "neteditConfiguration", {"sumocfg-file", "sumo-net-file", "additional-files"}),
        ("sumocfg", "sumoConfiguration", {"net-file", "additional-files"}),
        ("netccfg", "netconvertConfiguration", {"node-files", "edge-files"}),
    ],
)
def test_configurations_name_files_beside_them(name, suffix, root, inputs):
    config = ET.parse(NETS / name / f"{name}.{suffix}").getroot()
    files = {item.tag: item.get("value") for item in config.find("input")}
    assert config.tag == root
    assert set(files) == inputs
    assert all((NETS / name / file).is_file() for file in files.values())


@pytest.mark.parametrize("name", NAMES)
def test_every_road_has_one_lane_each_way_of_one_metre(name):
    root = ET.parse(NETS / name / f"{name}.net.xml").getroot()
    for edge in root.iterfind("edge[@from]"):
        (lane,) = edge.findall("lane")
        assert (edge.get("id"), float(lane.get("width"))) == (f"{edge.get('from')}_{edge.get('to')}", 1)
        assert float(lane.get("speed")) == 2


def test_lab_loop_is_a_rectangle_with_an_island():
    intended = box(0, 0, 6, 5) - box(2, 2, 4, 3)
    assert network("lab_loop").drivable.symmetric_difference(intended).area < 1e-3
    assert len(network("lab_loop").outline()) == 2


def test_lab_world_is_a_grid_of_streets_with_a_dead_end():
    blocks = shapely.union_all([box(x, y, x + 3, y + 2) for x in (2, 7) for y in (6, 10)])
    intended = (box(0, 4, 12, 14) - blocks) | box(5, 0, 7, 4)
    world = network("lab_world")
    assert world.drivable.symmetric_difference(intended).area < 1e-3
    assert len(world.outline()) == 5


def test_lab_world_turns_round_only_at_the_dead_end():
    root = ET.parse(NETS / "lab_world" / "lab_world.net.xml").getroot()
    turns = [(link.get("from"), link.get("to")) for link in root.iterfind("connection[@dir='t']") if link.get("via")]
    assert turns == [("s_end", "end_s")]
    assert network("lab_world").edges["s_end"] == (4.0,)


def test_lab_world_has_a_box_and_a_fence_on_its_streets():
    shapes = {shape.id: shape for shape in read_polygons(NETS / "lab_world" / "lab_world.poly.xml")}
    assert {name: shape.kind for name, shape in shapes.items()} == {"box": "obstacle", "fence": "wall"}
    road = network("lab_world").drivable
    assert all(road.covers(shapely.LineString(shape.coordinates)) for shape in shapes.values())


@pytest.mark.parametrize(
    ("edge", "centre", "radius", "quadrant"),
    [
        ("w_s", (1.75, 1.75), 1.25, (-1, -1)),
        ("s_e", (8, 2), 1.5, (1, -1)),
        ("e_n", (7.5, 5.5), 2.0, (1, 1)),
        ("n_w", (3.5, 4.5), 3.0, (-1, 1)),
    ],
)
def test_lab_curves_corners_have_their_radius(edge, centre, radius, quadrant):
    line = network("lab_curves").route_line([edge])
    arm = line - centre
    corner = arm[(arm * quadrant >= -1e-6).all(axis=1)]
    np.testing.assert_allclose(np.hypot(*corner.T), radius, atol=1e-3)
    assert len(corner) >= 19


def test_lab_curves_lap_is_smooth_and_bends_right_once():
    lap = network("lab_curves").route_line(["s_e", "e_n", "n_w", "w_s"], closed=True)
    steps = np.diff(lap, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    turns = np.degrees(np.diff(heading))
    assert np.abs(turns).max() < 6.5
    assert np.degrees(heading[-1] - heading[0]) == pytest.approx(360)
    assert turns[turns < -0.5].sum() == pytest.approx(-90, abs=3.5)  # half a step is lost where bends meet
    # straights, the corners' quarter circles, the S-bend: a quarter turn left of 2 m in all, one right of 1 m
    straights = 1.0 + (8 - 2.75 - 6 / 2**0.5) + 3.5 + 4.0 + 2.75
    arcs = np.pi / 2 * (1.25 + 1.5 + 2 + 3) + np.pi / 2 * (2 + 1)
    assert np.hypot(*steps.T).sum() == pytest.approx(straights + arcs, abs=0.02)


@pytest.mark.sumo
@pytest.mark.parametrize("name", NAMES)
def test_sumo_runs_the_configuration(name):
    libsumo = pytest.importorskip("libsumo")
    libsumo.start(["sumo", "-c", str(NETS / name / f"{name}.sumocfg"), "--no-step-log", "true"])
    try:
        libsumo.simulationStep()
        lengths = {lane: libsumo.lane.getLength(lane) for lane in libsumo.lane.getIDList() if lane[0] != ":"}
    finally:
        libsumo.close()
    assert lengths == {f"{edge}_0": pytest.approx(lane[0]) for edge, lane in network(name).edges.items()}
