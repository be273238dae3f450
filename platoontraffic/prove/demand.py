"""A modest random demand for a network that brings no traffic of its own."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.prove.trips import Trip, draw
from platoontraffic.road.network import Network
from platoontraffic.vehicles.bicycle import CARS

DENSITY = 6.0  # vehicles per kilometre of lane that are wanted on the road
MOST = 400  # vehicles on the road at most
ROUTES = 40  # that the vehicles share
SLOWED = 0.6  # mean speed in traffic over the speed limit: turns a number of vehicles into a rate of departures
ROOM = 7.5  # for one of SUMO's cars with its gap [m]
RADII = CARS["car"].turning_radius, 0.0  # SUMO's own cars turn on the spot, where there is no other route


def write_demand(network: Network, file: Path, seed: int, begin: float, duration: float) -> int:
    """Write a route file of vehicles that depart evenly at random in `duration` from `begin` on [s].

    Each begins at rest, as from a parking place: nobody can see it come.

    returns: their number
    """
    rng = np.random.default_rng([seed, 1])
    trips: list[Trip] = []
    for radius in RADII:
        if not trips:
            with suppress(InputError):
                trips = draw(network, ROUTES, rng, room=ROOM, radius=radius)
    lane_km = sum(length for _, _, length in network.lanes_for_cars()) / 1000
    wanted = min(DENSITY * lane_km, MOST)
    travel = np.mean([trip.free_time(np.inf) for trip in trips]) / SLOWED if trips else np.inf
    count = round(wanted / travel * duration)
    times, chosen = np.sort(rng.uniform(begin, begin + duration, count)), rng.integers(max(len(trips), 1), size=count)
    lines = ["<routes>"]
    lines += [f'    <route id="prove.{i}" edges={quoteattr(" ".join(t.edges))}/>' for i, t in enumerate(trips)]
    place = 'departLane="best" departSpeed="0"'
    lines += [
        f'    <vehicle id="prove.car.{i}" route="prove.{k}" depart="{time:.1f}" {place}/>'
        for i, (time, k) in enumerate(zip(times, chosen.tolist(), strict=True))
    ]
    file.write_text("\n".join([*lines, "</routes>", ""]), encoding="utf-8")
    return count
