"""Random routes driven alone on bare ground: how well the leader `path` keeps to the lanes of a network."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from platoontraffic import scenario as scenarios
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.lidar import Scene
from platoontraffic.prove.plans import FARTHER
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
APART = 100_000.0  # distance between vehicles that are driven at once [m]
WINDOW, FAR = 25.0, 100.0  # it is sought on its line within this of its last station; if it was astray there [m]
ASTRAY = 3.0  # distance from its line from which it is astray [m]


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
    time: float  # until it arrived, or its time was over [s]
    free_time: float  # at the speed limits [s]

    @property
    def holds(self) -> bool:
        return self.arrived and self.beyond <= MOST_BEYOND and self.lateral <= MOST_LATERAL


def drives(
    network: Network, count: int, seed: int, vehicle: str, tell: Callable[[int], None] = lambda ended: None
) -> list[Drive]:
    """Drive random routes, each by the law `path` at the speed limits.

    vehicle : name of a vehicle steered by its front wheels
    tell    : is given the number of routes that have ended, after every step
    raises  : InputError where the network has no route for cars
    """
    model, rng = VEHICLES[vehicle], np.random.default_rng(seed)
    trips = draw(network, count, rng, room=model.length, radius=model.turning_radius)
    scenario = _scenario(network, trips, seed, vehicle)
    members = [deploy_platoon(scenario, network, i)[0] for i in range(len(trips))]
    return driven(members, trips, seed, tell)


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
        "leader": {"law": "path", "lidar": {"preset": "car-leader", "range_max_m": FARTHER}, "odometry": "car"},
    }


def driven(
    members: Sequence[Member], trips: Sequence[Trip], seed: int, tell: Callable[[int], None] = lambda ended: None
) -> list[Drive]:
    """Drive each member along its trip, all in one simulation, but so far apart that none sees another.

    seed: of the sensors' errors
    """
    free = [trip.free_time(member.model.top_speed) for member, trip in zip(members, trips, strict=True)]
    limits = [PATIENCE * time + SETTLING for time in free]
    setting = Setting(
        [_moved_east(member, APART * i) for i, member in enumerate(members)],
        Scene.from_shapely(),
        STEP,
        steps=round(max(limits) / STEP),
        seed=seed,
    )
    row_of = {member.id: i for i, member in enumerate(members)}
    tracks: list[list[tuple[float, ...]]] = [[] for _ in members]  # time, axle's x and y, lateral acceleration
    with Simulation(setting) as simulation:
        for instant in simulation:
            fleet = instant.fleet
            lateral = np.abs(fleet.motion.speed * fleet.motion.yaw_rate)
            x, y = fleet.model.axle_position(fleet.motion) if len(fleet) else ((), ())
            for member, *values in zip(fleet.members, x, y, lateral, strict=True):
                i = row_of[member.id]
                if instant.time <= limits[i]:
                    tracks[i].append((instant.time, *values))
            tell(len(members) - len(fleet))
    parts = zip(members, trips, tracks, free, limits, strict=True)
    return [
        _drive(member, trip, np.array(track) - np.array([0.0, APART * i, 0.0, 0.0]), time, limit)
        for i, (member, trip, track, time, limit) in enumerate(parts)
    ]


def _moved_east(member: Member, distance: float) -> Member:
    """The member at a start pose and on a route that are moved by a distance [m]."""
    x, y, heading = member.pose
    line = Polyline(member.route.line.points + np.array([distance, 0.0]))
    return replace(member, pose=(x + distance, y, heading), route=replace(member.route, line=line))


def _drive(member: Member, trip: Trip, track: np.ndarray, free: float, limit: float) -> Drive:
    """track: time [s], x and y of the driven axle [m], lateral acceleration [m/s2] at each instant, (k, 4)"""
    station, off = _followed(track[:, 1:3], trip)
    lateral, time = track[:, 3], float(track[-1, 0])
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
        arrived=time + 1.5 * STEP < limit,
        time=time,
        free_time=free,
    )


def _followed(axles: np.ndarray, trip: Trip) -> tuple[np.ndarray, np.ndarray]:
    """Stations on the line [m] and distances from it [m] of a driven axle's positions (k, 2)."""
    line = Polyline(trip.line)
    station, off, near = np.empty(len(axles)), np.empty(len(axles)), trip.position
    for i, (x, y) in enumerate(axles):
        near, aside = line.project(x, y, near, WINDOW if i == 0 or off[i - 1] < ASTRAY else FAR)
        station[i], off[i] = near, abs(aside)
    return station, off
