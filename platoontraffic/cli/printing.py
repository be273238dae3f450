"""Output of commands on stdout: runs, studies and batches, as text or JSON."""

from __future__ import annotations

import json
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from platoontraffic.errors import InputError, counted, not_written, shortened

if TYPE_CHECKING:
    from rich.table import Table

    from platoontraffic.analysis.results import Results
    from platoontraffic.study.batch import Report
    from platoontraffic.study.study import Run, Study
    from platoontraffic.world.prepared import Prepared

# Columns of the table of a run: heading, metric of a member, format.
MOST_MEMBERS = 30  # that are listed; metrics.csv has all
UNTIL = {"arrived": "the last member had left the road", "contact": "the first contact"}  # ends of a run, if sooner
COLUMNS = (
    ("laps", "laps", ".2f"),
    ("right\nshare", "right_lane_share", ".3f"),
    ("gap\nmean", "gap_mean", ".2f"),
    ("\nmin", "gap_min", ".2f"),
    ("\nmax", "gap_max", ".2f"),
    ("cross-\ntrack max", "cross_track_max", ".2f"),
    ("lock-on\nratio", "lock_on_ratio", ".3f"),
    ("lock\nlosses", "lock_losses", ".0f"),
    ("contacts", "collisions", ".0f"),
)
WIDEST = 10_000  # longest line of a table [characters]
FAILURES = 10  # number of failures of a batch that are printed
ROUTE_FAULTS, FAULT = 3, 160  # number of faults of routes that are printed, and longest one [characters]

out = Console(highlight=False, markup=False)  # names may have brackets


def print_wide(table: Table) -> None:
    """Print a table in lines as long as it needs, even where the terminal's, or a file's, are shorter: cut numbers are
    wrong ones."""
    Console(highlight=False, markup=False, width=WIDEST).print(table, crop=False)


def print_json(document: Any) -> None:
    text = json.dumps(document, indent=2, ensure_ascii=False)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(document, indent=2)
    print(text)


def replay_of(folder: Path) -> Path | None:
    """The page of a run, made now; None, and a note, if no member was ever on the road."""
    from platoontraffic.replay import NoMembersError, page

    with result_faults():
        try:
            return page(folder, folder / "replay.html")
        except NoMembersError as error:
            print(f"there is no replay: {error}", file=sys.stderr)
            return None


def document(folder: Path, replay: Path | None) -> dict[str, Any]:
    """What `--json` prints of a run. replay: its page, if there is one"""
    return {"folder": str(folder), "summary": summary(folder)} | ({"replay": str(replay)} if replay else {})


@contextmanager
def result_faults(hint: str = "") -> Iterator[None]:
    """Report a missing or damaged file of results as bad input, and one that cannot be written by its cause."""
    from platoontraffic.analysis.reading import ResultsError

    try:
        yield
    except ResultsError as error:
        raise InputError(f"{error}{hint}") from error
    except OSError as error:
        raise not_written(error) from error


def print_remarks(prepared: Prepared) -> None:
    from platoontraffic.observation import sight, tested  # here, because it takes long to import

    scenario = prepared.scenario
    for remark in scenario.remarks():
        print(remark, file=sys.stderr)
    for file, ids in prepared.unsorted.unsorted.items() if prepared.unsorted else ():
        what = f"{counted(len(ids), 'element')} not loaded, as by SUMO, such as '{ids[0]}'"
        print(f"warning: {file}: {what}: one above departs later; sort the file by departure", file=sys.stderr)
    end = scenario.start + scenario.spec.run.duration_s
    for line in prepared.platooning.plan.summary(scenario.scale, end) if prepared.platooning else ():
        print(line, file=sys.stderr)
    for warning in (*sight.warnings(prepared), *tested.warnings(prepared)):
        print(f"warning: {warning}", file=sys.stderr)


def print_run(folder: Path) -> None:
    """Whether the platoons held, a table of the members, and a line on the whole run."""
    from platoontraffic.analysis.outcome import headline
    from platoontraffic.analysis.results import load_run

    with result_faults("; --force repeats the run"):
        results = load_run(folder)
        said = headline(results.events, results.metrics)
        table = _members(results)
    out.print(said if table.row_count else "There were no members.", soft_wrap=True, markup=False)
    if 0 < table.row_count <= MOST_MEMBERS:
        print_wide(table)
    if "equipped" in set(results.metrics.scope):
        print_wide(_trips(results))
        out.print(_share(results), soft_wrap=True, markup=False)
    lengths = any(str(column.header).startswith(("gap", "cross")) for column in table.columns)
    facts = json.loads((folder / "provenance.json").read_text(encoding="utf-8"))
    for line in not_equipped(facts):
        out.print(line, soft_wrap=True, markup=False)
    whole = results.metrics[results.metrics.scope == "run"].set_index("metric").value
    stood, stranded = whole["standstill_share_mean"], whole["stranded"]
    ended = results.events.detail[results.events.kind == "end"]
    until = next((f", until {words}," for why, words in UNTIL.items() if why in set(ended) and table.row_count), "")
    out.print(
        f"{facts['simulated_s']:g} s{until} at {facts['real_time_factor']:g} x real time, "
        f"contacts {whole['collisions']:g}"
        f"{f', {stood:.0%} of the time at a standstill' if stood > 0 else ''}"
        f"{f', {stranded:g} members stranded' if stranded > 0 else ''}"
        f"{'. Gaps and cross-track in m, while in the platoon' if lengths else ''}",
        soft_wrap=True,
    )
    for text in facts.get("sumo_options_replaced", ()):
        out.print(f"SUMO configuration: {text}", soft_wrap=True, markup=False)


def not_equipped(facts: dict[str, Any]) -> Iterator[str]:
    """Lines on the vehicles of the shares that stay SUMO's. facts: of provenance.json"""
    for why, number in facts.get("not_equipped", {}).items():
        yield f"{number} of the share stay SUMO's: {why}"
    faults = facts.get("undrivable_routes", [])
    for fault in faults[:ROUTE_FAULTS]:
        number, name = fault["vehicles"], fault["such_as"]
        vehicles = f"{number} vehicles, such as {name}" if number > 1 else f"vehicle {name}"
        yield f"  {vehicles}: {shortened(fault['why'], FAULT)}"
    if further := faults[ROUTE_FAULTS:]:
        vehicles = sum(fault["vehicles"] for fault in further)
        yield f"  {vehicles} for {counted(len(further), 'other fault')}: see undrivable_routes in provenance.json"


def _members(results: Results) -> Table:
    """A row a member; without columns that no member has a value of."""
    from rich.table import Table  # here, as the next one: not every command prints one

    metrics = results.metrics
    members = metrics[metrics.scope == "vehicle"].dropna(subset="value")
    of_robots = results.vehicles is not None and results.vehicles.wheelbase_m.isna().all()
    there = {*members.metric} - ({"right_lane_share"} if not of_robots else set())
    columns = [column for column in COLUMNS if column[1] in there]
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("\nmember", no_wrap=True)
    for heading, _, _ in columns:
        table.add_column(heading if "\n" in heading else f"\n{heading}", justify="right", no_wrap=True)
    for vehicle, rows in members.groupby("vehicle_id", sort=False):
        values = rows.set_index("metric").value
        table.add_row(vehicle, *(format(values[name], form) if name in values else "" for _, name, form in columns))
    return table


def _trips(results: Results) -> Table:
    """Trips of the traffic: of its members, of other vehicles, of all."""
    from rich.table import Table

    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("trips of the traffic")
    metrics = results.metrics
    counted = {"arrived": "trips_finished", "on the road": "trips_running", "removed": "trips_removed"}
    if not metrics.value[metrics.metric == "trips_removed"].any():
        del counted["removed"]
    for heading in (*counted, "mean delay of arrived ones in s", "before departure in s"):
        table.add_column(heading, justify="right", no_wrap=True)
    for scope, name in (("equipped", "members"), ("traffic", "others"), ("everybody", "all")):
        values = metrics[metrics.scope == scope].set_index("metric").value
        delays = (values[m] for m in ("delay_mean_finished", "depart_delay_mean_finished"))
        numbers = (f"{values[m]:g}" for m in counted.values())
        table.add_row(name, *numbers, *(f"{d:.1f}" if d == d else "" for d in delays))
    return table


def _share(results: Results) -> str:
    """How many vehicles of the traffic that have departed are members."""
    trips = results.metrics[results.metrics.metric.isin(["trips_finished", "trips_running", "trips_removed"])]
    number = trips.groupby("scope").value.sum()
    members, everybody = number["equipped"], number["everybody"]
    return f"{members:g} of {everybody:g} vehicles are members{f', {members / everybody:.1%}' if everybody else ''}"


def summary(folder: Path) -> dict[str, str | float | None]:
    """The row of a run's summary.csv; empty cells are None."""
    from platoontraffic.analysis.reading import read_table
    from platoontraffic.analysis.results import resources

    with result_faults("; --force repeats the run"):
        texts = [field["name"] for field in resources(folder).get("summary", []) if field["type"] == "string"]
        table = read_table(folder / "summary.csv", texts=texts).astype(object)
    return table.where(table.notna(), None).to_dict("records")[0]


def print_runs(
    study: Study, folder: Path, slots: int, executor: str, as_json: bool, part: tuple[int, int], retry_failed: bool
) -> None:
    """The runs of a part of a study, and an estimate of how long those that it runs take with `slots` at a time."""
    from platoontraffic.study import batch

    mine = batch.part_of(study, batch.Shard(*part))
    states = [batch.state(folder, run.id) for run in mine]
    wanted = batch.wanted(retry_failed)
    waiting = [run for run, state in zip(mine, states, strict=True) if state in wanted]
    simulated = batch.without_equals(study, folder, waiting)
    seconds, estimated_by = batch.estimate(study, folder, simulated)
    shares = batch.shared_warm_ups(simulated, executor)
    columns = ("id", "status", "seed", *study.keys)
    rows = [(run.id, state, run.seed, *run.values.values()) for run, state in zip(mine, states, strict=True)]
    if as_json:
        runs = [dict(zip(columns, row, strict=True)) for row in rows]
        print_json({"folder": str(folder), "runs": runs, "estimate_s": round(seconds / slots, 1)})
        return
    lines = [columns, *(tuple(map(str, row)) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print("  ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())
    print(
        f"{counted(len(rows), 'run')}, {len(waiting)} to do, about {duration_text(seconds / slots)} "
        f"with {slots} at a time ({estimated_by}); the batch would write {folder}"
    )
    if equal := equal_runs(mine):
        print(equal)
    if shares:
        shared = sum(map(len, shares.values()))
        print(
            f"{shared} of them share warm-ups, of which {len(shares)} {'is' if len(shares) == 1 else 'are'} simulated: "
            f"{sum(run.warm_up_s for runs in shares.values() for run in runs[1:]):g} s of traffic are saved"
        )


def equal_runs(runs: Sequence[Run]) -> str:
    """How many runs are equal to others, because nothing in them depends on their seed; "": none is."""
    points = Counter(run.point for run in runs if not run.random)
    more = sum(points.values()) - len(points)
    if not more:
        return ""
    are = "is equal to another" if more == 1 else "are equal to others"
    return f"{more} of these runs {are}, because nothing in them is random: one seed is simulated"


def print_report(report: Report, folder: Path) -> None:
    """The outcome of a batch, and how one of its runs is repeated; folder: the batch's."""
    runs, earlier, done, failed, _ = report.progress
    before = f" ({earlier} of them earlier)" if earlier else ""
    print(f"{counted(runs, 'run')}: {done} done{before}, {failed} failed")
    for run_id, error in list(report.failures.items())[:FAILURES]:
        print(f"  {run_id}: {error}")
    if failed > FAILURES:
        print(f"  and {failed - FAILURES} more, in runs.csv")
    if failed:
        print("  details: RUN.unfinished/failure.json; --retry-failed repeats these runs")
    if done:
        print(f"a run alone, RUN being its id in summary.csv: platoontraffic run {folder / 'RUN' / 'config.toml'}")


def duration_text(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def title(file: Path) -> str:
    """The title in a scenario or study file; "" if it has none."""
    return tomllib.loads(file.read_text(encoding="utf-8")).get("title", "")


def first_line(kind: type) -> str:
    """The first line of a class's docstring."""
    return (kind.__doc__ or "").strip().partition("\n")[0]
