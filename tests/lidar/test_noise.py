"""A scanner's errors: their size, what they leave alone, and that they depend on nothing but what they are for."""

import dataclasses
import hashlib
import math
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.lidar import ENGINES, PRESETS, Boxes, Carriers, LidarModel, Noise, Occasion, Scene, scan
from platoontraffic.lidar.noise import (
    BOUND,
    biases,
    gauss,
    incidence_cosine_squared,
    mixed,
    scan_keys,
    sensor_keys,
    uniform,
)
from tests.support.oracle import world

INF = math.inf
ROOM = Scene([(-5, -5, 5, -5), (5, -5, 5, 5), (5, 5, -5, 5), (-5, 5, -5, -5)])
NOBODY = Boxes.empty()
DIGESTS = [1158703273908278470, 909406913906941911, 14048890709183774865]
ROOM_DIGEST = "c2b4e06b04bf6520"
ALL_ERRORS = Noise(0.01, 0.002, 0.02, 0.001, 0.02, 0.1, 0.5, math.radians(60))


def fan(half_deg=90.0, samples=720, range_max=30.0, **more):
    half = math.radians(half_deg)
    return LidarModel(samples, -half, half, 0.3, range_max, **more)


def look(model, scene=ROOM, boxes=NOBODY, x=0.0, y=0.0, heading=0.0, owner=0, *, ids=None, motion=(0.0, 0.0, 0.0),
         stamp=0.0, number=0, seed=0, engine="raster", dtype=np.float64):  # fmt: skip
    carriers = Carriers(x, y, heading, owner, ids, *motion)
    return scan(model, scene, boxes, carriers, Occasion(stamp, number, seed), engine=engine, dtype=dtype)


def errors(model, scans=200, **more):
    """Measured minus true ranges of many scans of the room, (scans, k)."""
    true = look(dataclasses.replace(model, noise=Noise())).ranges[0]
    return np.array([look(model, number=i, **more).ranges[0] for i in range(scans)]) - true


# ---- the numbers themselves


def test_draws_are_normal_enough_bounded_and_unrelated():
    keys = scan_keys(sensor_keys(1, tuple(f"veh.{i}" for i in range(100))), 7)
    beams = np.arange(5000, dtype=np.uint64)
    z = gauss(mixed(keys[:, None] + beams * np.uint64(0x9E3779B97F4A7C15)))
    n = z.size
    assert abs(z.mean()) < 4 / math.sqrt(n)
    assert abs(z.std() - 1) < 4 / math.sqrt(2 * n)
    assert (z**4).mean() - 3 == pytest.approx(-0.3, abs=0.02)  # of a sum of four uniform numbers: -6/5/4
    assert 3.2 < np.abs(z).max() <= BOUND == pytest.approx(2 * math.sqrt(3), rel=1e-4)
    for other in (np.roll(z, 1, axis=1), np.roll(z, 1, axis=0)):  # the next beam, the next vehicle
        assert abs((z * other).mean()) < 4 / math.sqrt(n)
    u = uniform(mixed(keys[:, None] + beams * np.uint64(0x9E3779B97F4A7C15)))
    assert 0 <= u.min() < 1e-4
    assert 1 - 1e-4 < u.max() < 1
    assert np.histogram(u, 10, (0, 1))[0] == pytest.approx(n / 10, abs=5 * math.sqrt(n / 10))


def test_hash_is_the_same_everywhere():
    keys = scan_keys(sensor_keys(42, ("veh.0", "veh.1", "Zug ä")), 3)
    assert keys.tolist() == DIGESTS
    batch = look(fan(noise=ALL_ERRORS), seed=42, number=3, ids=["veh.0"])
    micrometres = np.nan_to_num(np.rint(batch.ranges * 1e6), nan=-1, posinf=-2, neginf=-3).astype("<i8")
    assert hashlib.blake2b(micrometres.tobytes(), digest_size=8).hexdigest() == ROOM_DIGEST


# ---- what errors depend on


@pytest.mark.parametrize("engine", ["raster", "numpy"])
def test_errors_of_a_vehicle_do_not_depend_on_who_else_scans(engine):
    model = fan(noise=ALL_ERRORS)
    poses = {"A": (1.0, 2.0, 0.3), "B": (-2.0, 0.0, 2.0), "C": (0.0, -3.0, -1.0)}

    def scans(names, threads=False):
        def one(names):
            x, y, heading = np.array([poses[name] for name in names]).T
            batch = look(model, x=x, y=y, heading=heading, owner=[0] * len(names), ids=names, seed=5, number=9,
                         engine=engine)  # fmt: skip
            found.update({name: batch[name].ranges for name in names})

        found = {}
        workers = [threading.Thread(target=one, args=([name],)) for name in names] if threads else []
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        if not workers:
            one(names)
        return found

    together = scans(["A", "B", "C"])
    for others in (scans(["C", "A"]), scans(["A"]), scans(["A", "B"], threads=True)):
        np.testing.assert_array_equal(others["A"], together["A"])


@pytest.mark.parametrize("change", [{"seed": 6}, {"number": 10}, {"ids": ["other"]}])
def test_another_seed_scan_or_vehicle_has_other_errors(change):
    model, usual = fan(noise=Noise(0.01)), {"seed": 5, "number": 9, "ids": ["A"]}
    assert (look(model, **usual).ranges == look(model, **usual).ranges).all()
    assert (look(model, **usual).ranges != look(model, **usual | change).ranges).mean() > 0.99


@pytest.mark.parametrize("engine", ENGINES)
def test_scanners_of_other_names_on_one_vehicle_have_other_errors(engine):
    model = fan(noise=ALL_ERRORS)
    front, rear, again = (
        look(dataclasses.replace(model, name=name), ids=["A"], engine=engine).ranges
        for name in ("front", "rear", "front")
    )
    np.testing.assert_array_equal(again, front)
    both = np.isfinite(front) & np.isfinite(rear)
    assert (front[both] != rear[both]).mean() > 0.9
    assert (np.isnan(front) != np.isnan(rear)).any()


def test_errors_of_two_scanners_on_one_vehicle_are_unrelated():
    n = 20_000
    ids = tuple(map(str, range(n)))
    one, other = (sensor_keys(3, ids, name) for name in ("front", "rear"))
    for draw in (lambda keys: gauss(mixed(keys)), lambda keys: gauss(mixed(scan_keys(keys, 7)))):
        assert abs((draw(one) * draw(other)).mean()) < 4 / math.sqrt(n)


def test_name_of_a_scanner_is_no_part_of_the_id():
    keys = {int(sensor_keys(0, (name,), scanner)[0]) for name, scanner in
            [("A", "lidar"), ("A", "rear"), ("A rear", "lidar"), ("A", "rear2"), ("A/rear", "lidar")]}  # fmt: skip
    assert len(keys) == 5


def test_default_name_keeps_the_errors_of_the_vehicle():
    assert sensor_keys(0, ("A",)).tolist() == sensor_keys(0, ("A",), LidarModel(3, -1, 1, 0, 1).name).tolist()


@pytest.mark.parametrize("engine", ENGINES)
def test_ids_that_compare_equal_are_different_names_in_any_order(engine):
    model, three = fan(noise=Noise(0.01), samples=30), (1, 1.0, True)
    together = look(model, x=[0, 0, 0], y=[0, 0, 0], heading=[0, 0, 0], owner=[0, 0, 0], ids=three, engine=engine)
    assert together.ids == ("1", "1.0", "True")
    assert len({row.tobytes() for row in together.ranges}) == 3
    for one in (1.0, True, 1):
        np.testing.assert_array_equal(look(model, ids=(one,), engine=engine).ranges[0], together[str(one)].ranges)


@pytest.mark.parametrize("model", [fan(noise=ALL_ERRORS), dataclasses.replace(PRESETS["utm30lx"], sweeps=7)])
def test_engines_make_the_same_errors(model):
    scene, boxes = world([(-5, -5, 5, -5), (5, -5, 5, 5)], [(3, 1, 0.4, 2, 1, 1), (1, -3, 0, 1, 1, 2)])
    poses = {"x": [0.0, -2.0], "y": [0.0, 1.0], "heading": [0.0, 0.5], "owner": [0, 0]}
    raster, plain = (look(model, scene, boxes, **poses, engine=engine) for engine in ("raster", "numpy"))
    np.testing.assert_array_equal(np.isnan(raster.ranges), np.isnan(plain.ranges))
    step = model.noise.resolution
    differ = ~np.isclose(raster.ranges, plain.ranges, rtol=0, atol=1e-9, equal_nan=True)
    assert np.abs(raster.ranges[differ] - plain.ranges[differ]) == pytest.approx(step)  # just between two steps
    assert differ.sum() <= 2


# ---- their size


def test_range_noise_is_a_plus_b_times_the_range():
    model = fan(noise=Noise(sigma=0.01, sigma_per_metre=0.003))
    found = errors(model)
    true = look(fan()).ranges[0]
    expected = 0.01 + 0.003 * true
    assert (found / expected).std() == pytest.approx(1, abs=4 / math.sqrt(2 * found.size))
    assert abs((found / expected).mean()) < 4 / math.sqrt(found.size)
    near, far = true < 5.5, true > 6.5
    assert found[:, near].std() < found[:, far].std()
    assert (np.abs(found) <= BOUND * expected + 1e-12).all()


def test_bias_stays_with_the_sensor_for_the_run():
    model = fan(noise=Noise(bias=0.05))
    found = errors(model, scans=3, ids=["A"])
    assert np.ptp(found) < 1e-12
    assert 0 < abs(found[0, 0]) <= 0.05 * BOUND
    many = biases(model.noise, sensor_keys(0, tuple(map(str, range(20_000)))))
    assert many.std() == pytest.approx(0.05, rel=0.02)


def test_resolution_rounds_to_its_steps():
    ranges = look(fan(noise=Noise(resolution=0.05))).ranges[0]
    np.testing.assert_allclose(ranges / 0.05, np.rint(ranges / 0.05), atol=1e-9)
    np.testing.assert_allclose(ranges, look(fan()).ranges[0], atol=0.025 + 1e-12)


@pytest.mark.parametrize("engine", ENGINES)
@given(steps=st.integers(1, 20_000), digits=st.integers(1, 3))
@settings(derandomize=True, deadline=None, max_examples=60)
def test_rounding_to_a_step_loses_no_return_at_either_limit(engine, steps, digits):
    resolution = 10.0**-digits
    far = steps * resolution  # may be a unit in the last place above or below the rounded range
    limits = {"range_min": far / 2, "range_max": far}, {"range_min": far, "range_max": 2 * far}
    for limit in (round(far, digits), far):
        for keywords in (one | {"range_max": limit} if one["range_max"] == far else one for one in limits):
            model = LidarModel(3, -0.1, 0.1, **keywords, noise=Noise(resolution=resolution))
            wall = Scene([(limit, -limit, limit, limit)])
            measured = look(model, wall, engine=engine).ranges[0, 1]
            assert measured == pytest.approx(limit, rel=1e-12)
            assert model.range_min <= measured <= model.range_max


def test_utm30lx_keeps_to_its_data_sheet():
    noise = PRESETS["utm30lx"].noise
    for distance, bound in ((10, 0.030), (30, 0.050)):
        most = BOUND * (noise.sigma + noise.sigma_per_metre * distance) + noise.resolution / 2
        assert 0.99 * bound < most <= bound
    assert (PRESETS["utm30lx"].samples, math.degrees(PRESETS["utm30lx"].angle_increment)) == (1081, 0.25)


def test_dropout_has_the_probability_that_is_said():
    for noise, expected in [
        (Noise(dropout=0.1), lambda r: 0.1 + 0 * r),
        (Noise(dropout_at_range_max=0.4), lambda r: 0.4 * (r / 8) ** 2),
        (Noise(dropout=0.05, dropout_at_range_max=0.4), lambda r: 0.05 + 0.4 * (r / 8) ** 2),
    ]:
        lost = np.isnan(errors(fan(noise=noise, range_max=8.0), scans=400)).mean(axis=0)
        p = expected(look(fan()).ranges[0])
        assert lost.mean() == pytest.approx(p.mean(), abs=4 * math.sqrt(p.mean() / (400 * 720)))
        assert (np.abs(lost - p) < 6 * np.sqrt(p * (1 - p) / 400)).all()


def test_grazing_surfaces_are_lost_more_often():
    model = fan(half_deg=89.9, range_max=1e4, noise=Noise(dropout_grazing=1.0, grazing_from=math.radians(60)))
    wall = Scene([(1, -1e4, 1, 1e4)])
    lost = np.isnan([look(model, wall, number=i).ranges[0] for i in range(400)]).mean(axis=0)
    incidence = np.abs(model.angles)  # of beams on a wall square ahead
    assert (lost[incidence < math.radians(59.9)] == 0).all()
    p = np.clip(1 - (np.cos(incidence) / 0.5) ** 2, 0, 1)
    assert (np.abs(lost - p) < 6 * np.sqrt(p * (1 - p) / 400) + 1e-9).all()


def test_lost_return_is_an_error_or_as_if_nothing_were_there():
    for dropped, value in (("error", math.nan), ("no_return", INF)):
        batch = look(fan(noise=Noise(dropout=1.0, dropped=dropped)))
        np.testing.assert_array_equal(batch.ranges, value)
        assert (batch.hits == -1).all()  # what was met is still told


@pytest.mark.parametrize("turn", [0.0, 0.3, -0.9, 1.2])
def test_incidence_follows_from_neighbours(turn):
    model = fan(half_deg=30, samples=300)
    normal = np.array([math.cos(turn), math.sin(turn)])
    ranges = 4.0 / (normal @ model.directions)
    ranges = np.where((ranges > 0) & (ranges < 1e3), ranges, INF)[None, :]
    met = np.isfinite(ranges)
    squared = incidence_cosine_squared(np.where(met, ranges, 0), np.zeros_like(ranges), met, model.angle_increment)
    np.testing.assert_allclose(squared[met], (normal @ model.directions)[None, :][met] ** 2, atol=1e-9)


# ---- what they leave alone


@pytest.mark.parametrize("engine", ["raster", "numpy"])
def test_only_returns_have_errors(engine):
    scene, boxes = world([(6, -2, 6, 2)], [(0.35, 1, 0.0, 0.3, 0.3, 3)])
    model = fan(half_deg=90, noise=ALL_ERRORS, range_max=20.0)
    true = look(dataclasses.replace(model, noise=Noise(), range_min=1.0), scene, boxes, engine=engine).ranges
    noisy = look(dataclasses.replace(model, range_min=1.0), scene, boxes, engine=engine).ranges
    assert (true == INF).any()
    assert (true == -INF).any()
    np.testing.assert_array_equal(noisy[~np.isfinite(true)], true[~np.isfinite(true)])


def test_no_spike_at_the_limits():
    # A wall just at a limit: half of the returns are beyond, and are not pushed back to it.
    model = fan(half_deg=0.5, noise=Noise(sigma=0.1))
    for limits, beyond, where in (((0.3, 10.0), INF, 9.9995), ((10.0, 20.0), -INF, 10.0)):
        model = dataclasses.replace(model, range_min=limits[0], range_max=limits[1])
        wall = Scene([(where, -9, where, 9)])
        assert np.isfinite(look(dataclasses.replace(model, noise=Noise()), wall).ranges).all()
        ranges = np.concatenate([look(model, wall, number=i).ranges[0] for i in range(100)])
        assert (ranges == beyond).mean() == pytest.approx(0.5, abs=0.01)
        edges = np.linspace(10 - 0.05, 10.0, 6) if beyond > 0 else np.linspace(10.0, 10.05, 6)
        density = np.histogram(ranges[np.isfinite(ranges)], edges)[0]
        assert density.max() < 1.2 * density.min()


def test_inside_a_solid_noise_does_not_help():
    batch = look(fan(noise=ALL_ERRORS), *world(boxes=[(0, 0, 0, 2, 2, 3)]))
    assert (batch.ranges == -INF).all()
    assert batch.inside[0]


# ---- sub-beams: mixed pixels


@pytest.mark.parametrize("engine", ["raster", "numpy"])
def test_at_an_edge_a_beam_measures_between_two_surfaces(engine):
    scene = Scene([(5, 0, 5, 10), (6, -10, 6, 0)])
    model = fan(half_deg=5, samples=201, divergence=math.radians(0.5), subbeams=5, merging=0.0)
    apart = look(model, scene, engine=engine).ranges[0]
    merged = look(dataclasses.replace(model, merging=2.0), scene, engine=engine).ranges[0]
    at_edge = np.abs(model.angles) < math.radians(0.25)
    between = (merged > 5.1) & (merged < 5.9)
    assert between.any()
    assert at_edge[between].all()
    assert not ((apart > 5.1) & (apart < 5.9)).any()  # told apart: the nearer one
    single = look(dataclasses.replace(model, subbeams=1), scene, engine=engine).ranges[0]
    np.testing.assert_allclose(merged[~at_edge], single[~at_edge], atol=1e-3)
    assert (apart[at_edge] <= single[at_edge] + 1e-9).all()


def test_subbeams_of_no_divergence_change_nothing():
    model = fan()
    np.testing.assert_allclose(
        look(dataclasses.replace(model, subbeams=4, merging=1.0)).ranges, look(model).ranges, rtol=1e-14
    )


@pytest.mark.parametrize("merging", [0.0, 0.5])
def test_subbeams_are_the_same_in_the_fast_engines(merging):
    rng = np.random.default_rng(0)
    scene = Scene(rng.uniform(-20, 20, (40, 4)))
    boxes = Boxes(*rng.uniform(-20, 20, (2, 20)), rng.uniform(-3, 3, 20), *rng.uniform(1, 3, (2, 20)), np.arange(20))
    model = fan(half_deg=170, subbeams=3, divergence=0.02, merging=merging)
    poses = boxes.x[:5], boxes.y[:5], boxes.heading[:5], boxes.owner[:5]
    raster, plain = (look(model, scene, boxes, *poses, engine=engine) for engine in ("raster", "numpy"))
    np.testing.assert_array_equal(raster.hits, plain.hits)
    np.testing.assert_allclose(raster.ranges, plain.ranges, atol=1e-9)


@pytest.mark.parametrize("subbeams", [1, 3])
@pytest.mark.parametrize("dropout_grazing", [0.0, 0.5])
def test_errors_of_the_few_beams_that_meet_something_are_those_of_a_whole_scan(subbeams, dropout_grazing):
    """Posts before many scanners at once: some meet none, some one beam, also the first or the last one."""
    rng, n = np.random.default_rng(subbeams), 300
    x, y = 100.0 * np.arange(n), np.zeros(n)
    bearing, distance = rng.uniform(-1.7, 1.7, (2, n)), rng.uniform(1.0, 33.0, (2, n))
    bearing[:, :20], distance[:, :20] = [[np.pi / 2], [-np.pi / 2]], 5.0
    posts = (x + distance * np.cos(bearing)).ravel(), (distance * np.sin(bearing)).ravel()
    width = np.tile(rng.uniform(0.02, 0.3, n), 2)
    boxes = Boxes(*posts, np.zeros(2 * n), width, width, np.arange(n, 3 * n))
    noise = dataclasses.replace(ALL_ERRORS, dropout_grazing=dropout_grazing)
    model = fan(samples=180, noise=noise, subbeams=subbeams, divergence=0.003 if subbeams > 1 else 0.0)
    raster, plain = (
        look(model, Scene(np.empty((0, 4))), boxes, x, y, np.zeros(n), np.arange(n), engine=engine)
        for engine in ("raster", "numpy")
    )
    np.testing.assert_array_equal(raster.hits, plain.hits)
    np.testing.assert_allclose(raster.ranges, plain.ranges, atol=1e-9)
    met = (raster.hits >= 0).sum(axis=1)
    assert {0, 1, 2} < {*met.tolist()}
    assert {0, 179} < {*np.flatnonzero((raster.hits >= 0).any(axis=0)).tolist()}


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("incidence_deg", [0, 30, 60, 75])
def test_on_an_oblique_wall_a_beam_measures_the_mean_over_its_spot(engine, incidence_deg):
    """Closed form: ray i of an angle a_i off the axis meets the wall at r cos(incidence) / cos(incidence + a_i)."""
    incidence, distance, rays = math.radians(incidence_deg), 10.0, 8
    model = LidarModel(3, -0.01, 0.01, 0.05, 60.0, divergence=0.015, subbeams=rays)
    along = np.array([-math.sin(incidence), math.cos(incidence)])
    wall = np.concatenate([(distance, 0) - 50 * along, (distance, 0) + 50 * along])
    off_axis = 0.015 * ((np.arange(rays) + 0.5) / rays - 0.5)
    spot = distance * math.cos(incidence) / np.cos(off_axis - incidence)
    assert np.ptp(spot) < 0.5  # all echoes overlap in a pulse of 3.3 ns
    assert look(model, Scene([wall]), engine=engine).ranges[0, 1] == pytest.approx(spot.mean(), abs=1e-9)
    assert abs(spot.mean() - distance) < 0.02
    infinitely_short = dataclasses.replace(model, merging=0.0)
    assert look(infinitely_short, Scene([wall]), engine=engine).ranges[0, 1] == pytest.approx(spot.min(), abs=1e-9)


@given(seed=st.integers(0, 2**32 - 1), merging=st.sampled_from([0.0, 0.5, 5.0]))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_all_engines_merge_the_same_sub_beams_near_the_end_of_the_range(seed, merging):
    rng = np.random.default_rng(seed)
    bearing, distance = rng.uniform(-0.5, 0.5, 12), rng.uniform(9.4, 10.3, 12)
    middle = np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)
    half = rng.uniform(-0.8, 0.8, (12, 2))
    scene = Scene(np.hstack([middle - half, middle + half]))
    model = LidarModel(41, -0.5, 0.5, 0.1, 10.0, divergence=0.03, subbeams=5, merging=merging)
    first, *others = (look(model, scene, engine=engine) for engine in ENGINES)
    for batch in others:
        np.testing.assert_array_equal(batch.hits, first.hits)
        np.testing.assert_allclose(batch.ranges, first.ranges, rtol=0, atol=1e-7)  # walls may be nearly edge-on


@pytest.mark.parametrize("engine", ENGINES)
def test_surface_beyond_the_range_is_not_merged_with_one_within(engine):
    scene = Scene([(9.9, -5, 9.9, 0), (10.15, -0.5, 9, 8)])
    model = LidarModel(3, -0.02, 0.02, 0.1, 10.0, divergence=0.02, subbeams=8, merging=0.5)
    assert look(model, scene, engine=engine).ranges[0, 1] == pytest.approx(9.90016, abs=1e-5)


# ---- sweeps: a scan takes time


@pytest.mark.parametrize("sweeps", [1, 2, 7, 720])
@pytest.mark.parametrize("engine", ["raster", "numpy"])
def test_where_nothing_moves_a_sweep_is_a_snapshot(sweeps, engine):
    model = fan(noise=Noise(0.01, dropout=0.1))
    boxes = Boxes([3], [1], [0.4], [2], [1], [1])
    snapshot = look(model, boxes=boxes, engine=engine)
    swept = look(dataclasses.replace(model, sweeps=sweeps), boxes=boxes, engine=engine)
    np.testing.assert_array_equal(swept.ranges, snapshot.ranges)
    np.testing.assert_array_equal(swept.hits, snapshot.hits)


def test_sweep_ends_at_the_instant_of_the_world():
    model = fan(half_deg=90, sweeps=720)
    batch = look(model, stamp=10.0)
    assert batch[0].time_increment * 719 == pytest.approx(1 / 40 / 2)  # half a turn of a mirror at 40 Hz
    assert batch.stamp + batch[0].time_increment * 719 == pytest.approx(10.0)
    assert look(fan(), stamp=10.0)[0].time_increment == 0.0


def test_wall_that_one_drives_towards_is_farther_on_the_earlier_beams():
    model, speed = fan(half_deg=45, sweeps=720, samples=720), 30.0
    wall = Scene([(10, -50, 10, 50)])
    scan_of = look(model, wall, motion=(speed, 0, 0))[0]
    when = scan_of.time_increment * np.arange(720) - model.sweep_time
    np.testing.assert_allclose(scan_of.ranges, (10 - speed * when) / np.cos(model.angles), rtol=1e-9)


def test_box_that_moves_with_the_sensor_is_seen_as_at_rest():
    still = Boxes([8], [1], [0.2], [4], [2], [1])
    moving = dataclasses.replace(still, vx=np.array([20.0]), vy=np.array([5.0]))
    model = fan(sweeps=16)
    seen = look(model, Scene(()), moving, motion=(20.0, 5.0, 0.0)).ranges
    np.testing.assert_allclose(seen, look(model, Scene(()), still).ranges, atol=1e-9)


def test_turning_sensor_smears_the_bearing():
    model, rate = fan(sweeps=720), 2.0
    pole = Boxes([8], [0], [0], [0.4], [0.4], [1])
    bearings = [
        model.angles[look(model, Scene(()), pole, motion=(0, 0, turn)).hits[0] == 1].mean() for turn in (0, rate)
    ]
    # When the middle beam was measured, half of the sweep before the end, the sensor had not yet turned so far.
    assert bearings[1] - bearings[0] == pytest.approx(rate * model.sweep_time / 2, abs=2 * model.angle_increment)


# ---- bad input


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sigma", -0.1),
        ("sigma", math.nan),
        ("bias", INF),
        ("dropout", 1.5),
        ("dropout_grazing", -0.1),
        ("grazing_from", math.pi / 2),
        ("dropped", "zero"),
        ("dropout", 0.6),
    ],
)
def test_bad_noise_is_refused(field, value):
    with pytest.raises(ValueError, match=rf"noise: {field}.*; must"):
        Noise(**{field: value, "dropout_at_range_max": 0.5})


@pytest.mark.parametrize(
    ("field", "value"), [("subbeams", 0), ("subbeams", 1.5), ("sweeps", 0), ("divergence", -1), ("merging", -1)]
)
def test_bad_model_is_refused(field, value):
    with pytest.raises(ValueError, match=rf"{field} = .*; must"):
        fan(**{field: value})
