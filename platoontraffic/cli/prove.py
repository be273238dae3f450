"""The command `prove`: its arguments, and the tables that it prints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from platoontraffic import shipped
from platoontraffic.cli.nets import file_of
from platoontraffic.cli.printing import out, print_json
from platoontraffic.cli.progress import err
from platoontraffic.errors import InputError, did_you_mean
from platoontraffic.road.network import Network, read_configuration
from platoontraffic.vehicles.bicycle import CARS

if TYPE_CHECKING:
    from platoontraffic.prove.alone import Drive

WIDTH = 120  # of the tables [characters]
CONFIGURATIONS = (".sumocfg", ".netecfg")


class Road(NamedTuple):
    """The network that is proved, and where its traffic comes from."""

    net: Path
    sumo: dict[str, str]  # the table `sumo` of a scenario on this road
    own_traffic: bool  # brought by a configuration or a shipped network


def road_of(name: str) -> Road:
    """raises: InputError if there is no such file or shipped network, or if it is not sound"""
    file = file_of(name)
    if file.suffix in CONFIGURATIONS:
        config = read_configuration(file)
        return Road(config.net, {"config": str(file.resolve())}, bool(config.routes))
    if name in shipped.networks():
        return Road(file, {"net": name}, file.with_name(f"{name}.rou.xml").is_file())
    return Road(file, {"net": str(file.resolve())}, False)


def check_vehicle(name: str) -> None:
    """raises: InputError if it is not steered by its front wheels"""
    if name not in CARS:
        raise InputError(f"--vehicle: {name!r}: must be {', '.join(CARS)}{did_you_mean(name, CARS)}")


def prove_alone(road: Road, routes: int, seed: int, vehicle: str, as_json: bool) -> bool:
    """Drive random routes alone and print how; whether all bars hold."""
    from platoontraffic.prove.alone import drives

    with _bar("routes", routes) as advance:
        driven = []
        for drive in drives(Network.read(road.net), routes, seed, vehicle):
            driven.append(drive)
            advance()
    holds = all(drive.holds for drive in driven)
    driven.sort(key=lambda drive: (drive.arrived, -drive.beyond, -drive.lateral))
    if as_json:
        table = [drive._asdict() | {"holds": drive.holds} for drive in driven]
        print_json({"net": str(road.net), "vehicle": vehicle, "seed": seed, "wanted": routes, "holds": holds,
                    "routes": table})  # fmt: skip
    else:
        _print_drives(driven, road.net, routes)
    return holds


def _print_drives(driven: Sequence[Drive], net: Path, wanted: int) -> None:
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
            *(f"{one.x:.1f}, {one.y:.1f}", one.lane, f"{one.lateral:.1f}", f"{one.time:.0f}", f"{one.free_time:.0f}"),
            fault,
        )
    print_wide(table)
    arrived, failing = sum(one.arrived for one in driven), sum(not one.holds for one in driven)
    some = f"only {len(driven)} of {wanted} routes were found; " if len(driven) < wanted else ""
    short = min(one.length for one in driven)
    out.print(
        f"{net}: {some}{len(driven)} routes of {short:.0f} to {max(one.length for one in driven):.0f} m, "
        f"{arrived} arrive; at most {max(one.beyond for one in driven):.2f} m (bar {MOST_BEYOND:g}) beyond the least "
        f"distance from the line, lateral acceleration at most {max(one.lateral for one in driven):.1f} m/s2 "
        f"(bar {MOST_LATERAL:g})",
        soft_wrap=True,
        markup=False,
    )
    out.print(f"{failing} of {len(driven)} routes fail" if failing else "holds")


def print_wide(table: Table) -> None:
    """Print a table in lines of up to 120 characters even where the terminal's, or a file's, are 80."""
    Console(highlight=False, width=max(out.width, WIDTH)).print(table, crop=False)


@contextmanager
def _bar(what: str, total: int) -> Iterator[Any]:
    """A function that advances a progress bar on stderr, if that is a terminal."""
    if not err.is_terminal:
        yield lambda: None
        return
    columns = [TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed} of {task.total}")]
    with Progress(*columns, TimeElapsedColumn(), console=err, transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)
