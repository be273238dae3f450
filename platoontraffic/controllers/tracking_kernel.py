"""The law `tracking` after its estimate: steering and following, and what limits them, compiled; rows (n,)."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.controllers import path, steering
from platoontraffic.controllers.path import BESIDE, LINE, LOST, OBSTACLE, PREDECESSOR
from platoontraffic.controllers.tracker import bends_kernel, own_motion, records
from platoontraffic.controllers.tracker.bends_kernel import BRAKING, acceleration_along, acceleration_in
from platoontraffic.controllers.tracker.own_motion import STILL
from platoontraffic.controllers.tracker.records import ACCELERATION, CUTS_IN, OVERHANG, SPEED
from platoontraffic.lidar.compiled import compiler

compiled = compiler(
    __file__, path.__file__, steering.__file__, bends_kernel.__file__, own_motion.__file__, records.__file__
)

FIRM = 1.0  # deceleration by which a standing car is held [m/s2]
STANDING = 0.05  # speed below which it is held [m/s]
TOO_NEAR, CRAWLS = 0.3, 0.3  # nearer than that to an obstacle [m] that is slower than that [m/s] it stays
CLOSE_ENOUGH, MOVE_UP = 0.1, 0.4  # excess of distance at which it stops, and at which it moves up again [m]
APPROACH = 2.0  # deceleration by which it and its predecessor could stop while it catches up [m/s2]
STEEPEST = 0.35  # sine of the greatest angle of the return to the trail
NOTICED = 0.4  # time after which its braking shows in its measured speed [s]
OPENING = 2.0  # time in which a gap that is too short for its hardest braking is opened [s]
EMERGENCY = 0.75  # share of its hardest braking from which, if it is needed, it brakes hardest: estimates are late
ASTRAY = 0.7  # up to this offset from its route it plans for the bends of the route, beyond for those of the trail [m]

curvature_back = compiled(steering.curvature_back)


@compiled
def pursue(speed, last, body, mount, fitted, line, track, ahead, obstacle, on_route, route, gains, dt, found):
    """Fill in `tracking.Pursuit`: stages 2 to 4 of the law.

    last            : acceleration that was commanded [m/s2], (n,)
    mount           : distance of the laser ahead of the body's centre [m]
    fitted          : `tracker.fitted.Fitted`
    line            : `DriveLine`
    track, ahead    : `Track` of the predecessor now, `Ahead` of the trail
    obstacle        : `tracking.Obstacle`
    on_route        : the route is driven, not the trail, bool (n,)
    route           : offset from it [m], inf where there is none; curvature by which it is driven [1/m], (n,) each; and
                      its curvature [1/m] at distances ahead [m], (n, k) each
    gains           : `tracking.Gains`
    """
    off_route, route_curvature, route_bend, route_distance = route
    for i in range(len(speed)):
        v, reaction = speed[i], body.brake_lag[i] + dt / 2  # from a scan to the effect of the brakes
        errors = ahead.offset[i], ahead.off_heading[i]
        back = curvature_back(errors, fitted.catch_up[i], fitted.gentle[i], STEEPEST)
        curvature = route_curvature[i] if on_route[i] else ahead.curvature[i] + back

        wanted, needed = -FIRM if v < STANDING else -gains.braking / 2, math.inf
        if math.isfinite(track.blind[i]):
            their_speed, their_acceleration = track.mean[i, SPEED], track.mean[i, ACCELERATION]
            distance = ahead.length[i] - OVERHANG - (mount - body.axle[i])
            ahead_of_it = their_speed, their_acceleration
            wanted = _headway(i, v, last[i], distance, ahead_of_it, line, body, gains, dt)
            needed = _brake_for(v, distance, their_speed, np.minimum(their_acceleration, 0.0), reaction, gains)
            needed = np.minimum(needed, _open_gap(v, distance, their_speed, reaction, gains))

        blind_spot = body.length[i] / 2 - mount  # from laser to front bumper
        to_obstacle, its_speed = obstacle.free[i] + blind_spot, obstacle.speed[i]
        its_braking = np.minimum(obstacle.acceleration[i], 0.0) if its_speed > 0 else 0.0
        brake = _brake_for(v, to_obstacle, its_speed, its_braking, reaction, gains)
        if its_speed > CUTS_IN * v:  # it has cut in, and is followed before it is the predecessor
            error = to_obstacle - gains.stand_off - gains.time_headway * v
            wanted = np.minimum(wanted, (gains.distance_gain * error + its_speed - v) / gains.time_headway)
            brake = np.minimum(brake, _open_gap(v, to_obstacle, its_speed, reaction, gains))
        elif math.isfinite(its_speed) and track.blind[i] > 0:  # a predecessor that it hides is no reason to speed up
            wanted = np.minimum(wanted, 0.0)
        found.bends[i] = acceleration_in(curvature, v, gains)
        if not on_route[i]:  # `alone` plans for the bends of a route that it steers by
            # Where the trail lies on the route, its bends are the route's, which are known without errors.
            by_route = abs(off_route[i]) <= ASTRAY
            bend, there = (route_bend[i], route_distance[i]) if by_route else (ahead.bend[i], ahead.distance[i])
            planned, steepest = reaction + BRAKING * gains.braking / (2 * gains.jerk), fitted.steepest_bend[i]
            bends = acceleration_along(bend, there, v, planned, steepest, gains)
            found.bends[i] = np.minimum(found.bends[i], bends)
        found.curvature[i], found.wanted[i], found.needed[i] = curvature, wanted, np.minimum(needed, brake)


@compiled
def _headway(i, v, last, distance, predecessor, line, body, gains, dt):
    """Acceleration that keeps the time headway [m/s2]; distance: from the laser to the predecessor's rear [m]."""
    their_speed, their_acceleration = predecessor
    error, rate = distance - (gains.stand_off + gains.time_headway * v), their_speed - v
    # Faster by so much it still stops at the stand-off, if its predecessor stops by the same braking (Gipps 1981).
    fast = math.sqrt(their_speed**2 + 2 * APPROACH * np.maximum(error, 0.0)) - their_speed
    wanted = rate + np.minimum(gains.distance_gain * error, np.maximum(gains.catching_up, fast))
    wanted = wanted / gains.time_headway
    achieved = line.drive[i] - line.brake[i]
    closing = rate - gains.time_headway * achieved
    change = (their_acceleration - achieved + gains.distance_gain * closing) / gains.time_headway
    near = error < (MOVE_UP if last <= -FIRM else CLOSE_ENOUGH)
    if v < STANDING and their_speed < 2 * STANDING and near:
        return -FIRM
    return _command(line.drive[i], line.brake[i], wanted, change, body.drive_lag[i], body.brake_lag[i], dt)


@compiled
def _command(drive, brake, wanted, rate, drive_lag, brake_lag, dt):
    """The command by which the acceleration a approaches the wanted one w, which changes at a rate w' [m/s3].

    With lag T of the part that acts, a' = (w - a) / T + w', so an error of a falls as exp(-t / T), whatever w does. For
    the engine d and the brakes b, a = d - b, of lags T_d and T_b that is

        w + T_d w' - b (T_d / T_b - 1)    if it is positive,     or else    w + T_b w' - d (1 - T_b / T_d).

    A command holds for dt, so it comes dt / 2 late on the mean: w' is also added over that time.
    """
    drive_lag, brake_lag = np.maximum(drive_lag, 1e-3), np.maximum(brake_lag, 1e-3)
    by_drive = wanted + (drive_lag + dt / 2) * rate - brake * (drive_lag / brake_lag - 1)
    by_brake = wanted + (brake_lag + dt / 2) * rate - drive * (1 - brake_lag / drive_lag)
    return by_drive if by_drive > 0 else np.minimum(by_brake, 0.0)


@compiled
def _brake_for(v, distance, their_speed, their_acceleration, reaction, gains):
    """Acceleration that just keeps the margin to what is ahead [m/s2]; inf where that is not known."""
    rate = np.maximum(v - their_speed, 0.0)
    left = np.maximum(distance - gains.margin - rate * reaction, 0.01)
    needed = their_acceleration - rate**2 / (2 * left)  # while both drive
    if their_speed * rate <= -2 * left * their_acceleration and their_speed > 0:  # it stops first
        needed = v**2 * their_acceleration / (their_speed**2 - 2 * left * their_acceleration)
    return math.inf if math.isnan(needed) or distance == math.inf else needed


@compiled
def _open_gap(v, distance, their_speed, reaction, gains):
    """Acceleration that opens within OPENING the gap in which it could stop if the vehicle ahead braked as hard as it
    can itself [m/s2].

    That gap is the safe distance of S. Shalev-Shwartz, S. Shammah, A. Shashua, "On a formal model of safe and scalable
    self-driving cars", arXiv:1708.06374 (2017), definition 1; it shall not be longer than the one that is kept anyway.
    """
    further = np.maximum(v**2 - their_speed**2, 0.0) / (2 * gains.hardest_braking)  # than it, to stand
    safe = gains.margin + v * (reaction + NOTICED) + further
    kept = gains.stand_off + gains.time_headway * v
    return 2 * (distance - np.minimum(safe, kept)) / OPENING**2


@compiled
def decide(
    speed, last, drive_lag, known, never_lost, pursuit, obstacle, stop, held, routed, road, limit, gains, dt, command
):
    """Fill in acceleration and curvature of the command; `limit`, a `BrakingFor` of `alone`, becomes that of the law.

    drive_lag  : of the drive's acceleration [s], (n,)
    known      : there is a predecessor, bool (n,)
    never_lost : it drives in the trail of its first one, bool (n,)
    stop       : acceleration for closed lines [m/s2], (n,); inf: none
    held       : it waits on its lane, bool (n,)
    routed     : the route is given
    road       : `alone`: its acceleration, those for bends and sight [m/s2]; its offset from the route [m], (n,) each
    """
    alone, bends, sight, offset = road
    for i in range(len(speed)):
        wanted, needed = np.minimum(pursuit.wanted[i], pursuit.bends[i]), pursuit.needed[i]
        creeps, reason = limit.creeps[i], limit.reason[i]
        if routed:
            if creeps or not known[i]:
                wanted = alone[i]
            # A vehicle that was met on the route may go straight on where the route turns; a predecessor that is
            # through a turn accelerates.
            if not (never_lost[i] and abs(offset[i]) > ASTRAY):
                wanted = np.minimum(wanted, bends[i])
            if not never_lost[i]:  # behind its predecessor in a platoon it need not see any farther
                wanted = np.minimum(wanted, sight[i])
            if creeps and needed < 0:
                needed = np.maximum(needed, alone[i])
        # Where nothing is left to brake in, the braking that is needed is too little at a crawl.
        stays = not creeps and obstacle.free[i] < TOO_NEAR and not obstacle.speed[i] > CRAWLS
        if stays:
            wanted = np.minimum(wanted, -FIRM)
        if known[i]:
            by_obstacle = math.isfinite(obstacle.free[i]) and speed[i] < STILL and needed < 0
            reason = OBSTACLE if by_obstacle or stays else PREDECESSOR
        if stop[i] < np.minimum(wanted, needed):
            reason = LINE
        elif not (routed or known[i]):
            reason = LOST
        limit.bearing[i] = obstacle.bearing[i] if reason == OBSTACLE else math.nan
        limit.reason[i] = BESIDE if reason == PREDECESSOR and held[i] else reason

        wanted, needed = np.minimum(wanted, stop[i]), np.minimum(needed, stop[i])
        command.acceleration[i] = _comfort(speed[i], last[i], wanted, needed, drive_lag[i], gains, dt)
        most = gains.lateral_acceleration / np.maximum(speed[i], 1e-3) ** 2
        command.curvature[i] = np.minimum(np.maximum(pursuit.curvature[i], -most), most)


@compiled
def _comfort(v, last, wanted, needed, drive_lag, gains, dt):
    """The wanted acceleration within comfort; the needed one where it is harder braking [m/s2].

    A vehicle that stands does not accelerate, however hard its brakes hold it. It may set out by any command from which
    the lag of its drive makes no more than the comfortable jerk; and takes that back at once.
    """
    wanted, change = np.minimum(np.maximum(wanted, -gains.braking), gains.acceleration), gains.jerk * dt
    if v < STANDING and wanted > 0:
        wanted = np.minimum(wanted, np.maximum(gains.jerk * drive_lag, change))
    else:
        last = np.maximum(np.minimum(last, 0.0), -FIRM) if v < STANDING else np.maximum(last, -gains.braking)
        wanted = np.minimum(np.maximum(wanted, last - change), last + change)
    if needed < -EMERGENCY * gains.hardest_braking:
        return -gains.hardest_braking
    acceleration = np.minimum(wanted, needed) if needed < -gains.braking else wanted
    return np.maximum(acceleration, -gains.hardest_braking)
