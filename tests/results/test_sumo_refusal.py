"""SUMO's refusals name the file that is meant, and folders with odd names are no fault."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

from platoontraffic import shipped
from platoontraffic.cli.main import app

CORRIDOR = shipped.networks()["corridor"]


def written(folder: Path, **sumo: object) -> Path:
    table = tomllib.loads(shipped.scenarios()["corridor_platoon"].read_text(encoding="utf-8"))
    table["sumo"] = {"net": "corridor", "traffic": False} | sumo
    (folder / "mine.toml").write_text(tomli_w.dumps(table))
    return folder / "mine.toml"


def refused(file: Path, folder: Path) -> str:
    done = CliRunner().invoke(app, ["run", str(file), "run.duration_s=1", "-q", "--out", str(folder / "out")])
    assert done.exit_code == 2, done.output
    (line,) = done.stderr.splitlines()
    return line


@pytest.mark.sumo
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.rou.xml", '<routes><flow id="east" type="no" from="west_light" to="light_prio" number="1"/></routes>'),
        ("a.rou.xml", '<routes><vType id="t" carFollowModel="no"/></routes>'),
        ("a.add.xml", '<additional><busStop id="b" lane="nowhere_0" startPos="0" endPos="9"/></additional>'),
        ("a.add.xml", '<additional><busStop id="b" lane="west_light_0" startPos="9" endPos="0"/></additional>'),
    ],
)
def test_the_file_that_is_wrong_is_named(name: str, text: str, tmp_path: Path):
    (tmp_path / name).write_text(text)
    (tmp_path / "b.rou.xml").write_text('<routes><vType id="fine"/></routes>')
    keys = {"routes": ["b.rou.xml"], "additional": []}
    keys["routes" if ".rou." in name else "additional"] = [*keys["routes" if ".rou." in name else "additional"], name]
    assert refused(written(tmp_path, **keys), tmp_path).startswith(f"{tmp_path / name}: SUMO refuses it: ")


@pytest.mark.sumo
def test_an_option_is_not_said_of_the_network(tmp_path: Path):
    (tmp_path / "c.sumocfg").write_text(
        f'<configuration><net-file value="{CORRIDOR}"/><lanechange.duration value="x"/></configuration>'
    )
    table = tomllib.loads(written(tmp_path).read_text())
    table["sumo"] = {"config": "c.sumocfg"}
    (tmp_path / "mine.toml").write_text(tomli_w.dumps(table))
    line = refused(tmp_path / "mine.toml", tmp_path)
    assert line.startswith(f"SUMO refuses the scenario (net {CORRIDOR} with configuration {tmp_path / 'c.sumocfg'}): ")


@pytest.mark.sumo
@pytest.mark.parametrize("name", ["e:8080", "10:30:00", "a${HOME}b", "a,b"])
def test_folders_that_sumo_takes_for_something_else(name: str, tmp_path: Path):
    changes = ["run.duration_s=1", "record.sumo=trips,summary,edges", "-q", "--out", str(tmp_path / name)]
    done = CliRunner().invoke(app, ["run", "corridor_platoon", *changes])
    assert done.exit_code == 0, done.output
    (folder,) = (tmp_path / name / "corridor_platoon").iterdir()
    tables = [folder / f"sumo_{table}.csv" for table in ("trips", "summary", "edges")]
    assert all(table.read_text().count("\n") > 1 or "edges" in table.name for table in tables)
    assert [file.name for file in tmp_path.iterdir()] == [name]
