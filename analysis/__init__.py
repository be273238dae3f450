"""Tables and pictures from the folder of a run or a batch. Needs no SUMO."""

if __name__ != "platoontraffic.analysis":  # a second copy, under another name, would not know the first one's classes
    raise ImportError("import it as platoontraffic.analysis")

from importlib import import_module
from typing import Any

# Modules and what they give; matplotlib and pandas are imported only where they are used.
_GIVEN_BY = {
    "figures": (
        "estimates", "growth", "heat_map", "label", "losses", "over_time", "paths", "road", "states", "time_space",
    ),
    "limits": ("binomial_limits", "detectable", "holm", "interval", "poisson_limits", "runs_needed"),
    "outcome": ("headline",),
    "pictures": ("picture",),
    "results": ("Batch", "Results", "ResultsError", "Scans", "load"),
    "swings": ("amplification", "peak"),
    "tables": ("paired", "summarise"),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _GIVEN_BY.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name in _GIVEN_BY:
        return import_module(f"{__name__}.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULE_OF]
