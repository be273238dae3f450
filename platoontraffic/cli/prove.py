"""The command `prove`: its arguments, and the tables that it prints."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from platoontraffic import shipped
from platoontraffic.cli.nets import file_of
from platoontraffic.cli.printing import out, print_json, print_wide
from platoontraffic.cli.progress import err
from platoontraffic.errors import InputError, counted, did_you_mean
from platoontraffic.prove.plans import Road
from platoontraffic.road.demand import read_demand
from platoontraffic.road.network import Network, read_configuration
from platoontraffic.vehicles.bicycle import CARS
from platoontraffic.vehicles.catalogue import VEHICLES

if TYPE_CHECKING:
    from platoontraffic.prove.alone import Drive
    from platoontraffic.prove.rides import Ride
    from platoontraffic.prove.traffic import Pair, Verdict

INCIDENTS = 10  # that are printed
CONFIGURATIONS = (".sumocfg", ".netecfg")


def road_of(name: str) -> Road:
    """raises: InputError if there is no such file or shipped network, or if it is not sound"""
    file = file_of(name)
    if file.suffix in CONFIGURATIONS:
        config = read_configuration(file)
        has_traffic = bool(config.routes or read_demand((), config.additional).vehicles)
        return Road(name, config.net, {"config": str(file.resolve())}, has_traffic, config.begin)
    if name in shipped.networks():
        return Road(name, file, {"net": name}, file.with_name(f"{name}.rou.xml").is_file())
    return Road(name, file, {"net": str(file.resolve())}, False)


def prove_traffic(
    road: Road, seeds: range, vehicle: str, warm_up: float, duration: float, folder: Path, as_json: bool
) -> bool:
    """Drive platoons in traffic on random routes, and SUMO's own cars in their places; whether all bars hold."""
    from platoontraffic.observation.tested import of_network
    from platoontraffic.prove.plans import planned
    from platoontraffic.prove.traffic import Verdict, pairs

    _check_times({"--warm-up": warm_up, "--duration": duration})
    network = Network.read(road.net)
    for warning in of_network(road.name, network):
        print(f"warning: {warning}", file=sys.stderr)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--results: {folder}: {error.strerror}; must be a folder") from error
    given = {"vehicle": vehicle, "warm_up": warm_up, "duration": duration}
    plans = [planned(road, network, seed, folder / f"seed-{seed}", **given) for seed in seeds]
    made = []
    with _bar("seeds", len(plans)) as show:
        for pair in pairs(plans, network, folder):
            made.append(pair)
            show(len(made))
    verdict = Verdict.of(sorted(made))
    if as_json:
        print_json(
            {
                "road": road.name,
                "net": str(road.net),
                "vehicle": vehicle,
                "holds": verdict.holds,
                "compared": not verdict.not_compared,
                **jsonable(verdict),
            }
        )
    else:
        _print_verdict(verdict, road)
    return verdict.holds


def _check_times(times: dict[str, float]) -> None:
    from platoontraffic.prove.plans import STEP

    faults = [f"{name}: {time:g}: must be a multiple of {STEP:g} s" for name, time in times.items()
              if math.isinf(time) or abs(round(time / STEP) - time / STEP) > 1e-6]  # fmt: skip
    if faults:
        raise InputError(*faults)


def jsonable(value: Any) -> Any:
    """Records as objects; numbers that are not finite as null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "_asdict"):
        return {name: jsonable(one) for name, one in value._asdict().items()}
    return [jsonable(one) for one in value] if isinstance(value, tuple | list) else value


def _print_verdict(verdict: Verdict, road: Road) -> None:
    """A line for each run, then a line on all."""
    columns = ("seed", "", "arrive", "last", "ratio", "delay", "contacts", "caused", "red", "yield", "splits", "stood")
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in columns:
        table.add_column(column, justify="right" if column else "left", no_wrap=True)
    for pair in verdict.pairs:
        table.add_row(str(pair.seed), "members", *_cells(pair.platoons, _number(pair.ratio, ".2f"), own=True))
        table.add_row("", "SUMO's", *_cells(pair.sumo, "", own=False))
    print_wide(table)
    low, high = verdict.yield_limits
    sizes = sorted({pair.size for pair in verdict.pairs})
    small = f"; platoons of {' and '.join(map(str, sizes))}, for want of longer lanes" if sizes != [5] else ""
    if alone := sum(len(pair.routes) == 1 for pair in verdict.pairs):
        small += f"; one platoon only with {alone} of {len(verdict.pairs)} seeds, for want of another start"
    fewest, most = (of(pair.cars for pair in verdict.pairs) for of in (min, max))
    many = counted(most, "car") if fewest == most else f"{fewest} to {most} cars"
    own = "" if road.has_traffic else f"; random traffic of this command, {many}"
    where = (verdict.ratio, ""), (verdict.ratio_overlapping, " where SUMO's own cars drive through others")
    last = [
        f"last arrival {ratio:.2f} times that of SUMO's own cars{seeds} (median of the seeds), "
        for ratio, seeds in where
        if math.isfinite(ratio)
    ]
    by_road = f" (and {verdict.by_road} where lanes of two directions overlap)" if verdict.by_road else ""
    out.print(
        f"{road.name}{small}{own}: {''.join(last)}{verdict.hours:.2f} vehicle hours, "
        f"{counted(verdict.caused, 'contact')} caused{by_road}, {counted(verdict.red_lights, 'red light')}, "
        f"{counted(verdict.failures_to_yield, 'failure')} to yield (95 % limits {low:.2f} to {high:.2f} an hour)",
        soft_wrap=True,
        markup=False,
    )
    for pair in verdict.pairs:
        _print_stands(pair)
    _print_incidents(verdict)
    for fault in verdict.faults:
        out.print(f"fails: {fault}", soft_wrap=True, markup=False)
    if verdict.holds:
        why = verdict.not_compared
        out.print(f"holds, but {why}: times are not compared" if why else "holds", soft_wrap=True)


def _cells(ride: Ride | None, ratio: str, own: bool) -> Iterator[str]:
    """A run's line of the table. own: of members; red lights and give-way violations of SUMO's cars are not known"""
    if ride is None:
        yield "failed"
        return
    yield from (f"{len(ride.arrivals)}/{ride.vehicles}", _number(ride.last_arrival, ".0f"), ratio)
    yield from (_number(ride.delay, ".0f"), str(ride.contacts))
    only_own = (ride.caused, ride.red_lights, ride.failures_to_yield, ride.splits)
    yield from (str(count) if own else "" for count in only_own)
    yield f"{ride.longest_stand.lasts:.0f}" if ride.stands else ""


def _print_stands(pair: Pair) -> None:
    from platoontraffic.prove.rides import reasons

    for side, ride in (("members", pair.platoons), ("SUMO's own", pair.sumo)):
        if ride and ride.stands:
            longest = ride.longest_stand
            stood = f"seed {pair.seed}, {side}: {longest.vehicle} stood for {longest.lasts:.0f} s"
            if ride is pair.platoons:  # why SUMO's own cars stand is not known
                counts = (f"{count} {word}" for word, count in sorted(reasons(ride.stands).items()))
                why = longest.why.partition(": ")[2] or longest.why
                out.print(f"{stood} ({why}); standstills over 10 s: {', '.join(counts)}", soft_wrap=True, markup=False)
            else:
                out.print(f"{stood}; {counted(len(ride.stands), 'standstill')} over 10 s", soft_wrap=True)


def _print_incidents(verdict: Verdict) -> None:
    """The first ones of all seeds, to look for in events.csv."""
    lines = [
        f"seed {pair.seed}, {one.time:g} s: {one.vehicle} {one.kind} {one.other} on {one.edge} ({one.detail})"
        for pair in verdict.pairs
        if pair.platoons
        for one in pair.platoons.incidents
    ]
    more = [f"and {len(lines) - INCIDENTS} more"] if len(lines) > INCIDENTS else []
    for line in [*lines[:INCIDENTS], *more]:
        out.print(line, soft_wrap=True, markup=False)


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "-"


def check_vehicle(name: str) -> None:
    """raises: InputError if it is not steered by its front wheels"""
    if name in VEHICLES and name not in CARS:
        raise InputError(f"--vehicle: {name!r}: is not steered by its wheels; must be car, van or truck")
    if name not in CARS:
        raise InputError(f"--vehicle: no such vehicle {name!r}{did_you_mean(name, CARS)}")


def prove_alone(road: Road, routes: int, seed: int, vehicle: str, as_json: bool) -> bool:
    """Drive random routes alone and print how; whether all bars hold."""
    from platoontraffic.prove.alone import drives

    with _bar("routes", routes) as show:
        driven = drives(Network.read(road.net), routes, seed, vehicle, show)
    holds = all(drive.holds for drive in driven)
    driven.sort(key=lambda drive: (drive.arrived, -drive.beyond, -drive.lateral))
    if as_json:
        facts = {"road": road.name, "net": str(road.net), "vehicle": vehicle, "seed": seed, "wanted": routes}
        print_json(facts | {"holds": holds, "routes": [drive._asdict() | {"holds": drive.holds} for drive in driven]})
    else:
        _print_drives(driven, road, routes)
    return holds


def _print_drives(driven: Sequence[Drive], road: Road, wanted: int) -> None:
    """The worst route first, then a line on all."""
    from platoontraffic.prove.alone import MOST_BEYOND, MOST_LATERAL

    headings = ("from", "to", "m", "off line", "beyond least", "at x, y", "lane", "m/s2", "time", "free", "")
    table = Table(box=None, header_style="bold", pad_edge=False)
    for heading in headings:
        left = heading in ("from", "to", "lane", "")
        table.add_column(heading, justify="left" if left else "right", no_wrap=True, max_width=18 if left else None)
    for one in driven:
        fault = "" if one.holds else "fails" if one.arrived else "does not arrive"
        table.add_row(
            *(one.start, one.end, f"{one.length:.0f}", f"{one.off:.2f}", f"{one.beyond:.2f}"),
            *(
                f"{one.x:.1f}, {one.y:.1f}",
                one.lane,
                f"{one.lateral:.1f}",
                f"{one.time:.0f}",
                f"{one.free_time:.0f}",
            ),
            fault,
        )
    print_wide(table)
    arrived, failing = sum(one.arrived for one in driven), sum(not one.holds for one in driven)
    some = f"only {len(driven)} of {wanted} routes were found; " if len(driven) < wanted else ""
    short, longest = min(one.length for one in driven), max(one.length for one in driven)
    out.print(
        f"{road.name}: {some}{counted(len(driven), 'route')} of {short:.0f} to {longest:.0f} m, "
        f"{arrived} arrive; at most {max(one.beyond for one in driven):.2f} m (bar {MOST_BEYOND:g}) beyond the least "
        f"distance from the line, lateral acceleration at most {max(one.lateral for one in driven):.1f} m/s2 "
        f"(bar {MOST_LATERAL:g})",
        soft_wrap=True,
        markup=False,
    )
    out.print(f"{failing} of {len(driven)} routes fail" if failing else "holds")


@contextmanager
def _bar(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A function that shows how many are done in a bar on stderr, if that is a terminal."""
    if not err.is_terminal:
        yield lambda done: None
        return
    columns = [TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed} of {task.total}")]
    with Progress(*columns, TimeElapsedColumn(), console=err, transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done: bar.update(task, completed=done)
