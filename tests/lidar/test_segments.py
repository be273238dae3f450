"""Groups of returns: small scenes of walls and boxes, measured by a formula of this file's own."""

import math
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from platoontraffic.lidar.laserscan import ScanBatch
from platoontraffic.lidar.model import LidarModel
from platoontraffic.lidar.segments import find_segments

INF, NAN = math.inf, math.nan
FRONT = LidarModel(1441, -math.pi / 2, math.pi / 2, 0.0, 60.0)
COARSE = LidarModel(181, -math.pi / 2, math.pi / 2, 0.0, 60.0)  # 1 degree
RING = LidarModel(360, -math.pi, math.pi - math.radians(1), 0.0, 60.0)  # the last beam is a step before the first
few = settings(derandomize=True, deadline=None, max_examples=200)
angles = st.floats(-math.pi, math.pi)


def batch(model, *rows, dtype=np.float64):
    ranges = np.array(rows, dtype=dtype).reshape(len(rows), model.samples)
    return ScanBatch(model, 0.0, tuple(map(str, range(len(rows)))), ranges, None, np.zeros(len(rows), dtype=bool))


def find(model, *rows, **options):
    return find_segments(batch(model, *rows), **options)


def ranges_to(model, *walls):
    """Distance to the nearest of some walls (x0, y0, x1, y1) on each beam, (k,)."""
    start, stop = np.array(walls, dtype=float).reshape(-1, 2, 2).transpose(1, 2, 0)[..., None]
    beam, along = model.directions[:, None, :], stop - start
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = beam[0] * along[1] - beam[1] * along[0]
        distance = (start[0] * along[1] - start[1] * along[0]) / turn
        share = (start[0] * beam[1] - start[1] * beam[0]) / turn
        return np.where((distance >= 0) & (share >= 0) & (share <= 1), distance, INF).min(axis=0)


def turned(points, angle):
    return points @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])


def corners_of(x, y, heading, length, width):
    """Counter-clockwise, (4, 2)."""
    unturned = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [length / 2, width / 2]
    return turned(unturned, heading) + np.array([x, y])


def box(*pose):
    corners = corners_of(*pose)
    return np.hstack([corners, np.roll(corners, -1, axis=0)])


def points_of(model, ranges):
    valid = np.isfinite(ranges)
    return (ranges[valid] * model.directions[:, valid]).T


def wrapped(angle):
    return math.pi - (math.pi - angle) % (2 * math.pi)


def street(model, seed, noise=0.01):
    """A noisy scan of some boxes at random, without errors."""
    rng = np.random.default_rng(seed)
    boxes = [box(*rng.uniform(-15, 15, 2), rng.uniform(-3, 3), *rng.uniform(0.5, 5, 2)) for _ in range(5)]
    ranges = ranges_to(model, *np.concatenate(boxes))
    return ranges + noise * rng.normal(size=ranges.shape)


def assert_same(one, other):
    for field in fields(one):
        if field.name not in ("row", "offset"):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), field.name)


# Groups


def test_box_ahead_is_one_group_as_wide_as_the_box():
    found = find(FRONT, ranges_to(FRONT, *box(12, 0, 0, 4, 1.8)))
    spacing = 10 * FRONT.angle_increment
    assert len(found) == 1
    assert 1.8 - 2 * spacing < found.width[0] <= 1.8
    assert found.line_heading[0] == pytest.approx(math.pi / 2)
    assert found.line_distance[0] == found.nearest_range[0] == pytest.approx(10)
    assert found.nearest_bearing[0] == pytest.approx(0)
    assert found.first[0] + found.last[0] == FRONT.samples - 1
    assert found.count[0] == found.last[0] - found.first[0] + 1
    np.testing.assert_allclose(found.start + found.stop, [[20, 0]], atol=1e-9)
    assert found.start[0, 1] < 0


def test_two_boxes_with_a_gap_are_two_groups():
    found = find(FRONT, ranges_to(FRONT, *box(12, 1.5, 0, 4, 1.8), *box(12, -1.5, 0, 4, 1.8)))
    assert len(found) == 2
    np.testing.assert_allclose(found.width, 1.8, atol=2 * 10 * FRONT.angle_increment)
    assert found.stop[0, 1] < 0 < found.start[1, 1]


@pytest.mark.parametrize(("step", "groups"), [(0.0, 1), (0.09, 1), (0.3, 2)])
def test_step_in_depth_parts_what_is_one_to_the_eye(step, groups):
    wall = [(10, -3, 10, 0.01), (10 + step, 0, 10 + step, 3)]
    assert len(find(FRONT, ranges_to(FRONT, *wall))) == groups


@pytest.mark.parametrize("every", [1, 2, 3])
@given(grazing_deg=st.floats(6, 80), side=st.floats(0.5, 3))
@few
def test_wall_alongside_is_one_group_up_to_the_grazing_angle(every, grazing_deg, side):
    ranges = ranges_to(COARSE, (0, side, 1e4, side))
    kept = np.arange(0, COARSE.samples, every)
    seen = np.full_like(ranges, NAN)
    seen[kept] = ranges[kept]
    grazing = math.radians(grazing_deg)
    kept = kept[COARSE.angles[kept] > 1e-9]
    near = COARSE.angles[kept[1:]]
    assume(np.abs(near - grazing).min() > 1e-9)
    found = find(COARSE, seen, jump=0, grazing=grazing)
    assert found.first[-1] == kept[:-1][near > grazing][0]
    assert found.last[-1] == kept[-1]
    assert len(found) == 1


@pytest.mark.parametrize("lost", [NAN, INF, -INF])
@pytest.mark.parametrize("bridge", [0, 1, 3])
def test_a_group_bridges_so_many_lost_returns_and_no_more(lost, bridge):
    ranges = np.tile(ranges_to(FRONT, (5, -2, 5, 2)), (2, 1))
    ranges[0, 720 : 720 + bridge] = lost
    ranges[1, 720 : 721 + bridge] = lost
    found = find(FRONT, *ranges, bridge=bridge)
    whole, parts = found.of(0), found.of(1)
    assert found.count[whole] == np.isfinite(ranges[0]).sum()
    assert found.last[parts].tolist() == [719, found.last[0]]
    assert found.first[parts].tolist() == [found.first[0], 721 + bridge]


def test_scan_of_nothing_has_no_groups():
    found = find(FRONT, np.full(FRONT.samples, INF), np.full(FRONT.samples, -INF), np.full(FRONT.samples, NAN))
    assert len(found) == 0
    assert found.corner.shape == (0, 2)
    assert found.offset.tolist() == [0, 0, 0, 0]
    assert len(find(FRONT)) == 0


def test_single_return_is_a_group_if_asked_for():
    ranges = np.full(COARSE.samples, INF)
    ranges[90] = 7.0
    assert len(find(COARSE, ranges)) == 0
    found = find(COARSE, ranges, min_beams=1)
    assert (found.first[0], found.last[0], found.count[0], found.width[0]) == (90, 90, 1, 0)
    assert found.nearest_range[0] == 7
    assert np.isnan([found.line_heading[0], found.line_distance[0], found.line_rms[0]]).all()


@pytest.mark.parametrize("returns", [1, 2, 3, 4, 5])
def test_groups_below_min_beams_are_left_out(returns):
    ranges = np.full(COARSE.samples, INF)
    ranges[90 : 90 + returns] = 7.0
    assert len(find(COARSE, ranges, min_beams=3)) == (returns >= 3)


def test_groups_of_a_row():
    one, none = ranges_to(FRONT, (5, -2, 5, 2)), np.full(FRONT.samples, INF)
    two = np.minimum(one, ranges_to(FRONT, (9, 5, 9, 7)))
    found = find(FRONT, one, none, two)
    assert found.row.tolist() == [0, 2, 2]
    assert [found.row[found.of(i)].tolist() for i in (0, 1, 2, -1)] == [[0], [], [2, 2], [2, 2]]
    with pytest.raises(IndexError):
        found.of(3)


# A full turn


@pytest.mark.parametrize("angle_min", [-math.pi, 0.0])
@pytest.mark.parametrize("samples", [1440, 1441], ids=["neighbours", "same direction"])
def test_wall_across_the_seam_of_a_full_turn_is_one_group(samples, angle_min):
    model = LidarModel(samples, angle_min, angle_min + math.radians(0.25) * (samples - 1), 0.0, 60.0)
    middle = angle_min + 0.001
    ends = turned(np.array([[5, -2], [5, 2]]), middle)
    found = find(model, ranges_to(model, ends.ravel()))
    assert len(found) == 1
    assert found.first[0] > found.last[0]
    assert found.count[0] == (found.last[0] - found.first[0]) % samples + 1
    assert found.width[0] == pytest.approx(4, abs=0.05)
    assert found.line_distance[0] == pytest.approx(5)
    assert found.line_heading[0] == pytest.approx(wrapped(middle + math.pi / 2))
    assert abs(wrapped(found.nearest_bearing[0] - middle)) < model.angle_increment
    assert -math.pi < found.nearest_bearing[0] <= math.pi


@pytest.mark.parametrize(("lost", "groups"), [(2, 1), (3, 2)])
@pytest.mark.parametrize("begin", [357, 358, 359, 360])
def test_lost_returns_are_bridged_across_the_seam_too(begin, lost, groups):
    ranges = ranges_to(RING, (-5, -2, -5, 2))
    ranges[np.arange(begin, begin + lost) % 360] = NAN
    found = find(RING, ranges, bridge=2)
    assert len(found) == groups
    assert found.count.sum() == np.isfinite(ranges).sum()


def test_fan_that_is_not_closed_has_no_seam():
    half = math.radians(179)
    model = LidarModel(1433, -half, half, 0.0, 60.0)
    found = find(model, ranges_to(model, (-5, -2, -5, 2)))
    assert len(found) == 2
    assert (found.first <= found.last).all()


def test_round_room_is_one_group():
    found = find(RING, np.full(RING.samples, 4.0))
    assert (found.first.tolist(), found.last.tolist(), found.count.tolist()) == ([0], [359], [360])


@given(seed=st.integers(0, 2**32 - 1), shift=st.integers(0, 359))
@few
def test_turning_the_world_by_some_beams_turns_the_groups(seed, shift):
    ranges = street(RING, seed)
    ranges[np.random.default_rng(seed).random(RING.samples) < 0.05] = NAN
    before, after = find(RING, ranges), find(RING, np.roll(ranges, shift))
    assume(((before.last - before.first) % RING.samples < RING.samples - 3).all())  # no ring, which starts anywhere
    order = np.argsort((after.first - shift) % RING.samples)
    np.testing.assert_array_equal((after.first[order] - shift) % RING.samples, before.first)
    np.testing.assert_array_equal((after.last[order] - shift) % RING.samples, before.last)
    turn = shift * RING.angle_increment
    for name in ("start", "stop", "corner"):
        np.testing.assert_allclose(getattr(after, name)[order], turned(getattr(before, name), turn), atol=1e-8)
    for name in ("line_heading", "leg_heading", "nearest_bearing"):
        difference = getattr(after, name)[order] - getattr(before, name) - turn
        np.testing.assert_allclose(np.exp(1j * difference[np.isfinite(difference)]), 1, atol=1e-8)
    for name in ("count", "width", "nearest_range", "line_distance", "leg_lengths", "convex"):
        np.testing.assert_allclose(getattr(after, name)[order], getattr(before, name), atol=1e-8)


# Lines


@given(bearing=st.floats(-0.3, 0.3), distance=st.floats(0.5, 20))
@few
def test_wall_lies_at_its_distance_and_heading(bearing, distance):
    model = LidarModel(721, -1.0, 1.0, 0.0, 100.0)
    found = find(model, distance / np.cos(model.angles - bearing))
    assert len(found) == 1
    assert found.line_distance[0] == pytest.approx(distance, rel=1e-9)
    assert found.line_heading[0] == pytest.approx(bearing + math.pi / 2, abs=1e-9)
    assert found.line_rms[0] < 1e-7 * distance
    assert abs(found.nearest_bearing[0] - bearing) <= model.angle_increment / 2 * (1 + 1e-9)


def test_noise_turns_the_line_of_a_rear_as_much_as_statistics_says():
    exact, sigma = ranges_to(FRONT, *box(12, 0, 0, 4, 1.8)), 0.01
    found = find(FRONT, *(exact + sigma * np.random.default_rng(1).normal(size=(2000, FRONT.samples))))
    assert len(found) == 2000
    expected = sigma / (found.width.mean() * math.sqrt(found.count.mean() / 12))
    error = found.line_heading - math.pi / 2
    assert 0.93 < error.std() / expected < 1.07
    assert abs(error.mean()) < 4 * expected / math.sqrt(2000)
    assert found.line_rms.mean() == pytest.approx(sigma, rel=0.03)


@given(seed=st.integers(0, 2**32 - 1))
@few
def test_lines_agree_with_singular_values(seed):
    found = find(FRONT, ranges := street(FRONT, seed, noise=0.02))
    for g in range(len(found)):
        points = points_of(FRONT, np.where(within(found, g), ranges, INF))
        mean = points.mean(axis=0)
        _, values, axes = np.linalg.svd(points - mean)
        along = axes[0] * np.sign(axes[0] @ (points[-1] - points[0]))
        rms = values[1] / math.sqrt(len(points)) if len(points) > 2 else 0
        assert found.line_rms[g] == pytest.approx(rms, abs=1e-7)
        assert found.line_distance[g] == pytest.approx(abs(along[0] * mean[1] - along[1] * mean[0]), abs=1e-9)
        np.testing.assert_allclose([math.cos(found.line_heading[g]), math.sin(found.line_heading[g])], along, atol=1e-9)


def within(found, g):
    beam = np.arange(FRONT.samples)
    return (found.first[g] <= beam) & (beam <= found.last[g])


# Right angles


@given(heading=angles, bearing=st.floats(-0.8, 0.8), distance=st.floats(4, 15), width=st.floats(1, 3))
@few
def test_box_at_any_angle_shows_its_corner(heading, bearing, distance, width):
    pose = (distance * math.cos(bearing), distance * math.sin(bearing), heading, 4.0, width)
    ranges = ranges_to(FRONT, *box(*pose))
    points, corners = points_of(FRONT, ranges), corners_of(*pose)
    corner = corners[np.hypot(*corners.T).argmin()]
    split = np.flatnonzero(np.isfinite(ranges))[0] + np.hypot(*(points - corner).T).argmin()
    # Two faces are seen, neither so flat that its returns lie apart.
    into_box = turned(points, -heading) - turned(np.array(pose[:2]), -heading)
    on_side = np.isclose(np.abs(into_box[:, 1]), width / 2) & ~np.isclose(np.abs(into_box[:, 0]), 2.0)
    assume(3 <= on_side.sum() <= len(points) - 3)
    assume(np.hypot(*np.diff(points, axis=0).T).max() < 0.1)
    found = find(FRONT, ranges)
    assert len(found) == 1
    np.testing.assert_allclose(found.corner, [corner], atol=1e-6)
    ends = np.hypot(*(corner - points[[0, -1]]).T)
    np.testing.assert_allclose(found.leg_lengths, [ends], atol=1e-6)
    off = found.leg_heading[0] - math.atan2(*(corner - points[0])[::-1])
    assert math.cos(off) == pytest.approx(1, abs=1e-12)
    assert math.sin(2 * (found.leg_heading[0] - heading)) == pytest.approx(0, abs=1e-6)
    assert abs(found.split[0] - split) <= 1
    assert found.convex[0]
    assert found.corner_rms[0] < 1e-6 < found.line_rms[0]


def test_corner_of_a_room_is_not_convex():
    found = find(FRONT, ranges_to(FRONT, (4, -3, 4, 2), (4, 2, -3, 2)), grazing=math.radians(30))
    np.testing.assert_allclose(found.corner[-1], [4, 2], atol=1e-9)
    assert found.leg_heading[-1] == pytest.approx(math.pi / 2)
    assert not found.convex[-1]


def test_noise_turns_a_corner_as_much_as_statistics_says():
    pose, sigma = (9, 0, math.pi / 4, 3, 3), 0.01
    exact = ranges_to(FRONT, *box(*pose))
    found = find(FRONT, *(exact + sigma * np.random.default_rng(1).normal(size=(1000, FRONT.samples))))
    assert len(found) == 1000
    half = points_of(FRONT, exact)[: found.count[0] // 2]  # both faces are seen alike, at 45 degrees or so
    flat = half[0] - half[-1]
    slant = sum(np.cos(np.arctan2(half[:, 1], half[:, 0]) - math.pi / 4) ** 2) / len(half)
    expected = (
        sigma
        * math.sqrt(slant)
        / math.sqrt(2 * ((half - half.mean(axis=0)) @ flat / np.hypot(*flat)).var() * len(half))
    )
    error = np.arcsin(np.sin(2 * (found.leg_heading - math.pi / 4))) / 2
    assert 0.85 < error.std() / expected < 1.15
    np.testing.assert_allclose(found.corner.mean(axis=0), [9 - 3 / math.sqrt(2), 0], atol=0.01)


@given(seed=st.integers(0, 2**32 - 1))
@few
def test_right_angles_agree_with_singular_values_of_every_split(seed):
    ranges = street(COARSE, seed, noise=0.05)
    found = find(COARSE, ranges, jump=1.0)
    for g in range(len(found)):
        beams = np.arange(found.first[g], found.last[g] + 1)
        beams = beams[np.isfinite(ranges[beams])]
        points = (ranges[beams] * COARSE.directions[:, beams]).T
        if len(points) < 4:
            assert np.isnan(found.corner[g]).all()
            assert found.split[g] == -1
            continue
        fits = [right_angle(points, j) for j in range(2, len(points) - 1)]
        costs = np.array([cost for cost, *_ in fits])
        best = costs.argmin()
        assert found.corner_rms[g] == pytest.approx(math.sqrt(costs[best] / len(points)), abs=1e-7)
        if len(costs) > 1 and np.partition(costs, 1)[1] - costs[best] < 1e-9:
            continue  # two splits as good as each other
        _, corner, along = fits[best]
        assert found.split[g] == beams[best + 2]
        np.testing.assert_allclose(found.corner[g], corner, atol=1e-8)
        heading = math.atan2(*(along * np.sign(along @ (corner - points[0])))[::-1])
        assert math.cos(found.leg_heading[g] - heading) == pytest.approx(1, abs=1e-12)
        lengths = abs((corner - points[0]) @ along), abs((points[-1] - corner) @ [-along[1], along[0]])
        np.testing.assert_allclose(found.leg_lengths[g], lengths, atol=1e-8)


def right_angle(points, j):
    """Sum of squares, corner and direction of the first leg, where the first j points lie on it."""
    first, second = points[:j].mean(axis=0), points[j:].mean(axis=0)
    quarter_back = np.array([[0, 1], [-1, 0]])
    _, values, axes = np.linalg.svd(np.concatenate([points[:j] - first, (points[j:] - second) @ quarter_back]))
    corner = np.linalg.solve(axes[::-1], [axes[1] @ first, axes[0] @ second])
    return values[1] ** 2, corner, axes[0]


# Symmetries


@given(seed=st.integers(0, 2**32 - 1))
@few
def test_mirrored_scan_gives_mirrored_groups(seed):
    ranges = street(FRONT, seed)
    one, other = find(FRONT, ranges), find(FRONT, ranges[::-1])
    last_beam = FRONT.samples - 1
    np.testing.assert_array_equal(other.first[::-1], last_beam - one.last)
    np.testing.assert_array_equal(other.count[::-1], one.count)
    for name, mirror in (("start", "stop"), ("stop", "start"), ("corner", "corner")):
        np.testing.assert_allclose(getattr(other, name)[::-1], getattr(one, mirror) * [1, -1], atol=1e-9)
    np.testing.assert_allclose(other.leg_lengths[::-1, ::-1], one.leg_lengths, atol=1e-9)
    np.testing.assert_array_equal(other.convex[::-1], one.convex)
    np.testing.assert_allclose(other.nearest_bearing[::-1], -one.nearest_bearing, atol=1e-9)
    np.testing.assert_allclose(np.cos(other.line_heading[::-1] + one.line_heading), -1, atol=1e-9)
    second = one.leg_heading + np.where(one.convex, -1, 1) * math.pi / 2
    fitted = one.count >= 4
    np.testing.assert_allclose(np.cos(other.leg_heading[::-1] + second)[fitted], -1, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
@few
def test_twice_the_size_is_the_same_but_twice_as_large(seed):
    ranges = street(FRONT, seed)
    one, twice = find(FRONT, ranges, jump=0.1), find(FRONT, 2 * ranges, jump=0.2)
    large = {
        "start",
        "stop",
        "width",
        "nearest_range",
        "line_distance",
        "line_rms",
        "corner",
        "leg_lengths",
        "corner_rms",
    }
    for field in fields(one):
        scale = 2 if field.name in large else 1
        np.testing.assert_array_equal(getattr(twice, field.name), scale * getattr(one, field.name), field.name)


def test_order_and_company_of_the_rows_do_not_change_a_single_bit():
    rows = np.array([street(RING, seed) for seed in range(40)] + [np.full(RING.samples, INF)])
    rows[np.random.default_rng(0).random(rows.shape) < 0.02] = NAN
    together, reversed_ = find(RING, *rows), find(RING, *rows[::-1])
    for i in range(len(rows)):
        alone = find(RING, rows[i])
        assert_same(part(together, i), alone)
        assert_same(part(reversed_, -1 - i), alone)


def part(found, row):
    at = found.of(row)
    return type(found)(**{field.name: getattr(found, field.name)[at] for field in fields(found)})


def test_single_precision_in_gives_double_precision_of_the_same_numbers():
    rows = np.array([street(RING, seed) for seed in range(20)], dtype=np.float32)
    single, double = find_segments(batch(RING, *rows, dtype=np.float32)), find(RING, *rows)
    assert_same(single, double)
    assert single.corner.dtype == np.float64


# At the door


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"jump": -0.1}, r"jump = -0.1; must be .* not negative"),
        ({"jump": NAN}, "jump = nan"),
        ({"grazing": 0.0}, "grazing = 0.0 rad; must be above 0"),
        ({"grazing": 1.6}, "grazing = 1.6 rad"),
        ({"grazing": math.radians(2.9)}, r"grazing = 2.9 deg; must be above 3 deg.* 2 bridged beams"),
        ({"min_beams": 0}, "min_beams = 0; must be a whole number, 1 or more"),
        ({"min_beams": 2.5}, "min_beams = 2.5"),
        ({"bridge": -1}, "bridge = -1; must be a whole number, 0 or more"),
    ],
)
def test_refuses_what_makes_no_sense(options, complaint):
    with pytest.raises(ValueError, match=complaint):
        find(COARSE, np.full(COARSE.samples, INF), **options)


def test_refuses_ranges_of_another_model():
    short = ScanBatch(FRONT, 0.0, ("0",), np.full((1, 9), INF), None, np.zeros(1, dtype=bool))
    with pytest.raises(ValueError, match=r"ranges are \(1, 9\); must be \(1, 1441\)"):
        find_segments(short)


def test_importing_it_does_not_import_numba():
    subprocess.run(
        [sys.executable, "-c", "import sys, platoontraffic.lidar.segments; assert 'numba' not in sys.modules"],
        check=True,
    )
