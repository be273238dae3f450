"""Random routes driven alone on bare ground: how well the leader `path` keeps to the lanes of a network."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from platoontraffic import scenario as scenarios
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.lidar import Scene
from platoontraffic.prove.trips import Trip, draw
from platoontraffic.road.network import Network
from platoontraffic.road.turning import tight_turns
from platoontraffic.scenario import Scenario
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.world.deployment import deploy_platoon
from platoontraffic.world.fleet import Member

STEP = 0.1  # [s]
MOST_BEYOND = 1.0  # the bar for the distance from the line, beyond the least that the turning radius allows [m]
MOST_LATERAL = 4.5  # the bar for lateral acceleration: up to there the bicycle model holds [m/s2]
PATIENCE, SETTLING = (
    3.0,
    60.0,
)  # a route must be driven within this factor of the free-flow time, and this time more [s]
WINDOW = 25.0  # the vehicle is sought on its line within this distance of its last station [m]


class Drive(NamedTuple):
    """How one route was driven. Distances are those of the driven axle from the lanes' centre line."""

    start: str  # edge
    end: str  # edge
    length: float  # [m]
    off: float  # greatest distance [m]
    beyond: float  # most that a distance was above the least one there that the turning radius allows [m]
    least: float  # the least one at the place where `beyond` was reached [m]
    x: float  # of the line, at that place [m]
    y: float
    lane: str  # at that place
    lateral: float  # greatest lateral acceleration [m/s2]
    lateral_lane: str  # where it was reached
    arrived: bool
    time: float  # until it arrived, or the simulation ended [s]
    free_time: float  # at the speed limits [s]

    @property
    def holds(self) -> bool:
        return self.arrived and self.beyond <= MOST_BEYOND and self.lateral <= MOST_LATERAL


def drives(network: Network, count: int, seed: int, vehicle: str) -> Iterator[Drive]:
    """Drive random routes, one after the other, each by the law `path` at the speed limits.

    vehicle : name of a vehicle steered by its front wheels
    raises  : InputError where the network has no route for cars
    """
    model, rng = VEHICLES[vehicle], np.random.default_rng(seed)
    trips = draw(network, count, rng, room=model.length, radius=model.turning_radius)
    scenario = _scenario(network, trips, seed, vehicle)
    for i, trip in enumerate(trips):
        (member,) = deploy_platoon(scenario, network, i)
        yield driven(member, trip, seed + i)


def _scenario(network: Network, trips: list[Trip], seed: int, vehicle: str) -> Scenario:
    """A scenario with a platoon of one for each trip."""
    table = {
        "seed": seed,
        "sumo": {"net": str(network.path.resolve()), "traffic": False},
        "scene": {"walls": "none"},
        "run": {"step_s": STEP, "duration_s": 3600.0},
        "platoon": [_platoon(i, trip, vehicle) for i, trip in enumerate(trips)],
    }
    with tempfile.TemporaryDirectory(prefix="platoontraffic-") as folder:
        file = Path(folder, "alone.toml")
        file.write_text(tomli_w.dumps(table), encoding="utf-8")
        return scenarios.load(file)


def _platoon(i: int, trip: Trip, vehicle: str) -> dict[str, Any]:
    return {
        "id": f"route{i}",
        "vehicle": vehicle,
        "start": {"edge": trip.edges[0], "lane": trip.lane, "position_m": trip.position},
        "route": list(trip.edges),
        "leader": {"law": "path", "lidar": "car-leader", "odometry": "car"},
    }


def driven(member: Member, trip: Trip, seed: int) -> Drive:
    """Drive a route; seed: of the sensors' errors."""
    free = trip.free_time(member.model.top_speed)
    setting = Setting([member], Scene.from_shapely(), STEP, steps=round((PATIENCE * free + SETTLING) / STEP), seed=seed)
    axles, lateral, time = [], [], 0.0
    with Simulation(setting) as simulation, closing(iter(simulation)) as instants:
        for instant in instants:
            time = instant.time
            if len(instant.fleet):
                motion = instant.fleet.motion
                axles.append(np.concatenate(member.model.axle_position(motion)))
                lateral.append(abs(motion.speed[0] * motion.yaw_rate[0]))
        arrived = simulation.outcome.ended == "arrived"
    station, off = _followed(np.array(axles), trip)
    least = tight_turns([trip.line], member.model.turning_radius).least_offset(station)
    worst, hardest = int(np.argmax(off - least)), int(np.argmax(lateral))
    x, y = Polyline(trip.line).at(station[[worst]])[0].tolist()
    return Drive(
        start=trip.edges[0],
        end=trip.edges[-1],
        length=trip.length,
        off=float(off.max()),
        beyond=max(float(off[worst] - least[worst]), 0.0),
        least=float(least[worst]),
        x=x,
        y=y,
        lane=trip.lane_at(station[worst]),
        lateral=float(lateral[hardest]),
        lateral_lane=trip.lane_at(station[hardest]),
        arrived=arrived,
        time=time,
        free_time=free,
    )


def _followed(axles: np.ndarray, trip: Trip) -> tuple[np.ndarray, np.ndarray]:
    """Stations on the line [m] and distances from it [m] of a driven axle's positions (k, 2)."""
    line = Polyline(trip.line)
    station, off, near = np.empty(len(axles)), np.empty(len(axles)), trip.position
    for i, (x, y) in enumerate(axles):
        near, aside = line.project(x, y, near, WINDOW)
        station[i], off[i] = near, abs(aside)
    return station, off
