"""Pictures that can be asked for by name."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from platoontraffic.analysis import figures, load
from platoontraffic.analysis.pictures import PICTURES, figure, strips_caption, strips_figure, there
from platoontraffic.cli.main import app
from tests.support.made_runs import made_run


@pytest.fixture(scope="module")
def ring(tmp_path_factory):
    return load(made_run(tmp_path_factory.mktemp("results") / "ring" / "made"))


def street(offset: float = 0.0, n: int = 41) -> pd.DataFrame:
    """Two members on a road to the north at 10 m/s, the follower 20 m behind and `offset` to the left; no bends."""
    time = np.arange(n) * 1.0
    rows = []
    for place in (0, 1):
        one = {"time_s": time, "platoon_id": "p", "vehicle_id": f"p.{place}", "place": place, "x_m": -offset * place,
               "y_m": 10 * time - 20 * place, "heading_rad": np.pi / 2, "gap_m": 15.0 if place else np.nan,
               "cross_track_m": offset if place else np.nan, "lane_id": "a_1" if place else "a_0"}  # fmt: skip
        rows.append(pd.DataFrame(one))
    return pd.concat(rows, ignore_index=True)


def drawn(axes) -> dict[str, np.ndarray]:
    return {line.get_label(): np.column_stack(line.get_data()) for line in axes.lines}


def test_strips_are_called_by_what_they_show(ring):
    assert strips_caption(ring).startswith("Gap, speed and spacing error over time; periods in which a follower had")
    alone = ring.trajectories.assign(platoon_id="equip", place=0, gap_m=np.nan, gap_error_m=np.nan)
    single = replace(ring, trajectories=alone, events=ring.events[:0])
    assert strips_caption(single) == "Speed over time"
    assert strips_figure(single).get_suptitle().startswith("Speed over time\n")


def test_a_picture_of_an_unfinished_run_says_so(ring):
    assert "unfinished" not in figure(ring, "gap").get_suptitle()
    assert figure(replace(ring, finished=False), "gap").get_suptitle().endswith("· unfinished: until 20 s")


def test_an_unrolled_street_shows_offsets_to_the_left_as_positive():
    scene = {"road": [[[-3.0, -30.0], [3.0, -30.0], [3.0, 390.0], [-3.0, 390.0]]]}
    axes = figures.unrolled(street(1.5), Figure().subplots(), scene)
    follower = drawn(axes)["p.1"]
    assert np.nanmax(np.abs(follower[:, 1] - 1.5)[np.isfinite(follower[:, 1])][4:]) < 1e-6


def test_offsets_are_over_the_distance_from_the_leaders_start():
    follower = drawn(figures.offsets(street(0.5), Figure().subplots()))["p.1"]
    assert follower[0] == pytest.approx([-np.hypot(20, 0.5), 0.5])
    assert follower[-1, 0] - follower[0, 0] == pytest.approx(400)


def test_oncoming_traffic_is_not_in_a_time_space_diagram():
    line = [[0.0, 0.0], [0.0, 400.0]]
    base = {"time_s": [0.0, 1.0, 2.0], "x_m": -3.0}
    with_it = pd.DataFrame(base | {"vehicle_id": "same", "y_m": [10.0, 20.0, 30.0], "heading_rad": np.pi / 2})
    against = pd.DataFrame(base | {"vehicle_id": "other", "y_m": [90.0, 80.0, 70.0], "heading_rad": -np.pi / 2})
    axes = figures.time_space(pd.concat([with_it, against]), Figure().subplots(), line)
    other, same = (line.get_ydata() for line in axes.lines)
    assert np.isnan(other).all()
    assert list(same) == [10, 20, 30]


def test_gaps_of_a_follower_that_was_split_off_are_not_in_their_distribution():
    table = street().assign(gap_m=lambda t: np.where(t.place == 0, np.nan, np.where(t.time_s < 20, 15.0, 900.0)))
    events = pd.DataFrame({"time_s": [22.0], "kind": ["split"], "vehicle_id": ["p.1"]})
    whole = figures.gap_distribution(table, Figure().subplots())
    cut = figures.gap_distribution(table, Figure().subplots(), events)
    assert max(line.get_xdata().max() for line in whole.lines) == 900
    assert max(line.get_xdata().max() for line in cut.lines) == 15


def test_lanes_are_their_indices():
    lines = drawn(figures.lanes(street(), Figure().subplots()))
    assert lines["p.0"][:, 1] == pytest.approx(0.25)  # 0, beside the other's
    assert lines["p.1"][:, 1] == pytest.approx(0.75)


def test_neighbours_can_be_told_apart_without_colours(ring):
    axes = figures.over_time(ring.trajectories, "speed_mps", Figure().subplots())
    assert len({line.get_marker() for line in axes.lines}) == 3
    assert len({line.get_markevery()[0] for line in axes.lines}) == 3


def test_every_picture_has_its_title_scenario_and_seed(ring):
    made = there(ring)
    assert {"map", "timespace", "speed", "acceleration", "gap", "error", "distribution"} <= set(made)
    for name, one in made.items():
        assert one.get_suptitle() == f"{PICTURES[name].title}\nring · seed 1 · run made"


def test_marks_are_where_events_are(ring):
    contact = ring.events[ring.events.kind == "collision"].time_s.iloc[0]
    (mark,) = [line for line in figure(ring, "speed").axes[0].lines if line.get_label() == "contact"]
    assert mark.get_xdata() == pytest.approx([contact])


def test_plot_writes_what_it_is_asked_for(tmp_path):
    folder = made_run(tmp_path / "run", seconds=2.0)
    done = CliRunner().invoke(app, ["plot", str(folder), "--what", "speed,timespace", "--format", "svg"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert [line.rpartition("/")[2] for line in done.stdout.split()] == ["plot-speed.svg", "plot-timespace.svg"]
    assert (folder / "plot-speed.svg").read_bytes().startswith(b"<?xml")
    done = CliRunner().invoke(app, ["plot", str(folder), "--what", "gap", "--to", str(tmp_path / "gap.pdf")])
    assert (tmp_path / "gap.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--what", "sped"], r"--what: 'sped': no such picture; there are map, .*, all; did you mean 'speed'\?"),
        (["--what", "nope"], r"--what: 'nope': no such picture; there are map, [^;]*, all\n$"),
        (["--format", "gif"], "--format: 'gif': must be png, svg or pdf"),
        (["--what", "gap,speed", "--to", "a.png"], "--to: is for a single picture"),
        (["--what", "lanes"], "'lane_id': not a column"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(arguments, said, tmp_path):
    folder = made_run(tmp_path / "run", seconds=2.0)
    done = CliRunner().invoke(app, ["plot", str(folder), *arguments])
    assert done.exit_code == 2
    assert re.search(said, done.stderr)
    assert not list(folder.glob("plot*"))
