"""A picture of a network with the places of its findings marked by kind."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from platoontraffic.analysis.writing import replacing
from platoontraffic.cli.net_findings import Findings
from platoontraffic.errors import InputError, not_written

LONGER_SIDE, SHORTER_SIDE = 10.0, 4.0  # of the map; the shorter one is at least so long [in]


def draw(found: Findings, title: str, file: Path) -> None:
    """Draw a network and its findings into a picture file. raises: InputError, RunError if it cannot be written"""
    lanes = [lane for edge in found.content.roads().values() for lane in edge.lanes]
    x, y = zip(*(point for lane in lanes for point in lane.shape), strict=True)
    width, height = max(max(x) - min(x), 1.0), max(max(y) - min(y), 1.0)
    unit = LONGER_SIDE / max(width, height)
    sides = max(width * unit, SHORTER_SIDE), max(height * unit, SHORTER_SIDE)
    figure = Figure(figsize=(sides[0] + 0.8, sides[1] + 0.8), layout="constrained")
    axes = figure.add_subplot()
    inside = [lane for edge in found.content.edges.values() if edge.function == "internal" for lane in edge.lanes]
    others, cars = ([lane for lane in lanes if lane.for_cars == for_cars] for for_cars in (False, True))
    for order, (drawn, colour) in enumerate(((inside, "0.8"), (others, "0.85"), (cars, "0.55"))):
        shapes = [lane.shape for lane in drawn]
        axes.add_collection(LineCollection(shapes, colors=colour, linewidths=0.6, zorder=order))
    colours = iter(matplotlib.colormaps["tab10"].colors)
    for kind in found.kinds:
        places = [place for place in kind.places if math.isfinite(place.x)]
        if places:
            label = f"{kind.name}: {len(places)}"
            at = [place.x for place in places], [place.y for place in places]
            axes.scatter(*at, s=28, color=[next(colours)], label=label, zorder=3, alpha=0.8, edgecolors="none")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=title)
    axes.autoscale()
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", ncols=4, frameon=False)
    try:
        with replacing(file) as new:
            figure.savefig(new, dpi=150)
    except ValueError as error:
        raise InputError(f"--plot: {file}: cannot be written: {error}") from None
    except OSError as error:
        raise not_written(error) from error
