"""The law: what every control law declares, what it is given and what it gives."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np

from platoontraffic.lidar import LaserScan, ScanBatch
from platoontraffic.vehicles.motion import Drive, Twist
from platoontraffic.vehicles.records import row

# What a law may declare in `needs`, and is then given in `Sensed`: its route, the next stop line, the order to lead;
# its predecessor without errors, or by messages; with one of these also the platoon's leader, or all its members.
NEEDS = frozenset({"route", "signals", "leads", "truth", "messages", "leader", "members"})
MAX_HEADWAY = 60.0  # longest time headway of a law [s]


class Law:
    """A control law: a frozen dataclass of its gains that turns what n vehicles sense into their commands.

    It is a function: equal `sensed` and memory give equal decisions, and it changes neither. What it declares beside
    `__call__` has these defaults.
    """

    needs: frozenset[str] = frozenset()  # of NEEDS or sensors: what it is given beside scan, own motion and body
    lidar: str | None = None  # the lidar preset, where a scenario names none; None: the paper's
    further_lidars: Mapping[str, str] = MappingProxyType({})  # presets of more lasers, by their names, as `lidar`
    coarsest: float = math.inf  # its lidar must have beams that are nearer to each other than that [rad]
    native: bool = False  # SUMO's own driver model drives, by the law's gains max_speed [m/s] and speed_factor alone
    imperfection: float = 0.5  # of that driver: SUMO's sigma, 0 to 1
    vehicle_type: Mapping[str, str] = MappingProxyType({})  # of that driver: attributes of SUMO's vehicle type
    overtakes: bool = True  # that driver
    controller: str | None = None  # of that driver, if its type is of SUMO's car-following model CC
    hardest_braking: float = math.inf  # it never brakes harder [m/s2]
    distance_from: Literal["laser", "bumper"] = "laser"  # the own point from which `desired_distance` counts
    drives_alone: bool = False  # it drives its route when it has no predecessor, so it can be given manoeuvres

    @property
    def heeds_lines(self) -> bool:
        """It stops at every closed line at which it can: what others count on."""
        return "signals" in self.needs

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        """The decision of n vehicles, one row each.

        memory : of the last decision; None at the first
        dt     : since the last decision [s]
        """
        raise NotImplementedError

    def desired_distance(self, speed: np.ndarray) -> np.ndarray:
        """Distance to the predecessor's rear that it keeps at steady speeds [m], (n,); NaN: none.

        It counts from the point that `distance_from` names.
        """
        return np.full(np.shape(speed), np.nan)

    def linear(self, speed: float, place: int) -> Linear | None:
        """The law for small deviations from a steady speed [m/s]; None: it declares none.

        place: number of vehicles to the leader
        """
        return None

    def looks_along(self, speed: float) -> float:
        """Distance from which it slows for bends and limits of its route at a speed [m]; inf: any.

        The route that it is given may end there, beyond what its laser sees.
        """
        return math.inf

    def remembered_path(self, memory: Any) -> np.ndarray | None:
        """The path that it remembers to drive, to be recorded and drawn; None if it remembers none.

        returns: points as seen from the driven axle, x forward, y to the left [m], (n, k, 2); NaN where there are fewer
        """
        return None

    def braking_for(self, memory: Any) -> BrakingFor | None:
        """What limited the speed at the last decision, for the reasons of events; None: the law does not say."""
        return None

    def off_trail(self, memory: Any, rows: np.ndarray) -> Any:
        """The memory after some of its vehicles have left their predecessors' trails, to drive their own routes.

        rows: of the memory, (m,)
        """
        return memory


class Linear(NamedTuple):
    """What a law commands for small deviations from steady driving: the sum of these gains times each, filtered.

    The filter is lag u' + u = sum; what is known of other members is that of the feed. Units are those of an
    acceleration; a gain of a law that commands a speed has one 1/s less.
    """

    gap: float = 0.0  # [1/s2]
    speed: float = 0.0  # own [1/s]
    acceleration: float = 0.0  # own [1]
    ahead_speed: float = 0.0  # of the predecessor [1/s]
    ahead_acceleration: float = 0.0  # [1]
    ahead_demand: float = 0.0  # [1]
    leader_gap: float = 0.0  # [1/s2]
    leader_speed: float = 0.0  # [1/s]
    leader_acceleration: float = 0.0  # [1]
    member_gap: float = 0.0  # to each member between predecessor and leader [1/s2]
    lag: float = 0.0  # [s]
    commands: Literal["acceleration", "speed"] = "acceleration"


class BrakingFor(NamedTuple):
    """What limits the speed of n vehicles, arrays (n,)."""

    reason: np.ndarray  # an index of BRAKES_FOR
    bearing: np.ndarray  # from the laser's forward direction to the return that it brakes for [rad]; NaN: none
    creeps: np.ndarray  # past something that has not moved for long, bool


BRAKES_FOR = ("", "predecessor", "obstacle", "line", "lost", "beside")


class Body(NamedTuple):
    """A vehicle's own size: floats, or arrays (n,)."""

    length: np.ndarray  # of the footprint [m]
    width: np.ndarray
    axle: np.ndarray  # the driven one, ahead of the centre [m]; negative: behind it
    turning_radius: np.ndarray  # of the driven axle's path at full lock [m]; 0: it turns on the spot
    curvature_rate: np.ndarray  # greatest rate at which steering changes the curvature [1/(m s)]; inf: at once
    steering_lag: np.ndarray  # of that, first order [s]; 0: none
    drive_lag: np.ndarray  # of the drive's acceleration, first order [s]
    brake_lag: np.ndarray  # of the brakes [s]
    hardest_braking: np.ndarray  # [m/s2]; inf: it stops at once


class RouteAhead(NamedTuple):
    """The given route from the driven axle on, as k points: rows (n, ...), or one vehicle's row."""

    distance: np.ndarray  # of the points, along the route [m], (n, k); from 0 on, close together at first
    points: np.ndarray  # as seen from the driven axle, x forward, y to the left [m], (n, k, 2)
    limit: np.ndarray  # of speed, from each point on [m/s], (n, k)
    curvature: np.ndarray  # of the route, to the left [1/m], (n, k)
    aside: (
        np.ndarray
    )  # of the route from the lane on which it began, to the left, by lane changes until there [m], (n, k)


CLOSED_BY = (
    "",
    "light",
    "right of way",
    "lane change",
    "no room behind the junction",
    "stop sign",
    "people on the crossing",
    "letting another vehicle in",
)


class Signals(NamedTuple):
    """The next stop line on the given route: rows (n,), or one vehicle's row."""

    distance: np.ndarray  # from the front bumper [m]; inf: there is none
    open: np.ndarray  # light, right of way and the queue behind the junction let this vehicle pass now, bool
    minor: np.ndarray  # it has to give way there; closed until within 2.5 of its lengths, where it looks, bool
    changing: np.ndarray  # closed (yellow), but a vehicle that cannot stop in comfort may pass, bool
    reason: np.ndarray  # why it is closed, or would be: an index of CLOSED_BY


class Neighbour(NamedTuple):
    """Another member as it is known to n vehicles, arrays (n,), or to one; k members, (n, k). NaN: not known."""

    gap: np.ndarray  # from the own front bumper to its rear bumper, straight [m]; negative: beside or behind
    relative_speed: np.ndarray  # its speed minus the own [m/s]
    speed: np.ndarray  # [m/s]
    acceleration: np.ndarray  # [m/s2]
    demand: np.ndarray  # the acceleration that it last commanded [m/s2]
    age: np.ndarray  # of all that [s]; its position is that of now, if it kept its speed since
    lost: np.ndarray  # there is none, or nothing is known of it any more, bool


class Known(NamedTuple):
    """The members ahead as they are known to n vehicles, or to one. None: the law does not need them."""

    predecessor: Neighbour
    leader: Neighbour | None
    place: np.ndarray  # number of vehicles from the leader, int (n,)
    members: Neighbour | None = None  # all k members on the road, (n, k); lost: itself, and those of other platoons
    ahead: np.ndarray | None = None  # number of vehicles to each of them, int (n, k); negative: behind


@dataclass(frozen=True)
class Sensed:
    """What a law is given: rows (n, ...), or one vehicle's row.

    Route, signals, leads, truth, messages and readings only if it declares them in `needs`.
    """

    scan: ScanBatch | LaserScan | None  # None only for a law with a sensor that is faster than its laser
    speed: np.ndarray  # own, by odometry [m/s], (n,)
    yaw_rate: np.ndarray  # own, to the left [rad/s], (n,)
    body: Body | None = None
    route: RouteAhead | None = None
    signals: Signals | None = None
    leads: np.ndarray | None = None  # ordered to follow no vehicle, bool (n,)
    scans: Mapping[str, ScanBatch | LaserScan] = field(
        default_factory=dict
    )  # of the further lasers that are due, by their names
    readings: Mapping[str, Any] = field(
        default_factory=dict
    )  # of the scenario's own sensors that are due, by their names; records (n, ...)
    age: float = 0.0  # of the scan: time since its last beam was measured [s]
    odometry_age: float = 0.0  # of speed and yaw rate [s]
    ages: Mapping[str, float] = field(default_factory=dict)  # of the scans of all further lasers, by their names [s]
    truth: Known | None = None  # without errors
    messages: Known | None = None  # as of the last message that has arrived

    def row(self, i: int) -> Sensed:
        """What one vehicle senses: a `LaserScan` and floats."""
        return Sensed(
            self.scan and self.scan[i],
            float(self.speed[i]),
            float(self.yaw_rate[i]),
            row(self.body, i),
            row(self.route, i),
            row(self.signals, i),
            None if self.leads is None else bool(self.leads[i]),
            {name: scan[i] for name, scan in self.scans.items()},
            {name: row(reading, i) for name, reading in self.readings.items()},
            self.age,
            self.odometry_age,
            self.ages,
            row(self.truth, i),
            row(self.messages, i),
        )


class Target(NamedTuple):
    """What a law takes for its predecessor: floats or arrays (n,); NaN where it sees none."""

    distance: np.ndarray  # from the laser [m]
    bearing: np.ndarray  # from the laser's forward direction, to the left [rad]

    def replaced(self, rows: Sequence[np.ndarray], given: Sequence[Target]) -> Target:
        """A copy with each of the given targets, (m,), in its rows, (m,)."""
        distance, bearing = self.distance.copy(), self.bearing.copy()
        for where, one in zip(rows, given, strict=True):
            distance[where], bearing[where] = one
        return Target(distance, bearing)


NO_TARGET = Target(np.nan, np.nan)


class Decision(NamedTuple):
    """A command, what to remember, and what was taken for the predecessor, from which lock-on is measured.

    The memory is None, or arrays, lists, NamedTuples or dataclasses of them, with one row for each vehicle: the rows of
    vehicles that arrive are taken out.
    """

    command: Twist | Drive
    memory: Any = None
    target: Target = NO_TARGET


def per_vehicle(law: Callable) -> Callable:
    """Lift a law's `__call__` written for one vehicle (a `LaserScan`, floats) to rows."""

    @wraps(law)
    def over_rows(self, sensed: Sensed, memory, dt: float) -> Decision:
        rows = range(len(sensed.speed))
        memories = memory or [None] * len(rows)
        decisions = [law(self, sensed.row(i), memories[i], dt) for i in rows]
        for decision in decisions:
            _check_for_one(decision)
        commands = [d.command for d in decisions]
        if len(kinds := {type(command) for command in commands}) > 1:
            names = " and ".join(sorted(kind.__name__ for kind in kinds))
            raise TypeError(f"gives {names} to vehicles at once; must be one kind of command")
        return Decision(
            type(commands[0])(*np.array(commands, dtype=float).T),
            [d.memory for d in decisions],
            Target(*np.array([d.target for d in decisions], dtype=float).T),
        )

    return over_rows


def _check_for_one(decision: Any) -> None:
    """raises: TypeError if it is not the decision of one vehicle, a command and a target with one number each"""
    try:
        sound = isinstance(decision.command, Twist | Drive) and np.shape(decision.command) == (2,)
        sound = sound and np.shape(decision.target) == (2,)
    except (AttributeError, ValueError):  # no Decision; arrays beside numbers
        sound = False
    if not sound:
        what = "a Decision of a Twist, or a Drive, and a Target, of two numbers each"
        raise TypeError(f"gives {decision!r:.200} to one vehicle; must be {what}")
