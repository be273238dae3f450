"""SUMO's car-following models behind a leader whose speed swings, by libsumo alone: nothing of the package is used.

Run as a program, it prints amplitude ratios, with step, lane and parameters:

    python tests/support/plain_libsumo.py
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import libsumo
import numpy as np

NET = Path(__file__).parents[2] / "sumo_nets" / "highway" / "highway.net.xml"
EDGES = ["e0_e1", "e1_e2", "e2_e3", "e3_e4", "e4_e5"]  # straight, to the east
LENGTH = 4.6  # of each car [m]
STEP, LANE, SPEED, SWING, FREQUENCY, BEGINS, COUNTS = 0.1, 0, 20.0, 1.5, 0.1, 10.0, 40.0
CAR = {"accel": 2.6, "decel": 4.5, "emergencyDecel": 9.0}
EXACT = {"sigmaleader": 0, "sigmagap": 0, "sigmaerror": 0}
# Model or controller: parameters, gap at the start [m].
CASES: dict[str, tuple[dict[str, float], float]] = {
    "Krauss": (CAR | {"tau": 1.0, "minGap": 2.5}, 22.5),
    "IDM": (CAR | {"tau": 1.0, "minGap": 2.5}, 22.7),
    "EIDM": (CAR | EXACT | {"tau": 1.0, "minGap": 2.5}, 22.7),
    "ACC": (CAR | {"tau": 1.2, "minGap": 2.5}, 26.5),
    "CACC": (CAR | {"tau": 0.6, "minGap": 2.5}, 14.5),
    "CC ACC": (CAR | {"tauEngine": 0.5, "ccaht": 1.2}, 26.0),
    "CC CACC": (CAR | {"tauEngine": 0.5, "constSpacing": 5.0}, 5.0),
    "CC PLOEG": (CAR | {"tauEngine": 0.5, "ploegH": 0.5}, 12.0),
    "CC CONSENSUS": (CAR | {"tauEngine": 0.5}, 31.0),
    "CC FLATBED": (CAR | {"tauEngine": 0.5, "flatbedD": 5.0}, 5.0),
}
# Time until the swing is steady, and counts [s]. SUMO's ACC, which switches between its gains, needs longer.
SECONDS = dict.fromkeys(CASES, 75.0) | {"ACC": 130.0}
CONTROLLERS = {"ACC": 1, "CACC": 2, "PLOEG": 4, "CONSENSUS": 5, "FLATBED": 6}


def swing(time: float) -> float:
    """The leader's speed [m/s]."""
    return SPEED + (SWING * np.sin(2 * np.pi * FREQUENCY * (time - BEGINS)) if time > BEGINS else 0.0)


def amplitude_ratios(case: str, cars: int = 4) -> np.ndarray:
    """Amplitude of each follower's speed over that of the car ahead, (cars - 1,)."""
    parameters, gap = CASES[case]
    speeds = _driven(case, parameters, gap, cars)
    late = speeds[-round(COUNTS / STEP) :]
    waves = np.exp(-2j * np.pi * FREQUENCY * STEP * np.arange(len(late)))
    amplitude = np.abs(waves @ (late - late.mean(axis=0)))
    return amplitude[1:] / amplitude[:-1]


def _driven(case: str, parameters: Mapping[str, float], gap: float, cars: int) -> np.ndarray:
    """Speeds [m/s], (steps, cars)."""
    model, _, controller = case.partition(" ")
    names = [f"v{i}" for i in range(cars)]
    vehicle = libsumo.vehicle
    with TemporaryDirectory() as folder:
        _start(Path(folder), model, parameters)
    try:
        libsumo.route.add("route", EDGES)
        for i, name in enumerate(names):
            position = str(700 - i * (LENGTH + gap))
            kind = "follower" if i else "leader"
            vehicle.add(name, "route", kind, departLane=str(LANE), departPos=position, departSpeed=str(SPEED))
        libsumo.simulationStep()
        for i, name in enumerate(names):
            vehicle.setLaneChangeMode(name, 0)
            vehicle.setSpeedMode(name, 31 if i and not controller else 0)
            if i and controller:
                given = {"ccds": 50, "ccac": CONTROLLERS[controller], "ccvp": i, "ccps": cars}
                if "ccaht" in parameters:
                    given["ccaht"] = parameters["ccaht"]
                for key, value in given.items():
                    vehicle.setParameter(name, f"carFollowModel.{key}", str(value))
        rows, before = [], np.full(cars, SPEED)
        for k in range(round(SECONDS[case] / STEP)):
            now = np.array([vehicle.getSpeed(name) for name in names])
            if controller:
                _tell(names, now, (now - before) / STEP, controller)
            vehicle.setSpeed("v0", swing((k + 1) * STEP))
            libsumo.simulationStep()
            rows.append([vehicle.getSpeed(name) for name in names])
            before = now
        assert {vehicle.getLaneIndex(name) for name in names} <= {
            LANE,
            LANE + 1,
        }  # a lane more, where there is a slip road
        return np.array(rows)
    finally:
        libsumo.close()


def _start(folder: Path, model: str, parameters: Mapping[str, float]) -> None:
    given = {name: value for name, value in parameters.items() if name != "ccaht"}
    if model == "CC":
        given |= {"lanesCount": 1, "minGap": 0}
    attributes = " ".join(f'{name}="{value}"' for name, value in given.items())
    same = f'length="{LENGTH}" speedDev="0" maxSpeed="50"'
    types = (
        f'<vType id="leader" {same} speedFactor="10"/>'
        f'<vType id="follower" {same} carFollowModel="{model}" speedFactor="1.5" sigma="0" {attributes}/>'
    )
    file = folder / "types.add.xml"
    file.write_text(f"<additional>{types}</additional>")
    options = ["-n", str(NET), "-a", str(file), "--step-length", str(STEP), "--seed", "1", "--precision", "6"]
    libsumo.start(["sumo", *options, "--no-step-log", "true", "--no-warnings", "true", "--time-to-teleport", "-1"])


def _tell(names: list[str], speed: np.ndarray, acceleration: np.ndarray, controller: str) -> None:
    """Every follower is told of leader and predecessor, or of all, as they were at the last step."""
    vehicle, now = libsumo.vehicle, libsumo.simulation.getTime()
    messages = []
    for i, name in enumerate(names):
        demand = float(vehicle.getParameter(name, "carFollowModel.ccsa").split(":")[2]) if i else acceleration[0]
        x, y = vehicle.getPosition(name)
        messages.append((speed[i], acceleration[i], x, y, now, demand, speed[i], 0.0, vehicle.getAngle(name)))
    for i, name in enumerate(names[1:], start=1):
        if controller == "CONSENSUS":
            for j, (v, a, x, y, at, u, *velocity) in enumerate(messages):
                if j != i:
                    _set(name, "ccvd", (j, v, a, x, y, at, LENGTH, u, *velocity))
        else:
            _set(name, "cclsa", messages[0])
            _set(name, "ccpsa", messages[i - 1])


def _set(name: str, key: str, values: tuple) -> None:
    libsumo.vehicle.setParameter(name, f"carFollowModel.{key}", ":".join(map(str, values)))


if __name__ == "__main__":
    print(f"step {STEP} s, lane {LANE}, leader {SPEED} m/s with {SWING} m/s at {FREQUENCY} Hz")
    for case, (parameters, _) in CASES.items():
        print(f"{case:14}", *(f"{ratio:.3f}" for ratio in amplitude_ratios(case)), " ", parameters)
