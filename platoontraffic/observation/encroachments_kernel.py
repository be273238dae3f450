"""Post-encroachment times, from where bodies were lately. Compiled.

A trail is where a body was in the last steps. The second of two bodies enters the trail of the first; at any place of
both the post-encroachment time is that at which the second comes minus that at which the first left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.observation import nearby_kernel
from platoontraffic.observation.nearby_kernel import in_cells, nearby, sort_few

HALVINGS = 12  # of a step, to find the instant within it
CLOSED = -1.0  # in place of a time: nothing is looked for any more while the second stays in the trail
NO_ROOM = -1  # in place of a number of encroachments
ROUNDING = 1e-6  # more than errors of rounding [m]

# Columns of a pose: centre [m], of the heading, length of the path so far [m], for how many steps it had been there.
X, Y, COS, SIN, ARC, STILL = range(6)
# Of the straight end of a trail: the pose in which it begins, as above; least and greatest distance of later ones along
# it [m]; their number.
LEAST, MOST, STEPS = range(4, 7)
ASIDE, TURNED = 0.15, 0.03  # poses of a straight end are no farther beside its line [m], nor turned farther from it

compiled = compiler(__file__, nearby_kernel.__file__)


class Trails(NamedTuple):
    """Of S bodies. Rings of K steps, in which `head` is now and the one before it one step ago."""

    poses: np.ndarray  # columns X to STILL, which are read together, (S, K, 6)
    ends: np.ndarray  # columns X to SIN and LEAST to STEPS, (S, 7)
    count: np.ndarray  # steps for which the body has been there, (S,) int
    longest: np.ndarray  # longest way in one step [m], (S,)
    half_length: np.ndarray  # (S,) [m]
    half_width: np.ndarray


class Meetings(NamedTuple):
    """Pairs of a member and another body of which the second is in the first's trail, up to P of each of M members.

    A row of the last three is of a member, and holds its pairs in any order.
    """

    count: np.ndarray  # pairs, (M,) int
    pair: np.ndarray  # 2 times the column of the other body; plus 1 where the member is the first, (M, P) int
    entered: np.ndarray  # length of the second's path when it entered the trail [m], (M, P)
    least: np.ndarray  # post-encroachment time until now [s], inf, or CLOSED, (M, P)

    @classmethod
    def none(cls, members: int, pairs: int) -> Meetings:
        """Room for so many."""
        shape = members, pairs
        return cls(np.zeros(members, np.intp), np.empty(shape, np.intp), np.empty(shape), np.empty(shape))


@compiled
def follow(trails, before, now, head, dt, slot, x, y, cos, sin, seat, platoon, found):
    """Add where bodies are now to the trails, then `meet`; arguments as there. cos, sin: of their headings, (N,)"""
    extend(Trails(*trails), head, slot, x, y, cos, sin)
    return meet(trails, before, now, head, dt, slot, x, y, seat, platoon, found)


@compiled
def extend(trails, head, slot, x, y, cos, sin):
    """Add where bodies are now; slot: column of each, (N,)."""
    rows = trails.poses.shape[1]
    for i in range(len(slot)):
        s, before = slot[i], (head - 1) % rows
        way = 0.0
        last, pose = trails.poses[s, before], trails.poses[s, head]
        pose[X], pose[Y], pose[COS], pose[SIN] = x[i], y[i], cos[i], sin[i]
        stands = trails.count[s] > 0
        if stands:
            way = math.hypot(x[i] - last[X], y[i] - last[Y])
            trails.longest[s] = max(trails.longest[s], way)
            pose[ARC] = last[ARC] + way
            for k in range(ARC):
                stands = stands and pose[k] == last[k]
        else:
            trails.longest[s] = pose[ARC] = 0.0
        pose[STILL] = last[STILL] + 1 if stands else 0.0
        _extend_straight(trails.ends[s], trails.count[s] == 0, pose)
        trails.count[s] += 1


@compiled
def _extend_straight(end, is_first, pose):
    """Add a pose to the straight end of a trail, or begin a new one with it."""
    dx, dy, cos, sin = pose[X] - end[X], pose[Y] - end[Y], end[COS], end[SIN]
    along, aside, turned = dx * cos + dy * sin, dy * cos - dx * sin, pose[SIN] * cos - pose[COS] * sin
    ahead = pose[COS] * cos + pose[SIN] * sin > 0.0
    if is_first or not (ahead and abs(aside) <= ASIDE and abs(turned) <= TURNED):
        end[X], end[Y], end[COS], end[SIN] = pose[X], pose[Y], pose[COS], pose[SIN]
        end[LEAST] = end[MOST] = end[STEPS] = 0.0
        return
    end[LEAST], end[MOST], end[STEPS] = min(end[LEAST], along), max(end[MOST], along), end[STEPS] + 1


@compiled
def meet(trails, before, now, head, dt, slot, x, y, seat, platoon, found):
    """Look at every pair of a member and another body, which is of no platoon or of another one.

    trails  : the fields of Trails
    before  : those of Meetings, of the last step; now: those of this step, filled in
    slot    : column of each body in trails, members first, (N,); x, y: where they are now [m], (N,)
    seat    : row of each member in Meetings, (n,); platoon: of each, (n,)
    found   : rows of member and body, 1 where the member was first, and post-encroachment time, (capacity, 4)
    returns : how many were found; NO_ROOM where a member meets more bodies than there is room for
    """
    trails, before, now = Trails(*trails), Meetings(*before), Meetings(*now)
    n, count, bodies = len(seat), 0, len(slot)
    length, radius, old_x, old_y = np.empty(bodies), np.empty(bodies), np.empty(bodies), np.empty(bodies)
    longest = widest = 0.0
    for k in range(bodies):
        s = slot[k]
        oldest = trails.poses[s, _oldest(trails, head, s)]
        length[k] = trails.poses[s, head, ARC] - oldest[ARC]
        old_x[k], old_y[k] = oldest[X], oldest[Y]
        radius[k] = math.hypot(trails.half_length[s], trails.half_width[s])
        longest, widest = max(longest, length[k]), max(widest, radius[k])
    cells = in_cells(x, y)
    near = np.empty(bodies, np.intp)
    for i in range(n):
        a, now.count[seat[i]] = slot[i], 0
        met = 0
        for k in near[: nearby(x[i], y[i], cells, radius[i] + widest + longest, near)]:
            reach = radius[i] + radius[k] + max(length[i], length[k])
            if abs(x[k] - x[i]) > reach or abs(y[k] - y[i]) > reach:
                continue
            if k >= n or (k > i and platoon[k] != platoon[i]):
                near[met] = k
                met += 1
        sort_few(near[:met])
        for k in near[:met]:
            b = slot[k]
            for is_first in range(2):
                one, other = (k, i) if is_first else (i, k)  # the second, the first
                pair = 2 * b + is_first
                # A column that is new has been another body's.
                new = trails.count[a] < 2 or trails.count[b] < 2
                p = -1 if new else _find(before, seat[i], pair)
                ends = (x[other], y[other]), (old_x[other], old_y[other])
                beside = _beside((x[one], y[one]), ends, length[other] + 2 * (radius[i] + radius[k]))
                if beside and p < 0:
                    continue
                second, first = (b, a) if is_first else (a, b)
                entered = before.entered[seat[i], p] if p >= 0 else math.nan
                least = before.least[seat[i], p] if p >= 0 else CLOSED
                time, is_in, entered, least = _met(trails, head, dt, second, first, p >= 0, entered, least)
                if is_in:
                    if now.count[seat[i]] == now.pair.shape[1]:
                        return NO_ROOM
                    last = seat[i], now.count[seat[i]]
                    now.pair[last], now.entered[last], now.least[last] = pair, entered, least
                    now.count[seat[i]] += 1
                if time >= 0.0 and count < len(found):
                    found[count, 0], found[count, 1], found[count, 2], found[count, 3] = i, k, is_first, time
                    count += 1
    return count


@compiled
def _find(meetings, row, pair):
    """Where a pair is in a row of Meetings; -1: it is not."""
    for p in range(meetings.count[row]):
        if meetings.pair[row, p] == pair:
            return p
    return -1


@compiled
def _beside(place, ends, length):
    """Whether a body is beside every place of a trail, by an ellipse about that: the way from one end of a path over
    any place of it to the other end is no longer than the path."""
    (new_x, new_y), (old_x, old_y) = ends
    new_x, new_y, old_x, old_y = new_x - place[0], new_y - place[1], old_x - place[0], old_y - place[1]
    return math.sqrt(new_x * new_x + new_y * new_y) + math.sqrt(old_x * old_x + old_y * old_y) > length


@compiled
def _met(trails, head, dt, second, first, was_in, entered, least):
    """The post-encroachment time of a pair, once the second has entered the first's trail by its own width; or else
    CLOSED. Then whether the second is in that trail, and what is remembered of it if it is.

    was_in         : it was so one step before
    entered, least : what was remembered; as in Meetings
    """
    body = _pose(trails, head, second)
    age = _newest(trails, head, body, first)
    if age < 0:
        return _finished(least), False, entered, CLOSED
    if not was_in:
        entered = trails.poses[second, head, ARC]
        # From behind, over the trail's end: it follows. One that is long or slow also ends there for those that cross.
        oldest = _pose(trails, _oldest(trails, head, first), first)
        behind = _overlap(body, oldest) and _head_alike(body, oldest)
        least = CLOSED if behind or trails.count[second] < 2 else math.inf
    if age == 0:  # a contact is no encroachment
        least = CLOSED
    if least == CLOSED:
        return CLOSED, True, entered, CLOSED
    if was_in and trails.poses[second, head, ARC] - entered > 2.0 * trails.half_width[second]:
        return _finished(least), True, entered, CLOSED
    return CLOSED, True, entered, min(least, _time_between(trails, head, dt, second, first, age))


@compiled
def _finished(least):
    return least if least < math.inf else CLOSED


@compiled
def _time_between(trails, head, dt, second, first, age):
    """From when the first left the last place that the second has now, to when the second came there [s].

    age: of the first's newest pose that overlaps the second [steps], 1 or more
    """
    rows = trails.poses.shape[1]
    now, before = _pose(trails, head, second), _pose(trails, (head - 1) % rows, second)
    old, new = _pose(trails, (head - age) % rows, first), _pose(trails, (head - age + 1) % rows, first)
    left, gone = 0.0, 1.0  # shares of the step from old to new: it overlaps, it does not
    for _ in range(HALVINGS):
        middle = (left + gone) / 2
        if _overlap(now, _between(old, new, middle)):
            left = middle
        else:
            gone = middle
    leaving = _between(old, new, left)
    came, apart = 1.0, 0.0  # shares of the step from before to now
    for _ in range(HALVINGS):
        middle = (came + apart) / 2
        if _overlap(_between(before, now, middle), leaving):
            came = middle
        else:
            apart = middle
    return dt * max(age - left - (1.0 - came), 0.0)


@compiled
def _newest(trails, head, body, first):
    """Age of the newest pose of a trail that overlaps a body [steps]; -1: none does."""
    rows = trails.poses.shape[1]
    touching = math.hypot(body[4], body[5]) + math.hypot(trails.half_length[first], trails.half_width[first])
    age, ages = 0, min(trails.count[first], rows)
    if not _overlap(body, _around_end(trails, first)):
        age = 1 + int(trails.ends[first, STEPS])
    while age < ages:
        row = head - age if head >= age else head - age + rows
        dx, dy = trails.poses[first, row, X] - body[0], trails.poses[first, row, Y] - body[1]
        squared = dx * dx + dy * dy
        if squared <= touching * touching:
            if _overlap(body, _pose(trails, row, first)):
                return age
            age += 1 + int(trails.poses[first, row, STILL])
            continue
        away = math.sqrt(squared) - touching
        if trails.longest[first] * ages < away:  # the whole trail is farther away
            return -1
        age += max(int(away / trails.longest[first]), 1)  # the poses until it may be near
    return -1


@compiled
def _around_end(trails, s):
    """A box about the body of a trail in all poses of its straight end, as of `_pose`."""
    end, half_length, half_width = trails.ends[s], trails.half_length[s], trails.half_width[s]
    middle = (end[LEAST] + end[MOST]) / 2
    return (
        end[X] + middle * end[COS],
        end[Y] + middle * end[SIN],
        end[COS],
        end[SIN],
        (end[MOST] - end[LEAST]) / 2 + half_length + TURNED * half_width + ROUNDING,
        ASIDE + half_width + TURNED * half_length + ROUNDING,
    )


@compiled
def _oldest(trails, head, s):
    """Row of the oldest pose of a trail."""
    rows = trails.poses.shape[1]
    return (head - min(trails.count[s], rows) + 1) % rows


@compiled
def _pose(trails, row, s):
    """x, y, cos, sin of the heading, half of length and width."""
    pose = trails.poses[s, row]
    return pose[X], pose[Y], pose[COS], pose[SIN], trails.half_length[s], trails.half_width[s]


@compiled
def _between(old, new, share):
    """A pose between two of one body."""
    cos, sin = old[2] + share * (new[2] - old[2]), old[3] + share * (new[3] - old[3])
    size = math.hypot(cos, sin)
    x, y = old[0] + share * (new[0] - old[0]), old[1] + share * (new[1] - old[1])
    return x, y, cos / size, sin / size, old[4], old[5]


@compiled
def _head_alike(a, b):
    """Whether two poses head in one direction, to 60 degrees."""
    return a[2] * b[2] + a[3] * b[3] > 0.5


@compiled
def _overlap(a, b):
    """Whether two boxes have a place in common: their shadows on the axes of both do."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    along, cross = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])
    return (
        abs(dx * a[2] + dy * a[3]) < a[4] + along * b[4] + cross * b[5]
        and abs(dy * a[2] - dx * a[3]) < a[5] + cross * b[4] + along * b[5]
        and abs(dx * b[2] + dy * b[3]) < b[4] + along * a[4] + cross * a[5]
        and abs(dy * b[2] - dx * b[3]) < b[5] + cross * a[4] + along * a[5]
    )
