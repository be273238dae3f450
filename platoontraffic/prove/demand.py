"""A random demand for a network that brings no traffic of its own, thinner where SUMO's own cars jam in it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.sax.saxutils import quoteattr

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.prove.trips import Trip, draw
from platoontraffic.road.network import Network
from platoontraffic.sumo.client import libsumo
from platoontraffic.sumo.process import Process, start_options
from platoontraffic.vehicles.bicycle import CARS

DENSITY = 6.0  # vehicles per kilometre of lane that are wanted on the road
MOST = 400  # vehicles on the road at most
THINNER, LEAST = 0.7, 0.1  # a demand in which SUMO's own cars jam is made thinner by this factor, down to this share
LONGEST_WAIT = 90.0  # a car that stands for longer does so in a jam; the lights of netgenerate take so long [s]
LOOKS_EVERY = 10  # steps of 1 s between two looks for such a car
ROUTES = 40  # that the vehicles share
SLOWED = 0.6  # mean speed in traffic over the speed limit: turns a number of vehicles into a rate of departures
ROOM = 7.5  # for one of SUMO's cars with its gap [m]
RADII = CARS["car"].turning_radius, 0.0  # SUMO's own cars turn on the spot, where there is no other route


def write_demand(network: Network, file: Path, seed: int, begin: float, duration: float) -> int:
    """Write a route file of vehicles that depart evenly at random in `duration` from `begin` on [s].

    Each begins at rest, as from a parking place: nobody can see it come. Where SUMO's own cars jam, all would stand for
    minutes, and times of arrival would be chance: there are fewer vehicles then, but no less than the share LEAST.

    returns: their number
    raises : RunError, InputError (SUMO fails, or refuses the network)
    """
    rng = np.random.default_rng([seed, 1])
    trips: list[Trip] = []
    for radius in RADII:
        if not trips:
            with suppress(InputError):
                trips = draw(network, ROUTES, rng, room=ROOM, radius=radius, round_blocks=False)
    lane_km = sum(length for _, _, length in network.lanes_for_cars()) / 1000
    wanted = min(DENSITY * lane_km, MOST)
    travel = np.mean([trip.free_time(np.inf) for trip in trips]) / SLOWED if trips else np.inf
    share = 1.0
    while True:
        count = round(share * wanted / travel * duration)
        times = np.sort(rng.uniform(begin, begin + duration, count))
        _write(file, trips, times, rng.integers(max(len(trips), 1), size=count).tolist())
        share *= THINNER
        if share < LEAST or _flows(network, file, seed, begin, duration):
            return count


def _write(file: Path, trips: Sequence[Trip], times: np.ndarray, chosen: Sequence[int]) -> None:
    """times: of departure [s]; chosen: the trips' numbers"""
    lines = ["<routes>"]
    lines += [f'    <route id="prove.{i}" edges={quoteattr(" ".join(t.edges))}/>' for i, t in enumerate(trips)]
    place = 'departLane="best" departSpeed="0"'
    lines += [
        f'    <vehicle id="prove.car.{i}" route="prove.{k}" depart="{time:.1f}" {place}/>'
        for i, (time, k) in enumerate(zip(times, chosen, strict=True))
    ]
    file.write_text("\n".join([*lines, "</routes>", ""]), encoding="utf-8")


def _flows(network: Network, file: Path, seed: int, begin: float, duration: float) -> bool:
    """Whether no car stands for longer than LONGEST_WAIT where SUMO drives all of a demand, in steps of 1 s."""
    with TemporaryDirectory(prefix="platoontraffic-") as folder:
        sumo = Process(libsumo, network.path, Path(folder, "log.txt"))
        files = {"route-files": str(file), "begin": str(begin)}
        sumo.start(start_options(network.path.resolve(), 1.0, seed, files))
        flows = True
        try:
            for time in range(LOOKS_EVERY, round(duration) + 1, LOOKS_EVERY):
                sumo.step(begin + time)
                flows = all(libsumo.vehicle.getWaitingTime(car) <= LONGEST_WAIT for car in libsumo.vehicle.getIDList())
                if not flows:
                    break
        except BaseException as error:
            sumo.close(error)
            raise
        sumo.close(None)
        return flows
