"""Runs beside each other: what differs is said, and nothing else."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from platoontraffic.analysis.comparison import cells, compared, difference
from platoontraffic.analysis.results import load_run
from platoontraffic.cli.main import app
from tests.support.runs import forget_sizes, run

pytestmark = pytest.mark.sumo

SHORT = ("run.duration_s=6", "platoon.size=3")
AT = ("branch.at_s=3", "branch.then.platoon.follower.time_headway_s=2")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A run, the same with a branch, and the first one again."""
    folder = tmp_path_factory.mktemp("runs")
    changes = {"alone": (), "branch": AT, "again": ()}
    return [run(folder / name, "corridor_tracking", *SHORT, *more) for name, more in changes.items()]


def test_differences_are_those_of_the_metrics(folders: list[Path]) -> None:
    alone, branch = (
        load_run(folder).metrics.set_index(["scope", "vehicle_id", "metric"]).value for folder in folders[:2]
    )
    table = compared(folders)
    assert len(table) > 5
    for row in table.itertuples():
        key = row.scope, row.vehicle_id, row.metric
        assert pd.isna(row.value) or row.value == alone[key]
        assert pd.isna(row.difference_1) or row.difference_1 == pytest.approx(branch[key] - alone[key])
        assert pd.isna(row.difference_2) or row.difference_2 == 0
    assert compared([folders[0], folders[2]]).empty
    equal = [key for key in alone.index if alone[key] == branch[key]]
    assert not set(equal) & set(zip(table.scope, table.vehicle_id, table.metric, strict=True))


def test_a_metric_that_one_run_has_alone_is_shown(folders: list[Path], tmp_path: Path) -> None:
    """It was left out, though the page says that only equal ones are; and a value that is gone looked equal."""
    changed = tmp_path / "changed"
    shutil.copytree(folders[2], changed)
    table = pd.read_csv(changed / "metrics.csv")
    first = table.index[table.scope == "run"]
    empty, full = (first[table.value[first].isna() == one][0] for one in (True, False))
    table.loc[empty, "value"], table.loc[full, "value"] = 6.5, float("nan")
    table.to_csv(changed / "metrics.csv", index=False)
    forget_sizes(changed)
    rows = {row.metric: cells(row) for row in compared([folders[0], changed], "run").itertuples()}
    assert rows[table.metric[empty]] == ["= 6.5", "none"]
    assert rows[table.metric[full]][0] == "none"
    assert len(rows) == 2


def test_nothing_differs_before_the_branch(folders: list[Path]) -> None:
    first, other = (load_run(folder).trajectories for folder in folders[:2])
    rows = difference(first, other, "speed_mps")
    assert len(rows) == len(first)
    assert (rows.speed_mps[rows.time_s <= 3] == 0).all()
    assert (rows.speed_mps[rows.time_s > 3] != 0).any()


def test_report_of_several_runs(folders: list[Path], tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["report", *map(str, folders[:2]), "--to", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.stderr
    page = (tmp_path / "page.html").read_text()
    assert "from 3 s platoon.follower.time_headway_s = 2" in page
    assert "without a branch" in page
    assert (tmp_path / "page-differences.png").is_file()
    done = CliRunner().invoke(app, ["report", *map(str, folders[:2]), "--metric", "gap_mean"])
    assert done.exit_code == 2


def test_runs_with_one_branch_are_told_apart_by_their_folders(folders: list[Path], tmp_path: Path) -> None:
    """As those of a scenario whose file has a branch."""
    copies = [Path(shutil.copytree(folders[1], tmp_path / name)) for name in ("a", "b")]
    done = CliRunner().invoke(app, ["report", *map(str, copies), "--to", str(tmp_path / "page.html")])
    assert done.exit_code == 0, done.stderr
    page = (tmp_path / "page.html").read_text()
    for name in ("a", "b"):
        assert f"from 3 s platoon.follower.time_headway_s = 2, {name}<" in page
