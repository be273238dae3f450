"""Scenarios for platoons in traffic on random routes, and for SUMO's own cars in their places.

For each seed there are two: one of platoons that drive by laser, and its twin, in which SUMO drives a car of the same
size from each member's start place on the same route, in the same traffic.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from platoontraffic import scenario as scenarios
from platoontraffic.errors import InputError
from platoontraffic.lidar import Scene
from platoontraffic.prove.demand import write_demand
from platoontraffic.prove.trips import Trip, draw
from platoontraffic.road.network import Network, read_configuration
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.deployment import deploy

STEP = 0.1  # [s]
LOOKED_EVERY = 2.0  # interval at which it is recorded where SUMO's own cars stand [s]
GAP = 2.5  # between members at the start [m]
PLATOONS = 2
SIZES = (5, 3, 1)  # of the platoons: the first for which lanes are long enough
DRAWN = 12  # trips of which the platoons' are the first ones that can be started
NAME = "proved"  # of the platoons, before their number; a flow p1 of the traffic would have vehicles p1.0, p1.1 …
LASER, SUMO = "platoons", "sumo"  # the two runs of a seed
FAST, FARTHER = 25.0, 150.0  # on networks with higher speed limits [m/s] lasers reach so far [m]
DRIVERS: Mapping[str, dict[str, Any]] = {
    LASER: {
        "leader": {"law": "path", "lidar": "car-leader", "odometry": "car"},
        "follower": {
            "law": "tracking", "policy": "obey", "on_loss": "drive", "lidar": "car-tracker", "odometry": "car",
        },
    },
    SUMO: {"leader": "sumo", "follower": "sumo"},
}  # fmt: skip


class Road(NamedTuple):
    """The network that is proved, and where its traffic comes from."""

    name: str  # as the user gave it
    net: Path
    sumo: Mapping[str, str]  # the table `sumo` of a scenario on this road
    has_traffic: bool  # of a configuration or a shipped network; otherwise a random demand is made
    begin: float = 0.0  # of SUMO's clock [s]


class Plan(NamedTuple):
    """One seed's scenarios, written to files."""

    seed: int
    size: int
    trips: tuple[Trip, ...]
    files: Mapping[str, Path]  # by LASER and SUMO
    duration: float  # of the runs after their warm-up [s]
    cars: int  # of the random demand; 0 where the road has traffic of its own

    @property
    def trip_of(self) -> dict[str, Trip]:
        """The trip of each vehicle, by id."""
        return {f"{NAME}{k}.{i}": trip for k, trip in enumerate(self.trips) for i in range(self.size)}


def planned(
    road: Road, network: Network, seed: int, folder: Path, *, vehicle: str, warm_up: float, duration: float
) -> Plan:
    """Write the scenarios of a seed.

    folder : for the scenarios, made if missing
    raises : InputError where there is no start for a platoon
    """
    folder.mkdir(parents=True, exist_ok=True)
    sumo: dict[str, Any] = dict(road.sumo)
    cars = 0
    if not road.has_traffic:
        demand = folder / "demand.rou.xml"
        cars = write_demand(network, demand, seed, road.begin, warm_up + duration)
        sumo["routes"] = [str(demand.resolve())]
    common = {
        "seed": seed,
        "sumo": sumo | {"warm_up_s": warm_up},
        "scene": {"walls": "none"},
        "run": {"step_s": STEP, "duration_s": duration},
        "record": {"every_s": 0.5},
    }
    model = VEHICLES[vehicle]
    for size in SIZES:
        room = size * model.length + (size - 1) * GAP
        trips = _startable(network, common, room, seed, folder, vehicle, size)
        if trips:
            break
    else:
        raise InputError(f"{network.path}: no place to start a {vehicle} from; must have one on the road")
    files = {}
    for which, drivers in _drivers(network).items():
        platoons = [_platoon(f"{NAME}{k}", trip, size, vehicle) | drivers for k, trip in enumerate(trips)]
        files[which] = folder / f"{which}.toml"
        table = common | {"platoon": platoons}
        if which == SUMO:
            table["record"] = common["record"] | {"traffic_every_s": LOOKED_EVERY}
            table["sumo"] = common["sumo"] | ({} if _sets_lane_changes(sumo) else {"lane_change_s": 0.0})
        files[which].write_text(tomli_w.dumps(table), encoding="utf-8")
    return Plan(seed, size, tuple(trips), files, duration, cars)


def _drivers(network: Network) -> dict[str, dict[str, Any]]:
    """`DRIVERS`, with lasers that reach as far as the network is fast."""
    found = {which: dict(roles) for which, roles in DRIVERS.items()}
    if max((network.limit(edge, lane) for edge, lane, _ in network.lanes_for_cars()), default=0.0) > FAST:
        for role, driver in found[LASER].items():
            found[LASER][role] = driver | {"lidar": {"preset": driver["lidar"], "range_max_m": FARTHER}}
    return found


def _sets_lane_changes(sumo: Mapping[str, Any]) -> bool:
    return "config" in sumo and "lanechange.duration" in read_configuration(sumo["config"]).options


def _startable(
    network: Network, common: Mapping[str, Any], room: float, seed: int, folder: Path, vehicle: str, size: int
) -> list[Trip]:
    """Trips from different edges, one for each platoon, fewer where there are not as many; [] where there is none."""
    rng = np.random.default_rng([seed, 2])
    try:
        radius = VEHICLES[vehicle].turning_radius
        drawn = draw(network, DRAWN, rng, room=room, radius=radius, round_blocks=False)
    except InputError:
        return []
    found: list[Trip] = []
    file = folder / "tried.toml"
    for trip in drawn:
        if any(trip.edges[0] == other.edges[0] for other in found):
            continue
        file.write_text(
            tomli_w.dumps(dict(common) | {"platoon": [_platoon(NAME, trip, size, vehicle)]}), encoding="utf-8"
        )
        checked = scenarios.load(file)
        file.unlink()
        try:
            deploy(checked, network, Scene.from_shapely())
        except InputError:  # off the road, where a lane is narrow or bent
            continue
        found.append(trip)
        if len(found) == PLATOONS:
            break
    return found


def _platoon(name: str, trip: Trip, size: int, vehicle: str) -> dict[str, Any]:
    return {
        "id": name,
        "size": size,
        "gap_m": GAP,
        "vehicle": vehicle,
        "start": {"edge": trip.edges[0], "lane": trip.lane, "position_m": trip.position},
        "route": list(trip.edges),
    } | DRIVERS[LASER]
