"""Whether bodies may touch walls, which is asked in every step; compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from platoontraffic.lidar.compiled import compiler

CELL = 20.0  # least side of a cell [m]
MOST_CELLS = 1e6  # beyond, cells are larger

compiled = compiler(__file__)


class Walls(NamedTuple):
    """Walls in pieces no longer than a cell, by the cells that their middles are in."""

    west: float  # border of the first column [m]
    south: float
    cell: float  # side of a cell [m]
    columns: int
    rows: int
    first: np.ndarray  # first piece of each cell, row by row, (columns * rows + 1,)
    pieces: np.ndarray  # x0, y0, x1, y1 [m], (m, 4)

    @classmethod
    def of(cls, segments: np.ndarray) -> Walls:
        """segments: x0, y0, x1, y1 [m], (k, 4), one or more"""
        ends = segments.reshape(-1, 2)
        (west, south), (width, height) = ends.min(axis=0), np.ptp(ends, axis=0)
        length = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
        cell = max(CELL, math.sqrt(width * height / MOST_CELLS), (width + height) / MOST_CELLS)
        parts = np.maximum(np.ceil(length / cell), 1).astype(int)
        wall = np.repeat(np.arange(len(segments)), parts)
        part = np.arange(len(wall)) - np.repeat(np.cumsum(parts) - parts, parts)
        start, step = segments[wall, :2], (segments[wall, 2:] - segments[wall, :2]) / parts[wall, None]
        pieces = np.hstack([start + part[:, None] * step, start + (part + 1)[:, None] * step])
        column, row = (((pieces[:, :2] + pieces[:, 2:]) / 2 - (west, south)) // cell).astype(int).T
        columns, rows = int(width // cell) + 1, int(height // cell) + 1
        at = row * columns + column
        order = np.argsort(at, kind="stable")
        first = np.searchsorted(at[order], np.arange(columns * rows + 1))
        return cls(float(west), float(south), float(cell), columns, rows, first, pieces[order])


@compiled
def may_touch(walls, n, x, y, facing, length, width, margin):
    """Whether the outline of one of the first n bodies, which are boxes, comes within a margin [m] of a wall.

    walls : the fields of Walls
    facing: cosine and sine of the headings
    """
    walls = Walls(*walls)
    for i in range(n):
        cos, sin = facing[0][i], facing[1][i]
        ahead, aside = length[i] / 2 + margin, width[i] / 2 + margin
        reach = math.hypot(ahead, aside) + walls.cell / 2  # to the middle of a piece
        left = max(math.floor((x[i] - reach - walls.west) / walls.cell), 0)
        right = min(math.floor((x[i] + reach - walls.west) / walls.cell), walls.columns - 1)
        bottom = max(math.floor((y[i] - reach - walls.south) / walls.cell), 0)
        top = min(math.floor((y[i] + reach - walls.south) / walls.cell), walls.rows - 1)
        if left > right:
            continue
        for row in range(bottom, top + 1):
            cells = row * walls.columns
            for k in range(walls.first[cells + left], walls.first[cells + right + 1]):
                dx0, dy0 = walls.pieces[k, 0] - x[i], walls.pieces[k, 1] - y[i]
                dx1, dy1 = walls.pieces[k, 2] - x[i], walls.pieces[k, 3] - y[i]
                begin = cos * dx0 + sin * dy0, cos * dy0 - sin * dx0
                end = cos * dx1 + sin * dy1, cos * dy1 - sin * dx1
                if _meets(begin, end, ahead, aside):
                    return True
    return False


@compiled
def _meets(begin, end, ahead, aside):
    """Whether a segment meets the rectangle from -ahead to ahead along x, and from -aside to aside along y."""
    enters, leaves = 0.0, 1.0  # shares of the segment between which it is within both limits
    for axis in range(2):
        limit = ahead if axis == 0 else aside
        a, d = begin[axis], end[axis] - begin[axis]
        if d == 0.0:
            if abs(a) > limit:
                return False
            continue
        one, other = (-limit - a) / d, (limit - a) / d
        enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
    return enters <= leaves
