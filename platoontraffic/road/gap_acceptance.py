"""Gap acceptance: whether a vehicle that must yield can cross before or behind another one.

As SUMO's drivers judge it (`MSLink::blockedByFoe`), with the times of vehicles as they can really drive: to go first, a
vehicle must have left the conflict area `FIRST_MARGIN` before the other one comes (SUMO's jmTimegapMinor, 1 s); to go
behind, the other must have left it before the own vehicle enters the junction, or must have entered it earlier, and
have left the area that margin before the own one comes there. One that enters later brakes for whatever is inside.
Where paths merge far beyond the line, a vehicle that waits until each one is gone finds no gap in a stream. Waiting
makes impatient over SUMO's --time-to-impatience.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

STANDING = 0.1  # speed below which a vehicle counts as standing [m/s]; also SUMO's
FIRST_MARGIN = 1.0  # between the rear of a vehicle that goes first and the other one [s]: SUMO's jmTimegapMinor
LEAST_MARGIN = 0.5  # the same of the most impatient driver [s]
BEHIND_MARGIN = 0.3  # between the rear of a vehicle that is let go first and the own front [s]
TIME_TO_IMPATIENCE = 300.0  # waiting time at a line until a driver is as impatient as can be [s]: SUMO's default
# That a vehicle which merges first may demand of the one behind [m/s2]; SUMO's drivers brake by 4.5.
MERGE_BRAKING = 2.0
# After so long at a line [s], a driver expects of one in a queue, slower than that [m/s] and so far from the line [m],
# that it keeps its speed: others are before it.
WATCHES_QUEUES_AFTER, IN_QUEUE_SPEED, IN_QUEUE_FROM = 10.0, 4.0, 15.0
# A queue that creeps past for ever leaves no gap. A driver in it lets in a vehicle that has waited for so long [s], if
# it is slower than that [m/s] and can stop so gently [m/s2], so far before the paths meet [m].
LET_IN_AFTER, LET_IN_SPEED, LET_IN_BRAKING, LET_IN_ROOM = 20.0, 4.0, 1.5, 1.0


class Driven(Protocol):
    """How the own vehicle drives on."""

    @property
    def acceleration(self) -> float:
        """Comfortable [m/s2]."""

    @property
    def at_once(self) -> Driven:
        """The same of a vehicle that begins to accelerate now."""

    def time_for(self, distance: float) -> float:
        """Time to drive a distance [m]; inf if it never does [s]."""

    def speed_after(self, time: float) -> float:
        """[m/s]"""


class Pace(NamedTuple):
    """How a vehicle drives on: at its speed for a delay, and then it accelerates up to a top speed."""

    speed: float  # [m/s]
    acceleration: float = 0.0  # [m/s2]
    top: float = 0.0  # [m/s]; a faster vehicle keeps its speed
    delay: float = 0.0  # [s]

    @property
    def at_once(self) -> Pace:
        return self._replace(delay=0.0)

    def time_for(self, distance: float) -> float:
        if distance <= 0:
            return 0.0
        speed, rate, top = self.speed, self.acceleration, max(self.top, self.speed)
        if rate <= 0 or top == speed:
            return distance / speed if speed > 0 else math.inf
        left = distance - speed * self.delay
        if left <= 0:
            return distance / speed
        to_top = (top**2 - speed**2) / (2 * rate)
        if left <= to_top:
            return self.delay + (math.sqrt(speed**2 + 2 * rate * left) - speed) / rate
        return self.delay + (top - speed) / rate + (left - to_top) / top

    def speed_after(self, time: float) -> float:
        return min(self.speed + self.acceleration * max(time - self.delay, 0.0), max(self.top, self.speed))


class Foe(NamedTuple):
    """A vehicle to be yielded to. Distances are from each vehicle's front bumper [m]; negative: passed."""

    to_enter: float  # own distance to the line, or to where it waits inside the junction
    to_conflict: float  # own distance to where the two paths meet
    to_exit: float  # own distance to where they part again
    foe_to_conflict: float
    foe_to_exit: float
    pace: Pace
    length: float
    clearing_speed: float  # at which it leaves the conflict area, if that is not more than its speed [m/s]
    merges: bool = False  # the paths do not part again
    foe_to_enter: float = math.inf  # its distance to its line; negative: it is inside; inf: it may still wait inside


def margin_after(waited: float) -> float:
    """Margin of a vehicle that goes first after it has waited for so long at its line [s]."""
    return FIRST_MARGIN + (LEAST_MARGIN - FIRST_MARGIN) * min(waited / TIME_TO_IMPATIENCE, 1.0)


def may_cross(foe: Foe, own: Driven, length: float, margin: float = FIRST_MARGIN) -> bool:
    """Whether the vehicle clears the conflict area before the foe arrives, or arrives after the foe has cleared it.

    own, length : how the vehicle drives on, and its length [m]
    margin      : if it goes first, or behind a foe that has entered before it [s]; behind one that is gone before it
                  enters at most BEHIND_MARGIN of it. 0: none at all

    A foe that stands before the conflict area and does not set out waits. It clears the area at its present speed, or
    more slowly in a bend.
    """
    if foe.to_exit + length < 0 or foe.foe_to_exit + foe.length < 0:
        return True
    pace = foe.pace
    if pace.speed < STANDING and not (pace.acceleration > 0 and foe.foe_to_conflict > 0):
        return foe.foe_to_conflict > 0  # it waits; otherwise it blocks the path
    return _is_first(foe, own, length, margin) or _is_behind(foe, own, margin)


def lets_in(foe: Foe, waited: float) -> bool:
    """Whether a foe in a slow queue lets a vehicle merge that has waited for so long at its line [s]."""
    stops_after = LET_IN_ROOM + foe.pace.speed**2 / (2 * LET_IN_BRAKING)
    may_stop = foe.pace.speed < LET_IN_SPEED and foe.foe_to_conflict > stops_after
    return foe.merges and may_stop and waited > LET_IN_AFTER


def _is_first(foe: Foe, own: Driven, length: float, margin: float) -> bool:
    past = own.time_for((foe.to_conflict if foe.merges else foe.to_exit) + length)
    if foe.pace.time_for(foe.foe_to_conflict) <= past + margin:
        return False
    if not foe.merges:
        return True
    # It is on the foe's lane from then on, its bend ends, and it accelerates: the foe need not brake hard.
    closing = max(foe.pace.speed_after(past) - own.speed_after(past), 0.0)
    away = foe.foe_to_conflict - foe.pace.speed * past
    return away > closing * margin + closing**2 / (2 * (MERGE_BRAKING + own.acceleration))


def _is_behind(foe: Foe, own: Driven, margin: float) -> bool:
    if foe.pace.speed < STANDING:
        return False  # when it will have gone is not known
    speed = max(min(foe.pace.speed, foe.clearing_speed), STANDING)
    area = foe.foe_to_exit - max(foe.foe_to_conflict, 0.0)
    left = (0.0 if foe.merges else area) + foe.length
    clears = max(foe.foe_to_conflict, 0.0) / foe.pace.speed + left / speed
    if foe.foe_to_conflict < 0:  # it is in the area, or past its begin
        clears = (foe.length + (foe.foe_to_conflict if foe.merges else foe.foe_to_exit)) / speed
    enters = own.time_for(foe.to_enter)
    is_gone = clears < enters
    enters_first = foe.foe_to_enter / foe.pace.speed + min(margin, BEHIND_MARGIN) < enters
    may_follow = enters_first and foe.pace.speed >= IN_QUEUE_SPEED
    if not (is_gone or may_follow):  # when the own one comes takes long to find
        return False
    comes = own.at_once.time_for(foe.to_conflict)
    return (is_gone and clears + min(margin, BEHIND_MARGIN) < comes) or (may_follow and clears + margin < comes)
