"""From the folder of a run to tables and pictures. Needs no SUMO."""

from analysis.pictures import picture
from analysis.results import Results, ResultsError, Scans, load

__all__ = ["Results", "ResultsError", "Scans", "load", "picture"]
