"""A network as netedit left it: `nets/lights.net.xml`, to which two roads were drawn by hand (E0, E1), and saved."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic import scenario, simulation
from platoontraffic.cli import nets
from platoontraffic.cli.nets import differences, nets_app, read
from platoontraffic.run import run as run_into
from tests.support import ODD_NETS

NETS = ODD_NETS
SAVED = NETS / "netedit_saved.net.xml"
BEFORE = NETS / "lights.net.xml"
WAY = ("E0", "E1", "north_in", "south_out")  # along what was drawn, and through the light

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
route = [{way}]
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
    """The folder of its plain sources."""
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    done = CliRunner().invoke(nets_app, ["import", str(SAVED), str(tmp_path / "sources")])
    assert (done.exit_code, done.stderr) == (0, "")
    return tmp_path / "sources"


def body(net: Path) -> str:
    """What follows the header, which has the date and the options of the program that wrote it."""
    return net.read_text(encoding="utf-8").partition("<net ")[2]


def test_it_is_netedits_own_file_and_has_what_was_drawn():
    assert "by Eclipse SUMO netedit 1.28" in SAVED.read_text(encoding="utf-8")[:200]
    saved, before = read(SAVED), read(BEFORE)
    assert saved.roads().keys() - before.roads().keys() == {"E0", "E1"}
    assert (saved.roads()["E0"].start, saved.roads()["E1"].end) == ("east", "north")
    assert saved.lights == before.lights
    assert nets.findings(SAVED) == nets.Findings()


def test_its_sources_are_plain_and_build_it_to_the_byte(imported):
    kinds = [file.name.removeprefix("netedit_saved.") for file in sorted(imported.iterdir())]
    assert kinds == ["con.xml", "edg.xml", "netccfg", "nod.xml", "tll.xml"]
    assert all("generated on" not in file.read_text(encoding="utf-8") for file in imported.iterdir())
    built = nets.build(imported / "netedit_saved.netccfg")
    assert list(differences(read(SAVED), read(built))) == []
    assert body(built) == body(SAVED)


def test_sources_come_back_from_what_they_build_to_the_byte(imported, tmp_path):
    built = nets.build(imported / "netedit_saved.netccfg")
    nets.import_net(built, tmp_path / "again")
    built.unlink()
    before, after = ({f.name: f.read_bytes() for f in d.iterdir()} for d in (imported, tmp_path / "again"))
    assert after == before


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("size", "duration", "edge"),
    [(3, 12.0, "E0"), (1, 70.0, "E1")],
    ids=["a platoon on a drawn road", "round its bend"],
)
def test_it_is_driven_on(tmp_path, size, duration, edge):
    shutil.copy(SAVED, tmp_path)
    file = tmp_path / "drawn.toml"
    way = ", ".join(f'"{edge}"' for edge in WAY)
    file.write_text(RUN.format(net=SAVED.name, way=way, size=size, duration=duration), encoding="utf-8")
    folder = run_into(simulation.prepare(scenario.load(file)), tmp_path / "results")
    rows = pd.read_csv(folder / "trajectories.csv")
    last = rows[rows.time_s == rows.time_s.max()]
    assert list(last.edge_id) == [edge] * size
    assert (last.speed_mps > 4).all()
    assert pd.read_csv(folder / "events.csv").query("kind in ('collision', 'lock_lost')").empty
