"""Properties of the compiled engine alone: its grid, its approximate angles, its compilation."""

import dataclasses
import gc
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from platoontraffic.lidar import Boxes, Carriers, LidarModel, Occasion, Scene, compiled, noise, scan
from platoontraffic.lidar.engines import raster_engine
from platoontraffic.lidar.engines.raster_engine import CELL
from platoontraffic.vehicles import bicycle_formulas, bicycle_kernel, motion
from tests.support import ROOT
from tests.support.oracle import world

few = settings(derandomize=True, deadline=None, max_examples=60)
VIEW = LidarModel(181, -math.pi / 2, math.pi / 2, 0.0, 45.0)


def both(model, scene, boxes, x, y, heading, owner):
    """Ranges of raster and of numpy, which knows no grid."""
    carriers = Carriers(x, y, heading, owner)
    return (scan(model, scene, boxes, carriers, engine=e, dtype=float) for e in ("raster", "numpy"))


def same(raster, plain):
    assert not np.isnan(raster.ranges).any()
    np.testing.assert_array_equal(raster.hits, plain.hits)
    np.testing.assert_allclose(raster.filled(), plain.filled(), rtol=0, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), fov=st.sampled_from([3.0, 23.0, 180.0, 270.0, 360.0]))
@few
def test_grid_hides_no_surface_from_a_sensor(seed, fov):
    # Sensors and vehicles also exactly on borders of cells and outside of the grid of walls; walls longer than cells.
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 300, (60, 2))
    scene = Scene(np.hstack([start, start + rng.normal(0, 10, (60, 2)) * rng.choice([1, 10], (60, 1))]))
    place = rng.uniform(-100, 400, (2, 50))
    snapped = rng.random((2, 50)) < 0.3
    place[snapped] = np.rint(place[snapped] / CELL) * CELL
    boxes = Boxes(*place, rng.uniform(-3, 3, 50), rng.uniform(1, 20, 50), rng.uniform(1, 3, 50), np.arange(50))
    model = dataclasses.replace(VIEW, angle_min=-math.radians(fov) / 2, angle_max=math.radians(fov) / 2)
    same(*both(model, scene, boxes, boxes.x[:20], boxes.y[:20], boxes.heading[:20], boxes.owner[:20]))


@given(seed=st.integers(0, 2**32 - 1), angle_min=st.floats(-6.28, 3.0), span=st.floats(0.01, 6.28))
@few
def test_fan_may_begin_anywhere(seed, angle_min, span):
    rng = np.random.default_rng(seed)
    model = LidarModel(50, angle_min, min(angle_min + span, 6.28), 0.0, 45.0)
    scene, boxes = Scene(rng.uniform(-30, 30, (20, 4))), Boxes.empty()
    same(*both(model, scene, boxes, *rng.uniform(-30, 30, (2, 3)), rng.uniform(-9, 9, 3), [0, 0, 0]))


@pytest.mark.parametrize("samples", [2, 3, 100_000])
def test_two_beams_and_a_hundred_thousand_agree_with_numpy(samples):
    rng = np.random.default_rng(samples)
    scene, boxes = Scene(rng.uniform(-30, 30, (200, 4))), Boxes.empty()
    for half in (math.pi, 2.6, 0.2, 1e-3):
        model = LidarModel(samples, -half, half, 0.0, 45.0)
        same(*both(model, scene, boxes, *rng.uniform(-30, 30, (2, 5)), rng.uniform(-3, 3, 5), [0] * 5))


def test_memory_for_faces_grows_with_the_surfaces_in_sight():
    rng = np.random.default_rng(0)
    boxes = Boxes(*rng.uniform(-40, 40, (2, 2000)), *[np.full(2000, 0.1)] * 3, np.arange(2000))
    scene = Scene(rng.uniform(-40, 40, (2000, 4)))
    same(*both(VIEW, scene, boxes, [0.0, 1.0], [0.0, 2.0], [0.0, 2.0], [0, 1]))


def test_far_flung_world_takes_no_more_memory():
    # SUMO has vehicles that are not on the road yet at -2^30 m.
    scene = Scene([(0, 5, 10, 5), (1e6, 1e6, 1e6 + 1, 1e6)])
    boxes = Boxes([20, -(2.0**30)], [0, -(2.0**30)], [0, 0], [4, 4], [2, 2], [1, 2])
    raster, plain = both(VIEW, scene, boxes, [0, 1e6], [0, 1e6 - 3], [0, 1.5], [0, 0])
    same(raster, plain)
    assert raster.hits[0, 90] == 1
    assert len(scene.kept["walls"][1]) < 2000


def test_few_long_walls_take_no_more_memory():
    scene = Scene([(-1e8, 5, 1e8, 5), (3, -1, 3, 1)])
    same(*both(VIEW, scene, Boxes.empty(), [0.0, 9e7], [0.0, 0.0], [0.0, 1.0], [0, 0]))
    assert scene.kept["walls"][2].shape[1] < 2000


def test_empty_worlds_and_empty_batches_scan():
    for scene, boxes in (world(), world([(1, -1, 1, 1)]), world(boxes=[(3, 0, 0, 1, 1, 1)])):
        same(*both(VIEW, scene, boxes, [0], [0], [0], [0]))
        assert scan(VIEW, scene, boxes, Carriers([], [], [], [])).ranges.shape == (0, 181)


def test_approximate_angle_is_good_to_half_a_beam_of_the_finest_fan_it_serves():
    angles = np.linspace(-math.pi, math.pi, 100_001)[1:]
    for size in (1e-9, 1.0, 1e9):
        rough = np.array([raster_engine._angle(size * math.cos(a), size * math.sin(a)) for a in angles])
        assert np.abs(rough - angles).max() < 3e-6 < 0.25 / raster_engine.FINE


def test_repeated_scans_take_no_more_memory():
    rng = np.random.default_rng(0)
    scene = Scene(rng.uniform(0, 100, (300, 4)))
    boxes = Boxes(*rng.uniform(0, 100, (2, 50)), *[np.ones(50)] * 3, np.arange(50))
    out = None
    for number in range(4000):
        before = out
        out = scan(VIEW, scene, boxes, Carriers.of(boxes), Occasion(number=number), out=out)
        assert before is None or (out.ranges is before.ranges and out.hits is before.hits)
        if number == 2999:  # whatever numpy and Python keep for later is full by then
            gc.collect()
            settled = sys.getallocatedblocks()
    gc.collect()
    assert sys.getallocatedblocks() < settled + 100  # 500 scans of 50 sensors


def python(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_lidar_is_imported_without_numba_and_pymunk():
    assert python("import sys, platoontraffic.lidar; print({'numba', 'pymunk'} & set(sys.modules))") == "set()"


def test_commands_that_prepare_no_run_never_import_numba():
    commands = [["list"], *(["list", kind] for kind in ("scenarios", "nets", "laws", "vehicles", "lidars"))]
    code = (
        "import sys\nfrom platoontraffic.cli.main import app\n"
        f"for words in {commands}:\n"
        "    app(words, standalone_mode=False)\n"
        "print('numba' in sys.modules)"
    )
    assert python(code).splitlines()[-1] == "False"


@pytest.mark.parametrize("kernel", [raster_engine._scan, bicycle_kernel.move])
def test_compiled_code_is_kept_until_any_file_that_a_kernel_calls_changes(kernel):
    # numba looks at one file only; the stamp that it compares is that of all.
    of_cars = [module.__file__ for module in (bicycle_kernel, bicycle_formulas, motion)]
    files = compiled.OWN if kernel is raster_engine._scan else of_cars
    assert kernel._cache._cache_file._source_stamp == compiled.digest(files)


def test_a_changed_file_changes_the_stamp(tmp_path):
    copies = [Path(shutil.copy(file, tmp_path)) for file in (noise.__file__, compiled.__file__)]
    before = compiled.digest(copies)
    with copies[0].open("a") as file:
        file.write("# changed\n")
    assert compiled.digest(copies) != before


def test_compiled_code_of_types_that_are_gone_is_compiled_anew(tmp_path):
    """As after an update: the list of what is kept names a record that the new code does not have."""
    code = (
        "from typing import NamedTuple\nfrom platoontraffic.lidar.compiled import compiler\n"
        "class {0}(NamedTuple):\n    x: float\n"
        "@compiler(__file__)\ndef double(record):\n    return 2 * record.x\n"
        "print(double({0}(1.5)))\n"
    )
    for name in ("Older", "Newer"):
        (tmp_path / "kernels.py").write_text(code.format(name))
        assert python(f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import kernels") == "3.0"


def test_kernels_compile_anew_where_no_cache_can_be_written(tmp_path):
    # No place for the cache: neither beside the source nor in a home folder.
    code = (
        "import numba.core.caching as c\n"
        "c.CacheImpl._locator_classes = []\nc.CompileResultCacheImpl._locator_classes = []\n"
        "from platoontraffic.lidar.compiled import compiled\n"
        "print(compiled(lambda x: x + 1)(1))"
    )
    assert python(code) == "2"
