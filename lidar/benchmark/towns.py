"""Towns of the benchmark, made from a seed, and the views that scan them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from ..model import LidarModel, Mount
from ..scene import Boxes, Scene

BLOCK = 150.0  # distance from road to road [m]
ROAD = 7.0  # width of a road of two lanes [m]
LENGTH, WIDTH = 4.5, 1.8  # of a vehicle [m]
SLOTS = 18  # places for a vehicle on a lane between two junctions
MOUNT = Mount(x=LENGTH / 2 + 0.05)  # just ahead of the bumper


def _view(half_angle_deg, range_max):
    half = math.radians(half_angle_deg)
    return LidarModel(720, -half, half, 0.3, range_max, mount=MOUNT)


VIEWS = {
    "lead30": _view(90, 30.0),
    "lead60": _view(90, 60.0),
    "foll30": _view(11.5, 30.0),
    "foll60": _view(11.5, 60.0),
}


class Size(NamedTuple):
    """A square town: blocks along each side, vehicles, number of them that scan; kerbs in pieces, or merged."""

    name: str
    blocks: int
    vehicles: int
    sensing: int
    merged: bool = False


SIZES = (
    Size("S", 4, 100, 10),
    Size("M", 13, 1000, 100),
    Size("L", 29, 5000, 500),
    Size("L merged", 29, 5000, 500, merged=True),
    Size("D", 13, 5000, 500),
)


def town(blocks: int, vehicles: int, seed: int = 1) -> tuple[Scene, Boxes]:
    """A grid of two-lane roads with kerbs in pieces of 5 m, six buildings a block, and vehicles on the right.

    No two vehicles overlap, and none is on a junction: a lane between two junctions has 18 places, which are drawn
    without replacement. The order of the vehicles is random.
    """
    rng = np.random.default_rng(seed)
    line = BLOCK * np.arange(blocks + 1)

    cut = np.linspace(ROAD / 2, BLOCK - ROAD / 2, 30)  # kerbs end at junctions
    side = np.sort([line - ROAD / 2, line + ROAD / 2], axis=None)
    begin, end = np.add.outer(line[:-1], cut[:-1]).ravel(), np.add.outer(line[:-1], cut[1:]).ravel()
    across, begin, end = np.repeat(side, len(begin)), np.tile(begin, len(side)), np.tile(end, len(side))
    kerbs = [np.stack([begin, across, end, across]), np.stack([across, begin, across, end])]

    east, north = (values.ravel() for values in np.meshgrid(line[:-1], line[:-1]))
    column, row = np.divmod(np.arange(6), 2)
    plot = (BLOCK - ROAD) / np.array([[[3]], [[2]]])  # width and depth
    middle = np.stack([np.add.outer(east, column * plot[0, 0]), np.add.outer(north, row * plot[1, 0])])
    half = rng.uniform(12, 20, middle.shape)
    middle += ROAD / 2 + plot / 2 + rng.uniform(-1, 1, middle.shape) * (plot / 2 - 2 - half)
    (x0, y0), (x1, y1) = (middle - half).reshape(2, -1), (middle + half).reshape(2, -1)
    faces = [np.stack(ends) for ends in ((x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0))]
    scene = Scene(np.concatenate([*kerbs, *faces], axis=1).T)

    shape = (2, blocks + 1, 2, blocks, SLOTS)
    north_south, road, back, block, slot = np.unravel_index(
        rng.choice(math.prod(shape), vehicles, replace=False), shape
    )
    lane = north_south * math.pi / 2 + back * math.pi
    room = (BLOCK - ROAD) / SLOTS
    along = BLOCK * block + ROAD / 2 + room * (slot + 0.5) + rng.uniform(-1.5, 1.5, vehicles)
    right = ROAD / 4 + np.clip(rng.normal(0, 0.2, vehicles), -0.5, 0.5)
    x = np.where(north_south, line[road], along) + right * np.sin(lane)
    y = np.where(north_south, along, line[road]) - right * np.cos(lane)
    heading = lane + np.clip(rng.normal(0, 0.03, vehicles), -0.1, 0.1)
    size = np.full(vehicles, LENGTH), np.full(vehicles, WIDTH)
    return scene, Boxes(x, y, heading, *size, owner=np.arange(vehicles))


def town_of(size: Size) -> tuple[Scene, Boxes]:
    scene, boxes = town(size.blocks, size.vehicles)
    if size.merged:
        scene = Scene.from_shapely(shapely.linestrings(scene.segments.reshape(-1, 2, 2)))
    return scene, boxes
