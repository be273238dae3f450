"""The shipped networks: built from their sources, complete, and of the stated shape."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from platoontraffic.road.netconvert import build_net
from platoontraffic.road.network import Network
from platoontraffic.road.sumo_files import read_polygons
from tests.support import ROOT

NETS = ROOT / "sumo_nets"
LABS = ["lab_loop", "lab_world", "lab_curves"]  # for robots, in the paper's own metres
ROADS = ["ring", "highway", "corridor", "grid"]  # for cars, with traffic
NAMES = [*LABS, *ROADS, "bends", "bottleneck"]


def network(name):
    return Network.read(NETS / name / f"{name}.net.xml")


@pytest.mark.parametrize("name", NAMES)
def test_the_sources_build_the_committed_network(name, tmp_path):
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    built = tmp_path / f"{name}.net.xml"
    build_net(NETS / name / f"{name}.netccfg", built)
    committed = NETS / name / f"{name}.net.xml"
    assert ET.canonicalize(from_file=built, strip_text=True) == ET.canonicalize(from_file=committed, strip_text=True)


@pytest.mark.parametrize("name", NAMES)
def test_a_committed_network_has_no_trace_of_the_machine_that_built_it(name):
    text = (NETS / name / f"{name}.net.xml").read_text()
    assert "generated on" not in text
    assert len(text) < 500_000


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("suffix", "root", "inputs"),
    [
        ("netecfg", "neteditConfiguration", {"sumocfg-file", "sumo-net-file", "additional-files"}),
        ("sumocfg", "sumoConfiguration", {"net-file", "additional-files"}),
        ("netccfg", "netconvertConfiguration", {"node-files", "edge-files"}),
    ],
)
def test_configurations_name_existing_files_in_their_folder(name, suffix, root, inputs):
    config = ET.parse(NETS / name / f"{name}.{suffix}").getroot()
    files = {item.tag: item.get("value").split(",") for item in config.find("input")}
    if name in [*ROADS, "bottleneck"]:
        inputs = inputs | ({"connection-files"} if suffix == "netccfg" else {"route-files"})
    assert config.tag == root
    assert set(files) - {"tllogic-files"} == inputs
    named = {file for files_of_a_kind in files.values() for file in files_of_a_kind}
    assert all((NETS / name / file).is_file() for file in named)
    if suffix == "sumocfg":
        kept = {f.name for f in (NETS / name).glob("*.xml") if f.name.split(".")[1] in ("net", "poly", "add", "rou")}
        assert named == kept


@pytest.mark.parametrize("name", LABS)
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


def test_lab_world_allows_turning_back_only_at_the_dead_end():
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
    assert turns[turns < -0.5].sum() == pytest.approx(-90, abs=3.5)  # half a step is lost at each joint of bends
    # straights, the corners' quarter circles, the S-bend: a quarter turn left of 2 m in all, one right of 1 m
    straights = 1.0 + (8 - 2.75 - 6 / 2**0.5) + 3.5 + 4.0 + 2.75
    arcs = np.pi / 2 * (1.25 + 1.5 + 2 + 3) + np.pi / 2 * (2 + 1)
    assert np.hypot(*steps.T).sum() == pytest.approx(straights + arcs, abs=0.02)


def corners(line):
    """Angle [deg] at each vertex of a line, left positive."""
    steps = np.diff(line, axis=0)
    heading = np.arctan2(*steps[np.hypot(*steps.T) > 1e-6].T[::-1])
    return np.degrees((np.diff(heading) + np.pi) % (2 * np.pi) - np.pi)


def roads(name):
    root = ET.parse(NETS / name / f"{name}.net.xml").getroot()
    return [edge for edge in root.iterfind("edge") if edge.get("function") != "internal"]


def houses(name):
    return [shapely.Polygon(shape.coordinates) for shape in read_polygons(NETS / name / f"{name}.poly.xml")]


@pytest.mark.parametrize("name", ROADS)
def test_lanes_are_wide_enough_and_bend_gently(name):
    root = ET.parse(NETS / name / f"{name}.net.xml").getroot()
    lanes = root.findall(".//lane")
    lines = {lane.get("id"): [[*map(float, p.split(","))] for p in lane.get("shape").split()] for lane in lanes}
    assert min(float(lane.get("width")) for lane in lanes) == 3.2
    assert max(np.abs(corners(line)).max(initial=0) for line in lines.values()) < 15  # [deg]
    inside = {lane: line for lane, line in lines.items() if lane[0] == ":"}
    for link in root.iterfind("connection[@via]"):
        if link.get("from")[0] != ":":
            before = lines[f"{link.get('from')}_{link.get('fromLane')}"][-2:]
            assert np.abs(corners(before + inside[link.get("via")][1:2])).max(initial=0) < 15


@pytest.mark.parametrize("name", ROADS)
def test_no_road_lies_on_another(name):
    areas = [
        shapely.LineString([[*map(float, p.split(","))] for p in lane.get("shape").split()])
        .buffer(0.49 * float(lane.get("width")), cap_style="flat", join_style="mitre")
        for edge in roads(name)
        for lane in edge.iterfind("lane")
    ]  # fmt: skip
    one, other = shapely.STRtree(areas).query(areas, "intersects")
    shared = shapely.area(shapely.intersection(np.take(areas, one), np.take(areas, other)))[one < other]
    assert shared.max(initial=0) < 1  # [m2]


@pytest.mark.parametrize("name", ["corridor", "grid"])
def test_houses_stand_beside_the_road(name):
    all_of_them, road = houses(name), network(name).drivable
    assert min(house.distance(road) for house in all_of_them) > 2
    assert len(shapely.STRtree(all_of_them).query(all_of_them, "intersects")[0]) == len(all_of_them)


@pytest.mark.parametrize("name", ROADS)
def test_traffic_is_mixed_and_every_flow_has_a_route(name):
    root = ET.parse(NETS / name / f"{name}.rou.xml").getroot()
    assert {kind.get("id") for kind in root.iter("vType")} >= {"car", "van", "truck"}
    assert sum(float(kind.get("probability")) for kind in root.find("vTypeDistribution")) == pytest.approx(1)
    (stops,) = [ET.parse(file).findall("busStop") for file in (NETS / name).glob("*.add.xml")] or [[]]
    assert {stop.get("busStop") for stop in root.iter("stop")} == {stop.get("id") for stop in stops}
    known = network(name).edges
    ends = [(flow.get("from"), flow.get("to")) for flow in root.iter("flow") if flow.get("from")]
    named = {edge for pair in ends for edge in pair} | {e for r in root.iter("route") for e in r.get("edges").split()}
    assert named <= set(known)
    assert len(ends) == len(set(ends))


def test_ring_is_round():
    lap = ["east_north", "north_west", "west_south", "south_east"]
    for lane, radius in ((0, 160.75), (1, 157.55)):
        line = network("ring").route_line(lap, lane=lane, closed=True)
        np.testing.assert_allclose(np.hypot(*line.T), radius, atol=0.02)
        assert corners(line).sum() == pytest.approx(360, abs=5)
        assert corners(line).max() < 2.5


@pytest.mark.parametrize("side", ["e", "w"])
def test_highway_has_two_lanes_a_ramp_off_and_a_ramp_on(side):
    main = [f"{side}{i}_{side}{i + 1}" for i in range(5)]
    highway = network("highway")
    assert [len(highway.edges[edge]) for edge in main] == [2, 3, 2, 3, 2]
    line = highway.route_line(main, lane=1)
    assert np.hypot(*np.diff(line, axis=0).T).sum() == pytest.approx(5000, abs=10)
    for route in (main, [*main[:2], f"{side}2_{side}_exit"], [f"{side}_entry_{side}3", *main[3:]]):
        assert np.abs(corners(highway.route_line(route))).max() < 5  # a lane is changed at 1 in 12: 4.8
    assert {float(lane.get("speed")) for e in roads("highway") if e.get("id") in main for lane in e} == {33.33}


@pytest.mark.parametrize("radius", [10, 14, 20, 28, 40, 56, 80, 112])
def test_bends_turn_a_quarter_at_the_radius_of_their_name(radius):
    line = network("bends").route_line([f"r{radius}"])
    turns, steps = np.radians(corners(line)), np.hypot(*np.diff(line, axis=0).T)
    assert turns.max() < np.radians(9)
    assert turns.sum() == pytest.approx(np.pi / 2, abs=1e-3)
    assert steps[1:-1].sum() == pytest.approx(radius * np.pi / 2, rel=0.01)
    assert steps[[0, -1]] == pytest.approx([320, 200], abs=0.1)


def test_corridor_bends_have_falling_radii():
    line = network("corridor").route_line(["b0_b1", "b1_b2"])
    turns, steps = np.radians(corners(line)), np.hypot(*np.diff(line, axis=0).T)
    bending = np.flatnonzero(np.abs(turns) > np.radians(1))
    bends = np.split(bending, np.flatnonzero(np.diff(np.sign(turns[bending]))) + 1)
    radii = [steps[bend[0] + 1 : bend[-1] + 1].sum() / turns[bend].sum() for bend in bends]
    # eastbound is 1.6 m to the right of the middle: outside in left bends
    np.testing.assert_allclose(radii, [60 + 1.6, -(40 - 1.6), 25 + 1.6, -(15 - 1.6)], rtol=0.02)


def test_corridor_roundabout_is_round_and_leads_to_every_arm():
    corridor = network("corridor")
    ring = corridor.route_line(["rw_rs", "rs_re", "re_rn", "rn_rw"], closed=True)
    np.testing.assert_allclose(np.hypot(*(ring - (1100, 0)).T), 20, atol=0.03)
    quarter = ["rw_rs", "rs_re", "re_rn", "rn_rw"]
    for n, leave in ((1, "rs_round_s"), (2, "re_b0"), (3, "rn_round_n"), (4, "rw_prio")):
        assert np.abs(corners(corridor.route_line(["prio_rw", *quarter[:n], leave]))).max() < 15


@pytest.mark.parametrize(
    ("name", "junction", "reach"), [("corridor", (400, 0), 30), ("corridor", (750, 0), 30), ("grid", (200, 160), 40)]
)
def test_houses_hide_the_crossing_road(name, junction, reach):
    town = shapely.union_all(houses(name))
    arms = reach * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]) + junction
    for one, other in zip(arms, np.roll(arms, 1, axis=0), strict=True):
        assert shapely.LineString([one, other]).intersects(town)
        assert not shapely.LineString([one, junction, other]).intersects(town)


def test_grid_has_lights_and_priority_and_two_lanes_on_its_axes():
    root = ET.parse(NETS / "grid" / "grid.net.xml").getroot()
    kinds = [junction.get("type") for junction in root.iterfind("junction")]
    assert (kinds.count("traffic_light"), kinds.count("priority"), kinds.count("dead_end")) == (20, 16, 24)
    for edge in roads("grid"):
        start, end = edge.get("from"), edge.get("to")
        shared = set(start) & set(end) & set("ABCDEF012345")  # the column or row that it lies in
        assert len(edge.findall("lane")) == (2 if shared & set("BE14") else 1)
    assert len(network("grid").outline()) == 1 + 25


@pytest.mark.sumo
@pytest.mark.parametrize("name", NAMES)
def test_sumo_runs_the_configuration(name):
    libsumo = pytest.importorskip("libsumo")
    libsumo.start(["sumo", "-c", str(NETS / name / f"{name}.sumocfg"), "--no-step-log", "--duration-log.disable"])
    lengths, collisions, departed = {}, 0, 0
    try:
        for _ in range(600 if name in ROADS else 1):
            libsumo.simulationStep()
            collisions += len(libsumo.simulation.getCollisions())
            departed += libsumo.simulation.getDepartedNumber()
        lengths = {lane: libsumo.lane.getLength(lane) for lane in libsumo.lane.getIDList() if lane[0] != ":"}
        lost = libsumo.vehicle.getTeleportingIDList()
    finally:
        libsumo.close()
    edges = network(name).edges
    assert lengths == {f"{edge}_{i}": pytest.approx(length) for edge in edges for i, length in enumerate(edges[edge])}
    assert (collisions, list(lost)) == (0, [])
    assert (departed > 10) == (name in ROADS)
