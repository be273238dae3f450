"""A learned follower: a small network with memory, evaluated over rows, whose weights are in a file.

The file is an .npz, and `np.savez` writes it. With k inputs and m memory values it has

    inputs       : name of the inputs, a text: "group", or "scan"
    shift, scale : of the inputs, (k,): the network gets (input - shift) / scale
    w0, b0       : weights and biases of the first layer, (h, k + m) and (h,), with h units: tanh(w x + b)
    w1, b1, ...  : further layers; the last of them has 2 + m units, o: two for the command, then those of the memory
    command      : "twist", forward speed [m/s] and yaw rate [rad/s], or "drive", acceleration [m/s2] and
                   curvature [1/m]
    low, high    : least and greatest command, (2,): low + (high - low) (1 + o) / 2
    memory_time  : time constants of the memory [s], (m,): each value relaxes towards its o, and begins at 0
    distance     : distance from laser to rear that it was trained to keep, (2,): at rest [m], and its headway [s]
    lidar        : preset of the laser for which it was trained, a text

Inputs, in SI and radians, in the frame of the laser, x forward, y to the left:

    group : 0 whether anything is seen; of the nearest group of neighbouring returns: 1 distance and 2 bearing of its
            centroid, 3 bearing of its first (rightmost) and 4 of its last beam, 5 angle of the line that fits it best
            to the y-axis, which is the relative heading of a predecessor whose rear it is, 6, 7 whether its first and
            its last beam are borders of the view; 8 own speed, 9 own yaw rate. Where nothing is seen, 1 to 7 are those
            of `shift`
    scan  : the least range in each of k - 2 equal sectors, from right to left (nothing there: range_max; nearer than
            range_min: range_min), own speed, own yaw rate
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from platoontraffic.controllers.law import Decision, Law, Sensed, Target
from platoontraffic.controllers.repaired import RepairedFollower
from platoontraffic.lidar import PRESETS, ScanBatch
from platoontraffic.vehicles.motion import Drive, Twist

COMMANDS = {"twist": Twist, "drive": Drive}
GROUP = 10  # inputs of a group
NEAREST = RepairedFollower()  # finds the nearest group of returns, as that law does


class Inputs(NamedTuple):
    """What the network gets, (n, k), and what the law takes for its predecessor."""

    values: np.ndarray
    target: Target


@dataclass(frozen=True, eq=False)
class Network:
    """The content of a file; fields as there."""

    inputs: str
    shift: np.ndarray
    scale: np.ndarray
    layers: tuple[tuple[np.ndarray, np.ndarray], ...]  # weights and biases
    command: str
    low: np.ndarray
    high: np.ndarray
    memory_time: np.ndarray
    distance: np.ndarray
    lidar: str

    @classmethod
    def read(cls, file: Path) -> Network:
        """raises: ValueError (it is no such file), OSError"""
        try:
            with np.load(file, allow_pickle=False) as content:
                found = dict(content)
        except (zipfile.BadZipFile, ValueError, EOFError) as error:
            raise ValueError(f"{file}: is no .npz file of plain arrays: {error}") from None
        try:
            count = sum(name[0] == "w" and name[1:].isdecimal() for name in found)
            layers = tuple((_numbers(found, f"w{i}", 2), _numbers(found, f"b{i}", 1)) for i in range(count))
            texts = {name: str(found[name]) for name in ("inputs", "command", "lidar")}
            arrays = {
                name: _numbers(found, name, 1) for name in ("shift", "scale", "low", "high", "memory_time", "distance")
            }
            network = cls(layers=layers, **texts, **arrays)
            network.check()
        except KeyError as error:
            raise ValueError(f"{file}: has no array {error}") from None
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from None
        return network

    def check(self) -> None:
        """raises: ValueError where shapes or values do not fit each other"""
        k, m = len(self.shift), len(self.memory_time)
        if self.inputs not in ("group", "scan"):
            raise ValueError(f"inputs = {self.inputs!r}; must be 'group' or 'scan'")
        if self.command not in COMMANDS:
            raise ValueError(f"command = {self.command!r}; must be 'twist' or 'drive'")
        if self.lidar not in PRESETS:
            raise ValueError(f"lidar = {self.lidar!r}; must be one of: {', '.join(PRESETS)}")
        if (self.inputs == "group" and k != GROUP) or k < 3:
            raise ValueError(f"shift has {k} values; must have {GROUP} for 'group', 3 or more for 'scan'")
        if not self.layers:
            raise ValueError("has no array 'w0'")
        width = k + m
        for i, (weights, biases) in enumerate(self.layers):
            height = 2 + m if i == len(self.layers) - 1 else len(biases)
            if (weights.shape, biases.shape) != ((height, width), (height,)):
                what = f"w{i}, b{i} are {weights.shape}, {biases.shape}"
                raise ValueError(f"{what}; must be {(height, width)}, {(height,)}")
            width = height
        for name, n in (("scale", k), ("low", 2), ("high", 2), ("distance", 2)):
            if len(getattr(self, name)) != n:
                raise ValueError(f"{name} has {len(getattr(self, name))} values; must have {n}")
        if not (self.low < self.high).all() or (self.scale <= 0).any() or (self.memory_time <= 0).any():
            raise ValueError("must have low < high, and positive scale and memory_time")
        if (self.distance < 0).any():
            raise ValueError(f"distance = {self.distance.tolist()}; must not be negative")

    def write(self, file: Path) -> None:
        layers = {f"w{i}": weights for i, (weights, _) in enumerate(self.layers)}
        layers |= {f"b{i}": biases for i, (_, biases) in enumerate(self.layers)}
        others = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "layers"}
        np.savez(file, **others, **layers)

    def __call__(self, inputs: np.ndarray, memory: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Commands (n, 2) and the next memory (n, m). inputs: (n, k)"""
        values = np.concatenate([(inputs - self.shift) / self.scale, memory], axis=1)
        for weights, biases in self.layers:
            values = np.tanh(values @ weights.T + biases)
        left = np.exp(-dt / self.memory_time)
        command, aim = values[:, :2], values[:, 2:]
        return self.low + (self.high - self.low) * (1 + command) / 2, aim + (memory - aim) * left


@dataclass(frozen=True)
class LearnedFollower(Law):
    """Follows by a network that was learned. Its target is the nearest group of returns, as that of `repaired`."""

    file: Path  # of the network, see `controllers.policy`

    def __post_init__(self) -> None:
        network = self.network  # raises: ValueError
        object.__setattr__(self, "lidar", network.lidar)

    @cached_property
    def network(self) -> Network:
        return _read(self.file, self.file.stat().st_mtime_ns)

    def __call__(self, sensed: Sensed, memory: np.ndarray | None, dt: float) -> Decision:
        network, n = self.network, len(sensed.speed)
        inputs = inputs_of(network.inputs, network.shift, sensed)
        if memory is None:
            memory = np.zeros((n, len(network.memory_time)))
        command, memory = network(inputs.values, memory, dt)
        return Decision(COMMANDS[network.command](*command.T.copy()), memory, inputs.target)

    def desired_distance(self, speed):
        """Distance from laser to rear that it was trained to keep [m]."""
        at_rest, headway = self.network.distance
        return at_rest + headway * speed


def inputs_of(kind: str, shift: np.ndarray, sensed: Sensed) -> Inputs:
    """The inputs of a kind, for n vehicles. shift: of the inputs, (k,)"""
    scan, own = sensed.scan, np.stack([sensed.speed, sensed.yaw_rate], axis=1)
    if kind == "scan":
        seen, target = sectors(scan, len(shift) - 2), group_target(scan)
    else:
        seen, target = _group(scan, *NEAREST.nearest(scan), shift), group_target(scan)
    return Inputs(np.concatenate([seen, own], axis=1), target)


def group_target(scan: ScanBatch, view: tuple[int, int] | None = None) -> Target:
    """The middle of the nearest group of neighbouring returns.

    view: first beam that counts, and the one after the last; None: all count
    """
    distance, theta = NEAREST.nearest_middle(scan, view or (0, scan.model.samples))
    return Target(distance, theta - np.pi / 2)


def sectors(scan: ScanBatch, count: int) -> np.ndarray:
    """The least range in each of `count` equal sectors, from right to left [m], (n, count)."""
    edges = np.linspace(0, scan.ranges.shape[1], count, endpoint=False).astype(int)
    return np.minimum.reduceat(scan.filled(), edges, axis=1)


def _group(scan: ScanBatch, ranges: np.ndarray, ends: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Inputs 0 to 7 of a group, (n, 8). ends: its first and last beam, (2, n)"""
    model, k, (first, last) = scan.model, ranges.shape[1], ends
    beams = np.arange(k)
    within = (beams >= first[:, None]) & (beams <= last[:, None]) & (first >= 0)[:, None]
    x, y = (np.where(within, ranges, 0.0) * one for one in model.directions)
    count = np.maximum(within.sum(axis=1), 1)
    mean_x, mean_y = x.sum(axis=1) / count, y.sum(axis=1) / count
    xx, yy, xy = ((a * b).sum(axis=1) / count for a, b in ((x, x), (y, y), (x, y)))
    xx, yy, xy = xx - mean_x**2, yy - mean_y**2, xy - mean_x * mean_y
    angle = -0.5 * np.arctan2(2 * xy, yy - xx)  # of the principal axis, counter-clockwise from the y-axis
    seen = first >= 0
    found = np.stack([
        seen, np.hypot(mean_x, mean_y), np.arctan2(mean_y, mean_x), model.angles[first], model.angles[last], angle,
        first == 0, last == k - 1,
    ], axis=1).astype(float)  # fmt: skip
    found[~seen, 1:] = shift[1:8]
    return found


@lru_cache(maxsize=32)
def _read(file: Path, changed: int) -> Network:
    """changed: when the file was, so that it is read anew then"""
    return Network.read(file)


def _numbers(found: dict[str, Any], name: str, dimensions: int) -> np.ndarray:
    values = found[name]
    if values.dtype.kind not in "iuf" or values.ndim != dimensions or not np.isfinite(values).all():
        raise ValueError(f"{name} is {values.dtype} {values.shape}; must be finite numbers in {dimensions} dimensions")
    return values.astype(float)
