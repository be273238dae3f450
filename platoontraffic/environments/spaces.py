"""Spaces, observations and commands of members that learn. SI and radians, in the frame of the vehicle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Space

from platoontraffic.episodes.episodes import COMMANDS, Facts, Frame, Seat

# Least and greatest values of another member: gap [m], relative speed, speed [m/s], acceleration and its demand [m/s2],
# age [s], and whether it is lost.
OTHER = (-1e4, -200, -200, -100, -100, 0, 0), (1e4, 200, 200, 100, 100, 1e4, 1)


def action_space(facts: Facts, seat: Seat) -> Box:
    """The command, (2,): forward speed [m/s] and yaw rate [rad/s], or acceleration [m/s2] and curvature [1/m]."""
    return Box(np.float32(seat.low), np.float32(seat.high), dtype=np.float32)


def observation_space(facts: Facts, seat: Seat) -> Space:
    """As of `observation`."""
    lidar, learn = seat.lidar, facts.learn
    near, far = np.float32(lidar.range_min), np.float32(lidar.range_max)
    speed, yaw_rate = np.float32(seat.most)
    if learn.observation == "dict":
        return Dict(
            ranges=Box(near, far, (lidar.samples,), np.float32),
            speed=Box(-speed, speed, (1,), np.float32),
            yaw_rate=Box(-yaw_rate, yaw_rate, (1,), np.float32),
            **{name: Box(np.float32(OTHER[0]), np.float32(OTHER[1]), dtype=np.float32) for name in facts.known},
        )
    if learn.observation == "scan":
        low, high = [near] * learn.sectors, [far] * learn.sectors
    else:
        first, last = np.float32(lidar.angle_min), np.float32(lidar.angle_max)
        half = np.float32(np.pi / 2)
        low = [0, 0, first, first, first, -half, 0, 0]
        high = [1, far, last, last, last, half, 1, 1]
    return Box(np.float32([*low, -speed, -yaw_rate]), np.float32([*high, speed, yaw_rate]), dtype=np.float32)


def observation(space: Space, seat: Seat, frame: Frame, row: int) -> Any:
    """What the member of a row observes.

    A dictionary: `ranges`, of the laser's beams from right to left [m]; nothing there, or a lost return: range_max;
    nearer than range_min: range_min. `speed` [m/s] and `yaw_rate`, to the left [rad/s], as its odometry has them. Or a
    vector: the inputs of the law "policy" (`controllers.policy`).

    Where the seat needs them, the dictionary also has other members, `truth` or `messages`, and `..._leader`, (7,): the
    fields of `controllers.law.Neighbour`; 0 where one is not known, and 1 for `lost`.
    """
    if isinstance(space, Box):
        return np.clip(frame.own[row].astype(np.float32), space.low, space.high)
    box = space["ranges"]
    ranges = np.fmin(frame.ranges[row], box.high)  # where it is NaN, fmin gives the other one
    np.maximum(ranges, box.low, out=ranges)
    own, most = frame.own[row], seat.most
    speed, yaw_rate = (np.array([min(max(v, -top), top)], np.float32) for v, top in zip(own, most, strict=True))
    others = {
        name: np.clip(np.nan_to_num(values[row]).astype(np.float32), space[name].low, space[name].high)
        for name, values in frame.known.items()
    }
    if not frame.here[row]:
        for other in others.values():
            other[-1] = 1.0
    return {"ranges": ranges, "speed": speed, "yaw_rate": yaw_rate, **others}


def command_of(facts: Facts, seat: Seat, action: Any) -> tuple[float, float]:
    """The two values of the command of an action; beyond the limits of the space they are the nearest within them.

    raises: ValueError
    """
    given = np.asarray(action)
    if given.shape != (2,) or given.dtype.kind not in "iuf":
        names = ", ".join(COMMANDS[facts.command]._fields)
        raise ValueError(f"{seat.id}: action {action!r}: must be two numbers ({names}), an array of shape (2,)")
    first, second = map(float, given.tolist())
    if not (math.isfinite(first) and math.isfinite(second)):
        names = ", ".join(COMMANDS[facts.command]._fields)
        raise ValueError(f"{seat.id}: action {action!r}: must be finite ({names})")
    return min(max(first, seat.low[0]), seat.high[0]), min(max(second, seat.low[1]), seat.high[1])
