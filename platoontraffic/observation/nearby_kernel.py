"""Bodies that are near a place, of thousands. Compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

FEW = 24  # bodies up to which each is looked at, as that takes less time than to find those in some cells
CELLS = 4  # of a grid, by body; more where bodies are in a line
ROUNDING = 1e-6  # more than errors of rounding move the edge of a cell [m]

compiled = compiler(__file__)


@compiled
def in_cells(x, y):
    """Bodies by the square cells of a grid that they are in, for `nearby`; up to FEW bodies are in one cell.

    returns: the grid: its corner x and y [m], cells by metre, columns, rows; where the bodies of each cell begin, and
             their rows and places in that order; bodies whose places are not finite come last, in no cell
    """
    west = south = math.inf
    east = north = -math.inf
    for i in range(len(x)):
        if math.isfinite(x[i]) and math.isfinite(y[i]):
            west, east, south, north = min(west, x[i]), max(east, x[i]), min(south, y[i]), max(north, y[i])
    grid = west, south, 0.0, 1, 1
    if len(x) > FEW and west < math.inf:
        width, height, most = east - west, north - south, CELLS * len(x)
        size = max(math.sqrt(width * height / most), max(width, height) / most, 1.0)
        grid = west, south, 1.0 / size, int(width / size) + 1, int(height / size) + 1
    _, _, per_metre, columns, rows = grid
    cell = np.empty(len(x), np.intp)
    begins = np.zeros(columns * rows + 2, np.intp)  # at first the bodies in each cell
    for i in range(len(x)):
        cell[i] = columns * rows
        if math.isfinite(x[i]) and math.isfinite(y[i]):
            cell[i] = _index(y[i] - south, per_metre, rows) * columns + _index(x[i] - west, per_metre, columns)
        begins[cell[i]] += 1
    for k in range(1, len(begins)):
        begins[k] += begins[k - 1]
    body, there = np.empty(len(x), np.intp), np.empty((len(x), 2))
    for i in range(len(x) - 1, -1, -1):
        begins[cell[i]] -= 1
        k = begins[cell[i]]
        body[k], there[k, 0], there[k, 1] = i, x[i], y[i]
    return grid, begins, body, there


@compiled
def _index(along, per_metre, count):
    """Column or row, of so many, at a distance from the corner [m]; the first or last one outside the grid."""
    return int(min(max(along * per_metre, 0.0), count - 1.0))


@compiled
def nearby(x, y, cells, reach, rows):
    """Fill in the rows of the bodies within `reach` of a place along x and along y [m], in any order.

    cells   : of `in_cells`
    rows    : (N,), filled in from its begin
    returns : how many there are
    """
    (west, south, per_metre, columns, lines), begins, body, there = cells
    far, count = reach + ROUNDING, 0
    first, last = _index(x - far - west, per_metre, columns), _index(x + far - west, per_metre, columns)
    for line in range(_index(y - far - south, per_metre, lines), _index(y + far - south, per_metre, lines) + 1):
        for place in range(begins[line * columns + first], begins[line * columns + last + 1]):
            if abs(there[place, 0] - x) <= reach and abs(there[place, 1] - y) <= reach:
                rows[count] = body[place]
                count += 1
    return count


@compiled
def sort_few(rows):
    """Sort a few rows in place: numpy's sort takes several times as long."""
    for count in range(1, len(rows)):
        row, at = rows[count], count
        while at > 0 and rows[at - 1] > row:
            rows[at] = rows[at - 1]
            at -= 1
        rows[at] = row
