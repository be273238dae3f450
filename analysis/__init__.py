"""From the folder of a run or a batch to tables and pictures. Needs no SUMO."""

from analysis.figures import estimates, growth, heat_map, label, losses, over_time, paths, road, states, time_space
from analysis.pictures import picture
from analysis.results import Batch, Results, ResultsError, Scans, load
from analysis.tables import amplification, interval, paired, summarise

__all__ = [
    "Batch",
    "Results",
    "ResultsError",
    "Scans",
    "amplification",
    "estimates",
    "growth",
    "heat_map",
    "interval",
    "label",
    "load",
    "losses",
    "over_time",
    "paired",
    "paths",
    "picture",
    "road",
    "states",
    "summarise",
    "time_space",
]
