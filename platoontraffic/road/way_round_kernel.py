"""Where laser returns are within a body that drives along a line. Compiled."""

from __future__ import annotations

import math

import numpy as np

from platoontraffic.lidar.compiled import compiler

compiled = compiler(__file__)


@compiled
def facing(points):
    """Cosine and sine of the heading of a line at its points (k, 2), (k,) each: that from one beside to the other."""
    last = len(points) - 1
    cos, sin = np.ones(len(points)), np.zeros(len(points))
    for k in range(len(points)):
        before, beyond = max(k - 1, 0), min(k + 1, last)
        dx, dy = points[beyond, 0] - points[before, 0], points[beyond, 1] - points[before, 1]
        away = math.sqrt(dx * dx + dy * dy)
        if away > 0.0:
            cos[k], sin[k] = dx / away, dy / away
    return cos, sin


@compiled
def touches(points, cos, sin, body, returns, clearance):
    """Whether each return (m, 2) is within its clearance (m,) of the body at each place, (k, m).

    points, cos, sin : of the driven axle (k, 2), and of its heading there, (k,)
    body             : half its length and half its width, and how far the driven axle is ahead of its centre [m]
    """
    half_length, half_width, axle = body
    touched = np.zeros((len(points), len(returns)), np.bool_)
    if len(returns) == 0:
        return touched
    reach = half_length + abs(axle) + half_width + 2 * clearance.max()
    x, y = points[:, 0], points[:, 1]
    left, right, low, high = x.min() - reach, x.max() + reach, y.min() - reach, y.max() + reach
    for j in range(len(returns)):
        if not (left < returns[j, 0] < right and low < returns[j, 1] < high):  # as most
            continue
        length, width = half_length + clearance[j], half_width + clearance[j]
        for k in range(len(points)):
            x_from, y_from = returns[j, 0] - points[k, 0], returns[j, 1] - points[k, 1]
            ahead, aside = cos[k] * x_from + sin[k] * y_from + axle, cos[k] * y_from - sin[k] * x_from
            touched[k, j] = abs(ahead) < length and abs(aside) < width
    return touched


def load() -> None:
    """Load what is compiled here."""
    points = np.array([[0.0, 0.0], [1.0, 0.0]])
    touches(points, *facing(points), (1.0, 1.0, 0.0), points, np.zeros(2))
