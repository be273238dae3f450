"""Frequency response of a string of vehicles with one law, by the linearisation that it declares.

Laws decide at instants of a fixed interval, and a command holds until the next one. So everything is a sequence, and
at the frequency w each is multiplied by z = exp(i w dt) from one instant to the next. A vehicle answers a command U by
position, speed and acceleration

    P = (z - Phi)^-1 Gamma U,        Phi, Gamma: exact over an interval of constant command

of x' = A x + B u, where

    a car under an acceleration     p' = v, v' = d + b, d' = (u / 2 - d) / T_drive, b' = (u / 2 - b) / T_brake
    a car under a speed             the same with (u - v - T_drive d - T_brake b) / T_response for u
    a robot under a speed           p' = v, v' = (u - v) / T
    a robot under an acceleration   as under the speed v + u dt / (1 - exp(-dt / T)), which is set once an interval

A car drives with the one lag and brakes with the other. Each of them gets half a sinusoid, of which the fundamental is
half of the whole: so the car above is the describing function about 0, and exact where the lags are equal.

With the filter F(z), the law's sum of gains times what it knows is U_i = F (own P_i + ahead D P_{i-1} + leader D P_0),
and D P_j for each member j between, if the law hears all. Each vehicle has a response P_i of its own.
The feed is D = z^-n for messages n intervals old; positions in them are carried on at the speed sent, and the command
that they have is one interval older. The gains follow one after another from the leader on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from platoontraffic.controllers.law import Law, Linear
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.vehicles.catalogue import VehicleModel

LEAST_LAG = 1e-6  # to which a lag of 0 is taken [s]


class Response(NamedTuple):
    """Of a vehicle to a command that oscillates, arrays (k,) over frequencies."""

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray


def gains(
    law: Law, vehicles: Sequence[VehicleModel], speed: float, frequencies: np.ndarray, dt: float, delay: int = 0
) -> np.ndarray | None:
    """G_i = V_i / V_{i-1} of each follower's speed over its predecessor's, (k, followers) complex.

    vehicles    : the leader's first, (followers + 1,)
    speed       : about which all drive [m/s]
    frequencies : [Hz], (k,)
    dt          : interval of the law's decisions [s]
    delay       : age of messages [intervals]

    returns: None if the law declares no linearisation
    """
    declared = [law.linear(speed, place) for place in range(1, len(vehicles))]
    if None in declared:
        return None
    z = np.exp(2j * np.pi * np.asarray(frequencies) * dt)
    of_each = {vehicle: response(vehicle, declared[0].commands, z, dt) for vehicle in set(vehicles)}
    return chain(declared, [of_each[one] for one in vehicles], z, dt, delay, getattr(law, "feed", "") == "radar")


def chain(
    declared: Sequence[Linear],
    vehicles: Sequence[Response],
    z: np.ndarray,
    dt: float,
    delay: int = 0,
    radar: bool = False,
) -> np.ndarray:
    """G_i of each follower, (k, n) complex, from the linearisation of each.

    vehicles : responses, the leader's first, (n + 1,)
    z        : (k,)
    radar    : gap and speed of the predecessor are not late
    """
    late = z**-delay
    known = [late * (one.position + delay * dt * one.speed) for one in vehicles]  # carried on at the speed sent
    p_0, v_0, a_0 = known[0], vehicles[0].speed, vehicles[0].acceleration
    over_leader, found, between = np.ones_like(z), [], []  # U_i / U_0; of members that are neither of the two
    for place, one in enumerate(declared, 1):
        (p, v, a), predecessor = vehicles[place], vehicles[place - 1]
        gap, speed = predecessor[:2] if radar else (known[place - 1], late * predecessor.speed)
        share = 1.0 if one.lag == 0 else -np.expm1(-dt / one.lag)
        filtered = share / (1 - (1 - share) / z)
        own = -(one.gap + one.leader_gap + one.member_gap * len(between)) * p + one.speed * v + one.acceleration * a
        ahead = one.gap * gap + one.ahead_speed * speed
        ahead = ahead + late * (one.ahead_acceleration * predecessor.acceleration + one.ahead_demand / z)
        leader = one.leader_gap * p_0 + late * (one.leader_speed * v_0 + one.leader_acceleration * a_0)
        members = one.member_gap * sum(between)
        follower = filtered * (ahead * over_leader + leader + members) / (1 - filtered * own)
        if place > 1:
            between.append(known[place - 1] * over_leader)
        by_command = follower / over_leader
        # Equal vehicles answer equally, without a division that would round.
        found.append(by_command if vehicles[place] is predecessor else by_command * (v / predecessor.speed))
        over_leader = follower
    return np.stack(found, axis=1)


def response(vehicle: VehicleModel, commands: str, z: np.ndarray, dt: float) -> Response:
    """Of a vehicle to its command, "acceleration" or "speed", which holds for dt [s]."""
    phi, gamma, out = _sampled(vehicle, commands, dt)
    states = np.linalg.solve(z[:, None, None] * np.eye(len(phi)) - phi, np.broadcast_to(gamma, (len(z), *gamma.shape)))
    p, v, a = (out @ states[:, :, 0].T).astype(complex)
    if not isinstance(vehicle, Car):
        a = (z - 1) / (z * dt) * v  # a robot's acceleration is the change of its speed
    return Response(p, v, a)


def greatest(law: Law, vehicle: VehicleModel, speed: float, dt: float, delay: int = 0, followers: int = 1) -> float:
    """The greatest |G| of the last of `followers` over its predecessor, over 0.002 Hz to half the rate of decisions."""
    frequencies = np.geomspace(0.002, 0.499 / dt, 4000)
    found = gains(law, [vehicle] * (followers + 1), speed, frequencies, dt, delay)
    return float(np.abs(found[:, -1]).max())


def _sampled(vehicle: VehicleModel, commands: str, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Phi, Gamma, and the matrix that gives position, speed and acceleration."""
    if isinstance(vehicle, Car):
        drive, brake = max(vehicle.lag, LEAST_LAG), max(vehicle.brake_lag, LEAST_LAG)
        a = np.zeros((4, 4))
        a[0, 1] = a[1, 2] = a[1, 3] = 1.0
        a[2, 2], a[3, 3] = -1 / drive, -1 / brake
        b = np.array([[0.0], [0.0], [0.5 / drive], [0.5 / brake]])
        if commands == "speed":
            b /= vehicle.response
            a[:, 1:] -= b * (1.0, drive, brake)
        return *_held(a, b, dt), np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1]])
    lag = max(vehicle.lag, LEAST_LAG)
    if commands == "speed":
        phi, gamma = _held(np.array([[0.0, 1.0], [0.0, -1 / lag]]), np.array([[0.0], [1 / lag]]), dt)
    else:
        reached = -np.expm1(-dt / lag)  # of a change of the speed that is set, within dt
        phi = np.array([[1.0, dt], [0.0, 1.0]])
        gamma = np.array([[dt * (dt / reached - lag)], [dt]])
    return phi, gamma, np.array([[1.0, 0], [0, 1], [0, 0]])


def _held(a: np.ndarray, b: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Phi and Gamma of x' = a x + b u over dt of constant u."""
    n = len(a)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n:] = a * dt, b * dt
    grown = _exponential(whole)
    return grown[:n, :n], grown[:n, n:]


def _exponential(matrix: np.ndarray) -> np.ndarray:
    """Of a small matrix, by scaling and squaring of its series."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 4)
    scaled, term, total = matrix / 2**halvings, np.eye(len(matrix)), np.eye(len(matrix))
    for k in range(1, 13):
        term = term @ scaled / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total
