"""Control laws, one file for each. A law turns what a vehicle senses into a command.

A law is a frozen dataclass of its gains, derived from `Law`, with

    __call__(sensed: Sensed, memory, dt) -> Decision

written over rows: every array has one row for each vehicle that drives by this law. It returns what it remembers and is
given that at the next call (`None` at the first); it keeps nothing elsewhere and changes nothing that it is given. A
law written for one vehicle is lifted to rows by `@per_vehicle` on its `__call__`.

A law is given the scan, its vehicle's own motion and its size. It declares whatever else it needs, and what it can do:
see `Law`.
"""

from platoontraffic.controllers.law import (
    BRAKES_FOR,
    CLOSED_BY,
    Body,
    BrakingFor,
    Decision,
    Law,
    RouteAhead,
    Sensed,
    Signals,
    Target,
    per_vehicle,
)

__all__ = [
    "BRAKES_FOR",
    "CLOSED_BY",
    "Body",
    "BrakingFor",
    "Decision",
    "Law",
    "RouteAhead",
    "Sensed",
    "Signals",
    "Target",
    "per_vehicle",
]
