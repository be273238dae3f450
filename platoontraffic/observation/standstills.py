"""Members that stand still for long, and why."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import shapely

from platoontraffic.observation.hindrances import Hindrances
from platoontraffic.observation.limits import Limits
from platoontraffic.observation.locks import Locks
from platoontraffic.observation.step import Cause, Step
from platoontraffic.observation.thresholds_kernel import all_move
from platoontraffic.vehicles.motion import FULL_SIZE
from platoontraffic.world.events import STANDSTILL_AFTER, Event
from platoontraffic.world.traffic import TrafficSnapshot

ALONG = math.cos(math.radians(45))  # cosine of the angle up to which a body stands along the path, not across it
PASSING = 1.0  # speed above which a vehicle drives past another one that stands [m/s]
STANDING, TURNING = 0.01, 0.01  # speed and yaw rate up to which a vehicle stands still [lengths a second, rad/s]


class Standstills:
    """State of all members of the run, by their number: arrays (N,)."""

    def __init__(self, n: int, locks: Locks, hindrances: Hindrances, limits: Limits) -> None:
        self._locks, self._hindrances, self._limits = locks, hindrances, limits
        self._since = np.full(n, np.nan)  # [s]; NaN: it moves
        self._noted = np.zeros(n, dtype=bool)  # there was an event of its present standstill
        self._all_move = True  # one step before

    def observe(self, step: Step) -> Iterator[Event]:
        """standstill when one has lasted STANDSTILL_AFTER, standstill_end when that one ends"""
        number, motion = step.fleet.number, step.fleet.motion
        moving = np.empty(number.size, dtype=bool)
        limits, length = (STANDING, TURNING), step.fleet.model.length
        all_moved, self._all_move = self._all_move, all_move(motion.speed, motion.yaw_rate, length, limits, moving)
        if all_moved and self._all_move:
            return
        since, noted = self._since[number], self._noted[number]
        since = np.where(np.isnan(since) & ~moving, step.traffic.time, since)
        began = ~moving & ~noted & (step.traffic.time - since > STANDSTILL_AFTER)
        for i in began.nonzero()[0]:
            cause = self._cause(step, i) or self._hindrances.after(number[i], since[i])
            detail = f"since {since[i]:.3f} s" + (cause.detail and f", {cause.detail}")
            yield step.event("standstill", i, what=cause.what, detail=detail)
        for i in (moving & noted).nonzero()[0]:
            yield step.event("standstill_end", i, duration=step.traffic.time - since[i])
        self._since[number] = np.where(moving, np.nan, since)
        self._noted[number] = ~moving & (noted | began)

    def _cause(self, step: Step, row: int) -> Cause:
        number, ahead = step.fleet.number[row], step.fleet.predecessor[row]
        hindrance = self._hindrances.now(number)
        reason, body = self._limits.reason(number), self._limits.body(number)
        by_body = reason == "predecessor" or (reason == "obstacle" and not _drives(step.traffic, body))
        if hindrance and not (hindrance.what == "held" and by_body):  # a body is nearer than the closed line
            return hindrance
        if self._limits.known[number] and (cause := self._by_law(step, row)):
            return cause
        if hindrance:
            return hindrance
        if blocking := _vehicle_ahead(step.traffic, row):
            return Cause("behind", f"behind {blocking}")
        if ahead >= 0 and not self._locks.locked[number]:
            return Cause("lost", f"has lost {step.traffic.ids[ahead]}")
        return Cause()

    def _by_law(self, step: Step, row: int) -> Cause:
        """What its law brakes for; a body across its path is found by its beam."""
        number, ahead = step.fleet.number[row], step.fleet.predecessor[row]
        reason, body = self._limits.reason(number), self._limits.body(number)
        if reason == "obstacle" and body in step.traffic.ids:
            aside = step.traffic.heading[step.traffic.ids.index(body)] - step.traffic.heading[row]
            return (
                Cause("behind", f"behind {body}") if math.cos(aside) > ALONG else Cause("blocked", f"blocked by {body}")
            )
        if reason == "obstacle" and body:
            return Cause("blocked", f"blocked by a {body}")
        if reason == "predecessor":
            target = self._locks.target[number]
            name = step.traffic.ids[ahead] if ahead >= 0 and self._locks.locked[number] else target
            return Cause("behind", f"behind {name}") if name else Cause()
        if reason == "lost" and ahead >= 0:
            return Cause("lost", f"has lost {step.traffic.ids[ahead]}")
        return Cause()


def _drives(traffic: TrafficSnapshot, body: str) -> bool:
    """Whether it is a vehicle that drives past, and does not keep another one at a stand."""
    return body in traffic.ids and traffic.speed[traffic.ids.index(body)] > PASSING


def _vehicle_ahead(traffic: TrafficSnapshot, row: int) -> str:
    """The nearest vehicle straight ahead, within one length of a car or three of a robot; "": none."""
    cos, sin = math.cos(traffic.heading[row]), math.sin(traffic.heading[row])
    length, side = traffic.length[row], np.array([-sin, cos]) * traffic.width[row] / 2
    front = np.array([traffic.x[row] + length / 2 * cos, traffic.y[row] + length / 2 * sin])
    reach = np.array([cos, sin]) * (length if length >= FULL_SIZE else 3 * length)
    strip = shapely.Polygon([front - side, front + side, front + reach + side, front + reach - side])
    boxes = shapely.polygons(traffic.boxes().corners())
    met = [k for k in np.flatnonzero(shapely.intersects(boxes, strip)) if k != row and not traffic.are_apart(row, k)]
    ahead = [(traffic.x[k] - front[0]) * cos + (traffic.y[k] - front[1]) * sin for k in met]
    return traffic.ids[met[int(np.argmin(ahead))]] if met else ""
