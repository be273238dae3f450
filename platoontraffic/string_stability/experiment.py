"""Measured string stability: a platoon on a straight road, whose leader's acceleration is given.

The road is bare ground. All begin at the platoon's `start.speed_mps` and at the gaps that the law keeps there, so what
is measured is the disturbance alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from platoontraffic.errors import InputError
from platoontraffic.lidar import Scene
from platoontraffic.road.route import Route
from platoontraffic.scenario import Scenario
from platoontraffic.simulation import Setting, Simulation, prepare
from platoontraffic.string_stability import theory
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.fleet import Member

PERIOD = 50.0  # of the multi-sine [s]
MULTIPLES = (1, 2, 3, 4, 6, 8, 11, 15, 20, 27)  # of 1 / PERIOD: its frequencies
SETTLING = 100.0  # time of the multi-sine before the first period that counts [s]; weakly damped strings take longest
PERIODS = 3  # that count
SIZE = 0.06  # acceleration of each of its sinusoids, of a car at 20 m/s [m/s2]
FAR = 1e5  # length of the road each way [m]


class Swept(NamedTuple):
    """Frequency response of each follower's speed over its predecessor's, arrays (k, followers)."""

    frequency: np.ndarray  # [Hz], (k,)
    gain: np.ndarray  # complex, the mean of the periods
    error: np.ndarray  # standard error of the mean of |gain|
    theory: np.ndarray | None  # complex; None: the law declares no linearisation


class Norms(NamedTuple):
    """Gains of the acceleration of each follower over its predecessor's, (followers,), in one manoeuvre."""

    profile: str
    l2: np.ndarray
    linf: np.ndarray
    least_gap: np.ndarray  # [m]; bumper to bumper

    @property
    def head_to_tail(self) -> tuple[float, float]:
        """Of the last follower over the leader, L2 and L-infinity."""
        return float(self.l2.prod()), float(self.linf.prod())


class Run(NamedTuple):
    """Arrays (steps, members)."""

    time: np.ndarray  # [s], (steps,)
    speed: np.ndarray  # [m/s]
    acceleration: np.ndarray  # [m/s2]
    gap: np.ndarray  # [m], (steps, followers)


def multi_sine(time: float, size: float = SIZE) -> float:
    """Acceleration of the sum of sinusoids of equal size [m/s2], with Schroeder's phases [m/s2]."""
    k = np.arange(1, len(MULTIPLES) + 1)
    phases = -np.pi * k * (k - 1) / len(MULTIPLES)
    return float(size * np.cos(2 * np.pi * np.array(MULTIPLES) / PERIOD * time + phases).sum())


def chirp(time: float) -> float:
    """0.3 m/s2 from 0.02 to 0.5 Hz within 60 s [m/s2]."""
    return 0.3 * np.cos(2 * np.pi * (0.02 + 0.48 / 60 * time / 2) * time) if time < 60 else 0.0


# Of the leader, by name: acceleration over time [m/s2], and when all of it is over [s].
PROFILES: dict[str, tuple[Callable[[float], float], float]] = {
    "sinusoid": (lambda t: 0.5 * np.cos(2 * np.pi * 0.05 * t) if t < 60 else 0.0, 90.0),
    "chirp": (chirp, 90.0),
    "step": (lambda t: -1.0 if t < 3 else 0.0, 60.0),
    "brake": (lambda t: -6.0 if t < 2 else 0.0, 60.0),
}


def sweep(scenario: Scenario, size: float = SIZE) -> Swept:
    """The frequency response of a scenario's followers.

    size   : acceleration of each sinusoid of the leader [m/s2]
    raises : InputError
    """
    run = drive(scenario, lambda time: multi_sine(time, size), SETTLING + PERIODS * PERIOD)
    dt, (law, vehicle, interval, delay) = run.time[1] - run.time[0], _string(scenario)
    n, frequency = round(PERIOD / dt), np.array(MULTIPLES) / PERIOD
    late = run.speed[-PERIODS * n - 1 : -1].reshape(PERIODS, n, -1)
    waves = np.exp(-2j * np.pi * np.outer(MULTIPLES, np.arange(n)) / n)
    swings = waves @ (late - late.mean(axis=1, keepdims=True))
    gains = swings[:, :, 1:] / swings[:, :, :-1]
    error = np.abs(gains).std(axis=0, ddof=1) / np.sqrt(PERIODS)
    speed = float(scenario.spec.platoon[0].start.speed_mps)
    followers = scenario.spec.platoon[0].size - 1
    expected = theory.gains(law, vehicle, speed, followers, frequency, interval, delay)
    return Swept(frequency, gains.mean(axis=0), error, expected)


def norms(scenario: Scenario, profile: str) -> Norms:
    """Gains of a scenario's followers in one manoeuvre of the leader. raises: InputError"""
    at, seconds = PROFILES[profile]
    run = drive(scenario, at, seconds)
    l2 = np.sqrt((run.acceleration**2).mean(axis=0))
    linf = np.abs(run.acceleration).max(axis=0)
    return Norms(profile, l2[1:] / l2[:-1], linf[1:] / linf[:-1], run.gap.min(axis=0))


def drive(scenario: Scenario, at: Callable[[float], float], seconds: float) -> Run:
    """The first platoon of a scenario behind a leader with a given acceleration over time.

    raises: InputError where SUMO would drive, or where the platoon has no follower
    """
    members = _members(scenario)
    dt, spec = scenario.spec.run.step_s, scenario.spec
    steps = round(seconds / dt)
    setting = Setting(
        members, Scene.from_shapely(), dt, steps, scenario.seed, spec.scene.lidar_engine, channel=spec.channel
    )
    rows = []
    with Simulation(setting) as simulation:
        now = simulation.reset()
        while True:
            motion, length = now.fleet.motion, now.fleet.model.length
            gap = -np.diff(motion.x) - (length[:-1] + length[1:]) / 2
            rows.append((now.step * dt, motion.speed, motion.acceleration, gap))
            if now.ended:
                break
            now = simulation.step({members[0].id: Drive(at(now.step * dt), 0.0)})
    time, *columns = zip(*rows, strict=True)
    return Run(np.array(time), *(np.array(column) for column in columns))


def _members(scenario: Scenario) -> list[Member]:
    """The first platoon in steady driving along the x axis."""
    first = scenario.spec.platoon[0].id
    members = [m for m in prepare(scenario).members if m.platoon == first]
    if len(members) < 2:
        raise InputError(scenario.fault(("platoon", 0, "size"), "1: must be 2 or more, for a string"))
    if native := [m.id for m in members if m.law.native]:
        raise InputError(scenario.fault(("platoon", 0), f"SUMO drives {native[0]}; must have a law of the package"))
    placed, x = [], 0.0
    for m in members:
        if m.place:
            wanted = float(m.law.desired_distance(np.array([m.speed]))[0])
            behind_bumper = m.seen_ahead_of_gap if m.law.distance_from == "laser" else 0.0
            gap = scenario.spec.platoon[0].gap_m if np.isnan(wanted) else wanted - behind_bumper
            x -= gap + (m.model.length + placed[-1].model.length) / 2
        limit = np.full(2, max(m.speed, 1.0))
        route = m.route and Route.along(("road",), np.array([[-FAR, 0.0], [FAR, 0.0]]), limit)
        placed.append(replace(m, pose=(x, 0.0, 0.0), route=route))
    return placed


def _string(scenario: Scenario):
    """Law, vehicle, interval of decisions [s], and age of messages [intervals] of the first follower."""
    member, dt, channel = _members(scenario)[1], scenario.spec.run.step_s, scenario.spec.channel
    steps = max(round(1 / (member.lidar.rate * dt)), 1)
    late = np.ceil(channel.latency_s / dt - 1e-6) if channel else 0
    return member.law, member.model, steps * dt, int(np.ceil(late / steps))


def is_linear(vehicle) -> bool:
    """Whether the theory is exact: the lags of a car's drive and brakes are equal."""
    return not isinstance(vehicle, Car) or vehicle.lag == vehicle.brake_lag
