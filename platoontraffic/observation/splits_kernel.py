"""Which followers are split off at one step; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.world import events
from platoontraffic.world.events import SPLIT_AFTER, SPLIT_GAP_FACTOR, SPLIT_GAP_MARGIN

BEGINS, ENDS = 1, 2  # changes of a follower's state

compiled = compiler(__file__, events.__file__)


class State(NamedTuple):
    """The arrays of `Splits`, (N,)."""

    scale: np.ndarray
    split: np.ndarray
    left_behind: np.ndarray
    begun: np.ndarray
    apart_since: np.ndarray
    follows: np.ndarray
    here: np.ndarray


@compiled
def update(time, number, predecessor, native, locked, gap, desired_gap, state, changes):
    """Bring the state up to date with a step, and fill in the changes, (n,): 0, BEGINS or ENDS.

    time        : [s]
    number      : of each member on the road, (n,); predecessor and native likewise
    locked      : as in `Locks`, (N,)
    gap, desired_gap : (n,) [m], NaN where there is none
    state       : the fields of State
    returns     : whether there are changes
    """
    state, changed = State(*state), False
    for i in range(len(number)):
        k, follows = number[i], predecessor[i] >= 0
        if follows and not state.follows[k] and state.here[k]:  # it was on the road: it has to join first
            state.split[k], state.begun[k] = True, time
        state.follows[k], state.here[k] = follows, True

        margin = SPLIT_GAP_MARGIN * state.scale[k]
        longest = max(SPLIT_GAP_FACTOR * desired_gap[i], desired_gap[i] + margin)  # NaN if the law names no distance
        # SUMO's drivers do not follow a vehicle, but a road.
        apart = follows and not native[i] and (not locked[k] or gap[i] - longest > 0)
        if not apart:
            state.apart_since[k] = math.nan
        elif math.isnan(state.apart_since[k]):
            state.apart_since[k] = time
        changes[i] = 0
        if apart and not state.split[k] and time - state.apart_since[k] > SPLIT_AFTER - 1e-6:
            state.split[k], state.begun[k], changes[i] = True, state.apart_since[k], BEGINS
        elif not apart and state.split[k]:
            state.split[k], changes[i] = False, ENDS
        changed |= changes[i] != 0
        near = gap[i] <= (margin if math.isnan(longest) else longest)
        state.left_behind[k] = state.split[k] and follows and not near
    return changed
