"""The rule of `controllers.beside`, compiled; rows (n,)."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers import lane_room
from platoontraffic.controllers.lane_room import ANOTHER
from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__, lane_room.__file__)

BEGINS, ENDS = 12.0, 8.0  # speeds from which a follower looks beside, and below which it gives that up [m/s]
IN_LINE = 0.4  # lane offset from the goal up to which a follower drives in line with it [m]
WATCHED = 0.5  # the same from which the side of the goal is looked at [m]
COMMITTED = 0.6  # offset from its lane from which it goes over in any case [m]
BEFORE_PREDECESSOR = 2.0  # distance before the predecessor's axle at which the strip ends [m]
GOAL_DRIFT = 1.2  # greatest speed at which it goes after a goal that is going over itself [m/s]
STEADY, LANE_AFTER = 0.3, 1.0  # a goal that has kept within [m] for [s] drives along a lane
SURE = 0.3  # time for which there must be room before it goes over [s]
CROSSING_TIME, SHORTEST = 3.0, 20.0  # of going over [s], and its least length [m]
STANDS = 2.0  # speed of what is behind up to which nothing need be left to it [m/s]
UNTIL_CLEAR = 3.0  # where it no longer looks for room: least time until what is behind would be abreast [s]
PATIENCE = 4.0  # time that it waits for room beside what keeps pace, before it falls back [s]
SLOWER, FALLS_BACK, GENTLE = 2.0, 25.0, 1.0  # falls back: slower by [m/s], as far as [m], braking by [m/s2]
LEAVES, YIELDS_BY = 0.1, 3.5  # a slow follower that leaves its lane by that [m] stops for what is beside it [m/s2]
SOON = 2.0  # or whose trail leaves the lane within its stopping distance and so much more [m]

room_needed = compiled(lane_room.room_needed)


@compiled
def find_goals(given, follows, own, place, trails, before, dt, goals, side):
    """Fill in `beside.Goals`, and the `beside.Side` that is known before the scan.

    given   : the routes, not shifted
    follows : the goal is the predecessor, if that is beside the route, bool (n,)
    own     : lane offset [m], (n,)
    place   : of the predecessors: distance along the route, and offset from it [m], (n,) each; NaN: none
    trails  : `beside.Trails`
    before  : `beside.Beside`
    """
    station, offset = place
    for i in range(len(own)):
        there, reach = given.aside[i, 0], math.inf
        if follows[i] and math.isfinite(station[i]):
            k = max(np.searchsorted(given.distance[i], station[i], side="right") - 1, 0)
            there, reach = offset[i] + given.aside[i, k], station[i] - BEFORE_PREDECESSOR
        lane = own[i] if math.isnan(before.lane[i]) else before.lane[i]
        base = lane if math.isnan(before.stays[i]) else before.stays[i]
        away = there - base
        for place_aside in (trails.least[i], trails.greatest[i]):
            if abs(place_aside - base) > abs(away):
                away = place_aside - base
        keeps = abs(there - before.seen_at[i]) < STEADY
        goals.there[i], goals.lane[i], goals.base[i], goals.away[i], goals.reach[i] = there, lane, base, away, reach
        goals.steady_for[i] = before.steady_for[i] + dt if keeps else 0.0

        watched = math.copysign(1.0, away) if abs(away) > WATCHED else 0.0
        known = watched == before.side.side[i]
        side.side[i] = watched
        side.ahead[i] = before.side.ahead[i] if known else math.inf
        side.ahead_closing[i] = before.side.ahead_closing[i] if known else math.nan
        side.behind[i] = before.side.behind[i] if known else math.inf
        side.behind_closing[i] = before.side.behind_closing[i] if known else math.nan


@compiled
def change(before, own, goals, soon, length, speed, age, dt, after):
    """Fill in the `beside.Beside` after a scan; `after.side` is what that shows.

    own           : lane offset [m], (n,)
    soon          : the same where it would stop, by its trail [m], (n,); NaN: not known
    length, speed : own [m], [m/s], (n,)
    age           : of the scan [s]
    """
    side = after.side
    for i in range(len(own)):
        there, base, away, steady_for = goals.there[i], goals.base[i], goals.away[i], goals.steady_for[i]
        active, follows = not math.isnan(before.stays[i]), goals.reach[i] < math.inf
        held = active and math.isnan(before.driven[i])
        crossing = active and not held
        room = _room_ahead(side, i, length[i], speed[i], age) and _room_behind(side, i, length[i], speed[i], age)
        room = room and side.side[i] != 0.0
        after.room_for[i] = before.room_for[i] + dt if room else 0.0

        left = abs(own[i] - base) > COMMITTED  # its lane
        no_way = not room and not left and abs(away) > ANOTHER
        begins = not active and speed[i] > BEGINS and no_way
        aside = np.fmax((soon[i] - base) * side.side[i], (own[i] - base) * side.side[i])
        leaves = not left and abs(away) > ANOTHER and aside > LEAVES
        after.yields[i] = not active and not begins and leaves and not _is_clear(side, i)
        stops = crossing and no_way
        goes = held and after.room_for[i] > SURE - 1e-6
        back = held and abs(away) < IN_LINE
        done = crossing and before.driven[i] > before.length[i] and (steady_for > LANE_AFTER or not follows)
        ends = back or done or (active and speed[i] < ENDS and _is_clear(side, i))

        after.stays[i] = goals.lane[i] if begins else math.nan if ends else before.stays[i]
        after.driven[i] = before.driven[i] + speed[i] * dt
        if goes:
            after.driven[i] = 0.0
        if stops or begins or ends:
            after.driven[i] = math.nan
        # A predecessor that is going over itself is on no lane; in line with it, a follower still has its former one.
        in_line = abs(there - own[i]) < IN_LINE and steady_for > LANE_AFTER and not active
        after.lane[i] = own[i] if in_line or done else goals.lane[i]
        drift = GOAL_DRIFT * dt
        drifts = np.minimum(np.maximum(there - before.goal[i], -drift), drift) if crossing and follows else 0.0
        after.goal[i] = (there if follows else math.nan) if goes else before.goal[i] + drifts
        after.length[i] = np.maximum(SHORTEST, CROSSING_TIME * speed[i]) if goes else before.length[i]
        after.waits[i] = before.waits[i] + dt if held and not goes and not back else 0.0
        after.seen_at[i] = before.seen_at[i] if abs(there - before.seen_at[i]) < STEADY else there
        after.steady_for[i] = steady_for


@compiled
def slow_down(beside, length, speed, target, error, age, wanted):
    """Change wanted accelerations to those of `beside.slowed`."""
    side = beside.side
    for i in range(len(wanted)):
        if beside.yields[i]:
            wanted[i] = np.minimum(wanted[i], -YIELDS_BY)
            continue
        held = not math.isnan(beside.stays[i]) and math.isnan(beside.driven[i])
        if not (held and beside.waits[i] > PATIENCE and error[i] < FALLS_BACK):
            continue
        paced = not _room_behind(side, i, length[i], speed[i], age) and not side.behind_closing[i] > SLOWER
        slower = np.maximum(target[i] - SLOWER - speed[i], -GENTLE)
        if (paced or not _room_ahead(side, i, length[i], speed[i], age)) and math.isfinite(slower):
            wanted[i] = np.minimum(wanted[i], slower)


@compiled
def _room_ahead(side, i, length, speed, age):
    """Room before what is ahead; length, speed: own [m], [m/s]; age: of the scan [s]."""
    ahead = side.ahead[i] - side.ahead_closing[i] * age if age > 0.0 else side.ahead[i]
    return side.ahead[i] == math.inf or ahead > room_needed(length, speed, side.ahead_closing[i])


@compiled
def _room_behind(side, i, length, speed, age):
    """Room for what is behind, as `_room_ahead`."""
    closing = side.behind_closing[i]
    behind, theirs = side.behind[i] - closing * age if age > 0.0 else side.behind[i], speed + closing
    stands = behind > 0.0 and theirs < STANDS
    return side.behind[i] == math.inf or behind > room_needed(length, theirs, closing) or stands


@compiled
def _is_clear(side, i):
    """Nothing is abreast, or will soon be from behind."""
    closing = side.behind_closing[i] if side.behind_closing[i] > 0.0 else 0.0  # not known: 0
    return side.ahead[i] > 0.0 and side.behind[i] > 0.0 and not side.behind[i] < closing * UNTIL_CLEAR
