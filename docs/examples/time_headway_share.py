"""A metric of one's own: how often a follower drives too close.

    platoontraffic run mine.toml record.metrics=time_headway_share.py:TimeHeadwayShare

with this file beside the scenario mine.toml. Its values are in metrics.csv, and for the run in summary.csv.
"""

from dataclasses import dataclass

import pandas as pd


@dataclass(frozen=True)
class TimeHeadwayShare:
    name = "short_headway_share"
    unit = ""
    meaning = "share of the recorded instants with a value of time_gap_s at which that is below 1 s"
    over = "max"  # platoons and the run have the largest value over their members

    def __call__(self, trajectories: pd.DataFrame, events: pd.DataFrame) -> dict[str, float]:
        rows = trajectories.dropna(subset="time_gap_s")
        return (rows.time_gap_s < 1.0).groupby(rows.vehicle_id).mean().to_dict()
