"""The cost of a step of the loop on this machine, beside that of SUMO alone: `platoontraffic bench traffic`.

Towns are made from a seed. In one run the members are driven by this package; in the other SUMO's own driver model
drives them on the same routes, and only SUMO's steps are measured. Each run has its own process, and the two kinds of
run take turns. Every run has one thread, so CPU time is nearly that of an idle machine; other jobs only take some of
the processor's caches. No result is a failure, however slow the machine is.
"""

from __future__ import annotations

import json
import os
import random
import tempfile
import time
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from operator import attrgetter
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import tomli_w

from platoontraffic import scenario, shipped, simulation
from platoontraffic.cli.bench_floor import COUNTED, HIGHWAY, LAB, WARM_UP, Above, Scene, above
from platoontraffic.cli.net_sources import run_program
from platoontraffic.errors import InputError, RunError
from platoontraffic.lidar.benchmark.frame import as_json, facts, machine, peak_memory, table
from platoontraffic.recording import run as run_into
from platoontraffic.results import sumo_tables
from platoontraffic.results.provenance import commit
from platoontraffic.simulation import Instant
from platoontraffic.sumo.client import libsumo
from platoontraffic.sumo.programs import program
from platoontraffic.sumo.world import World

STEP = 0.1  # [s]; the lidars scan in every step
SIZE = 5  # members of a platoon
BLOCK = 200.0  # distance between neighbouring junctions [m]
START, SPEED, GAP = 120.0, 8.0, 11.0  # of a platoon: position on its edge [m], speed [m/s], bumper to bumper [m]
ROUTE_EDGES = 12  # edges of a route, which is too long for any vehicle to arrive
STRAIGHT_ON = 0.7  # probability of going straight on at a junction that also allows a turn
EVERY = 10.0  # simulated time between two readings of the clocks [s]

STAGES = {  # stages of the loop -> their names in provenance.json
    "SUMO's step": ("step",),
    "read": ("read",),
    "scan": ("scan",),
    "decide": ("signals", "decide"),
    "move": ("move",),
    "place": ("place",),
    "observe": ("observe", "measure"),
    "record": ("record",),
    "watchers": ("show",),
}
LARGE, LARGEST, EQUIPPED = "1000 + 100", "5000 + 500", "5000, 20% equipped"  # towns with a target, see `bars`
ABOVE = {LAB.name: 0.6, HIGHWAY.name: 1.0}  # target of a step above its floor [ms]
CALLS, MEMBER, OBEYS = 350, 20.0, 35.0  # targets of calls a step in the lab; of a member in towns, in a city [us]
CITY = 200  # steps that are measured in a city


class Town(NamedTuple):
    """A grid of streets with its traffic, and the time for which it is simulated."""

    roads: int  # in each of the two directions of the grid
    background: int  # vehicles of the traffic
    platoons: int
    warm_up: int  # time before the platoons are inserted, or after the traffic has departed [s], a multiple of EVERY
    lasts: int  # time that is measured after it [s], a multiple of EVERY
    share: float = 0.0  # of the traffic that become members, each by itself

    @property
    def members(self) -> int:
        return SIZE * self.platoons + round(self.share * self.background)

    @property
    def name(self) -> str:
        if self.share:
            return f"{self.background}, {self.share:.0%} equipped"
        return f"{self.background} + {self.members}"


@dataclass(frozen=True)
class Plan:
    """The extent of a measurement.

    towns  : all with the same density of traffic
    turns  : number of runs of the loop, of SUMO alone, and of both a town's loop and its floor: the median counts
    extras : name -> overrides of a further run of the loop in each turn, in towns with platoons
    scenes : their steps are compared with their floors, and so are those of the towns
    """

    towns: tuple[Town, ...]
    turns: int
    extras: dict[str, tuple[str, ...]]
    scenes: tuple[Scene, ...] = ()


NOISE = "platoon.leader.lidar.noise=car-leader", "platoon.follower.lidar.noise=car-follower"
SPARSE_ROWS = ("record.every_s=1",)
FULL = Plan(
    towns=(
        Town(7, 100, 1, 20, 30),
        Town(20, 1000, 20, 20, 30),
        Town(44, 5000, 100, 10, 10),
        Town(44, 5000, 0, 10, 10, share=0.2),
    ),
    turns=3,
    extras={"with noise": NOISE, "a row a second": SPARSE_ROWS},
    scenes=(LAB, HIGHWAY),
)
QUICK = Plan(towns=(Town(7, 100, 1, 10, 10), Town(20, 1000, 20, 10, 10)), turns=1, extras={}, scenes=(LAB, HIGHWAY))


def city(config: Path, platoons: Path) -> Plan:
    """Steps of a SUMO configuration with platoons from a file."""
    name = f"{config.resolve().parent.name}/{config.name}"
    seconds = f"run.duration_s={STEP * (WARM_UP + COUNTED + CITY)}"
    scene = Scene(name, str(config), CITY, (f"run.step_s={STEP}", seconds), str(platoons))
    return Plan(towns=(), turns=0, extras={}, scenes=(scene,))


# ---- rows of the report; names carry units, because they become keys of JSON


class Whole(NamedTuple):
    """A step of the loop, and of SUMO alone.

    real_time : simulated time over CPU time of the loop
    wall_...  : the same by wall time
    member_us : CPU time of the loop beyond that of SUMO alone, per member
    """

    town: str
    what: str
    vehicles: int
    sumo_ms: float
    loop_ms: float
    ratio: float
    real_time: float
    wall_ratio: float
    wall_real_time: float
    member_us: float
    peak_mb: float | None


class Stage(NamedTuple):
    """Part of a step of the loop: its share of the CPU time, in proportion to its wall time."""

    town: str
    stage: str
    ms: float
    share: float


class Now(NamedTuple):
    """A figure beside the same one of another report."""

    figure: str
    before: float
    now: float

    @property
    def ratio(self) -> float:
        return self.now / self.before


class Bar(NamedTuple):
    """A target, and whether it is met."""

    wanted: str
    measured: float
    met: bool


@dataclass(frozen=True)
class Report:
    machine: dict[str, str]
    whole: list[Whole]
    stages: list[Stage]
    above: list[Above]
    bars: list[Bar]

    def json(self) -> str:
        return as_json(self)

    def beside(self, before: Report) -> list[Now]:
        """The figures that another report has too."""
        old, new = (_figures(one.whole, one.above) for one in (before, self))
        return [Now(name, old[name], value) for name, value in new.items() if name in old]


def run(plan: Plan, progress: Callable[[str], None] = lambda stage: None) -> Report:
    """Measure; progress is called with each stage. raises: MissingError without eclipse-sumo (netgenerate)"""
    here = machine("libsumo", "numpy", "numba", "shapely", "pymunk") | {"commit": commit() or "installed"}
    rows, parts, floors = [], [], []
    for scene in plan.scenes:
        progress(scene.name)
        floors.append(_in_a_process(above, scene.name, scene.scenario, scene.changes, scene.steps, scene.platoons))
    for town in plan.towns:
        with tempfile.TemporaryDirectory(prefix="platoontraffic-") as name:
            folder = Path(name)
            progress(f"{town.name}: the town")
            build(town, folder)

            alone: list[Spent] = []
            extras = plan.extras if town.platoons else {}
            loops: dict[str, list[Spent]] = {"": [], **{what: [] for what in extras}}
            for turn in range(1, plan.turns + 1):
                progress(f"{town.name}: {turn} of {plan.turns}")
                alone.append(_in_a_process(sumo_alone, folder, town))
                for what, found in loops.items():
                    found.append(_in_a_process(loop, folder, town, extras.get(what, ())))
            rows += [whole(town, what, alone, found) for what, found in loops.items()]
            parts += stages(town, loops[""])
            if plan.scenes:
                progress(f"{town.name}: its floor")
                seconds = f"run.duration_s={town.lasts + STEP * (WARM_UP + COUNTED)}"
                steps = round(town.lasts / STEP)
                scene = town.name, str(folder / "town.toml"), (seconds,), steps
                found = [_in_a_process(above, *scene) for _ in range(plan.turns)]
                floors.append(sorted(found, key=attrgetter("above_ms"))[plan.turns // 2])
    cities = {scene.name for scene in plan.scenes if scene.platoons}
    return Report(here, rows, parts, floors, bars(rows, floors, cities))


# ---- towns


def build(town: Town, folder: Path, seed: int = 1) -> None:
    """Write the files of both runs: town.net.xml, traffic.rou.xml, town.toml, members.rou.xml. raises: RunError"""
    net = folder / "town.net.xml"
    options = "--grid", "--grid.number", str(town.roads), "--grid.length", str(BLOCK), "-L", "1", "--no-turnarounds"
    done = run_program(program("netgenerate"), *options, "-o", net)
    if done.returncode:
        raise RunError(f"netgenerate failed: {done.stderr.strip().rpartition(chr(10))[2]}")
    rng = random.Random(seed)
    onward = _onward(net)
    edges = sorted(onward)
    begin = rng.sample(edges, town.platoons)
    routes = [_route(edge, onward, rng) for edge in begin]
    # Background vehicles begin on other edges than platoons.
    others = sorted(set(edges) - set(begin))
    background = [_route(rng.choice(others), onward, rng) for _ in range(town.background)]
    # Members from the traffic are those that depart after the begin of the run.
    anywhere = f'depart="{1 if town.share else 0}" departPos="random_free"'
    _write_routes(folder / "traffic.rou.xml", [("", str(i), route, anywhere) for i, route in enumerate(background)])
    (folder / "town.toml").write_text(tomli_w.dumps(_scenario(town, routes)), encoding="utf-8")
    members = simulation.prepare(scenario.load(folder / "town.toml")).members
    natives = []
    for m in members:
        kind = f'<vType id="{m.id}" length="{m.model.length}" width="{m.model.width}"/>'
        depart = f'type="{m.id}" depart="{town.warm_up}" departPos="{m.position}" departSpeed="{m.speed}"'
        natives.append((kind, m.id, m.route.edges, depart))
    _write_routes(folder / "members.rou.xml", natives)


def _onward(net: Path) -> dict[str, dict[str, str]]:
    """Edge -> direction (s, l or r) -> next edge."""
    onward: dict[str, dict[str, str]] = {}
    for _, element in ET.iterparse(net):
        if element.tag == "connection" and not element.get("from").startswith(":"):
            onward.setdefault(element.get("from"), {})[element.get("dir")] = element.get("to")
    return onward


def _route(edge: str, onward: dict[str, dict[str, str]], rng: random.Random) -> list[str]:
    """A random route from an edge on."""
    route = [edge]
    while len(route) < ROUTE_EDGES:
        ahead = onward[route[-1]]
        turns = sorted(set(ahead) - {"s"})
        straight_on = "s" in ahead and (not turns or rng.random() < STRAIGHT_ON)
        route.append(ahead["s" if straight_on else rng.choice(turns)])
    return route


def _write_routes(file: Path, vehicles: Iterable[tuple[str, str, Sequence[str], str]]) -> None:
    """vehicles: for each, an element to write before it, its id, its edges, its attributes"""
    lines = [
        f'{before}<vehicle id="{name}" {attributes}><route edges="{" ".join(edges)}"/></vehicle>'
        for before, name, edges, attributes in vehicles
    ]
    file.write_text("\n".join(["<routes>", *lines, "</routes>", ""]), encoding="utf-8")


def _scenario(town: Town, routes: list[list[str]]) -> dict:
    """Platoons as in the shipped ring_platoon; lidars without errors."""
    table = tomllib.loads(shipped.scenarios()["ring_platoon"].read_text(encoding="utf-8"))
    (example,) = table["platoon"]
    for role in ("leader", "follower"):
        lidar = example[role]["lidar"]
        example[role]["lidar"] = ({"preset": lidar} if isinstance(lidar, str) else lidar) | {"noise": "none"}
    del example["loop"]
    platoons = [
        example
        | {"id": f"p{i}", "size": SIZE, "gap_m": GAP, "route": route}
        | {"start": {"edge": route[0], "position_m": START, "speed_mps": SPEED}}
        for i, route in enumerate(routes)
    ]
    of_both = {"sumo": {"net": "town.net.xml", "routes": ["traffic.rou.xml"]}, "scene": {"walls": "none"}}
    if town.share:
        lasts = float(town.warm_up + town.lasts)
        return of_both | {"run": {"step_s": STEP, "duration_s": lasts}, "equip": [{"share": town.share}]}
    of_both["sumo"]["warm_up_s"] = float(town.warm_up)
    return of_both | {"run": {"step_s": STEP, "duration_s": float(town.lasts)}, "platoon": platoons}


# ---- runs, each in its own process


class Spent(NamedTuple):
    """Measurements of one run."""

    cpu: float  # CPU time [s]
    clock: float  # wall time [s]
    vehicles: int  # on the road at the end
    peak: float | None  # of memory [MB]
    stages: dict[str, float]  # wall time of each stage of the loop [s]


class Readings:
    """A watcher that reads CPU time, wall time and the number of vehicles every EVERY simulated seconds."""

    def __init__(self, vehicles: Callable[[], int]) -> None:
        self._vehicles = vehicles
        self.taken: list[tuple[float, float, int]] = []

    def show(self, instant: Instant) -> None:
        if instant.step % round(EVERY / STEP) == 0:
            self.taken.append((time.process_time(), time.perf_counter(), self._vehicles()))


def sumo_alone(folder: Path, town: Town) -> Spent:
    """SUMO's steps, with the members as SUMO-driven vehicles."""
    with (folder / "alone.log").open("wb") as log:
        os.dup2(log.fileno(), 2)  # SUMO writes its warnings to this descriptor
    prepared = simulation.prepare(scenario.load(folder / "town.toml"))
    options = sumo_tables.sumo_options(prepared.scenario, folder)
    options["route-files"] += f",{folder / 'members.rou.xml'}"
    with World(prepared.network, STEP, prepared.scenario.seed, folder / "start.log", options):
        libsumo.simulationStep(town.warm_up + 2 * STEP)  # the loop, too, takes two steps to insert the members
        began = time.process_time(), time.perf_counter()
        for _ in range(round(town.lasts / STEP)):
            libsumo.simulationStep()
        ended = time.process_time(), time.perf_counter()
        vehicles = libsumo.vehicle.getIDCount()
    return Spent(ended[0] - began[0], ended[1] - began[1], vehicles, peak_memory(), {})


def loop(folder: Path, town: Town, arguments: tuple[str, ...] = ()) -> Spent:
    """The loop of a run, from its first instant to its last one."""
    prepared = simulation.prepare(scenario.load(folder / "town.toml", arguments))
    readings = Readings(libsumo.vehicle.getIDCount)

    with tempfile.TemporaryDirectory(dir=folder) as results:
        # One second first, so that nothing is compiled or cached during the measurement.
        short = scenario.load(folder / "town.toml", ["sumo.warm_up_s=0", "run.duration_s=2", *arguments])
        run_into(replace(prepared, scenario=short), Path(results, "first"))
        done = run_into(prepared, Path(results, "run"), [readings])
        facts = json.loads((done / "provenance.json").read_text(encoding="utf-8"))
    (cpu, clock, _), (cpu_end, clock_end, vehicles) = readings.taken[-1 - round(town.lasts / EVERY)], readings.taken[-1]
    return Spent(cpu_end - cpu, clock_end - clock, vehicles, peak_memory(), facts["stage_s"])


def _in_a_process(function: Callable[..., Any], *arguments) -> Any:
    try:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            return pool.submit(function, *arguments).result()
    except BrokenProcessPool as error:
        what = next((one.name for one in arguments if isinstance(one, Town)), arguments[0])
        raise RunError(f"a process of the benchmark died: {function.__name__}, {what}") from error


# ---- evaluation


def whole(town: Town, what: str, alone: Sequence[Spent], loops: Sequence[Spent]) -> Whole:
    """Medians over the turns; each ratio is between runs of the same turn."""
    steps = round(town.lasts / STEP)
    pairs = list(zip(alone, loops, strict=True))
    loop_cpu = median(one.cpu for one in loops)
    return Whole(
        town=town.name,
        what=what,
        vehicles=loops[0].vehicles,
        sumo_ms=1e3 * median(one.cpu for one in alone) / steps,
        loop_ms=1e3 * loop_cpu / steps,
        ratio=median(one.cpu / bare.cpu for bare, one in pairs),
        real_time=town.lasts / loop_cpu,
        wall_ratio=median(one.clock / bare.clock for bare, one in pairs),
        wall_real_time=town.lasts / median(one.clock for one in loops),
        member_us=1e6 * median(one.cpu - bare.cpu for bare, one in pairs) / steps / town.members,
        peak_mb=max((one.peak for one in loops if one.peak is not None), default=None),
    )


def stages(town: Town, loops: Sequence[Spent]) -> list[Stage]:
    """CPU time of each stage, in proportion to its median share of the wall time."""
    rows = []
    loop_ms = 1e3 * median(one.cpu for one in loops) / round(town.lasts / STEP)
    for name, parts in STAGES.items():
        share = median(sum(one.stages[part] for part in parts) / sum(one.stages.values()) for one in loops)
        rows.append(Stage(town.name, name, share * loop_ms, share))
    return rows


def bars(rows: Sequence[Whole], floors: Sequence[Above] = (), cities: Collection[str] = ()) -> list[Bar]:
    """Targets of the loop; they are reported, not enforced.

    cities: scenes of which the members track, obey and drive
    """
    found = {row.town: row for row in rows if not row.what}
    wanted = []
    for one in floors:
        if one.scene in ABOVE:
            most = ABOVE[one.scene]
            wanted.append(Bar(f"{one.scene}: at most {most} ms above the floor", one.above_ms, one.above_ms <= most))
        if one.scene == LAB.name:
            wanted.append(Bar(f"{one.scene}: at most {CALLS} calls", one.calls, one.calls <= CALLS))
        if one.scene in (LARGE, LARGEST, EQUIPPED, *cities):
            most = OBEYS if one.scene in (EQUIPPED, *cities) else MEMBER
            what = f"{one.scene}: at most {most} us a member above the floor"
            wanted.append(Bar(what, one.member_us, one.member_us <= most))
    if large := found.get(LARGE):
        wanted.append(Bar(f"{LARGE}: at most 1.6 times SUMO alone", large.ratio, large.ratio <= 1.6))
        wanted.append(Bar(f"{LARGE}: at least 5 times real time", large.real_time, large.real_time >= 5))
    if largest := found.get(LARGEST):
        wanted.append(Bar(f"{LARGEST}: at least real time", largest.real_time, largest.real_time >= 1))
        if largest.peak_mb is not None:
            wanted.append(Bar(f"{LARGEST}: less than 2000 MB", largest.peak_mb, largest.peak_mb < 2000))
    if large and largest:
        growth = largest.member_us / large.member_us
        wanted.append(Bar("five times the members, at most 1.2 times the cost of each", growth, growth <= 1.2))
    return wanted


# ---- text


LEGEND = """\
A step of 0.1 s: background vehicles + members in platoons of five that scan at 10 Hz with 720 beams; equipped: a share
of the traffic drives its own routes by `tracking`. CPU time of one thread. loop: everything that a run does in a step;
sumo: SUMO's step alone, with the members as SUMO-driven vehicles. real time: simulated time over CPU time. wall: the
same by wall time, which other jobs lengthen. member: CPU time of the loop beyond that of sumo, per member. peak: memory
of the process."""


ABOVE_LEGEND = """\
A step of the loop, without tables, above its floor: SUMO's step with the members moved and read and nothing else; lab:
step of 0.025 s. calls: of Python and C functions in a step.
"""


def kept(file: Path) -> Report:
    """A report from its JSON. raises: InputError"""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        rows = [Whole(**row) for row in found["whole"]], [], [Above(**row) for row in found["above"]], []
        return Report({name: found["machine"][name] for name in ("commit", "processor")}, *rows)
    except OSError as error:
        raise InputError(f"--compare: {file}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"--compare: {file}: is not what `bench traffic --json` of this version prints") from error


def compared(report: Report, before: Report) -> str:
    """A table of the figures that two reports have."""
    rows = [[one.figure, _cell(one.before), _cell(one.now), f"{one.ratio:.2f}"] for one in report.beside(before)]
    head = f"Beside {before.machine['commit']} on {before.machine['processor']}"
    return head + "\n" + table([["", "before", "now", "ratio"], *rows], [True, False, False, False])


def _figures(rows: Sequence[Whole], floors: Sequence[Above]) -> dict[str, float]:
    """Those that are compared, by name."""
    found = {f"{row.town} {row.what}".strip() + ", loop [ms]": row.loop_ms for row in rows}
    for one in floors:
        found |= {f"{one.scene}, above the floor [ms]": one.above_ms, f"{one.scene}, calls": one.calls}
    return found


def text(report: Report, targets: bool = False) -> str:
    """The report as tables; targets: with the project's own, and whether each is met."""
    sections = [facts(report.machine)]
    if report.whole:
        sections += _of_towns(report)
    if report.above:
        names = [name.replace("_", " ") for name in Above._fields]
        sections.append(ABOVE_LEGEND + table([names, *(map(_cell, row) for row in report.above)], [True] + [False] * 6))
    if targets and report.bars:
        kept = [[bar.wanted, _cell(bar.measured), "yes" if bar.met else "no"] for bar in report.bars]
        sections.append("Targets\n" + table([["", "measured", "met"], *kept], [True, False, False]))
    return "\n\n".join(sections)


def _of_towns(report: Report) -> list[str]:
    head = [name.replace("_", " ") for name in Whole._fields]
    whole = table([head, *(map(_cell, row) for row in report.whole)], [True, True] + [False] * (len(head) - 2))
    towns = list(dict.fromkeys(row.town for row in report.stages))
    by_stage: dict[str, list[Stage]] = {}
    for row in report.stages:
        by_stage.setdefault(row.stage, []).append(row)
    parts = [[name, *(f"{_cell(row.ms)} ms {row.share:4.0%}" for row in rows)] for name, rows in by_stage.items()]
    return [LEGEND, whole, "Where the time goes\n" + table([["", *towns], *parts], [True] + [False] * len(towns))]


def _cell(value: str | float | None) -> str:
    if value is None:
        return "-"
    if not isinstance(value, float):
        return str(value)
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"
