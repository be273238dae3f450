"""All engines against an oracle, and against themselves after the world is moved, mirrored, cut or shuffled."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.lidar import ENGINES, Boxes, Carriers, LidarModel, Scene, scan
from tests.support.oracle import endpoint_miss, grazing, oracle_scan, world

FOVS = (23.0, 180.0, 270.0, 360.0)
few = settings(derandomize=True, deadline=None, max_examples=250)
seeds = st.integers(0, 2**32 - 1)
offsets = st.sampled_from([0.0, -137.0, 1e5, 1e6])


def fan(fov_deg, samples=91, range_max=12.0):
    half = math.radians(fov_deg) / 2
    return LidarModel(samples, -half, half, 0.0, range_max)


def street(seed, offset=0.0):
    """Scene, boxes and three sensor poses in generic position, some 20 m across."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-10, 10, (rng.integers(0, 9), 2))
    half = rng.uniform(-6, 6, middle.shape)
    scene = Scene(np.hstack([middle - half, middle + half]) + offset)
    v = rng.integers(0, 7)
    boxes = Boxes(
        *(rng.uniform(-10, 10, (2, v)) + offset),
        rng.uniform(-np.pi, np.pi, v),
        *rng.uniform(0.2, 5, (2, v)),
        rng.integers(0, 5, v),
    )
    x, y = rng.uniform(-8, 8, (2, 3)) + offset
    return scene, boxes, x, y, rng.uniform(-np.pi, np.pi, 3), np.arange(3)


def exact(model, scene, boxes, x, y, heading, owner, engine="raster"):
    return scan(model, scene, boxes, Carriers(x, y, heading, owner), engine=engine, dtype=np.float64)


@given(seed=seeds, fov=st.sampled_from(FOVS), offset=offsets)
@few
def test_raster_agrees_with_the_oracle(seed, fov, offset):
    check_against_the_oracle("raster", seed, fov, offset)


@pytest.mark.parametrize("engine", [name for name in ENGINES if name != "raster"])
@given(seed=seeds, fov=st.sampled_from(FOVS), offset=offsets)
@settings(few, max_examples=60)
def test_a_reference_engine_agrees_with_the_oracle(engine, seed, fov, offset):
    check_against_the_oracle(engine, seed, fov, offset)


def check_against_the_oracle(engine, seed, fov, offset):
    model = fan(fov)
    scene, boxes, x, y, heading, owner = street(seed, offset)
    batch = exact(model, scene, boxes, x, y, heading, owner, engine)
    for row in np.flatnonzero(~batch.inside):
        pose = (model, scene, boxes, x[row], y[row], heading[row], owner[row])
        expected, hits, sine = oracle_scan(*pose)
        ranges = batch.ranges[row]
        allowed = 1e-9 * (1 + np.where(np.isfinite(expected), expected, model.range_max)) / sine
        # Only two things may come out otherwise, and they are rare: a beam that passes an end within the rounding of
        # coordinates, and a surface just at the end of the range.
        at_end = endpoint_miss(*pose) < 1e-9 * (1 + model.range_max)
        at_limit = np.isclose(np.minimum(ranges, expected), model.range_max, rtol=0, atol=1e-9 * (1 + model.range_max))
        clear = ~(at_end | at_limit)
        assert clear.mean() > 0.98
        with np.errstate(invalid="ignore"):
            agree = (ranges == expected) | (np.abs(ranges - expected) <= allowed)
        np.testing.assert_array_equal(agree | ~clear, True)
        tied = np.abs(_other_owner_range(pose, hits) - expected) <= allowed
        np.testing.assert_array_equal(batch.hits[row][clear & ~tied], hits[clear & ~tied])


def _other_owner_range(pose, hits):
    """Distance on each beam to the nearest surface of another owner than the one hit, (k,)."""
    model, scene, boxes, *rest = pose
    second = np.full(model.samples, np.inf)
    for owner in np.unique(hits[hits != -2]):
        keep = boxes.owner != owner
        fields = (boxes.x, boxes.y, boxes.heading, boxes.length, boxes.width, boxes.owner)
        others = Boxes(*(field[keep] for field in fields))
        ranges, *_ = oracle_scan(model, world()[0] if owner == -1 else scene, others, *rest)
        second[hits == owner] = ranges[hits == owner]
    return np.where(np.isfinite(second), second, -1e9)


@pytest.mark.parametrize("engine", ENGINES)
@given(seed=seeds)
@few
def test_on_a_lattice_only_endpoints_and_edge_on_walls_may_differ(engine, seed):
    rng = np.random.default_rng(seed)
    scene = Scene(rng.integers(-4, 5, (5, 4)))
    boxes = Boxes(*rng.integers(-4, 5, (2, 2)), np.array([0, np.pi / 2]), [2, 4], [2, 2], [1, 2])
    model = LidarModel(9, -math.pi, math.pi, 0.0, 20.0)
    batch = exact(model, scene, boxes, [0], [0], [0], [0], engine)
    if batch.inside[0]:
        return
    pose = (model, scene, boxes, 0.0, 0.0, 0.0, 0)
    expected, *_ = oracle_scan(*pose)
    differ = ~np.isclose(batch.ranges[0], expected, rtol=0, atol=1e-9)
    classified = (endpoint_miss(*pose) < 1e-9) | (grazing(*pose) < 1e-9)
    assert not (differ & ~classified).any()


@given(seed=seeds, turn=st.floats(-3, 3), shift=st.floats(-500, 500))
@few
def test_moving_world_and_sensor_together_changes_nothing(seed, turn, shift):
    model = fan(270)
    scene, boxes, x, y, heading, owner = street(seed)

    def move(x, y):
        return np.cos(turn) * x - np.sin(turn) * y + shift, np.sin(turn) * x + np.cos(turn) * y - shift

    moved = Scene(np.stack([*move(*scene.segments.T[:2]), *move(*scene.segments.T[2:])], axis=1))
    moved_boxes = Boxes(*move(boxes.x, boxes.y), boxes.heading + turn, boxes.length, boxes.width, boxes.owner)
    before = exact(model, scene, boxes, x, y, heading, owner)
    after = exact(model, moved, moved_boxes, *move(x, y), heading + turn, owner)
    np.testing.assert_allclose(after.filled(), before.filled(), rtol=0, atol=1e-9)


@given(seed=seeds)
@few
def test_mirrored_world_gives_reversed_ranges(seed):
    model = fan(180)
    scene, boxes, x, y, heading, owner = street(seed)
    flipped = Scene(scene.segments * [1, -1, 1, -1])
    flipped_boxes = Boxes(boxes.x, -boxes.y, -boxes.heading, boxes.length, boxes.width, boxes.owner)
    before = exact(model, scene, boxes, x, y, heading, owner)
    after = exact(model, flipped, flipped_boxes, x, -y, -heading, owner)
    np.testing.assert_allclose(after.filled()[:, ::-1], before.filled(), rtol=0, atol=1e-9)


@given(seed=seeds, cut=st.floats(0.05, 0.95))
@few
def test_cutting_or_reversing_walls_changes_nothing(seed, cut):
    model = fan(360)
    scene, *rest = street(seed)
    start, stop = scene.segments[:, :2], scene.segments[:, 2:]
    middle = start + cut * (stop - start)
    pieces = Scene(np.concatenate([np.hstack([start, middle]), np.hstack([middle, stop])]))
    before = exact(model, scene, *rest).filled()
    np.testing.assert_allclose(exact(model, Scene(np.hstack([stop, start])), *rest).filled(), before, atol=1e-12)
    np.testing.assert_allclose(exact(model, pieces, *rest).filled(), before, rtol=0, atol=1e-9)


@given(seed=seeds)
@few
def test_one_more_obstacle_never_lengthens_a_range(seed):
    model = fan(360)
    scene, boxes, *rest = street(seed)
    more = Scene(np.concatenate([scene.segments, street(seed + 1)[0].segments]))
    assert (exact(model, more, boxes, *rest).ranges <= exact(model, scene, boxes, *rest).ranges).all()


@given(seed=seeds)
@few
def test_order_and_company_do_not_change_a_single_bit(seed):
    model = fan(270)
    scene, boxes, x, y, heading, owner = street(seed)
    rng = np.random.default_rng(seed)
    walls, box, row = (rng.permutation(n) for n in (len(scene.segments), len(boxes), len(x)))
    fields = (boxes.x, boxes.y, boxes.heading, boxes.length, boxes.width, boxes.owner)
    shuffled = Scene(scene.segments[walls]), Boxes(*(field[box] for field in fields))
    before = exact(model, scene, boxes, x, y, heading, owner)
    after = exact(model, *shuffled, x[row], y[row], heading[row], owner[row])
    np.testing.assert_array_equal(after.ranges, before.ranges[row])
    np.testing.assert_array_equal(after.hits, before.hits[row])
    for i in range(len(x)):
        alone = exact(model, scene, boxes, x[i], y[i], heading[i], owner[i])
        np.testing.assert_array_equal(alone.ranges[0], before.ranges[i])
        np.testing.assert_array_equal(alone.hits[0], before.hits[i])


def test_many_sensors_in_blocks_scan_as_they_do_alone():
    model = fan(270, samples=720)
    scene, boxes, *_ = street(3)
    x, y, heading = np.random.default_rng(3).uniform(-8, 8, (3, 400))
    together = exact(model, scene, boxes, x, y, heading, np.zeros(400))
    for i in (0, 166, 399):
        alone = exact(model, scene, boxes, x[i], y[i], heading[i], 0)
        np.testing.assert_array_equal(alone.ranges[0], together.ranges[i])


@given(seed=seeds, fov=st.sampled_from(FOVS))
@few
def test_with_twice_the_beams_every_second_one_is_the_same(seed, fov):
    model = fan(fov)
    coarse = exact(model, *street(seed))
    fine = exact(replace(model, samples=2 * model.samples - 1), *street(seed))
    np.testing.assert_array_equal(fine.ranges[:, ::2], coarse.ranges)


@pytest.mark.parametrize("engine", ENGINES)
def test_wall_at_d_gives_d_over_cosine(engine):
    model = fan(90, range_max=10.0)
    ranges = exact(model, *world([(3, -50, 3, 50)]), [0], [0], [0], [0], engine).ranges[0]
    np.testing.assert_allclose(ranges, 3 / np.cos(model.angles), rtol=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_box_square_ahead_covers_as_many_beams_as_its_width(engine):
    model = fan(180, samples=720, range_max=30.0)
    batch = exact(model, *world(boxes=[(22, 0, 0, 4, 1.8, 7)]), [0], [0], [0], [0], engine)
    wide = math.atan2(0.9, 20.0)
    assert (batch.hits == 7).sum() == (np.abs(model.angles) <= wide).sum() == 20
    np.testing.assert_allclose(batch.ranges[batch.hits == 7] * np.cos(model.angles[batch.hits[0] == 7]), 20.0)


@pytest.mark.parametrize("engine", ENGINES)
def test_corridor_is_half_its_width_over_the_sine(engine):
    model = fan(180, samples=181, range_max=50.0)
    ranges = exact(model, *world([(-99, 2, 99, 2), (-99, -2, 99, -2)]), [5], [0], [0], [0], engine).ranges[0]
    with np.errstate(divide="ignore"):
        expected = 2 / np.abs(np.sin(model.angles))
    np.testing.assert_allclose(ranges, np.where(expected > 50, np.inf, expected), rtol=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_both_ends_of_a_segment_belong_to_it(engine):
    model = LidarModel(3, -math.pi / 2, math.pi / 2, 0.0, 10.0)
    for end in (-1, 1):
        assert exact(model, *world([(2, 0, 2, end)]), [0], [0], [0], [0], engine).ranges[0, 1] == 2.0


@pytest.mark.parametrize("engine", ENGINES)
def test_lone_wall_edge_on_is_invisible(engine):
    model = LidarModel(3, -math.pi / 2, math.pi / 2, 0.0, 10.0)
    assert np.isinf(exact(model, *world([(2, 0, 4, 0)]), [0], [0], [0], [0], engine).ranges).all()


def test_walls_edge_on_but_for_rounding_are_seen_in_no_other_direction():
    behind = np.random.default_rng(0).uniform(0.6 * np.pi, 1.4 * np.pi, 500)
    near = np.stack([np.cos(behind), np.sin(behind)], axis=1)
    assert np.isinf(exact(fan(180), *world(np.hstack([near, 3.3 * near])), [0], [0], [0], [0]).ranges).all()


@pytest.mark.parametrize("engine", ["raster", "numpy"])
@given(seed=seeds)
@few
def test_sides_that_point_at_the_sensor_give_ranges_on_themselves_or_none(engine, seed):
    # Walls and sides of boxes on beams, at coordinates that rounding moves off them a little.
    rng = np.random.default_rng(seed)
    model = fan(360, samples=721, range_max=45.0)
    x, y, heading = *rng.uniform(-60, 60, 2), rng.integers(0, 720) * model.angle_increment
    along = np.array([np.cos(heading), np.sin(heading)])
    near = rng.uniform(1, 20)
    wall = np.concatenate([(x, y) + near * along, (x, y) + (near + rng.uniform(1, 20)) * along])
    aside = np.array([-along[1], along[0]])
    middle = (x, y) - (near + 2.25) * along + 1.25 * aside  # a side of this box points at the sensor, from behind
    boxes = Boxes([middle[0]], [middle[1]], [heading], [4.5], [2.5], [3])
    batch = exact(model, Scene([wall]), boxes, [x], [y], [rng.choice([0.0, heading])], [0], engine)
    ranges, hits = batch.ranges[0], batch.hits[0]
    assert not np.isnan(ranges).any()
    assert set(hits.tolist()) <= {-2, -1, 3}
    assert (ranges[hits == 3] >= near - 1e-9).all()
    assert (ranges[hits == -1] >= near - 1e-9).all()


def test_full_turn_sees_the_same_behind_on_its_first_and_last_beam():
    ranges = exact(fan(360), *world([(-3, -1, -3, 1)]), [0], [0], [0], [0]).ranges[0]
    np.testing.assert_allclose(ranges[[0, -1]], 3.0)
