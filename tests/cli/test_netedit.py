"""A network saved by netedit: `nets/lights.net.xml` with two roads drawn by hand (E0, E1)."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic import scenario, simulation
from platoontraffic.cli import net_findings, net_sources
from platoontraffic.cli.net_content import read
from platoontraffic.cli.net_sources import differences
from platoontraffic.cli.nets import nets_app
from platoontraffic.run import run as run_into
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
lookahead_m = 8.0
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
