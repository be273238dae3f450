"""SUMO's car-following models as followers: through the package as by libsumo alone."""

from __future__ import annotations

import numpy as np
import pytest

from platoontraffic import Simulation, scenario
from platoontraffic.controllers.native import PARAMETERS
from platoontraffic.errors import InputError
from tests.support import plain_libsumo as plain

ROAD = f"""
[sumo]
net = "highway"
traffic = false
[scene]
walls = "none"
[run]
duration_s = SECONDS
step_s = {plain.STEP}
[[platoon]]
size = 4
vehicle = {{ type = "car", length_m = {plain.LENGTH}, lag_s = 0.0, brake_lag_s = 0.0 }}
gap_m = GAP
to = "e4_e5"
start = {{ edge = "e0_e1", lane = {plain.LANE}, position_m = 700.0, speed_mps = {plain.SPEED} }}
[platoon.leader]
law = "path"
speed_mps = {plain.SPEED}
profile = "sinusoid"
amplitude_mps = {plain.SWING}
frequency_hz = {plain.FREQUENCY}
begins_s = {plain.BEGINS}
[platoon.follower]
law = "sumo"
imperfection = 0.0
speed_factor = 1.5
overtakes = false
"""


def follower_keys(case: str) -> str:
    model, _, controller = case.partition(" ")
    table = ", ".join(f"{name} = {value}" for name, value in plain.CASES[case][0].items())
    chosen = f'controller = "{controller}"\n' if controller else ""
    return f'model = "{model}"\n{chosen}parameters = {{ {table} }}\n'


@pytest.fixture
def road(tmp_path):
    def written(case: str, more: str = ""):
        file = tmp_path / "road.toml"
        file.write_text(
            ROAD.replace("GAP", str(plain.CASES[case][1])).replace("SECONDS", str(plain.SECONDS[case]))
            + follower_keys(case)
            + more
        )
        return file

    return written


@pytest.mark.sumo
@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[] if case in ("CACC", "CC PLOEG") else pytest.mark.slow) for case in plain.CASES]
)
def test_amplitude_ratios_are_those_of_libsumo_alone(road, case):
    expected = plain.amplitude_ratios(case)
    with Simulation.load(road(case)) as simulation:
        speeds, lanes = [], set()
        for now in simulation:
            speeds.append(now.fleet.motion.speed)
            lanes |= {lane for _, lane in now.roads if lane[:1] not in ("", ":")}
    late = np.array(speeds)[-round(plain.COUNTS / plain.STEP) :]
    waves = np.exp(-2j * np.pi * plain.FREQUENCY * plain.STEP * np.arange(len(late)))
    amplitude = np.abs(waves @ (late - late.mean(axis=0)))
    assert amplitude[1:] / amplitude[:-1] == pytest.approx(expected, abs=0.02)
    assert {lane for lane in lanes if lane.startswith("e0_e1")} == {f"e0_e1_{plain.LANE}"}


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            'model = "CACC"\nparameters = { tua = 1.0 }',
            "parameters.tua: no such parameter of CACC; did you mean 'tau'?",
        ),
        ('model = "IDM"\nparameters = { tau = "1" }', "parameters.tau: '1'; must be a number"),
        ('model = "IDM"\nparameters = 3', "must be a table of numbers"),
        ('model = "CC"', "must have both or neither"),
        ('controller = "PLOEG"', "must have both or neither"),
        ('model = "CACCC"', "CACC"),
        ('model = "CC"\ncontroller = "CONSENSUS"', "a size of 9; SUMO has it for up to 8"),
    ],
)
def test_faults(tmp_path, keys, said):
    file = tmp_path / "road.toml"
    file.write_text(ROAD.replace("GAP", "20.0").replace("SECONDS", "9.0").replace("size = 4", "size = 9") + keys)
    with pytest.raises(InputError) as error:
        scenario.load(file)
    assert len(error.value.faults) == 1
    assert said in str(error.value)


def test_every_parameter_is_of_sumo_s_file_format(tmp_path):
    sumo = pytest.importorskip("sumo")
    schema = (sumo.SUMO_HOME and sumo.SUMO_HOME + "/data/xsd/types/route.xsd") or ""
    text = open(schema).read()  # noqa: SIM115
    by_vehicle = {"ccaht"}
    unknown = {name for names in PARAMETERS.values() for name in names if f'name="{name}"' not in text} - by_vehicle
    assert unknown == set()


def test_what_a_run_writes_of_the_law_is_read_back(road, tmp_path):
    first = scenario.load(road("CC PLOEG"))
    table = first.resolved()["platoon"][0]["follower"]
    assert table["parameters"]["ploegH"] == 0.5
    assert first.laws[0, "follower"].vehicle_type["carFollowModel"] == "CC"
