"""The motion of one robot on two driven wheels after the other, compiled: the equations of `differential`."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler
from platoontraffic.vehicles import differential_formulas

compiled = compiler(__file__, differential_formulas.__file__)

_turned_by_wheels = compiled(differential_formulas.turned_by_wheels)


@compiled
def move(motion, command, axle, wheels, left_over, mean_left_over, dt, after):
    """`DifferentialDrive.moved`

    motion         : x, y, heading, turned, speed, yaw rate, (n,) each
    command        : the fields of a twist and of a drive, (n,) each; where the drive is NaN, the twist is obeyed
    axle           : ahead of the centre [m], (n,)
    wheels         : separation, radius and greatest speed, (n,) each
    left_over      : share of a difference of speeds that is still there after dt, and its mean over dt, (n,) each
    after          : filled in: the rows of `motion`, and the acceleration, (7, n)
    """
    x, y, heading, turned, speed, yaw_rate = motion
    for i in range(len(x)):
        wanted, turning = command[0][i], command[1][i]
        if not math.isnan(command[2][i]):  # a drive's acceleration lasts one step, at its curvature, whatever the lag
            gained = command[2][i] * dt
            reached, wanted = speed[i] + gained, speed[i] + gained / (1.0 - left_over[i])
            turning = wanted * command[3][i]
            if gained < 0.0 < reached:  # `wanted` may be below 0; the curvature has the lag, and keeps its sign
                kept = yaw_rate[i] * (reached / speed[i] - 1.0)
                turning = reached * command[3][i] + kept * left_over[i] / (1.0 - left_over[i])
        wanted, turning = _turned_by_wheels(wanted, turning, wheels[0][i], wheels[1][i], wheels[2][i])
        now, mean = wanted + (speed[i] - wanted) * left_over[i], wanted + (speed[i] - wanted) * mean_left_over[i]
        turns, mean_turns = (
            turning + (yaw_rate[i] - turning) * left_over[i],
            turning + (yaw_rate[i] - turning) * mean_left_over[i],
        )
        angle = mean_turns * dt
        chord = mean * dt * np.sinc(angle / (2 * np.pi))  # numpy's sinc(x) is sin(pi x) / (pi x)
        along, onward = heading[i] + angle / 2, heading[i] + angle
        # The axle moves along the chord; the centre keeps its place before the axle.
        after[0, i] = x[i] + chord * math.cos(along) + axle[i] * (math.cos(heading[i]) - math.cos(onward))
        after[1, i] = y[i] + chord * math.sin(along) + axle[i] * (math.sin(heading[i]) - math.sin(onward))
        after[2, i] = onward - 2 * np.pi * np.ceil((onward - np.pi) / (2 * np.pi))  # as `lidar.pose.wrap`
        after[3, i], after[4, i], after[5, i] = turned[i] + angle, now, turns
        after[6, i] = (now - speed[i]) / dt
