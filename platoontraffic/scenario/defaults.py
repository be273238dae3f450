"""Defaults that depend on the class of the vehicle: its driver, laser, start gap and walls, and the step of the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from platoontraffic.lidar import PRESETS
from platoontraffic.scenario.base import is_multiple, listed
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.vehicles.catalogue import VEHICLES, VehicleModel
from platoontraffic.vehicles.differential import DifferentialDrive

VEHICLE = "paper-robot"  # of a platoon that names none


class Usual(NamedTuple):
    """Defaults of vehicles of one class; lidars and drivers by role, "leader" or "follower"."""

    gap: float  # between members at the start [m]
    step: float  # of a run in which all vehicles are of this class: the scan interval of its lasers, or shorter [s]
    walls: str  # `scene.walls` of such a run: a robot drives between walls, a car between kerbs
    lidars: Mapping[str, str]  # preset, where neither the scenario nor the law names one
    drivers: Mapping[str, Mapping[str, Any]]  # keys of a driver without a law; a role that is missing must name one


# SUMO's cars stand 2.5 m apart (minGap). The lasers of cars have errors by default, so their odometry has them too: a
# platoon that names nothing shall not drive better than one with real sensors could.
USUAL: dict[type, Usual] = {
    DifferentialDrive: Usual(0.5, 0.025, "outline", {"leader": "paper-leader", "follower": "paper-follower"}, {}),
    Car: Usual(
        2.5,
        0.1,
        "none",
        {"leader": "car-leader", "follower": "car-follower"},
        {
            "leader": {"law": "path", "odometry": "car"},
            "follower": {"law": "tracking", "policy": "obey", "on_loss": "drive", "odometry": "car"},
        },
    ),
}


def usual(model: VehicleModel) -> Usual:
    return USUAL[type(model)]


def with_drivers(platoon: Any) -> Any:
    """The table of a platoon, as it is written, with the drivers that it leaves out where its vehicle has a default.

    Also with its size, where it lists its vehicles. A platoon whose vehicle is not sound has the drivers of a car: the
    vehicle is its fault, not a driver that is left out.
    """
    if not isinstance(platoon, dict):
        return platoon
    model = _model_in(platoon)
    drivers = usual(model).drivers if model else USUAL[Car].drivers
    vehicles = listed(platoon.get("vehicles"))
    given = {"size": len(vehicles)} if isinstance(vehicles, list) and vehicles and "size" not in platoon else {}
    platoon = {**platoon, **given}
    for role, driver in drivers.items():
        named = platoon.get(role)
        if isinstance(named, dict) and "law" not in named:
            given[role] = {**driver, **named}
        elif named is None and (role == "leader" or platoon.get("size", 1) != 1):
            given[role] = dict(driver)
    return {**platoon, **given}


def vehicles_in(table: Any) -> list[Any]:
    """The tables of a scenario, as they are written, that say which vehicles and lasers there are."""
    tables = [table.get(key) if isinstance(table, dict) else None for key in ("platoon", "equip")]
    platoons, equips = (one if isinstance(one, list) else [] for one in tables)
    return [*platoons, *({**equip, "vehicle": "car"} for equip in equips if isinstance(equip, dict))]


def usual_step(platoons: Any) -> float:
    """The step of a run with these platoons, tables as they are written [s].

    The least of its vehicles' steps; that of robots, if a laser that is named scans in between.
    """
    finest = USUAL[DifferentialDrive].step
    steps = [finest]
    for platoon in platoons if isinstance(platoons, list) else []:
        if model := _model_in(platoon):
            steps.append(usual(model).step)
            named = [_rate_in(platoon.get(role)) for role in ("leader", "follower")]
            if any(not is_multiple(1 / rate, usual(model).step) for rate in named if rate):
                steps.append(finest)
    return min(steps[1:], default=finest)


def usual_walls(platoons: Any) -> str:
    """`scene.walls` of a run with these platoons, tables as they are written: that of robots, if there is one."""
    models = [_model_in(platoon) for platoon in platoons] if isinstance(platoons, list) else []
    found = {usual(model).walls for model in models if model}
    return found.pop() if len(found) == 1 else USUAL[DifferentialDrive].walls


def _rate_in(driver: Any) -> float | None:
    """The scan rate of the laser that the table of a driver names [Hz]; None if it names none."""
    lidar = driver.get("lidar") if isinstance(driver, dict) else None
    table = lidar if isinstance(lidar, dict) else {"preset": lidar}
    rate, preset = table.get("rate_hz"), table.get("preset")
    if isinstance(rate, int | float) and rate > 0:
        return rate
    return PRESETS[preset].rate if isinstance(preset, str) and preset in PRESETS else None


def _model_in(platoon: Any) -> VehicleModel | None:
    """The vehicle that the table of a platoon names, the leader's; None if the table is not sound."""
    vehicle = platoon.get("vehicle", VEHICLE) if isinstance(platoon, dict) else None
    if isinstance(platoon, dict) and "vehicles" in platoon:
        vehicles = listed(platoon["vehicles"])
        vehicle = vehicles[0] if isinstance(vehicles, list) and vehicles else None
    name = vehicle.get("type", VEHICLE) if isinstance(vehicle, dict) else vehicle
    return VEHICLES.get(name) if isinstance(name, str) else None
