"""Each fault in a scenario file is reported in one line, with its place, before anything starts."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import pytest
import tomli_w

from platoontraffic import scenario, shipped, simulation
from platoontraffic.errors import InputError
from platoontraffic.lidar import PRESETS, Noise
from platoontraffic.scenario.scenario import relative_to
from platoontraffic.scenario.tables import Manoeuvre, Sumo
from platoontraffic.scenario.toml_lines import key_lines
from platoontraffic.scenario.vehicle_tables import Vehicle
from platoontraffic.vehicles.catalogue import VEHICLES


def faults(name, *changes) -> list[str]:
    with pytest.raises(InputError) as caught:
        simulation.prepare(scenario.load(name, changes))
    for fault in caught.value.faults:
        assert "\n" not in fault
    return list(caught.value.faults)


def vehicle(*changes):
    """The vehicle model of the paper's loop with changes of the platoon."""
    return scenario.load("paper_loop", [f"platoon.{c}" for c in changes]).spec.platoon[0].vehicle.model()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("laps = 2.0", "lapps = 2.0", "mine.toml:8: run.lapps: unknown key; did you mean 'laps'?"),
        ("laps = 2.0", "seed = 2", "mine.toml:8: run.seed: unknown key; did you mean 'seed', outside all tables?"),
        ("size = 5", 'size = "5"', "mine.toml:12: platoon.0.size: '5': should be a valid integer"),
        ("gap_m = 0.45", "gap_m = -0.45", "mine.toml:14: platoon.0.gap_m: -0.45: should be greater than 0"),
        ("duration_s = 900.0", "duration_s = nan", "mine.toml:7: run.duration_s: nan: should be a finite number"),
        ("duration_s = 900.0", "step_s = 0.0333", "mine.toml:7: run.step_s: 0.0333: must be whole milliseconds"),
        ('net = "lab_loop"', 'net = "lab_lop"', "mine.toml:4: sumo.net: 'lab_lop': no such file or shipped network"),
        ('law = "repaired"', 'law = "repared"', "mine.toml:21: platoon.0.follower.law: no law 'repared'; did you mean"),
        ('law = "repaired"', 'law = "nosuch:Law"', "mine.toml:21: platoon.0.follower.law: nosuch: cannot be imported"),
        ('law = "repaired"', 'law = "path"', "mine.toml:21: platoon.0.follower.law: 'path' needs platoon.0.route"),
        ('"paper-follower"', '"paper-folower"', "lidar.preset: 'paper-folower': not known; did you mean"),
        ('"paper-follower"', "{ range_min_m = 2.0 }", "mine.toml:22: platoon.0.follower.lidar: range_max = 1.0"),
        ('"paper-follower"', "{ rate_hz = 30.0 }", "rate_hz: 30: the scan interval must be a multiple of run.step"),
        ('"paper-follower"', '{ noise = "utm30l" }', "follower.lidar.noise.preset: 'utm30l': not known; did you mean"),
        ('"paper-follower"', "{ noise = 5 }", "follower.lidar.noise: 5: should be a table, or a name"),
        ('"paper-follower"', "{ noise = { sigma = 1 } }", "lidar.noise.sigma: unknown key; did you mean 'sigma_m'?"),
        (
            '"paper-follower"',
            '"paper-follower"\nlidars = { car = { sampels = 9 } }',
            "follower.lidars.car.sampels: unknown key; did you mean 'samples'?",
        ),
        (
            '"repaired"\nlidar = "paper-follower"',
            '"tracking"\nlidar = { samples = 14 }',
            "deg apart; must be nearer than 1.67 deg for 'tracking'",
        ),
        ('"paper-follower"', "{ noise = { dropout = 2 } }", "noise.dropout: 2: should be less than or equal to 1"),
        ('"paper-follower"', "{ sweeps = 1000 }", "sweeps = 1000; must be a whole number from 1 to samples = 720"),
        ('edge = "sw_se"', 'edge = "sw_es"', "mine.toml:13: platoon.0.start: no edge 'sw_es'"),
        ("position_m = 1.9", "position_m = 9.9", "mine.toml:13: platoon.0.start: edge 'sw_se': position 9.9 m is not"),
        ("position_m = 1.9", "position_m = 1.9, lateral_m = -0.45", "robot.0 would start at (3.80, 0.05) m, not"),
        ("gap_m = 0.45", 'vehicle = "carr"', "mine.toml:14: platoon.0.vehicle.type: 'carr': not known; did you mean"),
        ("gap_m = 0.45", "vehicle = { whelbase_m = 0.1 }", "whelbase_m: unknown key; did you mean 'wheelbase_m'?"),
        ("gap_m = 0.45", "vehicle = { max_wheel_speed_radps = 0.0 }", "radps: 0.0: should be greater than 0"),
        ("[platoon.follower]", "[platoon.folower]", "mine.toml:20: platoon.0.folower: unknown key; did you mean"),
        ("[sumo]", "[sumo", "not valid TOML"),
    ],
)  # fmt: skip
def test_a_fault_is_reported_with_line_and_key(scenario_file, old, new, said):
    assert any(said in fault for fault in faults(scenario_file((old, new))))


def test_a_platoon_that_is_too_long_for_its_road_is_told_how_many_fit():
    (fault,) = faults("corridor_platoon", "platoon.size=10000")
    assert "platoon.8 would start at " in fault
    assert fault.endswith("not wholly on the road; a size of 8 fits")
    assert simulation.prepare(scenario.load("corridor_platoon", ["platoon.size=8"])).members


def test_the_faults_of_start_and_route_are_told_at_once(scenario_file):
    given = faults(
        scenario_file(
            ('edge = "sw_se"', 'edge = "sw_es"'), ("[platoon.leader]", 'route = ["sw_se", "es_ne"]\n[platoon.leader]')
        )
    )
    assert [fault.partition(": ")[2] for fault in given] == [
        "platoon.0.start: no edge 'sw_es' in lab_loop.net.xml; did you mean 'sw_se'?",
        "platoon.0.route: no edge 'es_ne' in lab_loop.net.xml; did you mean 'se_ne'?",
    ]


def test_noise_of_a_lidar_is_that_of_its_preset_unless_given():
    def noise(*changes):
        changes = [f"platoon.follower.lidar.{change}" for change in changes]
        return simulation.prepare(scenario.load("paper_loop", changes)).members[1].lidar.noise

    assert noise() == Noise()
    assert noise("noise=utm30lx") == PRESETS["utm30lx"].noise
    given = noise("noise=utm30lx", "noise.sigma_m=0.02", "noise.grazing_from_deg=60", "noise.dropout_grazing=0.1")
    assert given == replace(PRESETS["utm30lx"].noise, sigma=0.02, grazing_from=math.pi / 3, dropout_grazing=0.1)
    car = ("preset=car-follower", "range_min_m=0.3", "range_max_m=3")
    assert noise(*car) == PRESETS["car-follower"].noise
    assert noise(*car, "noise=none", "noise.bias_m=0.1") == Noise(bias=0.1)


def test_each_key_of_another_class_of_vehicle_is_a_fault(scenario_file):
    table = 'vehicle = { type = "van", wheel_radius_m = 0.3, max_wheel_speed_radps = 9.0, lag_s = 0.1 }'
    file = scenario_file(("gap_m = 0.45", table))
    radius, speed = faults(file)
    assert radius.startswith(f"{file}:14: platoon.0.vehicle.wheel_radius_m: 0.3: a key of paper-robot, not of van; did")
    assert "max_wheel_speed_radps: 9.0: a key of paper-robot, not of van; did you mean" in speed


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["vehicle.wheelbase_m=99"], "vehicle.wheelbase_m: 99.0: must be at most 3.64, from the rear axle"),
        (["vehicle.axle_m=50"], "vehicle.axle_m: 50.0: must be from -2.37 to 2.37, within"),
        (["vehicle.length_m=2"], "vehicle.length_m: 2.0: axle_m must be from -1 to 1, within"),
        (["vehicle.length_m=3", "vehicle.axle_m=-1"], "vehicle.length_m: 3.0: wheelbase_m must be at most 2.5"),
        (["vehicle.max_jerk_mps3=1e-6"], "vehicle.max_jerk_mps3: 1e-06: should be greater than or equal to 0.1"),
        (["vehicle.response_s=1e9"], "vehicle.response_s: 1000000000.0: should be less than or"),
        (["vehicle.lag_s=1e9"], "vehicle.lag_s: 1000000000.0: should be less than or"),
        (["follower.time_headway_s=1e9"], "follower.time_headway_s: 1000000000.0: should be less than or"),
    ],
)  # fmt: skip
def test_a_car_that_cannot_be_is_a_fault(changes, said):
    (fault,) = faults("highway_tracking", *(f"platoon.{change}" for change in changes))
    assert fault.startswith(f"argument 1: platoon.0.{said}")


def test_wheels_of_a_robot_are_not_farther_apart_than_it_is_wide():
    (fault,) = faults("paper_loop", "platoon.vehicle.wheel_separation_m=0.2")
    assert fault == "argument 1: platoon.0.vehicle.wheel_separation_m: 0.2: must be at most 0.15, the width"


@pytest.mark.parametrize("name", VEHICLES)
def test_a_named_vehicle_is_that_of_the_catalogue(name):
    assert vehicle(f"vehicle={name}") == VEHICLES[name]


def test_keys_of_a_vehicle_become_si():
    given = vehicle("vehicle.type=car", "vehicle.max_steering_deg=30", "vehicle.power_wpkg=40", "vehicle.lag_s=0")
    assert given == replace(VEHICLES["car"], max_steering=math.radians(30), power=40.0, lag=0.0)


def test_every_field_of_every_vehicle_has_a_key_with_a_unit():
    keys = [key.rsplit("_", 1)[0] for key in Vehicle.model_fields]
    assert set(keys) == {"type"} | {f.name for v in VEHICLES.values() for f in fields(v)}
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize(("name", "gap"), [("paper-robot", 0.5), ("truck", 2.5)])
def test_a_resolved_scenario_has_the_default_gap_and_the_vehicle_and_loads_again(tmp_path, name, gap):
    text = (
        shipped.scenarios()["paper_loop"]
        .read_text()
        .replace("gap_m = 0.45", f'vehicle = {{ type = "{name}", lag_s = 1.0 }}')
    )
    (tmp_path / "first.toml").write_text(text)
    first = scenario.load(tmp_path / "first.toml")
    assert first.spec.platoon[0].gap_m == gap
    resolved = first.resolved(tmp_path)
    assert resolved["platoon"][0]["vehicle"] == {"type": name, "lag_s": 1.0}
    (tmp_path / "again.toml").write_text(tomli_w.dumps(resolved))
    assert scenario.load(tmp_path / "again.toml").resolved(tmp_path) == resolved


def test_all_faults_are_reported_at_once(scenario_file):
    file = scenario_file(("size = 5", "size = 0"), ("gap_m = 0.45", "gap_m = 0.0"), ("laps = 2.0", "laps = -1.0"))
    assert len(faults(file)) == 3


def test_platoons_cannot_share_an_id_or_a_start_pose(scenario_file):
    second = '\n[[platoon]]\nid = "robot"\nstart = { edge = "sw_se", position_m = 1.8 }\nleader = "reactive"\n'
    file = scenario_file()
    text = file.read_text()
    file.write_text(text + second)
    assert faults(file) == [f"{file}:25: platoon.1.id: 'robot': platoon.0 has the same id; must be another"]
    file.write_text(text + second.replace('"robot"', '"other"'))
    assert faults(file) == [f"{file}:26: platoon.1.start: other.0 would start on robot.0"]


@pytest.mark.parametrize(
    ("shape", "said"),
    [("3.5,0.3 4.5,0.3 4.5,0.7 3.5,0.7", "robot.0 would start inside an obstacle"),
     ("3.75,0.3 3.85,0.3 3.85,0.7 3.75,0.7", "robot.0 would start in contact with the wall or obstacle at"),
     ("3.5,0.3 nonsense", "boxes.poly.xml:2: poly 'box'")],
)  # fmt: skip
def test_a_start_pose_on_an_obstacle_and_an_unreadable_obstacle_are_faults(scenario_file, tmp_path, shape, said):
    poly = f'<additional>\n<poly id="box" type="obstacle" shape="{shape}"/>\n</additional>'
    (tmp_path / "boxes.poly.xml").write_text(poly)
    (fault,) = faults(scenario_file(('net = "lab_loop"', 'net = "lab_loop"\nadditional = ["boxes.poly.xml"]')))
    assert said in fault


def test_a_route_that_does_not_connect_is_a_fault(scenario_file):
    route = 'gap_m = 0.45\nroute = ["sw_se", "ne_nw"]'
    said = faults(scenario_file(("gap_m = 0.45", route), ('law = "reactive"', 'law = "path"')))
    assert said[0].endswith(
        "mine.toml:15: platoon.0.route: no connection from edge 'sw_se' to 'ne_nw'; it leads to: se_ne"
    )


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("platoon.size", "argument 1: 'platoon.size': must be key=value"),
        ("platoon.3.size=2", "argument 1: 'platoon.3.size=2': there are 1, numbered from 0"),
        ("run.duration_s=ten", "argument 1: run.duration_s: 'ten': should be a valid number"),
        ("platoon.follower.stand_of_m=1", "argument 1: platoon.0.follower.stand_of_m: unknown key; did you mean"),
        ("platoon.follower.lidr=x", "platoon.0.follower.lidr: unknown key; did you mean 'lidar'?"),
        ("platoon.size.x=1", "platoon.0.size is not a table"),
    ],
)
def test_a_fault_in_an_argument_is_reported_with_its_number(argument, said):
    assert any(said in fault for fault in faults("paper_loop", argument))


@pytest.mark.parametrize("content", ["", "<net", "<net></net>", '<net version="1.20"></net>', "<routes/>"])
def test_a_broken_net_is_a_fault_before_sumo_reads_it(scenario_file, tmp_path, content):
    (tmp_path / "broken.net.xml").write_text(content)
    (said,) = faults(scenario_file(('"lab_loop"', '"broken.net.xml"')))
    assert "broken.net.xml:" in said


DERIVED = "from dataclasses import dataclass\nfrom platoontraffic import Law as L\n@dataclass(frozen=True)\n"
CALL = "\n    def __call__(self, sensed, memory, dt): ...\n"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import nothing_of_that_name\n", "law.py:1: cannot be imported: ModuleNotFoundError"),
        ("def broken(:\n", "law.py:1: cannot be imported: SyntaxError"),
        ("1 / 0\n", "law.py:1: cannot be imported: ZeroDivisionError"),
        ("class Lew: ...\n", "law has no law 'Law', a class with __call__; did you mean 'Lew'?"),
        ("class Law:\n    def __call__(self): ...\n", "Law must be a frozen dataclass, of its gains"),
        (DERIVED + "class Law(L): ...\n", "law: the class Law has no __call__; a law must have one"),
        (
            DERIVED + "class Law(L):\n    lidar = 'car'" + CALL,
            "Law declares lidar = 'car'; must be one of: paper-leader, ",
        ),
        (DERIVED + "class Law(L):\n    lidar = 3" + CALL, "Law declares lidar = 3; must be one of: paper-leader, "),
        (
            DERIVED + "class Law(L):\n    further_lidars = {'rear': None}" + CALL,
            "Law declares further_lidars['rear'] = None; must be one of: paper-leader, ",
        ),
    ],
)
def test_a_plug_in_that_cannot_be_used_is_a_fault_of_the_key_law(scenario_file, tmp_path, source, said):
    (tmp_path / "law.py").write_text(source)
    (fault,) = faults(scenario_file(('law = "repaired"', 'law = "law:Law"')))
    assert fault.startswith(f"{tmp_path / 'mine.toml'}:21: platoon.0.follower.law: ")
    assert said in fault


@pytest.mark.parametrize(
    ("module", "missing", "file"), [("nosuch", "nosuch", "nosuch.py"), ("json.no.such", "json.no", "json/no/such.py")]
)
def test_of_a_module_that_is_nowhere_the_file_is_named_that_would_be_it(scenario_file, tmp_path, module, missing, file):
    (fault,) = faults(scenario_file(('law = "repaired"', f'law = "{module}:Law"')))
    assert f"No module named '{missing}'" in fault
    assert fault.endswith(f"; nor is there a file {tmp_path / file}")


def test_the_lidar_of_a_law_may_depend_on_its_gains(scenario_file, tmp_path):
    lidar = "    @property\n    def lidar(self): return 'car-follower'\n"
    (tmp_path / "law.py").write_text(DERIVED + "class Law(L):\n" + lidar + CALL)
    simulation.prepare(scenario.load(scenario_file(('law = "repaired"', 'law = "law:Law"'))))  # no fault


def test_arguments_change_every_platoon_or_the_numbered_one():
    world = scenario.load("paper_world", ["platoon.gap_m=0.6", "platoon.2.leader.speed_mps=0.2", "run.laps=3"])
    assert {p.gap_m for p in world.spec.platoon} == {0.6}
    assert [world.laws[i, "leader"].speed for i in (1, 2, 3)] == [0.1, 0.2, 0.1]
    assert world.spec.run.laps == 3


@pytest.mark.parametrize("name", shipped.scenarios())
def test_shipped_scenarios_are_sound_and_have_a_title(name):
    loaded = scenario.load(name)
    assert loaded.spec.title
    simulation.prepare(loaded)


def test_a_replay_of_platoons_without_followers_can_be_recorded():
    world = scenario.load("paper_world")
    assert [platoon.follower is None for platoon in world.spec.platoon].count(True) == 5
    assert world.for_replay().spec.record.scans_every_s == 0.5  # ten lasers for ten minutes


def test_faults_of_gains_and_of_the_lidar_are_reported_together(scenario_file):
    old, new = 'law = "repaired"', 'law = "repaired"\nstand_of_m = 1.0\nheading_gain_per_s = "fast"'
    file = scenario_file((old, new), ('lidar = "paper-follower"', "lidar = { rate_hz = 30.0 }"))
    assert [fault.partition(": ")[2].partition(":")[0] for fault in faults(file)] == [
        "platoon.0.follower.heading_gain_per_s", "platoon.0.follower.stand_of_m",
        "platoon.0.follower.lidar.rate_hz",
    ]  # fmt: skip


def test_keys_in_every_form_of_toml_have_their_line():
    text = '''a = 1
b.c = [
  1, # ]
  2,
]
[t.u]
"d e" = """
[not.a.table]
x = 1
"""
[[p]]
q = { r = 1 }
[[p]]
[p.s]
v = 1
'''
    assert key_lines(text) == {
        ("a",): 1, ("b", "c"): 2, ("t", "u"): 6, ("t", "u", "d e"): 7,
        ("p",): 11, ("p", 0): 11, ("p", 0, "q"): 12, ("p", 1): 13, ("p", 1, "s"): 14, ("p", 1, "s", "v"): 15,
    }  # fmt: skip


def test_keys_after_values_of_many_lines_have_their_lines():
    text = "a = [" + "[1, 2],\n" * 20_000 + ']\nb = \'\'\'\n] x = 1\n\'\'\'\nc = """\\"""" # [\nd = 1\n'
    assert key_lines(text) == {("a",): 1, ("b",): 20_002, ("c",): 20_005, ("d",): 20_006}


@pytest.mark.parametrize(("given", "number"), [(".2", 0.2), ("5.", 5.0), ("+3", 3.0), (".5e1", 5.0), ("1_0", 10.0)])
def test_numbers_on_the_command_line_may_be_written_as_elsewhere(given, number):
    assert scenario.load("paper_loop", [f"platoon.gap_m={given}"]).spec.platoon[0].gap_m == number


def test_a_text_that_looks_like_a_number_stays_one():
    assert scenario.load("paper_loop", ["title=.2"]).spec.title == ".2"


@pytest.mark.parametrize(("given", "kept"), [("sw_se", ["sw_se"]), ("sw_se,se_ne", ["sw_se", "se_ne"]), ("7", ["7"])])
def test_names_can_be_listed_without_brackets(given, kept):
    assert scenario.load("paper_loop", [f"platoon.route={given}"]).spec.platoon[0].route == kept
    assert Sumo(net="lab_loop", routes=given, additional=given).routes == kept
    assert Manoeuvre(kind="leave", vehicle="robot.1", time_s=1.0, route=given).route == kept


def test_vehicles_can_be_listed_without_brackets(scenario_file):
    file = scenario_file(("size = 5\n", ""))
    (platoon,) = scenario.load(file, ["platoon.vehicles=paper-robot,paper-robot"]).spec.platoon
    assert [platoon.size, *(vehicle.type for vehicle in platoon.vehicles)] == [2, "paper-robot", "paper-robot"]


@pytest.mark.parametrize(("given", "kept"), [("trips", ["trips"]), ("trips,edges", ["trips", "edges"]), ("[]", [])])
def test_sumo_tables_can_be_listed_without_brackets(given, kept):
    assert scenario.load("paper_loop", [f"record.sumo={given}"]).spec.record.sumo == kept


def test_a_law_that_needs_an_unknown_input_is_a_fault(scenario_file, tmp_path):
    law = '@dataclass(frozen=True)\nclass Law:\n    needs = {"v2v"}\n    def __call__(self, sensed, memory, dt): ...\n'
    (tmp_path / "law.py").write_text("from dataclasses import dataclass\n" + law)
    (fault,) = faults(scenario_file(('law = "repaired"', 'law = "law:Law"')))
    assert fault.endswith("Law needs v2v; there is: leader, leads, members, messages, route, signals, truth")


def test_a_file_on_another_drive_has_its_whole_path(monkeypatch):
    """On Windows no path leads from one drive to another: runs with results there failed."""

    def other_drive(*_):
        raise ValueError("path is on mount 'C:', start on mount 'D:'")

    assert relative_to(Path("/a/b/net.xml"), Path("/a/c")) == "../b/net.xml"
    monkeypatch.setattr("os.path.relpath", other_drive)
    assert relative_to(Path("/a/b/net.xml"), Path("/a/c")) == "/a/b/net.xml"
