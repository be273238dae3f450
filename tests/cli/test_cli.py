"""The command line as a user meets it: words, exit codes, what lies in the folder afterwards."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from platoontraffic import shipped
from platoontraffic.cli.main import app

COMMAND = [sys.executable, "-m", "platoontraffic"]
SHORT = ("run.duration_s=1", "platoon.size=2")


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.mark.sumo
def test_run_says_where_the_results_are_and_does_not_repeat_them(tmp_path):
    first = call("run", "paper_loop", *SHORT, "--out", tmp_path)
    folder = Path(first.stdout.splitlines()[-1])
    assert first.exit_code == 0
    assert folder.parent == tmp_path / "paper_loop"
    assert sorted(f.name for f in folder.iterdir()) == [
        "DONE", "config.toml", "datapackage.json", "events.csv", "metrics.csv", "provenance.json", "run.log",
        "scene.geojson", "statistics.csv", "summary.csv", "trajectories.csv", "vehicles.csv",
    ]  # fmt: skip
    written = (folder / "DONE").stat().st_mtime_ns
    second = call("run", "paper_loop", *SHORT, "--out", tmp_path)
    assert "is not repeated" in second.stderr
    assert (folder / "DONE").stat().st_mtime_ns == written
    assert call("run", "paper_loop", *SHORT, "--out", tmp_path, "--force").exit_code == 0
    assert (folder / "DONE").stat().st_mtime_ns > written


@pytest.mark.sumo
def test_another_seed_is_another_run(tmp_path):
    folders = {call("run", "paper_loop", *SHORT, "-q", "--seed", s, "--out", tmp_path).stdout.strip() for s in (1, 2)}
    assert {f.rpartition("-")[2] for f in folders} == {"s1", "s2"}


def test_a_dry_run_starts_nothing(tmp_path):
    done = call("run", "paper_loop", "--dry-run", "--out", tmp_path)
    assert (done.exit_code, list(tmp_path.iterdir())) == (0, [])
    assert "fine, 5 members" in done.stdout
    (tmp_path / "taken").write_text("")
    then = "--branch-at", 2, "--then", "platoon.follower.group_step_m=0.05"
    for command in (("run", "paper_loop"), ("run", "paper_loop", *then), ("batch", "capacity")):
        refused = call(*command, "--dry-run", "--out", tmp_path / "taken")
        assert (refused.exit_code, refused.stdout, refused.stderr.count("\n")) == (2, "", 1)
        assert "taken" in refused.stderr
        assert "results cannot be written: Not a directory" in refused.stderr
    assert "fine, members of the traffic's share; would" in call("run", "penetration", "--dry-run").stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["run", "paper_loop", "platoon.size=3", "seed=2", "platoon.size=2"],
            "argument 3: 'platoon.size=2': the same key as argument 1, 'platoon.size=3'; must be given once",
        ),
        (["run", "paper_loop", "seed=2", "--seed", "3"], "argument 1: 'seed=2': the seed is given as 3 as well"),
        (["batch", "paper_follower", "run.laps=1", "run.laps=2"], "'run.laps=2': the same key as argument 1"),
        (["string", "acc", "platoon.follower.law=cacc"], "the same key as argument 1, 'platoon.follower.law=acc'"),
        (["run", "paper_lop"], "paper_lop: no such scenario file or shipped scenario; did you mean 'paper_loop'?"),
        (["run", "paper_loop", "platoon.siz=3"], "argument 1: platoon.0.siz: unknown key; did you mean 'size'?"),
        (["run", "paper_loop", "--seed", "-1"], "argument: seed: -1: should be greater than or equal to 0"),
        (["run", "paper_loop", "platoon.start.edge=nowhere"], f"argument 1 or {shipped.scenarios()['paper_loop']}:"),
        (["check", "paper_loop", "nowhere.toml"], "nowhere.toml: no such scenario file"),
        (["list", "scenery"], "argument 1: 'scenery': no such list"),
        (["bench", "ladar"], "argument 1: 'ladar': no such benchmark; must be lidar, traffic or env"),
        (["bench", "lidar", "--compare", "x.json"], "--compare: is only for bench traffic"),
        (["bench", "traffic", "--compare", "nowhere.json"], "--compare: nowhere.json: No such file"),
        (["bench", "traffic", "--config", "x.sumocfg"], "--config: goes with bench traffic, and with the platoons of"),
        (["bench", "lidar", "--config", "x.sumocfg", "--platoon", "x.toml"], "--config: goes with bench traffic"),
        (["bench", "traffic", "--compare", __file__], "is not what `bench traffic --json` of this version prints"),
        (["new", "1st"], "argument 1: '1st': must begin with a letter"),
        (["plot", "nowhere"], "nowhere: no such folder"),
        (["run", "paper_loop", "--sed", "1"], "No such option"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, said, tmp_path):
    done = call(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("what", "names"),
    [
        (
            "scenarios",
            [
                "bends_platoon",
                "blackout",
                "capacity",
                "corridor_breakdown",
                "corridor_cut_in",
                "corridor_manoeuvres",
                "corridor_pedestrian",
                "corridor_platoon",
                "corridor_tracking",
                "corridor_two_platoons",
                "cut_ins",
                "grid_platoons",
                "highway_merge",
                "highway_platoon",
                "highway_tracking",
                "highway_traffic",
                "lab_obstacles",
                "paper_loop",
                "paper_path",
                "paper_printed",
                "paper_world",
                "penetration",
                "ring_platoon",
                "string",
                "yardsticks",
                "yardsticks_corridor",
            ],
        ),
        ("nets", ["bends", "bottleneck", "corridor", "grid", "highway", "lab_curves", "lab_loop", "lab_world", "ring"]),
        (
            "laws",
            [
                "acc",
                "acc_commercial",
                "cacc_path",
                "cacc_ploeg",
                "consensus",
                "constant_spacing",
                "external",
                "idm",
                "path",
                "policy",
                "printed",
                "reactive",
                "repaired",
                "sumo",
                "tracking",
            ],
        ),
        ("vehicles", ["paper-robot", "car", "van", "truck"]),
        (
            "lidars",
            ["paper-leader", "paper-follower", "utm30lx", "car-leader", "car-follower", "car-tracker", "car-around"],
        ),
    ],
)
def test_list_names_what_is_shipped(what, names):
    lines = call("list", what).stdout.splitlines()
    assert [line.split()[0] for line in lines] == names
    assert all(len(line.split()) > 1 for line in lines)


def test_bench_prints_json_for_programs_and_tables_for_people(monkeypatch):
    from platoontraffic.lidar import benchmark

    row = benchmark.Memory("nothing", 0.5)
    empty = {key: [] for key in ("cases", "scans", "noise", "ticks", "flat", "linear", "starts", "bars")}
    asked = []

    def run(plan, progress):
        asked.append(plan)
        progress("all of it")
        return benchmark.Report({"python": "3"}, memory=[row], **empty)

    monkeypatch.setattr(benchmark, "run", run)
    done = call("bench", "lidar", "--quick", "--json")
    assert (done.exit_code, done.stderr) == (0, "")
    assert json.loads(done.stdout)["memory"] == [{"what": "nothing", "megabytes": 0.5}]
    assert "megabytes" in call("bench", "lidar").stdout
    assert asked == [benchmark.QUICK, benchmark.FULL]


@pytest.mark.sumo
def test_new_writes_a_scenario_with_a_law_that_runs_as_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("new", "mine").exit_code == 0
    assert call("check", "mine/mine.toml").exit_code == 0
    done = call("run", "mine/mine.toml", "run.duration_s=60", "-q")
    assert done.exit_code == 0
    summary = (Path(done.stdout.strip()) / "summary.csv").read_text().splitlines()
    values = dict(zip(summary[0].split(","), summary[1].split(","), strict=True))
    assert (values["collisions"], values["lock_on_ratio_min"]) == ("0", "1.0")
    again = call("new", "mine")
    assert (again.exit_code, "nothing was changed" in again.stderr) == (2, True)


@pytest.mark.sumo
def test_plot_draws_a_picture(one_corner, tmp_path):
    done = call("plot", one_corner, "--to", tmp_path / "picture.png")
    assert done.exit_code == 0
    assert (tmp_path / "picture.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert "cannot be written" in call("plot", one_corner, "--to", tmp_path / "picture.nonsense").stderr


def _started(folder: Path, deadline: float = 60) -> Path:
    """The unfinished folder of a run, once it holds some rows."""
    until = time.monotonic() + deadline
    while time.monotonic() < until:
        for table in folder.glob("*/*.partial/trajectories.csv"):
            if table.stat().st_size > 10_000:
                return table.parent
        time.sleep(0.1)
    raise TimeoutError


@pytest.mark.sumo
@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    "name", ["SIGINT", pytest.param("SIGTERM", marks=pytest.mark.slow), pytest.param("SIGHUP", marks=pytest.mark.slow)]
)
def test_control_c_keeps_what_was_recorded_and_says_so(tmp_path, name):
    run = subprocess.Popen(
        [*COMMAND, "run", "paper_loop", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(getattr(signal, name), signal.SIG_DFL),  # the tests may run under nohup
    )
    try:
        _started(tmp_path)
        run.send_signal(getattr(signal, name))
        out, err = run.communicate(timeout=60)
    finally:
        run.kill()
    (kept,) = (tmp_path / "paper_loop").iterdir()
    assert (run.returncode, out) == (130, "")
    assert err == f"interrupted\nwhat was recorded until then is kept in {kept}\n"
    assert kept.name.endswith(".unfinished")
    assert not (kept / "DONE").exists()
    assert (kept / "trajectories.csv").read_text().endswith("\n")
    assert '"status": "unfinished"' in (kept / "provenance.json").read_text()
    refused = call("report", kept)
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1)
    assert f"an unfinished run; `platoontraffic run {kept / 'config.toml'}` repeats it" in refused.stderr
    assert call("plot", kept).stdout == f"{kept / 'plot.png'}\n"
    assert "unfinished run, which has no metrics" in call("plot", kept, "--what", "amplification").stderr


@pytest.mark.slow
@pytest.mark.sumo
def test_two_at_once_leave_one_result(tmp_path):
    command = [*COMMAND, "run", "paper_loop", "run.duration_s=10", "platoon.size=3", "-q", "--out", str(tmp_path)]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    said = [run.communicate(timeout=120) for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    assert len(set(said)) == 1
    assert len(list((tmp_path / "paper_loop").iterdir())) == 1


@pytest.mark.sumo
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_one_line_and_exit_code_1(tmp_path, monkeypatch):
    from platoontraffic.results import recorder as recording

    monkeypatch.setattr(recording.Recorder, "_open", lambda self, name, columns: open("/dev/full", "w"))  # noqa: SIM115
    done = call("run", "paper_loop", *SHORT, "--out", tmp_path)
    assert done.exit_code == 1
    assert "No space left on device" in done.stderr
    assert [f.name.partition(".")[2] for f in (tmp_path / "paper_loop").iterdir()] == ["unfinished"]


def test_results_that_cannot_be_written_are_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    done = call("run", "paper_loop", *SHORT, "--out", tmp_path / "file")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "results cannot be written" in done.stderr


@pytest.mark.parametrize("file", ["metrics.csv", "trajectories.csv", "scene.geojson"])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b'nonsense\n"'])
def test_a_damaged_result_is_one_line(one_corner, tmp_path, file, content):
    damaged = shutil.copytree(one_corner, tmp_path / "damaged")
    (damaged / file).write_bytes(content)
    done = call("plot", damaged)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert file in done.stderr


@pytest.mark.sumo
def test_an_empty_results_folder_of_the_users_survives_a_law_that_fails(tmp_path):
    law = "@dataclass(frozen=True)\nclass Law:\n    def __call__(self, sensed, memory, dt): 1 / 0\n"
    (tmp_path / "law.py").write_text("from dataclasses import dataclass\n" + law)
    text = shipped.scenarios()["paper_loop"].read_text().replace('"repaired"', '"law:Law"')
    (tmp_path / "mine.toml").write_text(text)
    (tmp_path / "out").mkdir()
    assert call("run", tmp_path / "mine.toml", "--out", tmp_path / "out").exit_code == 2
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.sumo
def test_force_keeps_the_finished_run_until_the_new_one_is_there(tmp_path, monkeypatch):
    first = Path(call("run", "paper_loop", *SHORT, "-q", "--out", tmp_path).stdout.strip())
    monkeypatch.setattr("platoontraffic.sumo.world.World.advance", lambda *_: 1 / 0)
    call("run", "paper_loop", *SHORT, "-q", "--out", tmp_path, "--force")
    assert (first / "DONE").is_file()


def test_doctor_starts_sumo_and_names_versions():
    done = call("doctor", "--json")
    findings = {finding["what"]: finding for finding in json.loads(done.stdout)}
    assert done.exit_code == 0
    assert findings["SUMO"]["text"].endswith("starts, steps and stops")
    assert all(finding["verdict"] != "trouble" for finding in findings.values())
    project = tomllib.loads(Path(__file__).parents[2].joinpath("pyproject.toml").read_text())["project"]
    extras = {f"extra {name}" for name in project["optional-dependencies"]} - {"extra docs", "extra dev"}
    assert extras == {what for what in findings if what.startswith("extra ")}


@pytest.mark.parametrize("what", ["scenario", "study"])
def test_schema_is_of_the_files_as_they_are(what):
    schema = json.loads(call("schema", what).stdout)
    files = shipped.scenarios() if what == "scenario" else shipped.studies()
    for file in files.values():
        assert set(tomllib.loads(file.read_text(encoding="utf-8"))) <= set(schema["properties"])
    assert call("schema", "lidar").exit_code == 2


@pytest.mark.sumo
def test_json_is_all_that_is_printed(tmp_path):
    ran = call("run", "paper_loop", *SHORT, "--json", "--out", tmp_path)
    assert json.loads(ran.stdout)["summary"]["lock_on_ratio_min"] == 1
    assert set(json.loads(call("list", "laws", "--json").stdout)) >= {"repaired", "printed"}
    checked = call("check", "paper_loop", "paper_follower", "nowhere.toml", "--json")
    fine, study, bad = json.loads(checked.stdout)["files"]
    assert (fine["faults"], study["faults"], len(bad["faults"]), checked.exit_code) == ([], [], 1, 2)


def test_it_says_its_version():
    done = CliRunner().invoke(app, ["--version"])
    cited = re.search(r"^version: (.+)$", Path(__file__).parents[2].joinpath("CITATION.cff").read_text(), re.MULTILINE)
    assert (done.exit_code, done.stdout) == (0, f"platoontraffic {cited[1]}\n")
