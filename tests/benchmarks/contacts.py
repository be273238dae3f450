"""Contacts of members in `highway_traffic` over several seeds, with exact Poisson limits of their rate.

    .venv/bin/python tests/benchmarks/contacts.py [--seeds 1 2 3 ...] [--seconds 420] [KEY=VALUE ...]

Prints a line a seed: contacts of members, those that a member caused (as the metric collisions_caused counts them), and
member hours; then both with the rates an hour that 95 % limits allow.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from platoontraffic.analysis.limits import poisson_limits
from platoontraffic.results.metrics import CAUSED_BY_OTHER, CAUSED_BY_ROAD
from platoontraffic.simulation import Simulation


def contacts(seed: int, seconds: float, changes: Sequence[str]) -> tuple[list, list, float]:
    """The events of contact, those of which a member is the cause, and the hours that members were on the road."""
    found, hours = [], 0.0
    with Simulation.load("highway_traffic", f"run.duration_s={seconds:g}", *changes, seed=seed) as simulation:
        for now in simulation:
            found += [event for event in now.events if event.kind == "collision"]
            hours += len(now.fleet) * simulation.setting.dt / 3600
        members = {member.id for member in simulation.setting.members}
    by_road = [event for event in found if event.what in CAUSED_BY_ROAD]
    by_other = [event for event in found if event.what in CAUSED_BY_OTHER and event.other not in members]
    caused = [event for event in found if event not in by_road + by_other]
    return found, caused, hours


def limits(count: int, hours: float) -> str:
    """The rate and its exact 95 % limits."""
    low, high = (limit / hours for limit in poisson_limits(count))
    return f"{count} in {hours:.2f} h: {count / hours:.2f} per hour, 95 % limits {low:.2f} to {high:.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 11)))
    parser.add_argument("--seconds", type=float, default=420.0)
    parser.add_argument("changes", nargs="*", metavar="KEY=VALUE")
    options = parser.parse_args()
    of_all = of_members = 0
    hours = 0.0
    for seed in options.seeds:
        found, caused, driven = contacts(seed, options.seconds, options.changes)
        of_all, of_members, hours = of_all + len(found), of_members + len(caused), hours + driven
        print(f"seed {seed}: {len(found)} contacts, {len(caused)} caused by members, {driven:.2f} member hours")
        for event in found:
            print(f"  {event.time:.1f} s {event.vehicle} {event.other} {event.what}: {event.detail}", flush=True)
    print("contacts:", limits(of_all, hours))
    print("caused by members:", limits(of_members, hours))


if __name__ == "__main__":
    main()
