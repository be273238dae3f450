"""Formulas of a car's demand, of which `bicycle.Car` makes its methods and `bicycle_kernel` its compiled functions.

They hold for floats and for arrays (n,); `car` is a `Car`, or a record with its fields.
"""

from __future__ import annotations

import numpy as np

from platoontraffic.vehicles.motion import Drive

CRAWL = 0.5  # speed below which a yaw rate no longer asks for more steering [m/s]


def strongest_acceleration(car, speed):
    """Greatest acceleration of the engine at a speed: constant at first, then what power p leaves over drag [m/s2].

        p / v (1 - (v / v_top)^3)

    Drag power grows with v^3 and takes all of p at v_top; above it the engine cannot hold the speed.
    """
    share = speed / car.max_speed
    return np.minimum(car.max_acceleration, car.power / np.maximum(speed, 1e-9) * (1 - share * share * share))


def drive_for(car, twist, motion):
    """The Drive that brings a car to a twist.

    acceleration : v + lag drive - brake_lag brake is the speed that would be reached if the demand ended now; its
                   rate is the demand. So it approaches the wanted speed with time constant `response`, and the
                   speed itself as through two lags in series, without overshoot unless a limit of jerk or brakes is
                   met. A negative wanted speed counts as 0.
    curvature    : yaw rate by speed, the wanted or the present one, whichever is greater: so a car that pulls away is
                   on the final circle at once, and one that brakes does not turn faster than commanded. Below CRAWL
                   the curvature fades, for a car cannot turn on the spot.
    """
    wanted = np.maximum(twist.speed, 0.0)
    run_out = car.lag * (motion.acceleration + motion.braking) - car.brake_lag * motion.braking
    acceleration = (wanted - motion.speed - run_out) / car.response
    return Drive(acceleration, twist.yaw_rate / np.maximum(np.maximum(wanted, motion.speed), CRAWL))


def within_limits(car, drive, strongest, lateral):
    """The part of a demand that engine, brakes, tyres and steering lock allow.

    strongest : `strongest_acceleration` at the present speed [m/s2]
    lateral   : present lateral acceleration [m/s2], at most the grip
    """
    tightest = np.tan(car.max_steering) / car.wheelbase
    share = np.minimum(np.abs(lateral) / car.grip, 1.0)
    hardest = np.minimum(car.max_braking, car.grip * np.sqrt(1 - share * share))
    return Drive(
        np.maximum(np.minimum(drive.acceleration, strongest), -hardest),
        np.maximum(np.minimum(drive.curvature, tightest), -tightest),
    )
