"""`run --branch-at`: a run that goes on as it is, and as others with keys changed."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.table import Table

from platoontraffic.branches.process import can_fork
from platoontraffic.branches.runs import Branch, Ended, Source, check_has_no_branch, run_branches
from platoontraffic.cli.alone import alone
from platoontraffic.cli.last_resort import try_to_load
from platoontraffic.cli.printing import document, out, print_json, print_remarks, print_wide, replay_of, result_faults
from platoontraffic.cli.progress import RunBar, err, run_progress, say
from platoontraffic.errors import InputError, RunError
from platoontraffic.recording import check_place, is_done, result_folder, run
from platoontraffic.scenario import Change
from platoontraffic.scenario.overrides import branch_of, check_once
from platoontraffic.world.prepared import Prepared, branched


def run_with_branches(
    source: Source,
    prepared: Prepared,
    at: float | None,
    then: Sequence[str],
    results: Path,
    *,
    dry_run: bool,
    force: bool,
    quiet: bool,
    json: bool,
    replay: bool,
) -> list[Path]:
    """The command `run` with branches; arguments as there. The folders of all results, that without a branch first."""
    made = branches_of(prepared, at, then, results)
    if not quiet:
        print_remarks(prepared)
    folder = result_folder(prepared.scenario, results)
    folders = [folder, *(branch.folder for branch, _ in made)]
    if dry_run:
        check_place(folder.parent)
        try_to_load(prepared)
        if json:
            print_json({"folders": [{"folder": str(one), "done": is_done(one)} for one in folders]})
        else:
            out.print(f"{prepared.scenario.source}: fine; would write {', '.join(map(str, folders))}", soft_wrap=True)
        return []
    run_all(source, prepared, folder, made, force, quiet or json)
    if json:
        made_here = {one: replay_of(one) for one in folders if replay}
        print_json({"folders": [document(one, made_here.get(one)) for one in folders]})
        return []
    if not quiet:
        print_differences(folders, then)
    return folders


def branches_of(
    prepared: Prepared, at: float | None, then: Sequence[str], results: Path
) -> list[tuple[Branch, Prepared]]:
    """The branches that `--branch-at` and `--then` ask for, checked.

    then : changes of each, `key=value`, or several with ";" between them

    raises: InputError with one line for every fault found
    """
    if at is None:
        raise InputError("--then: needs --branch-at, the time of the change in seconds")
    if not then:
        raise InputError(
            "--branch-at: needs --then, what changes at that time: --then platoon.follower.time_headway_s=2"
        )
    check_has_no_branch(prepared.scenario)
    made: list[tuple[Branch, Prepared]] = []
    faults: list[str] = []
    for number, texts in enumerate(then, start=1):
        try:
            changes = [_change(text.strip(), number) for text in texts.split(";") if text.strip()]
            check_once(changes)
            scenario = prepared.scenario.branched(branch_of(at, changes))
            folder = result_folder(scenario, results)
            made.append((Branch(tuple(branch_of(at, changes)), folder), branched(prepared, scenario)))
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(*dict.fromkeys(faults))
    return made


def _change(text: str, number: int) -> Change:
    try:
        return Change.parse(text, number)._replace(place=f"--then {number}")
    except InputError as error:
        raise InputError(*(fault.replace("argument", "--then", 1) for fault in error.faults)) from None


def run_all(
    source: Source,
    prepared: Prepared,
    folder: Path,
    made: Sequence[tuple[Branch, Prepared]],
    force: bool,
    quiet: bool,
) -> None:
    """Run what is missing.

    raises: RunError if one of them fails, after the others have ended; what `run` raises
    """

    def to_do() -> dict[Path, tuple[Branch, Prepared]]:
        return {branch.folder: (branch, one) for branch, one in made if force or not is_done(branch.folder)}

    missing = to_do()
    if not missing and is_done(folder):
        if not quiet:
            err.print("results of equal runs exist; they are not repeated without --force", soft_wrap=True)
        return
    spec, at = prepared.scenario.spec, made[0][1].scenario.spec.branch.at_s
    total = at + (spec.run.duration_s - at) * (1 + len(missing))

    def waits() -> None:
        if not quiet:
            err.print("another process executes one of these runs; this one waits for it", soft_wrap=True)

    with ExitStack() as stack:
        for one in sorted({folder, *missing}):  # in one order, so that two commands do not wait for each other
            stack.enter_context(alone(one, waits, say))
        missing = to_do()  # another process may have done some
        if not missing and is_done(folder) and not force:
            return
        if can_fork:
            bars = stack.enter_context(run_progress(total, spec.name, quiet))
            branches = [branch for branch, _ in missing.values()]
            ended = run_branches(
                source, folder, at, branches, os.cpu_count() or 1, replace=force, say=say, reached=_sum_on(bars)
            )
        else:
            say("this system cannot copy a process: each run is simulated from its begin, with the same results")
            runs = [(prepared, folder), *((one, branch.folder) for branch, one in missing.values())]
            ended = [Ended(run(one, to, replace=force, say=say)) for one, to in runs]
    if failed := [one for one in ended if one.error]:
        raise RunError("\n".join(f"{one.folder}: {one.error}" for one in failed))


def print_differences(folders: Sequence[Path], names: Sequence[str]) -> None:
    """The metrics of the whole runs that differ, and by how much.

    names: of the branches
    """
    from platoontraffic.analysis.comparison import cells, compared

    with result_faults("; --force repeats the runs"):
        metrics = compared(folders, "run")
    if metrics.empty:
        out.print("No metric of the whole run differs.")
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    for number, name in enumerate(names, start=1):
        out.print(f"{number}: {name}", soft_wrap=True, markup=False)
    out.print("+ and -: difference to the run without branch; =: value, where that run has none", soft_wrap=True)
    table.add_column("metric that differs", no_wrap=True)
    for heading in (*(f"in {number}" for number in range(1, len(folders))), "without branch"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in metrics.itertuples():
        unit = f" [{row.unit}]" if isinstance(row.unit, str) and row.unit else ""
        table.add_row(f"{row.metric}{unit}", *cells(row))
    print_wide(table)


def _sum_on(bars: Sequence[RunBar]) -> Callable[[float], None]:
    """A function that shows the sum of what it is given [s]."""
    reached = 0.0

    def more(simulated: float) -> None:
        nonlocal reached
        reached += simulated
        for bar in bars:
            bar.reach(reached)

    return more
