"""Input that once ended in a traceback, in a signal or in no words: now one line a fault, and exit code 2."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from platoontraffic import errors, shipped
from platoontraffic.cli.main import app
from tests.support import ROOT

LONG = "a" * 300
CORRIDOR = shipped.networks()["corridor"]
BOX = '[[obstacle]]\nkind = "box"\nx_m = 1.0\ny_m = 2.0\nlength_m = 1e-9\n[run]'
Write = Callable[..., Path]


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def command(*arguments: object, **environment: str) -> subprocess.CompletedProcess:
    words = [sys.executable, "-m", "platoontraffic", *map(os.fsencode, map(str, arguments))]
    return subprocess.run(words, capture_output=True, env=os.environ | environment, cwd=ROOT)


def assert_refused(done: Result, said: str) -> None:
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert "details, to report it" not in done.stderr
    assert all(len(line) < 5000 for line in done.stderr.splitlines())
    assert done.exit_code == 2


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("laps = 2.0", "step_s = 1e306", "mine.toml:8: run.step_s: 1e+306: should be less than"),
        ("laps = 2.0", "step_s = 1e-13", "mine.toml:8: run.step_s: 1e-13: must be whole milliseconds"),
        ("duration_s = 900.0", "duration_s = 1e308", "mine.toml:7: run.duration_s: 1e+308: should be less than"),
        ("[run]", "[record]\nevery_s = 1e308\n[run]", "record.every_s: 1e+308: should be less than"),
        ("[run]", "[record]\nscans_every_s = 1e307\n[run]", "record.scans_every_s: 1e+307: should be less than"),
        ("gap_m = 0.45", "gap_m = 1e308", "mine.toml:14: platoon.0.gap_m: 1e+308: should be less than"),
        ("position_m = 1.9", "position_m = 1.9, time_s = 1e308", "platoon.0.start.time_s: 1e+308: should be less than"),
        ("gap_m = 0.45", "vehicle = { length_m = 1e-9 }", "vehicle.length_m: 1e-09: should be greater than"),
        ("gap_m = 0.45", "vehicle = { width_m = 1e-9 }", "vehicle.width_m: 1e-09: should be greater than"),
        ("[run]", BOX, "mine.toml:10: obstacle.0.length_m: 1e-09: should be greater than or equal to 0.01"),
        ('law = "reactive"', 'law = "reactive"\nlidars = { x = { rate_hz = 1e-320 } }', "must be a multiple"),
        ("size = 5", "size = 9" + "9" * 5000, "mine.toml:12: platoon.0.size: has an integer of more than 64 bits"),
        ("size = 5", "size = 0x9" + "9" * 5000, "mine.toml:12: platoon.0.size: has an integer of more than 64 bits"),
        ("size = 5", "size = " + "[" * 900 + "]" * 900, "mine.toml: tables or lists are nested too deeply"),
        ("size = 5", "a." * 50_000 + "a = 1", "mine.toml: tables or lists are nested too deeply"),
        ('net = "lab_loop"', f'net = "{LONG}"', "mine.toml:4: sumo.net: "),
        ('net = "lab_loop"', f'net = "lab_loop"\nroutes = ["{LONG}"]', "cannot be read: File name too long"),
        ('law = "reactive"', f'law = "{LONG}:X"', f"platoon.0.leader.law: {LONG}: cannot be imported"),
        ('id = "robot"', 'id = "\udcff"', "mine.toml:11: byte 0xff: is not UTF-8"),
    ],
)
def test_values_beyond_all_use(old: str, new: str, said: str, scenario_file: Write):
    file = scenario_file()
    text = file.read_text()
    assert old in text
    file.write_bytes(text.replace(old, new, 1).encode("utf-8", "surrogateescape"))
    assert_refused(call("check", file), said)


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("seed=" + "9" * 5000, "argument 1: "),
        ("run.laps=" + "[" * 900, "argument 1: "),
        ("platoon.²=1", "platoon.0.²: unknown key"),
        ("platoon." + "9" * 5000 + ".size=1", "there are 1, numbered from 0"),
    ],
)
def test_arguments_beyond_all_use(argument: str, said: str):
    assert_refused(call("check", "paper_loop", argument), said)


@pytest.mark.parametrize(
    ("study", "said"),
    [
        (f'base = "{LONG}"', "base: '" + LONG + "': cannot be read: File name too long"),
        (
            'base = "paper_loop"\n[grid]\nplatoon.gap_m = { from = 1, to = 9' + "9" * 400 + ", step = 1 }",
            "m.toml:3: grid.platoon.gap_m: ",
        ),
        ('base = "paper_loop"\nseeds = { from = 1, to = 9' + "9" * 400 + ", step = 1 }", "m.toml:2: seeds: "),
        (
            'base = "paper_loop"\n[grid]\nplatoon.gap_m = { from = -1e308, to = 1e308, count = 3 }',
            "must be a shorter range",
        ),
        ('base = "paper_loop"\n[set]\nplatoon."²".size = 1', "platoon.0.²: unknown key"),
    ],
)
def test_studies_beyond_all_use(study: str, said: str, tmp_path: Path):
    file = tmp_path / "m.toml"
    file.write_text(study, encoding="utf-8")
    assert_refused(call("check", file), said)


@pytest.mark.parametrize(
    ("condition", "said"),
    [
        ('"a" * 9999999999 == 1', "+ - * / are for numbers"),
        ("platoon.size * [1] * 99999999999 == 1", "+ - * / are for numbers"),
        ("platoon.vehicle * 99999999999 == 1", "+ - * / are for numbers; at platoon.size = 1"),
        ("-" * 20_000 + "1", "cannot be read"),
        ("é > 1", "é: not a varied key of the study"),
        ("platoon.size < 1e-3", "fine, 2 runs"),
        ("platoon.size < 2.5E0 and platoon.size > .5e+0", "leaves out all runs"),
    ],
)
def test_conditions(condition: str, said: str, tmp_path: Path):
    file = tmp_path / "m.toml"
    grid = '[grid]\nplatoon.size = [1, 2]\nplatoon.vehicle = ["paper-robot"]'
    file.write_text(f'base = "paper_loop"\nleave_out = [{json.dumps(condition)}]\n{grid}')
    done = call("check", file)
    assert said in done.output
    assert "Traceback" not in done.output
    assert done.exit_code == (0 if said.startswith("fine") else 2)


@pytest.mark.parametrize(
    ("net", "pattern", "new", "said"),
    [
        ("lab_loop", r' speed="[^"]*"', ' speed="nan"', "x.net.xml:8: lane ':ne_0_0': speed = \"nan\"; must be"),
        ("lab_loop", r' speed="[^"]*"', ' speed="-3"', "x.net.xml:8: lane ':ne_0_0': speed = \"-3\"; must be"),
        ("lab_loop", r' width="[^"]*"', ' width="nan"', "lane ':ne_0_0': width = \"nan\"; must be"),
        ("lab_loop", r' length="[^"]*"', ' length="-3"', "x.net.xml:8: lane ':ne_0_0': length = \"-3\"; must be"),
        ("lab_loop", r' length="[^"]*"', ' length="1e300"', "lane ':ne_0_0': length = \"1e300\"; must be"),
        ("corridor", r'<phase duration="[^"]*"', '<phase duration="-5"', '<phase>: duration = "-5"; must be'),
        ("corridor", r'<connection from=":prio_4".*?/>', "", "no connection leads on from lane ':prio_4_0'"),
        ("corridor", r'<connection from="west_light" .*?/>', "", "junction 'light' has 12 requests for 9 connections"),
        ("corridor", r'<request index="4" .*?/>', "", "requests for 12 connections"),
        ("corridor", r'<request index="4" ', '<request index="9" ', "requests that are not numbered from 0 to 11"),
        (
            "corridor",
            r'<junction id="light"',
            '<lane id=":rs_2_0" index="0"/><junction id="light"',
            "is not in its edge",
        ),
        ("lab_loop", r' encoding="[^"]*"', ' encoding="KOI-99"', "x.net.xml:1: cannot be read (unknown encoding"),
        ("lab_loop", r"</net>", '<include href="x.net.xml"/></net>', "includes 'x.net.xml'; must be whole"),
    ],
)
def test_networks_that_crash_sumo_or_were_driven(
    net: str, pattern: str, new: str, said: str, tmp_path: Path, scenario_file: Write
):
    text, number = re.subn(pattern, new, shipped.networks()[net].read_text(encoding="utf-8"))
    assert number
    (tmp_path / "x.net.xml").write_text(text, encoding="utf-8")
    assert_refused(call("check", scenario_file(('net = "lab_loop"', 'net = "x.net.xml"'))), said)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        (
            "a.poly.xml",
            '<additional><poly id="p" type="obstacle" shape="0,0 1e300,0 1e300,1e300"/></additional>',
            "a.poly.xml:1: poly 'p': shape",
        ),
        ("a.add.xml", '<additional><include href="a.add.xml"/></additional>', "includes a.add.xml, which leads back"),
        ("a.add.xml", '<additional><include href="b.add.xml"/></additional>', "b.add.xml: no such file"),
        ("a.add.xml", "<net/>", "a.add.xml:1: root element is <net>, a network; must be a route file or an additional"),
        ("a.add.xml", '<additional><vType id="t" length="-1"/></additional>', "vType 't': length = \"-1\"; must be"),
        ("a.add.xml", '<additional><vType id="t" tau="nan"/></additional>', "vType 't': tau = \"nan\"; must be"),
        ("a.add.xml", '<additional><flow id="f" period="inf"/></additional>', "flow 'f': period = \"inf\"; must be"),
    ],
)
def test_additional_files(name: str, text: str, said: str, tmp_path: Path, scenario_file: Write):
    (tmp_path / name).write_text(text)
    file = scenario_file(('net = "lab_loop"', f'net = "lab_loop"\nadditional = ["{name}"]'))
    assert_refused(call("check", file), said)


def test_a_network_given_as_a_route_file(scenario_file: Write):
    """It was taken for traffic of no vehicles."""
    file = scenario_file(('net = "lab_loop"', f'net = "lab_loop"\nroutes = ["{CORRIDOR}"]'))
    assert_refused(call("check", file), "root element is <net>, a network; must be a route file or an additional file")


def test_a_netedit_configuration_that_names_itself(tmp_path: Path):
    file = tmp_path / "c.netecfg"
    file.write_text('<neteditConfiguration><sumocfg-file value="c.netecfg"/></neteditConfiguration>')
    assert_refused(call("check", file), "c.netecfg: names itself")


def test_a_simulation_has_one_thread(tmp_path: Path):
    from platoontraffic.road.network import read_configuration

    file = tmp_path / "c.sumocfg"
    file.write_text(f'<configuration><net-file value="{CORRIDOR}"/><threads value="4000"/></configuration>')
    read = read_configuration(file)
    assert ("threads" in read.options, read.ignored) == (False, ("threads",))


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", LONG), ("run", LONG), ("batch", LONG), ("replay", LONG), ("report", LONG), ("plot", LONG),
        pytest.param(("export", LONG), marks=pytest.mark.skipif(not find_spec("pyarrow"), reason="needs pyarrow")),
        ("run", "paper_loop", "--out", LONG),
    ],
)  # fmt: skip
def test_names_that_are_too_long(arguments: tuple[str, ...]):
    assert_refused(call(*arguments), "File name too long")


def test_a_folder_in_the_place_of_a_file(tmp_path: Path, scenario_file: Write):
    (tmp_path / "mine.sumocfg").mkdir()
    (tmp_path / "study.toml").write_text('base = "mine.sumocfg"\n[grid]\nplatoon.size = [2, 3]\n')
    scenario, folder = "must be a scenario file, or the name of a shipped scenario", tmp_path / "mine.sumocfg"
    for said, *words in (
        (f"{folder}: is a folder; {scenario}", "run", folder),
        (f"{folder}: is a folder; must be a study file", "batch", folder),
        (f"base: 'mine.sumocfg': is a folder; {scenario}", "check", tmp_path / "study.toml"),
        (f"sumo.net: '{folder}': is a folder; must be a network", "check", "paper_loop", f"sumo.net={folder}"),
        (f"{folder}: is a folder; must be a SUMO config", "check", "paper_loop", f"sumo.config={folder}"),
        ("is a folder; must be a route file", "check", scenario_file(("[run]", f'routes = ["{folder}"]\n[run]'))),
    ):
        assert_refused(call(*words), said)


def test_a_file_in_a_closed_folder(monkeypatch: pytest.MonkeyPatch):
    def closed(path: Path) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(errors.os, "stat", closed)
    assert errors.no_file("x") == "cannot be read: Permission denied"


def test_many_faults_are_counted(tmp_path: Path, scenario_file: Write):
    file = scenario_file()
    platoon = file.read_text().partition("[[platoon]]")[2]
    file.write_text(file.read_text() + f"\n[[platoon]]{platoon}" * 300)
    lines = call("check", file).stderr.splitlines()
    assert (len(lines), lines[-1]) == (51, "and 250 more")


def test_arguments_that_are_not_utf_8():
    done = command("run", "paper_loop", "--out", "inv\udcff")
    assert (done.returncode, done.stderr.decode()) == (2, "word 4 of the command, 'inv\\udcff': is not UTF-8\n")


@pytest.mark.parametrize(
    ("words", "said"), [(("--out", ""), "word 4 of the command: is empty"), (("--out=",), "--out: is empty")]
)
def test_an_empty_word_is_refused(words: tuple[str, ...], said: str):
    done = command("run", "paper_loop", *words, "--dry-run")
    assert (done.returncode, done.stderr.decode()) == (2, f"{said}; must be a text, or be left out\n")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("prove grid --routes 0", "Invalid value for '--routes': "),
        ("batch yardsticks -j 0", "Invalid value for '-j' / '--jobs': "),
        ("run paper_loop --seed x", "Invalid value for '--seed': "),
        ("run paper_loop --seed", "Option '--seed' requires an argument"),
        ("run", "Missing argument 'SCENARIO'"),
        ("nets foo", "No such command 'foo'"),
    ],
)
def test_a_fault_of_the_words_is_one_line(words: str, said: str):
    done = command(*words.split())
    (line,) = done.stderr.decode().splitlines()
    assert (done.returncode, done.stdout, line.startswith(f"platoontraffic: {said}")) == (2, b"", True)


def test_without_words_there_is_the_help():
    assert command("nets").stderr.decode().startswith("Usage: ")


@pytest.mark.parametrize("number", ["0", "x"])
def test_a_number_of_threads_that_numba_does_not_take(number: str):
    done = command("check", "paper_loop", NUMBA_NUM_THREADS=number)
    said = f"NUMBA_NUM_THREADS={number}: must be a whole number, 1 or more\n"
    assert (done.returncode, done.stderr.decode()) == (2, said)


def test_json_on_a_terminal_without_unicode():
    done = command("check", "é.toml", "--json", PYTHONIOENCODING="ascii")
    (fault,) = json.loads(done.stdout)["files"][0]["faults"]
    assert (done.returncode, done.stderr) == (2, b"")
    assert fault.startswith("é.toml: no such scenario file")


def test_a_full_stdout():
    with Path("/dev/full").open("w") as full:
        words = [sys.executable, "-m", "platoontraffic", "schema"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("No space left on device")


@pytest.mark.parametrize("where", ["shipped", "file"])
def test_a_study_is_run_by_another_command(tmp_path: Path, where: str):
    name, what = "paper_follower", "shipped study"
    if where == "file":
        name, what = str(tmp_path / "mine.toml"), "study"
        Path(name).write_text('base = "paper_loop"\n[grid]\nplatoon.size = [2, 3]\n')
    done = CliRunner().invoke(app, ["run", name])
    assert (done.exit_code, done.stderr) == (2, f"{name}: is a {what}; `platoontraffic batch {name}` runs it\n")


@pytest.mark.parametrize("key", ["record.passages", "equip.edges"])
def test_an_edge_may_be_a_number(key: str):
    """As those of OpenStreetMap are."""
    done = CliRunner().invoke(app, ["run", "capacity", f"{key}=123456", "--dry-run"])
    assert done.exit_code == 2
    assert "'123456': no such edge" in done.stderr


def test_a_type_of_a_share_must_be_in_the_demand(tmp_path: Path):
    """A misspelt one meant a share of nothing."""
    (tmp_path / "mine.rou.xml").write_text(
        '<routes><vTypeDistribution id="mix"><vType id="sedan"/><vType id="van"/></vTypeDistribution></routes>'
    )
    (tmp_path / "mine.toml").write_text(
        'sumo = { net = "grid", routes = ["mine.rou.xml"] }\nrun.duration_s = 10\n'
        '[[equip]]\nshare = 0.5\ntypes = ["sedann", "mix", "van"]\n'
    )
    done = CliRunner().invoke(app, ["check", str(tmp_path / "mine.toml")])
    assert done.exit_code == 2
    assert done.stderr.splitlines() == [
        f"{tmp_path / 'mine.toml'}:5: equip.0.types.0: 'sedann': no such vehicle type; did you mean 'sedan'?",
        f"{tmp_path / 'mine.toml'}:5: equip.0.types.1: 'mix': a distribution; must be types: sedan, van",
    ]


def test_edges_of_routes_must_be_in_the_network(tmp_path: Path):
    """A check said that all was fine, and SUMO refused the file in the run."""
    file = tmp_path / "mine.rou.xml"
    file.write_text(
        '<routes><flow id="f" begin="0" end="9" number="2" from="A0_A1" to="A1_A9"/>'
        '<vehicle id="v" depart="3"><route edges="A0_A1 A1_A2 nowhere"/></vehicle>'
        '<trip id="t" depart="5" from="A0_A1" to="A1_A2"/></routes>'
    )
    (tmp_path / "mine.toml").write_text(
        'sumo = { net = "grid", routes = ["mine.rou.xml"] }\nrun.duration_s = 10\n[[equip]]\nshare = 0.5\n'
    )
    done = CliRunner().invoke(app, ["check", str(tmp_path / "mine.toml")])
    assert done.exit_code == 2
    first, second = sorted(done.stderr.splitlines())
    assert first.startswith(f"{file}: 'f': no edge 'A1_A9'; did you mean")
    assert second.startswith(f"{file}: 'v': no edge 'nowhere'")


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("demand", "said"),
    [
        ('<trip id="t" type="nope" depart="900" from="A0_A1" to="A1_A2"/>', "The vehicle type 'nope' for vehicle 't'"),
        ('<flow id="f" begin="0" end="9" vehsPerHour="-5" from="A0_A1" to="A1_A2"/>', "Invalid repetition rate in"),
    ],
)
def test_what_sumo_refuses_is_found_without_a_run(tmp_path: Path, demand: str, said: str):
    file = tmp_path / "mine.rou.xml"
    file.write_text(f"<routes>{demand}</routes>")
    (tmp_path / "mine.toml").write_text(
        'sumo = { net = "grid", routes = ["mine.rou.xml"] }\nrun.duration_s = 10\n[[equip]]\nshare = 0.5\n'
    )
    for command in (("check",), ("run", "--dry-run")):
        assert_refused(call(*command, tmp_path / "mine.toml"), f"{file}: SUMO refuses it: {said}")


@pytest.mark.parametrize(
    ("edges", "lane", "said"),
    [
        ("A0_A1 A2_A3", "0", "no connection from edge 'A0_A1' to 'A2_A3'; it leads to: A1_"),
        ("A0_A1 A1_A2", "7", "departLane = '7': edge 'A0_A1' has "),
    ],
)
def test_vehicles_that_sumo_refuses_at_their_departure(tmp_path: Path, edges: str, lane: str, said: str):
    file = tmp_path / "mine.rou.xml"
    vehicle = f'<vehicle id="v" depart="3" departLane="{lane}"><route edges="{edges}"/></vehicle>'
    file.write_text(f"<routes>{vehicle}</routes>")
    traffic = 'sumo = { net = "grid", traffic = false, routes = ["mine.rou.xml"] }\nrun.duration_s = 5\n'
    platoon = '[[platoon]]\nvehicle = "car"\nstart = { edge = "A0_A1", position_m = 20 }\nto = "A1_A2"\n'
    for members in ("[[equip]]\nshare = 0.5\n", platoon):
        (tmp_path / "mine.toml").write_text(traffic + members)
        for command in (("check",), ("run", "--out", tmp_path / "out")):
            done = call(*command, tmp_path / "mine.toml")
            assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
            assert done.stderr.startswith(f"{file}: 'v': {said}")
        assert call("check", tmp_path / "mine.toml", "run.duration_s=2").exit_code == 0


@pytest.mark.sumo
def test_routes_that_sumo_is_to_ignore_are_no_fault(tmp_path: Path):
    """Neither for a check nor for the run."""
    (tmp_path / "mine.rou.xml").write_text(
        '<routes><vehicle id="v" depart="0"><route edges="A0_A1 A2_A3"/></vehicle></routes>'
    )
    net = shipped.networks()["grid"]
    (tmp_path / "mine.sumocfg").write_text(
        f'<configuration><net-file value="{net}"/><route-files value="mine.rou.xml"/><end value="1"/>'
        '<ignore-route-errors value="true"/></configuration>'
    )
    place = ("platoon.start.edge=A0_A1", "platoon.start.position_m=20", "platoon.to=A1_A2")
    for command in (("check",), ("run", "--out", tmp_path / "out")):
        assert call(*command, tmp_path / "mine.sumocfg", *place).exit_code == 0


@pytest.mark.parametrize("seeds", ["[1.5]", '["a"]', "true", "[true]"])
def test_seeds_of_another_kind(tmp_path: Path, seeds: str):
    """One line, without words of pydantic."""
    study = tmp_path / "mine.toml"
    study.write_text(f'base = "paper_loop"\nseeds = {seeds}\n[grid]\nplatoon.size = [2, 3]\n')
    done = CliRunner().invoke(app, ["check", str(study)])
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"{study}:2: seeds: ")
    assert "whole numbers" in line


def test_a_key_of_a_table_that_there_is_not():
    """The file was blamed, without a line."""
    done = CliRunner().invoke(app, ["check", "corridor_tracking", "equip.share=0.5"])
    assert done.exit_code == 2
    assert done.stderr == (
        "argument 1: equip: must be a list of tables: there is none here to change, or [[equip]] was meant\n"
    )


def test_a_fault_of_a_table_is_at_the_argument_that_set_the_key(tmp_path: Path):
    """It was at the first argument that set a key of the table."""
    file = tmp_path / "mine.toml"
    file.write_text('sumo.net = "grid"\nrun.duration_s = 90\n[[equip]]\nshare = 0.5\n')
    done = call("check", file, "equip.share=0.2", "equip.begin_s=50", "run.duration_s=60", "equip.end_s=20")
    assert done.stderr == f"argument 4 or {file}:3: equip.0: end_s 20; must be after begin_s = 50\n"
    done = call("check", file, "equip.share=0.2", "equip.size=3")
    assert done.stderr.startswith(f"argument 2 or {file}:3: equip.0: `size` goes with mode")


@pytest.mark.parametrize("modes", [("platoons", "single"), ("single", "platoons")])
def test_a_share_in_platoons_is_the_only_one(tmp_path: Path, modes: tuple[str, str]):
    """Where it was the first table, it was taken for none."""
    tables = (f'[[equip]]\nid = "e{i}"\nshare = 0.2\nmode = "{mode}"\n' for i, mode in enumerate(modes))
    file = tmp_path / "mine.toml"
    file.write_text('sumo.net = "grid"\nrun.duration_s = 10\n' + "".join(tables))
    done = CliRunner().invoke(app, ["check", str(file)])
    assert done.exit_code == 2
    assert f"equip.{modes.index('platoons')}.mode: 'platoons': there is another [[equip]] table" in done.stderr


def test_keys_to_change_need_a_file():
    done = CliRunner().invoke(app, ["check", "platoon.size=3"])
    assert done.exit_code == 2
    assert done.stderr.startswith("platoon.size=3: a key to change; must stand behind")


@pytest.mark.parametrize("key", ["--warm-up", "--duration"])
def test_endless_proofs(key: str):
    done = CliRunner().invoke(app, ["prove", "grid", "--traffic", key, "inf"])
    assert (done.exit_code, done.stderr) == (2, f"{key}: inf: must be a multiple of 0.1 s\n")


def test_a_folder_with_brackets_is_no_markup(tmp_path: Path):
    """It ended in a MarkupError, or was printed without them."""
    folder = tmp_path / "a [b] [" / "c]"
    folder.mkdir(parents=True)
    (folder / "s.toml").write_text((shipped.scenarios()["paper_loop"]).read_text())
    done = CliRunner().invoke(app, ["check", str(folder / "s.toml")])
    assert (done.exit_code, done.stdout) == (0, f"{folder / 's.toml'}: fine\n")
