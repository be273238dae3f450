"""Whole runs: their results, and that these are reproduced."""

from __future__ import annotations

import filecmp
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from platoontraffic import scenario, simulation
from platoontraffic.analysis.reading import read_table
from platoontraffic.errors import InputError
from platoontraffic.recording import run as run_into
from platoontraffic.results.provenance import run_id
from tests.support.runs import ONE_CORNER, run

TABLES = ["trajectories.csv", "events.csv", "metrics.csv", "statistics.csv", "summary.csv"]

pytestmark = pytest.mark.sumo


def metric(folder: Path, name: str, vehicle: str | None = None) -> float | pd.Series:
    """A metric of one vehicle, or of every vehicle that has it."""
    table = pd.read_csv(folder / "metrics.csv")
    values = table[(table.scope == "vehicle") & (table.metric == name)].set_index("vehicle_id").value
    return values if vehicle is None else values[vehicle]


def equal_tables(one: Path, other: Path, tables: list[str] = TABLES) -> bool:
    match, _, _ = filecmp.cmpfiles(one, other, tables, shallow=False)
    return match == tables


def test_three_robots_go_round_the_first_corner_and_keep_their_lock(one_corner):
    assert (metric(one_corner, "corners") == 1).all()
    assert (metric(one_corner, "collisions") == 0).all()
    assert (metric(one_corner, "lock_on_ratio") == 1).all()
    assert metric(one_corner, "right_lane_share", "robot.0") == 1
    assert metric(one_corner, "gap_min").min() > 0.3
    assert metric(one_corner, "gap_max").max() < 1.0


@pytest.mark.slow
def test_twice_in_one_process_is_the_same_bytes(one_corner, tmp_path):
    assert equal_tables(one_corner, run(tmp_path / "again", "paper_loop", *ONE_CORNER))


@pytest.mark.slow
def test_another_process_writes_the_same_bytes(one_corner, tmp_path):
    command = [sys.executable, "-m", "platoontraffic", "run", "paper_loop", *ONE_CORNER, "-q", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert equal_tables(one_corner, Path(done.stdout.strip()))


@pytest.mark.slow
def test_the_order_of_the_members_changes_nothing(one_corner, tmp_path):
    assert equal_tables(one_corner, run(tmp_path / "reversed", "paper_loop", *ONE_CORNER, members=lambda m: m[::-1]))


@pytest.mark.slow
def test_the_configuration_that_a_run_leaves_repeats_it(one_corner, tmp_path):
    again = scenario.load(one_corner / "config.toml")
    assert run_id(again) == run_id(scenario.load("paper_loop", ONE_CORNER))
    # Its summary has no columns of arguments, since it was given none.
    assert equal_tables(one_corner, run(tmp_path / "again", one_corner / "config.toml"), TABLES[:3])


def test_errors_of_lidars_follow_the_seed_and_the_vehicle_alone(tmp_path):
    noisy = (
        "run.duration_s=5",
        "platoon.follower.lidar.noise.sigma_m=0.01",
        "platoon.follower.lidar.noise.dropout=0.05",
    )
    one = run(tmp_path / "one", "paper_loop", *noisy)
    assert equal_tables(one, run(tmp_path / "reversed", "paper_loop", *noisy, members=lambda m: m[::-1]))
    assert not equal_tables(one, run(tmp_path / "other", "paper_loop", *noisy, seed=2), TABLES[:1])
    # Errors of the first three robots, and so their paths, do not depend on the robots behind them.
    fewer = run(tmp_path / "fewer", "paper_loop", *noisy, "platoon.size=3")
    closeness = ["clearance_m", "closest_id", "contact_in_s"]  # to those behind, too
    paths = [pd.read_csv(folder / "trajectories.csv").query("place < 3") for folder in (one, fewer)]
    paths = [table.drop(columns=closeness).reset_index(drop=True) for table in paths]
    assert paths[0].equals(paths[1])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "engine"),
    [*((name, "pymunk") for name in ("paper_loop", "paper_path", "paper_world")), ("paper_loop", "numpy"),
     ("paper_loop", "shapely")],
)  # fmt: skip
def test_every_lidar_engine_gives_the_same_trajectories(tmp_path, name, engine):
    one = run(tmp_path / "raster", name, "run.duration_s=6")
    other = run(tmp_path / engine, name, "run.duration_s=6", f"scene.lidar_engine={engine}")
    numbers = [pd.read_csv(f / "trajectories.csv").select_dtypes("number") for f in (one, other)]
    # Ranges are rounded to 32 bits before the laws see them; an ulp at 3 m is 2e-7 m.
    assert np.allclose(*numbers, atol=1e-5, equal_nan=True)


@pytest.mark.slow
def test_the_printed_follower_loses_the_platoon_at_the_first_corner(tmp_path):
    folder = run(tmp_path / "printed", "paper_printed", "run.duration_s=60", "platoon.size=2")
    lost = metric(folder, "lost_for_good", "robot.1")
    assert 14 < lost < 20  # while the leader stops to turn at the first corner
    assert metric(folder, "corners", "robot.1") == 0
    events = pd.read_csv(folder / "events.csv")
    assert events[events.time_s == lost].detail.iloc[0] == "not recognised, though 720 beams hit it"


@pytest.mark.slow
def test_a_leader_drives_a_path_of_several_radii(tmp_path):
    folder = run(tmp_path / "path", "paper_path", "run.duration_s=60", "platoon.size=2")
    rows = pd.read_csv(folder / "trajectories.csv")
    leader = rows[rows.place == 0]
    assert leader.speed_mps[leader.time_s > 5].to_numpy() == pytest.approx(0.1, rel=1e-3)
    assert leader.right_of_middle_m.between(0.45, 0.55).all()
    assert (metric(folder, "lock_on_ratio") == 1).all()


def test_a_run_records_its_provenance(one_corner):
    facts = json.loads((one_corner / "provenance.json").read_text())
    assert facts["status"] == "finished"
    assert set(facts["input_sha256"]) == {"net.lab_loop.net.xml", "additional.0.lab_loop.poly.xml"}
    assert facts["given_to_laws"]["platoon.0.follower"] == ["scan", "own motion"]
    stages = {"read", "signals", "scan", "decide", "observe", "measure", "record", "move", "place", "step"}
    assert set(facts["stage_s"]) == stages


def test_every_column_has_its_unit_and_meaning(one_corner):
    package = json.loads((one_corner / "datapackage.json").read_text())
    for table in package["resources"][:3]:
        header = (one_corner / table["path"]).read_text().splitlines()[0].split(",")
        assert header == [field["name"] for field in table["schema"]["fields"]]
        assert all(field["description"] for field in table["schema"]["fields"])
    kinds = set(pd.read_csv(one_corner / "events.csv").kind)
    assert kinds <= set(package["resources"][1]["kinds"])


def test_the_summary_is_one_row_with_what_was_varied(one_corner):
    (row,) = pd.read_csv(one_corner / "summary.csv").to_dict("records")
    assert row["platoon.size"] == 3
    assert row["lock_on_ratio_min"] == 1
    assert 0.4 < row["gap_mean_m"] < 0.6


NAN_LAW = """
from dataclasses import dataclass
from platoontraffic import Decision, Twist, per_vehicle

@dataclass(frozen=True)
class Law:
    wait_s: float = 0.5

    @per_vehicle
    def __call__(self, sensed, memory, dt):
        {body}
"""


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("return Decision(Twist(float('nan'), 0.0))", "law.py:5: law Law gave speed nan, yaw rate 0.0, target nan"),
        ("return 1 / 0", "law.py:11: law Law failed at 0.000 s: ZeroDivisionError"),
        ("return None", "law.py:5: law Law failed at 0.000 s: TypeError: gives None to one vehicle"),
        ("raise SystemExit(5)", "law.py:11: law Law failed at 0.000 s: SystemExit: 5"),
        ("raise ValueError('a\\nb')", "ValueError: a b"),
        ("return Decision(Twist(0.0, 0.0), target=(1.0, float('inf')))", "target 1.0, inf for robot.1 at 0.000 s"),
        (
            "return sensed.scan.hits[0]",
            "law Law failed at 0.000 s: TypeError",
        ),  # laws do not see what a beam met
        ("sensed.scan.ranges[:] = 1.0", "law Law failed at 0.000 s: ValueError"),
    ],
)
def test_a_plug_in_that_fails_leaves_no_results(scenario_file, tmp_path, body, said):
    (tmp_path / "law.py").write_text(NAN_LAW.format(body=body))
    file = scenario_file(('law = "repaired"', 'law = "law:Law"\nwait_s = 1.0'))
    with pytest.raises(InputError, match="law") as caught:
        run(tmp_path / "results" / "run", file)
    assert said in str(caught.value)
    assert not (tmp_path / "results").exists()


def test_a_lidar_slower_than_the_step_holds_the_command_between_scans(tmp_path):
    slow = 'platoon.follower.lidar={ preset = "paper-follower", rate_hz = 10.0 }'
    folder = run(tmp_path / "slow", "paper_loop", "run.duration_s=3", "platoon.size=2", "record.every_s=0.025", slow)
    rows = pd.read_csv(folder / "trajectories.csv")
    speed = rows[(rows.place == 1) & (rows.time_s > 0)].speed_mps.to_numpy()
    assert (speed[:120].reshape(-1, 4) == speed[:120:4, None]).all()
    assert len(set(speed)) > 10


ROWS_LAW = """
from dataclasses import dataclass
import numpy as np
from platoontraffic import Decision, Target, Twist

@dataclass(frozen=True)
class Law:
    def __call__(self, sensed, memory, dt):
        n = len(sensed.speed)
        return {decision}
"""


@pytest.mark.parametrize(
    "decision",
    [
        "Decision(Twist(np.zeros(5), np.zeros(n)))",
        "Decision(Twist(np.zeros((n, 1)), 0.0))",
        "Decision((0.0, 0.0, 0.0))",
        "Decision(Twist('fast', 0.0))",
        "Decision(Twist(1j, 0.0))",
        "Decision(Twist(0.0, 0.0), target=None)",
        "Decision(Twist(0.0, 0.0), target=Target(np.zeros(7), 0.0))",
        "3",
    ],
)
def test_a_law_that_returns_no_decision_is_reported_in_one_line(scenario_file, tmp_path, decision):
    (tmp_path / "law.py").write_text(ROWS_LAW.format(decision=decision))
    file = scenario_file(('law = "repaired"', 'law = "law:Law"'))
    with pytest.raises(InputError, match=r"law.py:6: law Law gave .*; must be a Decision of a Twist, or a Drive"):
        run(tmp_path / "results" / "run", file, "run.duration_s=0.1")


@pytest.mark.slow
def test_gaps_do_not_depend_on_how_often_they_are_recorded(tmp_path):
    short = ("run.duration_s=50", "platoon.size=2")
    rows = [pd.read_csv(run(tmp_path / e, "paper_loop", *short, f"record.every_s={e}") / "trajectories.csv")
            for e in ("0.1", "25")]  # fmt: skip
    often, seldom = (r[(r.place == 1) & (r.time_s == 50)].iloc[0] for r in rows)
    assert (often.gap_m, often.cross_track_m) == pytest.approx((seldom.gap_m, seldom.cross_track_m))


def test_the_run_id_changes_with_a_module_that_a_law_imports(scenario_file, tmp_path):
    file = scenario_file(('law = "repaired"', 'law = "law:Law"'))
    (tmp_path / "law.py").write_text("import gains\n" + NAN_LAW.format(body="return gains.SPEED"))
    ids = []
    for speed in (0.1, 0.2):
        (tmp_path / "gains.py").write_text(f"SPEED = {speed}\n")
        ids.append(run_id(scenario.load(file)))
    assert ids[0] != ids[1]


@pytest.mark.slow
def test_the_papers_platoon_drives_two_laps(tmp_path):
    folder = run(tmp_path / "loop", "paper_loop")
    turned = pd.read_csv(folder / "trajectories.csv").groupby("vehicle_id").turned_rad.last()
    assert (turned > 4 * np.pi - 0.01).all()  # the last row is up to one recording interval before the end
    assert (metric(folder, "corners") >= 8).all()
    assert (metric(folder, "collisions") == 0).all()
    assert metric(folder, "right_lane_share", "robot.0") == 1
    assert (metric(folder, "lock_on_ratio") >= 0.99).all()
    assert metric(folder, "gap_max").max() < 1.0


@pytest.mark.parametrize("minutes", [pytest.param(3, marks=pytest.mark.slow), pytest.param(10, marks=pytest.mark.soak)])
def test_ten_robots_move_about_the_papers_world_for_minutes(tmp_path, minutes):
    folder = run(tmp_path / "world", "paper_world", f"run.duration_s={60 * minutes}")
    assert len(metric(folder, "collisions")) == 10
    assert (metric(folder, "collisions") == 0).all()
    assert (metric(folder, "distance") > 3 * minutes).all()
    assert pd.read_csv(folder / "events.csv").time_s.max() == 60 * minutes


@pytest.mark.soak
def test_five_robots_follow_a_path_of_several_radii_for_a_lap(tmp_path):
    folder = run(tmp_path / "path", "paper_path")
    assert (metric(folder, "laps") >= 1 - 1e-3).all()
    assert (metric(folder, "lock_on_ratio") == 1).all()
    assert (metric(folder, "collisions") == 0).all()


def test_a_scenario_that_runs_twice_leaves_one_folder(tmp_path):
    prepared = simulation.prepare(scenario.load("paper_loop", ["run.duration_s=0.1", "run.laps=1"]))
    folder = run_into(prepared, tmp_path / "one")
    assert run_into(prepared, tmp_path / "one") == folder
    assert [f.name for f in tmp_path.iterdir()] == ["one"]


DEAD_END = """
[sumo]
net = "lab_world"
[run]
duration_s = 105.0
[[platoon]]
id = "robot"
size = 3
start = { edge = "s_end", position_m = 1.9 }
gap_m = 0.45
follower = { law = "repaired", lidar = "paper-follower" }
"""


def test_a_platoon_arrives_where_it_stands_before_the_wall_at_the_end_of_its_road(tmp_path):
    file = tmp_path / "dead_end.toml"
    file.write_text(DEAD_END + 'leader = { law = "path", speed_mps = 0.3 }\nroute = ["s_end"]\n', encoding="utf-8")
    events = pd.read_csv(run(tmp_path / "run", file) / "events.csv")
    arrived = events[events.kind == "arrived"]
    assert arrived.detail.fillna("").tolist() == ["", "with its leader", "with its leader"]
    assert 0.2 < arrived.y_m.iloc[0] < 0.5
    assert events.detail.iloc[-1] == "arrived"


@pytest.mark.slow
def test_a_platoon_comes_out_of_a_dead_end_again(tmp_path):
    """The paper's leader turns left on the spot before the wall, and passes its followers on the other lane."""
    file = tmp_path / "dead_end.toml"
    file.write_text(DEAD_END + 'leader = { law = "reactive", lidar = "paper-leader" }\n', encoding="utf-8")
    folder = run(tmp_path / "run", file)
    events, rows = (pd.read_csv(folder / f"{name}.csv") for name in ("events", "trajectories"))
    assert set(events.kind) == {"departed", "locked", "end"}
    last = rows[rows.time_s == 105.0].set_index("vehicle_id")
    assert (last.heading_rad - np.pi / 2).abs().max() < 0.05
    assert (last.turned_rad > 0.98 * np.pi).all()
    assert last.right_of_middle_m.min() > 0


def test_a_run_may_end_at_the_first_contact(tmp_path):
    folder = run(tmp_path / "contact", "lab_obstacles", "platoon.leader.speed_mps=0.6", "run.ends_at_contact=true")
    events = read_table(folder / "events.csv")
    end = events.iloc[-1]
    assert (end.kind, end.what) == ("end", "contact")
    assert events.time_s[events.kind == "collision"].tolist() == [end.time_s]
