"""Members with a value that passes a threshold in this step; compiled.

number: of each member on the road, (n,); arrays (N,) are of all members of the run, by number; `begins`, (n,) bool, is
filled in: the value was not beyond the threshold one step before. Where it is, whether any begins is returned.
"""

from __future__ import annotations

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def brakes_hard(number, acceleration, dt, limit, full_size, before, jerk, hard, begins):
    """Members of full size that brake harder than `limit` [m/s2]; their jerk [m/s3] over the time dt [s].

    acceleration : (n,) [m/s2]; before: one step before, (N,)
    """
    any_begins = False
    for i in range(len(number)):
        k = number[i]
        if dt > 0:
            jerk[k] = (acceleration[i] - before[k]) / dt
        before[k] = acceleration[i]
        now = full_size[k] and acceleration[i] < -limit
        begins[i] = now and not hard[k]
        any_begins |= begins[i]
        hard[k] = now
    return any_begins


@compiled
def all_move(speed, yaw_rate, length, limits, moving):
    """Fill in which members move, (n,) bool, and return whether all do.

    length : of each, (n,) [m]
    limits : up to which a member stands [lengths a second, rad/s]
    """
    standing, turning = limits
    everybody = True
    for i in range(len(speed)):
        moving[i] = abs(speed[i]) > standing * length[i] or abs(yaw_rate[i]) > turning
        everybody &= moving[i]
    return everybody


@compiled
def comes_near(number, gap, least, near, begins):
    """Members with a gap, (n,), below `least`, (N,) [m]."""
    any_begins = False
    for i in range(len(number)):
        k = number[i]
        now = gap[i] < least[k]
        begins[i] = now and not near[k]
        any_begins |= begins[i]
        near[k] = now
    return any_begins
