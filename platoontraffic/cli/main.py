"""The command line; how commands end is in `commands`."""

from __future__ import annotations

import io
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from platoontraffic import shipped
from platoontraffic.cli.commands import commands_of
from platoontraffic.cli.nets import nets_app
from platoontraffic.errors import InputError, MissingError, RunError, did_you_mean

if TYPE_CHECKING:
    from platoontraffic.scenario import Scenario
    from platoontraffic.study import batch as batches
    from platoontraffic.study.study import Study

app = typer.Typer(
    help="Platoons that drive by laser scanner, in SUMO traffic.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(nets_app, name="nets")
out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


command = commands_of(app)

ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="a scenario file, the name of a shipped one, or a SUMO configuration")
]
Changes = Annotated[
    list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="keys of the scenario to change: platoon.size=3")
]
Platoons = Annotated[
    str | None,
    typer.Option("--platoon", metavar="FILE", help="platoons for a SUMO configuration: a file of tables `platoon`"),
]
Seed = Annotated[int | None, typer.Option(help="instead of the scenario's")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="no progress and no summary: print the folder only")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON document instead")]
Results = Annotated[Path, typer.Option("--out", help="folder for results")]


@command
def run(
    scenario: ScenarioName,
    changes: Changes = None,
    platoons: Platoons = None,
    seed: Seed = None,
    results: Results = Path("results"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="check everything, start nothing")] = False,
    force: Annotated[bool, typer.Option("--force", help="run again although an equal run is there")] = False,
    replay: Annotated[
        bool, typer.Option("--replay", help="record traffic and scans too, and make replay.html of the run")
    ] = False,
    gui: Annotated[
        bool, typer.Option("--gui", help="watch it in sumo-gui while it runs; the results are the same")
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run a scenario; leave its tables in OUT/NAME/RUN."""
    from platoontraffic import scenario as scenarios

    simulation = _simulation()
    # A cluster ends jobs by SIGTERM; what was recorded is kept then as at Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    checked = scenarios.load(scenario, changes or (), seed, platoons)
    if replay:
        checked = checked.for_replay()
    prepared = simulation.prepare(checked)
    window = simulation.Window(prepared.members, prepared.scene.solids) if gui else None
    if not quiet:
        _remark(checked)
    folder = simulation.result_folder(checked, results)
    if dry_run and json:
        _print_json({"folder": str(folder), "members": len(prepared.members), "done": (folder / "DONE").is_file()})
        return
    if dry_run:
        out.print(f"{checked.source}: fine, {len(prepared.members)} in all; would write {folder}", soft_wrap=True)
        return
    from platoontraffic.results.recorder import is_done

    if is_done(folder) and not force:
        if not quiet and not json:
            err.print(f"an equal run is already there and is not repeated (--force would): {folder}")
    else:
        with _progress(checked.spec.run.duration_s, checked.spec.name, quiet) as progress:
            simulation.simulate(prepared, folder, progress, replace=force, window=window)
    if json:
        _print_json({"folder": str(folder), "summary": _summary(folder)})
        return
    if not quiet:
        _show(folder)
    if replay:
        from platoontraffic.replay import page

        with _results():
            made = page(folder, folder / "replay.html")
        if not quiet:
            out.print(f"to open in a browser: {made}", soft_wrap=True)
    print(folder)


@command
def batch(
    study: Annotated[str, typer.Argument(metavar="STUDY", help="a study file, or the name of a shipped one")],
    changes: Annotated[
        list[str] | None, typer.Argument(metavar="[KEY=VALUE]...", help="keys of the scenario, for every run")
    ] = None,
    slots: Annotated[
        int | None, typer.Option("-j", "--jobs", min=1, help="runs at a time; default: as many as processors")
    ] = None,
    executor: Annotated[
        str, typer.Option(help="processes, serial, dask (a cluster for this batch), or dask:ADDRESS of a running one")
    ] = "processes",
    shard: Annotated[str, typer.Option(metavar="I/N", help="do part I of N, from 1; parts may run at a time")] = "1/1",
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="do again what failed")] = False,
    results: Results = Path("results"),
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="list the runs and how long they take, start none")
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Do all runs of a study that are not there yet; leave them and their tables in OUT/STUDY."""
    from platoontraffic.study import batch as batches
    from platoontraffic.study import study as studies

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if executor not in ("processes", "serial", "dask") and not executor.startswith("dask:"):
        hint = did_you_mean(executor, ["processes", "serial", "dask"])
        raise InputError(f"--executor: {executor!r}: no executor{hint}; or dask:ADDRESS")
    part = _shard(shard)
    loaded = studies.load(study, changes or ())
    folder, slots = results / loaded.name, slots or os.cpu_count() or 1
    if dry_run:
        _show_runs(loaded, folder, 1 if executor == "serial" else slots, json)
        return
    with _batch_progress(loaded.name, quiet or json) as progress:
        report = batches.run(loaded, folder, executor, slots, part, retry_failed, progress)
    if json:
        _print_json({"folder": str(folder), **report.progress._asdict(), "failures": report.failures})
    elif not quiet:
        _show_report(report, folder)
    if not json:
        print(folder)
    if report.failures:
        raise typer.Exit(1)


@command
def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN|BATCH", help="the folder of a run, or for parquet of a batch")],
    to: Annotated[str, typer.Option("--to", help="parquet, mcap (ROS 2, Foxglove) or fcd (SUMO)")] = "parquet",
) -> None:
    """Write the tables as Parquet beside the CSV, of a batch those of all runs in one; or a run in others' formats."""
    kinds = {
        "parquet": ("platoontraffic.analysis.parquet", "pyarrow", "parquet"),
        "mcap": ("platoontraffic.export.rosbag", "rosbags", "ros"),
        "fcd": ("platoontraffic.export.fcd", "", ""),
    }
    if to not in kinds:
        raise InputError(f"--to: {to!r}: must be parquet, mcap or fcd{did_you_mean(to, kinds)}")
    module, package, extra = kinds[to]
    try:
        written = import_module(module).export
    except ImportError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise MissingError(f'{package} is not installed: pip install "platoontraffic[{extra}]"') from None
    with _results():
        for file in written(folder):
            print(file)


@command
def schema(what: Annotated[str, typer.Argument(help="scenario or study")] = "scenario") -> None:
    """Print the JSON schema of scenario or study files, for editors."""
    from platoontraffic.scenario import Spec
    from platoontraffic.study.study import StudyFile

    files = {"scenario": Spec, "study": StudyFile}
    if what not in files:
        raise InputError(f"argument 1: {what!r}: no schema of it{did_you_mean(what, files)}")
    _print_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **files[what].model_json_schema()})


@command
def doctor(json: Json = False) -> None:
    """Say what is installed, whether SUMO starts, and what gets in the way; exit code 3 if something does."""
    from platoontraffic.cli.doctor import TROUBLE, examine

    findings = examine()
    if json:
        _print_json([finding._asdict() for finding in findings])
    else:
        for finding in findings:
            out.print(f"{finding.verdict:8} {finding.what}: {finding.text}", soft_wrap=True, markup=False)
    if any(finding.verdict == TROUBLE for finding in findings):
        raise typer.Exit(3)


@command
def check(
    files: Annotated[
        list[str], typer.Argument(metavar="SCENARIO... [KEY=VALUE]...", help="files, or shipped names; keys to change")
    ],
    platoons: Platoons = None,
    json: Json = False,
) -> None:
    """Say what is wrong with scenario and study files, without running them."""
    from platoontraffic import scenario as scenarios
    from platoontraffic.study import study

    simulation = _simulation()
    faults: dict[str, tuple[str, ...]] = {}  # by file
    changes = [argument for argument in files if "=" in argument and not Path(argument).exists()]
    for name in (file for file in files if file not in changes):
        faults[name] = ()
        said = "fine"
        try:
            if study.is_study(name):
                said = f"fine, {len(study.load(name, changes).runs)} runs"
            else:
                checked = scenarios.load(name, changes, platoons=platoons)
                simulation.prepare(checked)
                _remark(checked)
            if not json:
                out.print(f"{name}: {said}", soft_wrap=True)
        except InputError as error:
            faults[name] = error.faults
    if json:
        _print_json({"files": [{"file": name, "faults": its} for name, its in faults.items()]})
    if any(faults.values()):
        raise InputError(*([] if json else [fault for its in faults.values() for fault in its]))


@command
def list_(
    what: Annotated[str, typer.Argument(help="scenarios, studies, nets, laws, vehicles or lidars")] = "scenarios",
    json: Json = False,
) -> None:
    """List what there is by name."""
    from platoontraffic.controllers.registry import find_law, law_names
    from platoontraffic.lidar import PRESETS
    from platoontraffic.vehicles.catalogue import VEHICLES

    listings: dict[str, Callable[[], dict[str, str]]] = {
        "scenarios": lambda: {name: _title(file) for name, file in shipped.scenarios().items()},
        "studies": lambda: {name: _title(file) for name, file in shipped.studies().items()},
        "nets": lambda: {name: str(file) for name, file in shipped.networks().items()},
        "laws": lambda: {name: _first_line(find_law(name, Path()).kind) for name in law_names()},
        "vehicles": lambda: {name: f"{v.length:g} x {v.width:g} m" for name, v in VEHICLES.items()},
        "lidars": lambda: {
            name: f"{m.samples} beams, {m.angle_max - m.angle_min:.4g} rad, {m.range_min:g} to {m.range_max:g} m"
            for name, m in PRESETS.items()
        },
    }
    if what not in listings:
        raise InputError(f"argument 1: {what!r}: nothing to list{did_you_mean(what, listings)}")
    if json:
        _print_json(listings[what]())
        return
    for name, text in listings[what]().items():
        out.print(f"{name:16} {text}", soft_wrap=True)


@command
def new(name: Annotated[str, typer.Argument(help="folder to make; also the scenario's name")]) -> None:
    """Make a folder with a scenario and a follower of your own to start from."""
    from platoontraffic.cli.starter import write_starter

    folder = write_starter(Path(name))
    out.print(f"made {folder}: a scenario, and in follower.py a law, both yours to change; run it with", soft_wrap=True)
    out.print(f"  platoontraffic run {folder / folder.name}.toml", soft_wrap=True)


@command
def plot(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="the folder of a run")],
    to: Annotated[Path | None, typer.Option("--to", help="picture file; default RUN/plot.png")] = None,
) -> None:
    """Draw the paths on the road and the gaps over time."""
    from platoontraffic.analysis.pictures import picture

    with _results():
        print(picture(run_folder, to or run_folder / "plot.png"))


@command
def replay(
    run_folder: Annotated[Path, typer.Argument(metavar="RUN", help="the folder of a run")],
    to: Annotated[Path | None, typer.Option("--to", help="page to make; default RUN/replay.html")] = None,
    vehicle: Annotated[str | None, typer.Option("--vehicle", help="member to begin with")] = None,
) -> None:
    """Make one HTML page that plays the run in any browser, without a network."""
    from platoontraffic.replay import page

    with _results():
        print(page(run_folder, to or run_folder / "replay.html", vehicle))


@command
def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN|BATCH", help="the folder of a run or of a batch")],
    to: Annotated[Path | None, typer.Option("--to", help="page to make; default FOLDER/report.html")] = None,
    metric: Annotated[
        str | None, typer.Option("--metric", help="column of a batch's summary.csv to draw; default: two that differ")
    ] = None,
) -> None:
    """Make one HTML page of pictures, metrics and events, or failures; the pictures also as PNG and SVG beside it."""
    from platoontraffic.report import batch_page, page

    to = to or folder / "report.html"
    with _results():
        if (folder / "study.toml").is_file():
            print(batch_page(folder, to, metric))
        elif metric is not None:
            raise InputError("--metric: is for batches; a run's report has them all")
        else:
            print(page(folder, to))


@command
def bench(
    what: Annotated[str, typer.Argument(help="lidar: what scans cost; traffic: a whole step, against SUMO alone")],
    quick: Annotated[bool, typer.Option("--quick", help="small towns only, half a minute")] = False,
    json: Annotated[bool, typer.Option("--json", help="one JSON document instead of tables")] = False,
) -> None:
    """Measure how fast it is here, in CPU time of one thread."""
    if what not in ("lidar", "traffic"):
        raise InputError(f"argument 1: {what!r}: nothing to measure by that name; must be lidar or traffic")
    import subprocess

    if what == "lidar":
        from platoontraffic.lidar import benchmark as bench
    else:
        from platoontraffic.cli import bench

    def progress(stage: str) -> None:
        if err.is_terminal:
            print(f"\r\x1b[K{stage}", end="", file=sys.stderr, flush=True)

    try:
        report = bench.run(bench.QUICK if quick else bench.FULL, progress)
    except subprocess.CalledProcessError as error:
        raise RunError(f"a process of the benchmark failed: {error.stderr.strip().rpartition(chr(10))[2]}") from error
    finally:
        progress("")
    print(report.json() if json else bench.text(report))


def main() -> None:
    """Entry point."""
    app()


@contextmanager
def _results():
    """What is wrong with the folder of a run is bad input."""
    from platoontraffic.analysis.results import ResultsError

    try:
        yield
    except ResultsError as error:
        raise InputError(str(error)) from error


def _simulation() -> ModuleType:
    """Of a pyarrow that it does not know libsumo warns on stdout, which is for results; `doctor` says it instead."""
    with redirect_stdout(io.StringIO()):
        from platoontraffic import simulation
    return simulation


def _print_json(document: Any) -> None:
    from json import dumps

    print(dumps(document, indent=2, ensure_ascii=False))


def _summary(folder: Path) -> dict[str, str | float | None]:
    """The row of a run's summary.csv; empty cells are None."""
    from csv import DictReader

    with (folder / "summary.csv").open(encoding="utf-8", newline="") as file:
        row = next(DictReader(file))
    return {name: _number(text) for name, text in row.items()}


def _number(text: str) -> str | float | None:
    try:
        return float(text) if text else None
    except ValueError:
        return text


def _shard(text: str) -> batches.Shard:
    from platoontraffic.study.batch import Shard

    number, _, of = text.partition("/")
    if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
        raise InputError(f"--shard: {text!r}: must be I/N, from 1/N to N/N")
    return Shard(int(number), int(of))


def _show_runs(study: Study, folder: Path, slots: int, json: bool) -> None:
    """The runs of a study, and how long those take that are to be done."""
    from platoontraffic.study import batch as batches

    states = [batches.state(folder, run.id) for run in study.runs]
    waiting = [run for run, state in zip(study.runs, states, strict=True) if state == batches.WAITING]
    seconds, judged_by = batches.estimate(study, folder, waiting)
    columns = ("id", "status", "seed", *study.keys)
    rows = [(run.id, state, run.seed, *run.values.values()) for run, state in zip(study.runs, states, strict=True)]
    if json:
        runs = [dict(zip(columns, row, strict=True)) for row in rows]
        _print_json({"folder": str(folder), "runs": runs, "estimate_s": round(seconds / slots, 1)})
        return
    lines = [columns, *(tuple(map(str, row)) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print("  ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())
    print(
        f"{len(rows)} runs, {len(waiting)} to do, about {_duration(seconds / slots)} with {slots} at a time "
        f"({judged_by}); would write {folder}"
    )


def _show_report(report: batches.Report, folder: Path) -> None:
    runs, earlier, done, failed, _ = report.progress
    before = f" ({earlier} of them before)" if earlier else ""
    print(f"{runs} runs: {done} done{before}, {failed} failed")
    for run_id, error in list(report.failures.items())[:10]:
        print(f"  {run_id}: {error}")
    if failed > 10:
        print(f"  and {failed - 10} more, in runs.csv")
    if failed:
        print("  RUN.unfinished/failure.json says more of each; --retry-failed does them again")


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@contextmanager
def _batch_progress(name: str, quiet: bool):
    """As `_progress`, of runs; what remains is judged by the runs of this batch so far."""
    if quiet or not err.is_terminal:
        yield lambda progress: None
        return
    columns = [TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[said]}"), TimeElapsedColumn()]
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(name, total=None, said="the first runs are on their way")
        began = time.monotonic()

        def tell(at: batches.Progress) -> None:
            ended = at.done + at.failed
            left = (time.monotonic() - began) / at.ended_now * (at.runs - ended)
            failed = f", {at.failed} failed" if at.failed else ""
            said = f"{ended} of {at.runs}{failed}, {_duration(left)} left"
            bar.update(task, total=at.runs, completed=ended, said=said)

        yield tell


def _remark(checked: Scenario) -> None:
    for remark in checked.remarks():
        print(remark, file=sys.stderr)


@contextmanager
def _progress(duration: float, name: str, quiet: bool):
    """A bar on stderr, where that is a terminal; yields what the run reports its time to."""
    if quiet or not err.is_terminal:
        yield lambda time: None
        return
    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of at most {task.total:.0f} s"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(name, total=duration)
        yield lambda time: bar.update(task, completed=time)


def _show(folder: Path) -> None:
    """The figures one looks at first."""
    import json

    from platoontraffic.analysis.results import ResultsError, load

    try:
        metrics = load(folder).metrics
    except ResultsError as error:
        raise InputError(f"{error}; --force runs again") from error
    facts = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    columns = {
        "laps": ("laps", ".2f"),
        "right": ("right_lane_share", ".3f"),
        "gap": ("gap_mean", ".2f"),
        "least": ("gap_min", ".2f"),
        "most": ("gap_max", ".2f"),
        "off path": ("cross_track_max", ".2f"),
        "lock-on": ("lock_on_ratio", ".3f"),
        "losses": ("lock_losses", ".0f"),
        "contacts": ("collisions", ".0f"),
    }
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("member", no_wrap=True)
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    members = metrics[metrics.scope == "vehicle"].dropna(subset="value")
    for vehicle, rows in members.groupby("vehicle_id", sort=False):
        values = rows.set_index("metric").value
        table.add_row(
            vehicle, *(format(values[name], form) if name in values else "" for name, form in columns.values())
        )
    out.print(table)
    whole = metrics[metrics.scope == "run"].set_index("metric").value
    stood = (
        f", {whole['standstill_share_mean']:.0%} of the time at a standstill" if whole["standstill_share_mean"] else ""
    )
    out.print(
        f"{facts['simulated_s']:g} s at {facts['real_time_factor']:g} x real time, "
        f"contacts {whole['collisions']:g}{stood}. Gaps and distance off the predecessor's path in m; "
        "right: share of the time right of the road's middle",
        soft_wrap=True,
    )


def _title(file: Path) -> str:
    import tomllib

    return tomllib.loads(file.read_text(encoding="utf-8")).get("title", "")


def _first_line(kind: type) -> str:
    return (kind.__doc__ or "").strip().partition("\n")[0]
