"""Every figure is drawn where there is no SUMO, and shows what its table says."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from platoontraffic import analysis
from platoontraffic.analysis import (
    ResultsError,
    amplification,
    crowd,
    estimates,
    growth,
    heat_map,
    label,
    load,
    losses,
    over_time,
    paired,
    paths,
    pictures,
    road,
    states,
    summarise,
    time_space,
)
from platoontraffic.analysis.figures import gap_distribution, line_style, main_platoon, offsets
from platoontraffic.analysis.following import SPLIT_AFTER
from platoontraffic.analysis.pictures import strips_figure
from tests.support.made_runs import RADIUS, SPEED, made_run

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    """A made run: three members; the second loses its predecessor from 10 to 12 s."""
    return load(made_run(tmp_path_factory.mktemp("made") / "ring"))


@pytest.fixture
def axes():
    return Figure().subplots()


@pytest.fixture
def summary() -> pd.DataFrame:
    rng = np.random.default_rng(1)
    points = [(size, demand, seed) for size in (1, 3, 5) for demand in (0.5, 1.0) for seed in range(6)]
    table = pd.DataFrame(points, columns=["platoon.size", "sumo.demand", "seed"])
    table["traffic_delay_mean_finished_s"] = (
        5 * table["sumo.demand"] + table["platoon.size"] + rng.normal(size=len(table))
    )
    table.attrs["units"] = {"traffic_delay_mean_finished_s": "s"}
    return table


def legend(axes) -> list[str]:
    return axes.get_legend_handles_labels()[1]


@pytest.mark.parametrize(
    ("column", "said", "followers"),
    [
        ("gap_m", "gap to the member ahead [m]", 2),
        ("gap_error_m", "spacing error [m]", 2),
        ("speed_mps", "speed [m/s]", 3),
        ("accel_mps2", "acceleration [m/s²]", 3),
    ],
)
def test_over_time_has_a_line_a_member_that_has_values(ring, axes, column, said, followers):
    assert over_time(ring.trajectories, column, axes) is axes
    assert legend(axes) == ["platoon.0", "platoon.1", "platoon.2"][-followers:]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", said)
    own = ring.trajectories[ring.trajectories.vehicle_id == "platoon.2"]
    np.testing.assert_array_equal(axes.lines[-1].get_ydata(), own[column])


def test_losses_are_bars_from_the_loss_to_the_lock(ring, axes):
    losses(ring.events, axes, ring.trajectories)
    (bar,) = [path for bars in axes.collections for path in bars.get_paths()]
    assert bar.get_extents().intervalx.tolist() == [10, 12]


def orders(ring) -> pd.DataFrame:
    """The events of the run, and orders by which the last member is split off from 5 to 9 s."""
    columns = ["time_s", "kind", "vehicle_id", "other_id", "what", "done"]
    told = [
        (5.0, "told", "platoon.2", "", "split", 1),
        (9.0, "told", "platoon.2", "platoon.1", "join", 1),
        (9.0, "rejoined", "platoon.2", "platoon.1", "", None),
        (15.0, "told", "platoon.1", "", "split", 0),
    ]
    return pd.concat([ring.events, pd.DataFrame(told, columns=columns)]).sort_values("time_s", kind="stable")


def test_a_member_that_an_order_splits_off_has_a_bar(ring, axes):
    states(orders(ring), axes, ring.trajectories)
    (bar,) = [path for bars in axes.collections for path in bars.get_paths()]
    assert bar.get_extents().intervalx.tolist() == [5, 9]
    assert bar.get_extents().intervaly.mean() == -2


def test_members_of_no_platoon_have_a_row_each(ring, axes):
    """Each has the place 0: all bars lay in one row, and each state was in the legend once for each member."""
    rows = ring.trajectories.assign(place=0)
    names = sorted(rows.vehicle_id.unique())
    held = [{"kind": "held", "time_s": 2.0 + k, "vehicle_id": name} for k, name in enumerate(names)]
    states(pd.DataFrame(held), axes, rows)
    bars = [path.get_extents() for bars in axes.collections for path in bars.get_paths()]
    assert [round(bar.intervaly.mean()) for bar in bars] == [-k for k in range(len(names))]
    assert legend(axes) == ["split off", "held", "broken"]
    assert axes.get_ylim() == pytest.approx((0.4 - len(names), 0.6))


def test_members_of_no_platoon_have_a_line_style_each(ring, axes):
    """All have place 0, and had one style."""
    table = ring.trajectories.assign(place=0)
    over_time(table, "speed_mps", axes)
    styles = {(line.get_color(), line.get_marker()) for line in axes.lines}
    assert len(styles) == len(axes.lines) == table.vehicle_id.nunique() > 1


def test_as_many_members_as_are_named_have_a_line_style_each(ring):
    styles = [line_style(place, ring.trajectories) for place in range(crowd.MOST + 1)]
    assert len({(style["color"], style["marker"]) for style in styles}) == len(styles)
    assert all(one["marker"] != other["marker"] for one, other in pairwise(styles))


@pytest.mark.parametrize("name", ["a", 60 * "a"])
def test_a_legend_lies_within_its_picture(ring, name):
    """Long names were cut off at both edges."""
    ids = {vehicle: f"{name}.{i}" for i, vehicle in enumerate(ring.trajectories.vehicle_id.unique())}
    long = replace(ring, trajectories=ring.trajectories.assign(vehicle_id=ring.trajectories.vehicle_id.map(ids)))
    made = pictures.figure(long, "speed")
    made.canvas.draw()
    (legend,) = made.legends
    box = legend.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= made.bbox.width


def test_strips_show_splits_by_order(ring):
    by_order = replace(ring, events=orders(ring))
    plain, split = (strips_figure(one) for one in (ring, by_order))
    assert len(split.axes) == len(plain.axes) + 1


def test_gaps_while_an_order_has_split_a_member_off_are_no_gaps_of_the_platoon(ring, axes):
    far = ring.trajectories.assign(gap_m=lambda t: t.gap_m.where((t.place < 2) | ~t.time_s.between(5, 9), 900.0))
    gap_distribution(far, axes, orders(ring))
    assert max(line.get_xdata().max() for line in axes.lines) < 20


def test_without_a_loss_it_says_never(ring, axes):
    losses(ring.events[ring.events.kind != "lock_lost"], axes, ring.trajectories)
    assert [text.get_text() for text in axes.texts] == ["never"]


def test_states_are_bars_from_begin_to_end_or_to_the_last_instant(ring, axes):
    rows = [("held", 3.0), ("released", 5.0), ("split", 4.0), ("breaks_down", 8.0), ("repaired", 9.0), ("held", 9.5)]
    events = pd.DataFrame([{"kind": kind, "time_s": time, "vehicle_id": "platoon.1"} for kind, time in rows])
    states(events, axes, ring.trajectories)
    last = ring.trajectories.time_s.max()
    bars = [path.get_extents().intervalx.tolist() for bars in axes.collections for path in bars.get_paths()]
    assert bars == [[4 - SPLIT_AFTER, last], [3, 5], [9.5, last], [8, 9]]  # a split is an event when it has lasted
    assert legend(axes) == ["split off", "held", "broken"]


def test_time_space_is_the_way_driven(ring, axes):
    time_space(ring.trajectories, axes)
    time, way = axes.lines[0].get_data()
    np.testing.assert_allclose(way, SPEED * time, rtol=1e-3)
    start = [line.get_ydata()[0] for line in axes.lines]
    assert start[0] == 0
    assert start[0] > start[1] > start[2]


def test_time_space_along_a_line_shows_traffic_too(ring, axes):
    turn = np.linspace(0, 2 * np.pi, 721)
    line = RADIUS * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    time_space(ring.traffic, axes, line)
    near = len(axes.lines)
    time_space(ring.trajectories, axes, line)
    time, way = axes.lines[near].get_data()
    np.testing.assert_allclose(np.diff(way), SPEED * np.diff(time), rtol=1e-2)
    drawn = np.array([np.isfinite(line.get_ydata()).any() for line in axes.lines[:near]])
    assert 0 < drawn.sum() < near  # those on lanes more than 6 m away are on another road


def test_growth_has_a_point_a_place_and_says_where_it_neither_grows_nor_falls(ring, axes):
    table = amplification(ring.trajectories, 1 / (2 * np.pi))
    growth(table, axes)
    assert axes.containers[0].lines[0].get_ydata() == pytest.approx([1, 1, 1], abs=0.01)
    assert [line.get_ydata() for line in axes.lines][-1] == [1, 1]


def test_estimates_are_points_with_bars(summary, axes):
    table = summarise(summary, "traffic_delay_mean_finished_s", ["platoon.size", "sumo.demand"])
    estimates(table, "sumo.demand", axes, by="platoon.size")
    assert axes.get_ylabel() == "traffic delay mean finished [s]"
    assert axes.get_legend().get_title().get_text() == "size"
    own = table[table["platoon.size"] == 3]
    points, _, (bars,) = axes.containers[1].lines
    np.testing.assert_allclose(points.get_ydata(), own["mean"])
    np.testing.assert_allclose([ends[:, 1] for ends in bars.get_segments()], own[["low", "high"]].to_numpy())


def test_equal_curves_can_all_be_seen(axes):
    points = [
        (law, x, mean) for law, means in (("a", (1, 2)), ("b", (1, 3)), ("c", (1, 2))) for x, mean in enumerate(means)
    ]
    table = pd.DataFrame(points, columns=["law", "x", "mean"]).assign(metric="m", low=0.0, high=4.0)
    estimates(table, "x", axes, "law")
    (a, *_), (b, *_), (c, *_) = axes.containers
    assert a.get_linewidth() > b.get_linewidth() == c.get_linewidth()
    assert a.get_markersize() > b.get_markersize() == c.get_markersize()


def test_estimates_over_texts_stand_side_by_side(axes):
    runs = pd.DataFrame({"law": ["tracking", "tracking", "acc", "acc"], "gap_m_mean": [1.0, 2.0, 3.0, 5.0]})
    estimates(summarise(runs, "gap_m_mean", "law"), "law", axes)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["acc", "tracking"]
    (points,) = axes.containers
    assert points[0].get_xydata().tolist() == [[0.0, 4.0], [1.0, 1.5]]


def test_estimates_of_differences_are_drawn_alike(summary, axes):
    table = paired(summary, "traffic_delay_mean_finished_s", "platoon.size", (1, 5), "sumo.demand")
    assert estimates(table, "sumo.demand", axes) is axes


def test_a_heat_map_has_a_cell_a_point_and_a_cross_where_no_run_is(summary, axes):
    summary = summary[(summary["platoon.size"] < 5) | (summary["sumo.demand"] < 1)]
    heat_map(summary, "platoon.size", "sumo.demand", "traffic_delay_mean_finished_s", axes)
    texts = [text.get_text() for text in axes.texts]
    assert len(texts) == 6
    assert texts[5] == "×"
    mean = summary[
        (summary["platoon.size"] == 1) & (summary["sumo.demand"] == 0.5)
    ].traffic_delay_mean_finished_s.mean()
    assert texts[0] == f"{mean:.3g}"
    assert axes.figure.axes[1].get_ylabel() == "traffic delay mean finished [s]"


def test_paths_of_vehicles_in_no_platoon_are_told_apart_and_lead_nobody(ring, axes):
    single = ring.trajectories.assign(platoon_id="equip", place=0)
    paths(single, axes, ring.scene)
    assert legend(axes) == ["platoon.0", "platoon.1", "platoon.2"]
    lines = [line for line in axes.lines if line.get_label().startswith("platoon")]
    assert len({line.get_color() for line in lines}) == len({line.get_marker() for line in lines}) == 3


def test_the_main_platoon_has_followers_if_any_has(ring):
    """Members in no platoon, which all have place 0, are more; without a platoon they are what is drawn."""
    platoon = ring.trajectories
    leader = platoon[platoon.place == 0]
    alone = pd.concat([leader.assign(platoon_id="equip", vehicle_id=f"alone.{i}") for i in range(5)])
    assert main_platoon(pd.concat([alone, platoon])) == "platoon"
    assert main_platoon(pd.concat([leader, alone])) == "equip"


def test_a_legend_lists_no_member_without_a_line(ring, axes):
    table = ring.trajectories
    offsets(table.assign(cross_track_m=np.where(table.place == 1, np.nan, 0.1)), axes)
    assert legend(axes) == ["platoon.2"]


def test_paths_lie_on_the_road(ring, axes):
    paths(ring.trajectories, axes, ring.scene, ring.events)
    assert legend(axes) == ["platoon.0 (leader)", "platoon.1", "platoon.2", "contact"]
    alone = road(ring.scene, Figure().subplots())
    assert len(alone.patches) == 2  # the road and a building
    assert len(alone.lines) == 4  # its lanes


@pytest.mark.parametrize(
    ("column", "said"),
    [
        ("platoon.follower.lidar.fov_deg", "follower lidar fov [°]"),
        ("platoon.follower.heading_gain_per_s", "follower heading gain [1/s]"),
        ("gap_mean_m", "gap mean [m]"),
        ("traffic_co2_per_distance_kgpkm", "traffic co2 per distance [kg/km]"),
        ("lock_on_ratio_min", "lock on ratio min"),
        ("collisions", "collisions"),
    ],
)
def test_labels_have_units(column, said):
    assert label(pd.DataFrame(), column) == said


def test_a_label_has_the_unit_that_the_table_says():
    table = pd.DataFrame()
    table.attrs["units"] = {"jerk_mean": "m/s3", "traffic_co2_kg": "kg"}
    assert label(table, "jerk_mean") == "jerk mean [m/s³]"
    assert label(table, "traffic_co2_kg") == "traffic co2 [kg]"


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (lambda r, a: over_time(r.trajectories, "gap", a), r"'gap': not a column; did you mean 'gap_m'\?"),
        (lambda r, a: over_time(r.trajectories, "gap_m", a, "other"), "platoon 'other': not in the table; there are p"),
        (lambda r, a: over_time(r.trajectories[:0], "gap_m", a), "no member was ever on the road"),
        (lambda r, a: over_time(r.trajectories.assign(gap_m=np.nan), "gap_m", a), "'gap_m': has no values"),
        (lambda r, a: time_space(r.traffic, a), "traffic needs a line of the road"),
        (lambda r, a: losses(r.events, a, r.trajectories[r.trajectories.place == 0]), "has no followers"),
        (
            lambda r, a: heat_map(r.metrics, "scope", "metrik", "value", a),
            "did you mean 'metric'",
        ),
        (lambda r, a: estimates(summarise(r.metrics, ["value"], "scope"), "scop", a), "did you mean 'scope'"),
        (
            lambda r, a: over_time(pd.concat([r.trajectories.assign(id=i) for i in "ab"]), "gap_m", a),
            "trajectories of 2 runs; must be of one",
        ),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_line(ring, axes, draw, said):
    with pytest.raises(ResultsError, match=said) as raised:
        draw(ring, axes)
    assert "\n" not in str(raised.value)


def test_every_figure_is_made_without_sumo(ring, tmp_path):
    code = """
import sys
for name in ("libsumo", "traci", "sumolib", "platoontraffic.sumo.world"):
    sys.modules[name] = None  # an import of it fails
from pathlib import Path
import pandas as pd
from matplotlib.figure import Figure
from platoontraffic.analysis import *

run, to = load(sys.argv[1]), Path(sys.argv[2])
runs = pd.DataFrame({"seed": [1, 2, 1, 2], "x": [1, 1, 2, 2], "y": [3, 3, 3, 3], "m": [1.0, 2.0, 4.0, 8.0]})
table, line = run.trajectories, run.trajectories[run.trajectories.place == 0][["x_m", "y_m"]]
made = {
    "over_time": lambda axes: over_time(table, "gap_m", axes),
    "losses": lambda axes: losses(run.events, axes, table),
    "states": lambda axes: states(run.events, axes, table),
    "time_space": lambda axes: time_space(table, time_space(run.traffic, axes, line), line),
    "growth": lambda axes: growth(amplification(table), axes),
    "estimates": lambda axes: estimates(paired(runs, "m", "x", (1, 2), "y"), "y", axes),
    "heat_map": lambda axes: heat_map(runs, "x", "y", "m", axes),
    "road": lambda axes: road(run.scene, axes),
    "paths": lambda axes: paths(table, axes, run.scene, run.events),
}
for name, draw in made.items():
    figure = Figure()
    assert draw(figure.subplots()).figure is figure
    figure.savefig(to / f"{name}.png")
picture(sys.argv[1], to / "picture.png")
"""
    done = subprocess.run([sys.executable, "-c", code, ring.folder, tmp_path], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    made = {file.stem for file in tmp_path.glob("*.png") if file.stat().st_size > 3000}
    numbers = {"binomial_limits", "detectable", "holm", "interval", "poisson_limits", "runs_needed"}
    tables = {"amplification", "headline", "label", "load", "paired", "peak", "summarise"}
    assert made == {name for name in analysis.__all__ if name.islower()} - tables - numbers
