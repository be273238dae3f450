"""`platoontraffic prove`: what it prints, its exit codes, bad input."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner, Result

from platoontraffic.cli.main import app
from platoontraffic.prove import alone


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["prove", *map(str, arguments)])


def test_it_prints_the_worst_route_first_and_ends_with_0_where_all_bars_hold():
    done = call("corridor", "--routes", 2, "--seed", 2)
    assert done.exit_code == 0, done.output
    assert "2 arrive" in done.stdout
    assert done.stdout.splitlines()[-1] == "holds"
    beyond = [float(line.split()[4]) for line in done.stdout.splitlines()[1:3]]
    assert beyond == sorted(beyond, reverse=True)


def test_it_ends_with_1_where_a_bar_does_not_hold(monkeypatch):
    monkeypatch.setattr(alone, "MOST_LATERAL", 0.1)
    done = call("corridor", "--routes", 1, "--json")
    assert done.exit_code == 1
    report = json.loads(done.stdout)
    assert not report["holds"]
    assert [route["holds"] for route in report["routes"]] == [False]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("coridor",), "coridor: no such file, nor a shipped network; did you mean 'corridor'?"),
        (("lab_loop",), "no lane for cars is 4.7 m long"),
        (("corridor", "--vehicle", "vam"), "--vehicle: no such vehicle 'vam'; did you mean 'van'?"),
        (("corridor", "--vehicle", "paper-robot"), "--vehicle: 'paper-robot': is not steered by its wheels; must be"),
        (("corridor", "--vehicle", "cra"), "did you mean 'car'?"),
        (("corridor", "--traffic", "--duration", 10.05), "--duration: 10.05: must be a multiple of 0.1 s"),
        (("corridor", "--traffic", "--results", __file__), "File exists; must be a folder"),
        (("corridor", "--results", "anywhere"), "--results: goes with --traffic; must be left out"),
        (("corridor", "--seeds", "9"), "--seeds: goes with --traffic; must be left out"),
        (("corridor", "--warm-up", "0"), "--warm-up: goes with --traffic; must be left out"),
        (("corridor", "--traffic", "--routes", "3"), "--routes: does not go with --traffic; must be left out"),
    ],
)
def test_bad_input_is_one_line(arguments, said):
    done = call(*arguments)
    assert done.exit_code == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
