"""Measured string stability: a platoon on a straight road, whose leader's acceleration is given.

The road is bare ground. All vehicles begin at the platoon's `start.speed_mps` and at the gaps that the law keeps there,
so what is measured is the disturbance alone. A law that does not declare its gaps first drives undisturbed for SETTLING
behind a leader at constant speed.

The leader's accelerations are those for cars at FULL and above; below it they shrink in proportion to the speed, so
that no manoeuvre stops the leader. A leader that cannot drive a manoeuvre is an error: the gains would be those of
another manoeuvre than the one that is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from platoontraffic.vehicles.catalogue import FleetModel, VehicleModel
from platoontraffic.vehicles.motion import Drive, Motion
from platoontraffic.world.fleet import Member

PERIOD = 50.0  # of the multi-sine [s]
MULTIPLES = (1, 2, 3, 4, 6, 8, 11, 15, 20, 27)  # of 1 / PERIOD: its frequencies
SETTLING = 100.0  # time of the multi-sine before the first period that counts [s]; weakly damped strings take longest
PERIODS = 3  # that count
SIZE = 0.06  # acceleration of each of its sinusoids at FULL [m/s2]
FULL = 20.0  # speed from which on the leader's accelerations are not reduced [m/s]
FAR = 1e5  # length of the road each way [m]
MISSED = 1e-3  # greatest error of the leader's speed in a manoeuvre, as a share of its speed at the start
STEADY = 0.01  # greatest error of a follower's mean speed in the last 10 s of settling, likewise
UNLIMITED = 1e9  # in place of a limit, in its SI unit


class Swept(NamedTuple):
    """Frequency response of each follower's speed over its predecessor's, arrays (k, followers)."""

    frequency: np.ndarray  # [Hz], (k,)
    gain: np.ndarray  # complex, the mean of the periods
    error: np.ndarray  # standard error of the mean of |gain|
    theory: np.ndarray | None  # complex; None: there is none
    no_theory: str  # why; "": there is one
    least_gap: np.ndarray  # [m], (followers,); bumper to bumper
    left_out: np.ndarray  # frequencies that are not measured [Hz]: half the rate of decisions or above
    decisions: float  # rate of the law's decisions [Hz]


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


def multi_sine(time: float, size: float = SIZE, multiples: Sequence[int] = MULTIPLES) -> float:
    """Acceleration of the sum of sinusoids of equal size [m/s2], with Schroeder's phases [m/s2]."""
    k = np.arange(1, len(multiples) + 1)
    phases = -np.pi * k * (k - 1) / len(multiples)
    return float(size * np.cos(2 * np.pi * np.array(multiples) / PERIOD * time + phases).sum())


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


def scale(scenario: Scenario) -> float:
    """Factor on the leader's accelerations: 1 at FULL and above, below it in proportion to the platoon's speed."""
    return min(float(scenario.spec.platoon[0].start.speed_mps) / FULL, 1.0)


def check(scenario: Scenario) -> None:
    """Drive the leader alone through all manoeuvres. raises: InputError where it cannot drive one of them"""
    platoon, dt = scenario.spec.platoon[0], scenario.spec.run.step_s
    vehicle, speed, at = platoon.model(0), float(platoon.start.speed_mps), ("platoon", 0, "start", "speed_mps")
    if speed == 0:
        raise InputError(scenario.fault(at, "0: the string drives at this speed; must be above 0"))
    if missed := _missed(vehicle, speed, dt):
        low, high = 0.0, speed
        while high - low > 0.01 * speed:
            middle = (low + high) / 2
            low, high = (low, middle) if _missed(vehicle, middle, dt) else (middle, high)
        allowed = f"must be at most {0.995 * low:.3g}" if low else "no speed is slow enough"
        raise InputError(scenario.fault(at, f"{speed:g}: {missed}; {allowed}"))


def sweep(scenario: Scenario, size: float = SIZE) -> Swept:
    """The frequency response of a scenario's followers.

    size   : acceleration of each sinusoid of the leader at FULL [m/s2]
    raises : InputError
    """
    members, dt = _members(scenario), scenario.spec.run.step_s
    interval = _steps_of_decisions(members[1], dt) * dt
    multiples = [m for m in MULTIPLES if 2 * m * interval < PERIOD - 1e-9]
    size *= scale(scenario)
    run = drive(scenario, lambda time: multi_sine(time, size, multiples), SETTLING + PERIODS * PERIOD)
    n, frequency = round(PERIOD / dt), np.array(multiples) / PERIOD
    late = run.speed[-PERIODS * n - 1 : -1].reshape(PERIODS, n, -1)
    waves = np.exp(-2j * np.pi * np.outer(multiples, np.arange(n)) / n)
    swings = waves @ (late - late.mean(axis=1, keepdims=True))
    gains = swings[:, :, 1:] / swings[:, :, :-1]
    error = np.abs(gains).std(axis=0, ddof=1) / np.sqrt(PERIODS)
    expected, why = _theory(scenario, members, frequency, interval)
    left_out = np.array([m for m in MULTIPLES if m not in multiples]) / PERIOD
    least = run.gap.min(axis=0)
    return Swept(frequency, gains.mean(axis=0), error, expected, why, least, left_out, 1 / interval)


def norms(scenario: Scenario, profile: str) -> Norms:
    """Gains of a scenario's followers in one manoeuvre of the leader. raises: InputError"""
    at, seconds = PROFILES[profile]
    factor = scale(scenario)
    run = drive(scenario, lambda time: factor * at(time), seconds)
    l2 = np.sqrt((run.acceleration**2).mean(axis=0))
    linf = np.abs(run.acceleration).max(axis=0)
    return Norms(profile, l2[1:] / l2[:-1], linf[1:] / linf[:-1], run.gap.min(axis=0))


def drive(scenario: Scenario, at: Callable[[float], float], seconds: float) -> Run:
    """The first platoon of a scenario behind a leader with a given acceleration over time.

    raises: InputError where SUMO would drive, where the platoon has no follower, where the leader cannot drive so, or
            where followers that have to settle do not
    """
    members = _members(scenario)
    dt, spec, leader = scenario.spec.run.step_s, scenario.spec, members[0]
    if missed := _missed_in(leader.model, leader.speed, at, seconds, dt):
        what = f"{leader.speed:g}: the leader cannot drive as it must: {missed}"
        raise InputError(scenario.fault(("platoon", 0, "start", "speed_mps"), what))
    settling = round(SETTLING / dt) if any(np.isnan(_wanted(m)) for m in members[1:]) else 0
    setting = Setting(
        members,
        Scene.from_shapely(),
        dt,
        settling + round(seconds / dt),
        scenario.seed,
        spec.scene.lidar_engine,
        channel=spec.channel,
    )
    rows = []
    with Simulation(setting) as simulation:
        now = simulation.reset()
        while True:
            motion, length, step = now.fleet.motion, now.fleet.model.length, now.step - settling
            gap = -np.diff(motion.x) - (length[:-1] + length[1:]) / 2
            rows.append((step * dt, motion.speed, motion.acceleration, gap))
            if now.ended:
                break
            now = simulation.step({leader.id: Drive(at(step * dt) if step >= 0 else 0.0, 0.0)})
    time, speed, *others = (np.array(column) for column in zip(*rows, strict=True))
    if settling:
        _check_settled(scenario, members, speed[settling - round(10 / dt) : settling].mean(axis=0))
    return Run(*(column[settling:] for column in (time, speed, *others)))


def is_linear(vehicle: VehicleModel) -> bool:
    """Whether the theory is exact: the lags of a car's drive and brakes are equal."""
    return not isinstance(vehicle, Car) or vehicle.lag == vehicle.brake_lag


def _missed(vehicle: VehicleModel, speed: float, dt: float) -> str:
    """The first manoeuvre that a leader cannot drive from a speed [m/s]; "": it can drive all."""
    factor = min(speed / FULL, 1.0)
    manoeuvres = {"multi-sine": (multi_sine, PERIOD), **PROFILES}
    for name, (at, seconds) in manoeuvres.items():
        if missed := _missed_in(vehicle, speed, lambda time, at=at: factor * at(time), seconds, dt):
            return f"the leader cannot drive the {name}: {missed}"
    return ""


def _missed_in(vehicle: VehicleModel, speed: float, at: Callable[[float], float], seconds: float, dt: float) -> str:
    """Where a leader does not drive a given acceleration over time, or stands; "": nowhere.

    It is compared with the same vehicle without limits of engine, brakes, tyres and wheels; lags and jerk remain.
    """
    limits = ("max_acceleration", "power", "max_speed", "max_braking", "grip", "max_wheel_speed")
    free = replace(vehicle, **{name: UNLIMITED for name in limits if hasattr(vehicle, name)})
    both, still = FleetModel.of([vehicle, free]), np.zeros(2)
    motion = replace(Motion.at_rest(still, still, still), speed=np.full(2, speed))
    for k in range(round(seconds / dt)):
        motion = both.moved(motion, Drive(np.full(2, at(k * dt)), still), dt)
        found, asked = motion.speed
        if asked <= 0:
            return f"after {(k + 1) * dt:.3g} s it would stand or reverse"
        if abs(found - asked) > MISSED * speed:
            return f"after {(k + 1) * dt:.3g} s it must drive {asked:.4g} m/s and drives {found:.4g} m/s"
    return ""


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
            wanted = _wanted(m)
            behind_bumper = m.seen_ahead_of_gap if m.law.distance_from == "laser" else 0.0
            gap = scenario.spec.platoon[0].gap_m if np.isnan(wanted) else wanted - behind_bumper
            x -= gap + (m.model.length + placed[-1].model.length) / 2
        limit = np.full(2, max(m.speed, 1.0))
        route = m.route and Route.along(("road",), np.array([[-FAR, 0.0], [FAR, 0.0]]), limit)
        placed.append(replace(m, pose=(x, 0.0, 0.0), route=route))
    return placed


def _wanted(member: Member) -> float:
    """Distance that a follower's law keeps at its start speed [m]; NaN: the law declares none."""
    return float(member.law.desired_distance(np.array([member.speed]))[0])


def _check_settled(scenario: Scenario, members: Sequence[Member], speed: np.ndarray) -> None:
    """raises: InputError where a member's mean speed (n,) [m/s] is not the leader's"""
    leader = members[0].speed
    for m, own in zip(members, speed, strict=True):
        if abs(own - leader) > STEADY * leader:
            what = (f"declares no desired_distance, and after {SETTLING:g} s behind a leader at {leader:g} m/s {m.id} "
                    f"drives {own:.3g} m/s; must follow at the leader's speed")  # fmt: skip
            raise InputError(scenario.fault(("platoon", 0, "follower", "law"), what))


def _theory(
    scenario: Scenario, members: Sequence[Member], frequency: np.ndarray, interval: float
) -> tuple[np.ndarray | None, str]:
    """The expected gains (k, followers), and why there are none.

    frequency : [Hz], (k,)
    interval  : of decisions [s]
    """
    age, why = _age_of_messages(scenario, members[1])
    if why:
        return None, why
    vehicles = [m.model for m in members]
    expected = theory.gains(members[1].law, vehicles, members[0].speed, frequency, interval, age)
    return expected, "the law declares no linearisation" if expected is None else ""


def _age_of_messages(scenario: Scenario, follower: Member) -> tuple[int, str]:
    """Age of the messages at a decision [intervals of decisions], and why it is not always the same."""
    channel, dt = scenario.spec.channel, scenario.spec.run.step_s
    if channel is None or "messages" not in follower.law.needs:
        return 0, ""
    for key in ("jitter_s", "loss", "burst_loss", "range_m", "blackout"):
        if getattr(channel, key):
            return 0, f"channel.{key} is given, so the age of messages changes"
    decisions, every = _steps_of_decisions(follower, dt), round(1 / (channel.rate_hz * dt))
    late, scan_late = (int(np.ceil(delay / dt - 1e-6)) for delay in (channel.latency_s, follower.lidar.delay))
    if decisions % every:
        return 0, (f"channel.rate_hz = {channel.rate_hz:g} sends no new message for each decision, at "
                   f"{1 / (decisions * dt):g} Hz, so the age of messages changes")  # fmt: skip
    age = late + (scan_late - late) % every  # steps; a message is sent every `every`, a scan used `scan_late` after it
    if age % decisions:
        return 0, (f"messages are {age * dt:g} s old at a decision; the theory needs a multiple of the interval of "
                   f"decisions, {decisions * dt:g} s")  # fmt: skip
    return age // decisions, ""


def _steps_of_decisions(follower: Member, dt: float) -> int:
    """From one decision to the next: at the rate of the laser, or of a faster sensor of its own."""
    rate = max(follower.lidar.rate, *(one.sensor.rate for one in follower.sensors), 0.0)
    return max(round(1 / (rate * dt)), 1)
