"""From the folder of a run or a batch to tables and pictures. Needs no SUMO."""

from analysis.pictures import picture
from analysis.results import Batch, Results, ResultsError, Scans, load

__all__ = ["Batch", "Results", "ResultsError", "Scans", "load", "picture"]
