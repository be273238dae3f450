"""Print how often background vehicles overlap and leave the road, and how often members of platoons do.

    .venv/bin/python tests/benchmarks/overlaps.py SCENARIO [BATCH ...]

SCENARIO: its background traffic drives alone, for ten minutes after the warm-up. BATCH: folders of batches there.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import shapely

from platoontraffic import scenario
from platoontraffic.analysis import load
from platoontraffic.results.sumo_tables import sumo_options
from platoontraffic.road.network import Network
from platoontraffic.sumo.world import World
from platoontraffic.world.fleet import Fleet

STEP, SECONDS = 0.1, 600.0
OFF_ROAD = 0.3  # distance of the rear axle, a quarter of the length before the rear, from the road [m]


def background(source: str) -> tuple[float, int, int]:
    """Vehicle hours, episodes of overlap, episodes off the road."""
    loaded, none = scenario.load(source), Fleet.deployed([], STEP)
    network = Network.read(loaded.net)
    road = network.drivable.buffer(OFF_ROAD)
    shapely.prepare(road)
    hours, overlaps, off = 0.0, 0, 0
    pairs, outside = set(), set()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options, warm_up = sumo_options(loaded, folder), loaded.spec.sumo.warm_up_s
        with World(network, STEP, loaded.seed, folder / "words.log", options, warm_up) as world:
            world.deploy(none)
            for _ in range(round(SECONDS / STEP)):
                world.advance(none)
                traffic = world.snapshot(none)
                hours += len(traffic.ids) * STEP / 3600
                boxes = shapely.polygons(traffic.boxes().corners())
                a, b = shapely.STRtree(boxes).query(boxes, predicate="intersects")
                now = {(traffic.ids[i], traffic.ids[k]) for i, k in zip(a, b, strict=True) if i < k}
                back = traffic.length / 4
                x, y = traffic.x - back * np.cos(traffic.heading), traffic.y - back * np.sin(traffic.heading)
                beside = {traffic.ids[i] for i in np.flatnonzero(~shapely.contains_xy(road, x, y))}
                overlaps += len(now - pairs)
                off += len(beside - outside)
                pairs, outside = now, beside
    return hours, overlaps, off


def members(folder: str) -> tuple[float, int, int, int]:
    """Vehicle hours, contacts, contacts that members caused, episodes off the road."""
    batch = load(folder)
    metrics, events = batch.table("metrics"), batch.table("events")
    run = metrics[metrics.scope == "run"].groupby("metric").value.sum()
    hours = 0.0
    for _, own in events.groupby("id"):
        end = own.loc[own.kind == "end", "time_s"].iloc[0]
        came, went = (own[own.kind == kind].set_index("vehicle_id").time_s for kind in ("departed", "arrived"))
        hours += (went.reindex(came.index).fillna(end) - came).sum() / 3600
    return hours, int(run.collisions), int(run.collisions_caused), int((events.kind == "off_road").sum())


def main() -> None:
    source, *batches = sys.argv[1:]
    hours, overlaps, off = background(source)
    print(f"background traffic: {hours:.1f} vehicle hours, overlaps {overlaps} ({overlaps / hours:.2f} an hour), "
          f"off the road {off} ({off / hours:.2f} an hour)")  # fmt: skip
    for folder in batches:
        hours, contacts, caused, off = members(folder)
        print(f"{folder}: {hours:.1f} vehicle hours, contacts {contacts} ({contacts / hours:.2f} an hour), "
              f"caused {caused}, off the road {off}")  # fmt: skip


if __name__ == "__main__":
    main()
