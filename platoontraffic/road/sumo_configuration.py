"""SUMO configurations (.sumocfg, .netecfg): which files and options they give to SUMO, and what cannot be honoured."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple
from xml.parsers import expat

from platoontraffic.errors import InputError, no_file
from platoontraffic.road.sumo_files import NOWHERE, fault_at, parse, wrong_root

# SUMO's other names of options, for those that matter here.
SYNONYMS = {
    "n": "net-file", "net": "net-file", "r": "route-files", "routes": "route-files",
    "a": "additional-files", "additional": "additional-files", "w": "weight-files", "weights": "weight-files",
    "b": "begin", "e": "end", "srand": "seed", "abs-rand": "random", "no-duration-log": "duration-log.disable",
    "H": "human-readable-time", "v": "verbose", "c": "configuration-file", "configuration": "configuration-file",
    "C": "save-configuration", "t": "duration-log.statistics", "l": "log", "log-file": "log",
    "ndump": "netstate-dump", "netstate": "netstate-dump", "netstate-output": "netstate-dump",
    "summary": "summary-output", "tripinfo": "tripinfo-output", "vehroutes": "vehroute-output",
    "person-fcd": "person-fcd-output", "personinfo": "personinfo-output", "personroutes": "personroute-output",
    "statistics-output": "statistic-output", "device.fcd-replay.file": "device.fcd-replay.files",
    "sumo-net-file": "net-file",
}  # fmt: skip
MAIN_INPUTS = ("net-file", "route-files", "additional-files")
INPUTS = {
    *MAIN_INPUTS, "weight-files", "load-state", "astar.all-distances",
    "astar.landmark-distances", "device.fcd-replay.files", "device.ssm.filter-edges.input-file",
    "fcd-output.filter-edges.input-file", "pedestrian.jupedsim.wkt",
}  # fmt: skip
OUTPUT = re.compile(r".*[-.]output|(message-|error-)?log|netstate-dump|device\.(ssm|toc)\.file")
IGNORED = re.compile(
    r"random|precision|time-to-teleport.*|collision\.(?!check-junctions\.mingap).*|no-step-log"
    r"|step-log\..*|duration-log\..*|emergencydecel\.warning-threshold"  # set by this tool, or implied by that
    r"|remote-port|num-clients|configuration-file|save-.*|output[-.].*|human-readable-time|vtk-output|print-options"
    r"|(device\.rerouting\.)?threads"  # a simulation has one thread
    r"|verbose|help|version|language"  # would wait for clients, write beside the input, or change what is read back
    r"|gui-.*|quit-on-end|game.*|start|delay|breakpoints|edgedata-files|alternative-net-file|selection-file|demo"
    r"|disable-textures|registry-viewport|window-.*|tracker-interval|osg-view|[gQGSdDTBmN]"  # of sumo-gui
)
TAKEN = frozenset({"seed", "step-length"})  # read by this tool, which gives SUMO its own
NO_END = -1.0  # SUMO's word for it [s]
ON = ("true", "1", "yes", "on", "x", "t")  # SUMO's words for a switch that is on
WANTED = "must be a SUMO configuration (.sumocfg), or one of netedit (.netecfg)"
FOR_NETWORKS = "; `prove` and `nets check` take a network, the key sumo.net of a scenario names one"


class Configuration(NamedTuple):
    """The content of a SUMO configuration, with paths relative to the working folder."""

    path: Path
    net: Path
    routes: tuple[Path, ...]
    additional: tuple[Path, ...]
    inputs: tuple[Path, ...] = ()  # further files: weights, a state to begin with
    options: Mapping[str, str] = MappingProxyType({})  # other options to pass to SUMO
    outputs: Mapping[str, str] = MappingProxyType({})  # output option -> file name, as written
    ignored: tuple[str, ...] = ()  # options of sumo-gui, options set by this tool, options that cannot be honoured
    begin: float = 0.0  # [s]
    end: float | None = None  # [s]
    step: float | None = None  # [s]
    seed: int | None = None


@dataclass
class _Written:
    """Options as they are written in one file, and the faults found in them."""

    path: Path
    root: str = ""
    last: int = 0  # line
    given: dict[str, tuple[str, int]] = field(default_factory=dict)  # option -> value and line
    ignored: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    @classmethod
    def read(cls, path: Path) -> _Written:
        written, section = cls(path), ""

        def start(tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
            nonlocal section
            written.root = written.root or tag
            if written.root not in ("configuration", "sumoConfiguration", "neteditConfiguration"):
                raise fault_at(path, parser, f"{wrong_root(tag)}; {WANTED}{FOR_NETWORKS if tag == 'net' else ''}")
            value = attributes.get("value", attributes.get("v"))
            if value is None:
                section = tag
            else:
                written.note(tag, value, parser.CurrentLineNumber, of_gui=section == "gui_only")

        written.last = parse(path, start, WANTED)
        return written

    def note(self, tag: str, value: str, line: int, of_gui: bool) -> None:
        """Take in one option."""
        option = SYNONYMS.get(tag, tag)
        if option in TAKEN and not of_gui:
            self.given[option] = value, line
        elif of_gui or IGNORED.fullmatch(option):
            self.ignored.append(tag)
        elif option == "net-file" and option in self.given:
            self.fault(line, tag, "a second network; must name one")
        elif value:
            self.given[option] = _environment(value), line

    def fault(self, line: int, option: str, words: str) -> None:
        self.faults.append(f"{self.path}:{line}: <{option}>: {words}")

    def take_files(self) -> dict[str, tuple[Path, ...]]:
        """Remove the options that name input files; their paths by option."""
        files: dict[str, tuple[Path, ...]] = {}
        for option in sorted(INPUTS & self.given.keys()):
            value, line = self.given.pop(option)
            files[option] = tuple(self.path.parent / name.strip() for name in value.split(","))
            for file in files[option]:
                if absent := no_file(file):
                    self.fault(line, option, f"'{os.path.relpath(file, self.path.parent)}': {absent}")
        networks = len(files.get("net-file", ()))
        if networks != 1:
            number = f"{networks} networks" if networks else "no network"
            self.faults.append(f"{self.path}:{self.last}: names {number}; must name one, as <net-file>")
        return files

    def times(self) -> dict[str, float]:
        """Begin, end and step length [s], as far as they are given."""
        times: dict[str, float] = {}
        for option in sorted({"begin", "end", "step-length"} & self.given.keys()):
            value, line = self.given[option]
            try:
                times[option] = in_seconds(value)
            except ValueError:
                self.fault(line, option, f"'{value}'; must be a time: seconds, or hours:minutes:seconds")
        begin, end = max(times.get("begin", 0.0), 0.0), times.get("end", NO_END)
        if end < begin and end != NO_END:
            value, line = self.given["end"]
            self.fault(line, "end", f"'{value}'; must be after <begin>, {begin:g}, or {NO_END:g} for none")
        return times

    def seed(self) -> int | None:
        value, line = self.given.get("seed", (None, 0))
        try:
            return None if value is None else int(value)
        except ValueError:
            self.fault(line, "seed", f"'{value}'; must be a whole number")
            return None

    def check_model(self) -> None:
        value, line = self.given.get("mesosim", ("", 0))
        if value.lower() in ON:
            self.fault(line, "mesosim", "the mesoscopic model has no lanes; must be off")


def read_configuration(path: str | Path, named_by: tuple[Path, ...] = ()) -> Configuration:
    """Read a .sumocfg, or a .netecfg of netedit.

    named_by : configurations that lead to this one
    raises   : InputError where the file, or one that it names, is missing, or asks for something that is not supported
    """
    path = Path(path)
    if path.resolve() in named_by:
        raise InputError(f"{path}: names itself; {WANTED}")
    written = _Written.read(path)
    if written.root == "neteditConfiguration":  # SUMO knows none of netedit's own options
        if "sumocfg-file" in written.given:
            inner = read_configuration(path.parent / written.given["sumocfg-file"][0], (*named_by, path.resolve()))
            return inner._replace(path=path, inputs=(*inner.inputs, inner.path))
        written.given = {o: written.given[o] for o in MAIN_INPUTS if o in written.given}
        written.ignored = []
    files, times, seed = written.take_files(), written.times(), written.seed()
    written.check_model()
    if written.faults:
        raise InputError(*written.faults)
    return _configuration(written, files, times, seed)


def _configuration(
    written: _Written, files: dict[str, tuple[Path, ...]], times: dict[str, float], seed: int | None
) -> Configuration:
    values = {option: value for option, (value, _) in written.given.items() if option not in TAKEN}
    main = [files.pop(option, ()) for option in MAIN_INPUTS]
    options = {option: ",".join(str(file.resolve()) for file in files[option]) for option in sorted(files)}
    options |= {option: value for option, value in values.items() if not OUTPUT.fullmatch(option)}
    return Configuration(
        path=written.path,
        net=main[0][0],
        routes=main[1],
        additional=main[2],
        inputs=tuple(file for option in sorted(files) for file in files[option]),
        options=options,
        outputs={o: value for o, value in values.items() if OUTPUT.fullmatch(o) and value not in NOWHERE},
        ignored=tuple(written.ignored),
        begin=max(times.get("begin", 0.0), 0.0),
        end=times["end"] if times.get("end", NO_END) >= 0 else None,
        step=times.get("step-length"),
        seed=seed,
    )


def _environment(value: str) -> str:
    """The value with ${NAME} replaced by environment variables, as SUMO does."""
    return re.sub(r"\$\{(\w+)\}", lambda match: os.environ.get(match[1], match[0]), value)


def in_seconds(time: str) -> float:
    """SUMO's times in seconds: seconds, or [days:]hours:minutes:seconds."""
    *larger, seconds = map(float, time.split(":"))
    if len(larger) not in (0, 2, 3):
        raise ValueError(time)
    return seconds + sum(part * unit for part, unit in zip(reversed(larger), (60, 3600, 86400), strict=False))
