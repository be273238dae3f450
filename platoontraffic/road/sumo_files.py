"""SUMO's XML files, read with line numbers: whether a network is whole, polygons, files named in files, id clashes."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from platoontraffic.errors import InputError, no_file
from platoontraffic.road.requests import Requests
from platoontraffic.road.sumo_values import MOST, unsound

NETWORK = "a SUMO network (.net.xml)"
TRAFFIC = "must be a route file or an additional file of SUMO"
OTHER_ROOTS = {
    "net": "a network",
    "nodes": "a plain node file",
    "edges": "a plain edge file",
    "connections": "a plain connection file",
    "additional": "an additional file",
    "routes": "a route file",
    "configuration": "a configuration",
    "sumoConfiguration": "a SUMO configuration, which names a network",
    "neteditConfiguration": "a netedit configuration, which names a network",
    "netconvertConfiguration": "a netconvert configuration, which builds a network",
}
NOWHERE = ("NUL", "/dev/null")  # names of output files that SUMO does not write

Start = Callable[[str, dict[str, str], expat.XMLParserType], None]  # called with each element's tag and attributes


class Shape(NamedTuple):
    """A wall or a solid obstacle of a polygon file."""

    id: str
    kind: str  # "wall": a line; "obstacle": solid, buildings included
    coordinates: np.ndarray  # (k, 2) [m]
    filled: bool


class Named(NamedTuple):
    """A file named in one of SUMO's input files."""

    element: str
    attribute: str
    name: str
    written: bool  # SUMO writes it; otherwise SUMO reads it


WRITTEN_TO = {"timedEvent": "dest", "calibrator": "output"}  # attribute that names an output; `file` in other elements
READ = {"rerouter": "file", "variableSpeedSign": "file", "calibrator": "file", "include": "href"}
PARAMETERS = ("device.ssm.file", "device.toc.file", "file")  # `file`: of traffic lights with detectors


def check_net_file(path: str | Path) -> bool:
    """Check that a file is a whole network: some broken networks kill SUMO and the process with it.

    returns : whether its traffic keeps to the left
    raises  : InputError
    """
    root, edge, road, lanes, left_hand, place = "", "", False, False, False, 0
    requests = Requests()

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal root, edge, road, lanes, left_hand, place
        if not root:
            root, left_hand = tag, attributes.get("lefthand") in ("true", "1")
            if tag != "net":
                raise fault_at(path, parser, f"{wrong_root(tag)}; must be <net>, {NETWORK}")
            if not attributes.get("version"):
                raise fault_at(path, parser, f"<net> has no version; must be {NETWORK} as netconvert writes it")
        elif tag == "include":
            raise fault_at(path, parser, f"includes '{attributes.get('href', '')}'; must be whole, {NETWORK}")
        elif tag == "edge":
            edge, road, place = attributes.get("id", ""), attributes.get("function", "normal") == "normal", 0
        elif tag == "lane":
            # By its place, not by its attribute `index`: older versions of netconvert wrote 0 for every internal lane.
            if attributes.get("id") != f"{edge}_{place}":
                raise fault_at(path, parser, f"{element_of(tag, attributes)}: is not in its edge")
            lanes, place = lanes | road, place + 1
        elif tag == "junction":
            edge = ""
        requests.note(tag, attributes)
        if fault := unsound(tag, attributes):
            raise fault_at(path, parser, f"{element_of(tag, attributes)}: {fault}")

    last = parse(path, start, f"must be {NETWORK}")
    if not lanes:
        raise InputError(f"{path}:{last}: the network has no road; must have at least one edge with a lane")
    if fault := requests.fault():
        raise InputError(f"{path}: {fault}; must be as netconvert writes it")
    return left_hand


def read_polygons(path: str | Path) -> list[Shape]:
    """Walls (type `wall`) and solid shapes (type `obstacle` or `building…`) of a .poly.xml; other types are skipped.

    raises : InputError
    """
    shapes: list[Shape] = []

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        kind = attributes.get("type", "")
        if kind.startswith("building"):
            kind = "obstacle"
        if tag != "poly" or kind not in ("wall", "obstacle"):
            return
        name = attributes.get("id", "")
        if attributes.get("geo", "0") in ("1", "true", "yes"):
            raise fault_at(path, parser, f"poly '{name}': geo coordinates; must be coordinates of the network [m]")
        coordinates = _coordinates(attributes.get("shape", ""))
        least = 2 if kind == "wall" else 3
        if len(coordinates) < least or not (np.abs(coordinates) <= MOST).all():
            shape = attributes.get("shape", "")
            raise fault_at(path, parser, f"poly '{name}': shape \"{shape:.40}\"; must be {least} or more points x,y")
        shapes.append(Shape(name, kind, coordinates, attributes.get("fill", "0") in ("1", "true", "yes")))

    parse(path, start, "must be an additional file with polygons (.poly.xml)")
    return shapes


def _coordinates(shape: str) -> np.ndarray:
    """Points of an attribute `shape` [m], (k, 2); one NaN where it cannot be read."""
    try:
        points = [tuple(map(float, point.split(",")))[:2] for point in shape.split()]
        return np.array(points, dtype=float).reshape(-1, 2)
    except ValueError:
        return np.full((1, 2), np.nan)


def file_named_in(element: str, attributes: Mapping[str, str]) -> Named | None:
    """The file that an element of a network, route file or additional file has SUMO write or read."""
    if element == "param":
        attribute, written = "value", attributes.get("key") in PARAMETERS
        if not written:
            return None
    else:
        attribute, written = WRITTEN_TO.get(element, "file"), True
        if READ.get(element, "") in attributes:
            attribute, written = READ[element], False
    name = attributes.get(attribute, "")
    return Named(element, attribute, name, written) if name and name not in NOWHERE else None


def names_files(path: Path) -> bool:
    """Whether a file names output files of SUMO, or includes other files."""
    found = False

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal found
        if file_named_in(tag, attributes):
            found = True
            parser.StartElementHandler = None

    parse(path, start, "must be a file that SUMO can read")
    return found


def id_clashes(path: Path, ids: Collection[str], within: tuple[Path, ...] = ()) -> list[tuple[str, str]]:
    """(id, `file:line: fault`) for every vehicle of a route file, or of one it includes, with an id among `ids`.

    A flow numbers its vehicles: those of flow `x` are `x.0`, `x.1` and so on.

    within : files that include this one
    raises : InputError where a file cannot be read, is of another kind, includes itself, or has an unsound number
    """
    if path.resolve() in within:
        raise InputError(f"{within[-1]}: includes {path.name}, which leads back to it; must not")
    clashes: list[tuple[str, str]] = []
    included: list[str] = []
    by_flow = {name.rpartition(".")[0]: name for name in sorted(ids, reverse=True)}

    root = ""

    def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        nonlocal root
        if not root:
            root = tag
            if tag in OTHER_ROOTS.keys() - {"routes", "additional"}:  # SUMO reads files of any other root
                raise fault_at(path, parser, f"{wrong_root(tag)}; {TRAFFIC}")
        if tag == "include" and attributes.get("href"):
            included.append(attributes["href"])
        name = attributes.get("id", "")
        made = by_flow.get(name) if tag in ("flow", "calibrator") else name if tag in ("vehicle", "trip") else None
        if fault := unsound(tag, attributes):
            raise fault_at(path, parser, f"{element_of(tag, attributes)}: {fault}")
        if made in ids:
            fault = fault_at(path, parser, f"{tag} '{name}' is, or makes, '{made}'")
            clashes.append((made, str(fault)))

    parse(path, start, TRAFFIC)
    for name in included:
        clashes += id_clashes(path.parent / name, ids, (*within, path.resolve()))
    return clashes


def wrong_root(tag: str) -> str:
    return f"root element is <{tag}>, {OTHER_ROOTS.get(tag, 'another kind of file')}"


def element_of(tag: str, attributes: Mapping[str, str]) -> str:
    """The element as faults name it: `lane 'a_0'`."""
    return f"{tag} '{attributes['id']}'" if "id" in attributes else f"<{tag}>"


def fault_at(path: str | Path, parser: expat.XMLParserType, words: str) -> InputError:
    """The error `file:line: words`, at the parser's present line."""
    return InputError(f"{path}:{parser.CurrentLineNumber}: {words}")


def parse(
    path: str | Path,
    start: Start,
    wanted: str,
    end: Callable[[str], None] | None = None,
    text: Callable[[str], None] | None = None,
) -> int:
    """Read a plain or gzipped XML file to its end, calling `start` at every element.

    wanted  : `must be …`, said where the file cannot be read
    end     : called with the tag of each element that ends
    text    : called with what stands between tags, in pieces
    returns : the number of its last line
    raises  : InputError
    """
    path = Path(path)
    if absent := no_file(path):
        raise InputError(f"{path}: {absent}; {wanted}")
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: start(tag, attributes, parser)
    parser.EndElementHandler, parser.CharacterDataHandler = end, text
    try:
        with path.open("rb") as file:
            magic = file.read(2)
        if not magic:
            raise InputError(f"{path}:1: the file is empty; {wanted}")
        with gzip.open(path) if magic == b"\x1f\x8b" else path.open("rb") as file:
            parser.ParseFile(file)
    except expat.ExpatError as error:
        early = error.code == expat.errors.codes[expat.errors.XML_ERROR_NO_ELEMENTS]
        words = "it ends too early" if early else expat.ErrorString(error.code)
        raise InputError(f"{path}:{error.lineno}: not whole XML ({words}); {wanted}") from None
    except InputError:
        raise
    except (OSError, EOFError, zlib.error, LookupError, ValueError) as error:  # the last two: an odd encoding
        raise InputError(f"{path}:{parser.CurrentLineNumber}: cannot be read ({error}); {wanted}") from None
    return parser.CurrentLineNumber
