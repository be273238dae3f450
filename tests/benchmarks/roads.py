"""Anybody's roads: `platoontraffic prove --traffic` on many networks, and its figures over all of them. Markdown.

    python tests/benchmarks/roads.py FOLDER [NET|CFG ...] [--seeds 5] [--duration 600]

Networks that are generated here, with every type of junction, and SUMO configurations of eclipse-sumo's own games; also
those that are given. What a road gave is kept in the folder, and driven again where that file is removed: so a run that
was interrupted goes on.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import sumo

sys.path.insert(0, str(Path(__file__).parents[2]))
from platoontraffic.analysis.limits import poisson_limits
from platoontraffic.prove.traffic import LATEST
from tests.support.generated import JUNCTIONS, generated, kinked, roundabouts

GAMES = "bs3d", "fkk_in", "fokr_bs_demo", "grid6"  # not those whose lights only a player changes
LATEST_OVER_ROADS = 1.1  # bar of the median over all roads
HEADINGS = "road", "arrive", "last", "last*", "hours", "caused", "red", "yield", "splits", "stood [s]", ""


def roads(folder: Path) -> Iterator[tuple[str, Path]]:
    """Generated networks, and configurations of SUMO's games, by name."""
    folder.mkdir(parents=True, exist_ok=True)
    make = partial(generated, folder)
    for junction in JUNCTIONS:
        yield f"grid {junction}", make("grid", junction)
    yield "grid lights, three lanes", make("grid", "traffic_light", 3)
    yield "spider", make("spider", "priority", 2)
    yield "random", make("random", "priority", 1, seed=5)
    yield "random, two lanes", make("random", "priority", 2, seed=909)
    yield "random lights, two lanes", make("random", "traffic_light", 2, seed=301)
    yield "random, left-hand", make("random", "right_before_left", 2, "--lefthand", seed=303)
    yield "random, kinked", kinked(make("random", "priority", 2, seed=7), 2.0, 7)
    yield "short streets", make("short", "priority", 1)
    for lanes in (1, 2):
        yield f"roundabouts {lanes}", roundabouts(folder, lanes)
    yield "grid, left-hand, two lanes", make("grid", "priority", 2, "--lefthand", seed=31)
    yield "random zipper, two lanes", make("random", "zipper", 2, seed=32)
    for game in GAMES:
        yield game, Path(sumo.SUMO_HOME, "tools", "game", f"{game}.sumocfg")


def proved(folder: Path, options: list[str], name: str, file: Path) -> dict | None:
    """What `prove` has found on a road; None if it failed."""
    kept = folder / f"{name.replace(' ', '_')}.json"
    if not kept.is_file():
        command = [sys.executable, "-m", "platoontraffic", "prove", str(file), "--traffic", "--json", *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if not done.stdout:
            print(f"{name}: {done.stderr.strip()[-500:]}", file=sys.stderr)
            return None
        kept.write_text(done.stdout, encoding="utf-8")
    return json.loads(kept.read_text(encoding="utf-8"))


def row(name: str, found: dict | None) -> list[str]:
    if found is None:
        return [name, *[""] * (len(HEADINGS) - 2), "failed"]
    rides = [pair["platoons"] for pair in found["pairs"] if pair["platoons"]]
    arrived = f"{sum(len(ride['arrivals']) for ride in rides)}/{sum(ride['vehicles'] for ride in rides)}"
    counts = found["caused"], found["red_lights"], found["failures_to_yield"], sum(ride["splits"] for ride in rides)
    stood = max((one["lasts"] for ride in rides for one in ride["stands"]), default=0.0)
    ratios = ["" if found[key] is None else f"{found[key]:.2f}" for key in ("ratio", "ratio_overlapping")]
    verdict = "holds" if found["holds"] else "; ".join(found["faults"])
    return [name, arrived, *ratios, f"{found['hours']:.2f}", *map(str, counts), f"{stood:.0f}", verdict]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="for networks and results")
    parser.add_argument("more", type=Path, nargs="*", help="further networks or configurations")
    parser.add_argument("--seeds", default="5")
    parser.add_argument("--duration", default="600")
    args = parser.parse_args()
    options = ["--seeds", args.seeds, "--duration", args.duration]
    print("Last arrival as multiple of that of SUMO's own cars; *: where these drive through others\n")
    print(f"| {' | '.join(HEADINGS)} |\n|{'---|' * len(HEADINGS)}")
    found = []
    for name, file in [*roads(args.folder / "nets"), *((file.parent.name, file) for file in args.more)]:
        one = proved(args.folder, options, name, file)
        print(f"| {' | '.join(row(name, one))} |", flush=True)
        found += [one] if one else []
    ratios = sorted(one["ratio"] or math.inf for one in found if one["compared"])
    hours, yields = math.fsum(one["hours"] for one in found), sum(one["failures_to_yield"] for one in found)
    low, high = (limit / hours for limit in poisson_limits(yields))
    print(
        f"\n{len(found)} roads, {hours:.1f} vehicle hours. Last arrival: median {statistics.median(ratios):.3f} of "
        f"{len(ratios)} roads (bar {LATEST_OVER_ROADS}), greatest {ratios[-1]:.2f} (bar {LATEST}). "
        f"{sum(one['caused'] for one in found)} contacts caused, {sum(one['red_lights'] for one in found)} red lights, "
        f"{yields} failures to yield: {yields / hours:.2f} an hour, 95 % limits {low:.2f} to {high:.2f} (bar 0.1)."
    )


if __name__ == "__main__":
    main()
