"""Study files: which runs they come to, and what is said of bad ones. No SUMO."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

import platoontraffic
from platoontraffic import scenario, shipped
from platoontraffic.cli.main import app
from platoontraffic.errors import InputError
from platoontraffic.results.provenance import run_id
from platoontraffic.study import study

GAIN, FOV, SIZE = "platoon.follower.heading_gain_per_s", "platoon.follower.lidar.fov_deg", "platoon.size"
Written = Callable[[str], Path]


@pytest.fixture
def written(tmp_path) -> Written:
    def write(text: str, name: str = "mine.toml") -> Path:
        (tmp_path / name).write_text(f'base = "paper_loop"\n{text}' if "base" not in text else text, encoding="utf-8")
        return tmp_path / name

    return write


def points(loaded: study.Study) -> list[tuple]:
    return [(run.seed, *run.values.values()) for run in loaded.runs]


@pytest.mark.parametrize("table", ["[set]\nsumo.config = {}", "[grid]\nsumo.config = [{}]"])
def test_the_road_may_be_a_file_beside_the_study(written, tmp_path, table):
    """The base may be a shipped scenario, beside which no file of a user lies."""
    net = shipped.networks()["highway"]
    (tmp_path / "town.sumocfg").write_text(f"<configuration><input><net-file value='{net}'/></input></configuration>")
    loaded = study.load(written(f'base = "penetration"\n{table.format(repr("town.sumocfg"))}\n'))
    again = tmp_path / "results"
    again.mkdir()
    (again / "study.toml").write_text(loaded.text(again))
    assert [run.id for run in study.load(again / "study.toml").runs] == [run.id for run in loaded.runs]


def test_a_grid_is_all_combinations_and_the_last_key_changes_fastest(written):
    loaded = study.load(written(f"[grid]\n{GAIN} = [1.0, 2.0]\n{FOV} = [20.0, 30.0, 40.0]\n"))
    assert loaded.keys == (GAIN, FOV)
    assert points(loaded) == [(1, gain, fov) for gain in (1.0, 2.0) for fov in (20.0, 30.0, 40.0)]


def test_what_is_zipped_moves_together(written):
    loaded = study.load(written(f'[zip]\n{GAIN} = [1.0, 2.0]\n"{FOV}" = [20.0, 30.0]\n[grid]\n{SIZE} = [2, 3]\n'))
    assert points(loaded) == [(1, 2, 1.0, 20.0), (1, 2, 2.0, 30.0), (1, 3, 1.0, 20.0), (1, 3, 2.0, 30.0)]


def test_several_zips_are_combined(written):
    loaded = study.load(written(f"[[zip]]\n{GAIN} = [1.0, 2.0]\n{FOV} = [20.0, 30.0]\n[[zip]]\n{SIZE} = [2, 3]\n"))
    assert points(loaded) == [(1, 1.0, 20.0, 2), (1, 1.0, 20.0, 3), (1, 2.0, 30.0, 2), (1, 2.0, 30.0, 3)]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ("{ from = 0.1, to = 0.5, step = 0.1 }", [0.1, 0.2, 0.3, 0.4, 0.5]),
        ("{ from = 1, to = 4, step = 1 }", [1, 2, 3, 4]),
        ("{ from = 1.0, to = 2.0, count = 3 }", [1.0, 1.5, 2.0]),
        ("{ from = 1.0, to = 1.9, step = 0.5 }", [1.0, 1.5]),
    ],
)
def test_a_range_ends_where_it_says(written, values, expected):
    assert [value for _, value in points(study.load(written(f"[grid]\n{GAIN} = {values}\n")))] == expected


def test_every_point_has_the_same_seeds(written):
    three = written(f"replications = 3\n[grid]\n{SIZE} = [2, 3]\n")
    assert points(study.load(three)) == [(seed, size) for size in (2, 3) for seed in (1, 2, 3)]
    some = written(f"seeds = [7, 5]\n[grid]\n{SIZE} = [2]\n")
    assert points(study.load(some)) == [(7, 2), (5, 2)]
    assert [run.seed for run in study.load(written("seeds = { from = 1, to = 3, step = 1 }\n")).runs] == [1, 2, 3]
    assert [run.seed for run in study.load(written("seeds = { from = 4, to = 6 }\n")).runs] == [4, 5, 6]


def test_points_are_left_out_by_what_their_keys_are(written):
    condition = f"{SIZE} * {GAIN} > 4 and not {SIZE} in [5]"
    loaded = study.load(written(f'leave_out = ["{condition}"]\n[grid]\n{SIZE} = [2, 3, 5]\n{GAIN} = [1.0, 2.0]\n'))
    assert points(loaded) == [(1, 2, 1.0), (1, 2, 2.0), (1, 3, 1.0), (1, 5, 1.0), (1, 5, 2.0)]
    by_number = written(f'leave_out = ["platoon.0.size == 3"]\n[grid]\n{SIZE.replace(".", ".0.")} = [2, 3]\n')
    assert points(study.load(by_number)) == [(1, 2)]


def test_a_run_of_a_study_is_the_run_of_its_scenario(written):
    loaded = study.load(written(f"seeds = [4]\n[set]\nrun.duration_s = 5.0\n[grid]\n{SIZE} = [2]\n"))
    alone = scenario.load("paper_loop", ["run.duration_s=5.0", "platoon.size=2"], seed=4)
    assert [run.id for run in loaded.runs] == [run_id(alone)]


def test_any_key_may_be_varied_a_law_too(written):
    text = '[grid]\nplatoon.follower.law = ["printed", "repaired"]\nsumo.traffic = [true, false]\n'
    assert len(study.load(written(text)).runs) == 4
    tables = '[grid]\nplatoon.follower.lidar = [{ preset = "paper-follower", fov_deg = 40.0 }, "paper-leader"]\n'
    assert len({run.id for run in study.load(written(tables)).runs}) == 2


def test_an_argument_is_set_in_every_run(written):
    file = written(f"[grid]\n{SIZE} = [2, 3]\n")
    one, other = study.load(file), study.load(file, ["run.duration_s=7"])
    assert not {run.id for run in one.runs} & {run.id for run in other.runs}


def test_an_edited_study_keeps_the_ids_of_points_that_stay(written):
    before = {run.id for run in study.load(written(f"[grid]\n{SIZE} = [2, 3]\n")).runs}
    after = {run.id for run in study.load(written(f"replications = 2\n[grid]\n{SIZE} = [3, 4]\n")).runs}
    assert len(before & after) == 1


def test_the_study_as_it_is_left_is_the_same_study(written, tmp_path):
    file = written(f"replications = 2\nleave_out = ['{SIZE} == 3']\n[set]\nrun.laps = 1.0\n[grid]\n{SIZE} = [2, 3, 4]\n"
                   f"[zip]\n{GAIN} = [1.0, 2.0]\n{FOV} = [20.0, 30.0]\n")  # fmt: skip
    base = tmp_path / "base.toml"
    base.write_text(shipped.scenarios()["paper_loop"].read_text())
    file.write_text(file.read_text().replace("paper_loop", "base.toml"))
    loaded = study.load(file)
    (tmp_path / "results" / "mine").mkdir(parents=True)
    left = tmp_path / "results" / "mine" / "study.toml"
    left.write_text(loaded.text(left.parent))
    assert [run.id for run in study.load(left).runs] == [run.id for run in loaded.runs]


@pytest.mark.parametrize("n", [1, 2, 3, 7, 40, 100])
def test_shards_share_all_runs_without_overlap(written, n):
    loaded = study.load(written(f"replications = 20\n[grid]\n{SIZE} = [2, 3]\n"))
    order = loaded.shuffled()
    parts = [[order[i].id for i in loaded.block(shard, n)] for shard in range(1, n + 1)]
    assert sorted(run for part in parts for run in part) == sorted(run.id for run in loaded.runs)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


BAD = [
    ('base = "paper_lop"', "mine.toml:1: base: 'paper_lop': no such scenario file, nor a shipped scenario"),
    ("[grid]\nplatoon.follower.heading_gan = [1.0]", "mine.toml:3: platoon.0.follower.heading_gan: unknown key; did"),
    ("[grid]\nplatoon.siz = [1]", "mine.toml:3: platoon.0.siz: unknown key; did you mean 'size'?"),
    ("[grid]\nplatoon.3.size = [1]", "mine.toml:3: 'platoon.3.size': there are 1, numbered from 0"),
    ("[grid]\nplatoon.size = []", "mine.toml:3: grid.platoon.size: is empty; must have one value or more"),
    ("[grid]\nplatoon.size = 3", "mine.toml:3: grid.platoon.size: 3: must be a list of values, or a range"),
    ("[grid]\nplatoon.size = [2, 0]", "mine.toml:3: platoon.0.size: 0: should be greater than or equal to 1"),
    ("[grid]\nplatoon.size = [2, 2]", "mine.toml:3: grid.platoon.size: has 2 twice"),
    ("[grid]\nplatoon.size = { from = 1, to = 9 }", "mine.toml:3: grid.platoon.size: {'from': 1, 'to': 9}: must be"),
    ("[grid]\nplatoon.size = { from = 9, to = 1, step = 1 }", "must go up from `from` to `to`"),
    ("[grid]\nplatoon.size = { from = 0, to = 1, step = 1e-12 }", "1000000 at most"),
    ("[grid]\nseed = [1, 2]", "mine.toml:3: seed: is not a parameter; must be given by the key `seeds`"),
    ("[set]\nseed = 1", "must be given by the key `seeds` of the study"),
    ("seeds = [1, 1]", "mine.toml:2: seeds: has 1 twice"),
    ("seeds = [-1]", "mine.toml:2: seeds: -1: must be whole numbers from 0"),
    ("seeds = [1]\nreplications = 2", "mine.toml:3: replications: must not be given beside seeds"),
    ("replications = 0", "mine.toml:2: replications: 0: should be greater than or equal to 1"),
    ("[zip]\nplatoon.size = [2, 3]\nrun.laps = [1.0]", "mine.toml:2: zip: must have equally many values of every key"),
    ("[grid]\nplatoon.size = [2]\n[zip]\nplatoon.size = [2]", "mine.toml:5: platoon.size: is varied twice"),
    ("grd = 1", "mine.toml:2: grd: unknown key; did you mean 'grid'?"),
    ('name = "a b"', "mine.toml:2: name: 'a b': must be of letters A to Z, digits, _ and - only"),
    ("grid = [1]", "mine.toml:2: grid: [1]: should be a table"),
    ("[[grid]]\nplatoon.size = [2]", "mine.toml:2: grid: [{'platoon': {'size': [2]}}]: should be a table"),
    ("seeds = { from = 5, to = 1 }", "must go up from `from` to `to`"),
    ("grid = {", "mine.toml:2: not valid TOML"),
    ('leave_out = ["platoon.size > 1"]\n[grid]\nplatoon.size = [2]', "mine.toml:2: leave_out: leaves out all runs"),
    ('leave_out = ["platoon.sizes > 1"]\n[grid]\nplatoon.size = [2]', "not a varied key of the study; did you"),
    ('leave_out = ["platoon.size >"]\n[grid]\nplatoon.size = [2]', "must be a comparison, such as"),
    ('leave_out = ["platoon.size"]\n[grid]\nplatoon.size = [2]', "must be a comparison, such as"),
    ('leave_out = ["platoon.size and not 3"]\n[grid]\nplatoon.size = [2]', "must be a comparison, such as"),
    ("[set]\nplatoon.size = 4\n[grid]\nplatoon.size = [2]", "mine.toml:3: 'platoon.size': is varied by the study, "),
    ('leave_out = ["platoon.size > \'a\'"]\n[grid]\nplatoon.size = [2]', "not supported between"),
    ('leave_out = ["platoon.size.real > 1"]\n[grid]\nplatoon.size = [2]', "not a varied key of the study"),
    ('leave_out = ["(platoon.size).real > 1"]\n[grid]\nplatoon.size = [2]', "real: not a varied key"),
    ('leave_out = ["[x for x in (1,)]"]\n[grid]\nplatoon.size = [2]', "x: not a varied key"),
    ('[grid]\nplatoon.size = [2]\nplatoon.start.edge = ["nowhere"]', "'nowhere'"),
    ("[grid]\nplatoon.gap_m = [0.5, 100.0]", "; at platoon.gap_m = 100.0"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "said"), BAD)
def test_bad_studies_are_one_line_a_fault_and_start_nothing(written, tmp_path, text, said):
    done = CliRunner().invoke(app, ["batch", str(written(text)), "--out", str(tmp_path / "results")])
    assert done.exit_code == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "results").exists()


def test_a_misspelt_key_of_the_grid_is_named_beside_the_condition_that_has_it_right(written):
    with pytest.raises(InputError) as raised:
        study.load(written('leave_out = ["platoon.size > 1"]\n[grid]\nplatoon.sise = [2]'))
    of_grid, of_condition = raised.value.faults
    assert of_grid.endswith("platoon.0.sise: unknown key; did you mean 'size'?")
    assert of_condition.endswith("platoon.size: not a varied key of the study; did you mean 'platoon.sise'?")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere.toml"], "nowhere.toml: no such study file, nor a shipped study"),
        (["paper_folower"], "did you mean 'paper_follower'?"),
        (["paper_loop"], "paper_loop: is a scenario, not a study; `platoontraffic run` runs it"),
        (["paper_follower", "platoon.siz=2"], "argument 1: platoon.0.siz: unknown key; did you mean 'size'?"),
        (["paper_follower", f"{GAIN}=2"], f"argument 1: '{GAIN}=2': is varied by the study, "),
        (["paper_follower", "--executor", "dusk"], "--executor: 'dusk': no such executor; did you mean 'dask'?"),
        (["paper_follower", "--executor", "processes:1"], "no such executor"),
        (["paper_follower", "--shard", "0/2"], "--shard: '0/2': must be I/N, from 1/N to N/N"),
        (["paper_follower", "--shard", "3/2"], "--shard: '3/2': must be I/N"),
        (["paper_follower", "-j", "0"], "-j"),
    ],
)
def test_bad_arguments_are_said(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["batch", *arguments])
    assert done.exit_code == 2
    assert said in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_faults_of_all_points_are_said_once(written):
    with pytest.raises(InputError) as caught:
        study.load(written(f"[grid]\n{SIZE} = [0, -1]\nplatoon.siz = [1, 2]\n"))
    assert len(caught.value.faults) == 3


def test_shipped_studies_are_listed_and_fine(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lines = CliRunner().invoke(app, ["list", "studies"]).stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped.studies())
    for name in shipped.studies():
        done = CliRunner().invoke(app, ["batch", name, "--dry-run"])
        assert (done.exit_code, done.stderr) == (0, "")
        assert " to do, about " in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_a_scenario_written_by_the_schema_is_what_is_read():
    from platoontraffic.scenario import Spec

    schema = Spec.model_json_schema()
    assert {"type": "string"} in schema["$defs"]["Driver"]["anyOf"]
    assert set(schema["properties"]) == set(Spec.model_fields)


def test_the_values_of_a_point_are_its_own(written):
    """A table that is a value is not changed by what is set inside it at another point."""
    lidar = {"preset": "paper-follower"}
    text = tomli_w.dumps({"base": "paper_loop", "grid": {"platoon.follower.lidar": [lidar], FOV: [20.0, 30.0]}})
    loaded = study.load(written(text))
    assert all(run.values["platoon.follower.lidar"] == lidar for run in loaded.runs)
    assert len({run.id for run in loaded.runs}) == 2


@pytest.mark.parametrize(
    ("scenario", "change", "random"),
    [
        ("paper_loop", "run.laps=1", False),
        ("paper_loop", "platoon.follower.lidar.noise=utm30lx", True),
        ("paper_loop", "platoon.follower.odometry=car", True),
        ("lab_obstacles", "run.duration_s=60", False),
        ("corridor_platoon", "platoon.size=2", True),
        ("highway_tracking", "platoon.size=2", True),
    ],
)
def test_runs_that_differ_in_a_seed_that_nothing_depends_on_are_said_to_be_equal(tmp_path, scenario, change, random):
    file = tmp_path / "seeds.toml"
    file.write_text(f'base = "{scenario}"\nreplications = 3\ngrid.record.every_s = [0.5, 1.0]')
    done = CliRunner().invoke(app, ["batch", str(file), change, "--dry-run"])
    assert done.exit_code == 0, done.stderr
    assert ("4 of these runs are equal to others, because nothing in them is random" in done.stdout) == (not random)


@pytest.mark.sumo
@pytest.mark.parametrize("noise", ["none", "utm30lx"])
def test_tables_depend_on_the_seed_exactly_where_a_scenario_is_random(tmp_path, noise):
    change = f"platoon.follower.lidar.noise={noise}"
    tables = [
        platoontraffic.run("paper_loop", "run.duration_s=0.5", change, seed=seed, results=tmp_path).trajectories
        for seed in (1, 2)
    ]
    assert tables[0].equals(tables[1]) == (not scenario.load("paper_loop", [change]).random)
