"""The paper's followers at the size of cars: how fast and how tightly a platoon of five can drive. Tables in Markdown.

    python tests/benchmarks/paper_at_car_size.py [--picture docs/pictures/paper_at_car_size.png]

Lengths are times SCALE, times as they are. The laws are not touched: `Scaled` shows them the world at the size of the
robots. No SUMO: a leader drives a prescribed twist, four followers see only their scans, 40 times a second.
Some five minutes on two free cores.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parents[2]))
from platoontraffic.controllers import Decision, Law, Sensed, Target
from platoontraffic.controllers.printed import SPEED_GAIN, PrintedFollower
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.lidar import LidarModel, Mount, Scene
from platoontraffic.simulation import Setting, Simulation
from platoontraffic.vehicles.bicycle import CARS, Car
from platoontraffic.vehicles.motion import Twist
from platoontraffic.world.contact import Contacts
from platoontraffic.world.fleet import Fleet
from tests.support.bench import DT, NO_WALLS, Prescribed, amplitude, platoon, targets

SCALE = 12.0  # a robot is 0.15 m wide, a car 1.76 m
FOLLOWERS = 4
LANE = 3.6  # width [m]; the platoon drives in the right-hand one of two
TOLERANCE = 0.02  # of the steady gap
FASTEST = 50.0  # tried [m/s]
ACCELERATION = 1.0  # of a leader that speeds up [m/s2]
SMALLEST = 4.4  # radius tried; at full lock the car's rear axle drives one of 4.31 m
GRIP = 4.0  # lateral acceleration up to which the car's model is to be trusted [m/s2]
REACHES = (12.0, 30.0, 60.0)
VIEWS = (23.0, 60.0, 180.0)
SPEEDS = (2.0, 5.0, 8.0, 11.0)  # in turns
FREQUENCIES = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5)
DECELERATIONS = (2.0, 4.0, 6.0, 8.0)


@dataclass(frozen=True)
class Scaled(Law):
    """A law of robots, for vehicles that are `scale` times as large: it is shown, and commands, a world that is not."""

    law: Any
    scale: float = SCALE

    def __call__(self, sensed: Sensed, memory: Any, dt: float) -> Decision:
        scan, model = sensed.scan, sensed.scan.model
        small = replace(model, range_min=model.range_min / self.scale, range_max=model.range_max / self.scale)
        scan = replace(scan, model=small, ranges=scan.ranges / self.scale)
        (speed, yaw_rate), memory, (distance, bearing) = self.law(
            replace(sensed, scan=scan, speed=sensed.speed / self.scale), memory, dt
        )
        return Decision(Twist(speed * self.scale, yaw_rate), memory, Target(distance * self.scale, bearing))

    def desired_distance(self, speed: float) -> float:
        return self.scale * self.law.desired_distance(speed / self.scale)


PRINTED, FAR_SIGHTED = Scaled(PrintedFollower()), Scaled(PrintedFollower(no_return="infinity"))
IN_METRES = PrintedFollower()  # its steps of 0.5 m not scaled
REPAIRED = Scaled(RepairedFollower())  # the same as RepairedFollower(stand_off=5.4, group_step=1.2)
LAWS = {
    "printed, no return is range_max": PRINTED,
    "the same, its 0.5 m not scaled": IN_METRES,
    "printed, no return is infinity": FAR_SIGHTED,
    "repaired": REPAIRED,
}

CAR = CARS["car"]
AT_ONCE = replace(
    CAR, max_steering_rate=1e3, steering_lag=0.0, max_acceleration=1e3, power=1e6, max_speed=1e3, max_braking=1e3,
    max_jerk=1e6, lag=0.0, brake_lag=0.0, response=0.05,
)  # fmt: skip
QUICK = replace(CAR, response=0.2, lag=0.1)
VEHICLES = {"at once": AT_ONCE, "quick": QUICK, "default": CAR}


def laser(reach: float, view: float = 23.0) -> LidarModel:
    """The paper's follower's, larger: range [m] from 3.6 to `reach`, and wider: `view` [deg]."""
    half = math.radians(view / 2)
    return LidarModel(720, -half, half, 0.3 * SCALE, reach, mount=Mount(CAR.length / 2 - 0.03 * SCALE))


# --- one run ---------------------------------------------------------------------------------------------------------


class Trial(NamedTuple):
    """A platoon that begins at a steady speed, its gaps as its law wants them."""

    law: Any
    speed: float
    twist_at: Callable[[float], Twist]  # the leader's
    seconds: float
    car: Car = QUICK
    eye: LidarModel = laser(30.0)
    scene: Scene = NO_WALLS
    followers: int = FOLLOWERS


class Moment(NamedTuple):
    """One instant of a trial; arrays have one row a follower, front to rear."""

    time: float
    fleet: Fleet
    locked: np.ndarray  # its target is its predecessor
    contacts: set[tuple[str, str]]


def run(trial: Trial) -> Iterator[Moment]:
    """The instants of a trial. The leader executes its twist without lag, whatever the followers do."""
    distance = trial.law.desired_distance(trial.speed)
    leader, *others = platoon(
        Prescribed(trial.twist_at), trial.law, trial.followers, model=trial.car, eye=trial.eye, distance=distance,
        speed=trial.speed,
    )  # fmt: skip
    members = [replace(leader, model=AT_ONCE), *others]
    contacts = Contacts(trial.scene, {m.id for m in members})
    with Simulation(Setting(members, trial.scene, DT, steps=round(trial.seconds / DT))) as simulation:
        for now in simulation:
            locked = targets(now)[1:] == np.arange(trial.followers)
            yield Moment(now.time, now.fleet, locked, contacts.of(now.traffic))


def together(trial: Trial) -> list[Moment] | None:
    """All moments of a run in which every follower is locked on and nothing touches; None as soon as one is not so."""
    moments = []
    for moment in run(trial):
        if not moment.locked.all() or moment.contacts:
            return None
        moments.append(moment)
    return moments


def steady(moment: Moment, law: Any, speed: float) -> bool:
    """Whether every gap is the law's."""
    wanted = law.desired_distance(speed)
    return bool((np.abs(moment.fleet.target.distance[1:] / wanted - 1) < TOLERANCE).all())


def holds_straight(law: Any, eye: LidarModel, walls: bool, speed: float) -> bool:
    """10 s at a constant speed, from steady gaps."""
    scene = kerbs(shapely.LineString([(-500, 0), (FASTEST * 15, 0)])) if walls else NO_WALLS
    moments = together(Trial(law, speed, lambda _: Twist(speed, 0.0), 10.0, eye=eye, scene=scene))
    return moments is not None and steady(moments[-1], law, speed)


def reaches(law: Any, eye: LidarModel, car: Car, start: float, speed: float) -> bool:
    """While the leader goes from one speed to another, and until the gaps are steady again."""

    def twist_at(time: float) -> Twist:
        return Twist(min(start + ACCELERATION * time, speed), 0.0)

    moments = together(Trial(law, start, twist_at, (speed - start) / ACCELERATION + 40.0, car, eye))
    return moments is not None and steady(moments[-1], law, speed)


def holds_bend(law: Any, eye: LidarModel, car: Car, speed: float, walls: bool, room: float, radius: float) -> bool:
    """Through 90 degrees to the left and out again; every rear axle within `room` of the leader's path."""
    spacing = law.desired_distance(speed) + CAR.length
    before, bend = 1.0, math.pi / 2 * radius / speed
    seconds = before + bend + 10.0 + FOLLOWERS * spacing / speed
    arc = np.linspace(0, math.pi / 2, 91)
    begin, end = speed * before + CAR.axle, speed * seconds
    path = shapely.LineString([
        (-500, 0), *np.column_stack([begin + radius * np.sin(arc), radius * (1 - np.cos(arc))]),
        (begin + radius, radius + end + 500),
    ])  # fmt: skip
    scene = kerbs(path) if walls else NO_WALLS

    def twist_at(time: float) -> Twist:
        return Twist(speed, speed / radius if before <= time < before + bend else 0.0)

    moments = together(Trial(law, speed, twist_at, seconds, car, eye, scene))
    if moments is None or np.abs(np.degrees(moments[-1].fleet.motion.turned) - 90).max() > 5:
        return False
    axles = np.array([m.fleet.model.axle_position(m.fleet.motion) for m in moments[::4]])
    return bool(shapely.distance(path, shapely.points(axles[:, 0], axles[:, 1])).max() <= room)


def holds_circle(law: Any, eye: LidarModel, car: Car, speed: float, radius: float) -> bool:
    """For 30 s after the last follower has come to where the circle begins."""
    seconds = 31.0 + FOLLOWERS * (law.desired_distance(speed) + CAR.length) / speed

    def twist_at(time: float) -> Twist:
        return Twist(speed, speed / radius if time >= 1.0 else 0.0)

    return together(Trial(law, speed, twist_at, seconds, car, eye)) is not None


def kerbs(lane: shapely.LineString) -> Scene:
    """Both kerbs of a road of two lanes, with this one, its middle line, to the right."""
    return Scene.from_shapely(walls=[lane.parallel_offset(LANE / 2, "right"), lane.parallel_offset(1.5 * LANE, "left")])


def growth(car: Car, frequency: float) -> float:
    """Amplitude of the last follower's speed by the leader's, which swings about 8 m/s; over one period after 40 s."""
    omega, settling = 2 * math.pi * frequency, 40.0

    def twist_at(time: float) -> Twist:
        return Twist(8.0 + 0.05 * math.sin(omega * time), 0.0)

    moments = together(Trial(REPAIRED, 8.0, twist_at, settling + 1 / frequency, car))
    if moments is None:
        return math.nan
    late = [m for m in moments if m.time >= settling]
    swing = amplitude(np.array([m.time for m in late]), np.array([m.fleet.motion.speed for m in late]), omega)
    return swing[-1] / swing[0]


def first_hit(law: Any, car: Car, deceleration: float, followers: int) -> int | None:
    """The follower nearest to the leader that touches the car ahead, when the leader brakes from 11 m/s; None: none."""

    def twist_at(time: float) -> Twist:
        return Twist(max(11.0 - deceleration * max(time - 1.0, 0.0), 0.0), 0.0)

    hit = set()
    for moment in run(Trial(law, 11.0, twist_at, 11.0 / deceleration + 15.0, car, followers=followers)):
        places = [sorted(int(name.split(".")[1]) for name in pair) for pair in moment.contacts]
        hit |= {back for front, back in places if back == front + 1}
    return min(hit, default=None)


# --- searches --------------------------------------------------------------------------------------------------------


def border(holds: Callable[[float], bool], good: float, bad: float, precision: float = 0.01) -> float:
    """The last value that holds, between one that does and one that does not."""
    while max(good, bad) / min(good, bad) > 1 + precision:
        between = math.sqrt(good * bad)
        good, bad = (between, bad) if holds(between) else (good, between)
    return good


def window(holds: Callable[[float], bool]) -> tuple[float, float]:
    """The smallest and the largest speed that hold, of those from 1 m/s to the fastest, 5 % apart; NaN: none."""
    tried = np.geomspace(1.0, FASTEST, 81)
    ends = []
    for speeds in (tried, tried[::-1]):
        good = next((i for i, speed in enumerate(speeds) if holds(speed)), None)
        if good is None:
            return math.nan, math.nan
        ends.append(speeds[0] if good == 0 else border(holds, speeds[good], speeds[good - 1]))
    return ends[0], ends[1]


def largest_speed(holds: Callable[[float], bool], start: float) -> float:
    """Upwards by a quarter from a speed that holds; NaN if it does not."""
    good = start
    if not holds(good):
        return math.nan
    while holds(1.25 * good):
        good *= 1.25
    return border(holds, good, 1.25 * good, 0.02)


def smallest_radius(holds: Callable[[float], bool], largest: float) -> float:
    """Downwards by halves, so it holds at all larger ones tried; NaN if not at the largest, 0 if at the smallest."""
    good = largest
    if not holds(good):
        return math.nan
    while good > SMALLEST:
        bad = max(good / 2, SMALLEST)
        if not holds(bad):
            return border(holds, good, bad, 0.05)
        good = bad
    return 0.0


# --- closed forms of a steady circle ---------------------------------------------------------------------------------


def sight_on_a_circle(speed: float, view: float, whole: bool) -> float:
    """Radius below which the predecessor is out of sight: it turns as fast as the leader, so its bearing is v / (K R).

    whole : both ends of its rear must be in view, v/(K R) + w/(2 D) = view/2, or only a part of it, v/(K R) = view/2
    """
    half = math.radians(view / 2) - (CAR.width * SPEED_GAIN / (2 * speed) if whole else 0.0)
    return speed / half if half > 0 else math.inf


def room_on_a_circle(law: Any, speed: float) -> float:
    """Radius below which there is no circle left for the last follower, as each drives within the one ahead."""
    return border(lambda radius: len(circles(law, speed, radius)) == FOLLOWERS, 1e3, 1.0, 1e-3)


def tail_on_a_circle(law: Any, speed: float) -> float:
    """Radius of a circle that is just as long as the platoon."""
    return (FOLLOWERS * (law.desired_distance(speed) + CAR.length) + CAR.length) / (2 * math.pi)


def circles(law: Any, speed: float, radius: float) -> list[float]:
    """Radii of the followers' rear axles behind a leader on a circle, as far as there are any.

    All turn at w = v/R, so all see their predecessor at beta = w/K. A laser a ahead of the axle, a rear b behind it,
    stand-off s, and f from distance to speed:  D = s + R' w/f,  (a + D cos beta)^2 + (R' - D sin beta)^2 = R^2 + b^2.
    """
    yaw_rate = bearing = speed / radius
    theta = math.pi / 2 + bearing
    per_radius = yaw_rate * 2 * math.sin(theta / 2) / theta
    stand_off = law.desired_distance(0.0)
    ahead, behind = CAR.length / 2 - 0.03 * SCALE - CAR.axle, CAR.length / 2 + CAR.axle
    radii: list[float] = []
    while len(radii) < FOLLOWERS:
        # Both terms are linear in R'; numpy's polynomials begin with the highest power.
        along = np.array([per_radius * math.cos(bearing), ahead + stand_off * math.cos(bearing)])
        aside = np.array([1 - per_radius * math.sin(bearing), -stand_off * math.sin(bearing)])
        of_target = np.array([0.0, 0.0, radius**2 + behind**2])
        roots = np.roots(np.polymul(along, along) + np.polymul(aside, aside) - of_target)
        radius = max(roots.real) if np.isreal(roots).all() else 0.0
        if radius <= 0:
            break
        radii.append(radius)
    return radii


# --- cells of the tables: top-level functions, for the processes that share them ------------------------------------


def straight(law: Any, reach: float, walls: bool) -> tuple[float, float]:
    return window(partial(holds_straight, law, laser(reach), walls))


def speeding_up(law: Any, car: Car, start: float) -> float:
    return largest_speed(partial(reaches, law, laser(12.0), car, start), start)


def bend(law: Any, view: float, car: Car, speed: float) -> float:
    holds = partial(holds_bend, law, laser(30.0, view), car, speed, False, math.inf)
    return smallest_radius(holds, largest_tried(law, speed))


def bend_in_lane(view: float, speed: float) -> float:
    room = (LANE - CAR.width) / 2
    return smallest_radius(partial(holds_bend, REPAIRED, laser(30.0, view), QUICK, speed, False, room), 200.0)


def bend_with_kerbs(speed: float) -> float:
    return smallest_radius(partial(holds_bend, REPAIRED, laser(30.0), QUICK, speed, True, math.inf), 200.0)


def circle(law: Any, view: float, car: Car, speed: float) -> float:
    return smallest_radius(partial(holds_circle, law, laser(30.0, view), car, speed), largest_tried(law, speed))


def largest_tried(law: Any, speed: float) -> float:
    """Radius [m]: larger than sight asks for."""
    return (12.0 if law == REPAIRED else 18.0) * speed


def braking(law: Any, car: Car) -> list[int | None]:
    return [first_hit(law, car, deceleration, 10) for deceleration in DECELERATIONS]


ACCELERATED = {"repaired": 2.0, "printed, no return is infinity": 6.0}  # from these speeds [m/s]
ACCELERATING = ("quick", "default")
TURNS = [("repaired", view, speed) for view in VIEWS for speed in SPEEDS] + [
    ("printed, no return is infinity", view, speed) for view in (23.0, 60.0) for speed in (8.0, 11.0)
]
CELLS: dict[tuple, tuple] = {
    **{("lane", speed): (bend_in_lane, 60.0, speed) for speed in SPEEDS},
    **{("circle", *turn): (circle, LAWS[turn[0]], turn[1], QUICK, turn[2]) for turn in TURNS},
    **{("bend", *turn): (bend, LAWS[turn[0]], turn[1], QUICK, turn[2]) for turn in TURNS},
    **{("vehicle", name): (bend, REPAIRED, 23.0, VEHICLES[name], 8.0) for name in ("at once", "default")},
    **{("kerbs", speed): (bend_with_kerbs, speed) for speed in (2.0, 3.0)},
    **{
        ("up", law, name): (speeding_up, LAWS[law], VEHICLES[name], start)
        for law, start in ACCELERATED.items()
        for name in ACCELERATING
    },
    **{("braking", law, name): (braking, LAWS[law], car) for law in ACCELERATED for name, car in VEHICLES.items()},
    **{("growth", name, f): (growth, car, f) for name, car in VEHICLES.items() for f in FREQUENCIES},
    **{
        ("straight", name, reach, walls): (straight, LAWS[name], reach, walls)
        for name in LAWS
        for reach in REACHES
        for walls in (False, True)
    },
}


# --- tables and picture ----------------------------------------------------------------------------------------------


def print_tables(found: dict[tuple, Any]) -> None:
    print_straights(found)
    print_turns(found)
    print_strings(found)


def print_straights(found: dict[tuple, Any]) -> None:
    table(
        "Straight road: speeds from - to, m/s. Ten seconds at a constant speed from steady gaps: every follower is "
        "locked on its predecessor in every step, nothing touches, every gap is within 2 % of the law's. Quick car, "
        f"view 23°; kerbs {LANE / 2:g} m to the right and {1.5 * LANE:g} m to the left.",
        ["law", "kerbs", *(f"laser to {reach:g} m" for reach in REACHES)],
        [
            [name, "yes" if walls else "no", *(_span(*found["straight", name, reach, walls]) for reach in REACHES)]
            for name in LAWS
            for walls in (False, True)
        ],
    )
    table(
        "Speeding up: largest speed, m/s, that a leader may reach at 1 m/s² with no loss, no contact and steady gaps "
        "40 s later. Laser to 12 m, no kerbs.",
        ["law", "from", *ACCELERATING],
        [
            [law, f"{start:g}", *(_number(found["up", law, name], 2) for name in ACCELERATING)]
            for law, start in ACCELERATED.items()
        ],
    )


def print_turns(found: dict[tuple, Any]) -> None:
    table(
        "Turns: smallest radius of the leader's rear axle, m, with every follower locked on in every step and no "
        "contact; laser to 30 m, quick car, no kerbs. Closed forms of a steady circle: sight of the predecessor, room "
        "for the last one's circle within the others', and a circle as long as the platoon. Grip: where the leader has "
        f"{GRIP:g} m/s² sideways; on smaller radii a real car slides, this model does not.",
        ["law", "view", "speed", "90° bend", "circle", "sight", "room", "length", "grip"],
        [
            [
                law, f"{view:g}°", f"{speed:g}", _radius(found["bend", law, view, speed]),
                _radius(found["circle", law, view, speed]), _radius(sight_on_a_circle(speed, view, law != "repaired")),
                _radius(room_on_a_circle(LAWS[law], speed)), _radius(tail_on_a_circle(LAWS[law], speed)),
                _radius(speed**2 / GRIP),
            ]
            for law, view, speed in TURNS
        ],
    )  # fmt: skip
    room = (LANE - CAR.width) / 2
    table(
        f"The same 90° bend, repaired, with every rear axle within {room:.2f} m of the leader's path, so in its lane "
        f"of {LANE:g} m; view 60°.",
        ["speed", "smallest radius"],
        [[f"{speed:g}", _radius(found["lane", speed], "above 200")] for speed in SPEEDS],
    )
    by_vehicle = [found["bend", "repaired", 23.0, 8.0] if v == "quick" else found["vehicle", v] for v in VEHICLES]
    table(
        "The same 90° bend, repaired, view 23°, at 8 m/s, by vehicle: smallest radius, m.",
        list(VEHICLES),
        [[_radius(radius) for radius in by_vehicle]],
    )
    kerbed = " and ".join(f"{_radius(found['kerbs', speed], 'above 200')} at {speed:g} m/s" for speed in (2.0, 3.0))
    print(f"And with kerbs, view 23°, quick: smallest radius, m: {kerbed}.\n")


def print_strings(found: dict[tuple, Any]) -> None:
    table(
        "String: amplitude of the last of four followers' speed by the leader's, repaired, about 8 m/s.",
        ["vehicle", *(f"{frequency:g} Hz" for frequency in FREQUENCIES)],
        [[name, *(_number(found["growth", name, f], 2) for f in FREQUENCIES)] for name in VEHICLES],
    )
    table(
        "Braking from 11 m/s to a stand, eleven cars: how many, the leader counted, stop without contact.",
        ["law", "vehicle", *(f"{deceleration:g} m/s²" for deceleration in DECELERATIONS)],
        [
            [law, name, *("all 11" if hit is None else f"{hit}" for hit in found["braking", law, name])]
            for law in ACCELERATED
            for name in VEHICLES
        ],
    )


def table(claim: str, head: list[str], rows: list[list[str]]) -> None:
    print(f"{claim}\n\n| {' | '.join(head)} |\n|{' --- |' * len(head)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    print(flush=True)


def _number(value: float, digits: int) -> str:
    return "none" if math.isnan(value) else f"{value:.{digits}f}"


def _span(smallest: float, largest: float) -> str:
    if math.isnan(smallest):
        return "none"
    low = "≤ 1" if smallest <= 1 else f"{smallest:.1f}"
    high = f"≥ {FASTEST:g}" if largest >= FASTEST else f"{largest:.1f}"
    return f"{low} - {high}"


def _radius(radius: float, none: str = "none") -> str:
    if math.isnan(radius) or math.isinf(radius):
        return none
    return f"{radius:.0f}" if radius else f"≤ {SMALLEST:g}"


BLACK, BLUE, ORANGE, GREEN, RED, SKY, GREY = "#222222", "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#999999"


def draw(found: dict[tuple, Any], to: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    straights, radii = figure.subplots(1, 2, width_ratios=[1.15, 1])
    draw_speeds(straights, found)
    draw_radii(radii, found)
    figure.savefig(to, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)


def draw_speeds(axes: Any, found: dict[tuple, Any]) -> None:
    """Bars from the smallest to the largest speed; a law after the other, with kerbs below without."""
    for i, name in enumerate(LAWS):
        for walls in (False, True):
            for colour, reach, offset in zip((BLUE, SKY, GREY), REACHES, (0, 1, 2), strict=True):
                low, high = found["straight", name, reach, walls]
                y = i + 0.4 * walls + 0.11 * offset
                if math.isnan(low):
                    axes.text(1.05, y, "none", va="center", fontsize=7, color=colour)
                    continue
                label = f"laser to {reach:g} m" if i == 0 and not walls else None
                axes.barh(y, high - low, left=low, height=0.09, color=colour, alpha=0.55 if walls else 1.0, label=label)
                beyond = "≥ " if high >= FASTEST else ""
                axes.text(high * 1.03, y, f"{beyond}{high:.3g}", va="center", fontsize=7, color="#444444")
            axes.text(0.92, i + 0.4 * walls + 0.11, "kerbs" if walls else "open", ha="right", va="center", fontsize=8)
    axes.set_yticks([i + 0.31 for i in range(len(LAWS))])
    axes.set_yticklabels([name.replace(", ", ",\n") for name in LAWS], fontsize=9)
    axes.tick_params(axis="y", length=0, pad=38)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(1, 80)
    ticks = [1, 2, 5, 10, 20, 50]
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("speed [m/s]")
    axes.set_title("Straight road: speeds at which five cars hold", fontsize=11)
    axes.grid(axis="x", alpha=0.3)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3, frameon=False, fontsize=9)


def draw_radii(axes: Any, found: dict[tuple, Any]) -> None:
    """Smallest radius by speed: bends, circles, and closed forms of the circle."""
    for colour, view in zip((RED, BLUE, GREEN), VIEWS, strict=True):
        speeds = [speed for law, v, speed in TURNS if law == "repaired" and v == view]
        for kind, style in (("bend", "o-"), ("circle", "s--")):
            values = [found[kind, "repaired", view, speed] for speed in speeds]
            drawn = [max(value, SMALLEST) for value in values]
            axes.plot(speeds, drawn, style, color=colour, ms=5, label=f"{kind}, {view:g}°")
    axes.text(
        6.5, 1.06 * SMALLEST, f"all tried, from {SMALLEST:g} m", ha="center", va="bottom", fontsize=8, color="#444444"
    )
    fine = np.linspace(2.0, 11.0, 60)
    room = np.array([max(f(REPAIRED, speed) for f in (room_on_a_circle, tail_on_a_circle)) for speed in fine])
    for view in VIEWS:
        form = np.maximum(room, [sight_on_a_circle(speed, view, False) for speed in fine])
        axes.plot(fine, form, ":", color=BLACK, lw=1.2, label="circle, closed forms" if view == VIEWS[0] else None)
    axes.plot(fine, np.maximum(fine**2 / GRIP, 1.0), color=GREY, lw=4, alpha=0.4, label=f"{GRIP:g} m/s² sideways")
    axes.plot(SPEEDS, [found["lane", speed] for speed in SPEEDS], "^-", color=ORANGE, ms=5, label="bend, in lane, 60°")
    axes.set_yscale("log")
    ticks = [5, 10, 20, 50, 100, 200]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(4, 230)
    axes.set_xlabel("speed [m/s]")
    axes.set_ylabel("smallest radius [m]")
    axes.set_title("Turns of the repaired follower, by field of view", fontsize=11)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3, frameon=False, fontsize=8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="draw the largest speeds and the smallest radii into this file")
    picture = parser.parse_args().picture
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        running = {cell: pool.submit(*call) for cell, call in CELLS.items()}
        found = {cell: job.result() for cell, job in running.items()}
    print_tables(found)
    if picture:
        draw(found, picture)


if __name__ == "__main__":
    main()
