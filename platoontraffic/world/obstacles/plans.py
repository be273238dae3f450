"""Plans of obstacles: the motion of each kind, a function of time or, for a cut-in, integrated over the run's steps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers import idm
from platoontraffic.geometry.polyline import Polyline
from platoontraffic.world.fleet import Fleet
from platoontraffic.world.obstacles.path_line import PathLine, SpeedProfile
from platoontraffic.world.traffic import TrafficSnapshot

TIME_ROUNDING = 1e-9  # tolerance for comparing times of steps [s]
CLEARANCE = 0.5  # distance that a cut-in keeps from the predecessor's rear, whatever its share of the gap [m]
REMOVED_AFTER = 1.0  # time after a cut-in vehicle has left again until it is removed [s]

# The Intelligent Driver Model (Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805).
HEADWAY, STANDING_GAP = 1.0, 2.0  # [s], [m]
ACCELERATION, COMFORTABLE_BRAKING, HARDEST_BRAKING = 1.5, 2.0, 8.0  # [m/s2]
LOOK_AHEAD = 80.0  # distance within which a driver looks for vehicles ahead [m]
LATERAL_CLEARANCE = 0.2  # a vehicle this close beside the own strip counts as ahead [m]


class Pose(NamedTuple):
    """Pose of a footprint's centre, and forward speed."""

    x: float
    y: float
    heading: float
    speed: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Plan(ABC):
    """The motion of one obstacle: `moved` advances its state by a step, `pose` gives its pose in that state."""

    id: str
    kind: str
    length: float
    width: float
    since: float = 0.0  # time when it appears [s]
    until: float = math.inf  # time when it is removed [s]
    edges: tuple[str, ...] = ()  # intended route, known to SUMO's drivers

    @property
    def seen_by_sumo(self) -> bool:
        """Robots are not: their lab networks have no SUMO-driven vehicles."""
        return self.kind != "robot"

    def moved(self, state: Any, time: float, before: TrafficSnapshot | None, fleet: Fleet, dt: float) -> Any:
        """The state at `time`, from the state dt earlier; None before the first instant.

        before : all traffic dt earlier; None at the first instant
        fleet  : the members at `time`
        """
        return state

    @abstractmethod
    def pose(self, state: Any, time: float) -> Pose | None:
        """The pose at `time`, in the state of that time; None where the obstacle is not present."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Lying(Plan):
    """An object that does not move."""

    x: float
    y: float
    heading: float

    def pose(self, state: Any, time: float) -> Pose | None:
        return Pose(self.x, self.y, self.heading, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Driving(Plan):
    """A vehicle that drives along a path at a prescribed speed, whatever is ahead of it."""

    path: PathLine
    station: float  # of its centre when it appears [m]
    lateral: float  # to the left of the path [m]
    speed: SpeedProfile  # over the time since it appears

    def pose(self, state: Any, time: float) -> Pose | None:
        station = self.station + self.speed.distance(time - self.since)
        if not self.path.closed and station > self.path.length:
            return None
        return Pose(*self.path.pose(station, self.lateral, self.length), self.speed.at(time - self.since))


@dataclass(frozen=True, eq=False, kw_only=True)
class Patrol(Plan):
    """A robot that drives round a closed line, which may go there and back; it turns on the spot, at once."""

    line: Polyline
    speed: float  # [m/s]

    def pose(self, state: Any, time: float) -> Pose | None:
        station = self.speed * (time - self.since) % self.line.length
        k = int(np.searchsorted(self.line.stations, station, side="right")) - 1
        (x, y), step = self.line.at(np.array([station]))[0], self.line.points[k + 1] - self.line.points[k]
        return Pose(float(x), float(y), math.atan2(step[1], step[0]), self.speed)


@dataclass(frozen=True)
class MemberNear:
    """The event that a member's front bumper comes near a station on its path."""

    member: str
    within: float  # distance along the path [m]
    path: PathLine
    station: float  # [m]

    def occurs(self, fleet: Fleet, dt: float) -> bool:
        """Whether the member is within the distance before the station, or has passed it in the last dt [s]."""
        if (row := row_of(fleet, self.member)) is None:
            return False
        here, _ = self.path.project(fleet.motion.x[row], fleet.motion.y[row])
        left = self.path.ahead(here, self.station) - fleet.model.length[row] / 2
        return -fleet.motion.speed[row] * dt <= left <= self.within


@dataclass(frozen=True, eq=False, kw_only=True)
class Crossing(Plan):
    """A pedestrian that waits at a kerb and then walks straight across. The state is the time of setting out."""

    start: tuple[float, float]
    end: tuple[float, float]
    speed: float  # [m/s]
    sets_out: float | None = None  # [s]; None: at the event
    at_event: MemberNear | None = None

    def moved(self, state: Any, time: float, before: TrafficSnapshot | None, fleet: Fleet, dt: float) -> float:
        if state is None:
            state = math.inf if self.sets_out is None else self.sets_out
        if state == math.inf and self.at_event and self.at_event.occurs(fleet, dt):
            return time
        return state

    def pose(self, state: Any, time: float) -> Pose | None:
        (x0, y0), (x1, y1) = self.start, self.end
        whole, walked = math.hypot(x1 - x0, y1 - y0), self.speed * max(time - state, 0.0)
        if walked >= whole:
            return None
        share, heading = walked / whole, math.atan2(y1 - y0, x1 - x0)
        return Pose(x0 + share * (x1 - x0), y0 + share * (y1 - y0), heading, self.speed if time >= state else 0.0)


@dataclass(frozen=True)
class TargetGap:
    """The gap between two members into which a vehicle cuts in, and its place in it when it begins to change lanes."""

    follower: str
    predecessor: str
    share: float = 0.5  # place of the vehicle's middle in the gap, from the follower's front
    relative: float = 0.0  # speed relative to that place [m/s]


@dataclass(frozen=True)
class LaneChange:
    """A lane change over a lateral distance s (q) = 10 q^3 - 15 q^4 + 6 q^5, and perhaps another one back.

    The profile has no lateral speed and no lateral acceleration at either end.
    """

    starts: float  # [s]
    lasts: float  # [s]
    offset: float  # of the first lane, to the left of the members' line [m]
    returns_after: float = math.inf  # the start [s]

    @property
    def ends(self) -> float:
        """Time when the vehicle is back on the first lane [s]."""
        return self.starts + self.returns_after + self.lasts

    def at(self, time: float) -> tuple[float, float]:
        """Offset to the left of the members' line [m], and its rate [m/s]."""
        since = time - self.starts
        if since > self.returns_after:
            q, sign = min((since - self.returns_after) / self.lasts, 1.0), 1.0
        else:
            q, sign = min(max(since / self.lasts, 0.0), 1.0), -1.0
        moved, rate = q * q * q * (10 + q * (6 * q - 15)), 30 * (q * (1 - q)) ** 2 / self.lasts
        return self.offset * (moved if sign > 0 else 1 - moved), sign * self.offset * rate


@dataclass(frozen=True)
class Braking:
    """Prescribed braking of a vehicle that has cut in."""

    after: float = math.inf  # the start of the lane change [s]
    rate: float = 4.0  # deceleration [m/s2]
    last_speed: float = 0.0  # [m/s]


class CutInState(NamedTuple):
    """State of a vehicle that cuts in."""

    station: float  # of its centre [m]
    speed: float  # [m/s]
    follower: float | None  # station of the follower at the last instant [m]; None: not known yet
    predecessor: float | None
    given_up: str = ""  # reason why the cut-in does not take place


@dataclass(frozen=True, eq=False, kw_only=True)
class CuttingIn(Plan):
    """A vehicle that drives beside a gap, changes lanes into it, and then keeps behind the vehicle ahead.

    Beside the gap its middle approaches its place in it at the relative speed, and is there when the lane change
    starts. It then keeps its speed unless it has to brake. After the lane change it drives by the Intelligent Driver
    Model with exact measurements, and brakes no harder than comfortably unless more is needed. It keeps CLEARANCE from
    the predecessor, whatever its share; where the gap is shorter than the vehicle, it gives up and is removed.
    """

    path: PathLine
    gap: TargetGap
    lane_change: LaneChange
    braking: Braking

    def moved(
        self, state: Any, time: float, before: TrafficSnapshot | None, fleet: Fleet, dt: float
    ) -> CutInState | None:
        if time < self.since - TIME_ROUNDING or (state and state.given_up):
            return state
        if state is None or time < self.lane_change.starts + dt - TIME_ROUNDING:
            return self._beside(state, time, fleet)
        return self._drives(state, time - dt, before, dt)

    def pose(self, state: CutInState | None, time: float) -> Pose | None:
        if state is None or state.given_up or time > self.lane_change.ends + REMOVED_AFTER:
            return None
        if not self.path.closed and state.station > self.path.length:
            return None
        offset, drift = self.lane_change.at(time)
        x, y, heading = self.path.pose(state.station, offset, self.length)
        return Pose(x, y, heading + math.atan2(drift, max(state.speed, abs(drift), 1.0)), state.speed)

    def _beside(self, state: CutInState | None, time: float, fleet: Fleet) -> CutInState:
        """The state beside the gap, before the lane change."""
        rows = row_of(fleet, self.gap.follower), row_of(fleet, self.gap.predecessor)
        if None in rows:
            return _given_up(f"{self.gap.follower} or {self.gap.predecessor} is not on the road")
        near = (state.follower, state.predecessor) if state else (None, None)
        follower, predecessor = (
            self.path.project(fleet.motion.x[row], fleet.motion.y[row], station)[0]
            for row, station in zip(rows, near, strict=True)
        )
        speed, length = fleet.motion.speed[list(rows)], fleet.model.length[list(rows)]
        gap = self.path.ahead(follower, predecessor) - length.mean()
        if time > self.lane_change.starts - TIME_ROUNDING and gap < self.length:
            return _given_up(f"the gap is {gap:.2f} m, it is {self.length:g} m long")
        share, relative = self.gap.share, self.gap.relative
        place = min(share * gap, gap - self.length / 2 - CLEARANCE)
        middle = follower + length[0] / 2 + place + relative * min(time - self.lane_change.starts, 0.0)
        return CutInState(middle, max(speed[0] + share * (speed[1] - speed[0]) + relative, 0.0), follower, predecessor)

    def _drives(self, state: CutInState, time: float, before: TrafficSnapshot, dt: float) -> CutInState:
        """The state dt after `time`, from the start of the lane change on."""
        gap, ahead = self._ahead(state, before)
        own, since = state.speed, time - self.lane_change.starts
        closing = max(own - ahead, 0.0)
        needed = closing**2 / (2 * max(gap - STANDING_GAP / 2, 0.1))
        wanted = float(idm.desired_gap(own, own - ahead, STANDING_GAP, HEADWAY, ACCELERATION, COMFORTABLE_BRAKING))
        free = idm.free_road(own, max(self.path.limit(state.station), 0.1))
        acceleration = idm.acceleration(wanted, max(gap, 0.1), ACCELERATION, free)
        acceleration = max(acceleration, -COMFORTABLE_BRAKING)
        if since < self.lane_change.lasts - TIME_ROUNDING:
            acceleration = 0.0
        if needed > COMFORTABLE_BRAKING:
            acceleration = -min(needed, HARDEST_BRAKING)
        speed = max(own + acceleration * dt, 0.0)
        if since > self.braking.after - TIME_ROUNDING:
            speed = min(speed, max(own - self.braking.rate * dt, min(self.braking.last_speed, own)))
        return state._replace(station=state.station + (own + speed) / 2 * dt, speed=speed)

    def _ahead(self, state: CutInState, before: TrafficSnapshot) -> tuple[float, float]:
        """Gap to the next vehicle ahead [m] and its speed [m/s]; inf and 0 where there is none."""
        offset, _ = self.lane_change.at(before.time)
        x, y, _ = self.path.pose(state.station, offset, self.length)
        near = np.hypot(before.x - x, before.y - y) < LOOK_AHEAD
        gap, speed = math.inf, 0.0
        for i in np.flatnonzero(near):
            if before.ids[i] == self.id:
                continue
            station, aside = self.path.project(before.x[i], before.y[i], state.station + 30.0)
            ahead = self.path.ahead(state.station, station)
            # During the lane change the predecessor, in the lane ahead, counts as well.
            beside = abs(aside - offset)
            if before.ids[i] == self.gap.predecessor:
                beside = min(abs(aside), beside)
            if ahead > 0 and beside < (self.width + before.width[i]) / 2 + LATERAL_CLEARANCE:
                between = ahead - (self.length + before.length[i]) / 2
                if between < gap:
                    gap, speed = between, float(before.speed[i])
        return gap, speed


def _given_up(reason: str) -> CutInState:
    return CutInState(0.0, 0.0, None, None, reason)


def row_of(fleet: Fleet, name: str) -> int | None:
    """The row of a member; None where it is not on the road."""
    return next((i for i, member in enumerate(fleet.members) if member.id == name), None)
