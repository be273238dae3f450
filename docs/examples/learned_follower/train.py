"""Learn a follower from its scan: an evolution strategy (CMA-ES) on the weights of the law "policy".

    python train.py [--generations 150] [--seed 1] [--to follower.npz]

It writes the weights, and beside them the learning curve, `follower.csv`. Needs `pip install "platoontraffic[learn]"`.
Equal seeds and generations give equal weights on one machine.

Episodes are driven by a compiled short cut: a leader drives arcs and straights of random length, radius and speed, and
three robots in a row follow it by the same network, each by its own scan of its predecessor, with errors of a random
size. Each drive comes with its mirror image. There are no walls, and a scan has a tenth of the beams. It is a means of
training alone: what the law does is measured in the simulator, see judge.py. Robots, laser and frames are those of the
scenarios of the lab; SI and radians.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from pathlib import Path

import cma
import numpy as np
from numba import njit

from platoontraffic.controllers.policy import Network

STEP = 0.025  # as long as the interval of the scans [s]
FOLLOWERS, DRIVES, LASTS = 3, 6, 1600  # robots in a row; drives of a generation, and their steps
HIDDEN, INPUTS = 14, 10
MEMORY_TIME = np.array([0.3, 0.6, 1.2, 2.4])  # [s]
MEMORY = len(MEMORY_TIME)
LOW, HIGH = np.array([0.0, -1.6]), np.array([0.8, 1.6])  # of the command: speed [m/s], yaw rate [rad/s]
DISTANCE = np.array([0.36, 0.5])  # from laser to rear, at rest [m], and its headway [s]
SHIFT = np.array([0.5, 0.5, 0.0, -0.1, 0.1, 0.0, 0.5, 0.5, 0.3, 0.0])
SCALE = np.array([0.5, 0.12, 0.08, 0.08, 0.08, 0.25, 0.5, 0.5, 0.2, 0.3])
FRONT, REAR, LASER, HALF_WIDTH = 0.16, -0.04, 0.13, 0.075  # of the robot, ahead of its driven axle [m]
NEAR, FAR, HALF_VIEW, BEAMS = 0.3, 1.0, math.radians(11.5), 41
ANGLES = np.linspace(-HALF_VIEW, HALF_VIEW, BEAMS)  # from right to left
COS, SIN = np.cos(ANGLES), np.sin(ANGLES)
BEFORE = 3.0  # length of the path on which the followers start [m]
WORST = 17.0  # cost of a step after contact
LENGTHS = (HIDDEN * (INPUTS + MEMORY), HIDDEN, (2 + MEMORY) * HIDDEN, 2 + MEMORY)


def layers(weights: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    w0, b0, w1, b1 = np.split(weights, np.cumsum(LENGTHS)[:-1])
    return (w0.reshape(HIDDEN, -1), b0), (w1.reshape(2 + MEMORY, HIDDEN), b1)


def network(weights: np.ndarray) -> Network:
    return Network("group", SHIFT, SCALE, layers(weights), "twist", LOW, HIGH, MEMORY_TIME, DISTANCE, "paper-follower")


def beginning(random: np.random.Generator) -> np.ndarray:
    """Weights of a proportional law, speed 2 / s (distance - 0.36 m) and yaw rate 2 / s bearing, beside random ones."""
    w0, w1 = 0.1 * random.standard_normal((HIDDEN, INPUTS + MEMORY)), 0.1 * random.standard_normal((2 + MEMORY, HIDDEN))
    w0[:2], w1[:2] = 0.0, 0.0
    w0[0, 1] = w0[1, 2] = 0.5
    w1[0, 0], w1[1, 1] = 2 * SCALE[1] / 0.4 / 0.5, 2 * SCALE[2] / HIGH[1] / 0.5
    b1 = np.zeros(2 + MEMORY)
    b1[0] = math.atanh((2 * (SHIFT[1] - 0.36) - 0.4) / 0.4)
    return np.concatenate([w0.ravel(), np.zeros(HIDDEN), w1.ravel(), b1])


def leader(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A random drive: x, y [m] and heading [rad] of its driven axle at each step, (3, LASTS + 1).

    returns also: those of the followers at the start, on the same path behind it, and a little beside, (FOLLOWERS, 3)
    """
    cruise, swing, period = random.uniform(0.05, 0.6), random.choice([0.0, 0.4]), random.uniform(4, 12)
    stops = random.uniform(5, 35) if random.random() < 0.2 else 1e9  # it stands for 4 s
    t = STEP * np.arange(LASTS)
    wanted = np.where((t > stops) & (t < stops + 4), 0.0, cruise * (1 + swing * np.sin(2 * np.pi * t / period)))
    speed, rate = np.zeros(LASTS), random.choice([0.3, 10.0]) * STEP
    for i in range(1, LASTS):
        speed[i] = speed[i - 1] + np.clip(wanted[i] - speed[i - 1], -rate, rate)
    ends, bends = [random.uniform(0.0, BEFORE)], [0.0]
    while ends[-1] < BEFORE + 0.9 * LASTS * STEP:
        radius = math.exp(random.uniform(math.log(0.8), math.log(4.0))) * random.choice([-1, 1])
        ends.append(ends[-1] + abs(radius) * random.uniform(0.5, 3.0))
        bends.append(1 / radius)
        if random.random() < 0.6:
            ends.append(ends[-1] + random.uniform(0.1, 2.0))
            bends.append(0.0)
    along = np.linspace(0, BEFORE, 300, endpoint=False)  # the path before the start
    driven = np.concatenate([along, BEFORE + np.cumsum(np.append(0.0, speed)) * STEP])
    curvature = np.array(bends)[np.searchsorted(ends, (driven[1:] + driven[:-1]) / 2)]
    heading = np.concatenate([[0.0], np.cumsum(np.diff(driven) * curvature)])
    along = (heading[1:] + heading[:-1]) / 2
    x, y = np.cumsum(np.diff(driven) * np.cos(along)), np.cumsum(np.diff(driven) * np.sin(along))
    path = np.stack([np.append(0.0, x), np.append(0.0, y), heading])
    behind = np.cumsum(random.uniform(0.36, 0.6, FOLLOWERS) + LASER - REAR)
    starts = np.stack([np.interp(BEFORE - behind, driven[:301], one[:301]) for one in path], axis=1)
    aside = 0.02 * random.standard_normal(FOLLOWERS)
    starts += np.stack([-np.sin(starts[:, 2]) * aside, np.cos(starts[:, 2]) * aside, 2 * aside[::-1]], axis=1)
    return path[:, 300:].copy(), starts


def episodes(random: np.random.Generator, drives: int) -> list[tuple[np.ndarray, np.ndarray, float, int]]:
    """Leaders, starts of the followers, errors of the ranges [m] and their seeds, of drives and their mirror images."""
    found = []
    for _ in range(drives):
        path, starts = leader(random)
        noise, seed = math.exp(random.uniform(math.log(0.001), math.log(0.02))), int(random.integers(2**31))
        mirrored = path * np.array([[1.0], [-1.0], [-1.0]]), starts * np.array([1.0, -1.0, -1.0])
        found += [(path, starts, noise, seed), (*mirrored, noise, seed)]
    return found


@njit(cache=True)
def group(px, py, ph, x, y, h, noise, found):
    """Fill in inputs 0 to 7 of the scan at axle pose x, y, h, of a robot at axle pose px, py, ph."""
    c, s = math.cos(ph - h), math.sin(ph - h)
    dx, dy = px - x, py - y
    rx, ry = math.cos(h) * dx + math.sin(h) * dy - LASER, -math.sin(h) * dx + math.cos(h) * dy
    ox, oy = -(c * rx + s * ry), s * rx - c * ry  # laser, and beams, in the frame of the predecessor's axle
    count, first, last = 0, -1, -1
    mx = my = xx = yy = xy = 0.0
    for k in range(BEAMS):
        ux, uy = COS[k], SIN[k]
        vx, vy = c * ux + s * uy, -s * ux + c * uy
        near, far = 0.0, FAR
        for o, v, low, high in ((ox, vx, REAR, FRONT), (oy, vy, -HALF_WIDTH, HALF_WIDTH)):
            if abs(v) < 1e-12:
                if o < low or o > high:
                    near = 2 * FAR
            else:
                one, other = (low - o) / v, (high - o) / v
                near, far = max(near, min(one, other)), min(far, max(one, other))
        if near > far:
            continue
        r = max(near + noise * np.random.normal(), NEAR)  # noqa: NPY002
        bx, by = r * ux, r * uy
        count += 1
        mx += bx
        my += by
        xx += bx * bx
        yy += by * by
        xy += bx * by
        last = k
        if first < 0:
            first = k
    if count == 0:
        found[0] = 0.0
        for k in range(1, 8):
            found[k] = SHIFT[k]
        return False
    mx, my = mx / count, my / count
    xx, yy, xy = xx / count - mx * mx, yy / count - my * my, xy / count - mx * my
    found[0], found[1], found[2] = 1.0, math.hypot(mx, my), math.atan2(my, mx)
    found[3], found[4] = ANGLES[first], ANGLES[last]
    found[5] = -0.5 * math.atan2(2 * xy, yy - xx)
    found[6], found[7] = 1.0 if first == 0 else 0.0, 1.0 if last == BEAMS - 1 else 0.0
    return True


@njit(cache=True)
def drive(leader, starts, noise, seed, w0, b0, w1, b1):
    """Mean cost of a step of the followers of one episode."""
    np.random.seed(seed)  # noqa: NPY002 (compiled, there is no other)
    n = leader.shape[1]
    path = np.empty((FOLLOWERS + 1, 3, n))  # x, y, heading of the driven axles
    driven = np.zeros((FOLLOWERS + 1, n))  # [m]
    path[0] = leader
    place, memory = np.zeros(FOLLOWERS, np.int64), np.zeros((FOLLOWERS, MEMORY))
    speed, yaw_rate, ended = np.zeros(FOLLOWERS), np.zeros(FOLLOWERS), np.zeros(FOLLOWERS, np.bool_)
    inputs, hidden, cost = np.empty(INPUTS), np.empty(HIDDEN), 0.0
    for f in range(FOLLOWERS):
        path[f + 1, :, 0] = starts[f]
    for i in range(n - 1):
        driven[0, i + 1] = driven[0, i] + math.hypot(leader[0, i + 1] - leader[0, i], leader[1, i + 1] - leader[1, i])
        for f in range(FOLLOWERS):
            x, y, h = path[f + 1, 0, i], path[f + 1, 1, i], path[f + 1, 2, i]
            if ended[f]:
                path[f + 1, 0, i + 1], path[f + 1, 1, i + 1], path[f + 1, 2, i + 1] = x, y, h
                driven[f + 1, i + 1] = driven[f + 1, i]
                cost += WORST
                continue
            px, py, ph = path[f, 0, i], path[f, 1, i], path[f, 2, i]
            seen = group(px, py, ph, x, y, h, noise, inputs)
            inputs[8], inputs[9] = speed[f], yaw_rate[f]
            for k in range(HIDDEN):
                total = b0[k]
                for q in range(INPUTS):
                    total += w0[k, q] * (inputs[q] - SHIFT[q]) / SCALE[q]
                for q in range(MEMORY):
                    total += w0[k, INPUTS + q] * memory[f, q]
                hidden[k] = math.tanh(total)
            for k in range(2 + MEMORY):
                total = b1[k]
                for q in range(HIDDEN):
                    total += w1[k, q] * hidden[q]
                out = math.tanh(total)
                if k < 2:
                    command = LOW[k] + (HIGH[k] - LOW[k]) * (1 + out) / 2
                    if k == 0:
                        change = command - speed[f]
                        speed[f] = command
                    else:
                        turn = command - yaw_rate[f]
                        yaw_rate[f] = command
                else:
                    q = k - 2
                    memory[f, q] = out + (memory[f, q] - out) * math.exp(-STEP / MEMORY_TIME[q])
            along = h + yaw_rate[f] * STEP / 2
            x, y = x + speed[f] * STEP * math.cos(along), y + speed[f] * STEP * math.sin(along)
            h += yaw_rate[f] * STEP
            path[f + 1, 0, i + 1], path[f + 1, 1, i + 1], path[f + 1, 2, i + 1] = x, y, h
            driven[f + 1, i + 1] = driven[f + 1, i] + speed[f] * STEP
            # The place on the predecessor's path, up to now; before its start there is none, and no offset from it.
            j = place[f]
            while j + 1 <= i and math.hypot(path[f, 0, j + 1] - x, path[f, 1, j + 1] - y) <= math.hypot(
                path[f, 0, j] - x, path[f, 1, j] - y
            ):
                j += 1
            place[f] = j
            heading = path[f, 2, j]
            off = -math.sin(heading) * (x - path[f, 0, j]) + math.cos(heading) * (y - path[f, 1, j])
            left = math.cos(heading) * (path[f, 0, j] - x) + math.sin(heading) * (path[f, 1, j] - y)
            if j == 0 and left > 0:
                off = 0.0
            gap = driven[f, i] - driven[f, j] + left + REAR - FRONT
            error = gap - (DISTANCE[0] + DISTANCE[1] * speed[f] - 0.03)
            cost += min((off / 0.03) ** 2, 9.0) + min((error / 0.1) ** 2, 4.0) + (0.0 if seen else 4.0)
            cost += min(0.02 * (change / 0.01) ** 2, 2.0) + min(0.02 * (turn / 0.05) ** 2, 2.0)
            if gap < 0.05 and math.hypot(px - x, py - y) < 0.25:
                ended[f] = True
    return cost / ((n - 1) * FOLLOWERS)


def cost(weights: np.ndarray, drives: list) -> float:
    (w0, b0), (w1, b1) = layers(weights)
    return float(np.mean([drive(*one, w0, b0, w1, b1) for one in drives]))


def learn(seed: int, generations: int, curve: Path) -> np.ndarray:
    """The mean of the last search distribution."""
    random, began = np.random.default_rng(seed), time.monotonic()
    strategy = cma.CMAEvolutionStrategy(beginning(random), 0.1, {"seed": seed, "popsize": 24, "verbose": -9})
    kept = episodes(np.random.default_rng(10**6), 15)  # the same for the whole curve
    with curve.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["generation", "cost_of_generation", "cost_of_kept_episodes", "sigma", "minutes"])
        for generation in range(generations):
            drives, asked = episodes(random, DRIVES), strategy.ask()
            costs = [cost(one, drives) for one in asked]
            strategy.tell(asked, costs)
            if generation % 10 == 0 or generation == generations - 1:
                minutes = (time.monotonic() - began) / 60
                row = np.median(costs), cost(strategy.mean, kept), strategy.sigma, minutes
                rows.writerow([generation, *(f"{value:.6g}" for value in row)])
                file.flush()
                network(strategy.mean).write(curve.with_suffix(".npz"))
    return strategy.mean


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--to", type=Path, default=Path("follower.npz"))
    given = parser.parse_args()
    weights = learn(given.seed, given.generations, given.to.with_suffix(".csv"))
    network(weights).write(given.to)


if __name__ == "__main__":
    main()
