"""Metrics that a scenario brings: `record.metrics`."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pytest

from platoontraffic import scenario, shipped, simulation
from platoontraffic.errors import InputError
from platoontraffic.recording import run as recorded
from platoontraffic.results import plug_in_metrics, provenance
from tests.results.test_metrics import events, trajectories
from tests.support import ROOT

EXAMPLE = ROOT / "docs" / "examples" / "time_headway_share.py"
NAME = f"{EXAMPLE.name}:TimeHeadwayShare"
SHORT = ("run.duration_s=1", "platoon.size=3")

FAILING = """
class Failing:
    name, unit, meaning = "failing", "", "nothing"

    def __call__(self, trajectories, events):
        return {}["no such vehicle"]
"""


@dataclass(frozen=True)
class Given:
    """Gives what it was made with."""

    values: object
    over: str = ""
    name: str = "given"
    unit: str = "m"
    meaning: str = "a number by member"

    def __call__(self, trajectories, events):
        return self.values


def rows(metric: Given) -> dict[tuple[str, str], float]:
    """Values by scope and vehicle or name."""
    found = plug_in_metrics.compute(metric, trajectories(gap_m=[1.0]), events((1.0, "end")))
    return {(one.scope, one.vehicle or one.name): one.value for one in found}


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder with a scenario and the example beside it."""
    shutil.copy(shipped.scenarios()["paper_loop"], tmp_path / "mine.toml")
    shutil.copy(EXAMPLE, tmp_path)
    return tmp_path


def test_platoons_and_the_run_have_a_metric_over_their_members():
    assert rows(Given({"p.0": 1.0, "p.1": 3.0}, "mean")) == {
        ("vehicle", "p.0"): 1, ("vehicle", "p.1"): 3, ("platoon", "given_mean"): 2, ("run", "given_mean"): 2,
    }  # fmt: skip


def test_without_over_a_metric_is_of_members_only_and_may_leave_some_out():
    assert rows(Given({"p.1": 3.0})) == {("vehicle", "p.1"): 3}


def test_a_value_that_is_missing_does_not_count_over_the_members():
    assert rows(Given({"p.0": math.nan, "p.1": 3.0}, "min"))["run", "given_min"] == 3


@pytest.mark.parametrize(
    ("values", "what"), [([1.0], "gave a list"), ({"x": 1.0}, "'x', no member"), ({"p.0": "far"}, "gave 'far' for p.0")]
)
def test_anything_but_numbers_by_member_is_a_fault_with_file_and_line(values, what):
    with pytest.raises(InputError, match=rf"test_plug_in_metrics.py:\d+: metric given .*{what}"):
        rows(Given(values))


@pytest.mark.parametrize("given", [Given({}, name="gap_mean"), Given({}, over="max", name="gap_error_rms")])
def test_a_metric_must_not_be_named_like_one_of_the_tool(given):
    with pytest.raises(InputError, match="is a metric of platoontraffic"):
        plug_in_metrics.check([given])


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("class Wrong:\n    name = 'wrong'\n    def __call__(self, t, e): ...", r"wrong.py:1: .*has no text 'unit'"),
        ("class Wrong: pass", "the class Wrong has no __call__; a metric must have one"),
        ("class Wrong:\n    name, unit, meaning = 'a b', '', ''\n    def __call__(self, t, e): ...", "must be of a-z"),
        (
            "class Wrong:\n    def __init__(self, x): ...\n    def __call__(self, t, e): ...",
            "cannot be made: TypeError",
        ),
    ],
)
def test_a_class_that_is_no_metric_is_a_fault_of_the_scenario(folder, code, what):
    (folder / "wrong.py").write_text(code)
    with pytest.raises(InputError, match=rf"argument 1: record.metrics.0: .*{what}"):
        scenario.load(folder / "mine.toml", ["record.metrics=['wrong.py:Wrong']"])


def test_the_file_of_a_metric_is_part_of_the_run_id(folder):
    def run_id() -> str:
        return provenance.run_id(scenario.load(folder / "mine.toml", [f"record.metrics={NAME}"]))

    before = run_id()
    assert run_id() == before != provenance.run_id(scenario.load(folder / "mine.toml"))
    (folder / EXAMPLE.name).write_text(EXAMPLE.read_text(encoding="utf-8") + "\n")
    assert run_id() != before


@pytest.mark.sumo
def test_the_example_has_rows_in_every_file_of_metrics(folder):
    checked = scenario.load(folder / "mine.toml", [f"record.metrics={NAME}", *SHORT])
    run = recorded(simulation.prepare(checked), folder / "run")
    metrics = pd.read_csv(run / "metrics.csv").query("metric.str.startswith('short_headway_share')")
    assert metrics.scope.tolist() == ["vehicle", "vehicle", "platoon", "run"]
    assert "short_headway_share_max" in pd.read_csv(run / "summary.csv")
    (described,) = (
        r for r in json.loads((run / "datapackage.json").read_text())["resources"] if r["name"] == "metrics"
    )
    assert "below 1 s" in described["metrics"]["vehicle"]["short_headway_share"]
    assert f"metric.0.{EXAMPLE.name}" in json.loads((run / "provenance.json").read_text())["input_sha256"]
    again = scenario.load(run / "config.toml")
    assert provenance.run_id(again) == provenance.run_id(checked)


@pytest.mark.sumo
def test_a_metric_that_fails_names_its_line_and_loses_no_table(folder):
    (folder / "failing.py").write_text(FAILING)
    checked = scenario.load(folder / "mine.toml", [f"record.metrics=failing.py:Failing,{NAME}", *SHORT])
    with pytest.raises(InputError, match=r"failing.py:6: metric failing failed: KeyError") as caught:
        recorded(simulation.prepare(checked), folder / "run")
    kept = folder / "run.unfinished"
    assert str(kept) in str(caught.value)
    assert {"gap_mean", "short_headway_share"} <= set(pd.read_csv(kept / "metrics.csv").metric)
    for name in ("trajectories.csv", "events.csv", "vehicles.csv", "summary.csv", "datapackage.json", "scene.geojson"):
        assert (kept / name).stat().st_size > 0, name
