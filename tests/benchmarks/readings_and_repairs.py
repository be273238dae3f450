"""Which readings of the paper's follower, and which repairs, keep the platoon together: a table in Markdown.

    python tests/benchmarks/readings_and_repairs.py

Every row is a run of a shipped scenario with the arguments shown. "First lost" is the follower nearest to the leader
among those that lost their predecessor for more than ten seconds, and when, where and how it first did.
"""

from __future__ import annotations

import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pandas as pd

LOST_AFTER = 10.0  # [s]

ROWS = [
    ("as printed, default readings", "paper_printed", ""),
    ("the step `range[i+1] - range[i] > 0.5` as printed", "paper_printed", "platoon.follower.edge=signed"),
    ("no return is infinity", "paper_printed", "platoon.follower.no_return=infinity"),
    ("ω = θ - 90 in degrees, as rad/s", "paper_printed", "platoon.follower.yaw_unit=deg"),
    ("θ of the speed is the bearing", "paper_printed", "platoon.follower.angle_in_speed=bearing"),
    ("hold the last command at a loss", "paper_printed", "platoon.follower.on_loss=hold"),
    ("distance sufficient above 0.45 m", "paper_printed", "platoon.follower.sufficient_distance_m=0.45"),
    ("leader at 0.45 m/s", "paper_printed", "platoon.leader.speed_mps=0.45"),
    ("all three repairs", "paper_loop", ""),
    ("without `nearest_group`", "paper_loop", "platoon.follower.nearest_group=false"),
    ("without `visible_middle`", "paper_loop", "platoon.follower.visible_middle=false"),
    ("without `stand_off`", "paper_loop", "platoon.follower.stand_off_m=0.0"),
]


def row(text: str, name: str, argument: str) -> str:
    from platoontraffic import scenario, simulation
    from platoontraffic.recording import run as run_into

    changes = ["run.duration_s=600", *([argument] if argument else [])]
    prepared = simulation.prepare(scenario.load(name, changes))
    with tempfile.TemporaryDirectory() as results:
        folder = run_into(prepared, Path(results) / "run")
        metrics, events = (pd.read_csv(folder / f"{table}.csv") for table in ("metrics", "events"))
    followers = metrics[(metrics.scope == "vehicle") & ~metrics.vehicle_id.fillna("").str.endswith(".0")]
    corners = followers[followers.metric == "corners"].value.min()
    contacts = metrics[(metrics.scope == "run") & (metrics.metric == "collisions")].value.iloc[0]
    when = "never"
    for vehicle in followers.vehicle_id.unique():
        own = events[(events.vehicle_id == vehicle) & events.kind.isin(["locked", "lock_lost", "lock_regained"])]
        until = own.time_s.shift(-1).fillna(events.time_s.max())
        lost = own[(own.kind == "lock_lost") & (until - own.time_s > LOST_AFTER)]
        if own.empty:
            when = f"{vehicle} never found it"
        elif len(lost):
            e = lost.iloc[0]
            when = f"{vehicle} at {e.time_s:.1f} s, ({e.x_m:.2f}, {e.y_m:.2f}) m: {e.detail}"
        else:
            continue
        break
    return f"| {text} | `{argument}` | {corners:g} | {when} | {contacts:g} |".replace("``", "")


def main() -> None:
    print("| follower | change | corners | first lost | contacts |\n| --- | --- | --- | --- | --- |")
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for line in pool.map(row, *zip(*ROWS, strict=True)):
            print(line, flush=True)


if __name__ == "__main__":
    main()
