"""The commands on networks: list the shipped ones, build, check, edit, and take edited ones back into sources."""

from __future__ import annotations

import os
import re
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from platoontraffic import shipped
from platoontraffic.cli.commands import commands_of
from platoontraffic.errors import InputError, RunError, did_you_mean

# The commands import what they need: numpy and shapely take a third of a second, and `--help` needs neither.

OPENED_BY = {
    "neteditConfiguration": "--netecfg-file",
    "sumoConfiguration": "--sumocfg-file",
    "net": "--sumo-net-file",
}


def described(net: Path) -> str:
    """The purpose and size of a network, in one line."""
    from platoontraffic.cli.net_content import read

    content = read(net)
    roads = content.roads()
    lanes = [lane for edge in roads.values() for lane in edge.lanes]
    counts, widths = sorted({len(edge.lanes) for edge in roads.values()}), sorted({lane.width for lane in lanes})
    ends = Counter((edge.start, edge.end) for edge in roads.values())
    road = sum(edge.lanes[0].length / (2 if ends[edge.end, edge.start] else 1) for edge in roads.values())
    lights = len({link.rules[2] for link in content.links if link.rules[2]})
    size = [
        f"{_span(counts)} lane{'s' * (counts[-1] > 1)} of {_span(widths)} m per direction",
        f"{road:.0f} m of road" if road < 1000 else f"{road / 1000:.1f} km of road",
        f"{lights or 'no'} junction{'s' * (lights != 1)} with lights",
    ]
    return f"{_purpose(net)} {', '.join(size)}.".strip()


def _span(values: list) -> str:
    return f"{values[0]:g}" if len(values) == 1 else f"{values[0]:g} to {values[-1]:g}"


def _purpose(net: Path) -> str:
    """The first sentence of the comment at the top of the node file."""
    from platoontraffic.cli.net_content import stem

    nodes = net.with_name(f"{stem(net)}.nod.xml")
    text = nodes.read_text(encoding="utf-8") if nodes.is_file() else ""
    comment = re.search(r"<!--\s*(.*?)\s*-->", text, re.DOTALL)
    return re.split(r"(?<=\.)\s", " ".join(comment[1].split()))[0] if comment else ""


def edit(name: str) -> None:
    """Open a shipped network, a network or a configuration in netedit, and wait until it is closed.

    raises : InputError; MissingError without eclipse-sumo or a display; RunError where netedit fails
    """
    from platoontraffic.cli.net_sources import root_of, run_program
    from platoontraffic.sumo.programs import need_display, no_display, program

    net = shipped.networks().get(name)
    path = net.with_name(f"{name}.netecfg") if net else file_of(name)
    if path.suffix == ".gz":
        raise InputError(f"{path}: is gzipped; unpack it first")
    root = root_of(path, "a shipped network's name, a .net.xml, a .netecfg or a .sumocfg")
    if root.tag not in OPENED_BY:
        raise InputError(f"{path}: root element is <{root.tag}>; must be one of: {', '.join(OPENED_BY)}")
    netedit = program("netedit")
    need_display("netedit")
    done = run_program(netedit, OPENED_BY[root.tag], path.resolve())
    if "unable to open display" in done.stderr:
        raise no_display("netedit")
    if done.returncode:
        raise RunError(f"{path}: netedit ended with {done.returncode}: {done.stderr.strip().rpartition(chr(10))[2]}")


def file_of(name: str) -> Path:
    """The file of a network, given its shipped name or its path."""
    networks = shipped.networks()
    if name not in networks and not Path(name).exists():
        hint = "" if os.sep in name or "." in name else did_you_mean(name, networks)
        raise InputError(f"{name}: no such file, nor a shipped network{hint}")
    return networks.get(name, Path(name))


nets_app = typer.Typer(help="Road networks: list, build, check, edit, import.", no_args_is_help=True)
out = Console(highlight=False, soft_wrap=True)
command = commands_of(nets_app)
NetName = Annotated[str, typer.Argument(metavar="NET", help="network file, or name of a shipped network")]


@command
def list_nets() -> None:
    """List the shipped networks."""
    for name, net in shipped.networks().items():
        out.print(f"{name:12} {described(net)}")


@command
def build_command(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="netconvert configuration (.netccfg)")],
    to: Annotated[
        Path | None, typer.Option("-o", "--to", help="network to write; default: the one that CONFIG names")
    ] = None,
) -> None:
    """Build a network from its plain sources."""
    from platoontraffic.cli.net_sources import build

    print(build(config, to))


@command
def check_command(
    nets: Annotated[list[str], typer.Argument(metavar="NET...", help="network files, or names of shipped networks")],
    every: Annotated[bool, typer.Option("--all", help="list every place, not only the worst of each kind")] = False,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="draw the network with the places marked; one NET")
    ] = None,
) -> None:
    """Report faults of networks, and where cars cannot drive, or not well: the worst first."""
    from platoontraffic.cli.net_findings import Findings, findings, lines_of

    faults: list[str] = []
    if plot and len(nets) > 1:
        raise InputError(f"--plot: {plot}: has room for one network; there are {len(nets)}")
    for name in nets:
        try:
            found = findings(net := file_of(name))
        except InputError as error:
            found, net = Findings(error.faults), Path(name)
        faults += found.faults
        for kind in found.kinds:
            for line in lines_of(kind, every):
                out.print(line if line[0] == " " else f"{net}: note: {line}", markup=False)
        if not found.faults and not found.kinds:
            out.print(f"{net}: fine", markup=False)
        if plot and not found.faults:
            from platoontraffic.cli.net_picture import draw

            draw(found, net.name, plot)
            print(plot)
    if faults:
        raise InputError(*faults)


@command
def edit_command(
    name: Annotated[str, typer.Argument(metavar="NAME|NET|NETECFG", help="name of a shipped network, or a file")],
) -> None:
    """Open a network in netedit."""
    edit(name)


@command
def import_command(
    net: NetName,
    folder: Annotated[Path, typer.Argument(help="folder for the sources; created if missing")],
    force: Annotated[bool, typer.Option("--force", help="replace existing sources; their comments are lost")] = False,
) -> None:
    """Turn a network, for instance one saved by netedit, back into plain sources."""
    from platoontraffic.cli.net_sources import import_net

    written = import_net(file_of(net), folder, force)
    for path in written:
        print(path)
