"""What a step costs above its floor: SUMO's step with the members moved and read, and nothing else.

A simulation is stepped, and where its members were is noted. In a new world of the same scenario they are then moved
there by bare calls of SUMO. Both are in one process and have one thread.
"""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from platoontraffic import scenario
from platoontraffic.simulation import Instant, Simulation, prepare, setting_of
from platoontraffic.sumo.client import libsumo
from platoontraffic.sumo.frame import front_of, sumo_angle
from platoontraffic.sumo.placement import ANY_LANE, EXACTLY
from platoontraffic.world.prepared import Prepared, departures

# Steps before those that are measured, in which members come to most junctions that they meet often; and steps of which
# the calls are counted.
WARM_UP, COUNTED = 300, 100


class Scene(NamedTuple):
    """A scenario, or a SUMO configuration with a file of platoons, of which a number of steps is measured."""

    name: str
    scenario: str
    steps: int
    changes: tuple[str, ...] = ()
    platoons: str | None = None


LAB = Scene("lab, 5 robots", "paper_loop", 2000)
HIGHWAY = Scene("highway, 5 tracking cars", "highway_tracking", 400, ("platoon.size=5", "run.duration_s=85"))


class Above(NamedTuple):
    """CPU time and calls of a step.

    above_ms : of the loop beyond the floor
    member_us: of that, per member
    calls    : of Python and C functions
    """

    scene: str
    members: int
    floor_ms: float
    loop_ms: float
    above_ms: float
    member_us: float
    calls: float


class Pose(NamedTuple):
    """A moved member at the end of a step, as SUMO is told it."""

    id: str
    x: float  # of the front bumper [m]
    y: float
    angle: float  # [deg]
    speed: float  # [m/s]


def above(
    name: str, source: str | Path, changes: Sequence[str], steps: int, platoons: str | Path | None = None
) -> Above:
    """Measure steps of a scenario. Its members depart at its begin, or, from the traffic, within WARM_UP steps; none
    arrives in these steps.

    platoons: their file, where the source is a SUMO configuration
    """
    prepared = prepare(scenario.load(source, changes, platoons=platoons))
    poses: list[list[Pose]] = []
    with Simulation(setting_of(prepared)) as simulation:
        simulation.reset()
        for _ in range(WARM_UP):
            poses.append(_poses(simulation.step()))
        loop = 0.0
        for _ in range(steps):
            began = time.process_time()
            now = simulation.step()
            loop += time.process_time() - began
            poses.append(_poses(now))
        counted = cProfile.Profile()
        counted.enable()
        for _ in range(COUNTED):
            simulation.step()
        counted.disable()
    loop_ms, floor_ms = 1e3 * loop / steps, 1e3 * _floor(prepared, poses)
    n = len(poses[-1])
    calls = pstats.Stats(counted).total_calls / COUNTED
    return Above(name, n, floor_ms, loop_ms, loop_ms - floor_ms, 1e3 * (loop_ms - floor_ms) / n, calls)


def _poses(now: Instant) -> list[Pose]:
    fleet, motion = now.fleet, now.fleet.motion
    x, y = front_of(motion.x, motion.y, motion.heading, fleet.model.length)
    angle = sumo_angle(motion.heading)
    columns = (values.tolist() for values in (x, y, angle, abs(motion.speed)))
    moved = zip(fleet.ids, *columns, fleet.native.tolist(), strict=True)
    return [Pose(*values) for *values, native in moved if not native]


def _floor(prepared: Prepared, poses: Sequence[Sequence[Pose]]) -> float:
    """CPU time of a step after WARM_UP in which members are moved to these poses and read [s]."""
    setting, vehicle = setting_of(prepared), libsumo.vehicle
    with setting.ground() as world:
        world.deploy(*departures(prepared.members, setting.dt))
        for k, step in enumerate(poses):
            if k == WARM_UP:
                began = time.process_time()
            for one in step:
                vehicle.moveToXY(one.id, *ANY_LANE, one.x, one.y, one.angle, *EXACTLY)
            libsumo.simulationStep()
            for one in step:
                vehicle.setPreviousSpeed(one.id, one.speed)
                vehicle.getLaneID(one.id)
        return (time.process_time() - began) / (len(poses) - WARM_UP)
