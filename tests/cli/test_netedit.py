"""A network saved by netedit: `nets/lights.net.xml` with two roads drawn by hand (E0, E1), and changes of it.

netedit saves through netconvert, so a change in its plain files leaves the network that netedit would save.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic import scenario, simulation
from platoontraffic.cli import net_findings, net_sources
from platoontraffic.cli.net_content import read
from platoontraffic.cli.net_sources import differences, run_program
from platoontraffic.cli.nets import nets_app
from platoontraffic.prove.alone import drives
from platoontraffic.recording import run as run_into
from platoontraffic.road.network import Network
from platoontraffic.sumo.programs import program
from tests.support import ODD_NETS

NETS = ODD_NETS
SAVED = NETS / "netedit_saved.net.xml"
BEFORE = NETS / "lights.net.xml"
ROUTE = ("E0", "E1", "north_in", "south_out")  # along the drawn roads and through the traffic light

RUN = """
[sumo]
net = "{net}"

[scene]
walls = "none"

[run]
step_s = 0.1
duration_s = {duration}

[[platoon]]
id = "laser"
size = {size}
gap_m = 10.0
start = {{ edge = "E0", position_m = 60.0 }}
route = [{route}]
vehicle = {{ type = "car" }}

[platoon.leader]
law = "path"
speed_mps = 8.0
catch_up_m = 8.0
half_width_m = 1.2
lidar = {{ preset = "car-leader", rate_hz = 10.0 }}

[platoon.follower]
law = "repaired"
stand_off_m = 4.0
group_step_m = 1.0
lidar = {{ preset = "car-follower", noise = "none", rate_hz = 10.0 }}
"""


@pytest.fixture
def imported(tmp_path) -> Path:
    """The folder of the network's plain sources."""
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    done = CliRunner().invoke(nets_app, ["import", str(SAVED), str(tmp_path / "sources")])
    assert (done.exit_code, done.stderr) == (0, "")
    return tmp_path / "sources"


def body(net: Path) -> str:
    """The file without its header, which has the date and the options of the program that wrote it."""
    return net.read_text(encoding="utf-8").partition("<net ")[2]


def test_the_file_is_written_by_netedit_and_has_the_drawn_roads():
    assert "by Eclipse SUMO netedit 1.28" in SAVED.read_text(encoding="utf-8")[:200]
    saved, before = read(SAVED), read(BEFORE)
    assert saved.roads().keys() - before.roads().keys() == {"E0", "E1"}
    assert (saved.roads()["E0"].start, saved.roads()["E1"].end) == ("east", "north")
    assert saved.lights == before.lights
    found = net_findings.findings(SAVED)
    assert (found.faults, found.kinds) == ((), ())


def test_the_imported_sources_build_the_same_bytes(imported):
    kinds = [file.name.removeprefix("netedit_saved.") for file in sorted(imported.iterdir())]
    assert kinds == ["con.xml", "edg.xml", "netccfg", "nod.xml", "tll.xml"]
    assert all("generated on" not in file.read_text(encoding="utf-8") for file in imported.iterdir())
    built = net_sources.build(imported / "netedit_saved.netccfg")
    assert list(differences(read(SAVED), read(built))) == []
    assert body(built) == body(SAVED)


def test_sources_imported_from_what_they_build_are_the_same_bytes(imported, tmp_path):
    built = net_sources.build(imported / "netedit_saved.netccfg")
    net_sources.import_net(built, tmp_path / "again")
    built.unlink()
    before, after = ({f.name: f.read_bytes() for f in d.iterdir()} for d in (imported, tmp_path / "again"))
    assert after == before


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("size", "duration", "edge"),
    [(3, 12.0, "E0"), (1, 70.0, "E1")],
    ids=["a platoon on a drawn road", "round its bend"],
)
def test_a_platoon_drives_on_the_drawn_roads(tmp_path, size, duration, edge):
    shutil.copy(SAVED, tmp_path)
    file = tmp_path / "drawn.toml"
    route = ", ".join(f'"{edge}"' for edge in ROUTE)
    file.write_text(RUN.format(net=SAVED.name, route=route, size=size, duration=duration), encoding="utf-8")
    folder = run_into(simulation.prepare(scenario.load(file)), tmp_path / "results")
    rows = pd.read_csv(folder / "trajectories.csv")
    last = rows[rows.time_s == rows.time_s.max()]
    assert list(last.edge_id) == [edge] * size
    assert (last.speed_mps > 4).all()
    assert pd.read_csv(folder / "events.csv").query("kind in ('collision', 'lock_lost')").empty


# ---- a lane, a stop sign and a bend

LANE = ('<edge id="E1" from="J0" to="north" priority="-1" numLanes="1"', 'numLanes="1"', 'numLanes="2"')
BEND = ('<edge id="E0"', 'speed="13.89"/>', 'speed="13.89" shape="1000,0 985,60 925,140 915.37,197.51"/>')
STOP = ('<node id="north"', 'type="priority"', 'type="allway_stop"')
JOINED = '<connection from="E1" to="north_in" fromLane="0" toLane="0"/>'
BOTH = f"{JOINED}\n{JOINED.replace(chr(34) + '0' + chr(34), chr(34) + '1' + chr(34), 1)}"

DRIVE = """
[sumo]
net = "changed.net.xml"

[scene]
walls = "none"

[run]
duration_s = 300.0

[[platoon]]
size = 3
vehicle = "car"
start = { edge = "E0", position_m = 40.0 }
to = "south_out"
"""


def changed(folder: Path, connections: str = BOTH) -> Path:
    """The network saved with another lane on E1, a stop sign at its end, and another bend in E0."""
    netconvert = program("netconvert")
    plain = folder / "plain"
    run_program(netconvert, "-s", SAVED, "--plain-output-prefix", plain, "--precision", "2")
    for kind, changes in (("edg", (LANE, BEND)), ("nod", (STOP,)), ("con", ((JOINED, JOINED, connections),))):
        file = Path(f"{plain}.{kind}.xml")
        lines = file.read_text(encoding="utf-8").splitlines()
        for begin, old, new in changes:
            (i,) = (i for i, line in enumerate(lines) if line.strip().startswith(begin))
            assert old in lines[i]
            lines[i] = lines[i].replace(old, new)
        file.write_text("\n".join(lines), encoding="utf-8")
    files = [word for flag, kind in zip("nexi", ("nod", "edg", "con", "tll"), strict=True)
             for word in (f"-{flag}", f"{plain}.{kind}.xml")]  # fmt: skip
    net = folder / "changed.net.xml"
    done = run_program(netconvert, *files, "--offset.disable-normalization", "--precision", "2", "-o", net)
    assert done.returncode == 0, done.stderr
    return net


@pytest.fixture
def netconvert():
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")


def test_a_lane_a_stop_sign_and_a_bend_are_imported_and_built_again(netconvert, tmp_path):
    net = changed(tmp_path)
    before, after = read(SAVED), read(net)
    assert [len(content.roads()["E1"].lanes) for content in (before, after)] == [1, 2]
    assert [len(content.roads()["E0"].lanes[0].shape) for content in (before, after)] == [2, 4]
    states = {link.rules[1] for link in after.links if link.source[0] == "E1" and link.target[0] == "north_in"}
    assert states == {"w"}  # SUMO's letter of an all-way stop
    folder = tmp_path / "sources"
    net_sources.import_net(net, folder)
    assert list(differences(after, read(net_sources.build(folder / "changed.netccfg")))) == []


def test_the_check_tells_a_finished_change_from_a_forgotten_connection(netconvert, tmp_path):
    assert net_findings.findings(changed(tmp_path)).kinds == ()
    (kind,) = net_findings.findings(changed(tmp_path, JOINED)).kinds
    assert (kind.name, len(kind.places)) == ("lane ends", 1)
    assert kind.places[0].text.startswith("'E1_1' at ")


def test_random_routes_over_the_changes_keep_to_their_lanes(netconvert, tmp_path):
    """As `prove` drives them."""
    found = drives(Network.read(changed(tmp_path)), 12, 1, "car")
    assert {"E0", "E1"} & {edge for one in found for edge in (one.start, one.end)}
    assert [one for one in found if not one.holds] == []


@pytest.mark.slow
@pytest.mark.sumo
def test_cars_drive_round_the_bend_and_over_the_stop_line(netconvert, tmp_path):
    changed(tmp_path)
    file = tmp_path / "drive.toml"
    file.write_text(DRIVE, encoding="utf-8")
    folder = run_into(simulation.prepare(scenario.load(file)), tmp_path / "results")
    events = pd.read_csv(folder / "events.csv")
    assert list(events.vehicle_id[events.kind == "arrived"]) == ["platoon.0", "platoon.1", "platoon.2"]
    assert not events.kind.isin(["collision", "off_road", "red_light", "failed_to_yield"]).any()
    rows = pd.read_csv(folder / "trajectories.csv")
    for name in ("platoon.0", "platoon.1", "platoon.2"):
        on_it = rows[(rows.vehicle_id == name) & (rows.edge_id == "E1")]
        assert on_it.speed_mps.min() < 2.0  # slow before the stop line
