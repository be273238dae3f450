"""`platoontraffic nets`: reports on sound and broken networks, and sources made from networks."""

from __future__ import annotations

import gzip
import math
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from platoontraffic import shipped
from platoontraffic.cli import net_findings, net_sources, nets
from platoontraffic.cli.net_content import read
from platoontraffic.cli.net_sources import differences
from platoontraffic.cli.nets import nets_app
from platoontraffic.errors import InputError
from platoontraffic.road.network import Network

RING = shipped.networks()["ring"]
LAB = shipped.networks()["lab_loop"]
TWICE = r'(<edge id="east_north".*?</edge>)'  # to be written twice

CROSS = """<nodes><node id="w" x="0" y="0"/><node id="c" x="200" y="0"/><node id="e" x="400" y="0"/>
<node id="s" x="200" y="-200"/></nodes>"""
ROADS = """<edges>
<edge id="in" from="w" to="c" numLanes="2" speed="13.89"/><edge id="out" from="c" to="e" numLanes="2" speed="13.89"/>
<edge id="side" from="s" to="c" numLanes="1" speed="13.89"/></edges>"""


NOWHERE = "note: road that leads nowhere, though others lead on from its junction:"
ENDS = "note: lane that ends, though other lanes of its road go on:"
NARROW = "note: lane narrower than a car (1.76 m):"
BUS_LANE = '<lane index="1" allow="bus"/>'
OTHERS = "note: 1 lane is for others:"


def call(*arguments: object) -> Result:
    return CliRunner().invoke(nets_app, [str(a) for a in arguments])


@pytest.fixture
def netconvert():
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")


@pytest.fixture
def made(netconvert, tmp_path):
    """A function that writes plain sources and builds the network, with further options of netconvert."""

    def make(*changes: tuple[str, str], connections: str = "", **options: str) -> Path:
        roads = ROADS
        for old, new in changes:
            assert old in roads
            roads = roads.replace(old, new)
        written = {"nod": CROSS, "edg": roads, "con": f"<connections>{connections}</connections>"}
        for kind, text in written.items():
            (tmp_path / f"cross.{kind}.xml").write_text(text)
        more = "".join(f'<{key.replace("_", "-")} value="{value}"/>' for key, value in options.items())
        (tmp_path / "cross.netccfg").write_text(
            '<netconvertConfiguration><input><node-files value="cross.nod.xml"/><edge-files value="cross.edg.xml"/>'
            '<connection-files value="cross.con.xml"/></input><output><output-file value="cross.net.xml"/></output>'
            f"<processing>{more}</processing></netconvertConfiguration>"
        )
        return net_sources.build(tmp_path / "cross.netccfg")

    return make


def test_list_describes_every_shipped_network():
    lines = call("list").stdout.splitlines()
    assert [line.split()[0] for line in lines] == sorted(shipped.networks())
    grid = next(line for line in lines if line.startswith("grid"))
    assert "five by five blocks" in grid
    assert "1 to 2 lanes of 3.2 m per direction" in grid
    assert "20 junctions with lights" in grid


def test_road_is_counted_once_for_both_directions():
    assert "34 m of road" in nets.described(shipped.networks()["lab_world"])
    assert "999 m of road" in nets.described(RING)  # the ring has one direction only


@pytest.mark.parametrize("name", ["ring", "highway", "corridor", "grid", "bends"])
def test_shipped_road_networks_have_no_findings(name):
    done = call("check", name)
    assert (done.exit_code, done.stdout) == (0, f"{shipped.networks()[name]}: fine\n")


def test_a_network_for_robots_is_narrow_but_no_fault():
    done = call("check", "lab_loop", "ring")
    first, second = done.stdout.splitlines()
    assert done.exit_code == 0
    assert "note: narrow: no lane is wider than 1 m" in first
    assert second.endswith("fine")


@pytest.mark.slow
def test_a_network_imported_and_built_again_is_the_same(netconvert, tmp_path):
    """Round trip: lanes, connections, junctions and lights are equal, shapes within 1 cm."""
    for name, net in shipped.networks().items():
        done = call("import", net, tmp_path / name)
        written = [Path(line) for line in done.stdout.splitlines()]
        assert (done.exit_code, done.stderr) == (0, "")
        assert written[-1] == tmp_path / name / f"{name}.netccfg"
        assert all("generated on" not in file.read_text() and str(tmp_path) not in file.read_text() for file in written)
        assert call("build", written[-1]).exit_code == 0
        assert list(differences(read(net), read(tmp_path / name / f"{name}.net.xml"))) == []


def test_a_gzipped_network_can_be_imported(netconvert, tmp_path):
    zipped = tmp_path / "town.net.xml.gz"
    zipped.write_bytes(gzip.compress(RING.read_bytes()))
    assert call("check", zipped).stdout == f"{zipped}: fine\n"
    assert call("import", zipped, tmp_path).exit_code == 0
    assert list(differences(read(RING), read(net_sources.build(tmp_path / "town.netccfg")))) == []


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('speed="13.89"', 'speed="10"', "edge 'east_north' differs"),
        ("160.75,0.15", "160.79,0.15", "edge 'east_north' differs"),
        ('fromLane="1" toLane="1"', 'fromLane="1" toLane="0"', "connection 'south_east_1 to east_north_1' is missing"),
    ],
)
def test_differences_between_networks_are_named(tmp_path, old, new, said):
    text = RING.read_text()
    assert old in text
    other = tmp_path / "other.net.xml"
    other.write_text(text.replace(old, new))
    assert said in list(differences(read(RING), read(other)))


def test_import_keeps_existing_files_unless_forced(netconvert, tmp_path):
    mine = tmp_path / "ring.nod.xml"
    mine.write_text("mine")
    kept = call("import", "ring", tmp_path)
    assert (kept.exit_code, mine.read_text(), list(tmp_path.iterdir())) == (2, "mine", [mine])
    assert kept.stderr == f"{mine}: exists and is kept; --force replaces it\n"
    assert call("import", "ring", tmp_path, "--force").exit_code == 0
    assert "<nodes" in mine.read_text()


def test_sources_that_would_build_a_different_network_are_not_written(netconvert, tmp_path, monkeypatch):
    monkeypatch.setattr(net_sources, "differences", lambda one, other: iter(["lane 'a_0' differs"]))
    done = call("import", "ring", tmp_path / "sources")
    assert done.exit_code == 2
    assert "its sources would build a different network: lane 'a_0' differs" in done.stderr
    assert not (tmp_path / "sources").exists()


def test_a_failed_build_keeps_the_old_network(made, tmp_path):
    net = made()
    before = net.read_bytes()
    (tmp_path / "cross.edg.xml").write_text(ROADS.replace('to="e"', 'to="nowhere"'))
    done = call("build", tmp_path / "cross.netccfg")
    assert done.exit_code == 2
    assert "cross.netccfg: netconvert: " in done.stderr
    assert net.read_bytes() == before
    assert sorted(f.name.split(".")[1] for f in tmp_path.iterdir()) == ["con", "edg", "net", "netccfg", "nod"]


def test_build_writes_to_the_given_file(made, tmp_path):
    net = made()
    done = call("build", tmp_path / "cross.netccfg", "-o", tmp_path / "other.net.xml")
    assert done.stdout == f"{tmp_path / 'other.net.xml'}\n"
    assert (tmp_path / "other.net.xml").read_bytes() == net.read_bytes()


@pytest.mark.parametrize(
    ("changes", "connections", "options", "said"),
    [
        ([], "", {}, "fine"),
        ([], "", {"no_internal_links": "true"}, "note: no lanes inside junctions"),
        ([], "", {"lefthand": "true"}, "note: left-hand traffic"),
        ([], '<connection from="side"/>', {}, f"{NOWHERE} 'side' before junction 'c' at"),
        ([], '<connection from="in" to="out" fromLane="0" toLane="0"/>', {}, f"{ENDS} 'in_1' at"),
        (
            [("</edges>", '<edge id="far" from="c" to="s"/></edges>')],
            '<connection from="in" to="out" fromLane="0" toLane="0"/><connection from="side"/>',
            {},
            "note: road that cannot be reached, though others lead to its junction: 'far' behind junction 'c' at",
        ),
        (  # only its bus lane goes on
            [('"s" to="c" numLanes="1" speed="13.89"/>', f'"s" to="c" numLanes="2" speed="13.89">{BUS_LANE}</edge>')],
            '<connection from="side" to="out" fromLane="1" toLane="1"/>',
            {},
            f"{NOWHERE} 'side' before junction 'c' at",
        ),
        ([('id="side"', 'id="side" width="1.7"')], "", {}, f"{NARROW} 'side_0', 1.7 m at"),
        ([('id="side"', 'id="side" allow="tram"')], "", {}, f"{OTHERS} rails 1, no part"),
        ([('id="side"', 'id="side" allow="pedestrian"')], "", {}, f"{OTHERS} pedestrian 1, no part"),
        ([('id="side"', 'id="side" allow="bus"')], "", {}, f"{OTHERS} bus 1, part of the road"),
    ],
)  # fmt: skip
def test_oddities_of_a_network_that_runs_are_notes(made, changes, connections, options, said):
    net = made(*changes, connections=connections, **options)
    done = call("check", net)
    assert done.exit_code == 0
    assert f"{net}: {said}" in done.stdout


@pytest.mark.parametrize(
    ("users", "said"), [("tram", "no lane for cars: all are for rails only"), ("pedestrian", "for pedestrian only")]
)
def test_a_network_without_lanes_for_cars_is_a_fault(made, users, said):
    done = call("check", made(('numLanes="', f'allow="{users}" numLanes="')))
    assert done.exit_code == 2
    assert said in done.stderr


def test_a_kind_is_one_line_with_its_worst_places_and_all_of_them_on_request(made):
    net = made(
        ('id="out" from="c" to="e" numLanes="2"', 'id="out" from="c" to="e" numLanes="9" width="1.7"'),
        ('id="in"', 'id="in" width="1.5"'),
    )
    (line,) = (line for line in call("check", net).stdout.splitlines() if "narrower" in line)
    assert line.startswith(f"{net}: note: 11 lanes narrower than a car (1.76 m): 'in_0', 1.5 m at (98, ")
    assert line.endswith("; and 8 more")
    every = call("check", net, "--all").stdout.splitlines()
    first = next(i for i, line in enumerate(every) if "narrower" in line)
    assert [line.split()[0] for line in every[first + 1 : first + 3]] == ["'in_0',", "'in_1',"]
    assert sum(line.startswith("    '") and "1.7 m" in line for line in every) == 9


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ("0,0 100,0 100,3 200,3", "90° to the"),  # a step aside
        ("0,0 100,0 110,4 120,0 200,0", None),  # a bend of 22 and 44 degrees, driven within the lane
    ],
)
def test_kinks_that_a_car_cannot_drive_are_named_with_place_and_angle(made, shape, said):
    net = made(('id="in"', f'id="in" shape="{shape}" spreadType="center"'))
    lines = [line for line in call("check", net, "--all").stdout.splitlines() if "lane 'in_0'" in line]
    if said is None:
        assert not lines
        return
    assert said in lines[0]
    x, y = map(float, re.search(r"at \((-?\d+), (-?\d+)\) m", lines[0]).groups())
    assert x == pytest.approx(100, abs=4)
    assert y == pytest.approx(200, abs=5)  # netconvert moves the network by 200 m
    # A corner of a right angle: R (sec 45° - 1) at least.
    offset = float(re.search(r"([\d.]+) m off the line", lines[0])[1])
    assert offset >= net_findings.CAR.turning_radius * (math.sqrt(2) - 1) - 0.1


def test_kinks_across_junctions_are_judged_with_the_lanes_before_and_after(made):
    """No line has a corner in itself: 45 degrees where it enters the junction, and 45 where it leaves, 1 m farther."""
    content = read(made())
    (link,) = (link for link in content.links if link.source == ("side", 0) and link.via)
    target, via = "_".join(map(str, link.target)), link.via
    lines = {"side_0": ((0, -50), (0, 0)), via: ((0, 0), (0.71, 0.71)), target: ((0.71, 0.71), (60, 0.71))}

    def drawn(lane):
        return lane._replace(shape=lines.get(lane.id, lane.shape))

    edges = {name: edge._replace(lanes=tuple(map(drawn, edge.lanes))) for name, edge in content.edges.items()}
    places = net_findings._kinks(content._replace(edges=edges)).places
    (kink,) = (place for place in places if "'side_0'" in place.text)
    assert kink.text.startswith(f"from 'side_0' to '{target}': 90° to the right within 1.0 m, ")
    assert (kink.x, kink.y) == pytest.approx((0.355, 0.355))
    # The arc of the turning radius R in place of one of 1 m / (pi / 2).
    radius = net_findings.CAR.turning_radius
    assert kink.badness == pytest.approx((radius - 1.004 / (math.pi / 2)) * (math.sqrt(2) - 1), abs=0.01)


def test_a_light_that_is_always_red_to_a_lane_closes_its_stop_line():
    net = shipped.networks()["corridor"]
    content = read(net)
    assert net_findings._closed(content).places == ()
    link = next(link for link in content.links if link.rules[2] and link.source[0] in content.roads())
    index = int(link.rules[3])
    red = {name: tuple((lasts, f"{state[:index]}r{state[index + 1:]}") for lasts, state in phases)
           for name, phases in content.lights.items()}  # fmt: skip
    (place,) = net_findings._closed(content._replace(lights=red)).places
    assert place.text.startswith(f"'{link.source[0]}_{link.source[1]}' to '{link.target[0]}', light '{link.rules[2]}'")


@pytest.mark.parametrize(("aside", "said"), [(1.0, True), (3.2, True), (3.5, False)])
def test_lanes_of_different_roads_on_the_same_ground_overlap(made, aside, said):
    """The upper lane of `in` is 1.6 m off its middle, so cars are 1.76 m wide at 3.36 m."""
    points = f"0,40 50,{aside} 150,{aside} 190,40 450,40 450,-200 200,-200"
    second = f'<edge id="twin" from="w" to="s" numLanes="1" speed="9" shape="{points}"'
    net = made(("</edges>", f'{second} spreadType="center"/></edges>'), ('id="in"', 'id="in" spreadType="center"'))
    found = [line for line in call("check", net).stdout.splitlines() if "cars side by side would touch" in line]
    assert bool(found) == said
    if said:
        assert "'twin_0'" in found[0]


def test_the_places_are_drawn(made, tmp_path):
    net = made(('id="side"', 'id="side" width="1.7"'))
    done = call("check", net, "--plot", tmp_path / "net.png")
    assert done.exit_code == 0
    assert (tmp_path / "net.png").read_bytes()[:4] == b"\x89PNG"
    assert done.stdout.splitlines()[-1] == str(tmp_path / "net.png")
    for arguments, what in (
        ([net, net, "--plot", "a.png"], "--plot: a.png: has room for one network"),
        ([net, "--plot", tmp_path / "net.nothing"], "net.nothing: cannot be written"),
    ):
        done = call("check", *arguments)
        assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
        assert what in done.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('from="east"', 'from="nowhere"', "goes from junction 'nowhere', which is missing"),
        ('from="east"', "", "does not name the junction from which it goes"),
        ('intLanes=":', 'intLanes=":x :', "names lane ':x', which is missing"),
        ('toLane="0"', 'toLane="7"', "_7', which is missing"),
    ],
)
def test_a_network_that_lacks_a_part_is_a_fault(tmp_path, old, new, said):
    text = RING.read_text()
    assert old in text
    net = tmp_path / "broken.net.xml"
    net.write_text(text.replace(old, new, 1))
    done = call("check", net)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr
    with pytest.raises(InputError):
        Network.read(net)


@pytest.mark.parametrize("command", ["check", "import"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: "", "the file is empty"),
        (lambda text: text[: len(text) // 2], "not whole XML"),
        (lambda text: text.replace("<net ", "<nodes ").replace("</net>", "</nodes>"), "a plain node file"),
        (lambda text: '<net version="1.20"/>', "the network has no road"),
        (lambda text: text.replace('width="3.20"', 'width="wide"'), "could not convert string to float"),
        (lambda text: re.sub(TWICE, r"\1\1", text, flags=re.DOTALL), "edge 'east_north' occurs more than once"),
    ],
)
def test_a_broken_file_is_one_line_and_exit_code_2(netconvert, tmp_path, command, change, said):
    net = tmp_path / "broken.net.xml"
    net.write_text(change(RING.read_text()))
    done = call(command, net, *([tmp_path / "sources"] if command == "import" else []))
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    for line in done.stderr.splitlines():
        assert line.count("broken.net.xml") == 1
        assert line.count("must be") <= 1
    assert not (tmp_path / "sources").exists()


def test_a_lane_without_extent_is_a_fault(tmp_path):
    net = tmp_path / "broken.net.xml"
    net.write_text(re.sub(r'(<lane id="east_north_0".*?shape=")[^"]*', r"\g<1>1.00,2.00 1.00,2.00", RING.read_text()))
    done = call("check", net)
    assert done.exit_code == 2
    assert "lane 'east_north_0' has no shape of two or more points" in done.stderr
    with pytest.raises(InputError, match="'east_north_0' has no shape"):
        Network.read(net)


def test_a_truncated_gzip_is_one_line_and_exit_code_2(tmp_path):
    net = tmp_path / "broken.net.xml.gz"
    net.write_bytes(gzip.compress(RING.read_bytes())[:500])
    done = call("check", net)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert f"{net}:" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["check", "rung"], "rung: no such file, nor a shipped network; did you mean 'ring'?"),
        (["check", "nowhere/ring.net.xml"], "nowhere/ring.net.xml: no such file, nor a shipped network"),
        (["check", "."], ".: is a folder"),
        (["import", "rung", "there"], "rung: no such file"),
        (["build", "nowhere.netccfg"], "nowhere.netccfg: no such file; must be a netconvert configuration"),
        (["build", RING], "root element is <net>; must be <netconvertConfiguration>"),
        (["build", RING.with_name("ring.netccfg"), "-o", "nowhere/ring.net.xml"], "no such folder: nowhere"),
        (["edit", "rung"], "rung: no such file, nor a shipped network; did you mean 'ring'?"),
        (["edit", RING.with_name("ring.netccfg")], "root element is <netconvertConfiguration>; must be one of"),
        (["edit", "town.net.xml.gz"], "town.net.xml.gz: is gzipped; unpack it first"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("town.net.xml.gz").write_bytes(gzip.compress(b"<net/>"))
    done = call(*arguments)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert said in done.stderr


@pytest.mark.parametrize(
    "arguments", [["edit", "ring"], ["build", RING.with_name("ring.netccfg")], ["import", "ring", "there"]]
)
def test_without_eclipse_sumo_the_message_names_what_to_install(arguments, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    done = call(*arguments)
    assert (done.exit_code, done.stderr.count("\n")) == (3, 1)
    assert "pip install platoontraffic[gui]" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_edit_without_a_display_is_exit_code_3(netconvert, monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    done = call("edit", "ring")
    assert (done.exit_code, done.stderr.count("\n")) == (3, 1)
    assert "needs a display" in done.stderr


@pytest.mark.skipif(shutil.which("Xvfb") is None, reason="needs a machine with an X server's library, as one with Xvfb")
def test_edit_with_an_unreachable_display_names_it(netconvert, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":987")
    done = call("edit", RING.with_name("ring.netecfg"))
    assert done.exit_code == 3
    assert "there is none at :987" in done.stderr


@pytest.mark.parametrize(
    ("name", "opened"),
    [
        ("ring", ["--netecfg-file", RING.with_name("ring.netecfg")]),
        (RING, ["--sumo-net-file", RING]),
        (RING.with_name("ring.sumocfg"), ["--sumocfg-file", RING.with_name("ring.sumocfg")]),
    ],
)
def test_edit_opens_shipped_names_networks_and_configurations(netconvert, monkeypatch, name, opened):
    calls = []
    monkeypatch.setenv("DISPLAY", ":0")
    done = subprocess.CompletedProcess([], 0, "", "")
    monkeypatch.setattr(
        net_sources, "run_program", lambda program, *arguments: calls.append([program.name, *arguments]) or done
    )
    assert call("edit", name).exit_code == 0
    assert calls == [["netedit", *opened]]
