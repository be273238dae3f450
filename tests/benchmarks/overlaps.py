"""Print how often SUMO's own vehicles overlap and leave the road, beside what members of platoons do.

    .venv/bin/python tests/benchmarks/overlaps.py SCENARIO [BATCH ...]

SCENARIO: a scenario or a SUMO configuration, of which the traffic alone is driven, for ten minutes after its warm-up
(five minutes of a configuration). BATCH: folders of batches of runs there.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
import shapely

from analysis import load
from lidar import Boxes
from platoontraffic import scenario
from platoontraffic.network import Network, read_configuration
from platoontraffic.sumo import centre_of, heading_of, libsumo

STEP, SECONDS = 0.1, 600.0
OFF_ROAD = 0.3  # [m], of the rear axle, a quarter of the length before the rear


def options(source: str) -> tuple[Path, list[str], float]:
    if source.endswith((".sumocfg", ".netecfg")):
        config = read_configuration(Path(source))
        return config.net, ["-c", source], 300.0
    loaded = scenario.load(source)
    files = {"-n": [loaded.net], "-r": loaded.route_files, "-a": loaded.additional}
    words = [word for option, paths in files.items() if paths for word in (option, ",".join(map(str, paths)))]
    return loaded.net, words, loaded.spec.sumo.warm_up_s


def natives(source: str) -> tuple[float, int, int]:
    """Vehicle hours, episodes of overlap, episodes off the road."""
    net, words, warm_up = options(source)
    road = Network.read(net).drivable.buffer(OFF_ROAD)
    shapely.prepare(road)
    with tempfile.TemporaryDirectory() as folder:
        kept = os.dup(2)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        libsumo.start(["sumo", *words, "--step-length", str(STEP), "--no-step-log", "--output-prefix", f"{folder}/",
                       "--time-to-teleport", "-1", "--collision.action", "none"])  # fmt: skip
        libsumo.simulationStep(libsumo.simulation.getTime() + warm_up)
        hours, pairs, outside, episodes = 0.0, set(), set(), [0, 0]
        for _ in range(round(SECONDS / STEP)):
            libsumo.simulationStep()
            names = libsumo.vehicle.getIDList()
            hours += len(names) * STEP / 3600
            front = np.array([libsumo.vehicle.getPosition(name) for name in names]).reshape(-1, 2)
            heading = heading_of(np.array([libsumo.vehicle.getAngle(name) for name in names]))
            length, width = (
                np.array([get(name) for name in names]) for get in (libsumo.vehicle.getLength, libsumo.vehicle.getWidth)
            )
            x, y = centre_of(*front.T, heading, length)
            boxes = shapely.polygons(Boxes(x, y, heading, length, width, np.arange(len(names))).corners())
            a, b = shapely.STRtree(boxes).query(boxes, predicate="intersects")
            now = {(names[i], names[k]) for i, k in zip(a, b, strict=True) if i < k}
            axle = x - length / 4 * np.cos(heading), y - length / 4 * np.sin(heading)
            off = {names[i] for i in np.flatnonzero(~shapely.contains_xy(road, *axle))}
            episodes[0] += len(now - pairs)
            episodes[1] += len(off - outside)
            pairs, outside = now, off
        libsumo.close()
        os.dup2(kept, 2)
    return hours, *episodes


def members(folder: str) -> tuple[float, int, int, int]:
    """Vehicle hours, contacts, those that they caused, episodes off the road."""
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
    hours, overlaps, off = natives(source)
    print(f"SUMO's own: {hours:.1f} vehicle hours, overlaps {overlaps} ({overlaps / hours:.2f} an hour), "
          f"off the road {off} ({off / hours:.2f} an hour)")  # fmt: skip
    for folder in batches:
        hours, contacts, caused, off = members(folder)
        print(f"{folder}: {hours:.1f} vehicle hours, contacts {contacts} ({contacts / hours:.2f} an hour), "
              f"caused {caused}, off the road {off}")  # fmt: skip


if __name__ == "__main__":
    main()
