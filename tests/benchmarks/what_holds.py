"""What holds: three followers of cars by radius, braking, noise, view, range and lag. Tables in Markdown.

    python tests/benchmarks/what_holds.py [--picture docs/pictures/what_holds.png] [--quick]

The paper's law as printed and repaired, in the world of `paper_at_car_size`, and `tracking` with its preset laser. No
SUMO, no walls: a leader drives a prescribed acceleration and curvature, the followers see only their scans. Some six
minutes on two free cores.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence, Set
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parents[2]))
from platoontraffic.controllers import Decision, Law, Sensed
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, LidarModel, Mount, Noise
from platoontraffic.observation.instant import Instant
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.bicycle import Car
from platoontraffic.vehicles.motion import Drive
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import Fleet, Member
from platoontraffic.world.ground import BareGround
from tests.benchmarks.paper_at_car_size import CAR, GRIP, PRINTED, QUICK, REPAIRED, SMALLEST, laser, table
from tests.support.bench import BLIND, DT, NO_WALLS, amplitude, platoon, targets

LEADER = replace(CAR, lag=0.0, brake_lag=0.0)  # steers as cars do; its acceleration is as prescribed, but for the jerk
TRACKER = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03))


class Follower(NamedTuple):
    law: Any
    eye: LidarModel
    car: Car
    step: float  # between scans [s]

    def seeing(self, view: float | None = None, reach: float | None = None, noise: Noise | None = None) -> Follower:
        """With another field of view [deg], range [m], noise. A tracker's beams stay as far apart as they are."""
        eye = self.eye
        if view is not None:
            half = math.radians(view / 2)
            samples = (
                round(2 * half / eye.angle_increment) + 1 if self.law.__class__ is TrackingFollower else eye.samples
            )
            eye = replace(eye, angle_min=-half, angle_max=half, samples=samples)
        return self._replace(
            eye=replace(eye, range_max=reach or eye.range_max, noise=eye.noise if noise is None else noise)
        )

    def wanted_gap(self, speed):
        """Bumper to bumper [m]."""
        return self.law.desired_distance(speed) - (self.car.length / 2 - self.eye.mount.x)


TRACKING = Follower(TrackingFollower(), TRACKER, CAR, 0.1)
FOLLOWERS = {
    "printed": Follower(PRINTED, laser(60.0), QUICK, DT),
    "repaired": Follower(REPAIRED, laser(60.0), QUICK, DT),
    "tracking": TRACKING,
    "tracking, no noise": TRACKING.seeing(noise=Noise()),
}
NOISY = ("tracking",)  # followers whose laser has noise
NOISE = TRACKER.noise

LOCK, BEAMS, OFF_PATH = 0.99, 5, 0.3  # share of the instants with so many beams on the predecessor; [m]
STEEPEST = 8.0  # lateral acceleration of the leader in the tightest bends tried [m/s2]
FINER = 1.15  # from a radius tried to the next
QUARTER, HALF = math.pi / 2, math.pi
JUNCTION_SPEED = 5.0
SAMPLE = 0.1  # [s]
FAR_APART = 20e3  # from a platoon to the next [m]


class Grid(NamedTuple):
    """The values that are tried."""

    speeds: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0, 30.0)  # in bends
    widest: float = 300.0  # radius
    angles: tuple[float, ...] = (QUARTER, HALF)
    braking_speeds: tuple[float, ...] = (10.0, 20.0, 25.0, 30.0)
    decelerations: tuple[float, ...] = (2.0, 4.0, 6.0, 8.0)
    repeats: int = 5  # of a run with noise
    sigmas: tuple[float, ...] = (0.0, 0.01, 0.03, 0.05, 0.1)
    dropouts: tuple[float, ...] = (0.002, 0.1, 0.3, 0.5)
    views: tuple[float, ...] = (30.0, 60.0, 90.0, 120.0, 180.0)
    junctions: tuple[float, ...] = (8.0, 12.0, 20.0)  # radii
    reaches: tuple[float, ...] = (20.0, 40.0, 60.0, 80.0, 100.0)
    straight_speeds: tuple[float, ...] = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0)
    lags: tuple[float | None, ...] = (None, 0.1, 0.3, 0.5, 0.8)  # None: as the car has
    frequencies: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5)
    followers: int = 9  # where they are many
    settling: float = 40.0  # of a string [s]
    laws: tuple[str, ...] = ("printed", "repaired", "tracking", "tracking, no noise")

    def radii(self, speed: float) -> np.ndarray:
        least = max(SMALLEST, speed**2 / STEEPEST)
        return least * FINER ** np.arange(math.ceil(math.log(self.widest / least, FINER)) + 1)


FULL = Grid()
SMOKE = Grid(
    (10.0,), 50.0, (QUARTER,), (20.0,), (4.0,), 1, (0.0, 0.03), (0.3,), (60.0, 180.0), (12.0,), (40.0,), (10.0,),
    (None,), (0.5,), 2, 10.0, ("repaired", "tracking"),
)  # fmt: skip


# --- runs: many platoons at once, each alone --------------------------------------------------------------------------


class Trial(NamedTuple):
    """A platoon behind a leader whose acceleration and curvature are a function of time."""

    follower: Follower
    speed: float
    at: Callable[[float], tuple[float, float]]
    seconds: float
    followers: int = 4
    distance: float | None = None  # from laser to rear at first; None: as the law wants it
    leader_speed: float | None = None  # at first; None: as the followers

    def members(self, number: int, leaders: Any) -> list[Member]:
        law, eye, car, step = self.follower
        distance = law.desired_distance(self.speed) if self.distance is None else self.distance
        leader, *others = platoon(
            leaders, law, self.followers, at=(0.0, number * FAR_APART, 0.0), distance=distance, model=car,
            leader_eye=replace(BLIND, rate=1 / step), eye=eye, speed=self.speed,
        )  # fmt: skip
        leader_speed = self.speed if self.leader_speed is None else self.leader_speed
        leader = replace(leader, model=LEADER, speed=leader_speed)
        return [replace(m, id=f"{number}.{m.place}", platoon=f"{number}") for m in (leader, *others)]


class Run(NamedTuple):
    """Samples, ten a second: time (k,), of the cars (k, n), of the followers (k, n - 1)."""

    trial: Trial
    time: np.ndarray
    speed: np.ndarray
    turned: np.ndarray
    axle: np.ndarray  # middle of the rear axle, (k, n, 2)
    locked: np.ndarray  # its target is a return from its predecessor
    beams: np.ndarray  # returns from its predecessor
    hit: int | None  # the follower that first touches its predecessor; the run ends there

    @property
    def lock_on(self) -> float:
        """Least share of the instants with enough beams on the predecessor, of all followers."""
        enough = self.beams >= BEAMS
        return float(np.min((self.locked & enough).sum(axis=0) / np.maximum(enough.sum(axis=0), 1)))

    def path(self, i: int) -> shapely.LineString:
        """Path of a rear axle, with a straight line before it."""
        first = self.axle[0, i] - (1000.0, 0.0)
        return shapely.LineString(np.vstack([first, self.axle[:, i]]))

    @property
    def off_path(self) -> float:
        """Greatest distance of a rear axle from the path of its predecessor [m]."""
        worst = 0.0
        for i in range(1, self.axle.shape[1]):
            path, points = self.path(i - 1), shapely.points(self.axle[:, i])
            beside = shapely.line_locate_point(path, points) < path.length
            worst = max(worst, shapely.distance(points, path)[beside].max(initial=0.0))
        return worst

    @property
    def gaps(self) -> np.ndarray:
        """Gaps along the predecessor's path, bumper to bumper [m], (k, n - 1)."""
        gaps = np.empty(self.locked.shape)
        for i in range(gaps.shape[1]):
            distance = 1000.0 + np.insert(np.cumsum(np.hypot(*np.diff(self.axle[:, i], axis=0).T)), 0, 0.0)
            own = shapely.line_locate_point(self.path(i), shapely.points(self.axle[:, i + 1]))
            gaps[:, i] = distance - own - CAR.length
        return gaps

    @property
    def gap_error(self) -> float:
        """Greatest difference from the gap that the law wants at the present speed [m]."""
        return float(np.abs(self.gaps - self.trial.follower.wanted_gap(self.speed[:, 1:])).max())


@dataclass(frozen=True)
class Leaders(Law):
    """Each leader drives by its own function of time; the memory is the index of that function."""

    at: tuple[Callable[[float], tuple[float, float]], ...]

    def __call__(self, sensed: Sensed, memory: np.ndarray | None, dt: float) -> Decision:
        which = np.arange(len(self.at)) if memory is None else memory
        return Decision(Drive(*np.array([self.at[i](sensed.scan.stamp) for i in which]).T), which)


class Parting(BareGround):
    """Bare ground; platoons whose names are put into `over` disappear with the next step."""

    over: Set[str] = frozenset()

    def advance(self, fleet: Fleet) -> Fleet:
        return super().advance(fleet).without({m.id for m in fleet.members if m.platoon in self.over})


def drive(trials: Sequence[Trial]) -> list[Run]:
    """Drive all trials in one simulation, far from each other.

    A platoon leaves when its time is over or two of its cars touch. All have the time step of the first.
    """
    dt, leaders = trials[0].follower.step, Leaders(tuple(trial.at for trial in trials))
    members = [m for i, trial in enumerate(trials) for m in trial.members(i, leaders)]
    contacts, ground = Contacts(NO_WALLS, {m.id for m in members}), Parting(dt)
    runs = [Running(trial, round(trial.seconds / dt)) for trial in trials]
    steps = max(running.steps for running in runs)
    with Simulation(Setting(members, NO_WALLS, dt, steps=steps, ground=lambda: ground)) as simulation:
        for now in simulation:
            if len(now.fleet) and now.step % round(SAMPLE / dt) == 0:
                _sample(now, contacts, runs)
                ground.over = {str(i) for i, one in enumerate(runs) if one.hit or now.step >= one.steps}
    return [Run(one.trial, *(np.array(column) for column in zip(*one.rows, strict=True)), one.hit) for one in runs]


class Running:
    """A run that is being driven."""

    def __init__(self, trial: Trial, steps: int) -> None:
        self.trial, self.steps = trial, steps
        self.rows: list[tuple] = []  # of `Run`, from time to beams
        self.hit: int | None = None


def _sample(now: Instant, contacts: Contacts, runs: Sequence[Running]) -> None:
    fleet, motion = now.fleet, now.fleet.motion
    locked, beams = targets(now) == fleet.predecessor, _beams(now)
    axle = np.column_stack(fleet.model.axle_position(motion))
    number = np.array([int(m.platoon) for m in fleet.members])
    begins = np.flatnonzero(np.diff(number, prepend=-1))
    for a, b in zip(begins, [*begins[1:], len(number)], strict=True):
        row = motion.speed[a:b], motion.turned[a:b], axle[a:b], locked[a + 1 : b], beams[a + 1 : b]
        runs[number[a]].rows.append((now.time, *row))
    for pair in contacts.of(now.traffic):
        (i, back), (_, front) = (map(int, name.split(".")) for name in pair)
        runs[i].hit = min(runs[i].hit or 1000, max(back, front))


def _beams(now: Instant) -> np.ndarray:
    """Returns from each member's predecessor, (n,)."""
    count = np.zeros(len(now.fleet), dtype=int)
    for group, scan in zip(now.fleet.groups, now.scans, strict=True):
        ahead = now.fleet.predecessor[group.rows]
        count[group.rows] = ((scan.hits == ahead[:, None]) & np.isfinite(scan.ranges)).sum(axis=1)
    return count


# --- leaders --------------------------------------------------------------------------------------------------


def straight_on(time: float) -> tuple[float, float]:
    return 0.0, 0.0


def turn(speed: float, radius: float, angle: float) -> Callable[[float], tuple[float, float]]:
    """A turn to the left after two seconds."""
    return lambda time: (0.0, 1 / radius if 2.0 <= time < 2.0 + angle * radius / speed else 0.0)


def s_bend(speed: float) -> Callable[[float], tuple[float, float]]:
    """Arcs of 0.9 rad and falling radius, left and right in turn."""
    radii = (60.0, 40.0, 30.0, 20.0, 15.0, 12.0)
    stations = np.cumsum([5.0 * speed, *(0.9 * radius for radius in radii)])

    def at(time: float) -> tuple[float, float]:
        i = int(np.searchsorted(stations, speed * time, side="right"))
        return 0.0, (-1) ** i / radii[i - 1] if 0 < i <= len(radii) else 0.0

    return at


def sinusoid(time: float) -> tuple[float, float]:
    """The speed oscillates by 2 m/s."""
    return math.cos(0.5 * time), 0.0


# --- cells of the tables: top-level functions, for the processes that share them --------------------------------------


class Bend(NamedTuple):
    together: bool  # locked on, no contact, all come out of it
    off_path: float  # [m]
    why: str  # if it does not hold

    @property
    def holds(self) -> bool:
        return self.together and self.off_path <= OFF_PATH


def bend_trial(follower: Follower, speed: float, radius: float, angle: float) -> Trial:
    tail = 4 * (follower.law.desired_distance(speed) + CAR.length) / speed
    return Trial(follower, speed, turn(speed, radius, angle), 10.0 + angle * radius / speed + 1.3 * tail)


def bend_of(run: Run) -> Bend:
    through = np.abs(run.turned[-1, 1:] - run.turned[-1, 0]).max() < math.radians(5)
    found = bool(run.locked[-10:].any(axis=0).all())
    why = "contact" if run.hit else "lost" if not through or not found else "lock" if run.lock_on < LOCK else ""
    off_path = run.off_path
    return Bend(not why, off_path, why or ("path" if off_path > OFF_PATH else ""))


def bends(follower: Follower, speed: float, angle: float, radii: Sequence[float]) -> list[Bend]:
    return [bend_of(run) for run in drive([bend_trial(follower, speed, radius, angle) for radius in radii])]


def braking(follower: Follower, grid: Grid, repeats: int) -> dict[tuple[float, float], tuple[float, int | None]]:
    """Least gap [m] and first contact, by speed and deceleration."""
    cases = [(v, b) for v in grid.braking_speeds for b in grid.decelerations for _ in range(repeats)]

    def trial(speed: float, deceleration: float) -> Trial:
        def at(time: float) -> tuple[float, float]:
            return (-deceleration if time >= 3.0 else 0.0), 0.0

        return Trial(follower, speed, at, speed / deceleration + 18.0, grid.followers)

    found: dict[tuple[float, float], tuple[float, int | None]] = {}
    for case, run in zip(cases, drive([trial(*case) for case in cases]), strict=True):
        found[case] = min(found.get(case, (math.inf, None)), (-math.inf if run.hit else run.gaps.min(), run.hit))
    return found


class Noisy(NamedTuple):
    lock_on: float
    gap_error: float  # [m]
    least_gap: float
    hit: bool


def noisy(follower: Follower, grid: Grid, bent: bool) -> dict[tuple[float, float], Noisy]:
    """By standard deviation of the range and share of returns that are lost."""
    cases = [(sigma, dropout) for sigma in grid.sigmas for dropout in grid.dropouts]

    def trial(sigma: float, dropout: float) -> Trial:
        grazing = min(NOISE.dropout_grazing, 1 - NOISE.dropout_at_range_max - dropout)
        noise = replace(NOISE, sigma=sigma, dropout=dropout, dropout_grazing=grazing)
        one = follower.seeing(noise=noise)
        return (
            Trial(one, 6.0, s_bend(6.0), 60.0, grid.followers)
            if bent
            else Trial(one, 20.0, sinusoid, 50.0, grid.followers)
        )

    runs = drive([trial(*case) for case in cases])
    return {
        case: Noisy(run.lock_on, run.gap_error, run.gaps.min(), run.hit is not None)
        for case, run in zip(cases, runs, strict=True)
    }


def views(follower: Follower, grid: Grid) -> dict[tuple[float, float], Bend]:
    cases = [(view, radius) for view in grid.views for radius in grid.junctions]
    runs = drive([bend_trial(follower.seeing(view), JUNCTION_SPEED, radius, QUARTER) for view, radius in cases])
    return {case: bend_of(run) for case, run in zip(cases, runs, strict=True)}


class Reach(NamedTuple):
    follows: bool  # keeps its gap on a straight
    stops: bool  # for a standing car that comes into sight
    gap: float  # then [m]
    impact: float  # speed at which it hits that car; NaN if it does not


def reaches(follower: Follower, grid: Grid) -> dict[tuple[float, float], Reach]:
    cases = [(reach, speed) for reach in grid.reaches for speed in grid.straight_speeds]

    def stop(reach: float, speed: float) -> Trial:
        one = follower.seeing(reach=reach)
        seconds = round(20.0 + 2 * reach / speed, 1)
        return Trial(one, speed, straight_on, seconds, 1, distance=reach - 0.1, leader_speed=0.0)

    follows = drive([Trial(follower.seeing(reach=reach), speed, straight_on, 20.0) for reach, speed in cases])
    stops = drive([stop(*case) for case in cases])
    found = {}
    for case, following, stopping in zip(cases, follows, stops, strict=True):
        wanted = follower.wanted_gap(case[1])
        steady = following.hit is None and np.abs(following.gaps[-50:].mean(axis=0) / wanted - 1).max() < 0.05
        impact = stopping.speed[-1, 1] if stopping.hit else math.nan
        stands = stopping.hit is None and stopping.speed[-1, 1] < 0.05
        found[case] = Reach(
            bool(steady and following.lock_on >= LOCK and (following.beams[-50:] >= BEAMS).mean() >= LOCK),
            bool(stands), stopping.gaps[-1, 0], impact,
        )  # fmt: skip
    return found


class String(NamedTuple):
    """Of amplitudes of speed, by frequency; NaN where two touch."""

    pair: dict[float, float]  # the first follower's by the leader's
    most: dict[float, float]  # the greatest of a follower's by the leader's
    last: dict[float, float]  # the last one's by the leader's
    rms: tuple[float, float]  # deviation of speed behind a steady leader: of the first follower, of the last [m/s]


def string(follower: Follower, lag: float | None, grid: Grid) -> String:
    """Of a disturbance at 20 m/s, by cars that have this lag of drive line and brakes."""
    if lag is not None:
        follower = follower._replace(car=replace(follower.car, lag=lag, brake_lag=lag))
    followers, settling = grid.followers + 1, grid.settling

    def trial(frequency: float) -> Trial:
        omega = 2 * math.pi * frequency
        most = min(1.5 / omega, 1.5)  # of speed [m/s]

        def at(time: float) -> tuple[float, float]:
            return most * omega * math.cos(omega * time), 0.0

        return Trial(follower, 20.0, at, settling + max(settling, 3 / frequency), followers)

    *runs, steady = drive([*map(trial, grid.frequencies), Trial(follower, 20.0, straight_on, 2 * settling, followers)])
    ratios = {}
    for frequency, run in zip(grid.frequencies, runs, strict=True):
        late = run.time > settling
        of = amplitude(run.time[late], run.speed[late], 2 * math.pi * frequency) if run.hit is None else np.array([1.0])
        ratios[frequency] = of[1:] / of[0] if len(of) > 1 else np.full(followers, math.nan)
    rms = (steady.speed[steady.time > settling] - 20.0).std(axis=0) if steady.hit is None else np.full(2, math.nan)
    return String(
        {f: r[0] for f, r in ratios.items()}, {f: r.max() for f, r in ratios.items()},
        {f: r[-1] for f, r in ratios.items()}, (rms[1], rms[-1]),
    )  # fmt: skip


STRINGS = {
    **FOLLOWERS,
    "printed, with noise": FOLLOWERS["printed"].seeing(noise=NOISE),
    "repaired, with noise": FOLLOWERS["repaired"].seeing(noise=NOISE),
}


def cells(grid: Grid) -> dict[tuple, tuple]:
    """The dearest first."""
    found: dict[tuple, tuple] = {}
    followers = {name: FOLLOWERS[name] for name in grid.laws}
    for name, follower in followers.items():
        for speed in grid.speeds:
            for angle in grid.angles:
                found["bend", name, speed, angle] = bends, follower, speed, angle, tuple(grid.radii(speed))
    for name, follower in STRINGS.items():
        if name.removesuffix(", with noise") not in followers:
            continue
        for lag in grid.lags if name in FOLLOWERS else (None,):
            found["string", name, lag] = string, follower, lag, grid
    for name, follower in followers.items():
        if name != "tracking, no noise":
            found["noise", name, True] = noisy, follower, grid, True
            found["noise", name, False] = noisy, follower, grid, False
        found["braking", name] = braking, follower, grid, grid.repeats if name in NOISY else 1
        found["view", name] = views, follower, grid
        found["reach", name] = reaches, follower, grid
    return found


# --- tables -----------------------------------------------------------------------------------------------------------


def smallest(radii: Sequence[float], good: Sequence[bool]) -> float:
    """From which on all larger ones tried are good; NaN: not even the largest."""
    bad = np.flatnonzero(~np.array(good))
    first = bad[-1] + 1 if len(bad) else 0
    return radii[first] if first < len(radii) else math.nan


def smallest_radii(found: dict[tuple, Any], grid: Grid, name: str, speed: float, angle: float) -> tuple[float, float]:
    """That holds, and through which they stay together wherever they drive."""
    radii, bent = grid.radii(speed), found["bend", name, speed, angle]
    return smallest(radii, [b.holds for b in bent]), smallest(radii, [b.together for b in bent])


def print_tables(found: dict[tuple, Any], grid: Grid) -> None:
    print_bends(found, grid)
    print_braking(found, grid)
    print_noise(found, grid)
    print_views(found, grid)
    print_reaches(found, grid)
    print_strings(found, grid)


def print_bends(found: dict[tuple, Any], grid: Grid) -> None:
    def cell(name: str, speed: float, angle: float) -> str:
        radii, bent = grid.radii(speed), found["bend", name, speed, angle]
        holds, together = smallest_radii(found, grid, name, speed, angle)
        first = next((b for r, b in zip(radii[::-1], bent[::-1], strict=True) if not b.holds), None)
        return f"{_radius(holds, radii)} ({_radius(together, radii)}{', ' + first.why if first else ''})"

    table(
        f"Bends, five cars: smallest radius, m, from which all larger ones tried hold: locked on {LOCK:g} of the "
        f"instants with {BEAMS} or more beams on the predecessor, no contact, all come out of the bend, and no rear "
        f"axle more than {OFF_PATH:g} m off the predecessor's path. In brackets that without the path, and what fails "
        f"first. Tried: radii from {SMALLEST:g} m, or {STEEPEST:g} m/s² sideways, to {grid.widest:g} m, "
        f"{FINER - 1:.0%} apart. Grip: {GRIP:g} m/s².",
        ["turn", "law", *(f"{speed:g} m/s" for speed in grid.speeds)],
        [
            [f"{math.degrees(angle):.0f}°", name, *(cell(name, speed, angle) for speed in grid.speeds)]
            for angle in grid.angles
            for name in grid.laws
        ]
        + [["", "grip", *(f"{speed**2 / GRIP:.3g}" for speed in grid.speeds)]],
    )


def print_braking(found: dict[tuple, Any], grid: Grid) -> None:
    def cell(gap: float, hit: int | None) -> str:
        return f"{gap:.1f}" if hit is None else f"hit by {hit}"

    table(
        f"The leader brakes to a stand, {grid.followers + 1} cars: least gap, m, or the follower that first hits the "
        f"car ahead. With noise the worst of {grid.repeats} runs.",
        ["law", "from", *(f"{deceleration:g} m/s²" for deceleration in grid.decelerations)],
        [
            [name, f"{v:g} m/s", *(cell(*found["braking", name][v, b]) for b in grid.decelerations)]
            for name in grid.laws
            for v in grid.braking_speeds
        ],
    )


def print_noise(found: dict[tuple, Any], grid: Grid) -> None:
    def cell(of: Noisy) -> str:
        return f"{of.lock_on:.3f}, contact" if of.hit else f"{of.lock_on:.3f}, {of.gap_error:.2f}, {of.least_gap:.2f}"

    for bent, where in ((True, "S-bend to a radius of 12 m at 6 m/s"), (False, "Straight, 20 ± 2 m/s in 12.6 s")):
        table(
            f"{where}, {grid.followers + 1} cars, by noise of the range and share of lost returns: least lock-on, "
            "greatest gap error and least gap, m, of all followers.",
            ["law", "noise", *(f"{dropout:g} lost" for dropout in grid.dropouts)],
            [
                [name, f"{sigma:g} m", *(cell(found["noise", name, bent][sigma, lost]) for lost in grid.dropouts)]
                for name in grid.laws
                if ("noise", name, bent) in found
                for sigma in grid.sigmas
            ],
        )


def print_views(found: dict[tuple, Any], grid: Grid) -> None:
    def cell(of: Bend) -> str:
        return f"{'yes' if of.holds else of.why}, {of.off_path:.2f}"

    table(
        f"Field of view: whether five cars hold through a quarter turn at {JUNCTION_SPEED:g} m/s, and how far, m, they "
        "come off the predecessor's path at the most.",
        ["law", "radius", *(f"{view:g}°" for view in grid.views)],
        [
            [name, f"{radius:g} m", *(cell(found["view", name][view, radius]) for view in grid.views)]
            for name in grid.laws
            for radius in grid.junctions
        ],
    )


def print_reaches(found: dict[tuple, Any], grid: Grid) -> None:
    def cell(of: Reach) -> str:
        stop = f"stops {of.gap:.1f}" if of.stops else "no stop" if math.isnan(of.impact) else f"hits at {of.impact:.1f}"
        return f"{'holds' if of.follows else 'no'}, {stop}"

    table(
        "Range of the laser: whether five cars hold a steady gap on a straight, and whether one stops for a standing "
        "car that it first sees at the end of that range: its gap then, m, or the speed at which it hits it, m/s.",
        ["law", "range", *(f"{speed:g} m/s" for speed in grid.straight_speeds)],
        [
            [name, f"{reach:g} m", *(cell(found["reach", name][reach, speed]) for speed in grid.straight_speeds)]
            for name in grid.laws
            for reach in grid.reaches
        ],
    )


def print_strings(found: dict[tuple, Any], grid: Grid) -> None:
    def worst(of: dict[float, float]) -> str:
        if any(math.isnan(value) for value in of.values()):
            return "contact"
        frequency = max(of, key=of.get)
        return f"{of[frequency]:.2f} at {frequency:g}"

    names = [name for name in STRINGS if ("string", name, None) in found]
    own = f"{CAR.lag:g} and {CAR.brake_lag:g}; printed and repaired {QUICK.lag:g} and {QUICK.brake_lag:g}"
    table(
        f"String, {grid.followers + 2} cars about 20 m/s: greatest amplitude of a follower's speed by the leader's, "
        f"and at which frequency, Hz, by lag of drive line and brakes, s (the cars' own {own}).",
        ["law", *("as the car" if lag is None else f"{lag:g} s" for lag in grid.lags)],
        [
            [name, *(worst(found["string", name, lag].most) for lag in grid.lags)]
            for name in names
            if all(("string", name, lag) in found for lag in grid.lags)
        ],
    )
    table(
        "Amplitude of speed by the leader's, of the first and of the last follower, by frequency; and the standard "
        "deviation of their speed, m/s, behind a steady leader.",
        ["law", *(f"{f:g} Hz" for f in grid.frequencies), "steady leader"],
        [
            [
                name,
                *(f"{of.pair[f]:.2f}, {of.last[f]:.2f}" for f in grid.frequencies),
                f"{of.rms[0]:.3f}, {of.rms[1]:.3f}",
            ]
            for name, of in ((name, found["string", name, None]) for name in names)
        ],
    )


def _radius(radius: float, radii: Sequence[float]) -> str:
    if math.isnan(radius):
        return "none"
    return f"{'≤ ' if radius == radii[0] else ''}{radius:.3g}"


# --- picture ----------------------------------------------------------------------------------------------------------

BLACK, BLUE, ORANGE, GREEN, GREY = "#222222", "#0072B2", "#E69F00", "#009E73", "#999999"
COLOURS = {"printed": ORANGE, "repaired": GREEN, "tracking": BLUE}  # Okabe and Ito's, safe for colour-blind readers
MARKS = {"printed": "s", "repaired": "^", "tracking": "o"}


def draw(found: dict[tuple, Any], grid: Grid, to: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 8.2), layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subfigures(2, 1, height_ratios=[1.25, 1])
    radii, strings = above.subplots(1, 2, width_ratios=[1.25, 1])
    draw_radii(radii, found, grid)
    draw_strings(strings, found, grid)
    drawn = [name for name in COLOURS if name in grid.laws]
    tiles = below.subplots(1, len(drawn) + 1)
    for axes, name in zip(tiles, drawn, strict=False):
        draw_braking(axes, found, grid, name)
    draw_noise(tiles[-1], found, grid)
    figure.savefig(to, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)


def draw_radii(axes: Any, found: dict[tuple, Any], grid: Grid) -> None:
    """Where the platoon holds, above each line; dashed, where it stays together wherever it drives."""
    angle, top = grid.angles[0], 1.25 * grid.widest
    for name, colour in COLOURS.items():
        if name not in grid.laws:
            continue
        both = np.array([smallest_radii(found, grid, name, speed, angle) for speed in grid.speeds])
        style = {"color": colour, "marker": MARKS[name], "ms": 6}
        axes.plot(grid.speeds, both[:, 0], "-", lw=2.2, label=f"{name}: holds", **style)
        axes.plot(grid.speeds, both[:, 1], ":", lw=1.5, mfc="white", label=f"{name}: together", **style)
        axes.fill_between(grid.speeds, both[:, 0], top, color=colour, alpha=0.13, lw=0)
    fine = np.linspace(min(grid.speeds), max(grid.speeds), 200)
    axes.fill_between(fine, fine**2 / GRIP, 1, color=GREY, alpha=0.3, lw=0, label=f"more than {GRIP:g} m/s² sideways")
    axes.set_yscale("log")
    ticks = [5, 10, 20, 50, 100, 200, 400]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(4, top)
    axes.set_xlim(min(grid.speeds), max(grid.speeds))
    axes.set_xlabel("speed [m/s]")
    axes.set_ylabel("radius [m]")
    axes.set_title(f"Quarter turn: smallest radius, {OFF_PATH:g} m off the path at most", fontsize=11)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", frameon=True, framealpha=0.9, edgecolor="none", fontsize=8)


def draw_strings(axes: Any, found: dict[tuple, Any], grid: Grid) -> None:
    """Greatest amplitude by the leader's, over all frequencies, by lag."""
    lags = [lag for lag in grid.lags if lag is not None]
    for name, colour in COLOURS.items():
        if name not in grid.laws:
            continue
        worst = [max(found["string", name, lag].most.values()) for lag in lags]
        axes.plot(lags, worst, "-", lw=2.2, color=colour, marker=MARKS[name], ms=6, label=name)
    axes.axhline(1.0, color=BLACK, lw=1)
    axes.set_xlabel("lag of drive line and brakes [s]")
    axes.set_ylabel("a follower's amplitude by the leader's")
    band = f"{min(grid.frequencies):g} to {max(grid.frequencies):g} Hz"
    axes.set_title(f"String of {grid.followers + 1} followers, {band}", fontsize=11)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper left", frameon=False, fontsize=8)


def draw_braking(axes: Any, found: dict[tuple, Any], grid: Grid, name: str) -> None:
    gaps = [[found["braking", name][v, b][0] for b in grid.decelerations] for v in grid.braking_speeds]
    texts = [["hit" if gap < 0 else f"{gap:.1f}" for gap in row] for row in gaps]
    draw_tiles(axes, np.array(gaps) / 10.0, texts, grid.decelerations, grid.braking_speeds)
    axes.set_xlabel("the leader brakes at [m/s²]")
    axes.set_ylabel("from [m/s]")
    axes.set_title(f"{name}: least gap [m]", fontsize=11, color=BLACK)


def draw_noise(axes: Any, found: dict[tuple, Any], grid: Grid) -> None:
    """The worse of both roads."""
    worst = [
        [min(found["noise", "tracking", bent][sigma, lost].lock_on for bent in (True, False)) for lost in grid.dropouts]
        for sigma in grid.sigmas
    ]
    texts = [[f"{value:.3f}" for value in row] for row in worst]
    draw_tiles(axes, (np.array(worst) - 0.9) / 0.1, texts, grid.dropouts, grid.sigmas)
    axes.set_xlabel("share of returns lost")
    axes.set_ylabel("noise of the range [m]")
    axes.set_title("tracking: least lock-on", fontsize=11)


def draw_tiles(axes: Any, shades: np.ndarray, texts: list[list[str]], columns: Sequence, rows: Sequence) -> None:
    """Light is good, 1; 0 and less is dark."""
    axes.imshow(np.clip(shades, 0, 1), cmap="cividis", vmin=-0.15, vmax=1.0, origin="lower", aspect="auto")
    for i, row in enumerate(texts):
        for j, text in enumerate(row):
            dark = shades[i, j] < 0.45
            axes.text(j, i, text, ha="center", va="center", fontsize=8, color="white" if dark else BLACK)
    axes.set_xticks(range(len(columns)), [f"{value:g}" for value in columns])
    axes.set_yticks(range(len(rows)), [f"{value:g}" for value in rows])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="draw radii, braking, noise and string into this file")
    parser.add_argument("--quick", action="store_true", help="a few cells of each table only, in seconds")
    given = parser.parse_args()
    grid = SMOKE if given.quick else FULL
    calls = {cell: partial(*call) for cell, call in cells(grid).items()}
    if given.quick:
        found = {cell: call() for cell, call in calls.items()}
    else:
        with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
            running = {cell: pool.submit(call) for cell, call in calls.items()}
            found = {cell: job.result() for cell, job in running.items()}
    print_tables(found, grid)
    if given.picture:
        draw(found, grid, given.picture)


if __name__ == "__main__":
    main()
