"""From lanes and junctions to kerbs: where they are, how exact they are, and how they are kept."""

import contextlib
import math
import multiprocessing
import shutil
from collections import defaultdict
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
import shapely
import sumolib
from shapely.ops import substring

from platoontraffic import shipped
from platoontraffic.lidar import Boxes, Carriers, LidarModel, Scene, kerbs, scan

RIGHT_AHEAD_LEFT = LidarModel(3, -math.pi / 2, math.pi / 2, 0.01, 500.0)


class Town(NamedTuple):
    """Lanes and what is known of them."""

    lanes: list  # centre lines, (k, 2) each
    widths: list
    junctions: list
    sides: list  # of each lane: distance of its centre line from the right and the left kerb
    ways: list  # lines across the junctions


def city(n=4, block=60.0, width=3.2):
    """n by n junctions, two lanes each way between neighbours, all of it turned a little."""
    half, turn = 2 * width, np.exp(0.3j)
    lanes, sides, ways, junctions = [], [], [], []
    for node in (complex(i, j) for i in range(n) for j in range(n)):
        corners = block * node + half * np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
        junctions.append(shapely.Polygon(plane(turn * corners)))
        arms = [u for u in (1, 1j, -1, -1j) if 0 <= (node + u).real < n and 0 <= (node + u).imag < n]
        for u in arms:
            for k in range(2):
                right = (k + 0.5) * width  # to the right of the middle
                ends = [block * node + u * (half - 1j * right), block * (node + u) - u * (half + 1j * right)]
                lanes.append(plane(turn * np.array(ends)))
                sides.append((half - right, half + right))
                # in over arm u, out over each other one on the same lane
                outs = [block * node + v * (half - 1j * right) for v in arms if v != u]
                ways += [plane(turn * np.array([block * node + u * (half + 1j * right), out])) for out in outs]
    return Town(lanes, [width] * len(lanes), junctions, sides, ways)


def network(name):
    """A network that SUMO's tool made."""
    net = sumolib.net.readNet(str(shipped.networks()[name]), withInternal=True)
    road = [edge for edge in net.getEdges(withInternal=False) if edge.getLaneNumber()]
    lanes = [lane for edge in road for lane in edge.getLanes()]
    widths = defaultdict(float)
    for lane in lanes:
        widths[frozenset((lane.getEdge().getFromNode().getID(), lane.getEdge().getToNode().getID()))] += lane.getWidth()
    sides = []
    for lane in lanes:
        edge = lane.getEdge()
        right = sum(other.getWidth() for other in edge.getLanes()[: lane.getIndex()]) + lane.getWidth() / 2
        sides.append((right, widths[frozenset((edge.getFromNode().getID(), edge.getToNode().getID()))] - right))
    areas = [shapely.Polygon(node.getShape()).buffer(0) for node in net.getNodes() if len(node.getShape()) >= 3]
    links = [link for edge in road for out in edge.getOutgoing().values() for link in out]
    ways = [
        net.getLane(link.getViaLaneID()) for link in links if link.getTo().getToNode() != link.getFrom().getFromNode()
    ]
    return Town(
        [np.array(lane.getShape()) for lane in lanes],
        [lane.getWidth() for lane in lanes],
        areas,
        sides,
        [np.array(w.getShape()) for w in ways],
    )


TOWNS = {"city": city, **{name: lambda name=name: network(name) for name in ("lab_curves", "lab_loop", "lab_world")}}


@pytest.fixture(params=TOWNS)
def town(request):
    return TOWNS[request.param]()


@pytest.fixture(params=[0.0, 0.01])
def tolerance(request):
    return request.param


def plane(points):
    return np.stack([points.real, points.imag], axis=1)


def drivable(town, cache=None):
    return kerbs.drivable(town.lanes, town.widths, town.junctions, cache)


def look(scene, places, headings):
    """Ranges to the right, ahead and to the left, (n, 3)."""
    x, y = np.transpose(places)
    carriers = Carriers(x, y, headings, np.arange(len(x)))
    return scan(RIGHT_AHEAD_LEFT, scene, Boxes.empty(), carriers, engine="numpy", dtype=float).ranges


def bearing(line):
    return math.atan2(*(line[-1] - line[0])[::-1])


# ---- where kerbs are


def test_area_is_valid_and_is_that_of_streets_and_junctions():
    town = city()
    area = drivable(town)
    assert area.is_valid
    assert area.area == pytest.approx(16 * 12.8**2 + 24 * 12.8 * (60 - 12.8), rel=1e-6)


def test_every_area_is_valid_in_one_part_and_keeps_its_lanes(town):
    area = drivable(town)
    assert area.is_valid
    assert area.geom_type == "Polygon"
    assert all(area.buffer(1e-5).covers(shapely.LineString(lane)) for lane in town.lanes)


def test_blocks_of_a_city_have_four_kerbs_each():
    rings = kerbs.borders(drivable(city()))
    assert len(rings) == 10
    assert len(Scene.from_shapely(rings).segments) == 40


def test_slits_between_lanes_are_closed_and_gaps_are_not():
    def rings(gap):
        return kerbs.borders(kerbs.drivable([[(0, 0), (9, 0)], [(0, 3 + gap), (9, 3 + gap)]], [3, 3]))

    assert [len(rings(gap)) for gap in (0, 0.09, 0.11)] == [1, 1, 2]


def test_no_kerb_crosses_a_centre_line(town, tolerance):
    walls = shapely.MultiLineString(kerbs.borders(drivable(town), tolerance))
    for line in map(shapely.LineString, [*town.lanes, *town.ways]):
        inner = substring(line, 1e-3, line.length - 1e-3)  # dead ends touch their kerb
        assert not walls.intersects(inner)


def test_sensor_sees_the_kerbs_left_and_right_of_its_lane(town, tolerance):
    scene = Scene.from_shapely(kerbs.borders(drivable(town), tolerance))
    # amid the longest straight piece of each lane: in a bend the other kerb may be round the corner
    steps = [max(pairwise(np.array(lane)), key=lambda step: np.hypot(*(step[1] - step[0]))) for lane in town.lanes]
    steps = np.array(steps)
    ranges = look(scene, steps.mean(axis=1), [bearing(step) for step in steps])
    np.testing.assert_allclose(ranges[:, [0, 2]], town.sides, atol=0.01 + tolerance)


def test_nothing_is_across_the_path_inside_a_junction(town, tolerance):
    scene = Scene.from_shapely(kerbs.borders(drivable(town), tolerance))
    steps = np.array([step for way in town.ways for step in pairwise(way)])
    ahead = look(scene, steps[:, 0], [bearing(step) for step in steps])[:, 1]
    assert (ahead > np.hypot(*(steps[:, 1] - steps[:, 0]).T)).all()


def test_no_solid_is_lost_where_they_touch():
    town = city()
    lanes = shapely.linestrings(town.lanes)
    scene = Scene.from_shapely(solids=[*shapely.buffer(lanes, 1.6, cap_style="flat"), *town.junctions])
    assert scene.enclosed(*shapely.get_coordinates(shapely.centroid(lanes)).T).all()


# ---- how exact they are


def winding_road():
    s = np.linspace(0, 200, 400)
    return kerbs.drivable([np.stack([s, 20 * np.sin(s / 20)], axis=1)], [6])


def test_simplified_borders_stay_within_the_tolerance():
    area = winding_road()
    exact = shapely.MultiLineString(kerbs.borders(area))
    vertices = []
    for tolerance in (0.0, 1e-3, 1e-2, 5e-2):
        rings = kerbs.borders(area, tolerance)
        assert all(ring.is_closed for ring in rings)
        assert shapely.Polygon(rings[0]).is_valid
        moved = shapely.hausdorff_distance(shapely.MultiLineString(rings), exact, densify=0.5)
        assert moved <= tolerance + 1e-12
        vertices.append(shapely.get_num_coordinates(rings).sum())
    assert vertices == sorted(set(vertices), reverse=True)


def test_borders_without_a_tolerance_are_those_of_the_area():
    holed = shapely.box(0, 0, 9, 9).difference(shapely.box(3, 3, 6, 6))
    assert shapely.equals_exact(shapely.Polygon(*(lambda r: (r[0], r[1:]))(kerbs.borders(holed))), holed)
    assert len(kerbs.borders(shapely.MultiPolygon([holed, shapely.box(20, 0, 21, 1)]))) == 3


# ---- how they are kept


@pytest.fixture
def kept(tmp_path):
    """A small town, its area, and the folder where that is kept."""
    town = city(2)
    return town, drivable(town, tmp_path / "cache"), tmp_path / "cache"


def test_kept_area_is_the_same_to_the_byte_and_not_made_again(kept, monkeypatch):
    town, area, folder = kept
    assert shapely.to_wkb(drivable(town)) == shapely.to_wkb(area)
    monkeypatch.setattr(shapely, "buffer", lambda *args, **kwargs: pytest.fail("made again"))
    assert shapely.to_wkb(drivable(town, folder)) == shapely.to_wkb(area)


def test_other_input_is_another_file(kept, monkeypatch):
    town, _, folder = kept
    moved = [town.lanes[0] + 1e-9, *town.lanes[1:]]
    others = [
        town._replace(lanes=moved),
        town._replace(widths=[3.3, *town.widths[1:]]),
        town._replace(junctions=town.junctions[1:]),
        town._replace(lanes=town.lanes[1:], widths=town.widths[1:]),
    ]
    for number, other in enumerate(others, start=2):
        assert shapely.to_wkb(drivable(other, folder)) == shapely.to_wkb(drivable(other))
        assert len(list(folder.iterdir())) == number
    monkeypatch.setattr(kerbs, "VERSION", -1)
    drivable(town, folder)
    assert len(list(folder.iterdir())) == 6


DAMAGE = {
    "empty": lambda content: b"",
    "cut": lambda content: content[:-20],
    "cut to a few bytes": lambda content: content[:7],
    "other numbers": lambda content: content[:40] + b"\0\0\0\0" + content[44:],
    "not a geometry": lambda content: b"<html>" * 20,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_file_is_made_again(kept, damage):
    town, area, folder = kept
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(DAMAGE[damage](whole))
    assert shapely.to_wkb(drivable(town, folder)) == shapely.to_wkb(area)
    assert file.read_bytes() == whole


@pytest.mark.parametrize("fault", ["a file in its place", "not to be written", "full disk"])
def test_folder_that_cannot_be_used_is_no_error(kept, fault, monkeypatch):
    town, area, folder = kept
    shutil.rmtree(folder)
    if fault == "a file in its place":
        folder.write_text("")
    elif fault == "not to be written":
        folder.mkdir(mode=0o500)
    else:
        monkeypatch.setattr(kerbs.os, "replace", lambda *names: (_ for _ in ()).throw(OSError(28, "no space")))
    assert shapely.to_wkb(drivable(town, folder)) == shapely.to_wkb(area)
    if fault == "full disk":
        assert list(folder.iterdir()) == []


def _write_again_and_again(file, n):
    for _ in range(n):
        file.unlink(missing_ok=True)
        kerbs._kept(file, lambda: shapely.Point(0, 0).buffer(1, quad_segs=50_000))


def test_two_processes_write_at_once_and_a_reader_finds_the_whole_file_or_none(tmp_path):
    file = tmp_path / "area.wkb"
    _write_again_and_again(file, 1)
    whole = file.read_bytes()
    spawn = multiprocessing.get_context("spawn")
    writers = [spawn.Process(target=_write_again_and_again, args=(file, 30)) for _ in range(2)]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        with contextlib.suppress(FileNotFoundError):
            assert file.read_bytes() == whole
    assert [writer.exitcode for writer in writers] == [0, 0]
    assert list(tmp_path.iterdir()) == [file]
