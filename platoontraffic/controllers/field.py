"""What the field's controllers share: what feeds them, and the steering. Only their longitudinal laws differ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from platoontraffic.controllers import tracking
from platoontraffic.controllers.law import BrakingFor, Decision, Known, Law, Neighbour, Sensed
from platoontraffic.controllers.path import LINE
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.vehicles.motion import Drive

# The law `acc` behind a lost radio: time headway [s], distance gain [1/s], gap at rest [m].
FALLBACK = 1.5, 0.1, 2.0


Feed = Literal["scan", "truth", "messages", "radar"]


class Own(NamedTuple):
    """The own vehicle, arrays (n,)."""

    speed: np.ndarray  # [m/s]
    acceleration: np.ndarray  # by the model of its drive line [m/s2]
    length: np.ndarray  # [m]


class Memory(NamedTuple):
    steering: tracking.Memory
    command: np.ndarray  # last acceleration [m/s2], (n,)


@dataclass(frozen=True)
class FieldLaw(Law):
    """A controller of the literature. It sets the acceleration; the law `tracking` steers, along the predecessor's path
    or its own route, and stops at lines.

    feed            What it knows of the members ahead: "scan", the predecessor as `tracking` estimates it by the laser;
                    "truth", without errors; "messages"; or "radar", gap and relative speed without errors, and the
                    rest by messages. All else is the same.
    on_radio_loss   What it does while the messages that it needs stay away: "laser", the same law by the laser, with
                    the predecessor in the leader's place; "headway", the law `acc` by the laser; "hold", it keeps its
                    speed.

    While it knows no predecessor it accelerates as `tracking` does. Its acceleration is kept within
    `steering.acceleration_mps2` and `steering.hardest_braking_mps2`; nothing else limits it, and nothing else brakes.
    """

    feed: Feed = "scan"
    on_radio_loss: Literal["laser", "headway", "hold"] = "laser"
    steering: TrackingFollower = field(default_factory=TrackingFollower)  # gains of the law that steers

    lidar: ClassVar[str] = "car-tracker"
    distance_from: ClassVar[str] = "bumper"
    uses_leader: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.uses_leader and self.feed == "scan":
            raise ValueError('feed = "scan": the laser does not measure the leader; must be "messages" or "truth"')

    def demand(self, own: Own, known: Known, last: np.ndarray, dt: float) -> np.ndarray:
        """Acceleration by the longitudinal law [m/s2], (n,).

        last : that of the last decision [m/s2], (n,)
        """
        raise NotImplementedError

    @property
    def needs(self) -> frozenset[str]:
        fed = {"scan": (), "truth": ("truth",), "messages": ("messages",), "radar": ("truth", "messages")}[self.feed]
        return self.steering.needs.union(fed, ("leader",) if self.uses_leader else ())

    @property
    def further_lidars(self) -> Mapping[str, str]:
        return self.steering.further_lidars

    @property
    def coarsest(self) -> float:
        return self.steering.coarsest

    @property
    def drives_alone(self) -> bool:
        return self.steering.drives_alone

    @property
    def heeds_lines(self) -> bool:
        return self.steering.heeds_lines

    @property
    def hardest_braking(self) -> float:
        return self.steering.hardest_braking

    def remembered_path(self, memory: Memory) -> np.ndarray:
        return self.steering.remembered_path(memory.steering)

    def braking_for(self, memory: Memory) -> BrakingFor:
        return memory.steering.braking_for

    def off_trail(self, memory: Memory, rows: np.ndarray) -> Memory:
        return memory._replace(steering=self.steering.off_trail(memory.steering, rows))

    def __call__(self, sensed: Sensed, memory: Memory | None, dt: float) -> Decision:
        steered = self.steering(sensed, memory and memory.steering, dt)
        drives, remembered = steered.command, steered.memory
        own = Own(remembered.odometry.speed, remembered.drive_line.acceleration, sensed.body.length)
        last = own.acceleration if memory is None else memory.command
        demand = self._fed(sensed, own, by_scan(sensed, remembered, own), last, dt)
        demand = np.where(np.isnan(demand), drives.acceleration, demand)
        limit = remembered.braking_for
        stops = (limit.reason == LINE) | limit.creeps
        demand = np.where(stops, np.minimum(demand, drives.acceleration), demand)
        # Behind a gap that is too short for it, `tracking` brakes for the predecessor, by more than for a line.
        by_line = ~stops & (remembered.for_lines < demand)
        demand = np.where(by_line, remembered.for_lines, demand)
        demand = np.clip(demand, -self.steering.hardest_braking, self.steering.acceleration)
        limit = limit._replace(reason=np.where(by_line, LINE, limit.reason))
        remembered = remembered._replace(acceleration=demand, braking_for=limit)
        return Decision(Drive(demand, drives.curvature), Memory(remembered, demand), steered.target)

    def _fed(self, sensed: Sensed, own: Own, scanned: Known, last: np.ndarray, dt: float) -> np.ndarray:
        """By what feeds it [m/s2], (n,); NaN: it knows no predecessor."""
        if self.feed == "scan":
            return self.demand(own, scanned, last, dt)
        if self.feed == "truth":
            return self.demand(own, sensed.truth, last, dt)
        received = sensed.messages
        if self.feed == "radar":
            seen = sensed.truth.predecessor
            ahead = received.predecessor._replace(gap=seen.gap, relative_speed=seen.relative_speed, speed=seen.speed)
            received = received._replace(predecessor=ahead)
        lost = received.predecessor.lost | (received.leader.lost if self.uses_leader else False)
        demand = self.demand(own, received, last, dt)
        if not lost.any():
            return demand
        instead = {
            "laser": lambda: self.demand(own, scanned, last, dt),
            "headway": lambda: constant_headway(own, scanned.predecessor, *FALLBACK),
            "hold": lambda: np.where(received.place > 0, 0.0, np.nan),  # the first one holds nothing
        }[self.on_radio_loss]()
        return np.where(lost, instead, demand)


def by_scan(sensed: Sensed, remembered: tracking.Memory, own: Own) -> Known:
    """The predecessor by the laser, also in the leader's place; its acceleration stands for what it commands."""
    (distance, speed, acceleration), n = remembered.predecessor, len(own.speed)
    mount = sensed.scan.model.mount.x
    gap = distance - (own.length / 2 - mount)
    age = np.full(n, sensed.age)
    ahead = Neighbour(gap, speed - own.speed, speed, acceleration, acceleration, age, np.isnan(gap))
    return Known(ahead, ahead, np.ones(n, int))


def constant_headway(own: Own, ahead: Neighbour, headway: float, gain: float, standstill: float) -> np.ndarray:
    """The law `acc` [m/s2], (n,). headway [s], gain [1/s], gap at rest [m]"""
    error = ahead.gap - standstill - headway * own.speed
    return (ahead.relative_speed + gain * error) / headway


def filtered(value: np.ndarray, last: np.ndarray, lag: float, dt: float) -> np.ndarray:
    """A step of the filter lag u' + u = value, exact for a value that is constant in it."""
    return value + (last - value) * np.exp(-dt / lag)
