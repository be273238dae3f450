"""Measured string stability against the theory."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from platoontraffic import scenario
from platoontraffic.cli.main import app
from platoontraffic.errors import InputError
from platoontraffic.string_stability import experiment, report, theory

EQUAL = ("platoon.vehicle.lag_s=0.5", "platoon.vehicle.brake_lag_s=0.5")
LINEAR = ("acc", "constant_spacing", "cacc_ploeg", "cacc_path", "consensus")


def swept(law: str, *changes: str) -> experiment.Swept:
    return experiment.sweep(scenario.load("string", [f"platoon.follower.law={law}", *EQUAL, *changes]))


def test_a_law_by_truth_is_its_theory_at_ten_frequencies():
    found = swept("acc", "platoon.follower.feed=truth", "platoon.size=2")
    assert len(found.frequency) == 10
    assert report.deviation(found) < 0.005
    assert np.angle(found.gain / found.theory) == pytest.approx(0.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("feed", ["truth", "messages", "radar"])
@pytest.mark.parametrize("law", LINEAR)
def test_every_linear_law_is_its_theory_within_two_percent(law, feed):
    channel = () if feed == "truth" else ("channel.latency_s=0.2",)
    found = swept(law, f"platoon.follower.feed={feed}", "platoon.size=4", *channel)
    assert report.deviation(found) < 0.02


@pytest.mark.slow
def test_idm_is_its_linearisation_for_small_disturbances_only():
    found = scenario.load(
        "string", ["platoon.follower.law=idm", "platoon.follower.feed=truth", "platoon.size=3", *EQUAL]
    )
    large, small = (experiment.sweep(found, size) for size in (experiment.SIZE, experiment.SIZE / 20))
    assert report.deviation(small) < 0.02 < report.deviation(large)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "more", "gain"),
    [("acc", (), "distance_gain_per_s=0.5"), ("cacc_ploeg", ("channel.latency_s=0.2",), "distance_gain_per_s2=0.2")],
)
def test_stability_turns_within_five_percent_of_the_predicted_headway(law, more, gain):
    feed = "messages" if more else "truth"

    def loaded(headway: float):
        keys = (f"law={law}", f"feed={feed}", gain, f"time_headway_s={headway}")
        return scenario.load("string", [*(f"platoon.follower.{key}" for key in keys), *EQUAL, *more, "platoon.size=2"])

    def peak(headway: float) -> float:
        found = loaded(headway)
        follower, vehicle = found.laws[0, "follower"], found.spec.platoon[0].model(1)
        return theory.greatest(follower, vehicle, 20.0, 0.1, 2 if more else 0)

    low, high = 0.3, 3.0
    for _ in range(12):
        low, high = ((low + high) / 2, high) if peak((low + high) / 2) > 1 + 1e-7 else (low, (low + high) / 2)
    below, above = (np.abs(experiment.sweep(loaded(share * high)).gain).max() for share in (0.95, 1.05))
    assert above < 1 < below


@pytest.mark.slow
def test_the_command_prints_tables_and_writes_files(tmp_path):
    arguments = ["string", "acc", "platoon.follower.feed=truth", "platoon.size=2", *EQUAL, "--out", str(tmp_path)]
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["deviation"] < 0.005
    assert len(found["frequency"]) == 10
    assert {row["profile"] for row in found["norms"]} == set(experiment.PROFILES)
    assert {file.name for file in (tmp_path / "acc").iterdir()} == {"frequency.csv", "norms.csv", "string.png"}


def test_a_law_that_cannot_be_measured_is_a_fault():
    with pytest.raises(InputError, match="SUMO drives platoon"):
        experiment.norms(scenario.load("string", ["platoon.follower.law=sumo"]), "step")
    with pytest.raises(InputError, match="must be 2 or more"):
        experiment.norms(scenario.load("string", ["platoon.size=1"]), "step")
