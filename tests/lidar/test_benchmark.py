"""The benchmark of scans: it measures everything, and its towns are as described. Times are not tested."""

import json
import subprocess
import sys

import numpy as np
import pytest
import shapely

from platoontraffic.lidar import ENGINES, Carriers, Scene, benchmark, scan
from platoontraffic.lidar.benchmark import QUICK, VIEWS, YARDSTICKS, town


@pytest.fixture(scope="module")
def report():
    return benchmark.run(QUICK)


def test_every_engine_and_yardstick_is_measured_in_every_view(report):
    names = {(row.scene, row.view, row.engine) for row in report.scans}
    assert names == {(s.name, view, e) for s in QUICK.sizes for view in VIEWS for e in (*ENGINES, *YARDSTICKS)}
    assert len(names) == len(report.scans)
    assert len(report.cases) == len(QUICK.sizes) * len(VIEWS)
    assert [row.sensors for row in report.linear] == list(QUICK.linear)
    assert (len(report.noise), len(report.ticks), len(report.flat)) == (2, 1, 4 * len(QUICK.flat))
    assert [row.until for row in report.starts] == ["import lidar", "first scan, warm"]
    assert len(report.memory) == 1 + len(QUICK.memory) + 3
    assert len(report.bars) == 3 + 3 * len(QUICK.sizes) + 4


def test_times_and_ratios_are_positive(report):
    for row in report.scans:
        assert min(row.best_us, row.beams_per_us, row.to_raster) > 0
        assert row.best_us <= row.median_us
    assert all(row.to_raster == 1 for row in report.scans if row.engine == "raster")
    assert min(row.ratio for row in (*report.flat, *report.linear)) > 0
    assert min(row.worst for row in report.bars) > 0


def test_all_engines_and_brute_force_measure_what_shapely_does(report):
    for row in report.scans:
        if row.engine != "floor":
            assert (row.difference_m < 1e-9, row.differing) == (True, 0), row


def test_importing_lidar_does_not_import_numba_nor_does_the_benchmark(report):
    assert [row.numba_imported for row in report.starts] == [False, True]
    code = "import sys, platoontraffic.lidar.benchmark; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_report_reads_as_json_and_as_text(report):
    rows = json.loads(report.json())
    assert rows["scans"][0].keys() == set(benchmark.Scans._fields)
    assert rows["machine"]["numpy"] == np.__version__
    lines = benchmark.text(report).splitlines()
    assert sum(line.startswith("raster  ") for line in lines) == len(report.cases)
    assert max(map(len, lines)) <= 120


# ---- towns


@pytest.fixture(scope="module")
def jam():
    return town(4, 600)


def test_the_same_seed_makes_the_same_town():
    one, two, other = town(3, 50, seed=7), town(3, 50, seed=7), town(3, 50, seed=8)
    np.testing.assert_array_equal(one[0].segments, two[0].segments)
    np.testing.assert_array_equal(one[1].corners(), two[1].corners())
    assert (one[1].x != other[1].x).all()


def test_kerbs_are_cut_at_junctions_and_blocks_have_six_buildings():
    scene, _ = town(4, 1)
    assert len(scene.segments) == 29 * 4 * 4 * 5 + 6 * 4 * 4 * 4
    assert len(Scene.from_shapely(shapely.linestrings(scene.segments.reshape(-1, 2, 2))).segments) == 80 + 384


def test_vehicles_of_a_jam_touch_neither_each_other_nor_walls(jam):
    scene, boxes = jam
    bodies = shapely.polygons(boxes.corners())
    one, other = shapely.STRtree(bodies).query(bodies, predicate="intersects")
    assert (one == other).all()
    walls = shapely.STRtree(shapely.linestrings(scene.segments.reshape(-1, 2, 2)))
    assert walls.query(bodies, predicate="intersects").size == 0


def test_no_sensor_of_a_jam_is_inside_another_vehicle(jam):
    scene, boxes = jam
    batch = scan(VIEWS["foll30"], scene, boxes, Carriers.of(boxes))
    assert not batch.inside.any()


def test_vehicles_keep_to_the_right_and_off_junctions(jam):
    _, boxes = jam
    x, y = boxes.x, boxes.y
    right = np.sin(boxes.heading), -np.cos(boxes.heading)
    aside = (x - 150 * np.rint(x / 150)) * np.rint(right[0]) + (y - 150 * np.rint(y / 150)) * np.rint(right[1])
    assert (np.abs(aside - 1.75) <= 0.5).all()
    near_junction = (np.abs(x - 150 * np.rint(x / 150)) < 3.5) & (np.abs(y - 150 * np.rint(y / 150)) < 3.5)
    assert not near_junction.any()
