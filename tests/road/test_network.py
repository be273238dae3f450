"""Reading a network: faults in the file, lanes and routes, the side of the road."""

import gzip
import math
import re
from types import SimpleNamespace

import numpy as np
import platformdirs
import pytest
import shapely

from platoontraffic import shipped
from platoontraffic.errors import InputError
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.road.network import MARGIN, Network
from platoontraffic.road.sumo_files import check_net_file, read_polygons
from platoontraffic.world.deployment import static_scene
from tests.support import ODD_NETS, ROOT
from tests.support.generated import crossroads

NETS = ROOT / "sumo_nets"
ODD = ODD_NETS
LAP = ["sw_se", "se_ne", "ne_nw", "nw_sw"]
LANE = '<lane id="a_0" index="0" speed="2" length="1" width="1" shape="0,0 1,0"/>'


@pytest.fixture(scope="module")
def loop():
    return Network.read(NETS / "lab_loop" / "lab_loop.net.xml")


@pytest.fixture(scope="module")
def world():
    return Network.read(NETS / "lab_world" / "lab_world.net.xml")


@pytest.fixture(scope="module")
def curves():
    return Network.read(NETS / "lab_curves" / "lab_curves.net.xml")


def right(network, x, y, degrees):
    return network.right_of_middle([x], [y], np.radians([degrees]))[0]


# ---- files


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "empty"),
        ("\n\n", 3, "ends too early"),
        ("plain text", 1, "not whole XML"),
        ('<net version="1.20">\n<edge id="a"', 2, "not whole XML"),
        (f'<net version="1.20">\n<edge id="a">{LANE}</edge>\n', 3, "ends too early"),
        (f'<net version="1.20">\n<edge id="a">{LANE}</edge>\n</nut>', 3, "mismatched tag"),
        ("<net></net>", 1, "no version"),
        ('<net version="1.20">\n</net>', 2, "no road"),
        ('<net version="1.20">\n<edge id="a"/>\n</net>', 3, "no road"),
        (f'<net version="1.20">\n<edge id="a" function="internal">{LANE}</edge>\n</net>', 3, "no road"),
        ("\n<nodes>\n</nodes>", 2, "<nodes>, a plain node file"),
        ("<sumoConfiguration/>", 1, "which names a network"),
        ("<html/>", 1, "must be <net>"),
    ],
)
def test_a_broken_network_is_one_fault_with_file_and_line(tmp_path, text, line, words):
    file = tmp_path / "some.net.xml"
    file.write_text(text)
    with pytest.raises(InputError) as error:
        check_net_file(file)
    (fault,) = error.value.faults
    assert fault.startswith(f"{file}:{line}: ")
    assert words in fault
    assert "; must " in fault
    assert "\n" not in fault


def test_a_missing_file_or_a_folder_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        check_net_file(tmp_path / "none.net.xml")
    with pytest.raises(InputError, match="is a folder"):
        check_net_file(tmp_path)


def test_a_gzipped_network_is_read_and_a_truncated_one_refused(tmp_path):
    whole = gzip.compress((NETS / "lab_loop" / "lab_loop.net.xml").read_bytes())
    file = tmp_path / "lab_loop.net.xml.gz"
    file.write_bytes(whole)
    assert Network.read(file).drivable.area == pytest.approx(28)
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"gz:\d+: cannot be read"):
        check_net_file(file)


def test_polygons_are_walls_or_obstacles_by_type_and_others_are_skipped(tmp_path):
    file = tmp_path / "some.poly.xml"
    file.write_text(
        '<additional><poly id="w" type="wall" shape="0,0 1,0"/>'
        '<poly id="o" type="obstacle" fill="1" shape="0,0 1,0 1,1"/>'
        '<poly id="b" type="building.yes" shape="0,0,5 1,0,5 1,1,5"/>'
        '<poly id="l" type="landuse" shape="0,0"/></additional>'
    )
    shapes = read_polygons(file)
    assert [(s.id, s.kind, len(s.coordinates), s.filled) for s in shapes] == [
        ("w", "wall", 2, False),
        ("o", "obstacle", 3, True),
        ("b", "obstacle", 3, False),
    ]


@pytest.mark.parametrize("shape", ["", "0,0", "0,0 1,x", "0,0 1", "0,0 nan,1"])
def test_a_polygon_with_too_few_points_is_named_with_its_line(tmp_path, shape):
    file = tmp_path / "some.poly.xml"
    file.write_text(f'<additional>\n<poly id="w" type="wall" shape="{shape}"/></additional>')
    with pytest.raises(InputError, match=r"poly\.xml:2: poly 'w'.*must be 2 or more points"):
        read_polygons(file)


# ---- lanes and routes


def test_lane_pose_moves_along_a_straight_lane(loop):
    assert loop.edges["sw_se"] == (2.0,)
    for position in (0, 0.5, 2):
        assert loop.lane_pose("sw_se", 0, position) == pytest.approx((2 + position, 0.5, 0))
    assert loop.lane_pose("ne_nw", 0, 0.5) == pytest.approx((3.5, 4.5, np.pi))


def test_lane_pose_follows_a_bend(curves):
    length = curves.edges["e_n"][0]
    x, y, heading = curves.lane_pose("e_n", 0, length / 2)
    ahead = curves.lane_pose("e_n", 0, length / 2 + 0.01)
    assert (ahead[0] - x, ahead[1] - y) == pytest.approx((0.01 * np.cos(heading), 0.01 * np.sin(heading)), abs=1e-3)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (("sw_es", 0, 0), "did you mean 'sw_se'"),
        (("q", 0, 0), "known: ne_nw, "),
        (("sw_se", 1, 0), "must be 0..0"),
        (("sw_se", 0, 2.1), "must be 0..2 m"),
        (("sw_se", 0, float("nan")), "must be 0..2 m"),
    ],
)
def test_lane_pose_names_the_allowed_values(loop, place, words):
    with pytest.raises(InputError, match=words):
        loop.lane_pose(*place)


def test_a_lap_closes_and_follows_the_outer_lane_except_at_corners(loop):
    lap = loop.route_line(LAP, closed=True)
    steps = np.hypot(*np.diff(lap, axis=0).T)
    assert lap[0] == pytest.approx(lap[-1])
    assert 15 < steps.sum() < 18  # each corner is cut from 3.0 to 2.4 m
    assert steps.max() == pytest.approx(2)  # the longest straight: no jump


def test_an_open_route_begins_and_ends_on_its_lanes(world):
    line = world.route_line(["c_s", "s_end", "end_s"])
    assert line[0] == pytest.approx((5.5, 8))
    assert line[-1] == pytest.approx((6.5, 4))


def test_a_route_without_a_connection_names_where_the_edge_leads(loop):
    with pytest.raises(InputError, match=r"no connection from edge 'sw_se' to 'ne_nw'; it leads to: se_ne"):
        loop.route_line(["sw_se", "ne_nw"])
    with pytest.raises(InputError, match="empty"):
        loop.route_line([])


def test_turning_back_on_a_road_needs_a_radius_that_the_vehicle_has():
    """A half circle between lanes 3.2 m apart has a radius of 1.6 m."""
    cross = Network.read(ODD_NETS / "cross.net.xml")
    cross.check_reversals(["north_in", "north_out"], 0.5)
    cross.check_reversals(["north_in", "east_out"], 4.0)
    with pytest.raises(InputError, match=r"turns back from 'north_in' to 'north_out' on a radius of 1\.\d m; .* 4.0 m"):
        cross.check_reversals(["north_in", "north_out"], 4.0)


def test_onward_follows_the_straightest_route(world):
    assert world.onward("sw_s", 3) == ("sw_s", "s_se", "se_e")
    assert world.onward("c_s", 3) == ("c_s", "s_end", "end_s")
    assert world.onward("w_c", 1) == ("w_c",)


# ---- the side of the road


def test_the_outer_lane_of_a_counter_clockwise_loop_is_right_of_the_middle(loop):
    assert right(loop, 3, 0.5, 0) == pytest.approx(0.5)
    assert right(loop, 3, 1.5, 0) == pytest.approx(-0.5)
    assert right(loop, 5.5, 2.5, 90) == pytest.approx(0.5)
    assert right(loop, 5.5, 0.5, 45) == pytest.approx(0.5**0.5)
    assert right(loop, 4.5, 1.5, 45) == pytest.approx(-0.5)


@pytest.mark.parametrize("degrees", [-80, -30, 0, 60])
def test_the_opposite_heading_has_the_opposite_side(curves, degrees):
    rng = np.random.default_rng(1)
    x, y = rng.uniform((0, 0), (10, 8), (500, 2)).T
    heading = np.full(500, np.radians(degrees))
    there, back = curves.right_of_middle(x, y, heading), curves.right_of_middle(x, y, heading + np.pi)
    np.testing.assert_allclose(there, -back)
    assert np.isfinite(there).sum() > 200


@pytest.mark.parametrize("corner", range(4))
def test_a_robot_turning_on_the_spot_in_a_corner_stays_right_of_the_middle(loop, corner):
    arriving = 90.0 * corner
    inward = np.array([(-1, 1), (-1, -1), (1, -1), (1, 1)])[corner]
    point = np.array([(6, 0), (6, 5), (0, 5), (0, 0)])[corner]
    degrees = np.arange(arriving - 10, arriving + 101)
    for across, along in np.ndindex(3, 3):
        x, y = point + inward * (0.3 + 0.3 * across, 0.3 + 0.3 * along)
        sides = loop.right_of_middle(np.full(len(degrees), x), np.full(len(degrees), y), np.radians(degrees))
        assert (sides > 0).all(), (x, y)


def test_a_lap_on_the_right_lane_is_right_of_the_middle_everywhere(curves):
    lap = curves.route_line(["s_e", "e_n", "n_w", "w_s"], closed=True)
    steps = np.diff(lap, axis=0)
    sides = curves.right_of_middle(*lap[:-1].T, np.arctan2(steps[:, 1], steps[:, 0]))
    np.testing.assert_allclose(sides, 0.5, atol=0.02)  # the inner lane has a radius of 0.25 m in four points


def test_inside_intersections_and_off_the_road_there_is_no_side(world):
    assert np.isnan(right(world, 6.5, 9, 90))
    assert np.isnan(right(world, 6, 5, 90))  # where the stub begins
    assert np.isnan(right(world, 3, 11, 0))  # in a block
    assert np.isnan(right(world, 6.5, -0.2, 90))  # behind the end wall
    assert right(world, 6.5, 0.1, 90) == pytest.approx(0.5)
    assert right(world, 6.5, 7, 90) == pytest.approx(0.5)
    assert right(world, 0.5, 13.5, -135) == pytest.approx(0.5**0.5)  # round the corner of two arms


def one_way(folder, lane=LANE):
    """A network of one lane."""
    file = folder / "one_way.net.xml"
    file.write_text(
        '<net version="1.20">'
        '<location netOffset="0,0" convBoundary="0,0,1,0" origBoundary="0,0,1,0" projParameter="!"/>'
        f'<edge id="a" from="p" to="q">{lane}</edge>'
        '<junction id="p" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0"/>'
        '<junction id="q" type="dead_end" x="1" y="0" incLanes="a_0" intLanes="" shape="1,0"/></net>'
    )
    return Network.read(file)


def test_a_network_of_railways_has_no_road(tmp_path):
    rails = one_way(tmp_path, LANE.replace("<lane ", '<lane allow="rail" '))
    with pytest.raises(InputError, match=r"net\.xml: the network has no lane for road vehicles"):
        rails.drivable  # noqa: B018


def test_a_one_way_road_has_no_side(tmp_path):
    network = one_way(tmp_path)
    assert network.drivable.area == pytest.approx(1)
    assert network.middle_lines() == []
    assert np.isnan(right(network, 0.5, 0.2, 0))


def test_a_body_is_on_the_lanes_of_its_edge_and_not_on_those_of_others_or_inside_junctions(loop):
    x, y, _ = loop.lane_pose("sw_se", 0, 1.0)
    body = shapely.box(x - 0.2, y - 0.1, x + 0.2, y + 0.1)
    assert loop.is_on_lanes("sw_se", body)
    assert not loop.is_on_lanes("se_ne", body)
    assert not loop.is_on_lanes("sw_se", shapely.affinity.translate(body, 0, 2 * loop.widest_lane))
    x, y, _ = loop.lane_pose("ne_nw", 0, 0.0)  # where the lane inside the junction ends
    assert not loop.is_on_lanes(":ne_0", shapely.Point(x, y))
    x, y, _ = loop.lane_pose("sw_se", 0, 0.0)
    assert loop.is_on_lanes("sw_se", shapely.Point(x - 0.2, y))
    assert not loop.is_on_lanes("sw_se", shapely.Point(x - 0.4, y))
    assert not loop.is_on_lanes("", body)


def test_the_only_lane_before_another_one():
    """highway: the third lane of e1_e2 ends as the ramp joins, and e2_e3 goes on by two lanes."""
    road = Network.read(shipped.networks()["highway"])
    assert road.only_before("e1_e2_1") == ":e1_0_0"
    assert road.only_before(":e1_0_0") == "e0_e1_0"
    assert road.only_before("e0_e1_0") == ""  # nothing leads there
    grid = Network.read(shipped.networks()["grid"])
    several = [one for one in grid.entered_from.values() if len(grid._net.getLane(one).getOutgoing()) > 1]
    assert several
    assert not any(grid.only_before(lane) in several for lane in grid.entered_from)


def test_the_middle_line_of_the_loop_is_a_ring_through_its_nodes(loop):
    (middle,) = loop.middle_lines()
    assert middle.is_ring
    assert middle.length == pytest.approx(14)


@pytest.mark.parametrize(
    ("pattern", "new", "said"),
    [
        (r"\s*<connection .*?/>", "", "junction 'ne' has 2 requests for 0 connections"),
        ('from="sw" to="se"', 'to="se"', "edge 'sw_se' does not name the junction from which it goes"),
        (r"<connection from=\"sw_se\".*?/>", "", "junction 'se' has 2 requests for 1 connections"),
        (r"<junction .*</junction>", "", "goes from junction 'ne', which is missing"),
        ('from="sw" to="se"', 'from="xx" to="se"', "edge 'sw_se' goes from junction 'xx', which is missing"),
        (r'(<lane id="sw_se_0"[^>]*?) shape="[^"]*"', r"\1", "lane 'sw_se_0' has no shape of two or more points"),
        (r'(<lane id="sw_se_0"[^>]*?) shape="[^"]*"', r'\1 shape="nan,nan 1,1"', "lane 'sw_se_0' has no shape"),
        ('<edge id="se_ne"', '<edge id="sw_se"', "lane 'se_ne_0': is not in its edge"),
    ],
)
def test_an_incomplete_network_is_refused_before_it_kills_the_process(tmp_path, pattern, new, said):
    whole = shipped.networks()["lab_loop"].read_text(encoding="utf-8")
    broken = re.sub(pattern, new, whole, flags=re.DOTALL)
    assert broken != whole
    (tmp_path / "broken.net.xml").write_text(broken)
    with pytest.raises(InputError, match=re.escape(said)):
        Network.read(tmp_path / "broken.net.xml")


def test_a_network_of_an_older_netconvert_is_read(tmp_path):
    """There every lane inside a junction has the index 0."""
    whole = shipped.networks()["grid"].read_text(encoding="utf-8")
    older, count = re.subn(r'(<lane id=":[^"]*_[1-9]") index="[1-9]"', r'\1 index="0"', whole)
    assert count
    (tmp_path / "older.net.xml").write_text(older)
    assert Network.read(tmp_path / "older.net.xml").edges == Network.read(shipped.networks()["grid"]).edges


# ---- its borders


@pytest.mark.parametrize(("width", "tolerance"), [(3.2, 0.01), (2.0, 0.01), (1.0, 0.0)])
def test_kerbs_are_within_a_centimetre_in_streets_and_exact_in_lab_networks(tmp_path, width, tolerance):
    bend = " ".join(f"{50 * np.sin(a):.2f},{50 * np.cos(a):.2f}" for a in np.linspace(0, 1.5, 60))
    network = one_way(tmp_path, LANE.replace('width="1"', f'width="{width}"').replace("0,0 1,0", bend))
    exact = network.outline()
    scenario = SimpleNamespace(spec=SimpleNamespace(scene=SimpleNamespace(walls="outline")), additional=())
    kerbs = static_scene(scenario, network).segments
    moved = shapely.hausdorff_distance(
        shapely.MultiLineString(list(kerbs.reshape(-1, 2, 2))), shapely.MultiLineString(exact), densify=0.1
    )
    assert moved <= tolerance + 1e-6
    assert (len(kerbs) < sum(len(ring.coords) - 1 for ring in exact)) == (tolerance > 0)


def test_only_the_areas_of_large_networks_are_cached(tmp_path, monkeypatch):
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / name)
    file = shipped.networks()["lab_world"]
    new = Network.read(file).drivable
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("platoontraffic.road.network.CACHED_LANES", 20)
    for _ in range(2):
        assert shapely.to_wkb(Network.read(file).drivable) == shapely.to_wkb(new)
        assert len(list((tmp_path / "platoontraffic").iterdir())) == 1


# ---- networks of towns


def test_bus_lanes_are_road_and_footpaths_and_rails_are_not():
    odd = Network.read(ODD / "odd.net.xml")
    assert sorted(odd.edges) == ["buses", "em", "me", "ms", "mw", "sm", "wm"]
    inside = [bool(odd.drivable.contains(shapely.Point(50, y))) for y in (-1.6, -4.8, -7.4, 60)]
    assert inside == [True, True, False, False]
    assert odd.route_line(["wm", "me"], 2)[:, 1] == pytest.approx(-1.6)


def test_in_left_hand_traffic_the_own_lane_is_left_of_the_middle():
    right_hand, left_hand = Network.read(ODD / "odd.net.xml"), Network.read(ODD / "left.net.xml")
    assert right(right_hand, *right_hand.lane_pose("wm", 2, 50)[:2], 0) == pytest.approx(1.6)
    assert right(left_hand, *left_hand.lane_pose("wm", 2, 50)[:2], 0) == pytest.approx(-1.6)
    with pytest.raises(InputError, match=r"must be 0\.\.2, 0 leftmost"):
        left_hand.lane_pose("wm", 3)


@pytest.mark.parametrize(("name", "side"), [("odd", -1), ("left", 1)])
def test_lane_borders_are_half_a_lane_beside_the_inner_lane(name, side):
    network = Network.read(ODD / f"{name}.net.xml")
    x, y, heading = network.lane_pose("wm", 2, 50)
    half = network._net.getEdge("wm").getLane(2).getWidth() / 2
    border = shapely.Point(x - side * half * np.sin(heading), y + side * half * np.cos(heading))
    assert shapely.MultiLineString(network.lane_borders()).distance(border) < 0.01


def test_junctions_are_where_roads_meet(world, loop):
    assert len(world.junctions()) > 1
    assert all(shapely.contains(loop.drivable.buffer(1e-6), area) for area in loop.junctions())


def test_without_lanes_inside_junctions_routes_cross_them_in_straight_lines():
    bare = Network.read(ODD / "bare.net.xml")
    line = bare.route_line(["wm", "me"], 1)
    assert line[:, 1] == pytest.approx(-1.6)
    assert np.diff(line[:, 0]).min() > 0


def test_a_route_begins_on_a_lane_that_is_open_to_the_classes_of_its_vehicles(tmp_path):
    """Straight on, both lanes lead; trucks may not use the right one."""
    file = crossroads(tmp_path)
    text = file.read_text()
    assert 'id="wc_0"' in text
    file.write_text(text.replace('id="wc_0"', 'id="wc_0" disallow="truck"'))
    network = Network.read(file)
    assert network.lane_for(("wc", "ce")) == network.lane_for(("wc", "ce"), {"passenger"}) == 0
    assert network.lane_for(("wc", "ce"), {"passenger", "truck"}) == 1


@pytest.mark.parametrize("x", [-150.0, -8.0, 0.0, 8.0])
def test_a_body_keeps_to_a_lane_up_to_the_margin_beside_it(tmp_path, x):
    """On lanes of 3.2 m, straight across a junction of 4 arms whose inside begins 7 m before its middle."""
    network, width = Network.read(crossroads(tmp_path)), 1.8
    west, y, _ = network.lane_pose("wc", 1)
    x += west + 200.0
    spare = (network.lane_width("wc", 1) - width) / 2 + MARGIN

    def keeps(aside: float, heading: float = 0.0) -> bool:
        body = shapely.box(x - 2.5, y + aside - width / 2, x + 2.5, y + aside + width / 2)
        return network.keeps_to_a_lane(x, y + aside, heading, body)

    assert keeps(0.0)
    assert keeps(spare - 0.02)
    assert keeps(0.02 - spare)
    assert not keeps(spare + 0.02)
    assert not keeps(-spare - 0.02)
    assert not keeps(0.0, heading=math.pi)


def test_inside_a_junction_a_vehicle_is_on_no_lane():
    network = Network.read(NETS / "grid" / "grid.net.xml")
    points, _, (line, *_) = network.route_lanes(network.onward("A0_A1", 2))
    before, middle, beyond = Polyline(points).at(line.station + np.array([-1.0, line.across / 2, line.across + 1.0]))
    heading = math.atan2(*(beyond - before)[::-1])
    assert network.lane_headed(*before, heading) is not None
    assert network.lane_headed(*middle, heading) is None
