"""One instant of a simulation: what there is, what is sensed, decided and observed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from platoontraffic.lidar import ScanBatch
from platoontraffic.observation.observer import Measures
from platoontraffic.vehicles.motion import Twist
from platoontraffic.world.events import Event
from platoontraffic.world.fleet import Fleet, Readings
from platoontraffic.world.passages import Passage
from platoontraffic.world.traffic import TrafficSnapshot
from platoontraffic.world.under_way import Seen


@dataclass(frozen=True, eq=False)
class Instant:
    """One instant: every member has sensed the same world, and its law has decided.

    Arrays (n,) of the fleet and its measures have one row a member on the road, in the order of `fleet.members`; the
    first n rows of `traffic` are the same members. SI, radians; x east, y north, headings counter-clockwise from east.
    """

    step: int  # 0 at the reset
    traffic: TrafficSnapshot  # members, then background traffic near them, then obstacles
    fleet: Fleet  # motion, commands, targets and memories of the members
    scans: Sequence[ScanBatch | None] = ()  # that the laws used, a batch for each of `fleet.groups`; None: none was due
    roads: Sequence[tuple[str, str]] = ()  # edge and lane of each member, as SUMO has them; the lane is "" off the road
    events: Sequence[Event] = ()  # since the instant before
    measure: Callable[[Fleet], Measures] | None = None  # computes `measures`
    ended: str = ""  # "arrived", "laps", "contact", "gridlock" or "duration" at the last instant
    passages: Sequence[Passage] = ()  # of vehicles at the ends of counted edges, in the last step
    readings: Sequence[Readings] = ()  # of further lasers and own sensors, for each group; (): there are none
    seen: Sequence[Seen | None] = ()  # the world at the instant of each scan, to whose traffic its hits belong
    odometry: Twist | None = None  # own speed and yaw rate that the laws used, (n,); None: those of `fleet.motion`
    whole: TrafficSnapshot | None = None  # as `traffic`, but with all background traffic; only where that is recorded

    def __repr__(self) -> str:
        """What it is in short, for notebooks."""
        others = len(self.traffic.ids) - len(self.fleet)
        return f"<Instant at {self.time:g} s: {len(self.fleet)} members, {others} others, {len(self.events)} events>"

    @property
    def time(self) -> float:
        """Since the platoons were placed [s]."""
        return self.traffic.time

    def __getstate__(self) -> dict[str, Any]:
        """For another process: measured, for it cannot be measured there."""
        measures = {"measures": self.measures} if self.measure or "measures" in vars(self) else {}
        return vars(self) | {"measure": None} | measures

    @cached_property
    def measures(self) -> Measures:
        """Measurements from outside. Computed at the first look, which must come before the next step."""
        return self.measure(self.fleet)
