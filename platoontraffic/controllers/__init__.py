"""Control laws: one file a law. A law turns what a vehicle senses into a command.

A law is a frozen dataclass of its gains with

    __call__(sensed: Sensed, memory, dt) -> Decision

written over rows: every array has one row a vehicle that drives by this law. What it remembers it returns and is given
back at the next call (`None` at the first); it must keep nothing elsewhere. A law written for one vehicle is lifted to
rows by `@per_vehicle` on its `__call__`.

What a law is given is the scan, its vehicle's own motion and its size. More has to be declared:
`needs = {"route", "signals"}`.
"""

from platoontraffic.controllers.law import CLOSED_BY, Body, Decision, RouteAhead, Sensed, Signals, Target, per_vehicle

__all__ = ["CLOSED_BY", "Body", "Decision", "RouteAhead", "Sensed", "Signals", "Target", "per_vehicle"]
