"""A SUMO configuration is a scenario by itself; nothing is written beside it, and its faults are reported."""

from __future__ import annotations

import filecmp
import gzip
import json
import os
import re
import shlex
import shutil
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from platoontraffic import scenario, shipped, simulation
from platoontraffic.cli.main import app
from platoontraffic.errors import InputError
from platoontraffic.results import sumo_tables
from platoontraffic.road.network import Network
from platoontraffic.road.sumo_configuration import read_configuration
from tests.support import ODD_NETS

RING = shipped.networks()["ring"].parent
NETS = ODD_NETS
PLATOON = ("platoon.start.edge=east_north", "platoon.start.position_m=40", "platoon.to=west_south", "platoon.size=2")
SHORT = ("run.duration_s=2", *PLATOON)


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def configure(folder: Path, inside: str = "", name: str = "city.sumocfg", root: str = "configuration") -> Path:
    """A folder with a configuration, as a user has it."""
    folder.mkdir(exist_ok=True)
    for file in ("ring.net.xml", "ring.rou.xml"):
        shutil.copy(RING / file, folder)
    file = folder / name
    net = "sumo-net-file" if root == "neteditConfiguration" else "net-file"
    files = f"<{net} value='ring.net.xml'/><route-files value='ring.rou.xml'/>"
    file.write_text(f"<{root}><input>{files}</input>{inside}</{root}>")
    return file


def contents(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


# ---- what the configuration gives


def test_demand_multiplies_the_scale_of_the_configuration(tmp_path):
    config = configure(tmp_path / "theirs", "<time><end value='10'/></time><processing><scale value='2'/></processing>")
    for more, scale in (((), "2"), (("sumo.demand=1.5",), "3.0")):
        assert sumo_tables.sumo_options(scenario.load(config, (*PLATOON, *more)), tmp_path)["scale"] == scale


def test_defaults_are_those_of_cars_in_traffic(tmp_path):
    end = "<time><begin value='0:01:40'/><end value='160'/></time>"
    with pytest.raises(InputError, match="<end> 160: leaves no time after its <begin>, 100, and sumo"):
        scenario.load(configure(tmp_path / "theirs", end), (*PLATOON, "sumo.warm_up_s=60"))
    checked = scenario.load(configure(tmp_path / "theirs", end), (*PLATOON, "sumo.warm_up_s=20"))
    spec = checked.spec
    assert (spec.name, spec.scene.walls, spec.run.step_s, spec.run.duration_s) == ("city", "none", 0.1, 40.0)
    (platoon,) = spec.platoon
    assert (platoon.vehicle.type, platoon.leader.law, platoon.follower.law) == ("car", "path", "tracking")


@pytest.mark.parametrize(
    ("file", "name"), [("run.sumocfg", "my_town"), ("osm.sumocfg", "my_town"), ("city.sumocfg", "city")]
)
def test_a_name_that_says_nothing_is_replaced_by_that_of_the_folder(tmp_path, monkeypatch, file, name):
    config = configure(tmp_path / "my town", name=file)
    assert scenario.load(config, SHORT).spec.name == name
    monkeypatch.chdir(config.parent)
    assert scenario.load(file, SHORT).spec.name == name


OF_A_SCENARIO = '[sumo]\nconfig = "theirs/city.sumocfg"\n'


@pytest.mark.parametrize("named_in", ["argument", "scenario"])
@pytest.mark.parametrize(
    ("given", "step", "said"),
    [
        ("0.05", 0.05, []),
        ("1", 0.1, ["step-length = 1 is not used: SUMO has run.step_s = 0.1, because every laser scan must fall on a"]),
        ("0.0003125", 0.1, ["step-length = 0.0003125 is not used: SUMO has run.step_s = 0.1"]),
    ],
)
def test_its_step_is_used_if_it_fits_and_said_if_not(tmp_path, named_in, given, step, said):
    file = configure(tmp_path / "theirs", f"<time><step-length value='{given}'/></time>")
    if named_in == "argument":
        checked = scenario.load(file, SHORT)
    else:
        mine = tmp_path / "mine.toml"
        mine.write_text(OF_A_SCENARIO + "[run]\nduration_s = 2\n" + PLATOONS.replace("size", 'vehicle = "car"\nsize'))
        checked = scenario.load(mine)
    assert checked.spec.run.step_s == step
    assert [text.partition(": ")[2] for text in checked.remarks()] == checked.replaced()
    assert [text[: len(start)] for text, start in zip(checked.replaced(), said, strict=True)] == said


def test_its_seed_and_end_are_those_of_the_run_unless_others_are_given(tmp_path):
    inside = "<x><seed value='42'/></x><time><end value='30'/></time>"
    file, mine = configure(tmp_path / "theirs", inside), tmp_path / "mine.toml"
    mine.write_text(OF_A_SCENARIO + "[run]\n" + PLATOONS.replace("size", 'vehicle = "car"\nsize'))
    for checked in (scenario.load(file, PLATOON), scenario.load(mine)):
        assert (checked.seed, checked.spec.run.duration_s, checked.replaced()) == (42, 30.0, [])
    checked = scenario.load(file, PLATOON, seed=7)
    assert (checked.seed, checked.replaced()) == (7, ["seed = 42 is not used: the run has seed = 7"])
    assert scenario.load(mine, ["seed=8", "run.step_s=0.05"]).seed == 8
    file.write_text(file.read_text().replace("42", "-1"))
    checked = scenario.load(file, PLATOON)
    assert (checked.seed, checked.replaced()) == (1, ["seed = -1 is not used: the run has seed = 1"])
    file.write_text(file.read_text().replace("-1", "some"))
    with pytest.raises(InputError, match="<seed>: 'some'; must be a whole number"):
        scenario.load(file, PLATOON)


@pytest.mark.sumo
def test_a_run_says_at_its_end_what_it_has_in_place_of_the_configurations_values(tmp_path):
    file = configure(tmp_path / "theirs", "<x><seed value='42'/></x><time><step-length value='1'/></time>")
    done = call("run", file, *SHORT, "--seed", 5, "--out", tmp_path / "results")
    assert done.exit_code == 0, done.stderr
    said = [line for line in done.stdout.splitlines() if line.startswith("SUMO configuration: ")]
    assert [" ".join(line.split()[2:5]) for line in said] == ["seed = 42", "step-length = 1"]
    facts = json.loads((Path(done.stdout.splitlines()[-1]) / "provenance.json").read_text())
    again = json.loads(call("run", file, *SHORT, "--seed", 5, "--out", tmp_path / "results", "--json").stdout)
    assert len(facts["sumo_options_replaced"]) == 2
    assert again["sumo_options_replaced"] == facts["sumo_options_replaced"]


def test_what_is_not_used_is_named_and_unknown_options_are_left_to_sumo(tmp_path):
    inside = (
        "<report><no-step-log value='true'/></report><random_number><seed value='7'/></random_number>"
        "<output><output-prefix value='TIME_'/></output><a><remote-port value='8813'/><blurb value='1'/></a>"
        "<gui_only><gui-settings-file value='nowhere.xml'/><osg-view value='true'/><anything value='1'/></gui_only>"
    )
    file = configure(tmp_path / "theirs", inside)
    config = read_configuration(file)
    assert config.ignored == (
        "no-step-log", "output-prefix", "remote-port", "gui-settings-file", "osg-view", "anything",
    )  # fmt: skip
    assert config.options == {"blurb": "1"}
    done = call("check", file, *SHORT)
    unused, refused = done.stderr.splitlines()
    assert "options that are not used: no-step-log, output-prefix, " in unused
    assert (done.exit_code, refused.startswith(f"{file}: SUMO refuses it: ")) == (2, True)


def test_file_names_can_hold_spaces_and_environment_variables(tmp_path, monkeypatch):
    monkeypatch.setenv("TOWN", "ring")
    file = configure(tmp_path / "my theirs")
    shutil.copy(RING / "ring.rou.xml", file.parent / "at night.rou.xml")
    text = (
        file.read_text()
        .replace("'ring.net", "'${TOWN}.net")
        .replace("'ring.rou.xml'", "'ring.rou.xml, at night.rou.xml'")
    )
    file.write_text(text)
    config = read_configuration(file)
    assert config.net == file.parent / "ring.net.xml"
    assert [route.name for route in config.routes] == ["ring.rou.xml", "at night.rou.xml"]


@pytest.mark.parametrize("key", ["config", "argument"])
def test_a_netedit_configuration_is_a_configuration(tmp_path, key):
    file = configure(tmp_path / "theirs", "<x><node-files value='no.xml'/></x>", "all.netecfg", "neteditConfiguration")
    assert read_configuration(file).options == {}
    if key == "argument":
        assert scenario.load(file, SHORT).route_files == (file.parent / "ring.rou.xml",)
    else:
        mine = tmp_path / "mine.toml"
        mine.write_text(
            PLATOONS.replace("size = 2", 'leader = "sumo"').replace(
                "[[", '[sumo]\nconfig = "theirs/all.netecfg"\n[run]\nduration_s = 2\n[[', 1
            )
        )
        assert scenario.load(mine).net == file.parent / "ring.net.xml"
    inner = configure(tmp_path / "theirs", "<time><end value='9'/></time>", "inner.sumocfg")
    file.write_text("<neteditConfiguration><sumocfg-file value='inner.sumocfg'/></neteditConfiguration>")
    config = read_configuration(file)
    assert (config.path, config.end, config.inputs) == (file, 9.0, (inner,))


PLATOONS = """
[[platoon]]
id = "mine"
size = 2
start = { edge = "east_north", position_m = 40.0 }
to = "west_south"
"""


def test_platoons_can_come_from_a_file_and_faults_have_its_lines(tmp_path):
    config, file = configure(tmp_path / "theirs"), tmp_path / "platoons.toml"
    file.write_text(PLATOONS)
    checked = scenario.load(config, ["run.duration_s=2"], None, file)
    assert (checked.spec.name, checked.spec.platoon[0].id, checked.net) == (
        "city",
        "mine",
        config.parent / "ring.net.xml",
    )
    file.write_text(PLATOONS.replace("east_north", "east_nort"))
    done = call("run", config, "run.duration_s=2", "--platoon", file)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert done.stderr.startswith(f"{file}:")
    assert "no edge 'east_nort' in ring.net.xml; did you mean 'east_north'?" in done.stderr
    file.write_text(PLATOONS + '[sumo]\nnet = "grid"\n')
    assert "--platoon: sumo.net: must not be given" in call("run", config, "--platoon", file).stderr
    assert "--platoon: goes with a SUMO conf" in call("run", "ring_platoon", "--platoon", file).stderr
    file.write_text(PLATOONS)
    assert "sumo: missing: must name the road; platoons alone go with a SUMO conf" in call("run", file).stderr
    assert "nowhere.toml: cannot be read: No such file" in call("run", config, "--platoon", "nowhere.toml").stderr


@pytest.mark.parametrize("content", ["platoon = 5", "[platoon]\nsize = 2", "sumo = 1", "run = 1\n" + PLATOONS, "[["])
def test_a_platoon_file_of_another_form_is_a_fault(tmp_path, content):
    file = tmp_path / "platoons.toml"
    file.write_text(content)
    done = call("run", configure(tmp_path / "theirs"), "--platoon", file, "run.duration_s=2")
    assert done.exit_code == 2
    assert (
        "must be a table" in done.stderr
        or "[[platoon]] was meant" in done.stderr
        or "should be" in done.stderr
        or "TOML" in done.stderr
        or "not a table" in done.stderr
    )


# ---- faults


def test_without_a_platoon_the_fault_shows_a_complete_command_that_works(tmp_path):
    file = configure(tmp_path / "theirs")
    said = call("run", file)
    assert (said.exit_code, said.stderr.count("\n")) == (2, 1)
    assert "; equip.share=0.2 makes members of a fifth of its demand; " in said.stderr
    example = shlex.split(said.stderr.partition("for example: platoontraffic ")[2])
    assert call(*example, "--dry-run", "--out", tmp_path).exit_code == 0


@pytest.mark.parametrize("change", ["sumo.net=grid", "sumo.config=theirs/city.sumocfg"])
def test_an_argument_does_not_replace_the_road_of_a_configuration(tmp_path, change):
    """It ran the demand of the shipped grid under the name of the configuration."""
    file = configure(tmp_path / "theirs")
    with pytest.raises(InputError, match=f"argument 1: '{change}': must not be given; the configuration {file} says"):
        scenario.load(file, [change, *SHORT])


def test_an_edge_can_have_a_number_for_a_name(tmp_path):
    file = configure(tmp_path / "theirs")
    net = file.parent / "ring.net.xml"
    net.write_text(re.sub(r"\beast_north\b", "12", net.read_text().replace("east_north_", "12_")))
    file.write_text(file.read_text().replace("<route-files value='ring.rou.xml'/>", ""))
    assert call("check", file, *SHORT[:1], "platoon.start.edge=12", *PLATOON[1:]).exit_code == 0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("ring.rou.xml", "nowhere.rou.xml", ":1: <route-files>: 'nowhere.rou.xml': no such file"),
        ("ring.net.xml", "nowhere.net.xml", ":1: <net-file>: 'nowhere.net.xml': no such file"),
        ("ring.net.xml", "ring.net.xml,ring.net.xml", ":1: names 2 networks; must name one, as <net-file>"),
        ("<route-files", "<net-file value='other.net.xml'/><route-files", ":1: <net-file>: a second network; must"),
        ("</input>", "</input><load-state value='no.xml'/>", ":1: <load-state>: 'no.xml': no such file"),
        ("</input>", "</input><begin value='noon'/>", ":1: <begin>: 'noon'; must be a time"),
        ("</input>", "</input><end value='-5'/>", ":1: <end>: '-5'; must be after <begin>, 0, or -1 for none"),
        ("</input>", "</input><begin value='9'/><end value='3'/>", ":1: <end>: '3'; must be after <begin>, 9, or -1"),
        ("</input>", "</input><mesosim value='true'/>", ":1: <mesosim>: the mesoscopic model has no lanes"),
        ("ring.net.xml", "ring.rou.xml", "ring.rou.xml:4: root element is <routes>, a route file; must be <net>"),
        ("configuration", "routes", ":1: root element is <routes>, a route file; must be a SUMO configuration"),
        ("</configuration>", "", "not whole XML"),
    ],
)
def test_a_fault_of_a_configuration_is_one_line(tmp_path, old, new, said):
    file = configure(tmp_path / "theirs")
    file.write_text(file.read_text().replace(old, new))
    done = call("check", file, *SHORT)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


def test_an_empty_configuration_is_reported_as_empty(tmp_path):
    (tmp_path / "a.sumocfg").write_text("")
    assert call("check", tmp_path / "a.sumocfg", *SHORT).stderr.startswith(
        f"{tmp_path / 'a.sumocfg'}:1: the file is empty"
    )


def test_an_end_or_a_duration_must_be_given(tmp_path):
    done = call("run", configure(tmp_path / "theirs"), *PLATOON)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "has no <end>; give the duration of the run, for example run.duration_s=600" in done.stderr


def test_a_misspelt_duration_is_named_beside_the_missing_one(tmp_path):
    done = call("run", configure(tmp_path / "theirs"), *PLATOON, "run.duraton_s=300")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 2)
    assert "has no <end>" in done.stderr
    assert "run.duraton_s: unknown key; did you mean 'duration_s'?" in done.stderr


@pytest.mark.parametrize(
    ("demand", "what"),
    [
        ('<vehicle id="platoon.1" depart="0">', "vehicle 'platoon.1' is, or makes, 'platoon.1', the id of a member"),
        ('<flow id="platoon" end="9" number="2">', "flow 'platoon' is, or makes, 'platoon.0', the id of a member"),
    ],
)
def test_a_background_vehicle_with_the_id_of_a_member_is_a_fault(tmp_path, demand, what):
    file = configure(tmp_path / "theirs")
    routes = file.parent / "ring.rou.xml"
    end = '<route edges="east_north"/>' + demand.split()[0].replace("<", "</") + "></routes>"
    routes.write_bytes(gzip.compress(f"<routes>\n{demand}{end}".encode()))
    (fault,) = call("check", file, *SHORT).stderr.splitlines()
    assert fault == f"{file}: platoon.0.id: 'platoon': {routes}:2: {what}; must be another"
    assert call("check", file, *SHORT, "platoon.id=other").exit_code == 0


# ---- what SUMO writes


DETECTORS = """<additional>
<e1Detector id="d" lane="east_north_0" pos="10" freq="1" file="out/counted.xml"/>
<edgeData id="e" freq="1" file="{absolute}"/>
<rerouter id="r" edges="east_north" file="rules.xml"/>
<include href="more/more.add.xml"/>
<vType id="watched"><param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="near.xml"/></vType>
<vType id="watched2"><param key="has.ssm.device" value="true"/></vType>
<flow id="w" type="watched" begin="0" end="9" period="3" from="east_north" to="west_south"/>
<flow id="x" type="watched2" begin="0" end="9" period="3" from="east_north" to="west_south"/>
</additional>"""


def writing_configuration(tmp_path: Path) -> Path:
    """A configuration that makes SUMO write files in every possible way."""
    inside = (
        "<additional-files value='writing.add.xml'/><output><tripinfo-output value='out/trips.xml'/>"
        "<netstate-dump value='dump.xml'/><statistic-output value='/dev/null'/><save-state.period value='1'/>"
        "<summary value='localhost:9000'/><device.rerouting.output value='rerouted.xml'/></output>"
        "<report><log value='log.txt'/></report>"
    )
    folder = tmp_path / "theirs"
    file = configure(folder, inside)
    (folder / "more").mkdir()
    (folder / "writing.add.xml").write_text(DETECTORS.format(absolute=tmp_path / "theirs" / "edges.xml"))
    (folder / "rules.xml").write_text("<rerouter/>")
    more = '<additional><e1Detector id="m" lane="east_north_0" pos="20" freq="1" file="inside.xml"/></additional>'
    (folder / "more" / "more.add.xml").write_text(more)
    return file


@pytest.mark.sumo
def test_files_are_written_only_into_the_folder_of_the_run(tmp_path, monkeypatch):
    file = writing_configuration(tmp_path)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    before = contents(tmp_path / "theirs")
    changes = ("run.duration_s=1", "sumo.warm_up_s=60", *PLATOON, 'record.sumo=["trips", "edges"]')
    done = call("run", os.path.relpath(file), *changes, "-q")
    assert done.exit_code == 0, done.stderr
    assert contents(tmp_path / "theirs") == before
    folder = tmp_path / "here" / done.stdout.strip()
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["results"]
    written = {path.name for path in folder.iterdir() if path.name.startswith("sumo_")}
    assert written >= {
        "sumo_out_counted.xml", "sumo_edges.xml", "sumo_inside.xml", "sumo_near.xml", "sumo_ssm.xml", "sumo_dump.xml",
        "sumo_out_trips.xml", "sumo_localhost_9000", "sumo_rerouted.xml", "sumo_log.txt", "sumo_trips.csv",
    }  # fmt: skip
    facts = json.loads((folder / "provenance.json").read_text())
    assert facts["sumo_options_ignored"] == ["save-state.period"]
    again = call("run", folder / "config.toml", "-q", "--out", tmp_path / "again")
    assert again.exit_code == 0, again.stderr
    for table in ("trajectories.csv", "sumo_trips.csv", "sumo_edges.csv", "metrics.csv"):
        assert filecmp.cmp(folder / table, Path(again.stdout.strip()) / table, shallow=False)


@pytest.mark.sumo
def test_trips_become_a_table_whatever_name_the_configuration_gives_them(tmp_path):
    inside = "<output><tripinfo-output value='trips.csv'/><summary-output value='s.xml'/></output>"
    changes = ("sumo.warm_up_s=9", *SHORT, "record.sumo=trips,summary", "record.sumo_every_s=1")
    done = call("run", configure(tmp_path / "theirs", inside), *changes, "-q", "--out", tmp_path)
    assert done.exit_code == 0, done.stderr
    folder = Path(done.stdout.strip())
    assert len(pd.read_csv(folder / "sumo_trips.csv")) > 2
    assert len(pd.read_csv(folder / "sumo_summary.csv")) == 3
    left = sorted(file.name for file in folder.glob("sumo_*"))
    assert left == ["sumo_s.xml", "sumo_summary.csv", "sumo_trips.csv"]


def test_detectors_of_traffic_lights_write_into_the_folder_of_the_run(tmp_path):
    file = configure(tmp_path / "theirs")
    net = file.parent / "ring.net.xml"
    light = '<tlLogic id="t" type="actuated" programID="0" offset="0"><param key="file" value="seen.xml"/></tlLogic>'
    net.write_text(net.read_text().replace("<junction", f"{light}<junction", 1))
    options = sumo_tables.sumo_options(scenario.load(file, SHORT), tmp_path)
    assert Path(options["net-file"]).parent == tmp_path
    assert f'value="{tmp_path / "sumo_seen.xml"}"' in Path(options["net-file"]).read_text()
    assert options["route-files"] == str(file.parent / "ring.rou.xml")


@pytest.mark.sumo
def test_an_option_that_sumo_does_not_know_is_reported_in_its_words(tmp_path):
    file = configure(tmp_path / "theirs", "<a><blurb value='1'/></a>")
    done = call("run", file, *SHORT, "--out", tmp_path / "results")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "SUMO refuses it: " in done.stderr
    assert "blurb" in done.stderr


# ---- odd networks

WALK = ("run.duration_s=20", "platoon.start.edge=wm", "platoon.start.position_m=60", "platoon.to=me")


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("net", "lane"), [("odd.net.xml", 2), ("odd.net.xml.gz", 2), ("left", 2), ("bare", 1)]
)  # fmt: skip
def test_platoons_drive_on_odd_networks(tmp_path, net, lane):
    name = net if "." in net else f"{net}.net.xml"
    bytes_ = (NETS / name.removesuffix(".gz")).read_bytes()
    (tmp_path / name).write_bytes(gzip.compress(bytes_) if name.endswith(".gz") else bytes_)
    (tmp_path / "a.sumocfg").write_text(f"<configuration><net-file value='{name}'/></configuration>")
    more = (f"platoon.start.lane={lane}", "platoon.size=3")
    done = call("run", tmp_path / "a.sumocfg", *WALK, *more, "-q", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    rows = pd.read_csv(Path(done.stdout.strip()) / "trajectories.csv")
    last = rows[rows.time_s == rows.time_s.max()]
    assert len(last) == 3
    assert last.x_m.min() > 100
    # On the lanes all the way, on the side of the road on which the country drives.
    side = -1.6 if net == "left" else 1.6
    assert rows[rows.x_m < 180].right_of_middle_m.to_numpy() == pytest.approx(side, abs=0.4)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["start.edge=mw", "start.lane=0"], "edge 'mw' lane 0 is for pedestrian; must be one for cars: 1 or 2"),
        (["start.edge=wm", "start.lane=1"], "edge 'wm' lane 1 is for bus; must be one for cars: 2"),
        (["start.edge=buses"], "edge 'buses' has no lane for cars: it is for bus, pedestrian"),
        (["start.edge=rail"], "edge 'rail' is not a road: it is for rail"),
        (["start.edge=path"], "edge 'path' is not a road: it is for pedestrian"),
        (["start.edge=wm", "start.lane=5"], "edge 'wm' has no lane 5; must be 0..2, 0 rightmost"),
        (["start.edge=wn"], "no edge 'wn' in odd.net.xml"),
        (["start.edge=wm", "start.lane=2", "start.position_m=500"], "position 500 m is not on it; must be 0..192.8 m"),
        (["start.edge=wm", "start.lane=2", "to=buses"], "edge 'buses' has no lane for cars: it is for bus, pedestrian"),
        (["start.edge=wm", "start.lane=2", "to=rail"], "edge 'rail' is not a road: it is for rail"),
        (["start.edge=wm", "start.lane=2", "to=mf"], "no edge 'mf' in odd.net.xml"),
        (
            ["start.edge=wm", "start.lane=2", 'route=["wm", "em"]'],
            "from edge 'wm' to 'em'; it leads to: me, ms",
        ),
        (["start.edge=wm", "start.lane=2", 'route=["wm", "rail"]'], "edge 'rail' is not a road: it is for rail"),
        (["start.edge=wm", "start.lane=2", 'route=["me", "em"]'], "does not contain the start edge 'wm'"),
    ],
)
def test_a_start_or_a_route_that_is_not_for_cars_is_a_fault(tmp_path, changes, said):
    (tmp_path / "a.sumocfg").write_text(f"<configuration><net-file value='{NETS}/odd.net.xml'/></configuration>")
    given = ["run.duration_s=2", *(f"platoon.{change}" for change in changes)]
    if not any(change.startswith("start.position_m=") for change in changes):
        given.append("platoon.start.position_m=40")
    if not any(change.startswith(("to=", "route=")) for change in changes):
        given.append("platoon.to=me")
    with pytest.raises(InputError) as caught:
        simulation.prepare(scenario.load(tmp_path / "a.sumocfg", given))
    (fault,) = caught.value.faults
    assert said in fault


def test_a_lane_for_both_directions_is_a_fault():
    network = Network.read(NETS / "bidi.net.xml")
    with pytest.raises(InputError, match="'wm' shares its lane with oncoming 'mw'; must have its own"):
        network.route_line(["wm", "me"])
    assert network.middle_lines() == []
