"""Programs of traffic lights, as a network file has them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from platoontraffic.road.sumo_configuration import in_seconds
from platoontraffic.road.sumo_files import NETWORK, parse

GREEN = ("g", "G")
STATIC = "static"  # type of a light that keeps to the durations of its phases

Program = list[tuple[str, float]]  # the states of a light, and the longest time of each [s]


def longest_closed(net: Path) -> dict[tuple[str, int], float]:
    """Longest time without green [s], by light and number of the link; of several programs, of the one that has most.

    0 for a link that never opens, and for one that is always open.

    raises : InputError (the file cannot be read)
    """
    programs: list[tuple[str, Program]] = []
    is_static = True  # the light that is read

    def start(tag: str, attributes: dict[str, str], _: object) -> None:
        nonlocal is_static
        if tag == "tlLogic":
            programs.append((attributes.get("id", ""), []))
            is_static = attributes.get("type", STATIC) == STATIC
        elif tag == "phase" and programs:
            duration = attributes.get("duration", "0")
            lasts = duration if is_static else attributes.get("maxDur", duration)
            programs[-1][1].append((attributes.get("state", ""), in_seconds(lasts)))

    parse(net, start, f"must be {NETWORK}")
    found: dict[tuple[str, int], float] = {}
    for light, program in programs:
        for index in range(max((len(state) for state, _ in program), default=0)):
            phases = [(state[index : index + 1] in GREEN, lasts) for state, lasts in program]
            found[light, index] = max(_longest_closed(phases), found.get((light, index), 0.0))
    return found


def _longest_closed(phases: Sequence[tuple[bool, float]]) -> float:
    """Longest time between two open phases of a cycle [s]. phases: whether each is open, and its time [s]"""
    opens = next((k for k, (is_open, _) in enumerate(phases) if is_open), None)
    if opens is None:
        return 0.0
    cycle = [*phases[opens:], *phases[:opens]]
    runs = groupby(cycle, key=lambda phase: phase[0])
    return max((sum(lasts for _, lasts in run) for is_open, run in runs if not is_open), default=0.0)
