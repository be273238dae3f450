"""Tables and pictures from the folder of a run or a batch. Needs no SUMO."""

if __name__ != "platoontraffic.analysis":  # a second copy, under another name, would not know the first one's classes
    raise ImportError("import it as platoontraffic.analysis")

from platoontraffic.analysis.figures import (
    estimates,
    growth,
    heat_map,
    label,
    losses,
    over_time,
    paths,
    road,
    states,
    time_space,
)
from platoontraffic.analysis.limits import binomial_limits, detectable, holm, interval, poisson_limits, runs_needed
from platoontraffic.analysis.pictures import picture
from platoontraffic.analysis.results import Batch, Results, ResultsError, Scans, load
from platoontraffic.analysis.swings import amplification, peak
from platoontraffic.analysis.tables import paired, summarise

__all__ = [
    "Batch",
    "Results",
    "ResultsError",
    "Scans",
    "amplification",
    "binomial_limits",
    "detectable",
    "estimates",
    "growth",
    "heat_map",
    "holm",
    "interval",
    "label",
    "load",
    "losses",
    "over_time",
    "paired",
    "paths",
    "peak",
    "picture",
    "poisson_limits",
    "road",
    "runs_needed",
    "states",
    "summarise",
    "time_space",
]
