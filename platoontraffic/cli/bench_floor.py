"""What a step costs above its floor: SUMO's step with the members moved and read, and nothing else.

A simulation is stepped, and where its members were is noted. In another process, in a world of the same scenario, they
are then moved there by bare calls of SUMO. The two take turns of `TURN` steps, because the speed of a machine changes
within a minute. Each has one thread.
"""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from platoontraffic import scenario
from platoontraffic.errors import RunError
from platoontraffic.simulation import Instant, Setting, Simulation, prepare, setting_of
from platoontraffic.sumo.client import libsumo
from platoontraffic.sumo.frame import front_of, sumo_angle
from platoontraffic.sumo.placement import ANY_LANE, EXACTLY

# Steps before those that are measured, in which members come to most junctions that they meet often; and steps of which
# the calls are counted.
WARM_UP, COUNTED = 300, 100
TURN = 50  # steps


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
    loop = floor = 0.0
    with _floor_of(source, changes, platoons) as moved, Simulation(_setting(source, changes, platoons)) as simulation:
        simulation.reset()
        last = WARM_UP + steps
        for first, end in pairwise([*range(0, WARM_UP, TURN), *range(WARM_UP, last, TURN), last]):
            poses, spent = [], 0.0
            for _ in range(first, end):
                began = time.process_time()
                now = simulation.step()
                spent += time.process_time() - began
                poses.append(_poses(now))
            of_floor = moved(poses)
            if first >= WARM_UP:
                loop, floor = loop + spent, floor + of_floor
        counted = cProfile.Profile()
        counted.enable()
        for _ in range(COUNTED):
            simulation.step()
        counted.disable()
    loop_ms, floor_ms, n = 1e3 * loop / steps, 1e3 * floor / steps, len(_poses(now))
    calls = pstats.Stats(counted).total_calls / COUNTED
    return Above(name, n, floor_ms, loop_ms, loop_ms - floor_ms, 1e3 * (loop_ms - floor_ms) / n, calls)


def _setting(source: str | Path, changes: Sequence[str], platoons: str | Path | None) -> Setting:
    return setting_of(prepare(scenario.load(source, changes, platoons=platoons)))


def _poses(now: Instant) -> list[Pose]:
    fleet, motion = now.fleet, now.fleet.motion
    x, y = front_of(motion.x, motion.y, motion.heading, fleet.model.length)
    angle = sumo_angle(motion.heading)
    columns = (values.tolist() for values in (x, y, angle, abs(motion.speed)))
    moved = zip(fleet.ids, *columns, fleet.native.tolist(), strict=True)
    return [Pose(*values) for *values, native in moved if not native]


@contextmanager
def _floor_of(*arguments: Any) -> Iterator[Callable[[Sequence[Sequence[Pose]]], float]]:
    """A process in which members are moved to their poses, a step after the other; returns its CPU time [s].

    arguments: of `_setting`

    raises: RunError (it has died)
    """
    ours, theirs = get_context("spawn").Pipe()
    process = get_context("spawn").Process(target=_floor, args=(theirs, *arguments))
    process.start()
    theirs.close()

    def moved(poses: Sequence[Sequence[Pose]]) -> float:
        try:
            ours.send(poses)
            return ours.recv()
        except (EOFError, OSError) as error:
            raise RunError("a process of the benchmark died: the floor") from error

    try:
        yield moved
    finally:
        ours.close()
        process.join()


def _floor(theirs: Connection, *arguments: Any) -> None:
    setting, vehicle = _setting(*arguments), libsumo.vehicle
    with suppress(EOFError, KeyboardInterrupt), setting.ground() as world:
        world.deploy(*setting.departures)
        while True:
            poses = theirs.recv()
            began = time.process_time()
            for step in poses:
                for one in step:
                    vehicle.moveToXY(one.id, *ANY_LANE, one.x, one.y, one.angle, *EXACTLY)
                libsumo.simulationStep()
                for one in step:
                    vehicle.setPreviousSpeed(one.id, one.speed)
                    vehicle.getLaneID(one.id)
            theirs.send(time.process_time() - began)
