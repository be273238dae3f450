"""Networks and their plain sources: building one from the other, and taking a network back into sources."""

from __future__ import annotations

import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from platoontraffic.cli.net_content import Content, Lane, Points, read, stem
from platoontraffic.cli.net_findings import some
from platoontraffic.errors import InputError, not_written
from platoontraffic.road.netconvert import HEADER, build_net, errors_in
from platoontraffic.road.sumo_files import check_net_file
from platoontraffic.sumo.programs import home_of, program

TOLERANCE = 0.01  # by which the shapes of a network and of the one rebuilt from its sources may differ [m]
PLAIN = ("nod", "edg", "con", "tll", "typ")  # kinds of source files, as netconvert writes them


def build(config: Path, output: Path | None = None) -> Path:
    """Build a network from its sources; returns its path. Where that fails, the old network is kept.

    output : default: the file that the configuration names
    raises : InputError; MissingError without eclipse-sumo
    """
    root = root_of(config, "a netconvert configuration (.netccfg)")
    if root.tag != "netconvertConfiguration":
        raise InputError(f"{config}: root element is <{root.tag}>; must be <netconvertConfiguration>, a .netccfg")
    if output is None:
        named = root.find(".//output-file")
        output = config.with_suffix(".net.xml") if named is None else config.parent / named.get("value", "")
    if output.is_dir() or not output.parent.is_dir():
        what = "is a folder" if output.is_dir() else f"no such folder: {output.parent}"
        raise InputError(f"{output}: {what}; must be a file to write")
    program("netconvert")
    try:
        with tempfile.TemporaryDirectory(dir=output.parent, prefix=".build-") as folder:
            built = Path(folder, "built.net.xml")
            build_net(config, built)
            check_net_file(built)
            built.replace(output)
    except OSError as error:
        raise not_written(error, output) from error
    return output


def root_of(path: Path, wanted: str) -> ET.Element:
    """The root element of an XML file.

    raises : InputError where the file is missing or not whole XML
    """
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}; must be {wanted}")
    try:
        return ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"{path}:{error.position[0]}: not whole XML; must be {wanted}") from None


def run_program(program: Path, *arguments: str | Path, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a program of eclipse-sumo in a folder, with its own data."""
    return subprocess.run([program, *arguments], cwd=folder, env=home_of(program), capture_output=True, text=True)


def import_net(net: Path, folder: Path, force: bool = False) -> list[Path]:
    """Turn a network back into plain sources and a .netccfg that builds an equal one; returns the files written.

    Nothing is written unless the sources build a network with the same lanes, connections, junctions and lights.

    force  : replace files that exist
    raises : InputError; MissingError without eclipse-sumo
    """
    from platoontraffic.analysis.writing import write  # here, because it takes long to import

    content = read(net)
    netconvert = program("netconvert")
    with tempfile.TemporaryDirectory(prefix="platoontraffic-") as temporary:
        sources = _plain_sources(net, content, netconvert, Path(temporary))
        _check_rebuilt(net, content, sources[-1])
        targets = {file: folder / file.name for file in sources}
        if (there := [target for target in targets.values() if target.exists()]) and not force:
            raise InputError(*(f"{target}: exists and is kept; --force replaces it" for target in there))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for file, target in targets.items():
                write(target, file.read_bytes())
        except OSError as error:
            raise not_written(error, folder) from error
    return list(targets.values())


def _plain_sources(net: Path, content: Content, netconvert: Path, folder: Path) -> list[Path]:
    """Write the sources of a network into a folder; returns the files, the .netccfg last."""
    name, precision = stem(net), str(_decimals(content.boundary))
    options = ("--plain-output-prefix", name, "--precision", precision)
    done = run_program(netconvert, "--sumo-net-file", net.resolve(), *options, folder=folder)
    if done.returncode:
        raise InputError(*(f"{net}: netconvert: {fault}" for fault in errors_in(done.stderr)))
    sources = [file for kind in PLAIN if (file := folder / f"{name}.{kind}.xml").is_file()]
    for file in sources:
        file.write_text(HEADER.sub("", file.read_text(encoding="utf-8"), count=1), encoding="utf-8")
    config = folder / f"{name}.netccfg"
    config.write_text(_config(config, precision), encoding="utf-8")
    return [*sources, config]


def _check_rebuilt(net: Path, content: Content, config: Path) -> None:
    """Raise InputError unless a configuration builds a network of the same content."""
    rebuilt = config.with_name("rebuilt.net.xml")
    try:
        build_net(config, rebuilt)
    except InputError as error:
        faults = [fault.rpartition(f"{config}: ")[2] for fault in error.faults]
        raise InputError(*(f"{net}: its sources do not build: {fault}" for fault in faults)) from error
    if different := list(some(differences(content, read(rebuilt)))):
        raise InputError(*(f"{net}: its sources would build a different network: {line}" for line in different))


def _decimals(boundary: str) -> int:
    """The number of decimals of a network's coordinates, by its boundary."""
    return max(2, *(len(number.partition(".")[2]) for number in boundary.split(",")), 0)


def _config(plain: Path, precision: str) -> str:
    """The configuration that netconvert left beside its plain output, made to build a network in the same folder."""
    name = plain.stem
    root = ET.fromstring(plain.read_text(encoding="utf-8"))
    root.attrib.clear()
    for old in root.findall("output"):
        root.remove(old)
    output = ET.Element("output")
    ET.SubElement(output, "output-file", value=f"{name}.net.xml")
    ET.SubElement(output, "precision", value=precision)
    root.insert(1, output)
    ET.indent(root, "    ")
    text = ET.tostring(root, encoding="unicode", short_empty_elements=True).replace(" />", "/>")
    head = f"<!-- netconvert -c {name}.netccfg builds {name}.net.xml -->"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n\n{head}\n{text}\n'


def differences(one: Content, other: Content) -> Iterator[str]:
    """Differences between two networks, except ids of lanes inside junctions and shapes within TOLERANCE."""
    for what, a, b in (
        ("edge", one.roads(), other.roads()),
        ("junction", one.junctions, other.junctions),
        ("light", one.lights, other.lights),
        ("connection", _joined(one), _joined(other)),
    ):
        yield from (f"{what} '{key}' is missing" for key in a.keys() - b.keys())
        yield from (f"{what} '{key}' is new" for key in b.keys() - a.keys())
        for key in sorted(a.keys() & b.keys()):
            if not _alike(a[key], b[key]):
                yield f"{what} '{key}' differs"


def _joined(content: Content) -> dict[str, tuple]:
    """Every connection of two roads, with its shape inside the junction, whatever the ids of the lanes there."""
    roads = content.roads()
    inside = {lane.id: lane.shape for edge in content.edges.values() for lane in edge.lanes}
    onward = {"_".join(map(str, link.source)): link.via for link in content.links if link.source[0] not in roads}
    joined = {}
    for link in content.links:
        if link.source[0] in roads and link.target[0] in roads:
            shape, via = [], link.via
            while via:
                shape += [point for point in inside.get(via, ()) if not shape or point != shape[-1]]
                via = onward.get(via, "")
            lanes = ("_".join(map(str, lane)) for lane in (link.source, link.target))
            joined[" to ".join(lanes)] = (link.rules, tuple(shape))
    return joined


def _alike(a: object, b: object) -> bool:
    """Whether two elements are equal; shapes and lengths may differ by the tolerance."""
    if isinstance(a, Lane) and isinstance(b, Lane):
        same = ("id", "width", "speed", "allowed", "banned", "merges")
        equal = all(getattr(a, key) == getattr(b, key) for key in same)
        return equal and abs(a.length - b.length) <= 1.5 * TOLERANCE and _alike(a.shape, b.shape)
    if isinstance(a, tuple) and isinstance(b, tuple):
        if a and b and all(isinstance(p, tuple) and p and isinstance(p[0], float) for p in (*a, *b)):
            return _near(a, b)
        return len(a) == len(b) and all(map(_alike, a, b))
    return a == b


def _near(a: Points, b: Points) -> bool:
    """Whether two lines are within the tolerance of each other."""
    from shapely.geometry import LineString

    if min(len(a), len(b)) < 2:
        return a == b
    one, other = LineString(a), LineString(b)
    return one.hausdorff_distance(other) <= 1.5 * TOLERANCE  # of two rounded shapes
