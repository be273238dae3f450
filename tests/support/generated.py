"""Networks that netgenerate and netconvert make: every type of junction, one to three lanes, kinks, left-hand traffic.

They need eclipse-sumo; tests take the folder for them from the fixture `generated_nets`, which is skipped without it.
"""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from platoontraffic.road.netconvert import HEADER
from platoontraffic.sumo.programs import home_of, program

JUNCTIONS = (
    "priority", "right_before_left", "allway_stop", "priority_stop", "traffic_light", "zipper", "unregulated",
)  # fmt: skip
LAYOUTS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "grid": ("--grid", "--grid.number=4", "--grid.length=120", "--grid.attach-length=60"),
        "spider": ("--spider", "--spider.arm-number=5", "--spider.circle-number=3", "--spider.space-radius=90"),
        "random": ("--rand", "--rand.iterations=60", "--rand.min-distance=40", "--rand.max-distance=160"),
        # Streets no longer than a few cars: lane changes, curves and stop lines come close together.
        "short": ("--rand", "--rand.iterations=60", "--rand.min-distance=12", "--rand.max-distance=40"),
    }
)
ROUNDABOUT = 18.0  # radius of the circle that `roundabouts` makes of each crossing [m]


def generated(
    folder: Path, layout: str = "grid", junction: str = "priority", lanes: int = 1, *more: str, seed: int = 1
) -> Path:
    """Write a network; equal arguments give equal bytes.

    layout : key of LAYOUTS
    junction : one of JUNCTIONS
    more   : further options of netgenerate, such as --lefthand
    """
    name = "_".join([layout, junction, str(lanes), *(word.strip("-").replace("=", "") for word in more), str(seed)])
    file = folder / f"{name}.net.xml"
    if not file.is_file():
        options = [f"--default-junction-type={junction}", f"--default.lanenumber={lanes}", f"--seed={seed}"]
        _run("netgenerate", *LAYOUTS[layout], *options, "--no-turnarounds", *more, f"--output-file={file}")
        _without_header(file)
    return file


def crossroads(folder: Path) -> Path:
    """Two roads of two lanes each way that cross at a light, whose second phase is green for west and east.

    A test that needs it is skipped where there is no netconvert.
    """
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    arms = {"w": (-200, 0), "e": (200, 0), "s": (0, -200), "n": (0, 200)}
    nodes = [f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, (x, y) in arms.items()]
    edges = [
        f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2"/>' for arm in arms for a, b in ((arm, "c"), ("c", arm))
    ]
    nodes.append('<node id="c" x="0" y="0" type="traffic_light"/>')
    files = {"nod": f"<nodes>{''.join(nodes)}</nodes>", "edg": f"<edges>{''.join(edges)}</edges>"}
    for kind, text in files.items():
        (folder / f"cross.{kind}.xml").write_text(text)
    file = folder / "cross.net.xml"
    sources = f"--node-files={folder / 'cross.nod.xml'}", f"--edge-files={folder / 'cross.edg.xml'}"
    # Green for good, without arrows: left turns give way.
    _run("netconvert", *sources, "--tls.green.time=1000", "--no-turnarounds", f"--output-file={file}")
    return file


def corner(folder: Path, turn: float) -> Path:
    """A road of two lanes from w to c that turns to the right there, by an angle [degrees], to x.

    A test that needs it is skipped where there is no netconvert.
    """
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    at = np.radians(-turn)
    nodes = {"w": (-100, 0), "c": (0, 0), "x": (100 * np.cos(at), 100 * np.sin(at))}
    nodes = [f'<node id="{name}" x="{x:.2f}" y="{y:.2f}"/>' for name, (x, y) in nodes.items()]
    edges = [f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2"/>' for a, b in ("wc", "cx")]
    files = {"nod": f"<nodes>{''.join(nodes)}</nodes>", "edg": f"<edges>{''.join(edges)}</edges>"}
    for kind, text in files.items():
        (folder / f"corner.{kind}.xml").write_text(text)
    file = folder / f"corner{turn:.0f}.net.xml"
    sources = f"--node-files={folder / 'corner.nod.xml'}", f"--edge-files={folder / 'corner.edg.xml'}"
    _run("netconvert", *sources, "--no-turnarounds", f"--output-file={file}")
    return file


def turnabout(folder: Path) -> Path:
    """A road from w to e through a large junction c, in which the way from n to m leads across it, and back farther on.

    The paths meet at x = -12 and 12 m.
    """
    nodes = {"w": (-200, 0), "c": (0, 0), "e": (200, 0), "n": (-60, 200), "m": (60, 200)}
    nodes = [f'<node id="{name}" x="{x}" y="{y}" type="unregulated" radius="30"/>' for name, (x, y) in nodes.items()]
    edges = [f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="1"/>' for a, b in ("wc", "ce", "nc", "cm")]
    shape, lane = "-12,30 -12,-15 12,-15 12,30", 'fromLane="0" toLane="0"'
    links = [f'<connection from="wc" to="ce" {lane}/>', f'<connection from="nc" to="cm" {lane} shape="{shape}"/>']
    kinds = {"nod": ("nodes", nodes), "edg": ("edges", edges), "con": ("connections", links)}
    for kind, (root, rows) in kinds.items():
        (folder / f"back.{kind}.xml").write_text(f"<{root}>{''.join(rows)}</{root}>")
    file, options = folder / "back.net.xml", (("node", "nod"), ("edge", "edg"), ("connection", "con"))
    sources = [f"--{name}-files={folder / f'back.{kind}.xml'}" for name, kind in options]
    _run("netconvert", *sources, "--offset.disable-normalization", f"--output-file={file}")
    return file


def lane_that_ends(folder: Path, length: float) -> Path:
    """A road of two lanes, A, and one as long as given, B [m]. From B_1 a road leads on to the north, C.

    A test that needs it is skipped where there is no netconvert.
    """
    pytest.importorskip("sumo", reason="netconvert comes with eclipse-sumo: pip install platoontraffic[gui]")
    ends = 200 + length
    nodes = {"a": (0, 0), "b": (200, 0), "c": (ends, 0), "d": (ends + 200, 0), "e": (ends, 200)}
    nodes = [f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in nodes.items()]
    edges = [("A", "a", "b", 2), ("B", "b", "c", 2), ("C", "c", "e", 1), ("D", "c", "d", 1)]
    edges = [f'<edge id="{name}" from="{a}" to="{b}" numLanes="{lanes}"/>' for name, a, b, lanes in edges]
    links = [f'<connection from="B" to="{onto}" fromLane="{lane}" toLane="0"/>' for lane, onto in enumerate(("D", "C"))]
    kinds = {"nod": ("nodes", nodes), "edg": ("edges", edges), "con": ("connections", links)}
    for kind, (root, rows) in kinds.items():
        (folder / f"ends.{kind}.xml").write_text(f"<{root}>{''.join(rows)}</{root}>")
    file = folder / f"ends{length:.0f}.net.xml"
    options = ("node", "nod"), ("edge", "edg"), ("connection", "con")
    sources = [f"--{name}-files={folder / f'ends.{kind}.xml'}" for name, kind in options]
    _run("netconvert", *sources, f"--output-file={file}")
    return file


def roundabouts(folder: Path, lanes: int = 1, arms: int = 4, count: int = 3) -> Path:
    """Write a street with roundabouts, each with side roads."""
    file = folder / f"roundabouts_{lanes}_{arms}_{count}.net.xml"
    if file.is_file():
        return file
    nodes, edges, rings = [], [], []
    for c in range(count):
        centre = np.array([c * 200.0, 0.0])
        turns = 2 * np.pi * np.arange(arms) / arms
        for k, turn in enumerate(turns):
            way = np.array([np.cos(turn), np.sin(turn)])
            nodes.append((f"r{c}.{k}", centre + ROUNDABOUT * way))
            joins_next = k == 0 and c + 1 < count
            joins_last = turn == np.pi and c > 0
            end = f"r{c + 1}.{arms // 2}" if joins_next else f"e{c}.{k}"
            if not joins_next and not joins_last:
                nodes.append((end, centre + 100.0 * way))
            if not joins_last:
                edges += [(f"o{c}.{k}", f"r{c}.{k}", end, ()), (f"i{c}.{k}", end, f"r{c}.{k}", ())]
            onward = [centre + ROUNDABOUT * np.array([np.cos(a), np.sin(a)])
                      for a in np.linspace(turn, turn + 2 * np.pi / arms, 8)]  # fmt: skip
            edges.append((f"c{c}.{k}", f"r{c}.{k}", f"r{c}.{(k + 1) % arms}", onward))
        ring = " ".join(f"r{c}.{k}" for k in range(arms)), " ".join(f"c{c}.{k}" for k in range(arms))
        rings.append(f'<roundabout nodes="{ring[0]}" edges="{ring[1]}"/>')
    shape = lambda points: f' shape="{" ".join(f"{x:.2f},{y:.2f}" for x, y in points)}"' if len(points) else ""  # noqa: E731
    texts = {
        "nod": ["<nodes>", *(f'<node id="{n}" x="{x:.2f}" y="{y:.2f}"/>' for n, (x, y) in nodes), "</nodes>"],
        "edg": [
            "<edges>",
            *(f'<edge id="{i}" from="{a}" to="{b}" numLanes="{lanes}" speed="{8.33 if s else 13.89}"{shape(s)}/>'
              for i, a, b, s in edges),
            *rings,
            "</edges>",
        ],
    }  # fmt: skip
    options = []
    for kind, lines in texts.items():
        source = file.with_name(f"{file.name.removesuffix('.net.xml')}.{kind}.xml")
        source.write_text("\n".join(lines), encoding="utf-8")
        options.append(f"--{'node' if kind == 'nod' else 'edge'}-files={source}")
    _run("netconvert", *options, "--no-turnarounds.except-deadend", f"--output-file={file}")
    _without_header(file)
    return file


def kinked(net: Path, shift: float, seed: int) -> Path:
    """Write a copy of a network whose lanes have kinks, as in networks that were drawn by hand or imported.

    Of every lane of a road the inner points, and new ones between them, are shifted at random. Ends stay, so that the
    lanes still join. The lanes of an edge are shifted alike. Lengths are those of the new lines.

    shift : greatest displacement, in x and in y [m]
    """
    file = net.with_name(f"{net.name.removesuffix('.net.xml')}_kinked{shift:g}_{seed}.net.xml")
    rng = np.random.default_rng(seed)
    tree = ET.parse(net)
    for edge in tree.getroot().iter("edge"):
        if edge.get("function", "normal") != "normal":
            continue
        lanes = edge.findall("lane")
        longest = max(len(lane.get("shape").split()) for lane in lanes)
        share = np.unique(np.concatenate([np.linspace(0, 1, longest), rng.uniform(0.05, 0.95, rng.integers(1, 4))]))
        away = rng.uniform(-shift, shift, (len(share), 2))
        away[[0, -1]] = 0.0
        for lane in lanes:
            points = np.array([tuple(map(float, point.split(",")[:2])) for point in lane.get("shape").split()])
            at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
            moved = np.column_stack([np.interp(share * at[-1], at, points[:, i]) for i in (0, 1)]) + away
            lane.set("shape", " ".join(f"{x:.2f},{y:.2f}" for x, y in moved))
            lane.set("length", f"{np.hypot(*np.diff(moved, axis=0).T).sum():.2f}")
    tree.write(file, encoding="utf-8", xml_declaration=True)
    return file


def _run(name: str, *options: str) -> None:
    file = program(name)
    done = subprocess.run([file, *options], env=home_of(file), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def _without_header(file: Path) -> None:
    """The header has the date."""
    file.write_text(HEADER.sub("", file.read_text(encoding="utf-8"), count=1), encoding="utf-8")
