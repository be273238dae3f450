"""Time of a scan by engine, in random worlds of the density of a town: a table on stdout.

    python tests/benchmarks/lidar_engines.py

CPU time of the whole call for 100 sensors of 720 beams, median of 5, per scan; and the largest difference to numpy.
"""

from __future__ import annotations

import time

import numpy as np

from lidar import Boxes, LidarModel, Scene, scan

VIEWS = {
    "180 deg, 30 m": (90, 30.0),
    "180 deg, 60 m": (90, 60.0),
    "23 deg, 30 m": (11.5, 30.0),
    "360 deg, 60 m": (180, 60.0),
}
WORLDS = {"small": (2_000, 300, 600.0), "town": (20_000, 1_000, 2_000.0)}  # walls, vehicles, side [m]
SENSORS = 100


def world(walls: int, vehicles: int, side: float) -> tuple[Scene, Boxes]:
    rng = np.random.default_rng(1)
    start = rng.uniform(0, side, (walls, 2))
    scene = Scene(np.hstack([start, start + rng.normal(0, 10, (walls, 2))]))
    place = rng.uniform(0, side, (2, vehicles))
    shape = rng.uniform(-3, 3, vehicles), rng.uniform(3, 6, vehicles), rng.uniform(1.5, 2.5, vehicles)
    return scene, Boxes(*place, *shape, owner=np.arange(vehicles))


def main() -> None:
    print(f"{'world':8}{'view':16}{'numpy us':>10}{'raster us':>11}{'ratio':>7}{'difference m':>15}")
    for name, size in WORLDS.items():
        scene, boxes = world(*size)
        poses = boxes.x[:SENSORS], boxes.y[:SENSORS], boxes.heading[:SENSORS], boxes.owner[:SENSORS]
        for view, (half, reach) in VIEWS.items():
            model = LidarModel(720, -np.radians(half), np.radians(half), 0.3, reach)
            spent, ranges = {}, {}
            for engine in ("numpy", "raster"):
                times = []
                for _ in range(6):  # the first compiles
                    began = time.thread_time()
                    ranges[engine] = scan(model, scene, boxes, *poses, engine=engine, dtype=np.float64).ranges
                    times.append(time.thread_time() - began)
                spent[engine] = 1e6 * float(np.median(times[1:])) / SENSORS
            both = np.isfinite(ranges["numpy"]) & np.isfinite(ranges["raster"])
            difference = np.abs(ranges["numpy"][both] - ranges["raster"][both]).max()
            ratio = spent["numpy"] / spent["raster"]
            print(f"{name:8}{view:16}{spent['numpy']:10.1f}{spent['raster']:11.1f}{ratio:7.1f}{difference:15.1e}")


if __name__ == "__main__":
    main()
