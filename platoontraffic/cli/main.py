"""The commands. Their exit codes and error lines are in `commands`."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib import import_module
from math import degrees
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import typer

import platoontraffic
from platoontraffic import shipped
from platoontraffic.cli.commands import commands_of
from platoontraffic.cli.last_resort import one_line_at_death, try_to_load
from platoontraffic.cli.nets import nets_app
from platoontraffic.cli.printing import (
    document,
    equal_runs,
    first_line,
    out,
    print_json,
    print_remarks,
    print_report,
    print_run,
    print_runs,
    replay_of,
    result_faults,
    title,
)
from platoontraffic.cli.progress import batch_progress, err, run_progress, say, say_when_compiling, show_stage
from platoontraffic.cli.signals import end_as_at_control_c
from platoontraffic.errors import InputError, MissingError, RunError, counted, did_you_mean

if TYPE_CHECKING:
    from platoontraffic.scenario.named_code import BeforeCode

app = typer.Typer(
    help="Platoons that drive by laser scanner, in SUMO traffic.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # importing what it needs for boxes takes a tenth of a second
    context_settings={"max_content_width": 120},
)
app.add_typer(nets_app, name="nets")
command = commands_of(app)


@app.callback(invoke_without_command=True)
def main(
    version: Annotated[bool, typer.Option("--version", help="print the version", is_eager=True)] = False,
) -> None:
    if version:
        print(f"platoontraffic {platoontraffic.__version__}")
        raise typer.Exit


ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="a scenario file, the name of a shipped one, or a SUMO configuration")
]
Changes = Annotated[
    list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="keys of the scenario to change: platoon.size=3")
]
Platoons = Annotated[
    str | None,
    typer.Option("--platoon", metavar="FILE", help="platoons for a SUMO configuration: a file of [[platoon]] tables"),
]
Seed = Annotated[int | None, typer.Option(help="seed, in place of the scenario's")]
NoPlugins = Annotated[
    bool, typer.Option("--no-plugins", help="refuse scenarios with plug-ins, because these are code that is run")
]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="no progress bar and no summary: print only the folder")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON document instead")]
ResultsFolder = Annotated[Path, typer.Option("--out", help="folder for results")]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="the folder of a run")]


@command
def run(
    scenario: ScenarioName,
    changes: Changes = None,
    platoons: Platoons = None,
    seed: Seed = None,
    results: ResultsFolder = Path("results"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="check everything, simulate nothing")] = False,
    force: Annotated[bool, typer.Option("--force", help="repeat the run even if its results exist")] = False,
    replay: Annotated[
        bool, typer.Option("--replay", help="also record background traffic and scans, and make replay.html")
    ] = False,
    gui: Annotated[bool, typer.Option("--gui", help="watch the run in sumo-gui; the results are the same")] = False,
    branch_at: Annotated[
        float | None,
        typer.Option("--branch-at", metavar="SECONDS", help="go on from this time as it is, and as each --then says"),
    ] = None,
    then: Annotated[
        list[str] | None,
        typer.Option("--then", metavar="KEY=VALUE", help='what changes in a branch; several with ";" between them'),
    ] = None,
    no_plugins: NoPlugins = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a scenario; its tables are in OUT/NAME/RUN."""
    from platoontraffic import scenario as scenarios

    runs = _runs()
    end_as_at_control_c()
    say_when_compiling(quiet)
    before_code = _before_code(no_plugins, None if dry_run else results)
    to_branch = branch_at is not None
    checked = scenarios.load(scenario, changes or (), seed, platoons, before_code, to_branch)
    if replay:
        checked = checked.for_replay()
    prepared = runs.prepare(checked)
    if branch_at is not None or then:
        from platoontraffic.branches.runs import Source
        from platoontraffic.cli.branches import run_with_branches

        if gui:
            raise InputError("--gui: not with --branch-at, because a SUMO with a window cannot be copied")
        source = Source(scenario, tuple(changes or ()), seed, platoons, replay)
        options = {"dry_run": dry_run, "force": force, "quiet": quiet, "json": json, "replay": replay}
        for folder in run_with_branches(source, prepared, branch_at, then or (), results, **options):
            _finish_run(folder, replay, quiet)
        return
    window = runs.Window(prepared.members, prepared.scene.solids) if gui else None
    if not quiet:
        print_remarks(prepared)
    folder = runs.result_folder(checked, results)
    if dry_run:
        runs.check_place(folder.parent)
        try_to_load(prepared)
    if dry_run and json:
        print_json({"folder": str(folder), "members": len(prepared.members), "done": (folder / "DONE").is_file()})
        return
    if dry_run:
        more = ["members of the traffic's share"] if prepared.scenario.spec.equip else []
        who = " and ".join(([counted(len(prepared.members), "member")] if prepared.members else []) + more)
        out.print(f"{checked.source}: fine, {who}; would write {folder}", soft_wrap=True)
        return
    if runs.is_done(folder) and not force:
        if not quiet and not json:
            err.print(f"results of an equal run exist; it is not repeated without --force: {folder}", soft_wrap=True)
    else:
        from platoontraffic.cli.alone import alone

        def waits() -> None:
            if not quiet:
                err.print("another process executes this run; this one waits for it", soft_wrap=True)

        progress = run_progress(checked.spec.run.duration_s, checked.spec.name, quiet)
        what = f"{checked.spec.name} ({runs.loaded(checked)})"
        with alone(folder, waits, say), one_line_at_death(what), progress as watchers:
            if force or not runs.is_done(folder):
                runs.run(prepared, folder, watchers, replace=force, window=window, say=say)
    if json:
        made = replay_of(folder) if replay else None
        print_json(document(folder, made) | {"sumo_options_replaced": checked.replaced()})
        return
    if not quiet:
        print_run(folder)
    _finish_run(folder, replay, quiet)


def _finish_run(folder: Path, replay: bool, quiet: bool) -> None:
    """Make the replay, if it is wanted, and print the folder."""
    made = replay_of(folder) if replay else None
    if made and not quiet:
        out.print(f"replay, for any browser: {made}", soft_wrap=True)
    print(folder)


@command
def batch(
    study: Annotated[str, typer.Argument(metavar="STUDY", help="a study file, or the name of a shipped one")],
    changes: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="keys of the scenario to change in every run")
    ] = None,
    slots: Annotated[
        int | None, typer.Option("-j", "--jobs", min=1, help="runs at a time; default: one per processor")
    ] = None,
    executor: Annotated[
        str, typer.Option(help="processes, serial, dask (a cluster for this batch), or dask:ADDRESS of a running one")
    ] = "processes",
    shard: Annotated[
        str, typer.Option(metavar="I/N", help="run part I of N, counted from 1; parts may run at the same time")
    ] = "1/1",
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="repeat failed runs")] = False,
    timeout: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="stop a run, which then failed, after this time; default: never"),
    ] = None,
    memory: Annotated[
        float | None,
        typer.Option(metavar="MB", help="stop a run, which then failed, that takes more memory; default: none"),
    ] = None,
    results: ResultsFolder = Path("results"),
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="list the runs and estimate their time, simulate nothing")
    ] = False,
    no_plugins: NoPlugins = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run all missing runs of a study; they and their tables are in OUT/STUDY."""
    from platoontraffic.study import batch as batches
    from platoontraffic.study import study as studies

    end_as_at_control_c()
    if executor not in ("processes", "serial", "dask") and not executor.startswith("dask:"):
        hint = did_you_mean(executor, ["processes", "serial", "dask"])
        raise InputError(f"--executor: {executor!r}: no such executor{hint}; or dask:ADDRESS")
    part = batches.Shard(*_shard(shard))
    loaded = studies.load(study, changes or (), _before_code(no_plugins, None if dry_run else results))
    folder, slots = results / loaded.name, slots or os.cpu_count() or 1
    if dry_run:
        from platoontraffic.results.recorder import check_place

        check_place(folder)
        print_runs(loaded, folder, 1 if executor == "serial" else slots, executor, json, part, retry_failed)
        return
    limits = batches.Limits(timeout, memory)
    if not quiet and not json and (equal := equal_runs(loaded.runs)):
        err.print(equal, soft_wrap=True)
    with batch_progress(loaded.name, len(loaded.runs), quiet or json) as watcher:
        report = batches.run(loaded, folder, executor, slots, part, retry_failed, limits, watcher)
    if json:
        print_json({"folder": str(folder), **report.progress._asdict(), "failures": report.failures})
    elif not quiet:
        print_report(report, folder)
    if not json:
        print(folder)
    if report.failures:
        raise typer.Exit(1)


@command
def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN|BATCH", help="folder of a run; for parquet also of a batch")],
    to: Annotated[str, typer.Option("--to", help="parquet, mcap (ROS 2, Foxglove) or fcd (SUMO)")] = "parquet",
) -> None:
    """Write the tables of a run in another format; parquet also takes a batch, and joins the tables of its runs."""
    kinds = {
        "parquet": ("platoontraffic.analysis.parquet", "pyarrow", "parquet"),
        "mcap": ("platoontraffic.export.rosbag", "rosbags", "ros"),
        "fcd": ("platoontraffic.export.fcd", "", ""),
    }
    if to not in kinds:
        raise InputError(f"--to: {to!r}: no such format{did_you_mean(to, kinds)}")
    module, package, extra = kinds[to]
    try:
        written = import_module(module).export
    except ImportError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise MissingError(f'{package} is not installed: pip install "platoontraffic[{extra}]"') from None
    with result_faults():
        for file in written(folder):
            print(file)


@command
def schema(what: Annotated[str, typer.Argument(help="scenario or study")] = "scenario") -> None:
    """Print the JSON schema of scenario or study files, for editors."""
    from platoontraffic.scenario.schema import scenario_schema
    from platoontraffic.study.study import StudyFile

    files = {"scenario": scenario_schema, "study": StudyFile.model_json_schema}
    if what not in files:
        raise InputError(f"argument 1: {what!r}: no such schema{did_you_mean(what, files)}")
    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **files[what]()})


@command
def doctor(json: Json = False) -> None:
    """Report what is installed and whether SUMO starts; exit code 3 if something is wrong."""
    from platoontraffic.cli.doctor import TROUBLE, examine

    findings = examine()
    if json:
        print_json([finding._asdict() for finding in findings])
    else:
        for finding in findings:
            out.print(f"{finding.verdict:8} {finding.what}: {finding.text}", soft_wrap=True, markup=False)
    if any(finding.verdict == TROUBLE for finding in findings):
        raise typer.Exit(3)


@command
def check(
    files: Annotated[
        list[str],
        typer.Argument(metavar="SCENARIO... [KEY=VALUE]...", help="files or shipped names; keys to change"),
    ],
    platoons: Platoons = None,
    no_plugins: NoPlugins = False,
    json: Json = False,
) -> None:
    """Report the faults of scenario and study files. Nothing is simulated, but SUMO loads the files of scenarios, and
    the code of plug-ins runs."""
    faults: dict[str, tuple[str, ...]] = {}  # by file
    changes = [argument for argument in files if "=" in argument and not os.path.exists(argument)]
    if len(changes) == len(files):
        raise InputError(f"{changes[0]}: a key to change; must stand behind the file or the shipped name that it is of")
    before_code = _before_code(no_plugins)
    for name in (file for file in files if file not in changes):
        faults[name] = ()
        try:
            found = _checked(name, changes, platoons, before_code)
            if not json:
                out.print(f"{name}: {found}", soft_wrap=True)
        except InputError as error:
            faults[name] = error.faults
    if json:
        print_json({"files": [{"file": name, "faults": of_file} for name, of_file in faults.items()]})
    if any(faults.values()):
        raise InputError(*([] if json else [fault for of_file in faults.values() for fault in of_file]))


def _before_code(no_plugins: bool, results: Path | None = None) -> BeforeCode:
    """What happens before the plug-ins of a scenario are imported; see `foreign_code.say`."""
    from platoontraffic.cli import foreign_code

    return foreign_code.refuse if no_plugins else foreign_code.say(results)


def _checked(name: str, changes: list[str], platoons: str | None, before_code: BeforeCode) -> str:
    """Check a file; returns the text to print if it has no faults. raises: InputError"""
    from platoontraffic import scenario as scenarios
    from platoontraffic.study import study

    if study.is_study(name):
        return f"fine, {counted(len(study.load(name, changes, before_code).runs), 'run')}"
    checked = scenarios.load(name, changes, platoons=platoons, before_code=before_code)
    print_remarks(prepared := _runs().prepare(checked))
    try_to_load(prepared)
    return "fine"


@command
def list_(
    what: Annotated[str, typer.Argument(help="scenarios, studies, nets, laws, vehicles or lidars")] = "scenarios",
    json: Json = False,
) -> None:
    """List the names of scenarios, studies, networks, laws, vehicles or lidars."""
    from platoontraffic.controllers.registry import find_law, law_names
    from platoontraffic.lidar import PRESETS
    from platoontraffic.vehicles.catalogue import VEHICLES

    listings: dict[str, Callable[[], dict[str, str]]] = {
        "scenarios": lambda: {name: title(file) for name, file in shipped.scenarios().items()},
        "studies": lambda: {name: title(file) for name, file in shipped.studies().items()},
        "nets": lambda: {name: str(file) for name, file in shipped.networks().items()},
        "laws": lambda: {name: first_line(find_law(name, Path()).kind) for name in law_names()},
        "vehicles": lambda: {name: f"{v.length:g} x {v.width:g} m" for name, v in VEHICLES.items()},
        "lidars": lambda: {
            name: f"{m.samples} beams, {degrees(m.angle_max - m.angle_min):.4g} deg, "
            f"{m.range_min:g} to {m.range_max:g} m"
            for name, m in PRESETS.items()
        },
    }
    if what not in listings:
        raise InputError(f"argument 1: {what!r}: no such list{did_you_mean(what, listings)}")
    if json:
        print_json(listings[what]())
        return
    listing = listings[what]()
    width = max(map(len, listing), default=0)
    for name, text in listing.items():
        out.print(f"{name:{width}} {text}", soft_wrap=True)


@command
def new(name: Annotated[str, typer.Argument(help="folder to make; also the name of the scenario")]) -> None:
    """Make a folder with a scenario and a law of your own to start from."""
    from platoontraffic.cli.starter import write_starter

    folder = write_starter(Path(name))
    out.print(
        f"made {folder}: a scenario and, in follower.py, its law, both to be changed. Run it with", soft_wrap=True
    )
    out.print(f"  platoontraffic run {quote(f'{folder / folder.name}.toml')}", soft_wrap=True, markup=False)


ROUTES = 24  # of `prove` ...
SEEDS, WARM_UP, DURATION = 5, 300.0, 600.0  # ... and with --traffic [s]; an option that has no effect is refused


@command
def prove(
    net: Annotated[
        str, typer.Argument(metavar="NET|CFG", help="network file, name of a shipped one, or SUMO configuration")
    ],
    routes: Annotated[
        int | None, typer.Option(min=1, show_default=f"{ROUTES}", help="without --traffic: number of random routes")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="seed of the routes and of the sensors' errors")] = 1,
    vehicle: Annotated[str, typer.Option(help="car, van or truck")] = "car",
    traffic: Annotated[
        bool, typer.Option("--traffic", help="two platoons of five in traffic, against SUMO's own cars")
    ] = False,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1, show_default=f"{SEEDS}", help="with --traffic: number of seeds, each with routes of its own"
        ),
    ] = None,
    warm_up: Annotated[
        float | None,
        typer.Option(
            "--warm-up", min=0, show_default=f"{WARM_UP:g}", help="with --traffic: time before the platoons start [s]"
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(min=1, show_default=f"{DURATION:g}", help="with --traffic: time that the platoons have [s]"),
    ] = None,
    results: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="with --traffic: folder to keep scenarios and runs in")
    ] = None,
    json: Json = False,
) -> None:
    """Drive random routes of a network, and report where that goes wrong; exit code 1 if it does."""
    from platoontraffic.cli.prove import check_vehicle, prove_alone, prove_traffic, road_of

    end_as_at_control_c()
    check_vehicle(vehicle)
    road = road_of(net)
    in_traffic = {"--seeds": seeds, "--warm-up": warm_up, "--duration": duration, "--results": results}
    if alien := [name for name, value in in_traffic.items() if value is not None and not traffic]:
        raise InputError(*(f"{name}: goes with --traffic; must be left out" for name in alien))
    if routes is not None and traffic:
        raise InputError("--routes: does not go with --traffic; must be left out")
    if traffic:
        with TemporaryDirectory(prefix="platoontraffic-") as temporary:
            folder, numbers = results or Path(temporary), range(seed, seed + (seeds or SEEDS))
            times = WARM_UP if warm_up is None else warm_up, duration or DURATION
            holds = prove_traffic(road, numbers, vehicle, *times, folder, json)
    else:
        holds = prove_alone(road, routes or ROUTES, seed, vehicle, json)
    if not holds:
        raise typer.Exit(1)


@command
def string(
    law: Annotated[str, typer.Argument(metavar="LAW", help="name of a law, or module:Class beside the scenario")],
    changes: Changes = None,
    scenario: Annotated[
        str, typer.Option(help="a scenario, of which the first platoon, the channel and the step are used")
    ] = "string",
    results: ResultsFolder = Path("results/string"),
    json: Json = False,
) -> None:
    """Measure the string stability of a law on a straight road, beside the theory of its linearisation."""
    from platoontraffic.cli.string import measure

    end_as_at_control_c()
    measure(law, changes or [], scenario, results, json)


@command
def plot(
    run_folder: RunFolder,
    what: Annotated[
        str | None,
        typer.Option(
            "--what", help="names of pictures with commas between, or all; default: one sheet of paths and gaps"
        ),
    ] = None,
    format: Annotated[str | None, typer.Option("--format", help="png, svg or pdf")] = None,
    to: Annotated[
        Path | None, typer.Option("--to", help="file of a single picture; default RUN/plot.png or RUN/plot-NAME.png")
    ] = None,
) -> None:
    """Draw pictures of a run: paths, time-space diagram, gaps, speeds, lanes and others; --what says which."""
    from platoontraffic.analysis.pictures import FORMATS, NAMES, picture, pictures

    names = [name.strip() for name in (what or "").split(",") if name.strip()]
    known = [*NAMES, "all"]
    hints = {name: did_you_mean(name, known) for name in names if name not in known}
    faults = [  # a hint that lists what is known says nothing more
        f"--what: {name!r}: no such picture; there are {', '.join(known)}{hint if 'did you mean' in hint else ''}"
        for name, hint in hints.items()
    ]
    if format and format not in FORMATS:
        faults.append(f"--format: {format!r}: must be png, svg or pdf")
    if to and (len(names) > 1 or "all" in names):
        faults.append("--to: is for a single picture")
    if to and format:
        faults.append("--format: is not for --to, whose file says it by its name")
    if faults:
        raise InputError(*faults)
    ending = format or "png"
    with result_faults():
        if names and not to:
            for file in pictures(run_folder, [] if "all" in names else names, ending):
                print(file)
        else:
            print(picture(run_folder, to or run_folder / f"plot.{ending}", names[0] if names else "sheet"))


@command
def replay(
    run_folder: RunFolder,
    to: Annotated[Path | None, typer.Option("--to", help="page to make; default RUN/replay.html")] = None,
    vehicle: Annotated[str | None, typer.Option("--vehicle", help="member that is selected first")] = None,
    beside: Annotated[
        Path | None, typer.Option("--beside", metavar="RUN", help="a second run, which plays beside the first")
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            "--video", metavar="FILE", help="a .gif, .mp4 or .webm, or a folder of frames, in place of a page"
        ),
    ] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", help="with --video: seconds of the run in one of the video; default: 4")
    ] = None,
) -> None:
    """Make one HTML page that plays a run in any browser, without a network; or a video."""
    from platoontraffic.replay import page, page_of_two

    if video and (to or vehicle or beside):
        raise InputError("--video: cannot be with --to, --vehicle or --beside, which are for pages")
    if speed is not None and not video:
        raise InputError("--speed: is only for a video; give --video as well")
    with result_faults():
        if video:
            from platoontraffic.replay.video import video as written

            print(written(run_folder, video, 4.0 if speed is None else speed))
        elif beside:
            print(page_of_two(run_folder, beside, to or run_folder / "replay-beside.html", vehicle))
        else:
            print(page(run_folder, to or run_folder / "replay.html", vehicle))


@command
def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN...|BATCH", help="folder of a run, of several to compare with the first, or of a batch"
        ),
    ],
    to: Annotated[
        Path | None, typer.Option("--to", help="page to make; default report.html in the first folder")
    ] = None,
    metric: Annotated[
        str | None,
        typer.Option("--metric", help="columns of a batch's summary.csv to draw, with commas between; default: two"),
    ] = None,
) -> None:
    """Make one HTML page of figures, metrics, events or failures; the figures are beside it as PNG and SVG."""
    from platoontraffic.report import batch_page, comparison_page, page

    folder = folders[0]
    is_batch = (folder / "study.toml").is_file()
    if metric is not None and not (is_batch and len(folders) == 1) and all(one.is_dir() for one in folders):
        raise InputError("--metric: is only for batches; the report of a run has all metrics")
    with result_faults():
        if len(folders) > 1:
            print(comparison_page(folders, to or folder / "comparison.html"))
        elif is_batch:
            print(batch_page(folder, to or folder / "report.html", metric))
        else:
            print(page(folder, to or folder / "report.html"))


@command
def bench(
    what: Annotated[
        str,
        typer.Argument(help="lidar: the cost of scans; traffic: of a step, beside SUMO alone; env: of environments"),
    ],
    quick: Annotated[bool, typer.Option("--quick", help="small towns only; takes half a minute")] = False,
    compare: Annotated[
        Path | None, typer.Option(metavar="FILE", help="traffic: also print ratios to a document of --json kept before")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="traffic: only of this SUMO configuration, with --platoon")
    ] = None,
    platoons: Platoons = None,
    targets: Annotated[
        bool, typer.Option("--targets", help="lidar, traffic: also say which of the project's own targets are met")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="one JSON document instead of tables")] = False,
) -> None:
    """Measure speed on this machine, in CPU time of one thread."""
    import subprocess

    if what not in ("lidar", "traffic", "env"):
        raise InputError(f"argument 1: {what!r}: no such benchmark; must be lidar, traffic or env")
    if what == "env":
        _bench_env(quick, bool(compare or config or platoons or targets or json))
        return
    benchmark = import_module("platoontraffic.lidar.benchmark" if what == "lidar" else "platoontraffic.cli.bench")
    if (config is None) != (platoons is None) or (config and what != "traffic"):
        raise InputError("--config: goes with bench traffic, and with the platoons of --platoon")
    before = None
    if compare:
        if what != "traffic" or json:
            raise InputError("--compare: is only for bench traffic, without --json")
        before = benchmark.kept(compare)
    try:
        plan = benchmark.city(config, platoons) if config else benchmark.QUICK if quick else benchmark.FULL
        measured = benchmark.run(plan, show_stage)
    except subprocess.CalledProcessError as error:
        raise RunError(f"a process of the benchmark failed: {error.stderr.strip().rpartition(chr(10))[2]}") from error
    finally:
        show_stage("")
    print(measured.json() if json else benchmark.text(measured, targets))
    if before:
        print(f"\n{benchmark.compared(measured, before)}")


def _bench_env(quick: bool, more: bool) -> None:
    if more:
        raise InputError("bench env: takes no option but --quick")
    try:
        from platoontraffic.cli.bench_env import text

        print(text(quick))
    except ImportError as error:
        raise MissingError(f'{error.name} is not installed: pip install "platoontraffic[learn]"') from error


def _runs() -> ModuleType:
    """The module that runs scenarios.

    libsumo warns on stdout, which is for results, of a pyarrow release that it does not know; `doctor` reports it.
    """
    with redirect_stdout(io.StringIO()):
        from platoontraffic import recording
    return recording


def _shard(text: str) -> tuple[int, int]:
    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        raise InputError(f"--shard: {text!r}: must be I/N, from 1/N to N/N")
    return int(number), int(of)
