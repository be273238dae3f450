"""The learned follower beside `repaired` on ten seeds: `python judge.py [RESULTS]` runs judge.toml, prints a table."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import platoontraffic

METRICS = ["cross_track_rms", "cross_track_max", "lock_on_ratio", "lock_losses", "gap_mean", "gap_error_rms"]


def main() -> None:
    results = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("results")
    batch = platoontraffic.batch(Path(__file__).with_name("judge.toml"), results=results)
    table = batch.table("metrics")
    table["law"] = table["platoon.follower"].map(lambda text: json.loads(text)["law"])
    own = table[(table.vehicle_id == "robot.1") & table.metric.isin(METRICS)]
    wide = own.pivot_table(index=["metric", "seed"], columns="law", values="value").loc[METRICS]
    summary = wide.groupby("metric", sort=False).agg(["mean", "min", "max"])
    print(summary.round(4).to_string())
    path, lock = wide.loc["cross_track_rms"], wide.loc["lock_on_ratio"]
    print(f"nearer to the predecessor's path on {(path.policy < path.repaired).sum()} of {len(path)} seeds,")
    print(f"longer locked on {(lock.policy > lock.repaired).sum()}")


if __name__ == "__main__":
    main()
