"""With which sensors `tracking` holds: scans a second, lost returns, bias of the yaw rate, delay; in Markdown.

    python tests/benchmarks/what_sensors_hold.py [--picture docs/pictures/what_sensors_hold.png] [--quick]

The delay is that of the scans and of the odometry. Six cars on bare ground: on a straight at 25 m/s a wave of speed,
then braking at 9 m/s2 to a stand; and quarter turns. It holds if no two cars touch, each is locked on in 0.99 of the
scans that it uses, no string amplifies (norm of the acceleration during the wave, from car to car), and no rear axle
leaves its predecessor's path by more than 0.3 m.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).parents[2]))
from platoontraffic.controllers.tracking import TrackingFollower
from platoontraffic.lidar import PRESETS, Mount
from platoontraffic.vehicles.catalogue import VEHICLES
from platoontraffic.vehicles.motion import Drive
from platoontraffic.vehicles.odometry import ODOMETRY
from tests.support.bench import BLIND, NO_WALLS, Log, Prescribed, drive, platoon

CAR, LAW = VEHICLES["car"], TrackingFollower()
EYE = replace(PRESETS["car-tracker"], mount=Mount(CAR.length / 2 - 0.03))
RATES, LOST, BIASES = (2.5, 5.0, 10.0, 20.0), (0.002, 0.2, 0.3, 0.4), (0.0, 1.0)  # [Hz], shares, [deg/s]
DELAYS = 0.0, 0.1, 0.2, 0.3  # [s]
TURNS = ((6.0, 4.2), (12.0, 6.0))  # radius [m] and speed [m/s]
LOCK, GAIN, OFF_PATH = 0.99, 1.02, 0.3
WAVE = 5.0, 35.0  # begin and end of the wave [s]
CALM = 40.0  # until the leader brakes [s]


class Sensors(NamedTuple):
    rate: float  # [Hz]
    lost: float  # share of the returns
    bias: float  # standard deviation of the yaw rate's bias [deg/s]
    delay: float  # of scans and odometry [s]


class Held(NamedTuple):
    gain: float
    lock_on: float
    off_path: float  # [m]
    gap: float  # least on the straight [m]

    @property
    def fails(self) -> str:
        """What fails first; "": it holds."""
        if self.gap <= 0:
            return "contact"
        if self.lock_on < LOCK:
            return "lock"
        return "string" if self.gain > GAIN else "path" if self.off_path > OFF_PATH else ""


def driven(sensors: Sensors, at, speed: float, seconds: float, followers: int = 5) -> Log:
    eye = replace(EYE, rate=sensors.rate, delay=sensors.delay, noise=replace(EYE.noise, dropout=sensors.lost))
    members = platoon(
        Prescribed(lambda time: Drive(*at(time))), LAW, followers, distance=LAW.desired_distance(speed), model=CAR,
        leader_eye=replace(BLIND, rate=sensors.rate), eye=eye, speed=speed,
        odometry=replace(ODOMETRY["car"], yaw_rate_bias=math.radians(sensors.bias), delay=sensors.delay),
    )  # fmt: skip
    return drive(members, NO_WALLS, seconds, step_of(sensors))


def step_of(sensors: Sensors) -> float:
    return min(1 / sensors.rate, 0.1)


def locked(log: Log, sensors: Sensors) -> float:
    """Least share of the scans that are used in which a car is locked on."""
    step = step_of(sensors)
    used = log.locked()[round(sensors.delay / step) :: max(round(1 / (sensors.rate * step)), 1)]
    return float(used.mean(axis=0).min())


def off_path(log: Log) -> float:
    """Greatest distance of a rear axle from its predecessor's path [m]."""
    worst = 0.0
    for i in range(1, log.axle.shape[1]):
        path, points = shapely.LineString(log.axle[:, i - 1]), shapely.points(log.axle[:, i])
        at = shapely.line_locate_point(path, points)
        worst = max(worst, shapely.distance(points, path)[(at > 0) & (at < path.length)].max())
    return worst


def wave(time: float) -> tuple[float, float]:
    """1.5 m/s at 0.1 Hz, then braking to a stand."""
    omega = 2 * math.pi * 0.1
    if time > CALM:
        return -9.0, 0.0
    begin, end = WAVE
    return (1.5 * omega * math.cos(omega * (time - begin)) if begin < time < end else 0.0), 0.0


def held(sensors: Sensors) -> Held:
    straight = driven(sensors, wave, 25.0, CALM + 10.0)
    norms = np.sqrt((straight.acceleration[straight.time < CALM] ** 2).sum(axis=0))
    gaps = straight.x[:, :-1] - straight.x[:, 1:] - CAR.length
    logs = [straight]
    for radius, speed in TURNS:
        until = 5.0 + math.pi / 2 * radius / speed

        def turn(time: float, bend: float = 1 / radius, until: float = until) -> tuple[float, float]:
            return 0.0, bend if 5.0 <= time < until else 0.0

        logs.append(driven(sensors, turn, speed, until + 20.0))
    lock_on = min(locked(log, sensors) for log in logs)
    return Held((norms[1:] / norms[:-1]).max(), lock_on, max(map(off_path, logs)), gaps.min())


def draw(found: dict[Sensors, Held], to: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * len(DELAYS), 2.8 * len(BIASES)), layout="constrained")
    FigureCanvasAgg(figure)
    all_axes = figure.subplots(len(BIASES), len(DELAYS), sharex=True, sharey=True)
    for axes, (bias, delay) in zip(all_axes.flat, product(BIASES, DELAYS), strict=True):
        cells = [[found[Sensors(rate, share, bias, delay)] for share in LOST] for rate in RATES]
        good = np.array([[not cell.fails for cell in row] for row in cells], dtype=float)
        axes.imshow(good, cmap="cividis", vmin=-0.15, vmax=1.0, origin="lower", aspect="auto")
        for (i, row), j in product(enumerate(cells), range(len(LOST))):
            text = f"{row[j].fails or 'holds'}\n{row[j].gain:.2f}, {row[j].off_path:.2f} m"
            axes.text(j, i, text, ha="center", va="center", fontsize=7, color="white" if row[j].fails else "#222222")
        axes.set_xticks(range(len(LOST)), [f"{share:g}" for share in LOST])
        axes.set_yticks(range(len(RATES)), [f"{rate:g}" for rate in RATES])
        axes.set_title(f"delay {delay:g} s, bias of the yaw rate {bias:g} °/s", fontsize=9)
    figure.supxlabel("share of returns lost", fontsize=10)
    figure.supylabel("scans a second [Hz]", fontsize=10)
    figure.suptitle("tracking: string gain, distance from the path", fontsize=11)
    figure.savefig(to, dpi=150, metadata={"Software": None} if to.suffix == ".png" else None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="draw the map into this file")
    parser.add_argument("--quick", action="store_true", help="two cells only")
    given = parser.parse_args()
    cells = [Sensors(*cell) for cell in product(RATES, LOST, BIASES, DELAYS)]
    found = {}
    print(
        "| Hz | lost | bias [°/s] | delay [s] | holds | gain | lock-on | off path [m] | least gap [m] |",
        "| --- " * 9 + "|",
        sep="\n",
    )
    for cell in [Sensors(5.0, 0.4, 1.0, 0.3), Sensors(10.0, 0.002, 0.0, 0.0)] if given.quick else cells:
        one = found[cell] = held(cell)
        values = f"{one.gain:.3f} | {one.lock_on:.3f} | {one.off_path:.2f} | {one.gap:.2f}"
        sensors = " | ".join(f"{value:g}" for value in cell)
        print(f"| {sensors} | {one.fails or 'yes'} | {values} |", flush=True)
    if given.picture and not given.quick:
        draw(found, given.picture)


if __name__ == "__main__":
    main()
