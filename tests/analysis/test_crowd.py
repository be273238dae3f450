"""Pictures of hundreds of members: what they show, against made trajectories."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from platoontraffic.analysis import crowd
from platoontraffic.analysis.results import ResultsError

SCENE = {"road": [[[0, 0], [1000, 0], [1000, 10], [0, 10]]], "middle": [], "walls": []}


@pytest.fixture
def axes():
    return Figure().subplots()


def driving(n: int = 30, every: float = 1.0, until: float = 60.0) -> pd.DataFrame:
    """Member i drives at 10 + i / 10 m/s along y = 5 m from x = 0, one second after the one before."""
    rows = [
        (t, "equip", f"v{i}", 0, (10 + i / 10) * (t - i), 5.0, 0.0, 10 + i / 10)
        for i in range(n)
        for t in np.arange(i, until, every)
    ]
    names = ["time_s", "platoon_id", "vehicle_id", "place", "x_m", "y_m", "heading_rad", "speed_mps"]
    return pd.DataFrame(rows, columns=names)


@pytest.mark.parametrize(("n", "many"), [(crowd.MOST, False), (crowd.MOST + 1, True)])
def test_members_that_cannot_be_told_apart_are_a_crowd(n, many):
    assert crowd.is_crowd(driving(n)) == many


def test_the_median_and_ninety_percent_of_the_members(axes):
    crowd.over_time(driving(21), "speed_mps", axes)
    (line,) = axes.lines
    assert line.get_ydata()[-1] == pytest.approx(11.0)  # of 10.0, 10.1, …, 12.0
    band = axes.collections[0].get_paths()[0].vertices
    assert {*np.round(band[band[:, 0] == 59.0, 1], 9)} == {10.1, 11.9}


def test_members_on_the_road_are_counted(axes):
    table = driving(25)
    table.loc[table.time_s == 30, "speed_mps"] = 0.0
    crowd.number(table, axes)
    counted = dict(zip(*axes.lines[0].get_data(), strict=True))
    assert (counted[0], counted[10], counted[30]) == (1, 11, 25)
    standing = axes.collections[0].get_paths()[0].vertices
    assert standing[:, 1].max() == 25


def test_the_cells_of_a_map_hold_all_members(axes):
    """Their sum is the mean number of members on the road."""
    table = driving(30)
    crowd.density(table, axes, SCENE)
    cells = axes.collections[-1].get_array()
    assert cells.sum() == pytest.approx(len(table) / table.time_s.nunique())


def test_a_cell_in_which_members_stand_does_not_take_the_colours_of_the_others(axes):
    table = driving(30)
    stands = table[table.vehicle_id == "v3"].assign(vehicle_id="stands", x_m=200.0)
    crowd.density(pd.concat([table, *[stands] * 20]), axes, SCENE)
    cells = axes.collections[-1]
    assert cells.norm.vmax < 0.2 * cells.get_array().max()
    assert axes.figure.axes[-1].get_xlabel().startswith("mean number of members")


def test_stations_are_those_along_the_farthest_path(axes):
    crowd.time_space(driving(30), axes)
    assert len(axes.lines) == 30
    times, stations = axes.lines[3].get_data()  # of v11, after v0, v1, v10
    assert np.nanmax(np.abs(stations - 11.1 * (np.asarray(times) - 11))) < 1e-6


def test_paths_that_all_meet_themselves_have_no_diagram(axes):
    table = driving(30)
    there = table.groupby("vehicle_id").cumcount()
    table["x_m"], table["y_m"] = np.where(there % 2, there, -there), there % 3
    with pytest.raises(ResultsError, match="meet itself"):
        crowd.time_space(table, axes)
