"""Frames of videos: they show the vehicles that are there."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from platoontraffic.analysis import load
from platoontraffic.replay.video import _drawing
from tests.replay.test_replay import WITH_GAPS, with_gaps
from tests.support.made_runs import made_run


def changed(folder: Path, change) -> Path:
    rows = pd.read_csv(folder / "trajectories.csv")
    change(rows).to_csv(folder / "trajectories.csv", index=False)
    return folder


def test_a_frame_shows_nobody_where_a_table_has_no_rows(tmp_path):
    figure, show = _drawing(load(with_gaps(made_run(tmp_path / "run", seconds=10.0))))
    members, others = figure.axes[0].collections
    for time, *there in WITH_GAPS:
        show(time)
        assert [len(members.get_paths()), len(others.get_paths())] == there, time


@pytest.mark.parametrize("heading", [0.0, 0.5, 1.0, -0.5])
def test_all_of_a_platoon_is_in_the_frame_whatever_its_direction(heading, tmp_path):
    """Of one to the north or south, the first and the last were outside."""
    heading *= np.pi

    def turned(rows: pd.DataFrame) -> pd.DataFrame:
        along = 10 * rows.time_s - 30 * rows.place
        return rows.assign(x_m=along * np.cos(heading), y_m=along * np.sin(heading), heading_rad=heading)

    folder = changed(made_run(tmp_path / "run", members=5, seconds=2.0), turned)
    figure, show = _drawing(load(folder))
    show(1.0)
    road = figure.axes[0]
    corners = np.concatenate([path.vertices for path in road.collections[0].get_paths()])
    for values, (low, high) in zip(corners.T, (road.get_xlim(), road.get_ylim()), strict=True):
        assert low < values.min() < values.max() < high


def test_a_crowd_has_no_legend_of_its_members(tmp_path):
    results = load(made_run(tmp_path / "run", members=40, seconds=2.0))
    with warnings.catch_warnings(action="error"):
        figure, show = _drawing(results)
        show(1.0)
        figure.savefig(tmp_path / "frame.png")
    road, below = figure.axes
    assert [text.get_text() for text in below.get_legend().get_texts()] == ["90 %", "median of the members"]
    assert len(road.collections[0].get_paths()) == 40
    view = road.get_xlim(), road.get_ylim()
    show(2.0)
    assert (road.get_xlim(), road.get_ylim()) == view  # it stands still


def test_the_frame_goes_on_with_another_platoon_when_the_largest_has_left(tmp_path):
    def two(rows: pd.DataFrame) -> pd.DataFrame:
        small = rows[(rows.place < 2) & (rows.time_s > 2)]
        small = small.assign(platoon_id="late", vehicle_id="late." + small.place.astype(str), x_m=small.x_m + 500)
        return pd.concat([rows[rows.time_s < 1], small])

    figure, show = _drawing(load(changed(made_run(tmp_path / "run", seconds=4.0), two)))
    show(0.5)
    assert np.mean(figure.axes[0].get_xlim()) < 200
    show(3.0)
    assert np.mean(figure.axes[0].get_xlim()) > 400
    assert figure.axes[1].get_xlim() == (0.0, 4.0)
