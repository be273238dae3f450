"""The meaning of a scan, and who may ask for one."""

import copy
import dataclasses
import json
import math
import pickle
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.lidar import ENGINES, PRESETS, Boxes, Carriers, LidarModel, Mount, Noise, Occasion, Scene, scan
from platoontraffic.lidar.pose import compose, wrap
from tests.support.oracle import endpoint_miss, grazing, world

INF = math.inf
THREE = LidarModel(3, -math.pi / 2, math.pi / 2, 0.5, 10.0)
MIDDLE = 1
ORIGIN = Carriers(0, 0, 0, 0)


@pytest.fixture(params=ENGINES)
def look(request):
    """Scan with THREE beams, right, ahead and left, from one pose; owner 0."""

    def look(scene, boxes, x=0.0, y=0.0, heading=0.0, owner=0, model=THREE):
        return scan(model, scene, boxes, Carriers(x, y, heading, owner), engine=request.param)

    return look


def test_nothing_there_is_plus_infinity(look):
    batch = look(*world([(11, -5, 11, 5)]))
    assert (batch.ranges == INF).all()
    assert (batch.hits == -2).all()


def test_object_nearer_than_range_min_blocks_what_is_behind(look):
    batch = look(*world([(3, -1, 3, 1)], [(0.4, 0, 0, 0.2, 0.2, 5)]))
    assert batch.ranges[0, MIDDLE] == -INF
    assert batch.hits[0, MIDDLE] == 5


@pytest.mark.parametrize("limit", [0.3, 0.7, 1.0, 3.0, 29.9])
def test_exactly_at_a_limit_is_a_hit(look, limit):
    near = dataclasses.replace(THREE, range_min=limit, range_max=2 * limit)
    far = dataclasses.replace(THREE, range_min=0.1, range_max=limit)
    for model in (near, far):
        assert look(*world([(limit, -1.1, limit, 0.7)]), model=model).ranges[0, MIDDLE] == np.float32(limit)


@pytest.mark.parametrize("boxes", [[(1, 0, 0.3, 4, 2, 3)], [(0, 1, 0, 2, 2, 3)]], ids=["inside", "on a face"])
def test_inside_another_box_every_beam_is_minus_infinity(look, boxes):
    batch = look(*world([(3, -1, 3, 1)], boxes))
    assert batch.inside.tolist() == [True]
    assert (batch.ranges == -INF).all()
    assert (batch.hits == 3).all()


def test_inside_a_static_solid_or_on_a_wall_every_beam_is_minus_infinity(look):
    solid = Scene.from_shapely(solids=[shapely.box(-1, -1, 1, 1)])
    for scene in (solid, world([(-1, -1, 1, 1)])[0]):
        batch = look(scene, Boxes.empty())
        assert batch.inside[0]
        assert (batch.ranges == -INF).all()
        assert (batch.hits == -1).all()


def test_walls_around_a_free_area_do_not_enclose(look):
    room = Scene.from_shapely(walls=[shapely.box(-2, -2, 2, 2)])
    batch = look(room, Boxes.empty())
    assert not batch.inside[0]
    np.testing.assert_allclose(batch.ranges[0], 2.0)


def test_own_vehicle_and_own_trailer_are_never_seen(look):
    scene, boxes = world([(8, -1, 8, 1)], [(0, 0, 0, 4, 2, 0), (4, 0, 0, 2, 2, 0), (6, 0, 0, 1, 1, 1)])
    batch = look(scene, boxes)
    assert not batch.inside[0]
    assert batch.ranges[0, MIDDLE] == 5.5
    assert batch.hits[0, MIDDLE] == 1
    assert look(scene, boxes, x=-4, owner=1).ranges[0, MIDDLE] == 2.0


def test_mount_turns_with_the_body(look):
    model = dataclasses.replace(THREE, mount=Mount(1.0, -0.5, math.pi / 2))
    batch = look(*world([(-20, 4, 20, 4), (-5, -20, -5, 20)]), heading=math.pi / 2, model=model)
    # The body looks north, the sensor sits at (0.5, 1) and looks west: its right-hand beam points north.
    np.testing.assert_allclose(batch.ranges[0], [3.0, 5.5, INF])


def test_own_rows_have_own_poses(look):
    batch = look(*world([(8, -9, 8, 9)]), x=[0, 2], y=[0, 1], heading=[0, 0], owner=[0, 1])
    np.testing.assert_allclose(batch.ranges[:, MIDDLE], [8, 6])


def test_ranges_are_float32_unless_asked_otherwise():
    scene, boxes = world([(3.3, -1, 3.3, 1)])
    assert scan(THREE, scene, boxes, ORIGIN).ranges.dtype == np.float32
    assert scan(THREE, scene, boxes, ORIGIN, dtype=np.float64).ranges[0, MIDDLE] == 3.3


def two_scans():
    scene, boxes = world([(3, -1, 3, 1), (-1, 0.2, 1, 0.2)])
    carriers = Carriers([0, 0], [0, -3], [0, 0], [0, 1], ids=["veh.3", "veh.1"])
    return scan(THREE, scene, boxes, carriers, Occasion(stamp=2.5))


def test_filled_puts_limits_in_place_of_infinities():
    batch = two_scans()
    np.testing.assert_array_equal(batch.ranges[0], np.float32([INF, 3, -INF]))
    np.testing.assert_array_equal(batch["veh.3"].filled(), [10, 3, 0.5])
    np.testing.assert_array_equal(batch["veh.3"].filled(no_return=20, too_close=0), [20, 3, 0])
    np.testing.assert_array_equal(batch.filled()[0], batch[0].filled())
    assert batch.filled().dtype == np.float64
    erroneous = dataclasses.replace(batch[0], ranges=np.array([1, math.nan, 2]))
    np.testing.assert_array_equal(erroneous.filled(), [1, 10, 2])
    np.testing.assert_array_equal(erroneous.filled(error=-1), [1, -1, 2])


def test_scan_is_a_view_of_its_row():
    batch = two_scans()
    one = batch["veh.1"]
    assert one.ranges.base is batch.ranges
    assert np.shares_memory(one.hits, batch.hits[1])
    assert (one.frame_id, one.stamp, one.scan_time, one.time_increment) == ("veh.1", 2.5, 1 / 40, 0.0)
    assert [s.frame_id for s in batch] == ["veh.3", "veh.1"]
    assert len(batch) == 2


def test_rows_keep_ids_and_ranges_together():
    batch = two_scans()
    swapped = batch.rows([1, 0])
    assert swapped.ids == ("veh.1", "veh.3")
    np.testing.assert_array_equal(swapped["veh.3"].ranges, batch["veh.3"].ranges)


def test_rows_are_chosen_by_mask_or_id_as_well():
    batch = two_scans()
    for which in (np.array([False, True]), ["veh.1"], [1], [-1]):
        assert batch.rows(which).ids == ("veh.1",)
    assert len(batch.rows([])) == 0
    for which in ([0.5], np.array([True]), np.array([True, False, True])):
        with pytest.raises(TypeError, match="rows are given as"):
            batch.rows(which)
    with pytest.raises(TypeError):
        batch[0:1]


def test_points_are_where_the_walls_are():
    one = two_scans()["veh.3"]
    np.testing.assert_array_equal(one.valid(), [False, True, False])
    np.testing.assert_allclose(one.points(), [[3, 0]], atol=1e-12)


@pytest.mark.parametrize("model", [*PRESETS.values(), LidarModel(1081, -2.356, 2.356, 0.1, 30)])
def test_last_beam_is_first_plus_increments(model):
    one = scan(model, *world(), ORIGIN)[0]
    assert one.angle_max == pytest.approx(one.angle_min + one.angle_increment * (len(one.ranges) - 1), abs=1e-12)
    np.testing.assert_array_equal(one.angles(), model.angles)


def test_presets_are_those_of_the_paper():
    leader, follower = PRESETS["paper-leader"], PRESETS["paper-follower"]
    assert (leader.samples, leader.range_min, leader.range_max, leader.rate) == (720, 0.30, 3.0, 40.0)
    assert (follower.samples, follower.range_min, follower.range_max, follower.rate) == (720, 0.30, 1.0, 40.0)
    np.testing.assert_allclose(np.degrees([leader.angle_min, leader.angle_max]), [-90, 90])
    np.testing.assert_allclose(np.degrees([follower.angle_min, follower.angle_max]), [-11.5, 11.5])
    assert hash(leader) == hash(dataclasses.replace(leader)) != hash(follower)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("samples", 1),
        ("samples", 2.5),
        ("angle_max", -2.0),
        ("angle_max", 5.0),
        ("angle_min", math.nan),
        ("range_min", -0.1),
        ("range_min", 10.0),
        ("range_max", INF),
        ("rate", 0.0),
    ],
)
def test_bad_model_is_refused_by_the_name_of_its_field(field, value):
    named = field if (field, value) != ("angle_max", 5.0) else "field of view"
    if (field, value) == ("range_min", 10.0):
        named = "range_max"
    with pytest.raises(ValueError, match=named):
        dataclasses.replace(THREE, **{field: value})


def test_bad_mount_is_refused():
    with pytest.raises(ValueError, match="yaw"):
        Mount(yaw=math.nan)


def test_bad_pose_is_refused_by_id():
    with pytest.raises(ValueError, match=r"veh\.7"):
        Carriers([0, math.nan], [0, 0], [0, 0], [0, 1], ids=["veh.1", "veh.7"])


@pytest.mark.parametrize(
    "solid", [shapely.Point(0, 0), shapely.GeometryCollection([shapely.box(0, 0, 1, 1), shapely.Point(3, 3)])]
)
def test_solids_without_an_inside_are_refused(solid):
    with pytest.raises(ValueError, match="solids is a Point; must be one of Polygon, MultiPolygon"):
        Scene((), solid)


def test_misspelt_engine_is_corrected():
    with pytest.raises(ValueError, match=r"did you mean 'numpy'\? must be one of raster, numpy, pymunk, shapely"):
        scan(THREE, *world(), ORIGIN, engine="nunpy")


def test_shapes_and_ids_must_match():
    with pytest.raises(ValueError, match="shapes"):
        Carriers([0, 1], 0, 0, 0)
    with pytest.raises(ValueError, match="ids"):
        Carriers([0, 1], [0, 1], [0, 1], [0, 1], ids=["a", "a"])


@pytest.mark.parametrize(
    "row", [(math.nan, 0, 0, 4, 2, 1), (0, 0, INF, 4, 2, 1), (0, 0, 0, 0, 2, 1), (0, 0, 0, 4, 2, -1)]
)
def test_bad_box_is_refused(row):
    with pytest.raises(ValueError, match="must be"):
        world(boxes=[row])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x": [[0.0]], "y": [[0.0]], "heading": [[0.0]], "owner": [[0]]}, "one value a sensor"),
        ({"x": 2e12}, "within 1e\\+12 m"),
        ({"owner": 2**32 + 1}, "owner = 4294967297; must be a whole number"),
        ({"owner": 1.5}, "owner = 1.5; must be a whole number"),
        ({"owner": 2**31 - 1}, "owner = 2147483647; must be"),
        ({"vx": np.zeros(3)}, "vx = .*; must be finite, one value or one a sensor"),
        ({"vy": math.nan}, "vy = nan"),
    ],
)
def test_bad_carrier_is_refused(change, said):
    with pytest.raises(ValueError, match=said):
        Carriers(**{"x": 0.0, "y": 0.0, "heading": 0.0, "owner": 0} | change)


def test_bad_dtype_or_number_of_a_scan_is_refused():
    with pytest.raises(ValueError, match="must be float32 or float64"):
        scan(THREE, *world(), ORIGIN, dtype=int)
    with pytest.raises(ValueError, match="number = -1; must be 0 or more"):
        scan(THREE, *world(), ORIGIN, Occasion(number=-1))


def test_numbers_of_numpy_are_numbers():
    noisy = dataclasses.replace(THREE, noise=Noise(0.01))
    scene = world([(3, -1, 3, 1)])
    plain = scan(noisy, *scene, ORIGIN, Occasion(number=2, seed=3)).ranges
    same = Occasion(number=np.int64(2), seed=np.int64(3))
    np.testing.assert_array_equal(scan(noisy, *scene, ORIGIN, same).ranges, plain)
    with pytest.raises(TypeError):
        scan(noisy, *scene, ORIGIN, Occasion(number=2.0))


def test_result_overwrites_a_batch_that_fits():
    scene, two = world([(3, -1, 3, 1)]), Carriers([0, 1], [0, 0], [0, 0], [0, 1])
    first = scan(THREE, *scene, two)
    again = scan(THREE, *scene, dataclasses.replace(two, x=[1, 2]), out=first)
    assert again.ranges is first.ranges
    assert again.ranges[:, MIDDLE].tolist() == [2, 1]
    with pytest.raises(ValueError, match="read-only"):
        again.ranges[0] = 0
    for other in (
        scan(dataclasses.replace(THREE, range_max=9), *scene, two),
        scan(THREE, *scene, ORIGIN),
        dataclasses.replace(first, hits=None),
    ):
        with pytest.raises(ValueError, match=r"out has ranges .*; must be"):
            scan(THREE, *scene, two, out=other)
    view = dataclasses.replace(first, ranges=first.ranges[:], hits=first.hits[:])
    with pytest.raises(ValueError, match="out holds views"):
        scan(THREE, *scene, two, out=view)


def test_copies_and_pickles_are_the_same_and_read_only():
    scene, boxes = world([(3, -1, 3, 1)], [(2, 2, 0.3, 4, 2, 5)])
    batch = scan(THREE, scene, boxes, ORIGIN)
    for copied in (copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))):
        again = scan(copied(THREE), copied(scene), copied(boxes), ORIGIN)
        np.testing.assert_array_equal(again.ranges, batch.ranges)
        assert not copied(scene).segments.flags.writeable
        assert not copied(boxes).x.flags.writeable
        assert not copied(THREE).angles.flags.writeable


def test_message_has_the_fields_of_ros():
    one = two_scans()["veh.3"]
    message = one.to_ros_dict()
    assert list(message) == [
        "header", "angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max",
        "ranges", "intensities",
    ]  # fmt: skip
    assert message["header"] == {"stamp": {"sec": 2, "nanosec": 500_000_000}, "frame_id": "veh.3"}
    assert message["ranges"] == [INF, 3.0, -INF]
    assert json.loads(json.dumps(message))["angle_max"] == one.angle_max


def test_message_holds_plain_floats_whatever_the_numbers_of_the_model():
    model = LidarModel(3, -1, np.float32(1), 0, np.int64(10), rate=np.float32(10))
    message = scan(model, *world([(3, -1, 3, 1)]), ORIGIN, Occasion(np.float32(2.5)))[0].to_ros_dict()
    assert message["header"]["stamp"] == {"sec": 2, "nanosec": 500_000_000}
    numbers = [value for name, value in message.items() if name not in ("header", "ranges", "intensities")]
    assert {type(value) for value in (*numbers, *message["ranges"])} == {float}
    by_hand = dataclasses.replace(two_scans()[0], range_max=np.float32(10), angle_min=-1).to_ros_dict()
    assert (type(by_hand["range_max"]), type(by_hand["angle_min"])) == (float, float)
    assert json.loads(json.dumps(message))["range_max"] == 10.0


def test_scans_carry_the_name_of_their_scanner():
    scene, carriers = world([(3, -1, 3, 1)]), Carriers(0, 0, 0, 0, ids="veh.3")
    batches = [scan(model, *scene, carriers) for model in (THREE, dataclasses.replace(THREE, name="rear"))]
    assert [batch.name for batch in batches] == [batch["veh.3"].name for batch in batches] == ["lidar", "rear"]
    assert [batch[0].frame_id for batch in batches] == ["veh.3", "veh.3/rear"]
    assert batches[1][0].to_ros_dict()["header"]["frame_id"] == "veh.3/rear"
    assert batches[1].rows([0]).name == "rear"


@pytest.mark.parametrize("name", ["", None, 3])
def test_scanner_without_a_name_is_refused(name):
    with pytest.raises(ValueError, match=r"name = .*; must be a text"):
        dataclasses.replace(THREE, name=name)


def test_carriers_of_boxes_have_their_poses_owners_and_motion():
    boxes = Boxes([1, 2, 3], [4, 5, 6], [0.1, 0.2, 0.3], 4, 2, [7, 8, 9], vx=[1, 2, 3], vy=0.5, yaw_rate=-0.1)
    two = Carriers.of(boxes, np.array([2, 0]), ["c", "a"])
    assert (two.x.tolist(), two.y.tolist(), two.heading.tolist()) == ([3, 1], [6, 4], [0.3, 0.1])
    assert (two.owner.tolist(), two.ids) == ([9, 7], ("c", "a"))
    assert (two.vx.tolist(), two.vy.tolist(), two.yaw_rate.tolist()) == ([3, 1], [0.5, 0.5], [-0.1, -0.1])
    assert len(Carriers.of(boxes)) == 3


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("order", [(5, 3, 8), (8, 5, 3), (3, 8, 5)])
def test_smallest_of_equally_near_owners_is_hit(engine, order):
    scene, boxes = world(boxes=[(4, 0, 0, 2, 2, owner) for owner in order])
    assert scan(THREE, scene, boxes, ORIGIN, engine=engine).hits[0, MIDDLE] == 3
    on_wall = world([(3, -1, 3, 1)], [(4, 0, 0, 2, 2, owner) for owner in order])
    assert scan(THREE, *on_wall, ORIGIN, engine=engine).hits[0, MIDDLE] == -1


def test_sensor_just_off_a_corner_both_ways_touches_the_box_in_every_engine():
    near = 0.9e-9
    for turn in (0.0, 0.4):
        scene, boxes = world(boxes=[(0, 0, turn, 2, 2, 3)])
        x, y = (1 + near) * (math.cos(turn) - math.sin(turn)), (1 + near) * (math.sin(turn) + math.cos(turn))
        for engine in ENGINES:
            assert scan(THREE, scene, boxes, Carriers(x, y, 0.0, 0), engine=engine).inside[0], engine


def test_id_that_is_not_in_the_batch_is_named():
    for ask in (lambda batch: batch["veh.9"], lambda batch: batch.rows(["veh.9"])):
        with pytest.raises(KeyError, match=r"'veh\.9' is not among the 2 ids"):
            ask(two_scans())


def test_points_in_a_given_frame():
    one = two_scans()["veh.3"]
    np.testing.assert_allclose(one.points(sensor=(10, 20, math.pi / 2)), [[10, 23]], atol=1e-12)


def test_bad_segment_is_refused_and_empty_one_dropped():
    with pytest.raises(ValueError, match="segment 1"):
        world([(0, 0, 1, 1), (0, 0, INF, 1)])
    assert world([(1, 1, 1, 1), (0, 0, 1, 1)])[0].segments.tolist() == [[0, 0, 1, 1]]


def test_scene_takes_lines_rings_holes_and_parts():
    ring = shapely.LinearRing([(0, 0), (1, 0), (0, 1)])
    holed = shapely.box(0, 0, 9, 9).difference(shapely.box(3, 3, 6, 6))
    two = shapely.MultiLineString([[(0, 0), (1, 1)], [(2, 2), (3, 3), (4, 2)]])
    assert len(Scene.from_shapely([ring]).segments) == 3
    assert len(Scene.from_shapely([two], [holed]).segments) == 3 + 8
    assert len(Scene.from_shapely(ring, holed).segments) == 3 + 8


@pytest.mark.parametrize(
    ("walls", "solids", "said"),
    [
        ([shapely.Point(0, 0)], [], r"walls\[0\] is a Point; must be one of LineString"),
        ([], [shapely.LineString([(0, 0), (1, 1)])], r"solids\[0\] is a LineString; must be one of Polygon"),
        ([None], [], r"walls\[0\] is a NoneType"),
        ([], [shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])], r"solids\[0\]: Self-intersection"),
    ],
)
def test_scene_takes_nothing_else(walls, solids, said):
    with pytest.raises(ValueError, match=said):
        Scene.from_shapely(walls, solids)
    with pytest.raises(ValueError, match="tolerance = nan"):
        Scene.from_shapely([], tolerance=math.nan)
    with pytest.raises(ValueError, match="must be one shapely geometry"):
        Scene(np.empty((0, 4)), [shapely.box(0, 0, 1, 1)])
    with pytest.raises(ValueError, match=r"shape \(4,\); must be \(m, 4\)"):
        Scene(np.zeros(4))


# ---- few segments for the same walls


def cut(line, rng):
    """A line in pieces of random lengths and senses."""
    cuts = np.sort(rng.random(rng.integers(1, 20)))
    points = [*shapely.line_interpolate_point(line, [0, *cuts, 1], normalized=True), *map(shapely.Point, line.coords)]
    points = sorted(points, key=line.project)
    if line.is_closed:
        points.append(points[0])
    pieces = [shapely.LineString(two if rng.random() < 0.5 else two[::-1]) for two in pairwise(points)]
    return [pieces[i] for i in rng.permutation(len(pieces)) if pieces[i].length]


def lines_of(scene):
    return shapely.MultiLineString(list(scene.segments.reshape(-1, 2, 2)))


@pytest.mark.parametrize("seed", range(20))
def test_pieces_of_straight_walls_become_one_and_scans_stay(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-20, 20, (4, 6, 2)) + rng.choice([0, 1e4])
    walls = [*map(shapely.LineString, corners[:2]), *map(shapely.LinearRing, corners[2:])]
    pieces = [piece for wall in walls for piece in cut(wall, rng)]
    straight, rugged = Scene.from_shapely(pieces), Scene(np.array([p.coords for p in pieces]).reshape(-1, 4))
    assert len(straight.segments) == 2 * 5 + 2 * 6 < len(rugged.segments)
    assert shapely.hausdorff_distance(lines_of(straight), lines_of(rugged), densify=0.01) <= 1e-6

    x, y = corners.mean(axis=(0, 1))[:, None] + rng.uniform(-20, 20, (2, 5))
    model, carriers = LidarModel(360, -math.pi, math.pi, 0.01, 100.0), Carriers(x, y, np.zeros(5), np.arange(5))
    a, b = (
        scan(model, scene, Boxes.empty(), carriers, engine="numpy", dtype=float).ranges for scene in (straight, rugged)
    )
    for i in range(5):
        place = (model, straight, Boxes.empty(), x[i], y[i], 0.0, 0)
        clear = endpoint_miss(*place) > 1e-4  # a beam may just pass the end of a wall that has moved
        np.testing.assert_array_equal(np.isfinite(a[i, clear]), np.isfinite(b[i, clear]))
        seen = clear & np.isfinite(a[i])
        assert seen.any()
        assert (np.abs(a[i, seen] - b[i, seen]) <= 1e-6 / grazing(*place)[seen]).all()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-3, 0.1])
def test_walls_move_no_further_than_the_tolerance(tolerance):
    angle = np.linspace(0, 2 * np.pi, 2000)
    bent = np.random.default_rng(1).normal(0, tolerance / 3, (2, 2000))
    round_, rough = shapely.LinearRing(10 * np.exp(1j * angle).view(float).reshape(-1, 2)), np.linspace(0, 30, 2000)
    walls = [round_, shapely.LineString(np.stack([rough, 20 + bent[0]], axis=1))]
    scene = Scene.from_shapely(walls, tolerance=tolerance)
    assert len(scene.segments) < sum(len(wall.coords) - 1 for wall in walls)
    assert shapely.hausdorff_distance(lines_of(scene), shapely.MultiLineString(walls), densify=0.5) <= tolerance


def test_ring_that_begins_amid_a_wall_stays_closed_with_its_corners_only():
    square = shapely.LinearRing([(1, 0), (2, 0), (2, 1), (2, 2), (0.5, 2), (0, 2), (-1e-12, 1), (0, 0)])
    segments = Scene.from_shapely([square]).segments
    assert len(segments) == 4
    assert (
        sorted(map(tuple, segments[:, :2])) == sorted(map(tuple, segments[:, 2:])) == [(0, 0), (0, 2), (2, 0), (2, 2)]
    )


def test_midpoint_of_a_wall_parallel_to_the_line_between_its_ends_goes_too():
    u = np.array([(0, 0), (0, 1), (0.3, 1), (0.5, 1 + 1e-9), (0.7, 1), (1, 1), (1, 0)])
    assert len(Scene.from_shapely([shapely.LineString(u)]).segments) == 3


def test_point_where_three_walls_meet_stays_though_two_are_in_line():
    bent = shapely.LineString([(0, 0), (5, 4e-7), (10, 0)])
    leg = shapely.LineString([(5, 4e-7), (5, 3)])
    assert len(Scene.from_shapely([bent]).segments) == 1
    assert {(5, 4e-7), (5, 3)} <= {tuple(end) for end in Scene.from_shapely([bent, leg]).segments.reshape(-1, 2)}
    ring = shapely.LinearRing([(5, 0), (10, 0), (10, 9), (0, 9), (0, 0)])
    assert len(Scene.from_shapely([ring, shapely.LineString([(5, 0), (5, 3)])]).segments) == 6


def test_wall_given_twice_counts_once():
    wall = shapely.LineString([(0, 0), (1, 0), (1, 1)])
    assert len(Scene.from_shapely([wall, wall.reverse(), shapely.LineString([(1, 0), (1, 1)])]).segments) == 2


def test_walls_with_nothing_to_merge_keep_their_order_and_sense():
    rows = [(3, 0, 0, 0), (0, 5, 0, 1), (1, 1, 2, 2)]
    scene = Scene.from_shapely([shapely.LineString([row[:2], row[2:]]) for row in rows])
    assert scene.segments.tolist() == [list(row) for row in rows]


# ---- inside solids


def test_nothing_is_inside_where_there_are_no_solids():
    for scene in (Scene(()), Scene.from_shapely(solids=[shapely.Polygon()])):
        assert scene.enclosed([0.0, 1.0], [0.0, math.nan]).tolist() == [False, False]


@given(seed=st.integers(0, 2**32), offset=st.sampled_from([0.0, -3.7, 1e5]), lattice=st.booleans())
@settings(deadline=None)
def test_enclosed_is_what_shapely_says(seed, offset, lattice):
    rng = np.random.default_rng(seed)

    def some(n, low=-30, high=30):
        values = rng.uniform(low, high, (n, 2))
        return (np.round(values) if lattice else values) + offset

    solids = [shapely.MultiPoint(some(n)).convex_hull for n in rng.integers(3, 9, rng.integers(1, 6))]
    solids.append(shapely.box(0, 0, 10, 0.01).difference(shapely.box(2, 0.001, 3, 0.002)))
    scene = Scene.from_shapely(solids=[solid for solid in solids if solid.geom_type == "Polygon"])
    cells, corners = scene._cells, shapely.get_coordinates(scene.solids)
    on_cells = np.array([cells.x, cells.y]) + cells.size * rng.integers(-2, max(cells.kind.shape) + 3, (200, 2))
    on_sides = shapely.line_interpolate_point(scene.solids.boundary, rng.random(200), normalized=True)
    points = [some(300), some(50, -90, 90), corners, shapely.get_coordinates(on_sides), on_cells]
    points += [corners[:, None].repeat(5, 1).reshape(-1, 2) + rng.normal(0, 1e-9, (5 * len(corners), 2))]
    points += [[(math.nan, 0), (math.inf, 0), (0, -math.inf), (1e300, -1e300)]]
    x, y = np.concatenate(points).T
    np.testing.assert_array_equal(scene.enclosed(x, y), shapely.contains_xy(scene.solids, x, y))


def test_most_points_amid_streets_and_blocks_need_no_second_look():
    blocks = [shapely.box(x, y, x + 30, y + 30) for x in range(0, 400, 40) for y in range(0, 400, 40)]
    cells = Scene.from_shapely(solids=blocks)._cells
    street, block = np.arange(-5.0, 400, 40), np.full(11, 15.0)
    assert set(cells.at(street, block)) == {0}
    assert set(cells.at(block[:10], street[:10] + 20)) == {1}
    assert (cells.kind == 2).mean() < 0.25


def test_grid_over_solids_is_bounded_however_slender_the_world():
    for solid in (shapely.box(0, 0, 1e6, 1e-3), shapely.box(1e6, 1e6, 1e6 + 1e-4, 1e6 + 5e-5)):
        scene = Scene.from_shapely(solids=[solid])
        assert scene._cells.kind.size < 10_000
        assert scene.enclosed(*shapely.get_coordinates(solid.centroid).T).tolist() == [True]
    flat = Scene((), shapely.Polygon([(5, 5), (6, 6), (7, 7)]))
    assert not flat.enclosed([6.0], [6.0])


def test_corners_go_counter_clockwise_around_the_centre():
    corners = Boxes([3], [4], [math.pi / 2], [4], [2], [0]).corners()[0]
    np.testing.assert_allclose(corners, [[4, 2], [4, 6], [2, 6], [2, 2]])
    assert shapely.LinearRing(corners).is_ccw


def test_wrap_keeps_directions_and_ends_at_plus_pi():
    np.testing.assert_allclose(wrap([3 * math.pi, -math.pi, 0.1, 7.0]), [math.pi, math.pi, 0.1, 7 - 2 * math.pi])


def test_compose_with_no_mount_is_the_body():
    assert [float(v) for v in compose(1.0, 2.0, 0.3, Mount())] == [1.0, 2.0, 0.3]
