"""The rear of a vehicle from one group of returns, compiled. Sensor frame: x forward, y left.

A group shows one face of a vehicle, as a line, or two, as a right angle; the expected heading tells which faces. Faces
are walked along from right to left, so the heading of the rear face is the vehicle's plus pi/2, that of the left side
equal to it, that of the right side the opposite.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)

REAR, LEFT, RIGHT = 0.5, 0.0, 1.0  # heading of a face less that of the vehicle [half turns]

FLOOR = 0.005  # least standard deviation of a measured distance, whatever the data sheet says [m]
FLOOR_HEADING = 0.004  # the same of a measured heading [rad]
BENT = 0.003  # rms distance of returns from a line beyond noise, from which on a corner explains them better [m]
WIDTH, WIDTH_SPREAD = 1.8, 0.15  # mean and standard deviation of the width of a vehicle not seen whole [m]
NARROWEST, WIDEST = 1.3, 2.7  # widths that a rear may have [m]
STEP = 0.2  # least depth behind an end at which the next return shows that the surface ends there [m]
ASKEW = math.radians(50)  # greatest difference of a face from the expected heading


class Group(NamedTuple):
    """One group of `records.Groups`."""

    first: int
    last: int
    count: int
    x1: float  # start: the first return, on the right
    y1: float
    x2: float  # stop: the last return, on the left
    y2: float
    line_heading: float
    line_distance: float
    line_rms: float
    corner_x: float
    corner_y: float
    leg_heading: float
    leg_right: float  # length from start to corner
    leg_left: float  # length from corner to stop
    corner_rms: float
    convex: bool


class Rear(NamedTuple):
    """A measured rear; all NaN if the group shows none."""

    x: float  # centre [m]
    y: float
    heading: float  # of the vehicle [rad]
    along: float  # variance of the centre along the heading [m2]
    across: float  # variance of the centre across the heading [m2]
    turned: float  # variance of the heading [rad2]
    width: float  # if the rear is seen whole, else NaN [m]


class End(NamedTuple):
    """One end of a face."""

    x: float
    y: float
    free: bool  # the surface ends there, hidden by nothing
    gap: float  # length along the face over which the end is uncertain [m]
    variance: float  # of the end along the face [m2]


@compiled
def remainder(angle, turn):
    return angle - turn * round(angle / turn)


@compiled
def group_of(groups, k):
    """Group k of `records.Groups`."""
    return Group(
        groups.first[k],
        groups.last[k],
        groups.count[k],
        groups.start[k, 0],
        groups.start[k, 1],
        groups.stop[k, 0],
        groups.stop[k, 1],
        groups.line_heading[k],
        groups.line_distance[k],
        groups.line_rms[k],
        groups.corner[k, 0],
        groups.corner[k, 1],
        groups.leg_heading[k],
        groups.leg_lengths[k, 0],
        groups.leg_lengths[k, 1],
        groups.corner_rms[k],
        groups.convex[k],
    )


@compiled
def no_rear():
    return Rear(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)


@compiled
def find_rear(group, expected, width, ranges, laser):
    """The rear that a group shows, if the vehicle heads about as expected.

    expected : heading of the vehicle, sensor frame [rad]
    width    : of the vehicle, where the group does not show it whole [m]
    ranges   : of the scan, (k,); NaN: lost
    laser    : `records.Laser`
    """
    error = laser.sigma + laser.sigma_per_metre * math.hypot(group.x1, group.y1)
    # A corner, if a line is not all that there is to see; noise alone bends a line that much once in a hundred.
    noisy = error * (1 + 2.5 / math.sqrt(group.count)) + BENT
    angular = group.count >= 6 and group.convex and group.line_rms > max(noisy, 2 * group.corner_rms)
    side = _side(group.leg_heading if angular else group.line_heading, expected, angular)
    if math.isnan(side):
        return no_rear()
    error2 = max(error, group.corner_rms if angular else group.line_rms) ** 2
    if angular:
        return _rear_at_corner(group, side, width, error2, ranges, laser)
    right, left = _ends(group, ranges, laser)
    if side == REAR:
        return _rear_face(group, right, left, width, error2)
    return _rear_beside(group, side, right if side == LEFT else left, width, error2)


@compiled
def _side(face, expected, angular):
    """The side of the vehicle that fits a face's heading best: REAR, LEFT or RIGHT; NaN if none does.

    A right angle is the rear and the left side, or the right side and the rear: its first leg is never the left side.
    """
    best, side = ASKEW, math.nan
    for turn in (REAR, LEFT, RIGHT):
        if angular and turn == LEFT:
            continue
        off = abs(remainder(face - turn * math.pi - expected, 2 * math.pi))
        if off < best:
            best, side = off, turn
    return side


@compiled
def _edge(ranges, beam, step, here):
    """Whether the surface ends, unhidden, beyond an end of a group; and over how many beams that is not known."""
    unknown = 1
    beam += step
    while 0 <= beam < len(ranges) and math.isnan(ranges[beam]):
        beam += step
        unknown += 1
    if not 0 <= beam < len(ranges):
        return False, unknown
    return ranges[beam] > here + STEP, unknown


@compiled
def _end(x, y, face, beam, step, ranges, increment):
    """An end of a face with this heading, as measured.

    One beam moves along the face by its distance over the cosine of the incidence. The end is equally likely anywhere
    in the gap to the next beam.
    """
    cos, sin = math.cos(face), math.sin(face)
    far = math.hypot(x, y)
    free, unknown = _edge(ranges, beam, step, far)
    across = max(abs(x * sin - y * cos), 0.1 * far) / far
    gap = unknown * increment * far / across
    return End(x, y, free, gap, gap * gap / 12 + FLOOR**2)


@compiled
def _end_on_line(group, x, y, beam, step, ranges, increment):
    """An end of a group's line: on the line, which is better known than any return, and half a gap farther out."""
    face = group.line_heading
    away_x, away_y = math.sin(face), -math.cos(face)
    off = group.line_distance - away_x * x - away_y * y
    end = _end(x + off * away_x, y + off * away_y, face, beam, step, ranges, increment)
    out = step * end.gap / 2
    return End(end.x + out * math.cos(face), end.y + out * math.sin(face), end.free, end.gap, end.variance)


@compiled
def _ends(group, ranges, laser):
    """Right and left end of a group that is a line."""
    right = _end_on_line(group, group.x1, group.y1, group.first, -1, ranges, laser.increment)
    left = _end_on_line(group, group.x2, group.y2, group.last, 1, ranges, laser.increment)
    return right, left


@compiled
def _line_variances(group, error2):
    """Variances of a line of least squares: across itself [m2], and of its heading [rad2]."""
    length = math.hypot(group.x2 - group.x1, group.y2 - group.y1)
    across = error2 / group.count + FLOOR**2
    return across, 12 * error2 / (group.count * max(length, 0.3) ** 2) + FLOOR_HEADING**2


@compiled
def _rear_face(group, right, left, width, error2):
    """A rear face alone. Its centre is half a width from an end that is free, or between the ends.

    Away from the group's middle, an error of the heading moves the centre along the heading, too.
    """
    length = math.hypot(group.x2 - group.x1, group.y2 - group.y1)
    whole = length + right.gap / 2 + left.gap / 2
    if length > WIDEST or (right.free and left.free and whole < NARROWEST):
        return no_rear()
    cos, sin = math.cos(group.line_heading), math.sin(group.line_heading)
    x, y, seen = (right.x + left.x) / 2, (right.y + left.y) / 2, math.nan
    if right.free and left.free:
        across, seen = (right.variance + left.variance) / 4, whole
    elif right.free:
        x, y = right.x + width / 2 * cos, right.y + width / 2 * sin
        across = right.variance + WIDTH_SPREAD**2 / 4
    elif left.free:
        x, y = left.x - width / 2 * cos, left.y - width / 2 * sin
        across = left.variance + WIDTH_SPREAD**2 / 4
    else:
        across = max(width - length, 0.3) ** 2 / 12
    depth, turned = _line_variances(group, error2)
    out2 = (x - (right.x + left.x) / 2) ** 2 + (y - (right.y + left.y) / 2) ** 2
    return Rear(x, y, group.line_heading - REAR * math.pi, depth + out2 * turned, across, turned, seen)


@compiled
def _rear_beside(group, side, end, width, error2):
    """A left or right side alone: the rear's corner is its near end, the centre half a width across from that."""
    if not end.free:
        return no_rear()
    heading = group.line_heading - side * math.pi
    cos, sin = math.cos(heading), math.sin(heading)
    half = width / 2 if side == LEFT else -width / 2
    depth, turned = _line_variances(group, error2)
    across = depth + WIDTH_SPREAD**2 / 4
    along = end.variance + half * half * turned
    return Rear(end.x + half * sin, end.y - half * cos, heading, along, across, turned, math.nan)


@compiled
def _rear_at_corner(group, side, width, error2, ranges, laser):
    """A right angle: one leg is the rear, from the corner to its other end; the other leg is a side.

    side : of the first leg: REAR, then the rear lies right of the corner, or RIGHT, then it lies left of it
    """
    heading = group.leg_heading - side * math.pi
    if side == REAR:
        along, toward, leg, other = group.leg_heading, -1.0, group.leg_right, group.leg_left
        end = _end(group.x1, group.y1, along, group.first, -1, ranges, laser.increment)
    else:
        along, toward, leg, other = group.leg_heading - math.pi / 2, 1.0, group.leg_left, group.leg_right
        end = _end(group.x2, group.y2, along, group.last, 1, ranges, laser.increment)
    seen = leg + end.gap / 2
    if seen > WIDEST or (end.free and seen < NARROWEST):
        return no_rear()
    if end.free:
        half, spread = seen / 2, end.gap * end.gap / 48
    else:
        half, spread, seen = width / 2, WIDTH_SPREAD**2 / 4, math.nan
    x, y = group.corner_x + toward * half * math.cos(along), group.corner_y + toward * half * math.sin(along)
    share = leg / (group.leg_right + group.leg_left)
    on_rear, on_side = max(group.count * share, 1.0), max(group.count * (1 - share), 1.0)
    inertia = on_rear * leg**2 + on_side * other**2
    turned = 12 * error2 / max(inertia, 0.1) + FLOOR_HEADING**2
    return Rear(x, y, heading, error2 / on_rear + FLOOR**2, error2 / on_side + FLOOR**2 + spread, turned, seen)
